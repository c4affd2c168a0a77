r"""Admissible for every weight in discrete time: one pair of matrices for all vertices of E x+ = sum_i h_i(k) A_i x.

Find Y > 0 and R with

    A_i' Y A_i - E' Y E + R S' A_i + A_i' S R' < 0, strictly, for every vertex i,        E' S = 0.

The terms with R vanish on what the algebraic equations S' A x = 0 admit. Then (E, sum_i h_i A_i) is regular, causal
and stable for every constant weight, and x tends to zero however fast the weights move: V = x' E' Y E x. The condition
is convex in A as Y > 0, so that the vertices decide for the whole; it is sufficient.

What a solver returns is rounded to float64 and then checked in rational arithmetic; that check is the result.

References: S. Xu, J. Lam, Robust Control and Filtering of Singular Systems, 2006 (for one vertex).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from .admissibility import LARGEST, exact, is_positive_definite, left_kernel, product, transposed
from .balance import Balance, balanced

Array = np.ndarray


@dataclass(frozen=True)
class DiscreteLyapunovMatrix:
    """Y and R for all vertices in discrete time, checked exactly on these float64 numbers.

    Parameters
    ----------
    Y : ndarray (n, n)
        Symmetric, positive definite.
    R : ndarray (n, n - r)
    """

    Y: Array
    R: Array


def discrete_lyapunov_matrix(E: Array, vertices: Sequence[Array]) -> DiscreteLyapunovMatrix | None:
    """Return a common Y and R for all vertices in discrete time, or None where none was found.

    Parameters
    ----------
    E : ndarray (n, n)
    vertices : sequence of ndarray (n, n)
        The A_i.
    """
    import cvxpy as cp  # a second to import

    S = np.array([[float(x) for x in row] for row in left_kernel(E)]).reshape(len(E), -1)
    # The time of E x+ is the sample: rows and columns are scaled, E and A alike.
    scale, n = balanced(E, np.max(np.abs(np.array(vertices)), axis=0)), len(E)
    scale = Balance(scale.rows, scale.columns, 1.0)
    Eb = scale.apply(E, vertices[0])[0]
    Sb, size = S / scale.rows[:, None], np.linalg.norm(S / scale.rows[:, None], axis=0)
    Y, R, bound = cp.Variable((n, n), symmetric=True), cp.Variable(S.shape) if S.size else None, cp.Variable()
    conditions = [Y >> np.eye(n), Y << bound * np.eye(n), bound <= LARGEST]
    for A in (scale.apply(E, A)[1] for A in vertices):
        M = A.T @ Y @ A - Eb.T @ Y @ Eb
        if S.size:
            zero = R @ ((Sb / size).T @ A)
            M = M + zero + zero.T
        conditions.append((M + M.T) / 2 << -1e-6 * np.eye(n))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            cp.Problem(cp.Minimize(bound), conditions).solve(solver=cp.CLARABEL)
        except cp.SolverError:
            return None
    if Y.value is None or (S.size and R.value is None):
        return None
    found_y = scale.rows[:, None] * (Y.value + Y.value.T) / 2 * scale.rows
    found_r = R.value / scale.columns[:, None] / size if S.size else np.zeros((n, 0))
    found = DiscreteLyapunovMatrix(found_y, found_r)
    return found if is_discrete_lyapunov_matrix(E, vertices, found_y, found_r) else None


def is_discrete_lyapunov_matrix(E: Array, vertices: Sequence[Array], Y: Array, R: Array) -> bool:
    """Whether Y and R fulfil the strict conditions in discrete time, in rational arithmetic on these float64 numbers.

    Parameters
    ----------
    E : ndarray (n, n)
    vertices : sequence of ndarray (n, n)
    Y : ndarray (n, n), R : ndarray (n, n - r)
        S is `left_kernel` of E.
    """
    S, n, exact_e, exact_y = left_kernel(E), len(E), exact(E), exact(Y)
    if np.shape(R) != (n, len(S[0]) if S else 0) or not is_positive_definite(exact_y):
        return False
    before = product(transposed(exact_e), product(exact_y, exact_e))
    for A in map(exact, vertices):
        after = product(transposed(A), product(exact_y, A))
        zero = product(exact(R), product(transposed(S), A)) if S else [[Fraction(0)] * n] * n
        M = [[before[i][j] - after[i][j] - zero[i][j] - zero[j][i] for j in range(n)] for i in range(n)]
        if not is_positive_definite(M):
            return False
    return True
