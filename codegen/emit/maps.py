"""The three affine maps of the interval family as C: framers forward, framers blind, residual bounds.

All three have one form. Row i of mode q is::

    lo = common + o_lo + S_lo . x - z,     hi = common + o_hi + S_hi . x - z,     common = sum of K_j v_j,

where S takes, per entry, the bound of x that its sign asks for, and z is the measurement or nothing. A
``MapSpec`` states such a map, ``MapView`` is what a template prints of it; ``layouts`` leads from one to
the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Linear:
    """A matrix (or vector) per mode, for both framers, and what it is multiplied with.

    Parameters
    ----------
    name : str
    lo, hi : ndarray (N, rows, columns) or (N, rows)
    operand : str
        C array; for the state the stem of ``<operand>_lo`` and ``<operand>_hi``.
    count : str
        Macro with the number of columns.
    """

    name: str
    lo: Array
    hi: Array
    operand: str = ""
    count: str = ""

    def side(self, side: str) -> Array:
        """Return the values of the framer "lo" or "hi"."""
        return self.hi if side == "hi" else self.lo

    def label(self, side: str) -> str:
        """Return the name, with the framer's suffix where the two differ."""
        return self.name if np.array_equal(self.lo, self.hi) else f"{self.name}_{side}"


@dataclass(frozen=True)
class Names:
    """Names that all maps of a design share.

    ``prefix`` and ``macro`` start functions and macros, ``real`` is "float32" or "float64", ``modes`` are
    the modes' names for comments and ``mode_macros`` their macros. ``checked``: who calls the functions has seen that
    the mode in the state is one.
    """

    prefix: str
    macro: str
    real: str
    modes: tuple[str, ...]
    mode_macros: tuple[str, ...]
    checked: bool = False

    @property
    def last(self) -> str:
        """The mode in the state as an index, which an upset of the memory must not lead out of a table."""
        return "s->mode" if self.checked else f"(s->mode < {self.macro}_MODES) ? s->mode : 0U"

    @property
    def real_type(self) -> str:
        """The C type of the numbers."""
        return f"{self.prefix}_real"


@dataclass(frozen=True)
class MapSpec:
    """One affine map, before a layout is chosen.

    Parameters
    ----------
    name : str
        C function.
    equation : tuple of str
        Its heading.
    parameters : tuple of str
        C parameters; ``s``, ``in`` and ``out`` are pointers to the state, input and output structs.
    selector, index : str
        C expressions of the mode: for a switch with a default branch, and as an index that is always in
        range.
    target_lo, target_hi : str
        C arrays that take the result. Never the arrays that are read.
    rows : tuple of str
        What each row is, for comments.
    common : tuple of Linear
    shared : bool
        Both framers have the same common part: it is computed once.
    offset : Linear
    state : Linear
        S.
    by_sign : bool
        S may have negative entries, which take the opposite bound.
    minus, plus : str
        C array subtracted (added) at the end, or empty.
    tail : tuple of str
        Statements after the last row.
    row_count : str
        Macro with the number of rows.
    names : Names
    sides : tuple of str
        "lo" and "hi"; or "" alone for a map of points, whose target, offset and state are the single ones.
    """

    name: str
    equation: tuple[str, ...]
    parameters: tuple[str, ...]
    selector: str
    index: str
    target_lo: str
    target_hi: str
    rows: tuple[str, ...]
    common: tuple[Linear, ...]
    shared: bool
    offset: Linear
    state: Linear
    by_sign: bool
    minus: str
    tail: tuple[str, ...]
    row_count: str
    names: Names
    sides: tuple[str, ...] = ("lo", "hi")
    plus: str = ""

    def target(self, side: str) -> str:
        """Return the C array that takes the bound "lo" or "hi"."""
        return self.target_hi if side == "hi" else self.target_lo


@dataclass(frozen=True)
class Table:
    """A ``static const`` array: declarator and initialiser, both printed."""

    name: str
    size: str
    note: tuple[str, ...]
    rows: tuple[str, ...]


@dataclass(frozen=True)
class Statement:
    """``target = lines``; one term per line."""

    target: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Row:
    """Statements of one row, under its comment."""

    note: str
    statements: tuple[Statement, ...]


@dataclass(frozen=True)
class Straight:
    """One function of straight-line code.

    ``unused`` are parameters it does not need, ``prologue`` its first declarations, ``multiply`` and
    ``add`` its floating-point operations, ``flash`` its bytes as estimated, to choose between layouts.
    """

    name: str
    equation: tuple[str, ...]
    parameters: tuple[str, ...]
    unused: tuple[str, ...]
    tables: tuple[Table, ...]
    prologue: tuple[str, ...]
    rows: tuple[Row, ...]
    tail: tuple[str, ...]
    multiply: int
    add: int
    flash: int

    @property
    def compare(self) -> int:
        """Comparisons, as printed."""
        lines = [line for row in self.rows for s in row.statements for line in s.lines]
        return sum(line.count(" < ") + line.count(" > ") for line in lines)


@dataclass(frozen=True)
class Inner:
    """An inner loop over j: its bound and its statements."""

    count: str
    updates: tuple[str, ...]


@dataclass(frozen=True)
class Stage:
    """Statements of the outer loop, then inner loops."""

    lines: tuple[str, ...]
    inner: tuple[Inner, ...]


@dataclass(frozen=True)
class Loops:
    """One function of loops; fields as in ``Straight``."""

    name: str
    equation: tuple[str, ...]
    parameters: tuple[str, ...]
    unused: tuple[str, ...]
    tables: tuple[Table, ...]
    prologue: tuple[str, ...]
    count: str
    stages: tuple[Stage, ...]
    tail: tuple[str, ...]
    multiply: int
    add: int
    flash: int
    compare: int = 0


@dataclass(frozen=True)
class Case:
    """One branch of a switch: its labels and the function it calls."""

    labels: tuple[str, ...]
    call: str


@dataclass(frozen=True)
class Switch:
    """The function that selects a mode's straight-line code.

    ``first`` is what all modes do before; ``last`` serves the default branch too.
    """

    name: str
    equation: tuple[str, ...]
    parameters: tuple[str, ...]
    selector: str
    first: tuple[str, ...]
    cases: tuple[Case, ...]
    last: Case


@dataclass(frozen=True)
class MapView:
    """A map in its layout: straight-line functions, then a switch between them, or one function of loops."""

    straights: tuple[Straight, ...] = ()
    loops: tuple[Loops, ...] = ()
    switches: tuple[Switch, ...] = ()

    @property
    def operations(self) -> Array:
        """Multiplications, additions and comparisons of the dearest mode, the tail apart; an int array (3,)."""
        bodies = (*self.straights, *self.loops)
        always = [b for b in bodies if any(b.name in line for s in self.switches for line in s.first)]
        others = [b for b in bodies if b not in always]
        counts = [[(b.multiply, b.add, b.compare) for b in some] or [(0, 0, 0)] for some in (always, others)]
        return np.sum(counts[0], axis=0) + np.max(counts[1], axis=0)
