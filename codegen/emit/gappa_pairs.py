"""The sums of a mode estimator by sliding modes in Gappa's words: the measurement, the test of a pair, its step.

What is proved of this family rests on these sums alone: that a test fails only where its mode was not active, and that
the bounds hold x while it is. The loops that decide promise nothing, so nothing is asked of their rounding.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from flint import fmpq

from ..certify.exact import Q, down, up
from ..certify.rounding import UNIT
from .gappa_boxes import BoxSum, _image, _number, _row
from .gappa_sums import SIDES, _join

Array = np.ndarray


def sums(modes, t, prefix: str) -> Iterator[BoxSum]:
    """State every sum of the pairs; what a sum may be off by is what ``certify.sliding_claims`` holds for it.

    Parameters
    ----------
    modes : sequence of Mode
        Of the plant.
    t : SlidingTables
    prefix : str
        Of the observer.

    Yields
    ------
    BoxSum
    """
    room = _Rooms(t)
    for i, row in enumerate(t.D):
        if np.any(row):
            yield BoxSum(f"{prefix}_seen_{i}", f"y[{i}] less D u", _join([f"in_y_{i}", *_row(-row, "in_u")]),
                         down(room.lost[i]))
    for i, row in enumerate(t.H):
        for side in SIDES:
            v = getattr(t, f"v_{side}")[i]
            yield BoxSum(f"{prefix}_tested_{side}_{i}", f"output {i} of C x and its noise, {side}",
                         _join([*_image(row, side), _number(v)]), room.tested(i, side))
    for q, mode in enumerate(modes):
        for side in SIDES:
            d, L, M = (getattr(t, f"{k}_{side}")[q] for k in "dLM")
            for i in range(len(t.limit)):
                terms = [_number(d[i]), *_row(t.G[q, i], "in_u"), *_row(L[i], "seen"), *_row(M[i], f"s_{side}")]
                yield BoxSum(f"{prefix}_moved_{side}_{i}_mode_{q}", f'x[{i}], {side}, mode "{mode.name}"', _join(terms),
                             room.moved(q, i, side))


def operands(t) -> Iterator[tuple[str, str, str]]:
    """Name every number that the sums read, with the ends of its range; ``seen`` is y less D u.

    Parameters
    ----------
    t : SlidingTables
    """
    for vector in "uy" if np.any(t.D) else "u":
        lo, hi = (getattr(t, f"{vector}_{side}").astype(float) for side in SIDES)
        yield from ((f"in_{vector}_{j}", a.hex(), b.hex()) for j, (a, b) in enumerate(zip(lo, hi)))
    for j, most in enumerate(_Rooms(t).seen):
        yield f"seen_{j}", (-up(most)).hex(), up(most).hex()
    for k, most in enumerate(t.limit.astype(float)):
        yield from ((f"s_{side}_{k}", (-most).hex(), most.hex()) for side in SIDES)


class _Rooms:
    """What the proof of the tables holds for the rounding of each sum, rounded down."""

    def __init__(self, t):
        self.t, self.n, self.n_u, self.p = t, *t.sizes[1:]
        self.u, self.y = (np.maximum(np.abs(getattr(t, f"{k}_lo")), np.abs(getattr(t, f"{k}_hi"))).astype(float)
                                  for k in "uy")
        self.tiny = fmpq(*float(np.finfo(t.real).smallest_subnormal).as_integer_ratio()) * (
            4 * (self.n + self.n_u + self.p) + 16)
        fed = [size(row, self.u) for row in t.D]
        # y and u are rounded when they are read: one rounding of three that the sum does not have.
        self.lost = [self.gamma(self.n_u + 1) * (Q(y) + f) for y, f in zip(self.y, fed)]
        self.seen = [Q(y) + f + self.gamma(self.n_u + 3) * (Q(y) + f) for y, f in zip(self.y, fed)]

    def gamma(self, k: int) -> fmpq:
        """So many roundings in a row."""
        return k * UNIT[self.t.real] / (1 - k * UNIT[self.t.real])

    def tested(self, i: int, side: str) -> float:
        """What the bound of the noise holds for the rounding of an output's bound."""
        t = self.t
        terms = size(t.H[i], t.limit) + self.seen[i] + abs(Q(getattr(t, f"v_{side}")[i]))
        return down(self.gamma(self.n + 4) * terms)

    def moved(self, q: int, i: int, side: str) -> float:
        """What the offset of a bound holds for the rounding of its sum."""
        t = self.t
        d, L, M = (getattr(t, f"{k}_{side}")[q, i] for k in "dLM")
        terms = size(M, t.limit) + size(t.G[q, i], self.u) + abs(Q(d)) + sum(
            (abs(Q(a)) * b for a, b in zip(L, self.seen)), fmpq(0))
        return down(self.gamma(self.n + self.n_u + self.p + 3) * terms + self.tiny)


def size(row: Array, bounds: Array) -> fmpq:
    """Exact sum of |row| times bounds."""
    return sum((abs(Q(a)) * abs(Q(b)) for a, b in zip(row, bounds)), fmpq(0))
