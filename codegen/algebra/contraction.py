"""How fast a stable matrix contracts, in one quadratic norm: rigorous bounds on what it still does after many steps.

With ``A S A' <= mu^2 S``, S > 0, and the norms ``|a|^2 = a S a'`` of rows and ``|g|^2 = g' S^-1 g`` of columns,

    |a A| <= mu |a|,    |a g| <= |a| |g|,    so  |a A^j g| <= mu^j |a| |g|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Contraction:
    """``A S A' <= mu^2 S`` with S > 0 and mu < 1.

    Parameters
    ----------
    S : ndarray (n, n)
    mu : float
    """

    S: Array
    mu: float

    def rows(self, a: Array) -> Array:
        """Return the norms of rows.

        Parameters
        ----------
        a : ndarray (..., n)

        Returns
        -------
        size : ndarray (...)
        """
        return np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", a, self.S, a), 0.0))

    def columns(self, G: Array) -> float:
        """Return the sum of the norms of the columns of G: |a G|_1 <= |a| times it.

        Parameters
        ----------
        G : ndarray (n, g)

        Returns
        -------
        size : float
        """
        return float(np.sqrt(np.maximum((G * np.linalg.solve(self.S, G)).sum(axis=0), 0.0)).sum())


def contraction(A: Array) -> Contraction | None:
    """Return a contraction of a stable matrix; None where its spectral radius is not below 1.

    S sums ``(A / m)^k (A / m)'^k`` with m half way between the radius and 1, so that a smaller factor than m is shown.

    Parameters
    ----------
    A : ndarray (n, n)

    Returns
    -------
    found : Contraction or None
    """
    A = np.asarray(A, dtype=float)
    n, radius = len(A), max(abs(np.linalg.eigvals(A)), default=0.0)
    if not radius < 1.0 - 1e-9:
        return None
    m = (1.0 + radius) / 2.0
    scale = np.sqrt(np.maximum(np.diag(_lyapunov(A / m, np.eye(n))), 1e-300))  # units of the states made alike
    S = _lyapunov(A / m, np.diag(scale * scale) + 1e-3 * np.max(scale) ** 2 * np.eye(n))
    S = (S + S.T) / 2.0
    return Contraction(S / np.max(np.diag(S)), float(m))


def _lyapunov(A: Array, G: Array) -> Array:
    """Solution of S = A S A' + G."""
    n = len(A)
    return np.linalg.solve(np.eye(n * n) - np.kron(A, A), G.ravel()).reshape(n, n)


def settled(A: Array, rows: Array, by: Contraction, small: float = 1e-9, most: int = 20000) -> Array:
    """Return ``rows A^j`` for j = 0, 1, ... until little is left of every row.

    Parameters
    ----------
    A : ndarray (n, n)
    rows : ndarray (k, n)
    by : Contraction
    small : float
        Of the norm that the row began with.
    most : int
        Longest list.

    Returns
    -------
    powers : ndarray (J, k, n)
        J >= 2.
    """
    limit = small * by.rows(rows)
    out = [rows, rows @ A]
    while len(out) < most and np.any(by.rows(out[-1]) > limit):
        out.append(out[-1] @ A)
    return np.array(out)
