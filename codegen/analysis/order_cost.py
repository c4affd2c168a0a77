"""What the order of a zonotope buys and costs: thresholds over the exact ones, multiply-adds, words of state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.dwell import patterns
from ..algebra.error_set import ErrorRecursion, tnl
from ..observers.zonotope import set_work

Array = np.ndarray
#: Length of the mode sequences, and samples at their beginning that do not count.
STEPS, FIRST = 60, 20
#: Directions that thresholds of two residuals are compared in.
FAN = 8


@dataclass(frozen=True)
class OrderCost:
    """One order of a zonotope.

    Parameters
    ----------
    order : int
    accuracy, worst : float
        Threshold over that of the exact set, mean and largest over mode sequences and directions; 1 is exact, inf where
        the set grows without bound.
    multiply_adds : int
        Of the set in a sample: reduction, carrying, bounds, membership. The estimate comes on top.
    words : int
        Numbers of the set in the state.
    """

    order: int
    accuracy: float
    worst: float
    multiply_adds: int
    words: int


def order_cost(plant, tables, orders: Sequence[int], dwell: int = 1) -> list[OrderCost]:
    """Return accuracy and cost of a zonotope of each order beside the estimate of a point observer.

    Parameters
    ----------
    plant : Plant
    tables : PointTables
        Of any family: its estimate is read.
    orders : sequence of int
        Each at least the number of states.
    dwell : int
        Samples a mode lasts at least.

    Returns
    -------
    records : list of OrderCost
    """
    t, n_y = tables, plant.n_y
    m = recursion(plant, t)
    half = np.maximum(t.x0_hi.astype(float) - t.x0_lo, t.x_hi.astype(float) - t.x_lo) / 2.0
    weight = np.maximum(t.limit.astype(float), half) ** -2.0
    template = getattr(t.shape, "directions", np.zeros((0, n_y))).astype(float)
    D = zonotope.fan(FAN) if n_y == 2 else np.concatenate([np.eye(n_y), template])
    paths = np.array(patterns(m.modes, dwell, STEPS))
    exact = supports(m, paths, half, D)
    added, noises = (int(np.any(G, axis=(0, 1, 2)).sum()) for G in (m.W, m.V))
    out = []
    for order in orders:
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = zonotope.ratio(supports(m, paths, half, D, order, weight), exact)[FIRST:]
        work = set_work(plant.n_x, n_y, order, added, noises, len(template))
        bounded = np.all(np.isfinite(ratio)) and np.max(ratio[-FIRST:]) <= 1.02 * np.max(ratio[-2 * FIRST:-FIRST])
        mean, worst = (float(ratio.mean()), float(ratio.max())) if bounded else (np.inf, np.inf)
        out.append(OrderCost(int(order), mean, worst, work.multiply, work.words))
    return out


def recursion(plant, t) -> ErrorRecursion:
    """Return the recursion of the errors of an estimate under the disturbance and noise of its plant.

    Parameters
    ----------
    plant : Plant
    t : PointTables

    Returns
    -------
    m : ErrorRecursion
    """
    modes = plant.enclosed.modes

    def stacked(name: str) -> Array:
        return np.array([getattr(mode, name) for mode in modes], dtype=float)

    halves = {name: (stacked(f"{name}_hi") - stacked(f"{name}_lo")) / 2.0 for name in "wv"}
    return tnl(stacked("A"), stacked("C"), t.L.astype(float), t.N.astype(float), stacked("Bw"), stacked("Dv"),
               halves["w"], halves["v"])


def supports(m: ErrorRecursion, paths: Array, half: Array, directions: Array, order: int | None = None,
             weight: Array | None = None) -> Array:
    """Return supports of residual sets along mode sequences from a box of errors on.

    Parameters
    ----------
    m : ErrorRecursion
    paths : ndarray (S, K) int
    half : ndarray (n,)
    directions : ndarray (d, n_y)
    order : int or None
        None: no reduction, the set is exact.
    weight : ndarray (n,) or None
        Of the squares in the key by which columns are kept.

    Returns
    -------
    h : ndarray (K, S, d)
    """
    out = []
    for path in paths:
        H, before = np.diag(half), m.start
        rows = []
        for q in path:
            rows.append(zonotope.support(m.C[q] @ H, directions) + zonotope.support(m.V[before, q], directions))
            if order is not None:
                H = zonotope.reduce(H, order, "squared", None, weight)
            H = np.concatenate([m.A[q] @ H, m.W[before, q]], axis=1)
            before = q
        out.append(rows)
    return np.array(out).swapaxes(0, 1)
