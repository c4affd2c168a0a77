r"""Storage matrices for a closed loop of given constants: proposals, which ``certify.tracking_loop`` decides.

The vertices of a loop at a short period are near their middle, so that the storage of the middle often does for all of
them: a Lyapunov equation, and a Riccati equation whose level is bisected. Only where it does not a solver looks for a
common one.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from .descriptor_lmi import solve

Array = np.ndarray
#: Share of the states that the Riccati equation adds to the output: what makes its inequality strict.
STRICT = 1e-6


def decaying(matrices: list[Array], units: Array, factor: float, margin: float) -> list | None:
    """P with M' P M < factor^2 P for every matrix.

    Parameters
    ----------
    matrices : list of ndarray (N, N)
    units : ndarray (N,)
        Of the states: numbers of about one.
    factor, margin : float

    Returns
    -------
    P : nested lists or None
        None where none is found.
    """
    N, scaled = len(units), [M * units / units[:, None] for M in matrices]
    middle = np.mean(scaled, axis=0)
    if np.abs(np.linalg.eigvals(middle)).max() < factor:
        P = solve_discrete_lyapunov(middle.T / factor, np.eye(N))
        if all(_least(factor**2 * P - M.T @ P @ M) > margin for M in scaled):
            return _listed(P, units)
    P = cp.Variable((N, N), symmetric=True)
    conditions = [P >> np.eye(N)]
    for M in scaled:
        S = factor**2 * P - M.T @ P @ M
        conditions.append((S + S.T) / 2 >> margin * np.eye(N))
    if not solve(cp.Problem(cp.Minimize(cp.trace(P)), conditions)):
        return None
    return _listed(P.value, units)


def level(matrices: list[Array], inputs: list[Array], out: Array, units: Array, margin: float) -> dict | None:
    """An energy gain, to a hundredth of the least that one storage shows, and that storage.

    Parameters
    ----------
    matrices : list of ndarray (N, N), inputs : list of ndarray (N, q)
    out : ndarray (k, N)
    units : ndarray (N,)
    margin : float

    Returns
    -------
    proof : dict or None
        "level2", "P"; None where none is found.
    """
    N, q = inputs[0].shape
    out = out * units
    flows = [np.hstack([M * units, B]) / units[:, None] for M, B in zip(matrices, inputs)]
    best, low, high = None, 0.0, 1e3
    while high > 1.01 * max(low, 1e-6):
        gamma = np.sqrt(max(low, 1e-6) * high)
        P = _storage(np.mean(flows, axis=0), out, gamma)
        if P is not None and all(_least(_gain(P, flow, out, gamma**2)) > margin for flow in flows):
            best, high = {"level2": float(gamma**2), "P": _listed(P, units)}, gamma
        else:
            low = gamma
    if best is not None:
        return best
    P, g = cp.Variable((N, N), symmetric=True), cp.Variable()
    conditions = [P >> margin * np.eye(N)]
    for flow in flows:
        now = cp.bmat([[P - out.T @ out, np.zeros((N, q))], [np.zeros((q, N)), g * np.eye(q)]])
        S = now - flow.T @ P @ flow
        conditions.append((S + S.T) / 2 >> margin * np.eye(N + q))
    if not solve(cp.Problem(cp.Minimize(g), conditions)):
        return None
    return {"level2": float(g.value), "P": _listed(P.value, units)}


def _storage(flow: Array, out: Array, gamma: float) -> Array | None:
    """The stabilising solution of P = A'PA + C'C + A'PB (g^2 - B'PB)^-1 B'PA; None where there is none."""
    N = len(flow)
    A, B = flow[:, :N], flow[:, N:]
    try:
        P = solve_discrete_are(A, B, out.T @ out + STRICT * np.eye(N), -gamma**2 * np.eye(B.shape[1]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    return P if np.all(np.isfinite(P)) and _least(P) > 0 else None


def _gain(P: Array, flow: Array, out: Array, level: float) -> Array:
    """P - e'e and the level, less what the storage is after a step."""
    N = len(P)
    S = -flow.T @ P @ flow
    S[:N, :N] += P - out.T @ out
    S[N:, N:] += level * np.eye(len(S) - N)
    return S


def _least(S: Array) -> float:
    return float(np.linalg.eigvalsh((S + S.T) / 2)[0])


def _listed(P: Array, units: Array) -> list:
    return ((P + P.T) / 2 / np.outer(units, units)).tolist()
