r"""What moves the error of a polytopic observer at most, on the numbers of the C: what thresholds rest on.

With eb = T1 E x - z (``polytope_error``), the plant at vertex i and the observer at vertex j, exactly,

    eb+ = N_j eb + M_ij x + B_ij u + D_ij d + rounding,      M r = O eb + (what x and d do to it) + rounding,

and what plant and observer do with any weights is a mean of these. x, u, d are in their ranges: each is a middle, one
column of W for all of them, and half widths, one column each. Nothing is said of how the weights move, so the set that
``filter_bounds`` finds holds for every pair at every sample.

A continuous plant moves between samples. Its mean weights and disturbance over a period are weights and a disturbance
again, so that only the change of x since the sample is left over: T1 sum_i h_i A_i (x(t) - x), bounded by `drift`.

Rounding is bounded in ``polytope_rounding``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .exact import Q, eye, product, rational, zeros
from .filter_model import JointMode
from .polytope_error import standard_errors
from .polytope_rounding import rounding

Array = np.ndarray
#: Turns of `drift`: every one of them is sound, and they come down fast.
TURNS = 30


@dataclass(frozen=True)
class Ranges:
    """Where the signals are, as middles and half widths; rational object arrays.

    Parameters
    ----------
    x, u, d : (ndarray (n,), ndarray (n,))
        u and d in their units, as those of the problem.
    """

    x: tuple[Array, Array]
    u: tuple[Array, Array]
    d: tuple[Array, Array]

    @classmethod
    def of(cls, plant, problem) -> Ranges:
        """Those of a plant file.

        Parameters
        ----------
        plant : Plant
        problem : DescriptorProblem
        """
        d = [np.concatenate(ends) for ends in zip(plant.limits("w"), plant.limits("v"))]
        return cls(middle(*plant.limits("x")), middle(*plant.limits("u"), problem.u_unit), middle(*d, problem.d_unit))


def middle(lo: Array, hi: Array, unit: Array | None = None) -> tuple[Array, Array]:
    """Middle and half width of ranges, exactly.

    Parameters
    ----------
    lo, hi : ndarray (n,)
    unit : ndarray (n,), optional
        What they are measured in.
    """
    lo, hi = (rational(v).reshape(len(v)) for v in (lo, hi))
    size = rational(np.ones(len(lo)) if unit is None else unit).reshape(len(lo))
    return (lo + hi) / 2 / size, (hi - lo) / 2 / size


def columns(parts: list[tuple[Array, tuple[Array, Array]]], extra: list[Array] = ()) -> Array:
    """What several signals do together: a column of their middles, then one for each half width.

    Parameters
    ----------
    parts : list of (object array (k, n), (middle, half))
    extra : list of object array (k, n)
        Columns of unknowns in [-1, 1].
    """
    rows = len(parts[0][0])
    centre = sum((product(M, mid.reshape(-1, 1)) for M, (mid, _) in parts), zeros(rows, 1))
    return np.concatenate([centre, *(M * half for M, (_, half) in parts), *extra], axis=1)


def reach(M: Array, box: tuple[Array, Array]) -> Array:
    """Largest magnitude of every row of M over a box.

    Parameters
    ----------
    M : object array (k, n), box : (middle, half)
    """
    mid, half = box
    return abs(product(M, mid.reshape(-1, 1)))[:, 0] + product(abs(M), half.reshape(-1, 1))[:, 0]


def largest(rows: list[Array]) -> Array:
    """Entrywise maximum of rational vectors."""
    return np.array([max(values) for values in zip(*rows)], dtype=object).reshape(len(rows[0]))


def drift(problem, box: Ranges, period: float) -> Array:
    """Bounds of the mean of |x(t) - x| over a period after a sample, per state (n,).

    E x changes by at most half a period times the largest E x' in the ranges, on the mean. The algebraic rows
    S' (A x + B u + Bd d) = 0, with other weights and another disturbance at t than at the sample, and their means:
    with W near the inverse of [E; S' A], |x(t) - x| <= |W| (right side) + |I - W [E; S' A_i]| |x(t) - x|, from the
    width of the ranges downwards.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a continuous plant.
    box : Ranges
    period : float
    """
    E, A, B, Bd, S = (rational(getattr(problem, k)) for k in ("E", "A", "B", "Bd", "S"))
    B, Bd = B * rational(problem.u_unit), Bd * rational(problem.d_unit)
    n, change = len(E), 2 * box.x[1]
    speed = largest([reach(a, box.x) + reach(b, box.u) + reach(g, box.d) for a, b, g in zip(A, B, Bd)])
    mean = sum(A[1:], A[0]) / len(A)
    tall = np.concatenate([E, product(S.T, mean)], axis=0)
    near = rational(np.linalg.pinv(np.array([[float(v) for v in row] for row in tall])))
    # The algebraic rows at both ends: what x, u and d at the sample do to their difference.
    left = zeros(S.shape[1])
    for i in range(len(A)):
        for k in range(len(A)):
            rows = [reach(product(S.T, M[i] - M[k]), side) for M, side in ((A, box.x), (B, box.u))]
            rows.append(reach(product(S.T, Bd[i]), box.d) + reach(product(S.T, Bd[k]), box.d))
            left = largest([left, sum(rows[1:], rows[0])]) if len(left) else left
    right = np.concatenate([Q(period) / 2 * speed, left])
    driven = product(abs(near), right.reshape(-1, 1))[:, 0]
    loss = zeros(n, n)
    for a in A:
        loss = np.maximum(loss, abs(eye(n) - product(near, np.concatenate([E, product(S.T, a)], axis=0))))
    for _ in range(TURNS):
        change = np.minimum(change, driven + product(loss, change.reshape(-1, 1))[:, 0])
        change = rational(np.nextafter([float(v) for v in change], np.inf))  # short numbers again, none smaller
    return change


def model(plant, problem, t, T1: Array, period: float | None) -> tuple[tuple[JointMode, ...], Array]:
    """The recursion of eb, one entry per pair of vertices, and T1 E.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    T1 : ndarray (n, n) or (h, n, n)
        As for ``polytope_error.standard_errors``.
    period : float or None
        Of a continuous plant.

    Returns
    -------
    model : tuple of JointMode
        What it estimates is M r.
    T1E : object array (n, n)
    """
    errors, box, slip = standard_errors(problem, t, T1, period), Ranges.of(plant, problem), rounding(t)
    n, m, p = len(problem.E), problem.B.shape[2], len(problem.C)
    F, K, C, T2, G, M = (rational(getattr(t, key)) for key in ("F", "K", "C", "T2", "G", "M"))
    moved = None if period is None else drift(problem, box, period)
    passed = eye(p) - product(C, T2)  # what an error of y is in r
    seen = product(M, errors.residual)
    noise = [product(M, passed) * slip.y, product(M, C) * slip.x_hat, M * slip.r, eye(p) * slip.weighted]
    room = abs(columns([(seen[:, n:2 * n], box.x), (seen[:, 2 * n:2 * n + m], box.u), (seen[:, 2 * n + m:], box.d)],
                       noise)).sum(axis=1)
    out = []
    for (_, j), (A, B) in errors.pairs.items():
        own = [(product(F[j], T2) - product(K[j], passed)) * slip.y, G[j] * slip.u,
               (F[j] + product(K[j], C)) * slip.x_hat, K[j] * slip.r, eye(n) * slip.z]
        if moved is not None:
            fixed = errors.T1[j % len(errors.T1)]
            change = largest([product(abs(product(fixed, rational(a))), moved.reshape(-1, 1))[:, 0] for a in problem.A])
            own.append(eye(n) * (Q(period) * change))
        W = columns([(A[:n, n:], box.x), (B[:n, :m], box.u), (B[:n, m:], box.d)], own)
        out.append(JointMode(A[:n, :n], W, (), seen[:, :n], zeros(p, n), room))
    return tuple(out), product(errors.T1[0], rational(problem.E))
