"""A point observer that follows a mode estimator: the C is the reference bit for bit, and what is wrong is noticed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, GCC, compile_, mutant, write
from helpers.follower import AGES, plant, stand_in
from helpers.small_modes import exact_course
from helpers.tools import need
from sil.test_equal import stimulus

from codegen.host import build
from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


def signals(design, name, real, runs=6, steps=40):
    """Half of the runs true courses, some of their samples missing; the others quiet, wild, refused."""
    t, rng = design.observer.tables[real], np.random.default_rng(3)
    u, y, q = stimulus(t, rng, runs, steps)
    for run in range(runs // 2):
        course = exact_course(plant(name), 4 * AGES, steps, run)
        u[run], missing = course.u.reshape(steps, -1), np.isnan(y[run])
        y[run] = course.y
        y[run][missing & (run % 2 == 0)] = np.nan
    return u, y, q


@pytest.mark.parametrize("name, real, layout, supervision", [
    ("box", "float64", "loop", GUARDED), ("ellipsoid", "float32", "table", None),
    ("table", "float64", "literal", GUARDED)])
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
    assert driver.run_many(u, y, 0 * q).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:2], y[:2], q[:2], **box).differs(
        design.observer.run_many(u[:2], y[:2], q[:2], real, **box)) == []


MUTANTS = {
    "step of another mode": ("held->mode = q;", "held->mode = 0U;"),
    "always measured": ("if (measured && (s->measured != 0U))", "if (measured)"),
    "never outside": ("_told_outside(&held, &given, &own) != 0U);", "_told_outside(&held, &given, &own) > 9U);"),
    "not narrowed": ("s->box_hi[at + i] = above[i] + xi_room[i];", "s->box_hi[at + i] += xi_room[i];"),
    "what has begun starts nothing": ("|| valve_lives(s, out->mode, 0U))", "|| (out->mode > 9U))"),
    "bounds of the observer not used": ("(age == 0U) && (q == s->followed)", "(age == 0U) && (q == 9U)"),
    "outlives an alarm": ("            valve_whole_range(s);\n            s->followed = VALVE_MODES;",
                          "            valve_whole_range(s);"),
    "last measurement forgotten": ("s->told_y[0] = in->y[0];", "s->told_y[0] = 0.0F;"),
    "noise of the sample forgotten": ("held->origin = s->told_origin;", "held->origin = VALVE_MODES;"),
}


#: Of a table.
OF_A_TABLE = {
    "size of the start not looked at": ("if (!(half[i] <= start[k][i]))", "if (!(half[i] <= half[i]))"),
    "rows stand still": ("        s->since++;\n", "        s->since = 0U;\n"),
    "a missing sample forgotten": ("    s->stage = VALVE_TOLD_ANEW;\n    s->since = 0U;\n}", "    s->since = 0U;\n}"),
    "rows of another mode": ("[stage][in->mode][row][i]", "[stage][0U][row][i]"),
}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder, signals and answers that every mutant is held against, by case."""
    @cache
    def made(case):
        design = stand_in(case)
        given = signals(design, case, "float32", 8, 60)
        folder = write(design, tmp_path_factory.mktemp("follower") / "good")
        return folder, given, design.observer.run_many(*given, "float32")

    return made


@pytest.mark.parametrize("case, name", [("zonotope", k) for k in MUTANTS] + [("table", k) for k in OF_A_TABLE])
def test_mutants_are_noticed(case, name, reference, tmp_path):
    good, (u, y, q), expected = reference(case)
    assert mutant(good, tmp_path / "mutant", (MUTANTS | OF_A_TABLE)[name]).run_many(u, y, q).differs(expected)


def test_compilers_and_symbols(tmp_path):
    need("clang", "g++")
    folder = write(stand_in("box"), tmp_path / "c", "float64", "loop")
    compile_(["clang", *CLANG, "-O0", "-c", "valve.c", "-o", "valve.o"], folder)
    assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["gcc", *GCC, "-O0", "-c", "valve.c"], folder)
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
