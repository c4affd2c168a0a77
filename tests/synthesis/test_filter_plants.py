"""Plants at the edge of what a fault estimation filter takes: slow, not stable; weights that say nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.filters import farhat
from synthesis.test_filter_design import FARHAT, runs

from codegen.algebra.template_set import least_kept
from codegen.certify import filter_bounds
from codegen.certify.filter_model import joint
from codegen.errors import DesignError
from codegen.observers import FilterObserver, FilterTables, Supervision
from codegen.pipeline import design
from codegen.plant.load import loads
from codegen.report import filter_words
from codegen.selection import filter_designs, filter_tables
from codegen.synthesis.fault_filter import inapplicable
from codegen.synthesis.hinf_analysis import heard
from codegen.synthesis.hinf_condition import in_reach, out_of_reach
from codegen.synthesis.hinf_filter import design as solver_design
from codegen.synthesis.hinf_weights import scaled

ONE = """
format = 1
name = "one"
[time]
kind = "discrete"
sample_period = 0.01
[signals]
x = [{ name = "a", range = [-30, 30] }]
y = [{ name = "p", range = [-60, 60] }]
w = [{ name = "gust", bounds = [-0.001, 0.001] }]
v = [{ name = "noise", bounds = [-0.02, 0.02] }]
f = [{ name = "valve", range = [-2, 2] }]
[initial]
x_lo = [-0.01]
x_hi = [0.01]
[[mode]]
name = "only"
A = [[0.5]]
C = [[1]]
Bw = [[1]]
Dv = [[1]]
Bf = [[0.3]]
Df = [[1]]
[observer]
method = "hinf-filter"
set_rows = 8
"""
THETA = 'theta = [{ name = "slip", bounds = [-0.1, 0.1], measured = false }]\n'


def of(*changes: str) -> str:
    """The plant file with pairs of old and new."""
    text = ONE
    for old, new in zip(changes[::2], changes[1::2]):
        assert old in text
        text = text.replace(old, new)
    return text


def test_a_slow_plant_has_a_filter():
    """A pole at 0.995, a tenth of a period of most loops: the solver fails on states in units of their ranges."""
    plant = loads(of("0.5", "0.995"))
    found = next(filter_designs.explore(plant, plant.options, lambda line: None))
    assert found.cert["reached"] <= found.cert["level"] < 0.0119  # what noise alone does to y is 0.01
    h, x, rng = float(found.tables.h[-1, 0, 0]), 0.0, np.random.default_rng(1)
    assert np.array(found.cert["set_of_both"]["reached"])[0, 0] <= h < 0.05
    gains = [float(np.asarray(getattr(found.tables, k)).ravel()[0]) for k in ("M", "L", "K", "Dy")]
    xi, top = 0.0, 0.0
    for k in range(4000):
        y = x + (0.02 if k % 1000 > 990 else rng.choice([-0.02, 0.02]))
        top = max(top, abs(gains[2] * xi + gains[3] * y))
        x, xi = 0.995 * x + 0.001 * (-1) ** (k // 1000), gains[0] * xi + gains[1] * y
    assert 0.5 * h < top <= h


def test_units_of_reach_are_the_same_problem():
    problem = farhat(True)
    problem = replace(problem, modes=tuple(replace(m, C=8 * m.C, F=8 * m.F, blocks=tuple(
        replace(b, H=b.H * np.array([[1], [1], [8]])) for b in m.blocks)) for m in problem.modes))
    moved, T, seen = in_reach(problem)
    assert np.any(np.diag(T) != 1) and np.any(seen != 1) and np.all(np.log2(seen) % 1 == 0)
    there = solver_design(moved)
    assert there.gamma == pytest.approx(0.3118, abs=6e-5)
    (A, B, C, D), m = out_of_reach(there, T, seen).gains[1], problem.modes[1]
    back, n = moved.modes[1], len(m.A)
    assert np.array_equal(B @ m.C, there.gains[1][1] @ back.C @ T)
    assert np.array_equal(D @ m.F, there.gains[1][3] @ back.F) and len(A) == n and C.shape == (1, n)


@pytest.mark.parametrize("changes, words", [
    (("0.5", "1.5"), 'mode "only" has an eigenvalue of size 1.5 '),
    (("0.5", "1"), 'mode "only" has an eigenvalue of size 1 '),
    (("A = [[0.5]]", 'A = [["1.5 + slip"]]', "[initial]", THETA + "[initial]"),
     'hinf-filter: mode "only" has an eigenvalue of size 1.5 '),
    (('"discrete"', '"continuous"', "0.5", "0.001"), 'mode "only" has an eigenvalue of size 1.00001 a sample'),
    (("0.5", "0.9999"), "more than 4000 samples to come down"),
    (("Df = [[1]]", "Df = [[0]]"), "no filter does better than one whose estimate is 0 at every sample"),
    (("set_rows = 8", "target = { num = [0], den = [1] }"), "observer.target: weight: the numerator is 0"),
    (("set_rows = 8", "colour = { num = [0, 0], den = [1, 0.5] }"), "observer.colour: weight: the numerator is 0")])
def test_refusals_say_what_is_wrong(changes, words):
    plant = loads(of(*changes))
    with pytest.raises(DesignError) as found:
        design(plant)
    assert words in str(found.value)
    reason = inapplicable(plant) or ""
    assert ("eigenvalue" in reason) == ("eigenvalue" in words and not plant.theta)  # what ``residua check`` says


def test_a_fault_that_is_not_heard_is_named():
    """Two faults, of which one does nothing; nor does the estimate of it, and the report says so."""
    plant = loads(of('range = [-2, 2] }]', 'range = [-2, 2] }, { name = "lost", range = [-1, 1] }]',
                     "Bf = [[0.3]]", "Bf = [[0.3, 0]]", "Df = [[1]]", "Df = [[1, 0]]"))
    found = next(filter_designs.explore(plant, plant.options, lambda line: None))
    assert found.cert["missed"] == ['"lost" in mode "only"']
    shown = SimpleNamespace(certificate={"float32": found.cert}, plant=plant)
    assert 'next to nothing is in it of fault "lost" in mode "only"' in filter_words.facts(shown, "float32")[0].text
    problem = farhat(False)
    gains = solver_design(problem).gains
    share = heard(problem, gains)[:, 0]
    assert np.all(share > 0.8) and np.array_equal(heard(problem, scaled(gains, [np.zeros((1, 1))] * 2)), [[0], [0]])
    m, (A, B, C, D) = problem.modes[1], gains[1]
    x, s, total = m.E[:, 1], B @ m.F[:, 1], abs((D @ m.F)[0, 1])
    for _ in range(200):
        y = m.C @ x
        total += abs((C @ s + D @ y)[0])
        x, s = m.A @ x, A @ s + B @ y
    assert total == pytest.approx(share[1], rel=1e-9)


LOOSE = FARHAT.replace("C  = [[1, 0.2]]", 'C  = [["1 + 0.1*delta", "0.2 - 0.05*delta"]]').replace(
    "Dw = [[0.2]]", 'Dw = [["0.2 + 0.1*delta"]]').replace('"float32"', '"float64"').replace(
    'method = "hinf-filter"', 'method = "hinf-filter"\nset_rows = 8')


def most(plant, t) -> float:
    """Largest |f_hat| over its bound in hostile runs."""
    d = SimpleNamespace(plant=plant, observer=FilterObserver({"float64": t}, Supervision()))
    u, y, q = runs(d, count=16, steps=16)
    trace = d.observer.run_many(u, y, q, "float64")
    assert np.all(trace.status == 0)
    return float(np.max(np.abs(trace.f_hat) / trace.f_bound))


def test_a_parameter_in_the_outputs_is_in_the_thresholds(monkeypatch):
    """What it does to y is in the estimate at once; a threshold that forgets that is exceeded."""
    plant = loads(LOOSE)
    found = next(filter_designs.explore(plant, plant.options, lambda line: None))
    assert 0.8 < most(plant, found.tables) <= 1

    def forgetful(modes, t):
        return tuple(replace(m, pushes=tuple(replace(p, seen=0 * p.seen) for p in m.pushes)) for m in joint(modes, t))

    monkeypatch.setattr(filter_tables, "joint", forgetful)
    monkeypatch.setattr(filter_bounds, "joint", forgetful)
    given = filter_tables.plain_tables(plant, {k: getattr(found.tables, k) for k in ("M", "G", "L", "K", "Du", "Dy")},
                                       "float64")
    graph = filter_bounds.Graph((None,), ((0, 0, 0), (0, 1, 0)))
    low, _ = filter_tables.thresholds(plant, given, graph, 8)
    assert most(plant, FilterTables(**given, **low)) > 1


def test_least_bounds_are_kept_and_least():
    rng = np.random.default_rng(2)
    edges = ((0, 0, 0), (0, 0, 1), (1, 1, 1), (1, 1, 0))
    G = rng.random((2, 3, 3))
    G *= 0.97 / np.max(np.abs(np.linalg.eigvals(np.maximum(*G))))
    omega, first = rng.random((2, 3)), np.ones((2, 3))
    b = least_kept(G, omega, edges, first)
    want = first
    for _ in range(1500):
        want = np.maximum(want, [np.max([G[p] @ want[a] + omega[p] for a, p, c in edges if c == to], axis=0)
                                 for to in (0, 1)])
    np.testing.assert_allclose(b, want, rtol=1e-9)
    assert all(np.all(G[p] @ b[a] + omega[p] <= b[c]) for a, p, c in edges) and np.all(b >= first)
    assert least_kept(1.02 * G / np.abs(np.linalg.eigvals(G[0])).max(), omega, edges, first) is None


def test_what_is_bounded_by_zero_is_no_disturbance():
    """Channels that never act leave the level as it is, 0.01256; without noise a filter does better, not worse."""
    gust, noise = '"gust", bounds = [-0.001, 0.001] }', '"noise", bounds = [-0.02, 0.02] }'
    idle = ', { name = "idle%d", bounds = [0, 0] }'

    def level(*changes):
        plant = loads(of(*changes))
        return next(filter_designs.explore(plant, plant.options, lambda line: None)).cert["level"]

    assert 0.0125 < level(gust, gust + idle % 1, noise, noise + idle % 2, "Bw = [[1]]", "Bw = [[1, 1]]",
                          "Dv = [[1]]", "Dv = [[1, 1]]") < 0.01257
    assert level(noise, noise.replace("-0.02, 0.02", "0, 0")) < 0.001
