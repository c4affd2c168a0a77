"""Cover of a sampled system that depends on one bounded number: a straight line in it, and what the line misses.

``[x'; y] = (sum_k s^k M_k) [x; u]`` with s constant over one period and within bounds is sampled with u held. With
s = s0 + r d, |d| <= 1, the sampled matrix is ``P0 + d P1 + rest`` with ``|rest| <= R`` elementwise: the exponential is
expanded in d by ball arithmetic (Arb), as far as its order ``TERMS``, powers of d beyond the first are replaced by
their best line, and the tail is bounded by the same expansion of the magnitudes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat, ctx

Array = np.ndarray
#: Highest power of d that is expanded.
TERMS = 8


@dataclass(frozen=True)
class Cover:
    """P(d) = base + d slope + rest, |d| <= 1, |rest| <= radius.

    Parameters
    ----------
    base, slope, radius : ndarray (n_x + n_y, n_x + n_u)
    """

    base: Array
    slope: Array
    radius: Array


def sampled_cover(motion, outputs, period: float, lo: arb | float, hi: arb | float) -> Cover:
    """Cover [x+; y] of [x; u] over all s within bounds.

    Parameters
    ----------
    motion : sequence of ndarray (n_x, n_x + n_u)
        Coefficients of s^0, s^1, ... of x'.
    outputs : sequence of ndarray (n_y, n_x + n_u)
        The same of y.
    period : float
        Seconds.
    lo, hi : arb or float
        Bounds of s; balls where they are not floats.

    Returns
    -------
    Cover

    Raises
    ------
    OverflowError
        The period is so long, or the bounds so wide, that the expansion does not settle.
    """
    before, ctx.prec = ctx.prec, 200
    try:
        middle, radius = (arb(hi) + arb(lo)) / 2, (arb(hi) - arb(lo)) / 2
        n_x, m = motion[0].shape
        square = [np.vstack([np.asarray(M, dtype=float), np.zeros((m - n_x, m))]) for M in motion]
        moved = [term.tolist()[:n_x] for term in _exponential(_around(square, middle, radius), period)]
        read = [term.tolist() for term in _around(outputs, middle, radius)]
        top = [arb_mat(rows) for rows in moved]
        tail = _tail(_around(square, middle, radius), period)
        empty = [[arb(0)] * m for _ in range(len(outputs[0]))]
        rows = [top[k].tolist() + (read[k] if k < len(read) else empty) for k in range(TERMS + 1)]
        return _line(rows, [r[:] for r in tail[:n_x]] + empty)
    finally:
        ctx.prec = before


def _around(matrices, middle: arb, radius: arb) -> list[arb_mat]:
    """Coefficients of d of a polynomial in s = middle + radius d."""
    size = len(matrices)
    zero = 0 * np.asarray(matrices[0], dtype=float)
    out = [arb_mat(zero.tolist()) for _ in range(size)]
    for k, M in enumerate(matrices):
        M = arb_mat(np.asarray(M, dtype=float).tolist())
        for j in range(k + 1):
            out[j] = out[j] + M * (arb.bin_uiui(k, j) * middle ** (k - j) * radius**j)
    return out


def _exponential(terms: list[arb_mat], period: float) -> list[arb_mat]:
    """Coefficients of d of exp(period sum_k d^k terms[k]), by the exponential of a block Toeplitz matrix."""
    m = terms[0].nrows()
    big = [[arb(0)] * (m * (TERMS + 1)) for _ in range(m * (TERMS + 1))]
    for k, term in enumerate(terms):
        for block in range(TERMS + 1 - k):
            for i in range(m):
                for j in range(m):
                    big[block * m + i][(block + k) * m + j] = arb(period) * term[i, j]
    E = arb_mat(big).exp()
    return [arb_mat([[E[i, k * m + j] for j in range(m)] for i in range(m)]) for k in range(TERMS + 1)]


def _tail(terms: list[arb_mat], period: float) -> list[list[arb]]:
    """Bound of the sum of all coefficients beyond ``TERMS``: those of the magnitudes are never smaller."""
    sizes = [arb_mat([[abs(x) for x in row] for row in term.tolist()]) for term in terms]
    whole = sizes[0]
    for size in sizes[1:]:
        whole = whole + size
    rest = (whole * arb(period)).exp()
    for term in _exponential(sizes, period):
        rest = rest - term
    bound = [[abs(x).upper() for x in row] for row in rest.tolist()]
    if any(not x.is_finite() for row in bound for x in row):
        raise OverflowError
    return bound


def _line(rows, tail) -> Cover:
    """Best line of the powers of d: d^2 by 1/2, d^3 by 3 d/4, the others by nothing; what is left is the radius."""
    shape = len(rows[0]), len(rows[0][0])
    base, slope, radius = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for i in range(shape[0]):
        for j in range(shape[1]):
            e = [term[i][j] for term in rows]
            constant, line = e[0] + e[2] / 2, e[1] + 3 * e[3] / 4
            base[i, j], slope[i, j] = float(constant.mid()), float(line.mid())
            rest = abs(constant - base[i, j]) + abs(line - slope[i, j]) + abs(e[2]) / 2 + abs(e[3]) / 4
            rest = rest + sum((abs(x) for x in e[4:]), arb(0)) + tail[i][j]
            top = float(rest.upper())
            radius[i, j] = np.nextafter(top, np.inf) if top > 0 else 0.0
    return Cover(base, slope, radius)
