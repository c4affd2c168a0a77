r"""Admissible for every weight: one Lyapunov matrix for all vertices of E x' = sum_i h_i(t) A_i x.

Find P with

    E' P = P' E >= 0    and    A_i' P + P' A_i < 0, strictly, for every vertex i.

Then (E, sum_i h_i A_i) is regular, impulse-free and stable for every constant weight, and x tends to zero however
fast the weights move: V = x' E' P x. The equality is built in by P = Y E + S X with Y > 0, E' S = 0 and X free. P is
not symmetric. The condition is sufficient: where it fails the system may still be admissible.

What a solver returns is rounded to float64 and then checked in rational arithmetic; that check is the result.

References: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Lemma 2.4.1 and Lemma B.2.16. The thesis
prints A_i' P + P' A_i <= 0, which P = 0 fulfils for any system; strict here.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from .balance import balanced

Array = np.ndarray
Rows = list[list[Fraction]]
#: Largest Y that is looked for, with Y >= I and A_i' P + P' A_i <= -I of the balanced pencil.
LARGEST = 1e7


@dataclass(frozen=True)
class LyapunovMatrix:
    """P = Y E + S X for all vertices, checked exactly on these float64 numbers.

    Parameters
    ----------
    Y : ndarray (n, n)
        Symmetric, positive definite.
    X : ndarray (n - r, n)
    S : ndarray (n, n - r)
        E' S = 0; its rational entries rounded, as for `P`.
    P : ndarray (n, n)
    """

    Y: Array
    X: Array
    S: Array
    P: Array


def lyapunov_matrix(E: Array, vertices: Sequence[Array]) -> LyapunovMatrix | None:
    """Return a common P for all vertices in continuous time, or None where none was found.

    Parameters
    ----------
    E : ndarray (n, n)
    vertices : sequence of ndarray (n, n)
        The A_i.
    """
    import cvxpy as cp  # a second to import

    S = np.array([[float(x) for x in row] for row in left_kernel(E)]).reshape(len(E), -1)
    scale = balanced(E, np.max(np.abs(np.array(vertices)), axis=0))
    n, free, Eb = len(E), S.shape[1], scale.apply(E, vertices[0])[0]
    Sb = S / scale.rows[:, None]
    Sb = Sb / (np.linalg.norm(Sb, axis=0) if free else 1.0)
    Y, X, bound = cp.Variable((n, n), symmetric=True), cp.Variable((free, n)) if free else None, cp.Variable()
    P = Y @ Eb + (Sb @ X if free else 0)
    conditions = [Y >> np.eye(n), Y << bound * np.eye(n), bound <= LARGEST]
    conditions += [A.T @ P + P.T @ A << -np.eye(n) for A in (scale.apply(E, A)[1] for A in vertices)]
    if free:
        conditions.append(cp.sigma_max(X) <= bound)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exact check judges what comes, however inaccurate it may be
        try:
            cp.Problem(cp.Minimize(bound), conditions).solve(solver=cp.CLARABEL)
        except cp.SolverError:
            return None
    if Y.value is None or (free and X.value is None):
        return None
    # Back to the given pencil: P is D P C^-1 of the balanced one, with Y and X to match.
    found_y = scale.time * scale.rows[:, None] * (Y.value + Y.value.T) / 2 * scale.rows
    found_x = np.zeros((0, n))
    if free:
        found_x = X.value / scale.columns / np.linalg.norm(S / scale.rows[:, None], axis=0)[:, None]
    if not is_lyapunov_matrix(E, vertices, found_y, found_x):
        return None
    return LyapunovMatrix(found_y, found_x, S, found_y @ E + S @ found_x)


def is_lyapunov_matrix(E: Array, vertices: Sequence[Array], Y: Array, X: Array) -> bool:
    """Whether P = Y E + S X fulfils the strict conditions, in rational arithmetic on these float64 numbers.

    Parameters
    ----------
    E : ndarray (n, n)
    vertices : sequence of ndarray (n, n)
    Y : ndarray (n, n), X : ndarray (n - r, n)
        S is `left_kernel` of E.
    """
    S = left_kernel(E)
    exact_y = exact(Y)
    if len(X) != (len(S[0]) if S else 0):
        return False
    P = product(exact_y, exact(E))
    if len(X):
        P = [[a + b for a, b in zip(*rows)] for rows in zip(P, product(S, exact(X)))]
    if not is_positive_definite(exact_y):
        return False
    for A in vertices:
        M = product(transposed(exact(A)), P)
        if not is_positive_definite([[-M[i][j] - M[j][i] for j in range(len(M))] for i in range(len(M))]):
            return False
    return True


def left_kernel(E: Array) -> Rows:
    """Return S with E' S = 0 and full column rank, exactly, as rows of fractions.

    Parameters
    ----------
    E : ndarray (n, n)
    """
    rows, n, pivots = list(map(list, zip(*exact(E)))), len(E), []
    for column in range(n):
        k = len(pivots)
        best = next((i for i in range(k, n) if rows[i][column]), None)
        if best is None:
            continue
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [x / rows[k][column] for x in rows[k]]
        for i in range(n):
            if i != k and rows[i][column]:
                rows[i] = [a - rows[i][column] * b for a, b in zip(rows[i], rows[k])]
        pivots.append(column)
    free = [j for j in range(n) if j not in pivots]
    S = [[Fraction(int(i == j)) for j in free] for i in range(n)]
    for row, pivot in zip(rows, pivots):
        S[pivot] = [-row[j] for j in free]
    return S if free else []


def is_positive_definite(M: Rows) -> bool:
    """Whether a symmetric matrix of fractions is positive definite: all pivots of its elimination are positive.

    Parameters
    ----------
    M : list of lists of Fraction
    """
    M = [list(row) for row in M]
    for k, pivot_row in enumerate(M):
        if pivot_row[k] <= 0:
            return False
        for row in M[k + 1:]:
            factor = row[k] / pivot_row[k]
            row[k:] = [a - factor * b for a, b in zip(row[k:], pivot_row[k:])]
    return True


def exact(M: Array) -> Rows:
    """The exact values of a matrix.

    Parameters
    ----------
    M : ndarray (m, n)
    """
    return [[Fraction(float(x)) for x in row] for row in M]


def transposed(A: Rows) -> Rows:
    """A'.

    Parameters
    ----------
    A : list of lists of Fraction
    """
    return list(map(list, zip(*A)))


def product(A: Rows, B: Rows) -> Rows:
    """A B.

    Parameters
    ----------
    A, B : list of lists of Fraction
    """
    columns = list(zip(*B))
    return [[sum((a * b for a, b in zip(row, column)), Fraction(0)) for column in columns] for row in A]
