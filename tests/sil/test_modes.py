"""The mode estimator: the C is the reference bit for bit, for one input and none, one output and two."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, GCC, built, compile_, write
from helpers.small_modes import PLANTS, exact_course, stand_in
from helpers.tools import need
from sil.test_equal import stimulus

from codegen.host import build
from codegen.observers import Supervision

AGES = 3
SUPERVISIONS = {"one input": Supervision(debounce=(2, 3), latch=False, recover=4, hold=3),
                "no input, two outputs": None}


def signals(design, real, runs=40, steps=90):
    """A third of the runs true courses, some of their samples missing; the others quiet, wild, refused."""
    t = design.observer.tables[real]
    u, y, q = stimulus(t, np.random.default_rng(3), runs, steps)
    for run in range(runs // 3):
        course = exact_course(design.plant, AGES, steps, run)
        u[run], missing = course.u.reshape(steps, -1), np.isnan(y[run])
        y[run] = course.y
        y[run][missing & (run % 2 == 0)] = np.nan
    return u, y, q


@pytest.mark.parametrize("name, real, layout", [
    ("one input", "float32", "table"), ("one input", "float64", "literal"),
    ("no input, two outputs", "float32", "literal"), ("no input, two outputs", "float64", "loop")])
def test_c_equals_the_reference(name, real, layout, tmp_path):
    design = stand_in(name, AGES, SUPERVISIONS[name])
    u, y, q = signals(design, real)
    reference = design.observer.run_many(u, y, q, real)
    driver = built(design, tmp_path, real, layout)
    assert driver.run_many(u, y, q).differs(reference) == []
    # The samples reach what they are to test; the mode that is handed over is not read.
    n_modes = design.plant.n_modes
    assert set(np.unique(reference.status)) == {0, 3} | ({2} if u.shape[2] else set())
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.latched_bits.any()
    assert reference.assured.any() and not reference.assured.all()
    assert set(np.unique(reference.mode)) == set(range(n_modes))
    assert set(np.unique(reference.age)) == set(range(AGES + 1))
    assert len(np.unique(reference.mode_set)) > n_modes and np.any(reference.settled_set != reference.mode_set)
    assert driver.run_many(u, y, (q + 1) % n_modes).differs(reference) == []
    box = {"x0_lo": design.plant.x0_lo + 0.01, "x0_hi": design.plant.x0_hi + 0.07}
    assert driver.run_many(u[:4], y[:4], q[:4], **box).differs(
        design.observer.run_many(u[:4], y[:4], q[:4], real, **box)) == []


MUTANTS = {
    "switches on samples only": ("below[i] += added_lo[i];", "below[i] += 0.0F;"),
    "no reach": ("above[i] += reach[q][i];", "above[i] -= reach[q][i];"),
    "radius": ("radius += (J_radius[pair][i][k] * ", "radius += (J_radius[pair][k][i] * "),
    "birth of another pair": ("birth[pair][i];\n        above", "birth[0U][i];\n        above"),
    "noise exchanged": ("least = seen - v_hi[i];", "least = seen - v_lo[i];"),
    "the two oldest": ("(n == 1U) && (", "(n == 9U) && ("),
    "oldest forgotten": ("(alive & ((uint32_t)1U << VALVE_OLDEST))", "0U"),
    "births of the young": ("{D}_lives(s, p, VALVE_OLDEST))", "{D}_lives(s, p, VALVE_OLDEST - 1U))"),
    "youngest mode": ("oldest = age;", "oldest = (oldest == 0U) ? age : oldest;"),
    "last of several": ("s->decided = out->mode;", "s->decided = 0U;"),
    "settled": ("(alive >> 1U) != 0U", "alive != 0U"),
    "room": ("below[i] -= room[i];", "below[i] += room[i];"),
    "feed": ("value -= (D[i][j]", "value += (D[i][j]"),
    "sign": ("if (matrix[i][k] >= 0.0F)", "if (matrix[i][k] < 0.0F)"),
    "no alarm": ("none ? VALVE_BIT_NO_MODE : 0U", "none ? 0U : 0U"),
    "no restart": ("if (none)\n        {\n            valve_whole_range(s);", "if (none)\n        {\n"),
}


@pytest.fixture(scope="module")
def reference():
    """Design, signals and answers that every mutant is held against."""
    design = stand_in("one input", AGES)
    u, y, q = signals(design, "float32")
    return design, u, y, q, design.observer.run_many(u, y, q, "float32")


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    design, u, y, q, expected = reference
    old, new = (text.replace("{D}", "valve") for text in MUTANTS[name])
    folder = write(design, tmp_path)
    text = (folder / "valve.c").read_text()
    assert text.count(old) >= 1
    (folder / "valve.c").write_text(text.replace(old, new))
    assert build(folder).run_many(u, y, q).differs(expected)


@pytest.mark.parametrize("name", PLANTS)
def test_compilers_and_symbols(name, tmp_path):
    need("clang", "g++")
    for real, layout in (("float32", "literal"), ("float64", "loop")):
        folder = write(stand_in(name, AGES, SUPERVISIONS[name]), tmp_path / real, real, layout)
        for compiler, flags in (("gcc", GCC), ("clang", CLANG)):
            compile_([compiler, *flags, "-O2", "-c", "valve.c", "-o", "valve.o"], folder)
            assert compile_(["nm", "-u", "valve.o"], folder) == ""
            compile_([compiler, *flags, "-O1", "-c", "test_valve.c"], folder)
        if real == "float32":
            compile_(["gcc", *GCC, "-O1", "-fanalyzer", "-Wstack-usage=512", "-c", "valve.c"], folder)
        compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)


def test_golden_vectors_notice_tables(tmp_path):
    """The self-test of the user sees a coefficient that is off by one in a thousand, in most places."""
    design = stand_in("one input", AGES)
    folder = write(design, tmp_path)
    compile_(["gcc", "-O1", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "good"], folder)
    compile_(["./good"], folder)
    text, t = (folder / "valve.c").read_text(), design.observer.tables["float32"]
    from codegen.emit.cprint import literal

    values = [t.Phi[0, 0, 0], t.Phi[1, 1, 0], t.Gamma[1, 1, 0], t.reach[0, 1], t.birth[0, 1, 1], t.J[1, 0, 0, 0],
              t.J_u[0, 1, 0, 0], t.v_hi[0], t.wide_hi[1], t.start_lo[1], t.S_inverse[1, 1]]
    for value in values:
        old = literal(abs(float(value)), "float32")
        assert old in text
        (folder / "valve.c").write_text(text.replace(old, f"({old} * 1.001F)"))
        compile_(["gcc", "-O0", "-ffp-contract=off", "valve.c", "test_valve.c", "-o", "bad"], folder)
        with pytest.raises(AssertionError):
            compile_(["./bad"], folder)
