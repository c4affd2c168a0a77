"""One matrix acting again and again: supports of what it does to sets, and their suprema over all later steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..algebra.contraction import Contraction, contraction, settled
from ..errors import DesignError

Array = np.ndarray

#: What tables are multiplied with: they are computed in double precision, and proved with some room for rounding.
OUTWARD = 1.0 + 1e-6
#: Steps are listed until that little is left of the rows, or the list holds so many numbers; the rest is bounded.
SMALL, MOST = 1e-9, 2_000_000


class Stay:
    """Supports of rows while one matrix A acts again and again, and their suprema over all later steps.

    Parameters
    ----------
    A : ndarray (n, n)
        Stable.
    W : ndarray (n, g)
        Generators added by every step but the first.
    rows : ndarray (k, n)
    steps : int
        ``at`` can be asked up to this step at least.
    where : str
        For the message.

    Raises
    ------
    DesignError
        A is not stable.
    """

    def __init__(self, A: Array, W: Array, rows: Array, steps: int = 0, where: str = "mode"):
        found = contraction(A)
        if found is None:
            radius = max(abs(np.linalg.eigvals(A)))
            raise DesignError(f"{where}: spectral radius of the error matrix {radius:.4g} (found), expected below 1. "
                              "No threshold holds for as long as this mode may stay; change the gains.")
        self.by: Contraction = found
        rows = np.asarray(rows, dtype=float)
        powers = list(settled(A, rows, found, SMALL, max(2, MOST // rows.size)))
        while len(powers) < steps + 2:
            powers.append(powers[-1] @ A)
        self.rows = np.array(powers)  # a A^j
        self.last = len(powers) - 1
        self.sums = np.zeros((len(powers), len(rows)))  # sum over m < j of |a A^m W|
        np.cumsum(np.abs(self.rows[:-1] @ W).sum(axis=2), axis=0, out=self.sums[1:])
        self.W = W

    def left(self, entry: Array, stop: int) -> Array:
        """Supports of what is left of an entry set at steps 0..stop.

        Returns
        -------
        h : ndarray (stop + 1, k)
        """
        return np.abs(self.rows[:stop + 1] @ entry).sum(axis=2)

    def added(self, first: Array, stop: int) -> Array:
        """Supports of what steps 0..stop have added; the first step adds ``first`` instead of W.

        Returns
        -------
        h : ndarray (stop + 1, k)
        """
        h = np.zeros((stop + 1, self.rows.shape[1]))
        h[1:] = np.abs(self.rows[:stop] @ first).sum(axis=2) + self.sums[:stop]
        return h

    def ever(self, entry: Array, first: Sequence[Array], since: int) -> Array:
        """Suprema of the supports over all steps >= since, whichever of ``first`` the first step adds.

        Returns
        -------
        h : ndarray (k,)
        """
        stop = self.last
        later = self._later(entry, first, stop)
        if since >= stop:
            return later  # of everything since ``stop``
        start = self.left(entry, stop)
        return np.maximum(later, np.max([(start + self.added(F, stop))[since:].max(axis=0) for F in first], axis=0))

    def affine(self, T: Array, first: Sequence[Array], since: int) -> tuple[Array, Array]:
        """``ever`` as a function of an entry box T b: the largest of ``maps @ b + constants`` over the first axis.

        Returns
        -------
        maps : ndarray (J, k, n)
        constants : ndarray (J, k)
        """
        stop, by = self.last, self.by
        sides = np.array([by.columns(column[:, None]) for column in T.T])
        tail = self._later(np.zeros((len(T), 1)), first, stop)
        left = by.rows(self.rows[stop - 1])[:, None] * by.mu * sides
        added = np.max([self.added(F, stop) for F in first], axis=0)[since:]
        return np.concatenate([np.abs(self.rows[since:stop + 1] @ T), left[None]]), np.concatenate([added, tail[None]])

    def _later(self, entry: Array, first: Sequence[Array], stop: int) -> Array:
        """Upper bound of the supports over all steps >= stop, by the contraction of A."""
        by, left = self.by, self.by.rows(self.rows[stop - 1])  # of what still acts on the first step's part
        begin = max(by.columns(F) for F in first)
        rest = by.columns(self.W) / (1.0 - by.mu)
        return left * (by.mu * by.columns(entry) + begin + rest) + self.sums[stop - 1]
