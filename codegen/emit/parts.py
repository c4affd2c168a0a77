"""What the run-time families decide of a view, each its own: members, maps, how a set starts and is cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import literal
from .families import StateLayout
from .manual import Bit
from .maps import MapView, Table

Array = np.ndarray


@dataclass(frozen=True)
class Field:
    """A member of a struct: C type, name, array size or nothing, comment lines."""

    type: str
    name: str
    size: str
    note: tuple[str, ...]


@dataclass(frozen=True)
class Cut:
    """A function that cuts a vector to its range: statements, or tables and a loop.

    ``name``, ``vector`` and ``what`` are of framers, of which there may be two vectors, x and z.
    """

    statements: tuple[str, ...]
    tables: tuple[Table, ...]
    counts: tuple[str, ...]
    name: str = ""
    vector: str = ""
    what: str = ""


@dataclass(frozen=True)
class Late:
    """A function that joins the bounds of two modes: its name, the call for the last mode and that for the new one."""

    name: str
    told: str
    now: str


@dataclass(frozen=True)
class Move:
    """The calls that bring framers or an estimate of the last sample to this one, with and without its measurement.

    Of a point observer also those that move its set by a measured step, and that give the bounds of x.
    """

    measured: str
    missing: str
    forward: str = ""
    settle: str = ""


@dataclass(frozen=True)
class Operations:
    """Floating-point operations of the dearest call."""

    multiply: int
    add: int
    compare: int
    divide: int = 0

    def __add__(self, other: Operations) -> Operations:
        return Operations(*(int(a + b) for a, b in zip(vars(self).values(), vars(other).values())))

    def counts(self) -> dict[str, int]:
        """By name, divisions where there are any."""
        return {name: count for name, count in vars(self).items() if count or name != "divide"}


@dataclass(frozen=True)
class Size:
    """A macro of a size: its stem, value and meaning."""

    name: str
    value: str
    note: str


@dataclass(frozen=True)
class Parts:
    """The part of ``DesignView`` that depends on the family; ``noun`` is what a fault spoils, in words.

    ``header`` and ``self_test`` are templates, ``sets`` is the error set of a point observer, or what a filter or a
    mode estimator has in its place, or nothing; ``lengths`` are macros of sizes that are not those of x, u and y.
    ``told``: the mode is an input.
    """

    noun: str
    header: str
    self_test: str
    bits: tuple[Bit, ...]
    maps: tuple[MapView, ...]
    state: StateLayout
    out_fields: tuple[Field, ...]
    operations: Operations
    cuts: tuple[Cut, ...]
    start: tuple[str, ...]
    whole_range: tuple[str, ...]
    crossed: tuple[str, ...]
    late: tuple[Late, ...]
    move: Move
    sets: tuple[object, ...] = ()
    lengths: tuple[tuple[str, int], ...] = ()
    told: bool = True


def assign(array: str, values: Array, real: str) -> tuple[str, ...]:
    """Print one assignment per element."""
    return tuple(f"{array}[{i}] = {literal(v, real)};" for i, v in enumerate(values))


def vector_table(name: str, count: str, values: Array, real: str) -> Table:
    """Print a vector as a table."""
    return Table(name, f"[{count}]", (), tuple(f"{literal(v, real)}," for v in values))
