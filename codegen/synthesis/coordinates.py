r"""Option ``coordinates = "change"`` of "component-interval": a change of coordinates that makes the observer positive.

With z = R x, S = R^-1 and M = R (A - L C) S >= 0 elementwise::

    z_hi+ = M z_hi + R B u + R L y + |R L| v_max + |R| (what dA and dB can do over the box of x)
    x_hi  = pos(S) z_hi - neg(S) z_lo,      x_lo = pos(S) z_lo - neg(S) z_hi

R and L come from the Sylvester equation ``R A - M R = F C``, ``L = R^-1 F``: any M without an eigenvalue of A and any F
that leave R regular are a design, so M >= 0 and F are searched (Nelder and Mead, fixed starts) for the narrowest x.

Source: Lamouchi (2016), section 4, (28)-(36). Differences from the print:

* The print assumes R and L; its example violates M >= 0 (entry -0.5), and no R exists for the L that it prints.
* In (30), (33) the parts of S stand on the wrong side; the bounds of R dA S are not needed here: the uncertainty is
  bounded over the box of x, which is at hand, and then mapped by R, which is never wider.
* (39) is replaced by the recursion of the widths, as without coordinates.

Neither this nor going without is always narrower: for the print's plant going without is, for the sampled plant of
Chevet (2021), whose output has no noise, this is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import linprog, minimize

from ..errors import DesignError
from .problem import Candidate, Problem, slopes, tidy

Array = np.ndarray
STARTS = 4
ROUNDS = 300  # of Nelder and Mead per unknown
LARGEST = 1e5  # condition number of R, its rows scaled
SLACK = 1e-9  # a negative entry of this share of its terms is rounding


def candidates(problem: Problem, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """The narrowest design found.

    Parameters
    ----------
    problem : Problem
    options : dict
        Not read.
    progress : callable

    Raises
    ------
    DesignError
        Several modes, or nothing was found.
    """
    if len(problem.names) > 1:
        raise DesignError('coordinates = "change" searches one matrix R for one mode, found '
                          f'{len(problem.names)} modes. Give R and L as gains, or use coordinates = "none".')
    progress("change of coordinates: search over M >= 0 and F of R A - M R = F C")
    found = search(problem)
    if found is None:
        raise DesignError("no change of coordinates was found that makes R (A - L C) R^-1 nonnegative and its bounds "
                          'finite. Use coordinates = "none".')
    R, L = found
    yield Candidate("change of coordinates, width", L[None], np.zeros_like(L)[None], {"kind": "box"},
                    slopes(problem, {}), R)


def search(problem: Problem) -> tuple[Array, Array] | None:
    """R and L of the smallest steady width of x, summed in units of the ranges; None where none is finite."""
    _, n, p = problem.sizes
    draw, best = np.random.default_rng(0), (np.inf, None)

    def parts(g: Array) -> tuple[Array, Array]:
        return np.abs(g[:n * n]).reshape(n, n), g[n * n:].reshape(n, p)

    def cost(g: Array) -> float:
        R = sylvester(problem.A[0], problem.C[0], *parts(g))
        if R is None:
            return 1e12
        width = x_width(problem, R, *parts(g))
        return 1e9 * (1 + np.max(np.abs(parts(g)[0]))) if width is None else float(np.sum(width / problem.x_max))

    for _ in range(STARTS):
        g = np.concatenate([0.5 * draw.random(n * n) / n, draw.normal(size=n * p)])
        for _ in range(2):  # a simplex that has collapsed is spread again
            done = minimize(cost, g, method="Nelder-Mead", options={"maxfev": ROUNDS * len(g), "xatol": 1e-8,
                                                                    "fatol": 1e-10, "adaptive": True})
            g = done.x
        best = min(best, (done.fun, tuple(g)))
    return None if best[0] >= 1e9 else tidied(problem, *parts(np.array(best[1])))


def tidied(problem: Problem, M: Array, F: Array) -> tuple[Array, Array]:
    """R with rows of size 1, and L; what is noise of the search in M, F and R becomes zero where that costs nothing."""
    A, C = problem.A[0], problem.C[0]
    R = sylvester(A, C, M, F)
    size, width = np.max(np.abs(R), axis=1, keepdims=True), x_width(problem, R, M, F)
    M, F = M * size.T / size, F / size
    clean = np.where(1e-4 * np.max(M) < M, M, 0.0), tidy(F)
    found = sylvester(A, C, *clean)
    again = None if found is None else x_width(problem, found, *clean)
    if again is not None and np.all(again <= (1 + 1e-4) * width):
        M, F = clean
    R = sylvester(A, C, M, F)
    L = np.linalg.solve(R, F)
    R = R / np.max(np.abs(R), axis=1, keepdims=True)
    rounder = np.where(np.abs(R) < 1e-6, 0.0, R)
    return (rounder if negative(A, C, rounder, L) is None else R), L


def sylvester(A: Array, C: Array, M: Array, F: Array) -> Array | None:
    """Solve ``R A - M R = F C`` for R (n_x, n_x); None where it has no regular solution."""
    n = len(A)
    system = np.kron(np.eye(n), A.T) - np.kron(M, np.eye(n))  # of the rows of R, one after the other
    try:
        R = np.linalg.solve(system, (F @ C).ravel()).reshape(n, n)
    except np.linalg.LinAlgError:
        return None
    return R if np.all(np.any(R != 0, axis=1)) else None


def x_width(problem: Problem, R: Array, M: Array, F: Array) -> Array | None:
    """Steady width of every state: |S| (I - M)^-1 (what a sample adds to the width of z).

    None where M >= 0 is not stable, or R all but singular.
    """
    try:
        S, settled = np.linalg.inv(R), np.linalg.inv(np.eye(len(M)) - M)
    except np.linalg.LinAlgError:
        return None
    # The inverse of I - M is nonnegative exactly where M >= 0 is stable; rows of R may have any size.
    if np.min(settled) < 0 or np.max(np.abs(S) @ np.max(np.abs(R), axis=1)) > LARGEST:
        return None
    add = 2 * np.abs(F @ problem.Dv[0]) @ problem.v_half + 2 * np.abs(R @ problem.Bw[0]) @ problem.w_half[0]
    count = len(problem.A_unc[0])
    add = add + 2 * np.abs(R) @ (problem.A_rad[0] @ problem.x_max + problem.u_push[0].sum(axis=0))
    for U in problem.A_unc[0][:count]:
        add = add + 2 * np.abs(R @ U) @ problem.x_max
    return np.abs(S) @ (settled @ add)


def negative(A: Array, C: Array, R: Array, L: Array) -> tuple[float, int, int] | None:
    """Smallest entry of R (A - L C) R^-1 with its row and column, where it is negative; None where none is."""
    S = np.linalg.inv(R)
    M = R @ (A - L @ C) @ S
    size = np.abs(R) @ (np.abs(A) + np.abs(L) @ np.abs(C)) @ np.abs(S)
    i, j = np.unravel_index(np.argmin(M / size), M.shape)
    return (float(M[i, j]), int(i), int(j)) if M[i, j] < -SLACK * size[i, j] else None


def repaired(A: Array, C: Array, R: Array) -> Array | None:
    """The L, to three digits, with which R (A - L C) R^-1 is nonnegative and about the smallest; None without any."""
    S = np.linalg.inv(R)
    target, seen = R @ A @ S, C @ S
    for room in (1e-3, 1e-2):  # for the digits that are not printed
        rows = [linprog(-seen.sum(axis=1), A_ub=seen.T, b_ub=row - room * np.max(np.abs(target)),
                        bounds=[(None, None)] * len(C)) for row in target]
        if all(r.status == 0 for r in rows):
            L = np.linalg.solve(R, np.array([row.x for row in rows]))
            short = np.array([float(f"{x:.3g}") for x in L.ravel()]).reshape(L.shape)
            if negative(A, C, R, short) is None:
                return short
    return None


def check_given(problem: Problem, R: Array, L: Array) -> None:
    """Refuse gains of the plant file that are no positive observer in the coordinates z = R x.

    Parameters
    ----------
    problem : Problem
    R : ndarray (n_x, n_x)
    L : ndarray (N, n_x, n_y)

    Raises
    ------
    DesignError
        R has no inverse, or R (A - L C) R^-1 has a negative entry; offers what mends it.
    """
    if np.linalg.cond(R) > LARGEST:
        raise DesignError(f"observer.gains.R has no inverse worth the name (condition number {np.linalg.cond(R):.3g}, "
                          f'expected at most {LARGEST:g}). Take another one, or use coordinates = "none".')
    for name, A, C, gain in zip(problem.names, problem.A, problem.C, L):
        found = negative(A, C, R, gain)
        if found is None:
            continue
        value, i, j = found
        better = repaired(A, C, R)
        mend = "" if better is None else f", or keep R and take L = {better.tolist()}"
        raise DesignError(f'R (A - L C) R^-1 of the gains given has the negative entry {value:.3g} at row {i + 1}, '
                          f'column {j + 1} in mode "{name}", expected >= 0: in these coordinates the bounds would '
                          f'cross what they bound. Use coordinates = "none", which takes this L as it is{mend}.')
