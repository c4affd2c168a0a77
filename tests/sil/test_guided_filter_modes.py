"""Filters guided by sliding modes: the C is the reference bit for bit, and what is wrong in it is noticed."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, built, compile_, mutant, write
from helpers.guided_filter import stand_in
from helpers.small_sliding import stand_in as alone
from helpers.tools import need
from sil.test_sliding import signals

from codegen.host import build
from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


def driven(design, real):
    """Signals, of which one true course has a sensor that drifts."""
    u, y, q = signals(design, real, 9, 60)
    y[0, 30:] += 0.01
    return u, y, q


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder, signals and answers that every mutant is held against; limits that are left now and then."""
    design = stand_in("one input", GUARDED, share=0.23)
    given = driven(design, "float32")
    folder = write(design, tmp_path_factory.mktemp("guided_filter") / "good")
    return folder, given, design.observer.run_many(*given, "float32"), design


def test_c_equals_the_reference(reference):
    folder, (u, y, q), trace, design = reference
    driver = build(folder)
    assert driver.run_many(u, y, q).differs(trace) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    assert set(np.unique(trace.status)) >= {0, 3} and not trace.assured.any()
    assert (trace.raw_bits & 1).any() and (trace.raw_bits & 2).any() and not trace.raw_bits.all()
    h, seen = design.observer.tables["float32"].told.h, np.unique(trace.f_bound)
    assert np.isin(h[0, :2], seen).all() and np.isin(h[1, 0], seen).any()  # a start, and from anywhere
    assert driver.run_many(u, y, 1 - q).differs(trace) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:2, :9], y[:2, :9], q[:2, :9], **box).differs(
        design.observer.run_many(u[:2, :9], y[:2, :9], q[:2, :9], "float32", **box)) == []


def test_other_numbers_and_layout(tmp_path):
    design = stand_in("parameters")
    given = driven(design, "float64")
    driver = built(design, tmp_path, "float64", "loop")
    assert driver.run_many(*given).differs(design.observer.run_many(*given, "float64")) == []


MUTANTS = {
    "goes on while blind": ("    if (!kept)\n    {\n        valve_told_start", "    if (s->age == 0U)\n    {\n"
                                                                              "        valve_told_start"),
    "step of another mode": ("valve_advance(s, in, out->mode);", "valve_advance(s, in, 0U);"),
    "never started": ("    s->told_since = 0U;\n}", "}"),
    "never from anywhere": ("        s->told_stage = VALVE_ANYWHERE;\n", ""),
    "live from the start": ("(!blind) && (s->age > 0U)", "(s->age > 0U)"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    good, (u, y, q), expected, _ = reference
    assert (good / "valve.c").read_text().count(MUTANTS[name][0]) == 1
    assert mutant(good, tmp_path / "mutant", MUTANTS[name]).run_many(u, y, q).differs(expected)


def test_everything_else_is_the_estimator_s_until_an_alarm(reference):
    _, (u, y, q), trace, _ = reference
    own = alone(supervision=GUARDED).observer.run_many(u, y, q, "float32")
    quiet = np.cumsum(trace.raw_bits != 0, axis=1) == 0
    assert quiet.mean() > 0.2
    for name in ("mode", "mode_set", "candidate", "age", "x_lo", "x_hi", "r_lo", "r_hi"):
        assert np.array_equal(getattr(trace, name)[quiet], getattr(own, name)[quiet], equal_nan=name[1] == "_")


def test_compilers_header_and_self_test(reference, tmp_path):
    need("clang", "g++")
    folder = shutil.copytree(reference[0], tmp_path / "c")
    compile_(["clang", *CLANG, "-O1", "-c", "valve.c", "-o", "valve.o"], folder)
    assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
    header = " ".join((folder / "valve.h").read_text().replace("\n *", " ").split())
    assert "out->assured is 0 at every sample" in header and "a decision that is not right (yet)" in header
    assert "#define VALVE_BIT_SENSOR 0x2U" in header and "#define VALVE_F_SENSOR 0U" in header
    compile_(["clang", *CLANG, "valve.o", "test_valve.c", "-o", "test"], folder)
    compile_(["./test"], folder)
