r"""Fault detection observer designed in discrete time: sensitive to slow faults of sensors, not to inputs, disturbance.

Plant: E x+ = sum_i h_i (A_i x + B_i u + Bd_i d), y = C x + Dd d + Df f, admissible, rank [E; C] = n. The observer is
that of ``descriptor_discrete``, with a weight M of its residual. Asked for are, as in ``hminus_hinf``,

    |M r| >= |f|   settled, f constant, u = d = 0,        |M r| <= gamma |(u, d)|   for f = 0, from rest.

The level is that of ``descriptor_discrete`` with |M r|^2 for |z|^2: T2 is given, so that V = M'M is a variable. Settled
is e+ - e = (N_j - I) e + (K_j - T2) Df f = 0 with e = x - x_hat: the inequality of ``hminus_hinf`` for slow faults,
with A_j - E for A_j and K_j - T2 for K_j.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorems 4.3.3 and C.2.1, put together, with the
differences that ``hminus_hinf`` and ``descriptor_discrete`` name; the thesis leaves detection in discrete time open.
"""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from .descriptor_discrete import stepped
from .descriptor_lmi import MARGIN, Bounds, assembled, solve
from .descriptor_problem import DescriptorProblem, factors, visible
from .descriptor_uncertain import INVISIBLE
from .hminus_hinf import DetectionDesign, Faults, sensitivity

Array = np.ndarray


def design(problem: DescriptorProblem, faults: Faults, bounds: Bounds, free: bool = True) -> DetectionDesign:
    """Design for the least ratio that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a discrete plant; its z is not read.
    faults : Faults
        Of sensors.
    bounds : Bounds
        Every sample shrinks the error by exp(-decay); the period is not read.
    free : bool
        T1 differs between vertices by what the algebraic equations leave open.

    Returns
    -------
    DetectionDesign
        Its K are those of z+ = .. - K_j r.

    Raises
    ------
    DesignError
        rank [E; C] < n, a fault that moves the state, or the solver finds none.
    """
    if not visible(problem):
        raise DesignError(f"hminus-hinf: {INVISIBLE}")
    if np.any(faults.Bf):
        raise DesignError("hminus-hinf: a fault moves the state of a discrete plant (found), expected faults of "
                          "sensors. Detect it by its threshold alone, with descriptor-discrete.")
    _, n, p, m, q = problem.sizes
    T1, T2, _ = factors(problem, False)
    level, unit, P1, P2 = cp.Variable(), cp.Variable(), *(cp.Variable((n, n), symmetric=True) for _ in range(2))
    V, Q = cp.Variable((p, p), symmetric=True), [cp.Variable((n, p)) for _ in problem.A]
    S = problem.S / np.linalg.norm(problem.S, axis=0)
    R = cp.Variable((2 * n + m + q, S.shape[1])) if S.size else None
    W = [cp.Variable((n, S.shape[1])) for _ in problem.A] if free and S.size else []
    PT = [P1 @ T1 + (W[j] @ S.T if W else 0) for j in range(len(Q))]
    conditions = [P1 >> unit * np.eye(n), P2 >> MARGIN * np.eye(n), V >> 0, unit >= MARGIN, level >= bounds.least**2]
    conditions += [cp.sigma_max(M) <= bounds.gain * unit for M in (*W, *Q)]
    moving = replace(problem, A=problem.A - problem.E)
    for j, (A, T, k) in enumerate(zip(problem.A, PT, Q)):
        slow = sensitivity(moving, faults, j, j, (T, T2), k - P1 @ T2, None, V, "slow")
        conditions += [assembled([[np.exp(-2 * bounds.decay) * P1, (T @ A + k @ problem.C).T], [P1]]) >> 0,
                       _above(assembled(slow))]
    out = np.hstack([problem.C, np.zeros((p, n + m)), problem.Dd - problem.C @ T2 @ problem.Dd])
    for i, j in problem.pairs:
        now, move, flow = stepped(problem, i, j, (P1, PT[j], T2), Q[j], (P2, R), level)
        conditions.append(_above(assembled([[now - out.T @ V @ out, move, flow], [P1, None], [P2]])))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError("hminus-hinf: no observer was found. Ask for a slower decay or larger gains; see residua "
                          "check on whether the plant is admissible for every weight.")
    sizes, vectors = np.linalg.eigh((V.value + V.value.T) / 2)
    Z = [np.linalg.solve(P1.value, w.value) @ S.T for w in W] or [np.zeros((n, n))] * len(Q)
    return DetectionDesign(np.array([T1 + z for z in Z]), T2, np.array([np.linalg.solve(P1.value, k.value) for k in Q]),
                           np.sqrt(np.maximum(sizes, 0.0))[:, None] * vectors.T, float(np.sqrt(max(level.value, 0.0))))


def _above(M):
    """M is positive definite."""
    return M >> MARGIN * np.eye(M.shape[0])
