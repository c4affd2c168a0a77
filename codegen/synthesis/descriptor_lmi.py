r"""Parts that the inequalities of the three descriptor observers share: the plant's Lyapunov matrix, bounds, assembly.

The state x of the plant stays in every inequality, because the observer's weights are wrong by something that x
multiplies. So every level needs an admissible plant: P2 = Y2 E + S X2 with Y2 > 0, E' S = 0 as in
``algebra.admissibility``.

The infimum of gamma needs gains without end, and says nothing about modes that neither u nor d excites. So all
designs bound the gains and ask for a decay rate.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

Array = np.ndarray
LEAST = 1e-3
#: Every inequality holds with this much to spare.
MARGIN = 1e-9


@dataclass(frozen=True)
class Bounds:
    """What a design keeps to besides the level; all in the units of the problem.

    Parameters
    ----------
    gain : float
        Largest singular value of the injection gains.
    decay : float
        Every error decays at least like exp(-decay t).
    period : float or None
        Explicit Euler steps of this length contract too: for every vertex |1 + period s| < 1 on its eigenvalues s.
    least : float
        No smaller gamma is looked for: where the mismatch can be rejected altogether the infimum is zero, and gains
        near it survive no rounding.
    """

    gain: float
    decay: float
    period: float | None = None
    least: float = LEAST


@dataclass(frozen=True)
class DescriptorDesign:
    """A design in the units of its problem.

    Parameters
    ----------
    K : ndarray (h, n, p)
        Gains K_j of z' = .. - K_j r, or L_j of E x_hat' = .. + L_j r.
    gamma : float
        What the solver claims. Nothing is proved before ``certify.polytope_gain``.
    T1 : ndarray (n, n) or None, T2 : ndarray (n, p) or None
        None for the observer in descriptor form.
    """

    K: Array
    gamma: float
    T1: Array | None = None
    T2: Array | None = None


class Storage:
    """The variables Y > 0 and X of P = Y E + S X.

    Parameters
    ----------
    E : ndarray (n, n), S : ndarray (n, n - r)
        E' S = 0.
    """

    def __init__(self, E: Array, S: Array):
        n, self._size = len(E), np.linalg.norm(S, axis=0)
        self.Y = cp.Variable((n, n), symmetric=True)
        self.X = cp.Variable((S.shape[1], n)) if S.size else None
        self.P = self.Y @ E + (S / self._size @ self.X if S.size else 0)

    def values(self) -> tuple[Array, Array]:
        """Y and X as numbers."""
        Y = self.Y.value
        return (Y + Y.T) / 2, self.X.value / self._size[:, None] if self.X is not None else np.zeros((0, len(Y)))


def he(M):
    """M + M'.

    Parameters
    ----------
    M : cvxpy expression (n, n)
    """
    return M + M.T


def minus(level, size: int):
    """-level I; a matrix without rows where size is 0, which a solver's expression cannot be.

    Parameters
    ----------
    level : cvxpy expression
    size : int
    """
    return -level * np.eye(size) if size else np.zeros((0, 0))


def assembled(rows: list[list]):
    """A symmetric matrix from the blocks on and above its diagonal; None is zero.

    Parameters
    ----------
    rows : list of lists
        Row k from its diagonal block on.
    """
    sizes = [row[0].shape[0] for row in rows]
    full = [[np.zeros((a, b)) for b in sizes] for a in sizes]
    for k, row in enumerate(rows):
        for offset, block in enumerate(row):
            if block is not None:
                full[k][k + offset] = block
                if offset:
                    full[k + offset][k] = block.T
    keep = [k for k, size in enumerate(sizes) if size]
    M = cp.bmat([[full[a][b] for b in keep] for a in keep])
    return (M + M.T) / 2


def negative(rows: list[list], margin: float = MARGIN):
    """The constraint that `assembled` is negative definite.

    Parameters
    ----------
    rows : list of lists
    margin : float
    """
    M = assembled(rows)
    return M << -margin * np.eye(M.shape[0])


def euler(P, PN, period: float, margin: float = MARGIN):
    """The constraint (I + period N)' P (I + period N) <= P, linear in P and P N.

    Parameters
    ----------
    P, PN : cvxpy expression (n, n)
    period, margin : float
    """
    M = assembled([[P, (P + period * PN).T], [P]])
    return M >> margin * np.eye(M.shape[0])


def solve(problem: cp.Problem) -> bool:
    """Run the solver; whether it brought something, believed or not.

    Parameters
    ----------
    problem : cvxpy.Problem
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "may be inaccurate" is for the certificate to decide
            problem.solve(solver=cp.CLARABEL)
    except (cp.error.SolverError, ArithmeticError):
        return False
    return problem.status in ("optimal", "optimal_inaccurate")
