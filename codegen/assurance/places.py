"""Where every constant of a design stands in its C: read back from the file and compared with the tables.

The maps (framers forward, framers blind, residual bounds) are executed symbolically for each mode; every
coefficient must be the table's, none may be missing and none may be there that the tables do not know.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..emit import families, point_parts, view
from ..emit.maps import MapSpec, Names
from ..emit.varying import Varying
from ..errors import CertificateError
from . import own_places
from .c_reader import Source, apart, read, walk
from .point_places import read_sets
from .read_varying import read_varying
from .symbolic import NOWHERE, Affine, Coefficient, Machine

SIDES = ("lo", "hi")
NOTHING = "zero"  # the offset of a map that has none


@dataclass(frozen=True)
class Entry:
    """One number: its index, its value, the literal it was read from and all its lines.

    Without a literal: a product with 1 (the line is the operand's), or one with 0 (no line).
    """

    index: tuple[int, ...]
    value: float
    literal: str
    lines: tuple[int, ...]


@dataclass(frozen=True)
class Constant:
    """A vector or matrix of the tables, of one mode ("" for all), in one function of the C."""

    name: str
    mode: str
    function: str
    entries: tuple[Entry, ...]


def constants(design, real: str, layout: str, text: str, header: str) -> tuple[Constant, ...]:
    """Find every constant of the tables in the C.

    Parameters
    ----------
    design : Design
    real, layout : str
        Of the C.
    text, header : str
        Of ``<prefix>.c`` and ``<prefix>.h``.

    Returns
    -------
    tuple of Constant

    Raises
    ------
    CertificateError
        A constant differs, is missing, or is one too many.
    """
    d = view.build(design, real, layout)
    t = design.observer.tables[real]
    names = Names(d.prefix, d.macro, real, tuple(m.name for m in design.plant.modes),
                  tuple(m.name for m in d.modes))
    source, found = read(d.prefix, text, header), _Found()
    try:
        family, whole = design.observer.family, bool(d.sets)
        points = hasattr(t, "shape")
        specs = (point_parts.maps(t, names, d.x, d.y) if points else own_places.maps(family, t, names, d) if whole
                 else _maps(family, t, names, d))
        moved = getattr(t, "told", t)  # tables of the maps
        part = found if moved is t or family == "driven" else found.part("told_")
        for spec in specs:
            for q, mode in enumerate(names.modes):
                if isinstance(spec, Varying):
                    read_varying(source, spec, moved, q, mode, part)
                else:
                    _read_map(source, spec, q, mode, part)
        _read_checks(source, d, names.modes or ("",), t, found)
        if whole:
            plain = [spec.spec if isinstance(spec, Varying) else spec for spec in specs]
            apart = {f for f in source.functions if f.startswith(tuple(spec.name for spec in plain))}
            cuts = next((z.cuts for z in d.sets if family == "guided"), d.cuts)
            apart |= {c.name for c in (*d.checks, *cuts)}
            if points:
                read_sets(source, design, d, t, apart | {f"{d.prefix}_cut"}, found)
            else:
                _read_cuts(source, cuts, moved, part)
                own_places.read_own(source, design, d, t, apart, found)
        else:
            _read_ranges(source, d, t, found)
        _read_dwell(source, d.prefix, design.observer.supervision, found)
    except (LookupError, TypeError, ValueError, AttributeError) as error:  # an index out of range, a name unknown ...
        raise CertificateError(f"{source.name}: is not the C that residua prints ({type(error).__name__}: {error}). "
                               "Print it again.") from error
    return found.constants()


def _maps(family: str, t, names: Names, d) -> tuple[MapSpec | Varying, ...]:
    """Every map of the C; where the mode may be told late, those for the mode that is told now too."""
    specs = families.specs(family, t, names, d.x, d.y)
    if t.change is not None:
        return (*specs, *families.change_specs(t, names, d.x))
    return (*specs, *families.late_specs(*specs[1:], names)) if d.late else specs


class _Found:
    """Collects entries by constant; the same number read twice has two lines.

    ``stem`` is what names of a part begin with, whose tables have names that others have, too.
    """

    def __init__(self, entries: dict | None = None, stem: str = ""):
        self.entries: dict[tuple[str, str, str], dict[tuple[int, ...], Entry]] = {} if entries is None else entries
        self.stem = stem

    def part(self, stem: str) -> _Found:
        """The same collection for a part of the C."""
        return _Found(self.entries, stem)

    def add(self, name: str, mode: str, function: str, index: tuple[int, ...], expected, c: Coefficient) -> None:
        """Compare what was read with what is expected, and keep it; ``minus_C`` is -C."""
        if name.startswith("minus_"):
            name, expected, c = name.removeprefix("minus_"), -expected, Coefficient(-c.value, c.literal, c.line)
        if c.value != Fraction(float(expected)):
            where = f"line {c.line}" if c.line else "no line"
            raise CertificateError(f"{function}: {name}{list(index)}{f' of mode {mode!r}' if mode else ''} is "
                                   f"{float(c.value)!r} in the C ({where}), expected {float(expected)!r}. Print it "
                                   "again.")
        name = name if name == NOTHING else self.stem + name
        group = self.entries.setdefault((name, mode, function), {})
        old = group.get(index)
        lines = {*(old.lines if old else ()), *([c.line] if c.line else [])}
        literal = old.literal if old and old.literal else c.literal
        group[index] = Entry(index, float(expected), literal, tuple(sorted(lines)))

    def constants(self) -> tuple[Constant, ...]:
        """Return what was found, in the order in which it was read."""
        return tuple(Constant(*key, tuple(group.values())) for key, group in self.entries.items() if key[0] != NOTHING)


def _read_map(source: Source, spec: MapSpec, q: int, mode: str, found: _Found) -> None:
    """Execute a map in one mode and compare every row of both framers with the tables."""
    prefix = spec.names.prefix
    machine = Machine(source, spec.names.real, {"in->mode": q, "s->mode": q, "mode": q}, skip=apart(prefix))
    machine.call(spec.name)
    for side in spec.sides:
        ends = {"lo": SIDES, "hi": SIDES[::-1]}.get(side)
        for i in range(len(spec.rows)):
            row = dict(machine.memory.get(f"{spec.target(side)}[{i}]", {}))
            for part in spec.common:
                for j, value in enumerate(part.side(side)[q, i]):
                    found.add(part.label(side), mode, spec.name, (i, j), value, _take(row, f"{part.operand}[{j}]"))
            found.add(spec.offset.label(side), mode, spec.name, (i,), spec.offset.side(side)[q, i], _take(row, ""))
            for j, value in enumerate(spec.state.side(side)[q, i]):
                own, opposite = (f"{spec.state.operand}{'_' * bool(s) + s}[{j}]" for s in ends or ("", ""))
                operand = opposite if spec.by_sign and value < 0 else own
                found.add(spec.state.label(side), mode, spec.name, (i, j), value, _take(row, operand))
            read_last = spec.minus or spec.plus
            measured = _take(row, f"{read_last}[{i}]") if read_last else NOWHERE
            extra = [operand for operand, c in row.items() if c.value]
            if extra or measured.value != bool(spec.plus) - bool(spec.minus):
                raise CertificateError(f"{source.name}: row {i} of {spec.name} in mode {mode!r} has a term with "
                                       f"{', '.join(extra) or read_last} that the tables do not know. Print it again.")


def _take(row: Affine, operand: str) -> Coefficient:
    return row.pop(operand, NOWHERE)


def _read_checks(source: Source, d, modes: tuple[str, ...], t, found: _Found) -> None:
    """Read the input checks."""
    for check in d.checks:
        scheduled = check.vector == "theta"  # its bounds may be each mode's own
        for q, mode in enumerate(modes) if scheduled else ((0, ""),):
            machine = Machine(source, d.real, {"in->mode": q})
            machine.call(check.name)
            bounds = {(operand, op): c for operand, op, c in machine.compared}
            for side, op in (("lo", ">="), ("hi", "<=")):
                name = f"{check.vector}_{side}"
                for i, value in enumerate(getattr(t.vary, name)[q] if scheduled else getattr(t, name)):
                    found.add(name, mode, check.name, (i,), value,
                              bounds.pop((f"in->{check.vector}[{i}]", op), NOWHERE))
            if bounds:
                raise CertificateError(f"{source.name}: {check.name} compares {', '.join(o for o, _ in bounds)} with "
                                       "what the tables do not know. Print it again.")


def _read_cuts(source: Source, cuts, t, found: _Found) -> None:
    """Read the ranges that bounds are cut to."""
    for cut, tables in zip(cuts, (t, t.change)):
        machine = Machine(source, t.real, clip=frozenset({f"{cut.name.rpartition('_cut')[0]}_clip"}))
        machine.call(cut.name)
        for framer in SIDES:
            for i in range(len(t.x_lo)):
                place = f"{cut.vector}_{framer}[{i}]"
                kept = set(machine.memory.get(place, {})) == {place}
                for side, c in zip(SIDES, machine.clipped[place] if kept else (NOWHERE, NOWHERE)):
                    name = f"{cut.vector}_{side}"
                    found.add(name, "", cut.name, (i,), getattr(tables, name)[i], c)


def _read_ranges(source: Source, d, t, found: _Found) -> None:
    """Read the cut and the boxes to start from."""
    _read_cuts(source, d.cuts, t, found)
    for function, vector in (("init", "x0"), ("whole_range", "x")):
        machine = Machine(source, d.real, skip=apart(d.prefix) | {f"{d.prefix}_clear"})
        machine.call(f"{d.prefix}_{function}")
        for side in SIDES:
            for i, value in enumerate(getattr(t, f"{vector}_{side}")):
                stored = machine.memory.get(f"s->x_{side}[{i}]", {})
                c = stored[""] if set(stored) == {""} else NOWHERE
                found.add(f"{vector}_{side}", "", f"{d.prefix}_{function}", (i,), value, c)


def _read_dwell(source: Source, prefix: str, s, found: _Found) -> None:
    """Read the leaky bucket's integers: what a sample takes out, what a switch puts in, what is too much."""
    if not s.monitors_dwell:
        return
    function = f"{prefix}_watch_dwell"
    uses = []
    for node in walk(source.function(function)):
        left, right = (getattr(node, a, None) or getattr(node, b, None)
                       for a, b in (("lvalue", "left"), ("rvalue", "right")))
        if getattr(getattr(left, "field", None), "name", "") == "bucket" and type(right).__name__ == "Constant":
            literal = right.value
            uses.append((node.op, Coefficient(Fraction(int(literal.rstrip("U"))), literal, right.coord.line)))
    expected = [(">", s.dwell_drain, "dwell_drain"), ("-=", s.dwell_drain, "dwell_drain"), ("=", 0, ""),
                ("+=", s.dwell_add, "dwell_add"), (">", s.dwell_limit, "dwell_limit"),
                ("=", s.dwell_limit, "dwell_limit"), ("==", 0, "")]
    if [op for op, _ in uses] != [op for op, _, _ in expected]:
        raise CertificateError(f"{source.name}: {function} does not handle the bucket as expected. Print it again.")
    for (_, c), (_, value, name) in zip(uses, expected):
        if name:
            found.add(name, "", function, (), np.int64(value), c)
        elif c.value:
            raise CertificateError(f"{source.name}:{c.line}: {function} has {c.literal} (expected 0U). Print it again.")
