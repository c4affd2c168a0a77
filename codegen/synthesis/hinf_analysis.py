"""The level of given filter gains, for instance of rounded ones: Lyapunov matrices and multipliers anew.

With the gains fixed the inequality is linear in the Lyapunov matrices themselves, so no slack is needed and the level
is at most that of the design. What comes out is a proposal; ``certify.switched_gain`` decides.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from .hinf_filter import FilterDesign, Multipliers, solve
from .hinf_problem import FilterMode, FilterProblem

Array = np.ndarray


def closed_loop(m: FilterMode, gains) -> tuple[Array, Array]:
    """Plant and filter together: next [x; s], and z, of [x; s; d; p].

    Parameters
    ----------
    m : FilterMode
    gains : (A, B, C, D) of the filter in this mode

    Returns
    -------
    move : ndarray (n_x + n_s, n_x + n_s + n_d + n_p)
    out : ndarray (n_f, n_x + n_s + n_d + n_p)
    """
    A, B, C, D = (np.asarray(g, dtype=float) for g in gains)
    n = len(m.A)
    H = np.hstack([b.H for b in m.blocks]) if m.blocks else np.zeros((n + len(m.C), 0))
    move = np.block([[m.A, np.zeros((n, len(A))), m.E, H[:n]], [B @ m.C, A, B @ m.F, B @ H[n:]]])
    return move, np.hstack([D @ m.C + m.Cz, C, D @ m.F + m.Fz, D @ H[n:]])


def coordinates(problem: FilterProblem, gains, proof: dict) -> Array:
    """Root R of a typical Lyapunov matrix, P = R R': in coordinates R' [x; s] all of them are near the identity."""
    P = np.mean([np.asarray(p) for p in proof["P"]], axis=0)
    size = 2.0 ** np.round(-np.log2(np.diag(P)) / 2)
    P = P * np.outer(size, size)
    values, vectors = np.linalg.eigh((P + P.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 1e-9 * values[-1]))
    return root / size[:, None]


def level_of(problem: FilterProblem, gains, start: dict, margin: float = 1e-8, refit: bool = False):
    """Least level of given gains.

    Parameters
    ----------
    problem : FilterProblem
    gains : sequence of (A, B, C, D), one per mode
    start : dict
        "P" of the design, for the scaling.
    margin : float
        What every inequality keeps to spare in scaled coordinates: room for the exact check.
    refit : bool
        C and D are chosen anew along with the rest: still one convex step.

    Returns
    -------
    FilterDesign or None
        None where the solver finds no level.
    """
    root = coordinates(problem, gains, start)
    k, (_, _, n_y, n_f) = len(root), problem.sizes
    back = np.linalg.inv(root)
    nodes, level = problem.switching.mode, cp.Variable(nonneg=True)
    P = [cp.Variable((k, k), symmetric=True) for _ in nodes]
    n_s = k - len(problem.modes[0].A)
    bounds = [Multipliers(m, n_s) for m in problem.modes]
    free = [(cp.Variable((n_f, n_s)), cp.Variable((n_f, n_y))) if refit else None for _ in problem.modes]
    constraints = [c for b in bounds for c in b.constraints] + [p >> margin * np.eye(k) for p in P]
    for a, b in problem.switching.edges:
        q = nodes[a]
        S = _edge(problem.modes[q], gains[q], free[q], bounds[q], (P[a], P[b]), level, (root, back))
        constraints.append((S + S.T) / 2 >> margin * np.eye(S.shape[0]))
    if not solve(cp.Problem(cp.Minimize(level), constraints)):
        return None
    if refit:
        gains = [(A, B, C.value, D.value) for (A, B, _, _), (C, D) in zip(gains, free)]
    values = [root @ p.value @ root.T for p in P]
    return FilterDesign(tuple(gains), float(np.sqrt(max(level.value, 0.0))),
                        {"P": [(p + p.T) / 2 for p in values], "multipliers": [b.values() for b in bounds]})


def _edge(m: FilterMode, gains, free, bounds: Multipliers, P, level, frame):
    """The inequality of one edge in scaled coordinates; with ``free`` outputs their square by a Schur complement."""
    root, back = frame
    k, n_d = len(root), m.E.shape[1]
    move, out = closed_loop(m, gains)
    n_p = move.shape[1] - k - n_d
    scale = np.eye(k + n_d + n_p)
    scale[:k, :k] = back.T
    move = root.T @ move @ scale
    S = cp.bmat([[P[0], np.zeros((k, n_d))], [np.zeros((n_d, k)), level * np.eye(n_d)]])
    if n_p:
        square, cross, inner = bounds.terms()
        s = scale[:k + n_d, :k + n_d]
        S = cp.bmat([[S - s.T @ square @ s, -s.T @ cross], [-cross.T @ s, inner]])
    S = S - move.T @ P[1] @ move
    if free is None:
        out = out @ scale
        return S - out.T @ out
    C, D = free
    n = len(m.A)
    H = [bounds.H[n:]] if n_p else []
    out = cp.hstack([D @ m.C + m.Cz, C, D @ m.F + m.Fz] + [D @ h for h in H]) @ scale
    return cp.bmat([[S, out.T], [out, np.eye(len(m.Cz))]])


def stability_margin(problem: FilterProblem) -> float:
    """How much the plant alone contracts: largest t with P - A' P+ A - uncertainty >= t I, 0 <= P <= I.

    Parameters
    ----------
    problem : FilterProblem

    Returns
    -------
    float
        Not above zero (but for the solver's accuracy): no filter has a level under this switching.
    """
    n = problem.sizes[0]
    nodes, t = problem.switching.mode, cp.Variable()
    P = [cp.Variable((n, n), symmetric=True) for _ in nodes]
    bounds = [Multipliers(m, 0) for m in problem.modes]
    constraints = [c for b in bounds for c in b.constraints] + [p >> 0 for p in P] + [p << np.eye(n) for p in P]
    for a, b in problem.switching.edges:
        m, bound = problem.modes[nodes[a]], bounds[nodes[a]]
        S = P[a] - t * np.eye(n)
        move = m.A
        if m.blocks:
            square, cross, inner = bound.terms()
            S = cp.bmat([[S - square[:n, :n], -cross[:n]], [-cross[:n].T, inner]])
            move = np.hstack([m.A, bound.H[:n]])
        S = S - move.T @ P[b] @ move
        constraints.append((S + S.T) / 2 >> 0)
    return float(t.value) if solve(cp.Problem(cp.Maximize(t), constraints)) else -np.inf


def heard(problem: FilterProblem, gains, steps: int = 1000) -> Array:
    """How much of each fault its own estimate gets, while a mode stays: sums of magnitudes of impulse responses.

    Parameters
    ----------
    problem : FilterProblem
    gains : sequence of (A, B, C, D), one per mode
    steps : int
        Samples that are followed.

    Returns
    -------
    ndarray (N, n_f)
        About 1, or what the weight of the target has, for an estimate that follows the fault; 0 for one that does not.
    """
    out = []
    for m, gain in zip(problem.modes, gains):
        move, read = closed_loop(m, gain)
        k, n_f = len(m.A) + len(gain[0]), len(m.Cz)
        last = slice(k + m.E.shape[1] - n_f, k + m.E.shape[1])
        read = read[:, :k + m.E.shape[1]].copy()
        read[:, :len(m.A)] -= m.Cz
        read[:, k:] -= m.Fz
        state, total = move[:, last], np.abs(np.diag(read[:, last]))
        with np.errstate(all="ignore"):  # of a plant that is not stable, which is said elsewhere
            for _ in range(steps):
                total = total + np.abs(np.diag(read[:, :k] @ state))
                state = move[:, :k] @ state
        out.append(total)
    return np.array(out)


def rounded(gains, real: str) -> list[tuple[Array, ...]]:
    """Gains as the C holds them.

    Parameters
    ----------
    gains : sequence of (A, B, C, D), one per mode
    real : {"float32", "float64"}

    Returns
    -------
    list of (A, B, C, D)
        In float64, each number one of the type.
    """
    return [tuple(np.asarray(M).astype(real).astype(float) for M in gain) for gain in gains]


def balanced(design: FilterDesign, n: int) -> FilterDesign:
    """The same filter in coordinates in which its states are of one size: fit for rounding.

    Parameters
    ----------
    design : FilterDesign
    n : int
        States of plant and weights.

    Returns
    -------
    FilterDesign
    """
    P = np.mean([np.asarray(p)[n:, n:] for p in design.proof["P"]], axis=0)
    R = np.linalg.cholesky((P + P.T) / 2).T  # new state R s
    inverse = np.linalg.inv(R)
    gains = tuple((R @ A @ inverse, R @ B, C @ inverse, D) for A, B, C, D in design.gains)
    both = np.eye(n + len(R))
    both[n:, n:] = inverse
    return FilterDesign(gains, design.gamma,
                        design.proof | {"P": [both.T @ np.asarray(p) @ both for p in design.proof["P"]]})
