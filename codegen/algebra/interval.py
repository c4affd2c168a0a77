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


def sup(A: Array, lo: Array, hi: Array) -> Array:
    """Largest value of ``A @ x`` over the box lo <= x <= hi, row by row (Lemma 6 of Zammali (2020))."""
    return pos(A) @ hi - neg(A) @ lo


def inf(A: Array, lo: Array, hi: Array) -> Array:
    """Smallest value of ``A @ x`` over the box, row by row."""
    return pos(A) @ lo - neg(A) @ hi


def half(lo: Array, hi: Array) -> Array:
    """Half width of a box."""
    return (hi - lo) / 2.0
