"""The mode estimator by sliding modes: the C is the reference bit for bit; mutants of the C are noticed."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, GCC, built, compile_, write
from helpers.small_modes import exact_course
from helpers.small_sliding import stand_in
from helpers.tools import need
from sil.test_equal import stimulus

from codegen.emit.cprint import literal
from codegen.host import build
from codegen.observers import Supervision

SUPERVISIONS = {"one input": Supervision(debounce=(2, 3), latch=False, recover=4, hold=3),
                "no input, two outputs": None}


def signals(design, real, runs=15, steps=50):
    """A third of the runs true courses, some of their samples missing; the others quiet, wild, refused."""
    t = design.observer.tables[real]
    u, y, q = stimulus(t, np.random.default_rng(3), runs, steps)
    for run in range(runs // 3):
        course = exact_course(design.plant, 19, steps, run)
        u[run], missing = course.u.reshape(steps, -1), np.isnan(y[run])
        y[run] = course.y
        y[run][missing & (run % 2 == 0)] = np.nan
    return u, y, q


@pytest.mark.parametrize("name, real, layout", [
    ("one input", "float32", "table"), ("one input", "float64", "literal"),
    ("no input, two outputs", "float32", "loop")])
def test_c_equals_the_reference(name, real, layout, tmp_path):
    design = stand_in(name, SUPERVISIONS[name])
    u, y, q = signals(design, real)
    reference = design.observer.run_many(u, y, q, real)
    driver = built(design, tmp_path, real, layout)
    assert driver.run_many(u, y, q).differs(reference) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    n_modes = design.plant.n_modes
    assert set(np.unique(reference.status)) == {0, 3} | ({2} if u.shape[2] else set())
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.latched_bits.any()
    assert not reference.assured.any() and set(np.unique(reference.mode)) == set(range(n_modes))
    assert reference.age.max() > design.observer.tables[real].blank + 1 and len(np.unique(reference.mode_set)) > n_modes
    assert driver.run_many(u, y, (q + 1) % n_modes).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    moved = driver.run_many(u[:4], y[:4], q[:4], **box)
    assert moved.differs(design.observer.run_many(u[:4], y[:4], q[:4], real, **box)) == []
    assert moved.differs(driver.run_many(u[:4], y[:4], q[:4]))


MUTANTS = {
    "explicit step": ("+ (VALVE_PERIOD * rate[i]);", "+ (0.0F * rate[i]);"),
    "sign of the correction": ("z[i] -= ((VALVE_PULL", "z[i] += ((VALVE_PULL"),
    "held gain forgotten": ("value -= (K[q][i][j] * z[j]);", "value -= (0.0F * z[j]);"),
    "restart of all pairs": ("    if (!kept)\n    {\n        valve_widen(lo, hi);", "    if (s->age == 0U)\n    {\n"
                                                                                   "        valve_widen(lo, hi);"),
    "no restart": ("        valve_widen(lo, hi);\n", ""),
    "loops not begun": ("if (fresh || (!kept))", "if (fresh)"),
    "share": ("VALVE_SHARE * s->level", "s->level"),
    "decision at once": ("if (s->age == VALVE_BLANK)", "if (s->age >= 1U)"),
    "bounds not begun": ("        if (blind)\n", "        if (s->age == 0U)\n"),
    "not armed": ("s->refuted | (s->armed & failed)", "s->refuted | failed"),
    "one span": ("(s->last > 0U) && (s->last <= (VALVE_DWELL - since))", "(s->last <= (VALVE_DWELL - since))"),
    "feed": ("value -= (D[i][j]", "value += (D[i][j]"),
    "assured": ("out->assured = 0U;", "out->assured = 1U;"),
}


@pytest.fixture(scope="module")
def reference():
    """Design, signals and answers that every mutant is held against."""
    design = stand_in("one input")
    u, y, q = signals(design, "float32")
    return design, u, y, q, design.observer.run_many(u, y, q, "float32")


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    design, u, y, q, expected = reference
    old, new = MUTANTS[name]
    folder = write(design, tmp_path)
    text = (folder / "valve.c").read_text()
    assert text.count(old) >= 1
    (folder / "valve.c").write_text(text.replace(old, new))
    assert build(folder).run_many(u, y, q).differs(expected)


def test_compilers_and_symbols(tmp_path):
    """With an input; without one and in the other type: test_guided_modes."""
    need("clang", "g++")
    folder = write(stand_in("one input", SUPERVISIONS["one input"]), tmp_path / "c", "float64", "loop")
    for compiler, flags in (("gcc", GCC), ("clang", CLANG)):
        compile_([compiler, *flags, "-O2", "-c", "valve.c", "-o", "valve.o"], folder)
        assert compile_(["nm", "-u", "valve.o"], folder) == ""
        compile_([compiler, *flags, "-O1", "-c", "test_valve.c"], folder)
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)


def test_golden_vectors_notice_tables(tmp_path):
    """The self-test sees a coefficient of the bounds that is off by a hundredth, one of the loops that is doubled.

    The loops show in the candidate alone.
    """
    design = stand_in("one input")
    folder = write(design, tmp_path)
    compile_(["gcc", "-O1", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "good"], folder)
    compile_(["./good"], folder)
    text, t = (folder / "valve.c").read_text(), design.observer.tables["float32"]
    bounds = (t.M_hi[0, 0, 0], t.d_hi[1, 0], t.x_hi[0])
    for value, factor in (*((v, "1.01F") for v in bounds), (t.turn, "2.0F"), (t.share, "0.5F")):
        old = literal(abs(float(value)), "float32")
        assert old in text
        (folder / "valve.c").write_text(text.replace(old, f"({old} * {factor})"))
        compile_(["gcc", "-O0", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "bad"], folder)
        with pytest.raises(AssertionError):
            compile_(["./bad"], folder)
