"""Framers driven by a mode estimator: the C is the reference bit for bit, and what is wrong in it is noticed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.driven import AGES, plant, stand_in
from helpers.folders import CLANG, CXX, GCC, built, compile_, mutant, write
from helpers.small_modes import exact_course
from helpers.tools import need
from sil.test_equal import stimulus

from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


def signals(design, name, real, runs=8, steps=60):
    """Half of the runs true courses, some of their samples missing; the others quiet, wild, refused."""
    t, rng = design.observer.tables[real], np.random.default_rng(3)
    u, y, q = stimulus(t, rng, runs, steps)
    theta, measured = np.stack([np.full((steps, 0), 0.0)] * runs), t.vary is not None and t.vary.parameters
    if measured:
        theta = rng.uniform(*plant(name).limits("theta"), (runs, steps, len(plant(name).theta)))
        theta[-1, ::7] = 9
    for run in range(runs // 2):
        course = exact_course(plant(name), AGES, steps, run)
        u[run], missing = course.u, np.isnan(y[run])
        y[run] = course.y
        y[run][missing & (run % 2 == 0)] = np.nan
        theta[run] = course.theta if measured else theta[run]
    return u, y, q, theta


@pytest.mark.parametrize("name, real, layout, supervision", [
    ("constant", "float32", "literal", None), ("parameters", "float32", "table", GUARDED),
    ("hidden", "float64", "loop", None), ("discrete", "float64", "literal", None),
    ("turned", "float64", "literal", GUARDED)])
def test_c_equals_the_reference(name, real, layout, supervision, tmp_path):
    design = stand_in(name, supervision)
    u, y, q, theta = signals(design, name, real)
    reference = design.observer.run_many(u, y, q, real, theta=theta)
    driver = built(design, tmp_path, real, layout)
    assert driver.run_many(u, y, q, theta=theta).differs(reference) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    assert set(np.unique(reference.status)) == {0, 2, 3} | ({4} if theta.shape[2] else set())
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.latched_bits.any()
    assert reference.assured.any() and not reference.assured.all() and len(np.unique(reference.mode_set)) > 1
    assert driver.run_many(u, y, 1 - q, theta=theta).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:2], y[:2], q[:2], theta=theta[:2], **box).differs(
        design.observer.run_many(u[:2], y[:2], q[:2], real, theta=theta[:2], **box)) == []


MUTANTS = {
    "step of another mode": ("held.mode = q;", "held.mode = 0U;"),
    "last bounds of another mode": ("held.x_lo[i] = s->frame_lo[at + i];", "held.x_lo[i] = s->frame_lo[i];"),
    "always measured": ("if (measured && (s->measured != 0U))", "if (measured)"),
    "not widened": ("if (kept && (age == 0U))", "if (kept && (age == 9U))"),
    "widened by all": ("if (kept && (age == 0U))", "if (kept)"),
    "not narrowed": ("s->box_hi[at + i] = above[i] + xi_room[i];", "s->box_hi[at + i] += xi_room[i];"),
    "what has begun is narrowed": ("for (uint32_t age = 1U;", "for (uint32_t age = 0U;"),
    "not cut to the boxes": ("if (kept && (s->frame_lo[to + i] > least))", "if (kept)"),
    "bounds outlive an alarm": ("            valve_whole_range(s);\n            s->framed = 0U;",
                                "            valve_whole_range(s);\n            s->framed = 3U;"),
    "parameters of this sample": ("held.theta[i] = s->theta[i];", "held.theta[i] = in->theta[i];"),
    "no check of parameters": ("(!valve_theta_accepted(in))", "(!valve_theta_accepted(in) && (status != VALVE_OK))"),
}


TURNED = {
    "z of another mode": ("held.z_lo[i] = s->frame_z_lo[at + i];", "held.z_lo[i] = s->frame_z_lo[i];"),
    "z from before a switch": ("const bool moved = kept && (!valve_lives(s, q, 0U));", "const bool moved = kept;"),
    "z that is not cut": ("if ((!moved) || (s->frame_z_hi[at + i] >= held.z_hi[i]))", "if (!moved)"),
    "z that does not follow": ("    valve_to_z(s);\n", "")}


@pytest.fixture(scope="module")
def references(tmp_path_factory):
    """Folder, signals and answers that every mutant of a plant is held against."""
    @cache
    def made(name):
        design = stand_in(name)
        given = signals(design, name, "float32")
        u, y, q, theta = given
        folder = write(design, tmp_path_factory.mktemp(name) / "good")
        return folder, given, design.observer.run_many(u, y, q, "float32", theta=theta)
    return made


@pytest.mark.parametrize("plant_name, name", [*(("parameters", name) for name in MUTANTS),
                                              *(("turned", name) for name in TURNED)])
def test_mutants_are_noticed(plant_name, name, references, tmp_path):
    good, (u, y, q, theta), expected = references(plant_name)
    assert mutant(good, tmp_path / "mutant", (MUTANTS | TURNED)[name]).run_many(u, y, q, theta=theta).differs(expected)


def test_compilers_and_symbols(tmp_path):
    need("clang", "g++")
    for name, real, layout in (("parameters", "float32", "literal"), ("turned", "float64", "loop")):
        folder = write(stand_in(name), tmp_path / real, real, layout)
        compile_(["clang", *CLANG, "-O1", "-c", "valve.c", "-o", "valve.o"], folder)
        assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["gcc", *GCC, "-O1", "-c", "valve.c"], folder)
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
    compile_(["gcc", "-O1", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "good"], folder)
    compile_(["./good"], folder)
