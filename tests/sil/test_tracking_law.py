"""Tracking law in C beside its observer: bit by bit the reference, in the loop with the true plant as well."""

from __future__ import annotations

import re
import subprocess
from functools import cache

import numpy as np
import pytest
from helpers.folders import CLANG, CXX, GCC, compile_
from helpers.tools import need
from helpers.tracking import CompiledTracker, closed_loop, designed, observer

from codegen.emit import files
from codegen.observers.feedback import CUT_INPUT, CUT_INTEGRAL, Tracker

need("gcc")
REALS = ["float32", "float64"]


@cache
def printed(real):
    return {name: text for name, text in files(designed(), real, "table", measure=False).items()
            if name in ("quadrotor.c", "quadrotor.h")}


def written(folder, real="float32"):
    """Header and C of the unit."""
    for name, text in printed(real).items():
        (folder / name).write_text(text, encoding="ascii")
    return folder


def signals(steps=84, seed=0):
    """References and measurements of a plant out of control, some lost: integrals and inputs run into their limits."""
    rng = np.random.default_rng(seed)
    ref = np.where(rng.random((steps, 3)) < 0.5, -0.15, 0.15)
    y = rng.uniform(-1, 1, (steps, 6)) * np.geomspace(0.01, 2, steps)[:, None]
    y[steps // 2:, :3] = 1.5
    y[3 * steps // 4:, :3] = -1.5
    y[20], y[30:33] = np.nan, np.nan
    return ref, y


def equal(compiled: CompiledTracker, real: str, ref, y) -> bool:
    """Whether C and reference answer the same, to the last bit; what was limited on the way."""
    unit, limited = Tracker(observer(), real), 0
    for k in range(len(y)):
        status, numbers, words = compiled.sample(ref[k], y[k])
        command, answer = unit.step(ref[k][None], y[k][None])
        r = np.zeros(6) if np.isnan(y[k]).any() else answer.r[0]
        expected = np.concatenate([command.u[0], answer.x_hat[0], r, unit.law.s[0]])
        told = [int(w[0]) for w in (command.limited, answer.raw_bits, answer.latched_bits, answer.assured)]
        if status != 0 or not np.array_equal(numbers, expected.astype(real)) or words.tolist() != told:
            return False
        limited |= int(words[0])
    return limited == CUT_INPUT | CUT_INTEGRAL


@pytest.mark.parametrize("real", REALS)
def test_the_c_equals_the_reference(real, tmp_path):
    assert equal(CompiledTracker(written(tmp_path, real), real), real, *signals())


def test_the_c_steers_the_true_plant_as_the_reference_does(tmp_path):
    """In the loop a bit that differs comes back: the same signals after 220 samples, a sensor fault among them."""
    plant, ref = designed().plant, np.zeros((220, 3))
    ref[50:, 0], ref[120:, 2] = 0.15, -0.15
    fault = np.zeros((220, plant.n_f))
    fault[200:, 0] = 0.2
    missing = np.arange(220) == 60
    run = closed_loop(plant, Tracker(observer()), ref, 4, "corner", fault, missing)
    compiled = CompiledTracker(written(tmp_path), "float32")
    for k in range(220):
        status, numbers, words = compiled.sample(ref[k], run.y[k])
        assert status == 0 and np.array_equal(numbers[:3], run.u[k].astype("float32")), k
        assert words.tolist()[:2] == [run.limited[k], run.raw[k]]
    assert np.flatnonzero(run.raw)[0] == 200 and not run.limited.any()


def test_what_is_refused_changes_nothing(tmp_path):
    compiled = CompiledTracker(written(tmp_path), "float32")
    ref, y = signals()
    for k in range(15):
        compiled.sample(ref[k], y[k])
    before = compiled.memory()
    for bad in (0.16, -0.16, np.inf):
        status, numbers, _ = compiled.sample([0, bad, 0], y[15])
        assert status == 2 and np.all(numbers[:3] == 7)
    assert compiled.sample([0, np.nan, 0], y[15])[0] == 2
    status, numbers, _ = compiled.sample(ref[15], [0, 0, 0, 0, 9, 0])
    assert status == 3 and np.all(numbers[:3] == 7) and compiled.memory() == before
    assert compiled.sample(ref[15], y[15])[0] == 0 and compiled.memory() != before


MUTANTS = [("in->u[0] = -(", "in->u[0] = ("), ("* law->s[1])", "* law->s[0])"), ("(ref[2] - in->y[2])", "(in->y[2])"),
           ("law->limited |= ", "law->limited = "), ("quadrotor_command(s, law, s->y, in)",
           "quadrotor_command(s, law, in->y, in)"), ("law->s[i] = -limit[i];", "law->s[i] = next[i];"),
           ("in->u[i] = most[i];", "in->u[i] = least[i];"), ("(h[1] * v[1])", "(h[0] * v[1])"),
           ("status = quadrotor_step(s, in, out);", "status = quadrotor_predict(s, in, out);")]


@pytest.mark.parametrize("old, new", MUTANTS)
def test_a_mutant_of_the_law_is_noticed(old, new, tmp_path):
    text = (written(tmp_path) / "quadrotor.c").read_text()
    at = text.index(old, text.index("quadrotor_command("))  # of the law, not of the observer
    compiled = CompiledTracker(tmp_path, "float32", text[:at] + new + text[at + len(old):])
    assert not equal(compiled, "float32", *signals())


def self_test(folder):
    """Compile the user's test once; return a function that links a C to it and runs it."""
    compile_(["gcc", "-std=c99", "-c", "test_quadrotor.c", "-o", "test.o"], folder)

    def answer(text):
        (folder / "quadrotor.c").write_text(text)
        compile_(["gcc", "-std=c99", "-ffp-contract=off", "-w", "quadrotor.c", "test.o", "-o", "self"], folder)
        return subprocess.run([folder / "self"], check=False).returncode

    return answer


@pytest.mark.parametrize("real", REALS)
def test_golden_vectors_kill_every_constant_of_the_law(real, tmp_path):
    """Each changed by one in a thousand."""
    for name, text in files(designed(), real, "table", measure=False).items():
        (tmp_path / name).write_text(text, encoding="ascii")
    text, answer = (tmp_path / "quadrotor.c").read_text(), self_test(tmp_path)
    assert answer(text) == 0
    start = text.index("static uint32_t quadrotor_command")
    places = [m for m in re.finditer(r"(?<=\()\d+\.\d*F?(?= \*)", text) if m.start() > start]
    assert len(places) > 15
    for m in places if real == "float32" else places[::9]:
        assert answer(f"{text[:m.start()]}({m[0]} * 1.001F){text[m.end():]}") != 0, m[0]


def test_compilers_find_nothing_in_the_other_number_type(tmp_path):
    """MISRA and the committed type: as every committed folder."""
    need("gcc", "clang", "g++")
    written(tmp_path, "float64")
    for compiler, flags in (("gcc", GCC), ("clang", CLANG), ("g++", CXX)):
        compile_([compiler, *flags, "-O2", "-c", "quadrotor.c", "-o", "q.o"], tmp_path)
    assert compile_(["nm", "-u", "q.o"], tmp_path) == ""
