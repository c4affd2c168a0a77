"""Surely detected faults of residual sets: the figures of the dossier, and no noise that hides a fault of that size."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog, minimize
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
    F63,
    H62,
    L63,
    N63,
    V62,
    V63,
    W62,
    W63,
    linf_gains,
    observe,
    random_path,
)

from codegen.algebra import ellipsoid, error_set, residual_sets, zonotope
from codegen.analysis.set_blocks import block_table
from codegen.analysis.set_detectability import (
    SureByMode,
    ellipsoid_gauges,
    fault_inputs,
    futures,
    response,
    settled_mode,
    sizes,
    steady_set,
    surely_detected,
    threshold_gauges,
    zonotope_gauges,
)
from codegen.analysis.set_online import largest_boxes, mean_table, online_table
from codegen.analysis.set_tables import dwell_table

ROUND = sum(([q] * 5 for q in range(3)), []) * 9
NO_STATE_FAULT = np.zeros((3, 1))


def sensor_faults(L, N):
    return fault_inputs(A63, C63, L, NO_STATE_FAULT, F63, N)


@pytest.fixture(scope="module")
def printed():
    return error_set.tnl(A63, C63, L63, N63, D63, DV63, W63, V63)


@pytest.fixture(scope="module")
def gains21():
    return linf_gains(A63, C63, D63, DV63, .8)


# -- against the plant -------------------------------------------------------------------------------
def test_response_is_that_of_the_plant(printed):
    faults, path = sensor_faults(L63, N63), ROUND[:40]
    quiet = np.zeros((40, 1)), np.zeros((40, 2)), np.zeros(3)
    for onset in (0, 7, 10):
        f = np.where(np.arange(40) < onset, 0.0, 1.0)[:, None]
        r = observe(A63, C63, L63, N63, D63, DV63, path, *quiet, f=f, Df=F63)
        before = path[onset - 1] if onset else printed.start
        assert response(printed, faults, path[onset:], before, 0) == pytest.approx(r[onset:], abs=1e-12)
        assert not np.any(r[:onset])
    L = np.full((3, 3, 2), .1)
    m = error_set.luenberger(A62, C62, L, D62, DV62, W62, V62)
    on_state = fault_inputs(A62, C62, L, F62, np.zeros((2, 1)))
    x, out = np.zeros(3), []
    for q in path:  # the plant's own fault: e+ = (A - L C) e + F f
        out.append(C62 @ x)
        x = (A62[q] - L[q] @ C62) @ x + F62[q][:, 0]
    assert response(m, on_state, path, path[0], 0) == pytest.approx(np.array(out))


def hides(G, r):
    """Oracle: whether some noise brings the residual of a fault back into the set, r + G z = G z'."""
    G, r = G / np.abs(G).max(), r / np.abs(G).max()
    return linprog(np.zeros(2 * G.shape[1]), A_eq=np.c_[G, -G], b_eq=-r, bounds=(-1, 1)).status == 0


def test_a_fault_of_that_size_cannot_hide_and_a_smaller_one_can(printed):
    faults, rng = sensor_faults(L63, N63), np.random.default_rng(0)
    path = random_path(rng, 3, 3, 36)
    sets = residual_sets.zonotopes(printed, path, np.eye(3))
    for onset in (12, 20, 27):
        r = response(printed, faults, path[onset:onset + 6], path[onset - 1], 0)
        by_delay = sizes(zonotope_gauges(sets[onset:onset + 6], r))
        assert np.all(np.diff(by_delay) <= 0)
        for d, f in enumerate(by_delay):
            assert not any(all(hides(sets[onset + j], 1.0005 * f * s * r[j]) for j in range(d + 1)) for s in (1, -1))
            assert all(hides(sets[onset + j], .998 * f * r[j]) for j in range(d + 1))
    assert sizes(np.array([0.0, 4.0, 2.0]))[1:] == pytest.approx([.5, .5]) and sizes(np.zeros(1))[0] == np.inf


def test_gauges_of_bounded_sets_find_no_more_than_the_exact_one(printed):
    faults, rng = sensor_faults(L63, N63), np.random.default_rng(1)
    path = random_path(rng, 3, 4, 40)
    r = response(printed, faults, path[20:], path[19], 0)
    H0 = np.eye(3)
    exact = zonotope_gauges(residual_sets.zonotopes(printed, path, H0)[20:], r)
    for got in (zonotope_gauges(residual_sets.zonotopes(printed, path, H0, 4)[20:], r),
                ellipsoid_gauges(residual_sets.ellipsoids(printed, path, ellipsoid.of_box(np.ones(3)))[20:], r),
                threshold_gauges(residual_sets.intervals(printed, path, np.ones(3))[20:], np.eye(2), r),
                threshold_gauges(dwell_table(printed, 4, H0, zonotope.fan(8), 6).along(path)[20:], zonotope.fan(8), r),
                threshold_gauges(block_table(printed, zonotope.fan(8), 6, 5).along(path, H0)[20:], zonotope.fan(8), r)):
        assert np.all(got <= exact * (1 + 1e-9))
    wide = np.random.default_rng(2).normal(size=(5, 9))  # five residuals: a linear program instead of normals
    point = np.random.default_rng(3).normal(size=5)
    t = zonotope_gauges([wide], point[None])[0]
    for factor in (.999, 1.001):
        inside = linprog(np.zeros(9), A_eq=wide, b_eq=point / t * factor, bounds=(-1, 1)).status == 0
        assert inside == (factor < 1)


# -- published and measured ----------------------------------------------------------------------------
def figures(m, faults, kind):
    """(mean half widths, mean area, worst onset, worst after 15 samples) at dwell 5 for k >= 20."""
    sets = {"zonotope": lambda: residual_sets.zonotopes(m, ROUND, np.eye(3)),
            "ellipsoid": lambda: residual_sets.ellipsoids(m, ROUND, np.eye(3)),
            "interval": lambda: [np.diag(b) for b in residual_sets.intervals(m, ROUND, np.ones(3))]}[kind]()
    algebra, gauges = (ellipsoid, ellipsoid_gauges) if kind == "ellipsoid" else (zonotope, zonotope_gauges)
    onset, late, half, area = [], [], [], []
    for k in range(20, 110):
        r = response(m, faults, ROUND[k:k + 16], ROUND[k - 1], 0)
        t = gauges([sets[k], sets[k + 15]], r[[0, 15]])
        onset.append(2 / t[0])
        late.append(2 / t[1])
        half.append(algebra.hull(sets[k]))
        area.append(algebra.area(sets[k]))
    return np.mean(half, axis=0), np.mean(area), max(onset), max(late)


@pytest.mark.parametrize("kind, together, half, area, onset, late", [
    ("ellipsoid", False, (.0291, .0351), 2.86e-3, .084, .079),
    ("zonotope", False, None, 1.75e-3, .0727, None),
    ("zonotope", True, None, 2.17e-4, .0578, None)])
def test_section_6_3_5_with_the_printed_gains(kind, together, half, area, onset, late):
    """The mode sequence is not given: a few per cent."""
    m = error_set.tnl(A63, C63, L63, N63, D63, DV63, W63, V63, together=together)
    got = figures(m, sensor_faults(L63, N63), kind)
    assert got[1] == pytest.approx(area, rel=.03) and got[2] == pytest.approx(onset, rel=.03)
    if half:
        assert got[0] == pytest.approx(half, rel=.01) and got[3] == pytest.approx(late, rel=.06)


def test_section_6_3_5_targets(gains21):
    """At or below f_on 0.116 interval, 0.063 ellipsoid, 0.058 zonotope; the fault's response is (I - C N) F at once."""
    L, N = linf_gains(A63, C63, D63, DV63, .6, interval=True)
    m = error_set.tnl(A63, C63, L, N, D63, DV63, W63, V63, together=False)
    assert np.all(m.A > -1e-6)
    half, area, onset, _ = figures(m, sensor_faults(L, N), "interval")
    assert half == pytest.approx([.0273, .0413], rel=.02) and area == pytest.approx(4.53e-3, rel=.02)
    assert onset == pytest.approx(.116, rel=.01)
    L, N = gains21
    m, faults = error_set.tnl(A63, C63, L, N, D63, DV63, W63, V63), sensor_faults(L, N)
    tight = {kind: figures(m, faults, kind) for kind in ("ellipsoid", "zonotope")}
    assert tight["ellipsoid"][2] <= .063 and tight["zonotope"][2] <= .058
    assert tight["ellipsoid"][3] <= .061 and tight["zonotope"][3] <= .0565
    assert faults.R[0, 0, :, 0] == pytest.approx((np.eye(2) - C63 @ N[0]) @ F63[:, 0])


@pytest.mark.parametrize("lam, q, eventually, within", [(.1, 2, 5.79e-3, 5.80e-3), (.5, 0, 2.53e-3, 2.89e-3),
                                                        (.9, 1, 1.16e-3, 4.27e-3)])
def test_a_larger_eigenvalue_is_not_better(lam, q, eventually, within):
    """Table of dossier 1.10: one mode, S chosen for the fault; early detection is best near .5."""
    CF = C62 @ F62[q]
    pinv = np.linalg.pinv(CF)
    own, free = (A62[q] - lam * np.eye(3)) @ F62[q] @ pinv, np.linalg.svd(CF)[0][:, 1]

    def found(s):
        L = (own + np.outer(s, free))[None]
        m = error_set.luenberger(A62[q:q + 1], C62, L, D62, DV62, W62, V62)
        assert m.A[0] @ F62[q] == pytest.approx(lam * F62[q])
        faults = fault_inputs(A62[q:q + 1], C62, L, F62[q:q + 1], np.zeros((2, 1)))
        try:
            by_delay, last = settled_mode(m, faults, 0, 0, 3)
        except ValueError:  # not stable
            return 1.0, 1.0
        return last, by_delay[3]

    best = minimize(lambda s: found(s)[0], np.zeros(3), method="Nelder-Mead", options={"maxiter": 70})
    last, early = found(best.x)
    assert last == pytest.approx(eventually, rel=.02) and early == pytest.approx(within, rel=.03)


def test_steady_set_is_the_limit(printed):
    for q in range(3):
        far = residual_sets.zonotopes(printed, [q] * 60, np.zeros((3, 1)))[-1]
        D = zonotope.fan(16)
        assert zonotope.support(steady_set(printed, q, 1e-10), D) == pytest.approx(zonotope.support(far, D), rel=1e-8)
        assert np.all(zonotope.support(steady_set(printed, q, .5), D) >= zonotope.support(far, D))  # the rest is boxed
    m = error_set.luenberger(A63, C63, np.zeros_like(L63), D63, DV63, W63, V63)
    with pytest.raises(ValueError, match="mode 0: spectral radius of Ac 1.269"):
        steady_set(m, 0)


# -- per mode and dwell index ----------------------------------------------------------------------------
def test_futures_are_all_that_the_dwell_time_admits():
    for dwell, lasted in ((1, 0), (3, 0), (3, 1), (3, 5)):
        found = list(futures(3, 1, lasted, dwell, 5))
        assert len(set(found)) == len(found)

        def admitted(path, dwell=dwell, lasted=lasted):
            run = lasted + 1
            for a, b in zip(path, path[1:]):
                if a != b and run < dwell:
                    return False
                run = run + 1 if a == b else 1
            return path[0] == 1

        assert sorted(found) == [p for p in product(range(3), repeat=5) if admitted(p)]


def test_surely_detected_with_a_dwell_table(gains21):
    """Every admissible sequence, onset anywhere after the first stay: with the table the alarm comes in time."""
    L, N = gains21
    m, faults = error_set.tnl(A63, C63, L, N, D63, DV63, W63, V63), sensor_faults(L, N)
    table = dwell_table(m, 5, np.eye(3), zonotope.fan(8), 7)
    figures = surely_detected(m, faults, table, 0, 3)
    assert figures.by_delay.shape == (3, 8, 4) and figures.onset < .0595 and figures.within <= figures.onset
    assert np.all(figures.late < figures.onset)
    rng, tightest = np.random.default_rng(5), 0.0
    for _ in range(12):
        path = random_path(rng, 3, 5, 60, 4)
        h, lasted = table.along(path), 0
        for k in range(1, 56):
            lasted = lasted + 1 if path[k] == path[k - 1] else 0
            if sum(a != b for a, b in zip(path[:k], path[1:k + 1])) < 2:
                continue  # not yet in the last stage
            r = response(m, faults, path[k:k + 4], path[k - 1], 0)
            needed = sizes(threshold_gauges(h[k:k + 4], table.directions, r))
            claimed = figures.by_delay[path[k], min(lasted, 7)]
            assert np.all(needed <= claimed * (1 + 1e-12))
            tightest = max(tightest, np.min(needed / claimed))
    assert tightest > .999
    # The same with noise that pulls against the fault: the residual really leaves the set.
    f = 1.0001 * figures.within
    for sign in (1, -1):
        for run in range(20):
            path = random_path(rng, 3, 5, 40, 4)
            w, v = rng.choice([-.1, .1], (40, 1)), rng.choice([-.1, .1], (40, 2))
            onset = 25
            if run % 2:  # against the fault in the direct path
                v[onset:] = -sign * .1 * np.sign(F63[:, 0])
            step = sign * f * (np.arange(40) >= onset)[:, None]
            r = observe(A63, C63, L, N, D63, DV63, path, w, v, np.zeros(3), f=step, Df=F63)
            outside = np.any(np.abs(r @ table.directions.T) > table.along(path), axis=1)
            assert not np.any(outside[:onset]) and np.any(outside[onset:onset + 4])


def test_largest_boxes_by_hand():
    """Mode 0 gathers up to 1/(1 - .9) = 10, mode 1 halves it: .5^2 of it is left at the earliest return."""
    W = np.zeros((3, 2, 1, 1))
    W[:, 0] = 1.0
    m = error_set.ErrorRecursion(np.array([[[.9]], [[.5]]]), np.ones((2, 1, 1)), W, np.zeros((3, 2, 1, 1)), (1,))
    boxes = largest_boxes(m, 2, 4)[:, :, 0]
    assert boxes[0] == pytest.approx([2.5, 3.25, 3.925, 4.5325, 10], rel=2e-3)
    assert boxes[1] == pytest.approx([10, 5, 2.5, 1.25, .625], rel=2e-3)


@pytest.mark.parametrize("dwell", [1, 5])
def test_sets_carried_online(gains21, dwell):
    """Whatever order is kept, settled sets stay below the bound, and faults of the size promised leave them."""
    L, N = gains21
    m, faults = error_set.tnl(A63, C63, L, N, D63, DV63, W63, V63), sensor_faults(L, N)
    D = zonotope.fan(8)
    table = dwell_table(m, dwell, np.eye(3), D, 6)
    bound = online_table(m, table)
    figures = surely_detected(m, faults, mean_table(table, bound), 0, 3)
    assert figures.onset < (.0595 if dwell == 5 else .13)
    rng, reached, last = np.random.default_rng(7), 0.0, bound.h.shape[2] - 1
    blocks = block_table(m, D, 6, 5)
    for _ in range(8):
        path, lasted = random_path(rng, 3, dwell, 70, 4), 0
        exact = residual_sets.thresholds(m, path, np.eye(3), D)
        sets = [residual_sets.thresholds(m, path, np.eye(3), D, order) for order in (3, 5)]
        sets.append(blocks.along(path, np.eye(3)))
        for k in range(1, 66):
            lasted = lasted + 1 if path[k] == path[k - 1] else 0
            if k < 40:
                continue
            ratio = [np.max(h[k] / bound.h[0, path[k], min(lasted, last)]) for h in sets]
            assert max(ratio) <= 1
            reached = max(reached, ratio[0])
            r = np.abs(response(m, faults, path[k:k + 4], path[k - 1], 0) @ D.T)
            for d, f in enumerate(figures.by_delay[path[k], min(lasted, last)]):
                for h in sets:
                    assert np.any(f * r[:d + 1] > (h + exact)[k:k + d + 1])
    assert reached > .98  # the bound is not larger than it need be
    grown = error_set.ErrorRecursion(m.A * 20, m.C, m.W, m.V, m.groups)
    assert largest_boxes(grown, dwell, 6) is None and online_table(grown, table) is None


def test_one_mode_and_long_dwell(gains21):
    L = np.array([[[.3, 0], [.1, .2], [0, .1]]])
    one = error_set.luenberger(A62[:1], C62, L, D62, DV62, W62, V62)
    faults = fault_inputs(A62[:1], C62, L, F62[:1], np.zeros((2, 1)))
    table = dwell_table(one, 1, H62, zonotope.fan(8), 30)
    got = surely_detected(one, faults, table, 0, 4)
    exact, last = settled_mode(one, faults, 0, 0, 4)
    assert isinstance(got, SureByMode) and got.by_delay[0, 0, 0] == np.inf  # a fault on the state shows a sample later
    assert np.all(got.by_delay[0, 30] >= exact * (1 - 1e-5))
    assert got.late[0] >= last * (1 - 1e-5)
    assert got.by_delay[0, 30, 1:] == pytest.approx(exact[1:], rel=.1)
