"""Observers that solve the algebraic equations themselves: the C equals the reference; what it says of the plant."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.descriptors import GENERATED
from helpers.folders import write
from helpers.solved import stand_in
from helpers.tools import need

from codegen.analysis.frequency import responses
from codegen.analysis.validate import validate
from codegen.designs import Design, read_design
from codegen.emit.layouts import LAYOUTS
from codegen.host import build
from codegen.observers import DescriptorObserver
from codegen.plant.simulate import simulate

need("gcc")
CONTACT = GENERATED / "disc_contact_descriptor-direct"


def same(design: Design, folder, real: str = "float32") -> bool:
    """Whether C and reference answer the same to the last bit, on inputs that reach every answer."""
    t, rng = design.observer.tables[real], np.random.default_rng(2)
    u = rng.uniform(1.01 * t.u_lo, 1.01 * t.u_hi, (20, 60, 1)).astype(real)
    y = (rng.choice([0.1, 1.0], (20, 1, 1)) * rng.uniform(1.02 * t.y_lo, 1.02 * t.y_hi, (20, 60, 2))).astype(real)
    y[rng.random(y.shape[:2]) < 0.1] = np.nan
    q = np.zeros(y.shape[:2], int)
    trace = design.observer.run_many(u, y, q, real)
    assert {0, 2, 3} == set(np.unique(trace.status)) and trace.raw_bits.any() and trace.assured.any()
    assert 0 < trace.settled.mean() < 1 and 0 < trace.inside.mean() < 1
    return build(folder).run_many(u, y, q).differs(trace) == []


@pytest.mark.parametrize("uneven, real, layout", [(True, "float64", LAYOUTS[-1]), (False, "float32", LAYOUTS[0])])
def test_c_equals_the_reference(uneven, real, layout, tmp_path):
    design = stand_in(uneven, real)
    assert same(design, write(design, tmp_path, real, layout), real)


MUTANTS = [("pivot = g[0] + g[1]", "pivot = h[0] + h[1]"), ("obs_weights(s->z, h)", "obs_weights(s->y, h)"),
           ("(g[1] * v[1])", "(h[1] * v[1])"), ("inside, r, true, out)", "inside, r, false, out)")]


@pytest.mark.parametrize("old, new", MUTANTS)
def test_a_mutant_of_the_c_is_noticed(old, new, tmp_path):
    design = stand_in(True)
    folder = write(design, tmp_path)
    text = (folder / "obs.c").read_text()
    assert old in text
    (folder / "obs.c").write_text(text.replace(old, new, 1))
    assert not same(design, folder)


@lru_cache
def contact() -> Design:
    return read_design(CONTACT)


def test_the_contact_force_is_estimated_from_an_inconsistent_start():
    """Nothing measures it: spin and force of the start are 0, 0.75 rad/s and 9.7 N follow from the equations."""
    design = contact()
    truth = simulate(design.plant, replace(design.plant.scenarios[1], steps=200), seed=1)
    trace = design.observer.run(truth.u, truth.y)
    error, size = np.abs(trace.x_hat - truth.x), np.ptp(truth.x, axis=0)
    assert np.linalg.matrix_rank(np.vstack([design.plant.polytope.E, design.plant.polytope.C])) == 2
    assert error[0, 2:].max() < 0.1 and np.all(error.max(axis=0) < 0.02 * size) and trace.assured.all()
    spoilt = replace(design.observer.tables["float32"], Q=0 * design.observer.tables["float32"].Q)
    wrong = DescriptorObserver({"float32": spoilt}, design.observer.supervision).run(truth.u, truth.y)
    assert np.abs(wrong.x_hat - truth.x)[:, 3].max() > 0.2 * size[3]


def test_faults_are_found_and_low_thresholds_found_out(tmp_path):
    design = contact()
    driver = build(write(design, tmp_path / "own"))
    outcome = validate(replace(design, plant=replace(design.plant, scenarios=design.plant.scenarios[2:])), driver)[0]
    assert [e.delay for e in outcome.episodes] == [0, 0] and outcome.passed
    tables = {r: replace(t, h=t.h / 8) for r, t in design.observer.tables.items()}
    low = replace(design, observer=DescriptorObserver(tables, design.observer.supervision),
                  plant=replace(design.plant, scenarios=(replace(design.plant.scenarios[1], steps=100),)))
    corner = validate(low, build(write(low, tmp_path / "low")))[0]
    assert corner.false_alarms > 0 and not corner.differences


def test_gains_by_frequency_are_those_of_a_time_series():
    """A sinusoid on one sensor, the plant at rest: after a long time, sample by sample, at each vertex."""
    design = contact()
    p, t, k = design.plant, design.observer.tables["float64"], 90
    r, size = responses(p, t, faults=np.array([1])), np.max(np.abs(p.limits("f")), axis=0)
    angle = 2 * np.pi * r.frequency[k] * p.sample_period
    wave = size[1] * np.exp(1j * angle * np.arange(6000))
    for j in range(2):
        (of_z, _), z, out = t.estimate(j), np.zeros(p.n_x, dtype=complex), []
        for f in wave:
            x_hat = of_z @ z
            out.append(p.polytope.Df[:, 1] * f - t.C @ x_hat)
            z = t.F[j] @ x_hat - t.K[j] @ out[-1]
        assert np.linalg.norm(out[-1]) == pytest.approx(r.fault[j, k], rel=1e-6)
