"""Zonotopes and ellipsoids: the examples of Zammali (2020), 6.2.1 and 6.3.1, and linear programs as the oracle."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

from codegen.algebra import ellipsoid, zonotope

EXAMPLE = np.array([[.9, .8, .35, .1, .2, .6, .19, .7], [.4, .05, .81, .13, .19, .27, .01, .44]])


def reaches(G, r, factor=1.0):
    """Oracle: whether G z = r has a solution with |z| <= factor."""
    return linprog(np.zeros(G.shape[1]), A_eq=G, b_eq=r, bounds=(-factor, factor)).status == 0


def smallest_factor(G, r):
    """Oracle of the gauge: inf where the program has no solution."""
    g = G.shape[1]
    sides = np.block([[np.eye(g), -np.ones((g, 1))], [-np.eye(g), -np.ones((g, 1))]])
    found = linprog(np.append(np.zeros(g), 1.0), A_ub=sides, b_ub=np.zeros(2 * g), A_eq=np.c_[G, np.zeros(len(G))],
                    b_eq=r, bounds=[(None, None)] * g + [(0, None)])
    return found.fun if found.status == 0 else np.inf


def sets(rng, m, count):
    """Random sets, a third of them flat, some with zero and parallel columns."""
    for i in range(count):
        G = rng.normal(size=(m, int(rng.integers(m, 9))))
        if i % 3 == 0 and m > 1:
            G = rng.normal(size=(m, m - 1)) @ rng.normal(size=(m - 1, 4))
        if i % 5 == 0:
            G = np.c_[G, 2 * G[:, :1], np.zeros(m)]
        yield G


# -- published -------------------------------------------------------------------------------------
@pytest.mark.parametrize("order, area, box", [(7, 20.9140, (.49, .33)), (5, 26.9300, (1.89, .65)),
                                              (3, 33.8880, (2.94, 1.90))])
def test_example_3_reduced(order, area, box):
    assert zonotope.area(EXAMPLE) == pytest.approx(16.5784, abs=5e-5)
    reduced = zonotope.reduce(EXAMPLE, order)
    kept = [[.9, .4], [.35, .81], [.7, .44], [.8, .05], [.6, .27]][:order - 2]
    assert np.array_equal(reduced[:, :order - 2].T, kept)
    assert reduced[:, order - 2:] == pytest.approx(np.diag(box), abs=1e-12)
    assert zonotope.area(reduced) == pytest.approx(area, abs=5e-5)


def test_examples_1_2_and_4():
    assert np.array_equal(zonotope.hull(np.array([[1, 2, 3], [3, 2, 1]])), [6, 6])
    circle = 2 * np.eye(2)  # example 4: radius sqrt 2
    assert ellipsoid.hull(circle) == pytest.approx([np.sqrt(2)] * 2)
    assert ellipsoid.area(circle) == pytest.approx(2 * np.pi)


# -- supports, vertices ----------------------------------------------------------------------------
def test_support_is_the_largest_over_the_corners():
    rng = np.random.default_rng(0)
    G, D = rng.normal(size=(3, 6)), rng.normal(size=(9, 3))
    corners = np.array(list(product((-1, 1), repeat=6))) @ G.T
    assert zonotope.support(G, D) == pytest.approx((corners @ D.T).max(axis=0))
    assert zonotope.hull(G) == pytest.approx(corners.max(axis=0))
    H = rng.normal(size=(3, 2))
    assert zonotope.support(zonotope.add(G, H), D) == pytest.approx(zonotope.support(G, D) + zonotope.support(H, D))


def test_vertices_enclose_the_area_and_touch_every_support():
    V, D = zonotope.vertices(EXAMPLE), zonotope.fan(32)
    x, y = V.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2 == pytest.approx(zonotope.area(EXAMPLE))
    assert (V @ D.T).max(axis=0) == pytest.approx(zonotope.support(EXAMPLE, D))
    turns = np.cross(np.c_[np.roll(V, -1, 0) - V, np.zeros(len(V))],
                     np.c_[np.roll(V, -2, 0) - np.roll(V, -1, 0), np.zeros(len(V))])[:, 2]
    assert np.all(turns > 0)  # convex, counter-clockwise


# -- membership ------------------------------------------------------------------------------------
@pytest.mark.parametrize("m", [1, 2, 3])
def test_membership_agrees_with_a_linear_program(m):
    rng = np.random.default_rng(m)
    seen = {True: 0, False: 0}
    for G in sets(rng, m, 45):
        for _ in range(2):
            z = rng.uniform(-1, 1, G.shape[1])
            edge = smallest_factor(G, G @ z)  # a point in the plane of the set, moved just inside and just outside
            if edge < 1e-6:
                continue
            for factor in (.999, 1.001):
                r = G @ z / edge * factor
                assert zonotope.contains(G, r) == (factor < 1)
                assert zonotope.gauge(G, r) == pytest.approx(factor, rel=1e-9)
                seen[factor < 1] += 1
        r = rng.normal(size=m) * zonotope.hull(G).max()
        assert zonotope.contains(G, r) == reaches(G, r)
    assert min(seen.values()) > 50
    assert not zonotope.contains(np.eye(m), np.full(m, np.nan))


def test_a_flat_set_needs_the_coordinate_rows():
    G, far = np.array([[1.0], [1.0]]), np.array([50.0, 50.0])
    own = np.array([[-1.0, 1.0]])  # the normal of its only generator: sees a strip, not a segment
    assert zonotope.contains(G, far, own) and not zonotope.contains(G, far)
    assert zonotope.gauge(G, far) == pytest.approx(50) and zonotope.gauge(G, np.array([1.0, -1.0])) == np.inf


def test_templates_never_exclude_falsely_and_hold_the_best_direction():
    rng = np.random.default_rng(4)
    for m in (2, 3, 4, 5):
        G, faults = rng.normal(size=(m, 9)), rng.normal(size=(2, m))
        D = zonotope.template(G, np.r_[faults, np.zeros((1, m))])
        assert np.array_equal(D[:m], np.eye(m)) and len(D) <= m + 2
        for r in (G @ rng.uniform(-1, 1, (9, 300))).T:
            assert zonotope.contains(G, r * (1 - 1e-12), D)
        for r in faults:  # along a fault the template is as good as the exact set
            assert zonotope.gauge(G, r, D) == pytest.approx(smallest_factor(G, r), rel=1e-7)


# -- reduction -------------------------------------------------------------------------------------
def dropped(G, order, key="squared", coordinates=None, weight=None):
    """Mutant: forgets what it does not keep."""
    return zonotope.reduce(G, order, key, coordinates, weight)[:, :order - len(G)]


@pytest.mark.parametrize("key", zonotope.KEYS)
def test_a_reduced_set_holds_the_set(key):
    rng = np.random.default_rng(5)
    short = 0
    for n in (1, 2, 3, 5):
        D = np.r_[rng.normal(size=(200, n)), np.eye(n)]
        for coordinates in (None, np.eye(n) + .3 * rng.normal(size=(n, n))):
            G = rng.normal(size=(n, 14)) * 10.0 ** rng.uniform(-2, 1, 14)
            for order in (n, n + 1, 10):
                H = zonotope.reduce(G, order, key, coordinates, np.full(n, 4.0))
                assert H.shape == (n, order)
                assert np.all(zonotope.support(H, D) >= zonotope.support(G, D) * (1 - 1e-12))
                inward = G if coordinates is None else np.linalg.solve(coordinates, G)
                outward = H if coordinates is None else np.linalg.solve(coordinates, H)
                assert zonotope.hull(outward) == pytest.approx(zonotope.hull(inward))  # boxing keeps the hull
                short += np.any(zonotope.support(dropped(G, order, key, coordinates), D) < zonotope.support(G, D))
    assert short == 24  # the mutant is caught every time


def counted(G, order):
    """The selection as the C does it, with its compares counted."""
    G, n, count = G.copy(), len(G), 0
    size = (G * G).sum(axis=0)
    for i in range(order - n):
        best = i
        for j in range(i + 1, G.shape[1]):
            count += 1
            if size[j] > size[best]:
                best = j
        G[:, [i, best]], size[[i, best]] = G[:, [best, i]], size[[best, i]]
    return np.c_[G[:, :order - n], np.diag(np.abs(G[:, order - n:]).sum(axis=1))], count


def test_compares_do_not_depend_on_data_and_ties_go_to_the_lowest_index():
    rng = np.random.default_rng(6)
    for n, order, appended in ((3, 5, 6), (3, 10, 6), (3, 20, 6), (2, 2, 3), (1, 4, 2)):
        for values in (rng.normal(size=(n, order + appended)), np.ones((n, order + appended)),
                       rng.integers(-2, 3, (n, order + appended)).astype(float)):
            expected, count = counted(values, order)
            assert np.array_equal(zonotope.reduce(values, order), expected)
            assert count == zonotope.compares(n, order, appended)
    assert [zonotope.compares(3, order, 6) for order in (5, 10, 20)] == [19, 84, 289]  # the dossier's counts
    tied = np.array([[3.0, -3.0, 3.0, 1.0]])
    assert zonotope.reduce(tied, 2)[0].tolist() == [3.0, 7.0]
    with pytest.raises(ValueError, match="expected at least 3"):
        zonotope.reduce(np.eye(3), 2)


# -- ellipsoids ------------------------------------------------------------------------------------
def test_the_ellipsoid_of_a_box_holds_its_corners_and_the_squares_alone_do_not():
    half = np.array([.1, .3, .05])
    for corner in product((-1, 1), repeat=3):
        assert ellipsoid.contains(ellipsoid.of_box(half) * (1 + 1e-12), corner * half)
        assert not ellipsoid.contains(np.diag(half**2), corner * half)  # V = .01 I where .02 I is meant
    assert ellipsoid.of_box(np.array([.1, .1])) == pytest.approx(.02 * np.eye(2))
    assert np.count_nonzero(ellipsoid.of_box(np.array([.1, 0.0]))) == 1
    assert ellipsoid.of_box(np.array([.1, 0.0]))[0, 0] == pytest.approx(.01)


def test_sums_hold_the_sum_and_the_best_weights_have_the_smallest_trace():
    rng = np.random.default_rng(7)
    D = rng.normal(size=(300, 3))
    for _ in range(20):
        shapes = [(F := rng.normal(size=(3, int(rng.integers(1, 4))))) @ F.T for _ in range(3)]  # some are flat
        whole = ellipsoid.add(shapes)
        need = sum(ellipsoid.support(X, D) for X in shapes)
        assert np.all(ellipsoid.support(whole, D) >= need * (1 - 1e-12))
        assert np.any(ellipsoid.support(sum(shapes), D) < need)  # mutant: shapes added up
        assert ellipsoid.add([ellipsoid.add(shapes[:2]), shapes[2]]) == pytest.approx(whole)  # nesting changes nothing
        for t in rng.uniform(.05, 2, (30, 3)):
            other = ellipsoid.add(shapes, t)
            assert np.all(ellipsoid.support(other, D) >= need * (1 - 1e-12))
            assert np.trace(other) >= np.trace(whole) * (1 - 1e-12)
        alpha = rng.uniform(.1, 3)
        fixed = ellipsoid.add_fixed(*shapes[:2], alpha)
        assert np.all(ellipsoid.support(fixed, D) >= sum(ellipsoid.support(X, D) for X in shapes[:2]) * (1 - 1e-12))
        best = np.sqrt(np.trace(shapes[1]) / np.trace(shapes[0]))
        assert ellipsoid.add_fixed(*shapes[:2], best) == pytest.approx(ellipsoid.add(shapes[:2]))
    assert np.array_equal(ellipsoid.add([np.zeros((2, 2)), np.eye(2)]), np.eye(2))
    with pytest.raises(ValueError, match="weights"):
        ellipsoid.add([np.eye(2), np.eye(2)], [1.0, 0.0])


def test_membership_images_and_outline_of_an_ellipsoid():
    rng = np.random.default_rng(8)
    for n in (1, 2, 3, 5):
        F = rng.normal(size=(n, n))
        X = F @ F.T
        for r in rng.normal(size=(40, n)):
            value = r @ np.linalg.solve(X, r)
            assert ellipsoid.quadratic(X, r) == pytest.approx(value, rel=1e-6)
            assert ellipsoid.contains(X, r) == (value <= 1)
            assert ellipsoid.contains(X, r / np.sqrt(value) * .9999) and ellipsoid.gauge(X, r) == pytest.approx(
                np.sqrt(value), rel=1e-6)
        M, D = rng.normal(size=(2, n)), rng.normal(size=(20, 2))
        assert ellipsoid.support(ellipsoid.image(M, X), D) == pytest.approx(ellipsoid.support(X, D @ M))
    assert not ellipsoid.contains(np.eye(2), np.array([np.nan, 0]))
    assert not ellipsoid.contains(np.zeros((2, 2)), np.zeros(2))
    R = np.array([[2.0, .5], [.5, 1.0]])
    points = ellipsoid.outline(R, 400)
    assert np.array([ellipsoid.quadratic(R, p) for p in points]) == pytest.approx(1)
    x, y = points.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2 == pytest.approx(ellipsoid.area(R), rel=1e-3)
