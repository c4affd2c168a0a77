r"""An ellipsoid that the error of an observer keeps: e+ = N_j e + W_j d with |d_i| <= 1 and j switching as it likes.

With P > 0, diagonal D_j and a share a,

    (N_j e + W_j d)' P (N_j e + W_j d) <= a e' P e + d' D_j d,        tr D_j <= 1 - a,

V = e' P e comes down to 1 at least as fast as a says, and stays there. A linear matrix inequality for each a; the best
of some is taken. What comes out is a proposal: ``certify.fault_sets`` decides.
"""

from __future__ import annotations

from collections.abc import Sequence

import cvxpy as cp
import numpy as np
import scipy.linalg

from .descriptor_lmi import assembled, solve

Array = np.ndarray
#: Shares that are tried, as parts of the way from the least possible one to 1.
PARTS = (0.5,)
#: V at most at a start, where it is 1 in the end: what it comes down from takes time.
HIGHEST = 5e3
#: Smallest squared size of an error beside the largest, for the solver's coordinates.
LEAST = 1e-4
#: Room for the exact check in coordinates where everything is near 1.
SPARE = 1e-7


def kept_ellipsoid(N: Sequence[Array], W: Sequence[Array], rows: Array,
                   start: Array) -> tuple[Array, list[Array], float] | None:
    """Propose an ellipsoid with narrow bounds of some rows.

    Parameters
    ----------
    N : sequence of ndarray (n, n), W : sequence of ndarray (n, q)
    rows : ndarray (k, n)
        What is to be bounded.
    start : ndarray (n, l)
        The error at a start is this times numbers in [-1, 1]; V is at most `HIGHEST` there.

    Returns
    -------
    P : ndarray (n, n)
    D : list of ndarray (q,)
    share : float
        None where there is no such ellipsoid.
    """
    least, best = max(np.max(np.abs(np.linalg.eigvals(M))) for M in N) ** 2, None
    if least >= 1:
        return None
    L = coordinates(N, W)
    back = np.linalg.inv(L)
    N, W, rows, start = [back @ M @ L for M in N], [back @ M for M in W], rows @ L, back @ start
    rows = rows / np.linalg.norm(rows, axis=1)[:, None]
    for part in PARTS:
        share = least + part * (1 - least)
        found = _for_share(N, W, rows, start, share)
        if found is not None and (best is None or found[0] < best[0]):
            best = (*found, share)
    if best is None:
        return None
    _, P, D, share = best
    P = back.T @ P @ back
    return (P + P.T) / 2, [np.maximum(d, 0.0) for d in D], share


def coordinates(N: Sequence[Array], W: Sequence[Array]) -> Array:
    """L of e = L z in which errors of the mean of the vertices are about as large one way as another.

    Parameters
    ----------
    N : sequence of ndarray (n, n), W : sequence of ndarray (n, q)
    """
    mean = sum(N) / len(N)
    X = scipy.linalg.solve_discrete_lyapunov(mean, sum(M @ M.T for M in W) / len(W))
    values, vectors = np.linalg.eigh((X + X.T) / 2)
    values = np.maximum(values, LEAST * values.max())
    return vectors * np.sqrt(values) if values.max() > 0 else np.eye(len(X))


def _for_share(N, W, rows: Array, start: Array, share: float):
    n, q = N[0].shape[0], W[0].shape[1]
    P, top = cp.Variable((n, n), symmetric=True), cp.Variable(len(rows))
    D = [cp.Variable(q, nonneg=True) for _ in N]  # in units of 1 - share, as W' P W is
    conditions = [P >> SPARE * np.eye(n), cp.sum(cp.abs(start.T @ P @ start)) <= HIGHEST]
    for M, wide, d in zip(N, W, D):
        wide = wide / np.sqrt(1 - share)
        S = assembled([[share * P - M.T @ P @ M, -(M.T @ P @ wide)], [cp.diag(d) - wide.T @ P @ wide]])
        conditions += [S >> SPARE * np.eye(n + q), cp.sum(d) <= 1 - 1e-6]
    for k, row in enumerate(rows):
        conditions.append(assembled([[cp.reshape(top[k], (1, 1), order="C"), row[None]], [P]]) >> 0)
    if not solve(cp.Problem(cp.Minimize(cp.sum(top)), conditions)):
        return None
    return float(top.value.sum()), P.value, [d.value * (1 - share) for d in D]
