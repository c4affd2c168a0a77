"""Storage matrices for a closed loop of given constants: proposals, which ``certify.tracking_loop`` decides."""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from .descriptor_lmi import solve

Array = np.ndarray


def decaying(matrices: list[Array], units: Array, factor: float, margin: float) -> list | None:
    """P with M' P M < factor^2 P for every matrix.

    Parameters
    ----------
    matrices : list of ndarray (N, N)
    units : ndarray (N,)
        Of the states: the solver meets numbers of about one.
    factor, margin : float

    Returns
    -------
    P : nested lists or None
        None where the solver finds none.
    """
    N = len(units)
    P = cp.Variable((N, N), symmetric=True)
    conditions = [P >> np.eye(N)]
    for M in matrices:
        M = M * units / units[:, None]
        S = factor**2 * P - M.T @ P @ M
        conditions.append((S + S.T) / 2 >> margin * np.eye(N))
    if not solve(cp.Problem(cp.Minimize(cp.trace(P)), conditions)):
        return None
    return _listed(P.value, units)


def level(matrices: list[Array], inputs: list[Array], out: Array, units: Array, margin: float) -> dict | None:
    """Least energy gain that one storage shows, and that storage.

    Parameters
    ----------
    matrices : list of ndarray (N, N), inputs : list of ndarray (N, q)
    out : ndarray (k, N)
    units : ndarray (N,)
    margin : float

    Returns
    -------
    proof : dict or None
        "level2", "P"; None where the solver finds none.
    """
    N, q = inputs[0].shape
    P, g = cp.Variable((N, N), symmetric=True), cp.Variable()
    conditions = [P >> margin * np.eye(N)]
    # A short period makes every step small, P large: with pace P and inputs over its root all blocks are of one size.
    pace = 1 - max(np.abs(np.linalg.eigvals(M)).max() for M in matrices)
    if pace <= 0:
        return None
    out = out * units * np.sqrt(pace)
    for M, B in zip(matrices, inputs):
        flow = np.hstack([M * units, B / np.sqrt(pace)]) / units[:, None]
        now = cp.bmat([[P - out.T @ out, np.zeros((N, q))], [np.zeros((q, N)), g * np.eye(q)]])
        S = now - flow.T @ P @ flow
        conditions.append((S + S.T) / 2 >> margin * np.eye(N + q))
    if not solve(cp.Problem(cp.Minimize(g), conditions)):
        return None
    return {"level2": float(g.value), "P": _listed(P.value / pace, units)}


def _listed(P: Array, units: Array) -> list:
    return ((P + P.T) / 2 / np.outer(units, units)).tolist()
