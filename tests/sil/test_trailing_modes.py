"""Filters beside a mode estimator: the C is the reference bit for bit, and what is wrong is noticed."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, GCC, compile_, mutant, write
from helpers.small_modes import exact_course
from helpers.tools import need
from helpers.trailing import AGES, plant, stand_in
from sil.test_equal import stimulus

from codegen.host import build
from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


def drifting(p, steps):
    """A quiet run in the first mode, whose first sensor drifts."""
    x, u = (p.x0_lo + p.x0_hi) / 2, np.sum(p.limits("u"), axis=0) / 2
    m, y = p.modes[0], []
    for k in range(steps):
        y.append(m.C @ x + m.D @ u + 0.002 * k * np.eye(p.n_y)[0])
        x = m.A @ x + m.B @ u + m.Bw @ (m.w_lo + m.w_hi) / 2
    return np.tile(u, (steps, 1)), np.array(y)


def signals(design, name, real, runs=6, steps=40):
    """Half of the runs true courses, some samples missing, or a sensor that drifts; the others quiet, wild, refused."""
    t, rng = design.observer.tables[real], np.random.default_rng(3)
    u, y, q = stimulus(t, rng, runs, steps)
    for run in range(runs // 2):
        course, missing = exact_course(plant(name), 4 * AGES, steps, run), np.isnan(y[run])
        u[run], y[run] = course.u.reshape(steps, -1), course.y
        if run % 3 == 2:
            u[run], y[run] = drifting(plant(name), steps)
            missing[:] = False
        y[run][missing & (run % 2 == 0)] = np.nan
    return u, y, q


@pytest.mark.parametrize("name, real, layout, supervision", [
    ("no input", "float32", "table", None), ("parameter", "float64", "loop", GUARDED)])
def test_c_equals_the_reference(name, real, layout, supervision, tmp_path):
    design = stand_in(name, supervision)
    u, y, q = signals(design, name, real)
    reference = design.observer.run_many(u, y, q, real)
    driver = build(write(design, tmp_path, real, layout))
    assert driver.run_many(u, y, q).differs(reference) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    assert set(np.unique(reference.status)) >= {0, 3}
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.latched_bits.any()
    assert reference.assured.any() and not reference.assured.all() and len(np.unique(reference.mode_set)) > 1
    assert len(np.unique(reference.f_bound)) > 12
    assert driver.run_many(u, y, 0 * q).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:2], y[:2], q[:2], **box).differs(
        design.observer.run_many(u[:2], y[:2], q[:2], real, **box)) == []


MUTANTS = {
    "young ones ruled out": ("                s->alive[q] &= 1U;", "                s->alive[q] = 0U;"),
    "what has begun changes nothing": ("(runs && (((alive & 1U) == 0U) || (s->latched != 0U)))", "runs"),
    "an alarm changes nothing": ("const bool kept = none || (", "const bool kept = ("),
    "rows stand still": ("? (s->told_since[q] + 1U) : VALVE_LAST", "? s->told_since[q] : VALVE_LAST"),
    "size of the start not looked at": ("if (!(hi[i] <= largest[k][i]))", "if (!(hi[i] <= hi[i]))"),
    "a missing sample forgotten": ("        s->running = 0U;\n        for", "        for"),
    "decision not taken back": ("        s->decided = s->settled;\n", ""),
    "outlives an alarm": ("        if (none)\n        {\n            valve_loose(s);",
                          "        if (s->decided > 9U)\n        {\n            valve_loose(s);"),
}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder, signals and answers that every mutant is held against."""
    design = stand_in("input")
    given = signals(design, "input", "float32", 6, 60)
    folder = write(design, tmp_path_factory.mktemp("trailing") / "good", layout="literal")
    assert build(folder).run_many(*given).differs(design.observer.run_many(*given, "float32")) == []
    return folder, given, design.observer.run_many(*given, "float32")


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    good, (u, y, q), expected = reference
    assert mutant(good, tmp_path / "mutant", MUTANTS[name]).run_many(u, y, q).differs(expected)


def test_compilers_and_header(tmp_path):
    need("clang", "g++")
    folder = write(stand_in("no input"), tmp_path / "c", "float64", "loop")
    compile_(["clang", *CLANG, "-O0", "-c", "valve.c", "-o", "valve.o"], folder)
    assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["gcc", *GCC, "-O0", "-c", "valve.c"], folder)
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
    compile_(["gcc", "-O1", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "good"], folder)
    compile_(["./good"], folder)
    header = " ".join((folder / "valve.h").read_text().replace("\n *", " ").split())
    assert "whose estimate goes on" in header and "#define VALVE_F_PIPE 1U" in header
