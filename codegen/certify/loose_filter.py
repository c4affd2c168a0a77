"""Thresholds of filters that start at run time, each in one mode that stays: exact checks on the numbers of the C.

As ``filter_bounds``, mode by mode, with a graph that never switches. What is started is [x; xi] with x = c + d, c in
the declared range, |d| at most the size of the start, and xi = E c but for its rounding: along a row r = [r_x, r_s]

    |r e| <= |r_x + r_s E| |c| + |r_x| |d| + |r_s| (rounding of E c).

So a row with r_x = -r_s E knows of nothing but d. A filter that goes on is anywhere within its limits, and x in its
range. Nothing is said of switching: who starts a filter sees to it that the mode is the same since.
"""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from .exact import Q, product, rational
from .filter_bounds import Demand, Graph, Maps, anywhere, maps, raised, supports, table
from .filter_model import joint_mode, sizes
from .rounding import TINY, UNIT

Array = np.ndarray
#: A mode that stays.
STAYS = Graph((None,), ((0, 0, 0),))
#: Samples within which bounds are down to the last ones.
MOST = 4000
OF_A_MODE = ("M", "G", "L", "K", "Du", "Dy", "E")


def alone(t, q: int) -> SimpleNamespace:
    """The constants of one mode."""
    return SimpleNamespace(**{**vars(t), **{name: getattr(t, name)[q:q + 1] for name in OF_A_MODE}})


def rounded_start(t) -> tuple[Array, Array]:
    """Largest |c|, and what E c may lose in the C by mode and row, exactly: (n_x,), (N, n_s)."""
    c, n = sizes(t.x_lo, t.x_hi), t.E.shape[2]
    rate, tiny = (n + 1) * UNIT[t.real] * Q(1.01), 2 * (n + 1) * TINY[t.real]
    return c, np.array([rate * product(abs(rational(E)), c.reshape(-1, 1))[:, 0] + tiny for E in t.E], dtype=object)


def begins(t, q: int, rows: Array) -> list[Array]:
    """Bounds of the rows at a start of each size, and from anywhere; doubles that are not below.

    Parameters
    ----------
    t : LooseFilter
    q : int
    rows : ndarray (m, n_x + n_s)

    Returns
    -------
    list of ndarray (1, m)
    """
    n, exact, E = len(t.x_lo), rational(rows), rational(t.E[q])
    c, lost = rounded_start(t)
    of_x, of_xi = exact[:, :n], exact[:, n:]
    fixed = abs(of_x + product(of_xi, E)) @ c + abs(of_xi) @ lost[q]
    out = [raised(fixed + abs(of_x) @ rational(size)) for size in t.sizes]
    return [b[None] for b in (*out, supports(rows, anywhere(t, c)))]


def tabled(t, q: int, found: Maps, b: Array, rows: Array) -> list[list[Array]]:
    """Bounds of the estimate in mode q from each start on, until the last bounds hold; lists of different lengths.

    Raises
    ------
    CertificateError
        They do not come down within ``MOST`` samples.
    """
    return [[row[0] for row in table(found, STAYS, b, first, MOST)] for first in begins(t, q, rows)]


def demands(modes, t, certs: list[dict]) -> Iterator[Demand]:
    """All conditions of the thresholds.

    Parameters
    ----------
    modes : sequence
        Of the plant as the firmware sees it.
    t : LooseFilter
    certs : list of dict
        By mode; see ``filter_bounds.maps``, and "bounds" (m,).

    Yields
    ------
    Demand

    Raises
    ------
    CertificateError
        Bounds do not come down to the last within the rows of the table.
    """
    n_x, n_s, limit = len(t.x_lo), len(t.limit), t.limit.astype(float)
    for q, (mode, cert) in enumerate(zip(modes, certs, strict=True)):
        rows, b = np.array(cert["rows"], dtype=float), np.array(cert["bounds"], dtype=float)[None]
        found = maps((joint_mode(mode, alone(t, q), 0),), cert, n_s)
        yield Demand("kept", f"a sample later in mode {q}", found.after(STAYS, b), b, lambda at, needed, q=q: (
            f"the set of plant and filter in mode {q} is not kept: row {at[1]} needs {needed[at]:.6g}."))
        final = found.estimate(STAYS, b)[0]
        for k, proved in enumerate(tabled(t, q, found, b, rows)):
            for since, needed in enumerate(proved):
                yield threshold(needed, t.h[k, min(since, t.last) >> t.shift, q],
                                f"{since} samples after a start of size {k} in mode {q}")
            for row in range(len(proved) >> t.shift, t.h.shape[1]):
                yield threshold(final, t.h[k, row, q], f"in row {row} after a start of size {k} in mode {q}")
        yield Demand("limit", f"without a fault in mode {q}", b[0, n_x:n_x + n_s], limit, lambda at, needed, q=q: (
            f"xi[{at[0]}] of mode {q} reaches {needed[at]:.4g} without a fault, beyond its limit {limit[at]:.4g}."),
            True)
    for name, room in start_rooms(t).items():
        yield Demand("start", name, np.zeros(1), np.array([float(room)]), lambda at, needed, name=name: (
            f"{name} is {float(getattr(t, name)):.9g}, less than what the rounding of a start asks for."))
    unit, tiny = 2 * UNIT[t.real], 2 * TINY[t.real]  # the centre as it was rounded
    widest = raised((rational(t.x_hi) - rational(t.x_lo)) / 2 + unit * sizes(t.x_lo, t.x_hi) + tiny)
    yield Demand("start", "declared range", widest, t.sizes[0].astype(float), lambda at, needed: (
        f"the largest size of x[{at[0]}] is less than half of its declared range."))


def threshold(needed: Array, given: Array, when: str) -> Demand:
    """That a threshold holds the estimate."""
    return Demand("threshold", when, needed, given.astype(float), lambda at, needed: (
        f"the estimate of fault {at[0]} reaches {needed[at]:.6g} {when}, its threshold is {float(given[at]):.6g}."))


def start_rooms(t) -> dict:
    """What the constants of a start's half widths have beyond the rounding that they are for: name -> exact number.

    The half widths are of the centre as it was rounded. They lose one rounding in the difference, one in the product
    with ``grow``, one in the sum with ``floor``; numbers below the normal ones may be read or written as zero.
    """
    unit, tiny = Q(UNIT[t.real]), Q(TINY[t.real])
    keep = 1 - unit
    return {"grow": Q(t.grow) * keep * keep * keep - 1, "floor": (Q(t.floor) - tiny) * keep - 3 * tiny}
