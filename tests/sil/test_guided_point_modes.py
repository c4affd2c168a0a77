"""Point observers guided by sliding modes: the C is the reference bit for bit, and what is wrong in it is noticed."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, built, compile_, mutant, write
from helpers.guided_point import stand_in
from helpers.small_sliding import stand_in as alone
from helpers.tools import need
from sil.test_sliding import signals

from codegen.observers import Supervision

GUARDED = Supervision(debounce=(2, 3), latch=False, recover=4, hold=3)


@pytest.mark.parametrize("name, real, layout", [("table", "float64", "loop"), ("trace", "float32", "literal")])
def test_c_equals_the_reference(name, real, layout, tmp_path):
    """A set that is listed, with N; one that is computed, with an input."""
    design = stand_in(name, real, GUARDED)
    u, y, q = signals(design, real, 6, 45)
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
    "observer of another mode": ("valve_lend(s, out->mode, &held);", "valve_lend(s, 0U, &held);"),
    "not cut": ("if (kept && (own.x_hi[i] < out->x_hi[i]))", "if (kept)"),
    "not settled": ("    valve_take(s, &held);\n", ""),
    "bits of the estimator's place": ("&own) << 1U;", "&own);"),
    "live from the start": ("(!blind) && (s->age > 0U)", "(s->age > 0U)"),
}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder, signals and answers that every mutant is held against."""
    design = stand_in("box", "float32")
    given = signals(design, "float32", 9, 45)
    folder = write(design, tmp_path_factory.mktemp("guided_point") / "good")
    return folder, given, design.observer.run_many(*given, "float32")


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_noticed(name, reference, tmp_path):
    good, (u, y, q), expected = reference
    assert mutant(good, tmp_path / "mutant", MUTANTS[name]).run_many(u, y, q).differs(expected)


def test_the_decision_is_that_of_the_estimator_until_an_alarm(reference):
    """And the bounds are never wider than its own."""
    _, (u, y, q), trace = reference
    own = alone().observer.run_many(u, y, q, "float32")
    quiet = np.cumsum(trace.raw_bits != 0, axis=1) == 0
    assert quiet.mean() > 0.2
    for name in ("mode", "mode_set", "candidate", "age"):
        assert np.array_equal(getattr(trace, name)[quiet], getattr(own, name)[quiet])
    here, there = ((o.x_hi - o.x_lo)[quiet & (own.status == 0)] for o in (trace, own))
    assert np.all(here <= there)


def test_compilers_header_and_self_test(reference, tmp_path):
    need("clang", "g++")
    folder = shutil.copytree(reference[0], tmp_path / "c")
    compile_(["clang", *CLANG, "-O1", "-c", "valve.c", "-o", "valve.o"], folder)
    assert compile_(["nm", "-u", "valve.o"], folder) == ""
    compile_(["g++", *CXX, "-c", "valve.c", "-o", "valve.oo"], folder)
    header = " ".join((folder / "valve.h").read_text().replace("\n *", " ").split())
    assert "out->assured is 0 at every sample" in header and "a decision that is not right (yet)" in header
    assert "#define VALVE_BIT_LEVEL 0x2U" in header and "#define VALVE_BIT_CROSSED 0x4U" in header
    compile_(["clang", *CLANG, "valve.o", "test_valve.c", "-o", "test"], folder)
    compile_(["./test"], folder)
