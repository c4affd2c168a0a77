r"""Observer in standard form, designed in discrete time: firmware needs no integration at all.

Plant: E x+ = sum_i h_i(x) (A_i x + B_i u + Bd_i d), y = C x + Dd d, admissible, rank [E; C] = n. The observer

    x_hat = z + T2 y,   r = y - C x_hat,   z+ = sum_j h_j(x_hat) (T1 A_j x_hat + T1 B_j u - K_j r)

has the error of ``descriptor_uncertain`` with the next sample in place of the derivative: x_hat holds the y of its own
sample, so that no difference of the disturbance enters. With V = eb' P1 eb + x' E' P2 E x, the algebraic equations
S' (A_i x + B_i u + Bd_i d) = 0 times a free R added, V+ - V + |z|^2 < gamma^2 |(u, d)|^2 is one linear inequality per
pair of vertices, with Z of T1, T2 as a variable: the plant's own weights, the observer's, no lemma to join them.

``mismatch = "disturbance"``: what the observer's weights make wrong, w = sum_i (h_i(x) - h_i(x_hat)) (A_i x + B_i u +
Bd_i d), is an unknown input through T1 instead. h inequalities without the plant, so that the level also covers
plants that are not admissible; but it is one from (d, w), and nothing bounds w by u.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem C.2.1, for the second form; the first
answers what its chapter 5 leaves open. Differences from the print: the columns of N_i' P and of the disturbance
change places in (C.16); T2 H d(k+1) is no T2 H d(k), a confusion that lets error modes of radius 1 pass; gamma^2 for
gamma; > 0 for >= 0.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, Bounds, DescriptorDesign, assembled, he, minus, solve
from .descriptor_problem import CALIBRATED, DescriptorProblem, factors, visible
from .descriptor_uncertain import INVISIBLE

Array = np.ndarray
#: Options of ``[observer]``: as those of ``descriptor_uncertain``; the decay of a discrete plant is one per sample.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "channel": ("state", "residual"), "factors": ("free", "least"),
           "set_rows": (4, 400), "within": (0, 50), "mismatch": ("bounded", "any"), **CALIBRATED}
MISMATCH = ("plant", "disturbance")


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return descriptor_problem.inapplicable(plant, False)


def design(problem: DescriptorProblem, bounds: Bounds, free: bool = True, mismatch: str = "plant",
           reject: bool = True) -> DescriptorDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a discrete plant.
    bounds : Bounds
        Every sample shrinks the error by exp(-decay); the period is not read.
    free : bool
        Z is a variable; else T1 and T2 are those of least norm with T2 Dd = 0, if there are any.
    mismatch : {"plant", "disturbance"}
    reject : bool
        Ask for T2 Dd = 0.

    Returns
    -------
    DescriptorDesign

    Raises
    ------
    DesignError
        rank [E; C] < n, or the solver finds none.
    """
    if mismatch not in MISMATCH:
        raise DesignError(f"descriptor-discrete: mismatch is {mismatch!r}, expected one of {', '.join(MISMATCH)}.")
    if not visible(problem):
        raise DesignError(f"descriptor-discrete: {INVISIBLE}")
    _, n, p, m, q = problem.sizes
    T1, T2, F = factors(problem, reject)
    if not free or np.any(np.abs(T2 @ problem.Dd) > 1e-9):  # with T2 Dd = 0 nothing else is linear in Z
        F = F[:0]
    level, unit, P1 = cp.Variable(), cp.Variable(), cp.Variable((n, n), symmetric=True)
    W = cp.Variable((n, len(F))) if len(F) else None
    PT = P1 @ T1 + (W @ F[:, :n] if len(F) else 0)
    Q = [cp.Variable((n, p)) for _ in problem.A]
    conditions = [P1 >> unit * np.eye(n), unit >= MARGIN, level >= bounds.least**2]
    if len(F):
        conditions.append(cp.sigma_max(W) <= bounds.gain * unit)
    for A, k in zip(problem.A, Q):
        M = assembled([[np.exp(-2 * bounds.decay) * P1, (PT @ A + k @ problem.C).T], [P1]])
        conditions += [cp.sigma_max(k) <= bounds.gain * unit, M >> 0]
    if mismatch == "plant":
        P2 = cp.Variable((n, n), symmetric=True)
        R = cp.Variable((2 * n + m + q, problem.S.shape[1])) if problem.S.size else None
        conditions.append(P2 >> MARGIN * np.eye(n))
        rows = [_pair(problem, i, j, (P1, PT, T2), Q[j], (P2, R), level) for i, j in problem.pairs]
    else:
        rows = [_vertex(problem, j, (P1, PT, T2), Q[j], level) for j in range(len(Q))]
    for M in map(assembled, rows):
        conditions.append(M >> MARGIN * np.eye(M.shape[0]))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError("descriptor-discrete: no observer was found. Ask for a slower decay or larger gains; see "
                          "residua check on whether the plant is admissible for every weight.")
    Z = np.linalg.solve(P1.value, W.value) if len(F) else np.zeros((n, 0))
    K = np.array([np.linalg.solve(P1.value, k.value) for k in Q])
    return DescriptorDesign(K, float(np.sqrt(max(level.value, 0.0))), T1 + Z @ F[:, :n], T2 + Z @ F[:, n:])


def _channel(problem: DescriptorProblem, i: int, j: int, T, Q):
    """P1 times what d does to eb."""
    (_, PT, T2), Dd = T, problem.Dd
    return PT @ (problem.Bd[i] - problem.A[j] @ T2 @ Dd) + Q @ (Dd - problem.C @ T2 @ Dd)


def stepped(problem: DescriptorProblem, i: int, j: int, T, Q, plant, level) -> tuple:
    """V - V+ + level |(u, d)|^2 of one pair as blocks over (eb, x, u, d): before a step, by Schur complements after it.

    Parameters
    ----------
    problem : DescriptorProblem
    i, j : int
        Vertices of plant and observer.
    T : tuple
        P1, P1 T1 and T2.
    Q : cvxpy expression (n, p)
        P1 K_j.
    plant : tuple
        P2, and R or None.
    level : cvxpy expression

    Returns
    -------
    now : cvxpy expression
    move : cvxpy expression
        (P1 eb+)'.
    flow : cvxpy expression
        (P2 E x+)'.
    """
    (P1, PT, _), (P2, R), (_, n, _, m, q) = T, plant, problem.sizes
    A, B, Bd, E = problem.A, problem.B, problem.Bd, problem.E
    flow = np.hstack([np.zeros((n, n)), A[i], B[i], Bd[i]])
    now = assembled([[P1, None, None, None], [E.T @ P2 @ E, None, None], [-minus(level, m), None], [-minus(level, q)]])
    if R is not None:
        now = now - he(R @ (problem.S.T @ flow))
    move = [PT @ A[j] + Q @ problem.C, PT @ (A[i] - A[j]), PT @ (B[i] - B[j]), _channel(problem, i, j, T, Q)]
    return now, cp.hstack([b for b in move if b.shape[1]]).T, flow.T @ P2


def _pair(problem: DescriptorProblem, i: int, j: int, T, Q, plant, level) -> list[list]:
    """The inequality of one pair: over (eb, x, u, d) and, by Schur complements, (eb+, x+, z)."""
    (_, n, _, m, _), T2 = problem.sizes, T[2]
    out = np.hstack([problem.H, np.zeros((len(problem.H), n + m)), problem.J - problem.H @ T2 @ problem.Dd])
    return [[*stepped(problem, i, j, T, Q, plant, level), out.T], [T[0], None, None], [plant[0], None],
            [np.eye(len(out))]]


def _vertex(problem: DescriptorProblem, j: int, T, Q, level) -> list[list]:
    """The inequality of one vertex, the mismatch as an unknown input: over (eb, d, w), (eb+, z)."""
    (P1, PT, T2), (_, n, _, _, q) = T, problem.sizes
    N, out = PT @ problem.A[j] + Q @ problem.C, (problem.J - problem.H @ T2 @ problem.Dd).T
    return [[P1, None, None, N.T, problem.H.T],
            [-minus(level, q), None, _channel(problem, j, j, T, Q).T, out],
            [-minus(level, n), PT.T, None], [P1, None], [np.eye(len(problem.H))]]
