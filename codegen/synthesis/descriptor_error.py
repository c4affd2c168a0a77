r"""Observer in standard form, the wrong weights as a norm-bounded error: h inequalities in place of h^2.

Plant and observer are those of ``descriptor_uncertain``, with T1 and T2 fixed. The error is written with the plant's
own weights, sum_i h_i N_i e, and what the observer's weights change of it is bounded in norm.

As printed the condition has no solution for h >= 2 vertices. Let X_j = Q N_j. By Schur complements its first block is

    S_i = X_i + X_i' + (1/eps) sum_j X_j X_j' + h eps I,

and X_i + X_i' + X_i X_i'/eps + eps I = (X_i + eps I)(X_i + eps I)'/eps >= 0, so that S_i >= (h - 1) eps I > 0. Nothing
is left to solve: ``form = "printed"`` is refused with this reason.

The centred form holds. The differences of the weights add up to zero, so that what is common to all vertices may be
taken out: in inequality i the blocks are those of Q T1 (A_j - A_i), Q (N_j - N_i), Q T1 (B_j - B_i) and those of d.
They are affine in i, and each has a multiplier of its own. The level is always at least that of
``descriptor_uncertain``; the certificate, which works in pairs, finds a smaller one for the same gains.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorems 3.4.1 and 3.4.2 (whose inequality the
print does not show in full). Differences from the print: centred; Q T1 A_i + Xi_i C in the first block; the exact
channel of d; multipliers for A, N, B and d apart; decay rate and bound of the gains.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, Bounds, DescriptorDesign, Storage, euler, he, minus, negative, solve
from .descriptor_problem import CALIBRATED, DescriptorProblem, factors, visible
from .descriptor_uncertain import INVISIBLE, hints

Array = np.ndarray
#: Options of ``[observer]``: as those of ``descriptor_uncertain``, and the form of the condition.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "channel": ("state", "residual"), "form": ("centred", "printed"),
           "set_rows": (4, 400), "within": (0, 50), "mismatch": ("bounded", "any"), **CALIBRATED}
FORMS = ("centred", "printed")


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return descriptor_problem.inapplicable(plant)


def design(problem: DescriptorProblem, bounds: Bounds, form: str = "centred") -> DescriptorDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
    bounds : Bounds
    form : {"centred", "printed"}

    Returns
    -------
    DescriptorDesign

    Raises
    ------
    DesignError
        The printed form for two vertices or more, rank [E; C] < n, or the solver finds none.
    """
    if form not in FORMS:
        raise DesignError(f"descriptor-error: form is {form!r}, expected one of {', '.join(FORMS)}.")
    if form == "printed" and len(problem.A) > 1:
        raise DesignError(
            f"descriptor-error: the printed condition has no solution for {len(problem.A)} vertices (found), only for "
            "one: its block of the error is at least (h - 1) eps I, whatever the gains, where it must be negative. "
            'Use form = "centred".')
    if not visible(problem):
        raise DesignError(f"descriptor-error: {INVISIBLE}")
    h, n, p, _, _ = problem.sizes
    T1, T2, _ = factors(problem)
    level, unit, eps = cp.Variable(), cp.Variable(), cp.Variable(4, nonneg=True)
    Q, plant = cp.Variable((n, n), symmetric=True), Storage(problem.E, problem.S)
    Xi = [cp.Variable((n, p)) for _ in range(h)]
    conditions = [Q >> unit * np.eye(n), plant.Y >> MARGIN * np.eye(n), unit >= MARGIN, level >= bounds.least**2]
    for A, xi in zip(problem.A, Xi):
        QN = Q @ T1 @ A + xi @ problem.C
        conditions += [cp.sigma_max(xi) <= bounds.gain * unit, he(QN) + 2 * bounds.decay * Q << 0]
        if bounds.period is not None:
            conditions.append(euler(Q, QN, bounds.period))
    conditions += [negative(_vertex(problem, i, (T1, T2), Q, Xi, plant.P, eps, level)) for i in range(h)]
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError(f"descriptor-error: no observer was found. {hints(problem, bounds, T1)}")
    K = np.array([np.linalg.solve(Q.value, xi.value) for xi in Xi])
    return DescriptorDesign(K, float(np.sqrt(max(level.value, 0.0))), T1, T2)


def _vertex(problem: DescriptorProblem, i: int, T, Q, Xi, P2, eps, level) -> list[list]:
    """The inequality of one vertex: over (e, x, u, d), what goes into the norm bounds, what comes out of them, z."""
    (T1, T2), (h, n, _, m, q) = T, problem.sizes
    A, B, Bd, C, Dd = problem.A, problem.B, problem.Bd, problem.C, problem.Dd
    Dt = Dd - C @ T2 @ Dd
    steps = [Q @ T1 @ (a - A[i]) for a in A]
    noises = [-s @ T2 @ Dd + (xi - Xi[i]) @ Dt for s, xi in zip(steps, Xi)]
    into = [cp.hstack(steps), cp.hstack([s + (xi - Xi[i]) @ C for s, xi in zip(steps, Xi)]),
            cp.hstack([Q @ T1 @ (b - B[i]) for b in B]) if m else None, cp.hstack(noises) if q else None]
    sides = [(n, eps[0]), (n, eps[1]), (m, eps[2]), (q, eps[3])]  # A by x, N by e, B by u, the rest by d
    out = [e * np.hstack([np.eye(k)] * h) if k else None for k, e in sides]
    top = [he(Q @ T1 @ A[i] + Xi[i] @ C), None, None, Q @ T1 @ (Bd[i] - A[i] @ T2 @ Dd) + Xi[i] @ Dt, *into,
           None, out[1], None, None, problem.H.T]
    rows = [top,
            [he(A[i].T @ P2), P2.T @ B[i], P2.T @ Bd[i], *[None] * 4, out[0], None, None, None, None],
            [minus(level, m), None, *[None] * 4, None, None, out[2], None, None],
            [minus(level, q), *[None] * 4, None, None, None, out[3], (problem.J - problem.H @ T2 @ Dd).T]]
    rows += [[minus(e, h * k)] for k, e in sides + sides]
    return [*rows, [-np.eye(len(problem.H))]]
