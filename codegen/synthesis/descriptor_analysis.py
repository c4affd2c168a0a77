"""The level of given constants, for instance of rounded ones: Lyapunov matrices anew.

The error model comes from outside (``certify.polytope_error`` makes it, in exact numbers) with all that rounding does.
What comes out is a proposal; ``certify.polytope_gain`` decides.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from .descriptor_lmi import LEAST, Storage, euler, he, solve
from .descriptor_problem import Scaling

Array = np.ndarray
DROP = 1e-9


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))


def _clean(M: Array) -> Array:
    """Drop entries that rounding alone left: beside those near 1 they stop a solver. The exact check has them."""
    return np.where(np.abs(M) < DROP * np.max(np.abs(M), initial=0.0), 0.0, M)


def _negative(M, margin: float):
    return M << -margin * np.eye(M.shape[0])


def continuous_level(model, s: Scaling, S: Array, direct: bool, decay: float, period: float | None,
                     margin: float) -> dict | None:
    """Least level in continuous time.

    Parameters
    ----------
    model : ErrorModel
        Anything with Ee, E, pairs, C, D.
    s : Scaling
    S : ndarray (n, n - r)
        Of the plant's own units.
    direct : bool
        Whether the error obeys the plant's E.
    decay : float
        In the plant's time.
    period : float or None
        Euler steps of this length are to contract.
    margin : float
        What every inequality keeps to spare in scaled coordinates: room for the exact check.

    Returns
    -------
    proof : dict or None
        "level2", "Y1", "X1", "Y2", "X2"; None where the solver finds no level.
    """
    n, rows = len(model.E), s.rows
    left = np.concatenate([rows if direct else 1 / (s.columns * s.time), rows])
    right = np.concatenate([s.columns, s.columns])
    E = s.time * rows[:, None] * _floats(model.E) * s.columns
    Ee, none = (E, S / rows[:, None]) if direct else (np.eye(n), np.zeros((n, 0)))
    own, plant = Storage(Ee, none), Storage(E, S / rows[:, None])
    level, N = cp.Variable(), {}
    conditions = [level >= LEAST**2, own.Y >> margin * np.eye(n), plant.Y >> margin * np.eye(n)]
    out = _clean(np.hstack([_floats(model.C) * right, _floats(model.D)]))
    for (_, j), (A, B) in model.pairs.items():
        A, B = _clean(left[:, None] * _floats(A) * right), _clean(left[:, None] * _floats(B))
        N[j] = A[:n, :n]
        flow, k = np.hstack([A, B]), B.shape[1]
        V = cp.vstack([own.P.T @ flow[:n], plant.P.T @ flow[n:], *([np.zeros((k, 2 * n + k))] if k else [])])
        M = V + V.T + out.T @ out - np.diag([0.0] * 2 * n + [1.0] * k) * level
        conditions.append(_negative((M + M.T) / 2, margin))
    for own_part in N.values():
        M = he(own.P.T @ own_part) + 2 * decay / s.time * Ee.T @ own.Y @ Ee
        conditions.append(_negative((M + M.T) / 2, margin))
        if period is not None:
            conditions.append(euler(own.Y, own.Y @ own_part, period * s.time, margin))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        return None
    (Y1, X1), (Y2, X2) = own.values(), plant.values()
    weight = s.time * np.outer(rows, rows)
    Y1 = weight * Y1 if direct else Y1 / np.outer(s.columns, s.columns) / s.time
    return {"level2": float(level.value), "Y1": Y1.tolist(), "X1": (X1 / s.columns).tolist(),
            "Y2": (weight * Y2).tolist(), "X2": (X2 / s.columns).tolist()}


def discrete_level(model, s: Scaling, S: Array, contraction: float, margin: float) -> dict | None:
    """Least level in discrete time, of the standard form, or with algebraic equations that the observer solves.

    Parameters
    ----------
    model : ErrorModel
    s : Scaling
        Its time is not used.
    S : ndarray (n, n - r)
    contraction : float
        Every sample shrinks the error by this factor at least.
    margin : float

    Returns
    -------
    proof : dict or None
        "level2", "P1", "P2", "R", with ``model.ties`` "Re" too; None where the solver finds no level.
    """
    n, rows, size = len(model.E), s.rows, np.linalg.norm(S, axis=0)
    left, right = np.concatenate([1 / s.columns, rows]), np.concatenate([s.columns, s.columns])
    E, Sn = rows[:, None] * _floats(model.E) * s.columns, S / rows[:, None] / size
    P1, P2 = (cp.Variable((n, n), symmetric=True) for _ in range(2))
    level = cp.Variable()
    conditions = [level >= LEAST**2, *(P >> margin * np.eye(n) for P in (P1, P2))]
    out = _clean(np.hstack([_floats(model.C) * right, _floats(model.D)]))
    R, N = cp.Variable((out.shape[1], S.shape[1])) if S.size else None, {}
    Ee, ties = _floats(model.Ee), _ties(model, right)
    Re, Rc = (cp.Variable((k, S.shape[1])) if ties else None for k in (out.shape[1], n))
    for (i, j), (A, B) in model.pairs.items():
        A, B = _clean(left[:, None] * _floats(A) * right), _clean(left[:, None] * _floats(B))
        N[j] = A[:n, :n]
        flow, k = np.hstack([A, B]), B.shape[1]
        now = cp.bmat([[Ee.T @ P1 @ Ee, np.zeros((n, n))], [np.zeros((n, n)), E.T @ P2 @ E]])
        if k:
            now = cp.bmat([[now, np.zeros((2 * n, k))], [np.zeros((k, 2 * n)), level * np.eye(k)]])
        M = flow[:n].T @ P1 @ flow[:n] + flow[n:].T @ P2 @ flow[n:] - now + out.T @ out
        if S.size:
            M = M + he(R @ (Sn.T @ flow[n:]))
        if ties:
            M = M + he(Re @ ties[i, j])
        conditions.append(_negative((M + M.T) / 2, margin))
    for j, own in N.items():
        M = own.T @ P1 @ own - contraction**2 * (Ee.T @ P1 @ Ee)
        if ties:
            M = M + he(Rc @ ties[j, j][:, :n])
        conditions.append(_negative((M + M.T) / 2, margin))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        return None
    P1, P2 = ((P.value + P.value.T) / 2 for P in (P1, P2))
    units = np.concatenate([right, np.ones(out.shape[1] - 2 * n)])
    free = R.value / units[:, None] / size if S.size else np.zeros((out.shape[1], 0))
    return {"level2": float(level.value), "P1": (P1 / np.outer(s.columns, s.columns)).tolist(),
            "P2": (P2 * np.outer(rows, rows)).tolist(), "R": free.tolist(),
            **({"Re": (Re.value / units[:, None]).tolist()} if ties else {})}


def _ties(model, right: Array) -> dict:
    """The rows that are zero, in scaled coordinates."""
    units = {pair: np.concatenate([right, np.ones(tie.shape[1] - len(right))]) for pair, tie in model.ties.items()}
    return {pair: _clean(_floats(tie) * units[pair]) for pair, tie in model.ties.items() if tie.size}


def tied_contraction(model, P1: Array, s: Scaling, margin: float) -> dict | None:
    """Factor by which every sample shrinks e' Ee' P1 Ee e, where the observer solves algebraic equations.

    Parameters
    ----------
    model : ErrorModel
    P1 : ndarray (n, n)
        In the plant's units.
    s : Scaling
    margin : float

    Returns
    -------
    proof : dict or None
        "contraction", "Rc"; None where the solver finds none.
    """
    n, right = len(model.E), np.concatenate([s.columns, s.columns])
    P, Ee, ties = P1 * np.outer(s.columns, s.columns), _floats(model.Ee), _ties(model, right)
    square, conditions = cp.Variable(), []
    Rc = cp.Variable((n, next(iter(ties.values())).shape[0])) if ties else None
    for (_, j), (A, _) in model.pairs.items():
        N = _clean(_floats(A[:n, :n]) * s.columns / s.columns[:, None])
        M = N.T @ P @ N - square * (Ee.T @ P @ Ee)
        if ties:
            M = M + he(Rc @ ties[j, j][:, :n])
        conditions.append(_negative((M + M.T) / 2, margin))
    if not solve(cp.Problem(cp.Minimize(square), conditions)):
        return None
    return {"contraction": float(np.sqrt(max(square.value, 0.0)) * (1 + 1e-9)),
            "Rc": (Rc.value / s.columns[:, None] if ties else np.zeros((n, 0))).tolist()}


def sensitivity_level(model, M: Array, s: Scaling, S: Array, margin: float) -> dict | None:
    """Largest share of a fault's energy that the weighted residual has at least.

    Parameters
    ----------
    model : FaultModel
        Anything with pairs, C, D, E, moved.
    M : ndarray (k, p)
    s : Scaling
    S : ndarray (n, n - r)
    margin : float

    Returns
    -------
    proof : dict or None
        "level2", "Y1", and "Y2", "X2" where a fault moves x; None where the solver finds none.
    """
    n, rows = len(model.E), s.rows
    left, right = np.concatenate([1 / (s.columns * s.time), rows]), np.concatenate([s.columns, s.columns])
    own = Storage(np.eye(n), np.zeros((n, 0)))
    plant = Storage(s.time * rows[:, None] * _floats(model.E) * s.columns, S / rows[:, None]) if model.moved else None
    level, conditions = cp.Variable(), [P.Y >> margin * np.eye(n) for P in (own, plant) if P is not None]
    out = _clean(M @ np.hstack([_floats(model.C) * right, _floats(model.D)]))
    per_vertex = {j: m for (_, j), m in model.pairs.items()}  # without x the plant's vertex does not matter
    for A, B in (model.pairs if model.moved else per_vertex).values():
        flow = np.hstack([_clean(left[:, None] * _floats(A) * right), _clean(left[:, None] * _floats(B))])
        n_f = B.shape[1]
        kept = [*range(n), *(range(n, 2 * n) if model.moved else ()), *range(2 * n, 2 * n + n_f)]
        V = cp.vstack([own.P.T @ flow[:n, kept], *([plant.P.T @ flow[n:, kept]] if model.moved else []),
                       np.zeros((n_f, len(kept)))])
        R = out[:, kept].T @ out[:, kept] - np.diag([0.0] * (len(kept) - n_f) + [1.0] * n_f) * level - V - V.T
        conditions.append((R + R.T) / 2 >> margin * np.eye(len(kept)))
    if not solve(cp.Problem(cp.Maximize(level), conditions)):
        return None
    proof = {"level2": float(level.value),
             "Y1": (own.values()[0] / np.outer(s.columns, s.columns) / s.time).tolist()}
    if plant is not None:
        Y2, X2 = plant.values()
        proof |= {"Y2": (s.time * np.outer(rows, rows) * Y2).tolist(), "X2": (X2 / s.columns).tolist()}
    return proof
