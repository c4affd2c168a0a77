"""A filter of lower order: weights raise the order, the firmware pays for each state at every sample.

Balanced truncation in coordinates common to all modes (the Gramians are averaged over the modes), then C and D anew
by the convex inequality with A and B given. What the reduced filter is worth is its own level, certified like any
other.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from .hinf_analysis import level_of
from .hinf_filter import FilterDesign
from .hinf_problem import FilterProblem

Array = np.ndarray


def truncated(design: FilterDesign, n: int, order: int) -> FilterDesign | None:
    """The filter's ``order`` most important states, balanced over its modes.

    Parameters
    ----------
    design : FilterDesign
    n : int
        States of plant and weights.
    order : int

    Returns
    -------
    FilterDesign or None
        Its level is still that of the whole filter. None where a mode of the filter is not stable by itself.
    """
    if any(np.abs(np.linalg.eigvals(A)).max() >= 1 for A, _, _, _ in design.gains):
        return None
    seen = sum(solve_discrete_lyapunov(A.T, C.T @ C) for A, _, C, _ in design.gains)
    reached = sum(solve_discrete_lyapunov(A, B @ B.T) for A, B, _, _ in design.gains)
    root = np.linalg.cholesky((reached + reached.T) / 2 + 1e-14 * np.trace(reached) * np.eye(len(reached)))
    U, sigma, _ = np.linalg.svd(root.T @ seen @ root)
    size = sigma[:order] ** 0.25
    back = root @ U[:, :order] / size  # s = back r
    there = (np.linalg.solve(root, np.eye(len(root))).T @ U[:, :order] * size).T  # r = there s
    gains = tuple((there @ A @ back, there @ B, C @ back, D) for A, B, C, D in design.gains)
    both = np.zeros((n + len(root), n + order))
    both[:n, :n], both[n:, n:] = np.eye(n), back
    P = [both.T @ np.asarray(p) @ both for p in design.proof["P"]]
    return FilterDesign(gains, design.gamma, design.proof | {"P": P})


def reduce_order(problem: FilterProblem, design: FilterDesign, loss: float = 0.02) -> FilterDesign:
    """The filter of lowest order that costs at most the given share of the level.

    Parameters
    ----------
    problem : FilterProblem
        With its weights.
    design : FilterDesign
    loss : float
        Allowed rise of gamma, relative.

    Returns
    -------
    FilterDesign
        The given one where no state can be spared.
    """
    n, best = problem.sizes[0], design
    for order in range(len(design.gains[0][0]) - 1, 0, -1):
        start = truncated(design, n, order)
        found = None
        for refit in (True, False):  # the solver does not bring every refit to an end
            if start is not None and found is None:
                found = level_of(problem, start.gains, start.proof, refit=refit)
        if found is None or not found.gamma <= design.gamma * (1 + loss):
            break
        best = found
    return best
