"""Interval arithmetic on vectors: the product of a matrix with a box, and positive and negative parts."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def pos(A: Array) -> Array:
    """Positive part max(A, 0)."""
    return np.maximum(A, 0.0)


def neg(A: Array) -> Array:
    """Negative part max(-A, 0), so that A = pos(A) - neg(A)."""
    return np.maximum(-A, 0.0)


def support(A: Array, lo: Array, hi: Array) -> Array:
    """Row-wise maximum of A @ x over boxes, for stacked matrices (..., r, c) and boxes (..., c) or (c,)."""
    return (pos(A) @ hi[..., None])[..., 0] - (neg(A) @ lo[..., None])[..., 0]


def half(lo: Array, hi: Array) -> Array:
    """Half width of a box."""
    return (hi - lo) / 2.0


def sizes(lo: Array, hi: Array) -> Array:
    """Largest magnitude of each range; 1 where there is none.

    Parameters
    ----------
    lo, hi : ndarray (n,)
    """
    size = np.maximum(np.abs(lo), np.abs(hi))
    return np.where(np.isfinite(size) & (size > 0), size, 1.0)


def with_products(lo, hi, products) -> tuple[list, list]:
    """Bounds of parameters with those of their products behind them; floats or rationals.

    Parameters
    ----------
    lo, hi : sequences of number (J,)
    products : sequence of (int, int)
    """
    ends = [[a * b for a in (lo[j], hi[j]) for b in (lo[k], hi[k])] for j, k in products]
    return [*lo, *map(min, ends)], [*hi, *map(max, ends)]


def hull(S: Array, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Box of S x over a box of x, rounded outward.

    Parameters
    ----------
    S : ndarray (m, n)
    lo, hi : ndarray (..., n)

    Returns
    -------
    lo, hi : ndarray (..., m)
    """
    middle, radius = ((lo + hi) / 2) @ S.T, ((hi - lo) / 2) @ np.abs(S).T
    room = 1e-12 * (np.maximum(np.abs(lo), np.abs(hi)) @ np.abs(S).T)
    return middle - radius - room, middle + radius + room
