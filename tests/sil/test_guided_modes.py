"""Framers guided by sliding modes: the C is the reference bit for bit, and what is wrong in it is noticed."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, built, compile_, mutant, write
from helpers.guided import stand_in
from helpers.small_modes import exact_course
from helpers.small_sliding import stand_in as alone
from helpers.tools import need
from sil.test_sliding import signals

from codegen.host import build
from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


@pytest.mark.parametrize("name, real, layout", [("no input, two outputs", "float32", "loop"),
                                                ("turned", "float64", "literal")])
def test_c_equals_the_reference(name, real, layout, tmp_path):
    """Without inputs; with one, in other coordinates; one with an input in those of x is in the gallery."""
    design = stand_in(name, GUARDED)
    u, y, q = signals(design, real, 9, 45)
    reference = design.observer.run_many(u, y, q, real)
    driver = built(design, tmp_path, real, layout)
    assert driver.run_many(u, y, q).differs(reference) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    n_modes = design.plant.n_modes
    assert set(np.unique(reference.status)) >= {0, 3}
    assert (reference.raw_bits & 1).any() and (reference.raw_bits & 2).any() and not reference.raw_bits.all()
    assert not reference.assured.any() and set(np.unique(reference.mode)) == set(range(n_modes))
    assert driver.run_many(u, y, (q + 1) % n_modes).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:2, :9], y[:2, :9], q[:2, :9], **box).differs(
        design.observer.run_many(u[:2, :9], y[:2, :9], q[:2, :9], real, **box)) == []


MUTANTS = {
    "framers of another mode": ("held.mode = out->mode;", "held.mode = 0U;"),
    "last measurement forgotten": ("held.y[0] = s->told_y[0];", "held.y[0] = given.y[0];"),
    "live from the start": ("(!blind) && (s->age > 0U)", "(s->age > 0U)"),
    "not cut": ("if (kept && (own.x_hi[i] < out->x_hi[i]))", "if (kept)"),
    "bits forgotten": ("        raw |= valve_framers", "        (void)valve_framers"),
}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder, signals and answers that every mutant is held against."""
    design = stand_in()
    given = signals(design, "float32", 9, 45)
    folder = write(design, tmp_path_factory.mktemp("guided") / "good")
    return folder, given, design.observer.run_many(*given, "float32")


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    good, (u, y, q), expected = reference
    assert mutant(good, tmp_path / "mutant", MUTANTS[name]).run_many(u, y, q).differs(expected)


TURNED = {
    "z of the start": ("if ((!kept) || (s->told_z_lo[i] <= held.z_lo[i]))", "if (s->told_z_lo[i] <= held.z_lo[i])"),
    "z that does not follow": ("    valve_told_to_z(&held);\n", "")}


@pytest.mark.parametrize("name", TURNED)
def test_mutants_of_other_coordinates_are_noticed(name, tmp_path):
    design = stand_in("turned")
    given = signals(design, "float32", 9, 45)
    folder = write(design, tmp_path / "c", "float32", "table")
    text, (old, new) = (folder / "valve.c").read_text(), TURNED[name]
    assert text.count(old) == 1
    (folder / "valve.c").write_text(text.replace(old, new))
    assert build(folder).run_many(*given).differs(design.observer.run_many(*given, "float32"))


PARAMETERS = {"as it is": ("", ""), "last parameter forgotten": ("= s->told_theta[0];", "= in->theta[0];"),
              "bounds of a parameter not looked at": ("if ((status == VALVE_OK) && (!valve_theta_accepted(in)))",
                                                      "if ((status != VALVE_OK) && (!valve_theta_accepted(in)))")}


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_reach_the_framers(name, tmp_path):
    """One that is measured, one that is not; some beyond their bounds."""
    design = stand_in("parameters", GUARDED)
    runs = [exact_course(design.plant, 40, 45, seed, seed % 2) for seed in (4, 5)]
    u, y, q, theta = (np.stack([getattr(run, k) for run in runs]).reshape(2, 45, -1) for k in ("u", "y", "q", "theta"))
    theta[1, 30] *= 50
    expected = design.observer.run_many(u, y, q[..., 0], "float32", theta=theta)
    folder = write(design, tmp_path / "c", "float32", "literal")
    text, (old, new) = (folder / "valve.c").read_text(), PARAMETERS[name]
    assert old in text and set(np.unique(expected.status)) == {0, 4}
    (folder / "valve.c").write_text(text.replace(old, new))
    assert bool(build(folder).run_many(u, y, q[..., 0], theta=theta).differs(expected)) == bool(old)


def test_the_decision_is_that_of_the_estimator_until_an_alarm(reference):
    """And the bounds are never wider than its own, the residuals neither."""
    _, (u, y, q), trace = reference
    own = alone().observer.run_many(u, y, q, "float32")
    quiet = np.cumsum(trace.raw_bits != 0, axis=1) == 0
    assert quiet.mean() > 0.2
    for name in ("mode", "mode_set", "candidate", "age"):
        assert np.array_equal(getattr(trace, name)[quiet], getattr(own, name)[quiet])
    here, there = ((o.x_hi - o.x_lo)[quiet & (own.status == 0)] for o in (trace, own))
    assert np.all(here <= there) and here.mean() < there.mean()


def test_compilers_and_header(tmp_path):
    need("clang", "g++")
    folder = write(stand_in("no input, two outputs"), tmp_path / "c", "float32", "literal")
    compile_(["clang", *CLANG, "-O1", "-c", "valve.c", "-o", "valve.o"], folder)
    assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
    header = " ".join((folder / "valve.h").read_text().replace("\n *", " ").split())
    assert "out->assured is 0 at every sample" in header and "a decision that is not right (yet)" in header
    assert "#define VALVE_BIT_B 0x4U" in header and "#define VALVE_BIT_CROSSED 0x8U" in header
