"""Sets of the residual against the plant itself: exact where nothing is reduced, never too small where it is."""

from dataclasses import replace

import numpy as np
import pytest
from set_plants import (
    A62,
    A63,
    C62,
    C63,
    D62,
    D63,
    DV62,
    DV63,
    F62,
    H62,
    H63,
    HALF63,
    L63,
    N63,
    V62,
    V63,
    W62,
    W63,
    luenberger62,
    observe,
    pole_gains,
    random_path,
    tnl63,
    worst_residuals,
)

from codegen.algebra import ellipsoid, error_set, residual_sets, zonotope
from codegen.analysis.set_blocks import block_table

FAN = zonotope.fan(8)


@pytest.fixture(scope="module")
def gains20():
    L, gamma = pole_gains(A62, C62, D62, DV62, F62, .5)
    assert gamma == pytest.approx(.0605, abs=1e-4)
    return L


@pytest.fixture(scope="module")
def recursion20(gains20):
    return luenberger62(gains20)


@pytest.fixture(scope="module")
def recursion63():
    return tnl63()


def stacked(D):
    return np.broadcast_to(D, (3, *D.shape)) if D.ndim == 2 else D


def cases(gains20):
    """(recursion, first error, arguments of the simulation) of a Luenberger and a TNL observer."""
    yield (error_set.luenberger(A62, C62, gains20, D62, DV62, W62, V62), H62,
           (A62, C62, gains20, np.zeros_like(gains20), stacked(D62), DV62), (W62, V62, np.full(3, .1)))
    yield (error_set.tnl(A63, C63, L63, N63, D63, DV63, W63, V63), H63,
           (A63, C63, L63, N63, D63, DV63), (W63, V63, HALF63))


def test_unreduced_sets_are_exact(gains20):
    """What the noise can do to plant and observer, sample by sample, is the support: no more and no less."""
    rng = np.random.default_rng(0)
    for m, H0, system, halves in cases(gains20):
        for dwell in (1, 4):
            path = random_path(rng, 3, dwell, 22, spread=3)
            truth = worst_residuals(*system, path, *halves, FAN)
            assert residual_sets.thresholds(m, path, H0, FAN) == pytest.approx(truth, rel=1e-9)


def test_the_copies_of_the_noise(recursion63):
    """Apart they cost eight times the area; together with a wrong sign they leave residuals outside."""
    path = sum(([q] * 5 for q in range(3)), []) * 7
    apart = error_set.tnl(A63, C63, L63, N63, D63, DV63, W63, V63, together=False)
    area = [np.mean([zonotope.area(R) for R in residual_sets.zonotopes(m, path, np.eye(3))[20:]])
            for m in (apart, recursion63)]
    assert area == pytest.approx([1.75e-3, 2.17e-4], rel=.03)  # dossier 2.7
    truth = worst_residuals(A63, C63, L63, N63, D63, DV63, path[:22], W63, V63, np.ones(3), FAN)
    assert np.all(residual_sets.thresholds(apart, path[:22], np.eye(3), FAN) >= truth * (1 - 1e-9))
    after = np.concatenate([N63, np.zeros((1, 3, 2))])
    noise = DV63 * V63
    entering = (recursion63.A[None] @ after[:, None] - L63[None]) @ noise  # mutant: + Ac N instead of - Ac N
    W = np.concatenate([recursion63.W[..., :1], entering], axis=-1)
    once = np.concatenate([recursion63.W[..., :1], np.broadcast_to(-L63 @ noise, entering.shape)], axis=-1)
    of_this_mode = np.broadcast_to(-(recursion63.A @ N63 + L63) @ noise, entering.shape)  # N of the wrong mode
    wrong_mode = np.concatenate([recursion63.W[..., :1], of_this_mode], axis=-1)
    for mutant in (replace(recursion63, W=W), replace(recursion63, W=once), replace(recursion63, W=wrong_mode),
                   replace(recursion63, V=recursion63.V[..., :1])):
        assert np.any(residual_sets.thresholds(mutant, path[:22], np.eye(3), FAN) < truth * (1 - 1e-3))


def test_every_bounded_set_holds_the_exact_one(recursion20, recursion63):
    rng = np.random.default_rng(1)
    D = np.r_[FAN, rng.normal(size=(20, 2))]
    for m, half in ((recursion20, np.full(3, .1)), (recursion63, HALF63)):
        path = random_path(rng, 3, 3, 40)
        exact = residual_sets.thresholds(m, path, np.diag(half), D)
        T = np.eye(3) + .2 * rng.normal(size=(3, 3, 3))
        for coordinates in (None, T):
            for key in zonotope.KEYS:
                for order in (3, 5, 10):
                    got = residual_sets.thresholds(m, path, np.diag(half), D, order, key, coordinates)
                    assert np.all(got >= exact * (1 - 1e-12))
        boxes = residual_sets.intervals(m, path, half)
        assert np.all(boxes >= residual_sets.thresholds(m, path, np.diag(half), np.eye(2), 3) * (1 - 1e-12))
        X0 = ellipsoid.of_box(half)
        for alpha in (None, residual_sets.steady_weights(m), np.array([.3, 1, 3])):
            shapes = residual_sets.ellipsoids(m, path, X0, alpha)
            assert np.all([ellipsoid.support(R, D) for R in shapes] >= exact * (1 - 1e-12))


def test_fixed_weights_cost_little(recursion63):
    """Without a square root the ellipsoid is at most 1.2 % larger on average once the start has died away."""
    path, X0 = random_path(np.random.default_rng(1), 3, 5, 90), ellipsoid.of_box(HALF63)
    fixed = residual_sets.ellipsoids(recursion63, path, X0, residual_sets.steady_weights(recursion63))[20:]
    best = residual_sets.ellipsoids(recursion63, path, X0)[20:]
    larger = [np.sqrt(np.trace(a) / np.trace(b)) for a, b in zip(fixed, best)]
    assert np.mean(larger) < 1.012 and max(larger) < 1.06


def test_reduction_that_drops_is_caught(recursion20, monkeypatch):
    path = random_path(np.random.default_rng(2), 3, 3, 25)
    exact = residual_sets.thresholds(recursion20, path, H62, FAN)
    whole = zonotope.reduce
    monkeypatch.setattr(zonotope, "reduce", lambda G, order, *rest: whole(G, order, *rest)[:, :order - 3])
    assert np.any(residual_sets.thresholds(recursion20, path, H62, FAN, 5) < exact * .99)
    table = block_table(recursion20, FAN, 6, 5)
    assert np.any(table.along(path, H62) < exact * .99)


def test_ellipsoid_without_the_factor_of_a_box_is_caught(recursion63, monkeypatch):
    """Corner noise of all channels: inside with V = s diag(b^2), outside with V = diag(b^2)."""
    path = sum(([q] * 5 for q in range(3)), []) * 3
    signs = 1.0 - 2.0 * (np.arange(2 * 45).reshape(45, 2) % 3 == 1)
    worst = {}
    for factor in ("s", "none"):
        if factor == "none":
            monkeypatch.setattr(residual_sets, "of_group", lambda G: G @ G.T)
        shapes = residual_sets.ellipsoids(recursion63, path, np.eye(3) * 1e-6)
        worst[factor] = 0.0
        exact = residual_sets.zonotopes(recursion63, path, np.zeros((3, 1)))
        for R, G in zip(shapes, exact):
            for corner in zonotope.vertices(G):  # reached by some noise
                worst[factor] = max(worst[factor], ellipsoid.quadratic(R, corner))
        r = observe(A63, C63, L63, N63, D63, DV63, path, .1 * signs[:, :1], .1 * signs, np.zeros(3))
        assert all(ellipsoid.contains(R, x) for R, x in zip(shapes, r)) or factor == "none"
    assert worst["s"] <= 1.0 < worst["none"]
