"""Validation of a tracking law: the compiled C in the loop with the true plant, held against its certificate."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from helpers.tools import need
from helpers.tracking import GENERATED_ROOT, designed, observer

from codegen.analysis.bad_signals import mean_loop, towards
from codegen.analysis.steering import LOOP, names
from codegen.analysis.validate import validate
from codegen.emit.render import render
from codegen.emit.view import build as view
from codegen.errors import PlantError, ValidationError
from codegen.host.build import build
from codegen.pipeline import require
from codegen.report import plots, steering_words
from codegen.report.verdict import verdict

need("gcc")
KEPT = GENERATED_ROOT / "quadrotor_tracking"
RECORD = {"state_bytes": 60, "operations_per_step": {"multiply": 1, "add": 1, "compare": 1}, "measured": {}}
REST, ENERGY, ENDS, MISSING = (LOOP + name for name in ("from the initial box to rest", "from rest, the largest energy",
                                                        "disturbances at their ends", "samples missing"))
FAULT, FAR = LOOP + "yaw gyro", LOOP + "towards the largest yaw_torque"


@pytest.fixture(scope="module")
def outcomes():
    """By name, all of them: of the plant file, and in the loop."""
    return {o.scenario.name: o for o in validate(designed(), build(KEPT))}


def test_every_promise_is_kept_in_the_loop(outcomes):
    plant = designed().plant
    assert list(outcomes) == [s.name for s in plant.scenarios] + names(plant) and len(names(plant)) == 9
    require(designed(), "float32", list(outcomes.values()))
    assert all(o.passed for o in outcomes.values())
    for name in names(plant):
        steering, trace = outcomes[name].steering, outcomes[name].trace
        if name not in (FAULT, MISSING):
            assert not steering.limited.any() and trace.assured.all() and len(steering.figures) >= 2
            assert all(0 < found <= most for _, found, most in steering.figures)
    energy, decay = outcomes[ENERGY].steering.figures[-1], outcomes[REST].steering.figures[-1]
    assert energy[1] > 0.6 * energy[2] and 0.98 < decay[1] < decay[2] < 1  # near what is certified
    assert np.isnan(outcomes[MISSING].truth.y).any() and outcomes[FAULT].episodes[0].delay == 0


def test_the_output_follows_its_reference(outcomes):
    run = outcomes[ENDS]
    at = np.arange(len(run.truth.q)) % 240 > 220
    assert np.abs(run.truth.x[at, :3] - run.steering.ref[at]).max() < 0.4 * 0.15
    assert np.abs(run.truth.x[:, :3]).max() > 0.12


def test_bad_signals_drive_an_input_further(outcomes):
    """At the very last sample, further than any draws; and they are within their bounds."""
    plant, t = designed().plant, designed().observer.tables["float32"]
    for i, s in enumerate(plant.u):
        u = outcomes[f"{LOOP}towards the largest {s.name}"].truth.u[:, i]
        assert u.max() > 1.2 * np.abs(outcomes[ENDS].truth.u[:, i]).max() and np.argmax(u) > len(u) - 6
    ref, signals = towards(plant, t, mean_loop(plant, t), 0, 40)
    assert set(np.abs(ref).ravel()) <= set(t.law.reference) and np.all(np.abs(signals.w) <= plant.limits("w")[1])


def tampered(folder, **fields):
    """The design with another law, and its C; the certificate is that of the old one."""
    tables = {real: replace(t, law=replace(t.law, **{k: change(t.law) for k, change in fields.items()}))
              for real, t in designed().observer.tables.items()}
    made = replace(designed(), observer=observer(tables))
    shutil.copytree(KEPT, folder)
    (folder / "quadrotor.c").write_text(render("polytopic.c.jinja", d=view(made, "float32", "table", "")))
    return made, build(folder)


@pytest.mark.parametrize("fields, run, words", [
    ({"Ki": lambda law: -law.Ki}, REST, "did not shrink"),
    ({"Kx": lambda law: law.Kx * law.Kx.dtype.type(0.5)}, ENERGY, "energy gain"),
    ({"limit": lambda law: law.limit / 16}, FAR, "was cut"),
    ({"Ki": lambda law: law.Ki * law.Ki.dtype.type(6)}, FAR, "certified is at most")])
def test_a_law_that_is_not_the_certified_one_breaks_a_promise(fields, run, words, tmp_path):
    """C and reference agree: only the certificate can tell."""
    made, driver = tampered(tmp_path / "c", **fields)
    (o,) = validate(made, driver, [run])
    assert o.differences == [] and any(words in broken for broken in o.steering.broken) and not o.passed
    with pytest.raises(ValidationError, match="expected what the certificate says"):
        require(made, "float32", [o])
    assert verdict(made, "float32", RECORD, [o]).word == "Validation failed"


def test_c_that_is_not_the_reference_shows(tmp_path):
    folder = shutil.copytree(KEPT, tmp_path / "c")
    source = folder / "quadrotor.c"
    source.write_text(source.read_text().replace("law->s[i] = next[i];", "law->s[i] = next[i] * 1.0000002F;"))
    (o,) = validate(designed(), build(folder), [REST])
    assert "u" in o.differences and not o.passed


def test_the_report_shows_it(outcomes):
    (found,) = steering_words.tables(list(outcomes.values()))
    assert len(found.rows) == sum(len(o.steering.figures) for o in outcomes.values() if o.steering) == 16
    assert steering_words.tables([outcomes["no fault"]]) == ()
    shown = [name for name, o in outcomes.items() if o.steering and o.steering.drawn]
    assert shown == [ENDS, FAULT] and plots.residuals(designed().plant, outcomes[REST], "s1") == ()
    (plot,) = plots.tracking(designed(), "float32", outcomes[ENDS], "s1")
    assert f'aria-label="Tracking in {ENDS}"' in plot.svg and "roll_torque" in plot.svg
    assert "cut at 0 samples" in plot.caption and plots.tracking(designed(), "float32", outcomes[REST], "s1") == ()


def test_the_verdict_says_so(outcomes):
    said = verdict(designed(), "float32", RECORD, list(outcomes.values()))
    assert said.kind == "ok" and "9 runs in the loop" in said.result and "steers roll, pitch and yaw" in said.purpose


def test_names_of_runs_can_be_asked_for():
    with pytest.raises(PlantError, match="in the loop: samples missing"):
        validate(designed(), build(KEPT), ["in the loop: something else"])
