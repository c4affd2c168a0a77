"""The Gappa script of a design: every sum that the C rounds, and the room that its offset leaves for it.

``certify`` finds the rounding of a sum by a formula of its own, moves the offset outward by it and forgets it.
Here the margin is taken back from the finished tables: what of the offset is left once disturbance, noise and
the rounding of constants and inputs have had their part. Gappa must prove, from the sums alone, that no
rounding is larger.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..certify.containment import Containment
from ..certify.exact import Q, down
from . import families
from .maps import MapSpec, Names
from .view import DesignView

Array = np.ndarray
FORMAT = {"float32": "ieee_32", "float64": "ieee_64"}
SIDES = ("lo", "hi")


@dataclass(frozen=True)
class Row:
    """A sum of the C: Gappa name, what it is, its terms in evaluation order, the margin in hex and in decimal."""

    name: str
    note: str
    terms: tuple[str, ...]
    margin: str
    about: str


@dataclass(frozen=True)
class Operand:
    """A number that sums read: Gappa variable and the ends of its range, in hex."""

    name: str
    least: str
    most: str


@dataclass(frozen=True)
class RoundingView:
    """Everything that ``rounding_<prefix>.g`` has and the observer's own view has not.

    ``largest`` is the largest number of the type.
    """

    format: str
    operands: tuple[Operand, ...]
    rows: tuple[Row, ...]
    largest: str


def rounding(design, d: DesignView) -> RoundingView:
    """State the rounding of every row of every map, for every mode and both framers.

    Parameters
    ----------
    design : Design
    d : DesignView

    Returns
    -------
    view : RoundingView
        A row that is the same in several modes appears once.
    """
    t = design.observer.tables[d.real]
    names = Names(d.prefix, d.macro, d.real, tuple(m.name for m in d.modes), tuple(m.macro for m in d.modes))
    # TODO: the rows of Varying maps.
    specs = [s for s in families.specs(design.observer.family, t, names, d.x, d.y) if isinstance(s, MapSpec)]
    margins = _margins(design.plant.modes, t)
    rows = [row for spec in specs for side in SIDES for i in range(len(spec.rows))
            for row in _rows(spec, side, i, margins)]
    operands = dict.fromkeys(operand for spec in specs for operand in _operands(spec, t))
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in operands), tuple(rows),
                        float(np.finfo(t.dtype).max).hex())


def _margins(modes, t) -> dict[tuple[str, int, str], list[float]]:
    """What each offset leaves for rounding, rounded down to a double: (name, mode, side) -> one per row."""
    found = {}
    for name, q, side, demands in Containment(modes, t).offsets():
        offsets = getattr(t, f"{name}_{side}")[q]
        outward = [Q(o) if side == "hi" else -Q(o) for o in offsets]
        found[name, q, side] = [down(o - demand.need, "float64") for o, demand in zip(outward, demands)]
    return found


def _rows(spec: MapSpec, side: str, i: int, margins: dict) -> Iterator[Row]:
    """Give one row of a map, once per group of modes that have the same sum and margin."""
    groups: dict[tuple, list[int]] = {}
    for q in range(len(spec.names.modes)):
        key = (_terms(spec, q, side, i), float(margins[spec.offset.name, q, side][i]))
        groups.setdefault(key, []).append(q)
    for (terms, margin), modes in groups.items():
        which = " and ".join(f'"{spec.names.modes[q]}"' for q in modes)
        yield Row(f"{spec.name}_{side}_{i}_mode_{modes[0]}", f"{spec.rows[i]}, {side}, mode {which}", terms,
                  margin.hex(), f"{margin:.4g}")


def _terms(spec: MapSpec, q: int, side: str, i: int) -> tuple[str, ...]:
    """Print the sum of one row without the measurement at its end; terms with coefficient zero change nothing."""
    terms = []
    for part in spec.common:
        row = part.side("hi" if spec.shared else side)[q, i]
        terms += [_product(c, part.operand, j) for j, c in enumerate(row) if c != 0]
    offset = float(spec.offset.side(side)[q, i])
    terms += [offset.hex()] if offset else []
    other = SIDES[1 - SIDES.index(side)]
    for j, c in enumerate(spec.state.side(side)[q, i]):
        bound = other if spec.by_sign and c < 0 else side
        terms += [_product(c, f"{spec.state.operand}_{bound}", j)] if c != 0 else []
    # A subtraction of c v and an addition of -c v are one operation in IEEE 754 arithmetic.
    return tuple(terms[:1] + [f"- {text[1:]}" if text[0] == "-" else f"+ {text}" for text in terms[1:]]) or ("0",)


def _product(coefficient: float, operand: str, j: int) -> str:
    """Print ``coefficient * operand[j]``; the coefficients 1 and -1 need no multiplication."""
    value, sign = float(coefficient), "-" if coefficient < 0 else ""
    name = _name(operand, j)
    return sign + (name if abs(value) == 1 else f"({abs(value).hex()} * {name})")


def _name(operand: str, j: int) -> str:
    """Turn the C operand ``in->u`` and an index into a Gappa variable."""
    return f"{operand.replace('->', '_')}_{j}"


def _operands(spec: MapSpec, t) -> Iterator[tuple[str, str, str]]:
    """Name every number that the sums of a map read, with the ends of its range.

    The ranges are those behind the margins, which the Frama-C harness shows the state never to leave; zero is what
    init and reset store.
    """
    for part in spec.common:
        vector = part.operand.split("->")[1]
        lo, hi = (getattr(t, f"{vector}_{side}").astype(float) for side in SIDES)
        for j, (a, b) in enumerate(zip(np.minimum(lo, 0.0), np.maximum(hi, 0.0))):
            yield _name(part.operand, j), a.hex(), b.hex()
    for side in SIDES:
        for j, b in enumerate(t.box.astype(float)):
            yield _name(f"{spec.state.operand}_{side}", j), (-b).hex(), b.hex()
