r"""Observer in standard form for a descriptor plant with unmeasured weights: the mismatch as an uncertain system.

Plant: E x' = sum_i h_i(x) (A_i x + B_i u + Bd_i d), y = C x + Dd d, admissible, rank [E; C] = n. The observer

    x_hat = z + T2 y,   r = y - C x_hat,   z' = sum_j h_j(x_hat) (T1 A_j x_hat + T1 B_j u - K_j r),

T1 E + T2 C = I, is an ordinary differential equation: what is algebraic in x comes from y by T2. With eb = T1 E x - z,
N_j = T1 A_j + K_j C and Dt = (I - C T2) Dd

    eb' = sum_ij h_i h_j { N_j eb + T1 (A_i - A_j) x + T1 (B_i - B_j) u + [T1 (Bd_i - A_j T2 Dd) + K_j Dt] d },

e = eb - T2 Dd d, r = C eb + Dt d: linear in P1 and P1 K_j, and one inequality per pair makes |z| <= gamma |(u, d)|.
All factors are [T1 T2] + Z F with F the left kernel of [E 0; C Dd]; with P1 Z as a variable the condition stays linear.
T2 of least norm alone throws the algebraic equations away (T1 has zero columns for them).

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem 3.3.1 and Corollary 3.3.1.
Differences from the print:

* the last block of (3.53) is -I (printed -gamma^2 I, with which the level would be its root); P2' B_i for P2 B_i; the
  (1, 4) block of (3.61) is there; P1 > 0.
* the channel of d is exact for every T2, no d' = 0 is supposed.
* Lemma B.2.17 is not used to drop pairs: it needs the same weights on both sides.
* a decay rate and a bound of the gains. Without the rate the modes that T1 makes invisible may be as slow as they
  like; without the bound gamma tends to the norm of the feedthrough, which is what the printed .5832 is (.58310).
* Z is a variable.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, Bounds, DescriptorDesign, Storage, euler, he, minus, negative, solve
from .descriptor_problem import CALIBRATED, DescriptorProblem, factors, visible

Array = np.ndarray
#: Options of ``[observer]``: decay rate (1/s), bound of the gains in the units of the design, what the level is of,
#: whether T1 and T2 are chosen or of least norm, rows of the set behind the thresholds, delay of sure alarms.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "channel": ("state", "residual"), "factors": ("free", "least"),
           "set_rows": (4, 400), "within": (0, 50), "mismatch": ("bounded", "any"), **CALIBRATED}
INVISIBLE = ("rank [E; C] is less than the number of states: no T1, T2 with T1 E + T2 C = I exist, an algebraic state "
             "is not seen by the outputs. Measure it, or use descriptor-direct.")


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return descriptor_problem.inapplicable(plant)


def design(problem: DescriptorProblem, bounds: Bounds, free: bool = True) -> DescriptorDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
    bounds : Bounds
    free : bool
        Z is a variable; else T1 and T2 are those of least norm with T2 Dd = 0, if there are any.

    Returns
    -------
    DescriptorDesign

    Raises
    ------
    DesignError
        rank [E; C] < n, or the solver finds none.
    """
    if not visible(problem):
        raise DesignError(f"descriptor-uncertain: {INVISIBLE}")
    _, n, p, _, _ = problem.sizes
    T1, T2, F = factors(problem)
    if not free or np.any(np.abs(T2 @ problem.Dd) > 1e-9):  # with T2 Dd = 0 nothing else is linear in Z
        F = F[:0]
    level, unit = cp.Variable(), cp.Variable()
    P1, W = cp.Variable((n, n), symmetric=True), cp.Variable((n, len(F))) if len(F) else None
    PT = P1 @ T1 + (W @ F[:, :n] if len(F) else 0)
    Q, plant = [cp.Variable((n, p)) for _ in problem.A], Storage(problem.E, problem.S)
    conditions = [P1 >> unit * np.eye(n), plant.Y >> MARGIN * np.eye(n), unit >= MARGIN, level >= bounds.least**2]
    if len(F):
        conditions.append(cp.sigma_max(W) <= bounds.gain * unit)
    for A, q in zip(problem.A, Q):
        PN = PT @ A + q @ problem.C
        conditions += [cp.sigma_max(q) <= bounds.gain * unit, he(PN) + 2 * bounds.decay * P1 << 0]
        if bounds.period is not None:
            conditions.append(euler(P1, PN, bounds.period))
    conditions += [negative(_pair(problem, i, j, (PT, T2), Q[j], plant.P, level)) for i, j in problem.pairs]
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError(f"descriptor-uncertain: no observer was found. {hints(problem, bounds, T1)}")
    Z = np.linalg.solve(P1.value, W.value) if len(F) else np.zeros((n, 0))
    K = np.array([np.linalg.solve(P1.value, q.value) for q in Q])
    return DescriptorDesign(K, float(np.sqrt(max(level.value, 0.0))), T1 + Z @ F[:, :n], T2 + Z @ F[:, n:])


def _pair(problem: DescriptorProblem, i: int, j: int, T, Q, P2, level) -> list[list]:
    """The inequality of one pair: over (eb, x, u, d, z)."""
    (PT, T2), (_, _, _, m, q) = T, problem.sizes
    A, B, Bd, C, Dd = problem.A, problem.B, problem.Bd, problem.C, problem.Dd
    return [[he(PT @ A[j] + Q @ C), PT @ (A[i] - A[j]), PT @ (B[i] - B[j]),
             PT @ (Bd[i] - A[j] @ T2 @ Dd) + Q @ (Dd - C @ T2 @ Dd), problem.H.T],
            [he(A[i].T @ P2), P2.T @ B[i], P2.T @ Bd[i], None],
            [minus(level, m), None, None],
            [minus(level, q), (problem.J - problem.H @ T2 @ Dd).T],
            [-np.eye(len(problem.H))]]


def hints(problem: DescriptorProblem, bounds: Bounds, T1: Array) -> str:
    """What stands in the way: modes of (T1 A_j, C) that no gain moves and that are slower than the rate.

    Parameters
    ----------
    problem : DescriptorProblem
    bounds : Bounds
    T1 : ndarray (n, n)
    """
    for name, A in zip(problem.names, problem.A):
        for s in np.linalg.eigvals(T1 @ A):
            seen = np.linalg.svd(np.vstack([s * np.eye(len(A)) - T1 @ A, problem.C]), compute_uv=False)[-1]
            if seen < 1e-7 * max(1.0, abs(s)) and s.real > -bounds.decay:
                return (f'At vertex "{name}" no gain moves the mode {s.real:.4g}, the decay asked for is '
                        f"{bounds.decay:.4g} (in the scaled time of the design). Ask for less, or measure more.")
    steps = ", or sample faster" if bounds.period is not None else ""
    return (f"Ask for a slower decay or larger gains{steps}; see residua check on whether the plant is admissible for "
            "every weight.")
