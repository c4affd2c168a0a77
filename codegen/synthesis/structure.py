"""Why no interval observer exists: checks that need no Lyapunov function, and words for the user.

Two things can stand in the way. A row of T A - L C cannot be made nonnegative by any L (and N): then one
entry obstructs, and it can be named. Or it can, but something does not decay: a direction z >= 0 that the
outputs do not see (C z = 0, with the TNL structure also C A z = 0) passes through T A - L C as A z for every
gain, so A z >= z forbids stability.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from .problem import Problem

Array = np.ndarray


def best_row(A: Array, C: Array, i: int, tnl: bool) -> tuple[float, int]:
    """Largest achievable smallest entry of row i of T A - L C (cut at 0), and the entry where it is attained.

    Parameters
    ----------
    A : ndarray (n_x, n_x), C : ndarray (n_y, n_x)
    i : int
        Row.
    tnl : bool

    Returns
    -------
    value : float
        >= 0: the row can be made nonnegative.
    column : int
    """
    free = np.vstack([C] + ([C @ A] if tnl else []))  # row_i(M) = A_i - g @ free
    n, k = A.shape[0], free.shape[0]
    cost = np.zeros(k + 1)
    cost[-1] = -1.0  # maximise t subject to A_i - g @ free >= t, t <= 0
    constraint = np.hstack([free.T, np.ones((n, 1))])
    solved = linprog(cost, A_ub=constraint, b_ub=A[i], bounds=[(-1e7, 1e7)] * k + [(None, 0.0)])
    if solved.status != 0:
        return 0.0, i
    row = A[i] - solved.x[:k] @ free
    return float(solved.x[-1]), int(np.argmin(row))


def obstruction(problem: Problem) -> str | None:
    """Say which mode and entry forbids T A - L C >= 0, or which direction forbids decay; None if neither does.

    Gains that are scheduled may be others at every corner of the parameters: one corner without any is enough. Where
    entries may have either sign (``split``) nothing of this stands in the way.
    """
    if problem.split:
        return None
    gains, matrix = ("L, N", "T A - L C") if problem.tnl else ("L", "A - L C")
    wider = "tnl-interval" if problem.x_max is None else "tnl-interval-lpv"
    other = "" if problem.tnl else f'Try method "{wider}", or '
    for q, corner, A in _corners(problem):
        for i in range(len(A)):
            value, j = best_row(A, problem.C[q], i, problem.tnl)
            if value < -1e-9 * max(1.0, np.abs(A).max()):
                return (f'no {gains} give {matrix} >= 0 in mode "{problem.names[q]}"{at_words(corner)}: best entry '
                        f"({problem.states[i]}, {problem.states[j]}) is {value:.3g}. {other}"
                        f"{'measure' if other else 'Measure'} {problem.states[j]}.")
    for q, corner, A in _corners(problem):
        z = unseen_growth(A, problem.C[q], problem.tnl)
        if z is not None:
            parts = " + ".join(f"{v:.3g} {s}" for v, s in zip(z, problem.states) if v > 1e-9)
            return (f'the direction z = {parts} is invisible to the outputs of mode "{problem.names[q]}"'
                    f"{at_words(corner)} (C z = 0{', C A z = 0' if problem.tnl else ''}) and does not decay "
                    "(A z >= z), whatever the gains. Measure one of these states.")
    return None


def _corners(problem: Problem):
    """Yield (mode, corner of theta, A there) over all modes."""
    for q in range(len(problem.names)):
        for corner, A in problem.at(q):
            yield q, corner[:problem.parameters], A


def at_words(corner: Array) -> str:
    """Name a corner of theta; empty where nothing is measured."""
    return f" at theta = ({', '.join(f'{v:g}' for v in corner)})" if len(corner) else ""


def unseen_growth(A: Array, C: Array, tnl: bool) -> Array | None:
    """A direction z >= 0, sum 1, with C z = 0 (and C A z = 0) and A z >= z; None if there is none."""
    n = len(A)
    hidden = np.vstack([C] + ([C @ A] if tnl else []))
    equal = np.vstack([hidden, np.ones((1, n))])
    rhs = np.concatenate([np.zeros(len(hidden)), [1.0]])
    solved = linprog(np.zeros(n), A_ub=np.eye(n) - A, b_ub=np.zeros(n), A_eq=equal, b_eq=rhs, bounds=[(0, None)] * n)
    return solved.x if solved.status == 0 else None


def unseen_decay(A: Array, C: Array, tnl: bool) -> tuple[float, Array | None]:
    """Slowest decay of what the outputs do not see: the largest s with A z >= s z, z >= 0, C z = 0 (and C A z = 0).

    For such a z every gain has (T A - L C) z = A z, so no nonnegative T A - L C has a spectral radius below s. With
    z = 1 (C 1 = 0) s is the smallest row sum of A.

    Returns
    -------
    s : float
        0 where there is no such direction.
    z : ndarray (n_x,) or None
        Sum 1.
    """
    n = len(A)
    hidden = np.vstack([C] + ([C @ A] if tnl else []) + [np.ones((1, n))])
    rhs = np.concatenate([np.zeros(len(hidden) - 1), [1.0]])
    lo, hi, best = 0.0, float(np.max(np.abs(A).sum(axis=1))) + 1e-9, None
    for _ in range(50):
        s = (lo + hi) / 2
        solved = linprog(np.zeros(n), A_ub=s * np.eye(n) - A, b_ub=np.zeros(n), A_eq=hidden, b_eq=rhs,
                         bounds=[(0, None)] * n)
        if solved.status == 0:
            lo, best = s, solved.x
        else:
            hi = s
    return (lo, best) if best is not None else (0.0, None)


def slow_reason(problem: Problem, lam: float) -> str | None:
    """Say why no design has V+ <= (1 - lam) V, if a direction that the outputs do not see forbids it.

    V = e' P e with T A - L C >= 0 shrinks by its spectral radius squared at best: sqrt(1 - lam) must not be below
    ``unseen_decay`` in any mode, at any corner of the parameters.
    """
    worst = (0.0, None, 0, np.zeros(0))
    for q in range(len(problem.names)):
        for corner, A in problem.at(q):
            s, z = unseen_decay(A, problem.C[q], problem.tnl)
            if z is not None and s > worst[0]:
                worst = (s, z, q, corner[:problem.parameters])
    s, z, q, corner = worst
    if s <= np.sqrt(1.0 - lam):
        return None
    parts = " + ".join(f"{v:.3g} {x}" for v, x in zip(z, problem.states) if v > 1e-9)
    return (f"lambda = {lam:g} asks for decay by {np.sqrt(1.0 - lam):.4g} per sample, but in mode "
            f'"{problem.names[q]}"{at_words(corner)} the direction z = {parts} is invisible to the outputs (C z = 0, '
            f"so (A - L C) z = A z for every L) and A z >= {s:.4g} z. Ask for lambda below {1.0 - s * s:.4g}, or "
            "measure another state.")
