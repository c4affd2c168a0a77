"""Weights of plant and observer as far apart as the error allows, and the plant between samples: bounds and mutants."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from codegen.certify import polytope_bounds, polytope_drift, polytope_near, polytope_thresholds
from codegen.certify.exact import Q, rational, zeros
from codegen.certify.polytope_ranges import Ranges
from codegen.certify.weight_slopes import exponential_error, slopes, steepness
from codegen.errors import CertificateError
from codegen.observers.polytopic_step import evaluate
from codegen.plant.load import gallery_names, load, loads
from codegen.selection.polytopic_tables import frozen, tables_of
from codegen.synthesis.descriptor_gains import StandardGains
from codegen.synthesis.descriptor_problem import problem_of

POLYTOPIC = [name for name in gallery_names() if load(name).polytope is not None and not load(name).polytope.known]
#: A tank that fills the faster the fuller it is: one state, one premise, discrete.
TANK = """
format = 1
name = "tank"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "level", range = [0, 2] }]
u = [{ name = "pump", range = [0, 1] }]
y = [{ name = "level", range = [-2, 4] }]
v = [{ name = "noise", bounds = [-0.01, 0.01] }]
f = [{ name = "level sensor", range = [-1, 1] }]
[initial]
x_lo = [0.5]
x_hi = [0.5]
[common]
C = [[1]]
Dv = [[1]]
Df = [[1]]
[nonlinear]
E = [[1]]
f = ["0.5*level + 0.1*level**2 + 0.1*pump"]
[[scenario]]
name = "run"
steps = 60
u = ["1"]
"""


@lru_cache
def tank():
    """Tables of a small gain for the tank, its recursion, and the certificate of its thresholds."""
    plant = loads(TANK)
    problem = problem_of(plant)
    K = np.full((2, 1, 1), -0.25)
    gains = StandardGains(np.zeros((1, 1)), problem.A.astype("float32").astype(float),
                          problem.B.astype("float32").astype(float), K, problem.C)
    t = tables_of(plant, gains, np.eye(1), "float32")
    return plant, problem, t, np.eye(1), frozen(plant, problem, t, np.eye(1), None), frozen(
        plant, problem, t, np.eye(1), None, near=False)


def box_of(plant, wide: float = 1.5):
    """Ranges of the states, somewhat wider, and of the inputs."""
    (lo, hi), (u_lo, u_hi) = plant.limits("x"), plant.limits("u")
    mid, half = (lo + hi) / 2, wide * (hi - lo) / 2
    return [(Q(a), Q(b)) for a, b in zip([*(mid - half), *u_lo], [*(mid + half), *u_hi])]


def cleared(found, plant, mutant: float = 1.0, pairs: int = 300):
    """Largest |h(x) - h(x_hat)| of random pairs, far and near, over what the slopes allow, per weight."""
    rng, p, n = np.random.default_rng(0), plant.polytope, plant.n_x
    (lo, hi), (u_lo, u_hi) = plant.limits("x"), plant.limits("u")
    h, worst = len(p.vertices), 0.0
    units = np.eye(h)[:, :, None] - 1 / h  # q_i, less their mean: a row picks one weight
    steep, spread = steepness(found, rational(units))
    S = np.array([[float(v) for v in s.state] for s in found]).reshape(-1, n)
    for _ in range(pairs):
        x, u = rng.uniform(lo, hi), rng.uniform(u_lo, u_hi)
        x_hat = np.clip(x + 10.0 ** rng.uniform(-3, 0) * rng.uniform(-1, 1, n) * (hi - lo), lo - (hi - lo) / 4,
                        hi + (hi - lo) / 4)
        apart = np.abs(p.weights(x, u)[0] - p.weights(x_hat, u)[0])
        allowed = np.minimum(np.abs(S @ (x - x_hat)) @ steep * mutant, spread)
        worst = max(worst, np.max(apart / (allowed + 1e-12)))
    return worst


@pytest.mark.parametrize("name", POLYTOPIC)
def test_weights_are_no_further_apart_than_their_slopes_allow(name):
    """Every polytopic plant of the gallery; slopes that are a fifth too small are found out."""
    plant = load(name)
    found = slopes(plant.polytope, box_of(plant), zeros(plant.n_u))
    assert found is not None or name == "disc_points"  # whose weights have corners
    if found is not None:
        assert cleared(found, plant) <= 1 + 1e-9
        assert len(found) > 2 or cleared(found, plant, 0.8) > 1  # a signal that is the worst of one premise is drawn


def test_what_jumps_or_is_read_from_outside_has_no_slopes():
    """Weights that are no shares beyond their range: the C takes equal ones there."""
    text = TANK[:TANK.index("[nonlinear]")] + "E = [[1]]\n" + "".join(
        f'[[vertex]]\nA = [[{a}]]\nB = [[0.1]]\nweight = "{w}"\n' for a, w in ((0.9, "1 - level/2"), (0.6, "level/2")))
    plant = loads(text)
    assert slopes(plant.polytope, box_of(plant), zeros(1)) is None
    inside = slopes(plant.polytope, box_of(plant, 0.9), zeros(1))
    assert inside is not None and np.allclose(np.abs(inside[0].mid), 0.5, atol=0.01)


def test_exponentials_are_as_exact_as_is_said():
    """Weights of the C in single precision against those of the plant file, at the same numbers."""
    plant, rng = load("dlpv"), np.random.default_rng(1)
    problem = problem_of(plant)
    gains = StandardGains(np.zeros((3, 3)), problem.A.astype("float32").astype(float), problem.B.astype(
        "float32").astype(float), np.zeros((3, 3, 3)), problem.C)
    t, box = tables_of(plant, gains, np.eye(3), "float32"), box_of(plant)
    off = float(exponential_error(t, box))
    points = np.column_stack([rng.uniform(float(a), float(b), 300) for a, b in box]).astype("float32")
    held = np.array(evaluate(t.weights, list(points.T), "float32"))[:-1].T
    true = np.array([plant.polytope.weights(x[:3], x[3:])[0] for x in points.astype(float)])
    wrong = np.abs(held - true).sum(axis=1).max() / 2
    assert 1e-8 < wrong <= off < 1e-2


def test_the_worst_signals_stay_within_the_bounds_and_mutants_do_not():
    """One sample from every corner of the tank's set, in exact numbers; slopes a fifth too small are passed."""
    plant, problem, t, T1, (held, cert), _ = tank()
    t = held
    every = polytope_thresholds.every_pair(problem)
    parts = polytope_bounds.Parts.of(plant, every, t, T1, None)
    model, _ = polytope_bounds.model(plant, every, t, T1, None, parts)
    found = polytope_near.near(plant, every, t, parts, model)
    graph, b = polytope_thresholds.graph_of(model), np.array(cert["bounds"])
    F, G, K, (lo, hi) = t.F.astype(float), t.G.astype(float), t.K.astype(float), (0.0, 2.0)

    def worst(size: float) -> float:
        """Largest |eb+| of the tank and its observer over corners and a grid of levels, |eb| at most that."""
        most = 0.0
        for x in np.linspace(lo, hi, 41):
            for eb, u, v in ((e, u, v) for e in (-size, size) for u in (0, 1) for v in (-0.01, 0.01)):
                z = x - eb
                g = np.clip(z / 2, 0, 1)
                share = np.array([1 - g, g])
                after = sum(s * (F[j, 0, 0] * z + G[j, 0, 0] * u - K[j, 0, 0] * (x + v - z))
                            for j, s in enumerate(share))
                most = max(most, abs(0.5 * x + 0.1 * x * x + 0.1 * u - after))
        return most

    maps = polytope_near.maps(model, found, cert)
    flat = replace(maps, steep=0.8 * maps.steep)
    for size in (0.01, 0.05, 0.2):
        here = np.full_like(b, size)
        assert worst(size) <= maps.after(graph, here)[0, 0]
        assert worst(size) > flat.after(graph, here)[0, 0] or size < 0.05
    assert worst(0.2) > 0.9 * maps.after(graph, np.full_like(b, 0.2))[0, 0]


def test_near_weights_give_lower_thresholds_and_their_certificate_is_checked():
    """A half of what any weights give, on the tank; each number the bounds rest on, changed: refused."""
    plant, problem, _, T1, (t, cert), (any_t, any_cert) = tank()
    assert "near" in cert and "near" not in any_cert and t.h[-1, 0] < any_t.h[-1, 0] / 2
    check = polytope_thresholds.check
    check(plant, problem, t, cert, T1, None)
    check(plant, problem, any_t, any_cert, T1, None)
    without = {k: v for k, v in cert.items() if k != "near"}
    wrong = cert | {"near": {"sees": [[[0], [3.0]]]}}
    for tables, proof in ((t, without), (t, wrong), (replace(t, K=0 * t.K), cert),
                          (replace(t, h=t.h * np.float32(0.98)), cert),
                          (t, cert | {"bounds": (np.array(cert["bounds"]) * 0.9).tolist()})):
        with pytest.raises(CertificateError):
            check(plant, problem, tables, proof, T1, None)
    noisy = replace(plant, v=(replace(plant.v[0], lo=-0.02, hi=0.02),))
    with pytest.raises(CertificateError, match="not kept"):
        check(noisy, problem_of(noisy), t, cert, T1, None)


def test_the_plant_between_samples_at_the_worst_corner():
    """The disc at the ends of its ranges, its algebraic rows solved, by fine steps: within the bound and near it."""
    plant = load("disc")
    problem, p, T = problem_of(plant), plant.polytope, plant.sample_period
    rows = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [2, 1, 0, 0], [0, 0, 0, 1]], dtype=float)

    def most() -> np.ndarray:
        found = np.zeros(len(rows))
        for a, b, u in ((a, b, u) for a in (-0.273, 0.273) for b in (-0.69, 0.69) for u in (-2, 2)):
            x, path = np.array([a, b, 0, 0.0]), []
            for _ in range(51):
                x[2] = x[1] / 0.4
                x[3] = (2.5 * (x[0] + x[0]**3) + 0.75 * x[1] + 0.125 * u) / 0.075
                path.append(x.copy())
                x[:2] += T / 50 * p.right_side(x, np.array([u]))[:2]
            path = np.array(path)
            found = np.maximum(found, np.abs((path - path[0]) @ rows.T).mean(axis=0))
        return found

    def bound(period: float) -> np.ndarray:
        moved = polytope_drift.drift(plant, problem, Ranges.of(plant, problem), period)
        return moved.of(rational(rows)).astype(float)

    reached = most()
    assert np.all(reached <= bound(T)) and np.all(reached > 0.95 * bound(T))
    assert np.all(reached > bound(0.9 * T))
