"""The sums of a mode estimator in Gappa's words: measurement, boxes over a period, boxes that are born, the answer.

All the C does with boxes is looked at: each end is a sum over the ends that its coefficients' signs ask for. What a sum
may be off by is what the tables were proved to hold for it (``certify.mode_enclosure``). Both ends of a box are the
mirrored sums; both are stated where rounding could tell them apart, in the period and in the answer.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from flint import fmpq

from ..certify.exact import Q, down
from ..certify.loose_filter import rounded_start
from ..certify.rounding import UNIT
from .gappa_sums import SIDES, _join, _product

Array = np.ndarray


@dataclass(frozen=True)
class BoxSum:
    """One sum: name, what it is, its terms in evaluation order, what it may be off by."""

    name: str
    note: str
    terms: tuple[str, ...]
    margin: float


def sums(modes, t, prefix: str) -> Iterator[BoxSum]:
    """State every sum of a mode estimator.

    Parameters
    ----------
    modes : sequence of Mode
        Of the plant.
    t : ModeTables
    prefix : str
        Of the observer.

    Yields
    ------
    BoxSum
    """
    room, names = _Rooms(modes[0], t), [m.name for m in modes]
    for i, d in enumerate(t.D):
        for side, v in zip(SIDES, (t.v_hi, t.v_lo)):
            terms = [f"in_y_{i}", *_row(-d, "in_u"), _number(-v[i])]
            yield BoxSum(f"{prefix}_cut_{side}_{i}", f"y[{i}] less D u and noise, {side}", _join(terms),
                         room.measured(i, side))
    for q, mode in enumerate(names):
        for i in range(len(t.limit)):
            for side in SIDES:
                terms = _join([*_carried(t, q, i, side), _number(_outward(t.reach[q, i], side))])
                yield BoxSum(f"{prefix}_carried_{side}_{i}_mode_{q}", f'xi[{i}], {side}, mode "{mode}"', terms,
                             room.carried(q, i))
    for i, row in enumerate(t.S_inverse):
        for side in SIDES:
            terms = [*_image(row, side), _number(_outward(t.x_room[i], side))]
            yield BoxSum(f"{prefix}_answer_{side}_{i}", f"x[{i}], {side}", _join(terms), room.answered(i))
    for p, q in itertools.permutations(range(len(names)), 2):
        for i in range(len(t.limit)):
            J = _join([_number(t.J_shift[p, q, i]), *_row(t.J_u[p, q, i], "in_u"), *_image(t.J[p, q, i], "lo")])
            radius = _join([_number(t.J_reach[p, q, i]), *_row(t.J_u_radius[p, q, i], "a"),
                            *_row(t.J_radius[p, q, i], "m")])
            terms = [f"({' '.join(_join(_carried(t, q, i, 'lo')))})", f"+ (({' '.join(J)}) - ({' '.join(radius)}))",
                     f"- {float(t.birth[p, q, i]).hex()}"]
            yield BoxSum(f"{prefix}_born_{i}_modes_{p}_{q}", f'xi[{i}], lo, "{names[p]}" to "{names[q]}"',
                         tuple(terms), room.born(p, q, i))


def narrowed(t, prefix: str, of: str = "s_x", whose: str = "framers") -> Iterator[BoxSum]:
    """State what framers, or the bounds of an observer, make of S x, which boxes are cut to.

    Parameters
    ----------
    t : DrivenTables or FollowerTables
    prefix : str
    of : str
        Variables of the bounds, without side and index.
    whose : str

    Yields
    ------
    BoxSum
        Of the numbers s->x_lo and s->x_hi of framers, or those that ``of`` says.
    """
    n = len(t.xi_room)
    gamma = (n + 2) * UNIT[t.real] / (1 - (n + 2) * UNIT[t.real])
    tiny = 4 * (n + 2) * Q(np.finfo(t.real).smallest_subnormal)
    for i, row in enumerate(t.S_rounded):
        size = sum((abs(Q(a)) * Q(b) for a, b in zip(row, t.told.box)), Q(t.xi_room[i]))
        for side in SIDES:
            terms = [*_image(row, side, of), _number(_outward(t.xi_room[i], side))]
            yield BoxSum(f"{prefix}_narrowed_{side}_{i}", f"xi[{i}] of {whose}, {side}", _join(terms),
                         down(gamma * size + tiny))


def begun(t, prefix: str, modes: tuple[str, ...]) -> Iterator[BoxSum]:
    """State what filters make of the centre of bounds at a start.

    Parameters
    ----------
    t : LooseFilter
    prefix : str
    modes : tuple of str

    Yields
    ------
    BoxSum
        Of the numbers ``centre``, which are within the declared range.
    """
    _, lost = rounded_start(t)
    for q, (E, mode) in enumerate(zip(t.E, modes)):
        yield from (BoxSum(f"{prefix}_begun_{i}_mode_{q}", f'xi[{i}] at a start, mode "{mode}"', _join(
            _row(row, "centre")), down(lost[q, i])) for i, row in enumerate(E))


def operands(t) -> Iterator[tuple[str, str, str]]:
    """Name every number that the sums read, with the ends of its range."""
    for vector in "uy":
        lo, hi = (getattr(t, f"{vector}_{side}").astype(float) for side in SIDES)
        yield from ((f"in_{vector}_{j}", a.hex(), b.hex()) for j, (a, b) in enumerate(zip(lo, hi)))
        if vector == "u":
            yield from ((f"a_{j}", 0.0.hex(), max(abs(a), abs(b)).hex()) for j, (a, b) in enumerate(zip(lo, hi)))
    for k, b in enumerate(t.limit.astype(float)):
        yield from ((f"s_{side}_{k}", (-b).hex(), b.hex()) for side in SIDES)
        yield f"m_{k}", 0.0.hex(), b.hex()


class _Rooms:
    """What the proof of the tables holds for the rounding of each sum, rounded down."""

    def __init__(self, mode, t):
        self.mode, self.t = mode, t
        self.u = np.maximum(np.abs(t.u_lo), np.abs(t.u_hi)).astype(float)
        self.tiny = fmpq(*float(np.finfo(t.real).smallest_subnormal).as_integer_ratio()) * (
            4 * (len(t.limit) + len(self.u)) + 16)

    def gamma(self, k: int) -> fmpq:
        """So many roundings in a row."""
        return k * UNIT[self.t.real] / (1 - k * UNIT[self.t.real])

    def size(self, *parts) -> fmpq:
        """Exact sum of |row| times bounds."""
        return sum((abs(Q(a)) * abs(Q(b)) for row, bounds in parts for a, b in zip(row, bounds)), fmpq(0))

    def measured(self, i: int, side: str) -> float:
        """What the bound of the noise leaves, less noise, and what reading y and u and the rounded D may be off by."""
        t, m, sign = self.t, self.mode, 1 if side == "lo" else -1
        noise = sum((max(sign * Q(a) * Q(b) for b in ends) for a, *ends in zip(m.Dv[i], m.v_lo, m.v_hi)), fmpq(0))
        y = max(abs(Q(t.y_lo[i])), abs(Q(t.y_hi[i])))
        unit = UNIT[t.real] * (1 + 2 * UNIT[t.real])
        read = unit * (y + self.size((t.D[i], self.u))) + 2 * self.tiny
        left = sum((abs(Q(a) - Q(b)) * Q(c) for a, b, c in zip(m.D[i], t.D[i], self.u)), fmpq(0)) * (1 + unit)
        return down(sign * Q((t.v_hi if side == "lo" else t.v_lo)[i]) - noise - read - left)

    def base(self, q: int, i: int) -> fmpq:
        """Magnitudes of the terms of a period."""
        t = self.t
        return self.size((t.Phi[q, i], t.limit), (t.Gamma[q, i], self.u), ([1.0], [t.shift[q, i]]))

    def carried(self, q: int, i: int) -> float:
        n, n_u = len(self.t.limit), len(self.u)
        return down(self.gamma(n + n_u + 3) * (self.base(q, i) + Q(self.t.reach[q, i])) + self.tiny)

    def answered(self, i: int) -> float:
        t = self.t
        return down(self.gamma(len(t.limit) + 2) * (self.size((t.S_inverse[i], t.limit)) + Q(t.x_room[i])) + self.tiny)

    def born(self, p: int, q: int, i: int) -> float:
        t = self.t
        jump = self.size((t.J[p, q, i], t.limit), (t.J_radius[p, q, i], t.limit), (t.J_u[p, q, i], self.u),
                         (t.J_u_radius[p, q, i], self.u), ([1.0], [t.J_shift[p, q, i]]), ([1.0], [t.J_reach[p, q, i]]))
        g = self.gamma(len(t.limit) + len(self.u) + 6)
        return down(g * jump + g * (self.base(q, i) + jump + Q(t.birth[p, q, i])) + 2 * self.tiny)


def _number(value) -> str:
    return float(value).hex()


def _outward(value, side: str) -> float:
    return -float(value) if side == "lo" else float(value)


def _row(row: Array, operand: str) -> list[str]:
    return [_product(c, f"{operand}_{j}") for j, c in enumerate(row) if c != 0]


def _image(row: Array, side: str, of: str = "s") -> list[str]:
    """Each coefficient takes the end that its sign asks for."""
    other = SIDES[1 - SIDES.index(side)]
    return [_product(c, f"{of}_{side if c >= 0 else other}_{k}") for k, c in enumerate(row) if c != 0]


def _carried(t, q: int, i: int, side: str) -> list[str]:
    return [_number(t.shift[q, i]), *_row(t.Gamma[q, i], "in_u"), *_image(t.Phi[q, i], side)]
