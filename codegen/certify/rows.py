"""Rows a A^j in float64 with a rigorous bound on their error, and upper bounds of their products with generators.

The rounding of one step is bounded as usual; what later steps make of it shrinks in the norm ``|a|^2 = a S a'``, in
which ``A S A' <= mu^2 S`` is checked in exact rationals. (Bounding it entry by entry would let it grow like |A|^j.)
Sums of nonnegative numbers are themselves rounded; ``WIDER`` covers that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq_mat

from ..algebra.contraction import Contraction, contraction, settled
from ..errors import CertificateError
from .exact import Q, leading_failure, rational, up

Array = np.ndarray

#: Unit roundoff, what covers the rounding of a sum of at most 20 000 nonnegative numbers, and what covers underflow.
UNIT, WIDER, TINY = 2.0**-53, 1.0 + 4e-12, 1e-290
#: Rows are listed until that little is left, a longer list than a table is computed from.
SMALL = 1e-11


@dataclass(frozen=True)
class Generators:
    """Generators in floats.

    Parameters
    ----------
    near : ndarray (n, g)
        Each entry within a unit roundoff of the exact one.
    """

    near: Array

    @classmethod
    def of(cls, G: Array) -> Generators:
        """Take floats as exact."""
        return cls(np.asarray(G, dtype=float))

    @classmethod
    def of_exact(cls, G: Array) -> Generators:
        """Round rationals to floats."""
        return cls(np.array([[float(x) for x in row] for row in G]).reshape(G.shape))

    @classmethod
    def box(cls, T: Array, b: Array) -> Generators:
        """Take the columns of T, scaled by b."""
        return cls(T * b)


class Norm:
    """A contraction of one matrix, checked exactly.

    Parameters
    ----------
    A : ndarray (n, n)
    exact : ndarray (n, n) of fmpq or None
        What A is the rounded value of; None: A itself.

    Raises
    ------
    CertificateError
        None is found, or it does not hold.
    """

    def __init__(self, A: Array, exact: Array | None = None):
        by = contraction(A)
        if by is None:
            raise CertificateError("tables: a mode's error matrix is not contracting (found), expected stable.")
        self.by: Contraction = by
        self.mu = by.mu
        S, exact = rational(by.S), rational(A) if exact is None else exact
        if leading_failure(S) is not None or leading_failure(Q(by.mu) ** 2 * S - exact @ S @ exact.T) is not None:
            raise CertificateError("tables: the contraction of a mode's error matrix does not hold exactly (found), "
                                   "expected A S A' < mu^2 S.")
        self.S, self.size = S, np.abs(by.S)
        self.inverse = np.array(fmpq_mat([list(row) for row in S]).inv().tolist(), dtype=object)
        self.near = np.array([[float(x) for x in row] for row in self.inverse])

    def rows(self, a: Array) -> Array:
        """Upper bounds of the norms of rows (..., n)."""
        plain = np.einsum("...i,ij,...j->...", a, self.by.S, a)
        slip = (len(self.size) ** 2 + 4) * 2 * UNIT * self._magnitude(a)
        return np.sqrt((np.maximum(plain, 0.0) + slip) * WIDER + TINY)

    def magnitudes(self, a: Array) -> Array:
        """Upper bounds of the norms of all rows with entries of at most these magnitudes."""
        return np.sqrt(self._magnitude(a) * WIDER + TINY)

    def _magnitude(self, a: Array) -> Array:
        return np.einsum("...i,ij,...j->...", np.abs(a), self.size, np.abs(a))

    def columns(self, G: Generators) -> float:
        """Upper bound of the sum of the norms of columns, g' S^-1 g."""
        g, S = G.near, self.near
        plain = np.maximum(np.einsum("ig,ij,jg->g", g, S, g), 0.0)
        slip = (len(S) ** 2 + 8) * 2 * UNIT * np.einsum("ig,ij,jg->g", np.abs(g), np.abs(S), np.abs(g))
        return float(np.sum(np.sqrt((plain + slip) * WIDER + TINY))) * WIDER + TINY

    def against(self, other: Norm) -> float:
        """Upper bound of this norm over another one: the root of tr(S_other^-1 S)."""
        return float(np.sqrt(up((other.inverse * self.S).sum()))) * WIDER


class Powers:
    """Rows a A^j for j = 0..last, each within ``error`` (in the norm of A) of the exact one.

    Parameters
    ----------
    A : ndarray (n, n)
        Each entry within a unit roundoff of the exact one.
    norm : Norm
        Of the exact A.
    rows : ndarray (k, n)
    error : ndarray (k,)
        Of these rows, in that norm.
    least : int
        Smallest number of steps.
    most : int
        Largest number of entries, where the least number of steps allows it.
    """

    def __init__(self, A: Array, norm: Norm, rows: Array, error: Array, least: int, most: int = 4_000_000):
        n = len(A)
        powers = list(settled(A, rows, norm.by, SMALL, max(2, most // rows.size)))
        while len(powers) < least + 2:
            powers.append(powers[-1] @ A)
        self.rows = np.array(powers)
        slip = norm.magnitudes((2 * n + 2) * UNIT * (np.abs(self.rows[:-1]) @ np.abs(A)) + n * TINY)
        self.error = np.empty(self.rows.shape[:2])
        self.error[0] = error
        for j, step in enumerate(slip):
            self.error[j + 1] = (norm.mu * self.error[j] + step) * WIDER
        self.last = len(self.rows) - 1
        self.norm = norm

    def support(self, G: Generators, stop: int) -> Array:
        """Upper bounds of |a A^j G|_1 for j = 0..stop - 1."""
        rows, n = self.rows[:stop], self.rows.shape[2]
        slip = (2 * n + 4) * UNIT * (np.abs(rows) @ np.abs(G.near)).sum(axis=2)
        near = np.abs(rows @ G.near).sum(axis=2)
        return (near + slip + self.error[:stop] * self.norm.columns(G)) * WIDER + TINY

    def left(self, j: int) -> Array:
        """Upper bounds of the norms of a A^j."""
        return (self.norm.rows(self.rows[j]) + self.error[j]) * WIDER


def start(exact: Array, norm: Norm) -> tuple[Array, Array]:
    """Round exact rows to floats, with the error in a norm.

    Parameters
    ----------
    exact : ndarray (k, n) of fmpq
    norm : Norm

    Returns
    -------
    rows : ndarray (k, n)
    error : ndarray (k,)
    """
    rows = np.array([[float(x) for x in row] for row in exact])
    return rows, norm.magnitudes(np.abs(rows) * 2.0**-51 + TINY)
