"""The layouts: how an affine map (``maps.MapSpec``) becomes C.

    literal   one function of straight-line code per mode, constants in the code, and a switch;
    table     one function of straight-line code over a row of coefficients that the mode selects;
    loop      one function of loops over matrices.

All do the additions in the order of ``codegen.observers.framer``, so their results are ``==``. Products
with 0 are left out and products with 1 need no multiplication where the code is straight.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .cprint import (
    Term,
    constant,
    count_operations,
    initialiser,
    literal,
    paragraph,
    product,
    sum_lines,
)
from .maps import Case, Inner, Linear, Loops, MapSpec, MapView, Row, Stage, Statement, Straight, Switch, Table

Array = np.ndarray
LAYOUTS = ("literal", "table", "loop")
SIDES = ("lo", "hi")


class Columns:
    """The columns of the table layout: coefficients that differ between modes, equal ones merged."""

    def __init__(self):
        self.values: list[Array] = []
        self.names: list[dict[str, None]] = []  # ordered sets

    def terms(self, name: str, values: Array, operand: str, real: str) -> list[Term]:
        """Return the term ``values[q] * operand`` ("" for a number alone): literal if all modes agree."""
        if np.all(values == values[0]):
            return product(float(values[0]), operand, real) if operand else constant(float(values[0]), real)
        index = next((i for i, known in enumerate(self.values) if np.array_equal(known, values)), None)
        if index is None:
            index = len(self.values)
            self.values.append(values)
            self.names.append({})
        self.names[index][name] = None
        return [("+", f"(k[{index}] * {operand})" if operand else f"k[{index}]")]

    def table(self, spec: MapSpec) -> tuple[Table, ...]:
        """Return the table, or none if every coefficient is the same in all modes."""
        if not self.values:
            return ()
        columns = paragraph(", ".join(f"{i} {' = '.join(names)}" for i, names in enumerate(self.names)),
                            "/* columns: ", " * ")
        note = (*columns[:-1], f"{columns[-1]} */")
        rows = tuple(line for mode, row in zip(spec.names.modes, np.stack(self.values, axis=1))
                     for line in _mode_rows(mode, row, spec.names.real))
        return (Table("table", f"[{spec.names.macro}_MODES][{len(self.values)}U]", note, rows),)


def lay_out(spec: MapSpec, layout: str) -> MapView:
    """Print the map in the layout "literal", "table" or "loop"."""
    everything = np.arange(len(spec.names.modes))
    if layout == "loop":
        return MapView(loops=(LoopPrinter(spec).loops(),))
    if layout == "table" or len(everything) == 1:
        return MapView(straights=(straight(spec, everything, spec.name),))
    bodies = [straight(spec, everything[[q]], f"{spec.name}_{q}") for q in everything]
    groups: dict[tuple, list[int]] = {}  # modes with the same code share it
    for q, body in enumerate(bodies):
        groups.setdefault(body.rows, []).append(q)
    if len(groups) == 1:
        return MapView(straights=(straight(spec, everything, spec.name),))
    arguments = ", ".join(_pointers(spec))
    cases = [Case(tuple(spec.names.mode_macros[q] for q in group), f"{bodies[group[0]].name}({arguments})")
             for group in groups.values()]
    named = [replace(bodies[group[0]], equation=(" and ".join(f'Mode "{spec.names.modes[q]}"' for q in group) + ".",))
             for group in groups.values()]
    switch = Switch(spec.name, spec.equation, spec.parameters, spec.selector, tuple(cases[:-1]), cases[-1])
    return MapView(straights=tuple(named), switches=(switch,))


def straight(spec: MapSpec, modes: Array, name: str) -> Straight:
    """Print straight-line code that serves ``modes``, with a table where they differ."""
    columns, rows, operations = Columns(), [], np.zeros(2, dtype=int)
    for i, note in enumerate(spec.rows):
        common = _common_terms(spec, columns, modes, i, "hi") if spec.shared else []
        sums = [(f"const {spec.names.real_type} common_{i}", common)] if common else []
        for side in SIDES:
            start = [("+", f"common_{i}")] if common else []
            start = start if spec.shared else _common_terms(spec, columns, modes, i, side)
            sums.append((f"{spec.target(side)}[{i}]", start + _own_terms(spec, columns, modes, i, side)))
        operations += sum(np.array(count_operations(terms)) for _, terms in sums)
        rows.append(Row(note, tuple(Statement(target, sum_lines(terms, spec.names.real)) for target, terms in sums)))
    tables = columns.table(spec)
    prologue = (f"const {spec.names.real_type} *const k = table[{spec.index}];",) if tables else ()
    text = [f"{s.target} {' '.join(s.lines)}" for row in rows for s in row.statements]
    return Straight(name, spec.equation, spec.parameters, _unused(spec, [*text, *prologue]), tables, prologue,
                    tuple(rows), spec.tail, int(operations[0]), int(operations[1]))


def _common_terms(spec: MapSpec, columns: Columns, modes: Array, i: int, side: str) -> list[Term]:
    """Terms of inputs and outputs in row i, in evaluation order."""
    terms: list[Term] = []
    for part in spec.common:
        values = part.side(side)[modes]
        for j in range(values.shape[2]):
            name = f"{part.label(side)}[{i}][{j}]"
            terms += columns.terms(name, values[:, i, j], f"{part.operand}[{j}]", spec.names.real)
    return terms


def _own_terms(spec: MapSpec, columns: Columns, modes: Array, i: int, side: str) -> list[Term]:
    """Offset, state terms and measurement of one bound in row i."""
    real = spec.names.real
    terms = columns.terms(f"{spec.offset.label(side)}[{i}]", spec.offset.side(side)[modes][:, i], "", real)
    values = spec.state.side(side)[modes]
    same, opposite = (f"{spec.state.operand}_{s}" for s in (SIDES if side == "lo" else SIDES[::-1]))
    for j in range(values.shape[2]):
        entry, name = values[:, i, j], f"{spec.state.label(side)}[{i}][{j}]"
        if not spec.by_sign or (entry >= 0).all():
            terms += columns.terms(name, entry, f"{same}[{j}]", real)
        elif (entry <= 0).all():
            terms += columns.terms(name, entry, f"{opposite}[{j}]", real)
        else:  # the sign depends on the mode: one column per bound, one of them zero in each mode
            terms += columns.terms(f"pos({name})", np.maximum(entry, 0), f"{same}[{j}]", real)
            terms += columns.terms(f"-neg({name})", np.minimum(entry, 0), f"{opposite}[{j}]", real)
    return terms + ([("-", f"{spec.minus}[{i}]")] if spec.minus else [])


def _unused(spec: MapSpec, text: Iterable[str]) -> tuple[str, ...]:
    """Return the pointer parameters that the printed code does not touch."""
    code = " ".join([*text, *spec.tail])
    return tuple(p for p in _pointers(spec) if f"{p}->" not in code)


def _pointers(spec: MapSpec) -> tuple[str, ...]:
    """Return the names of the parameters, all of which are pointers."""
    return tuple(parameter.split("*")[-1] for parameter in spec.parameters)


def _mode_rows(mode: str, value: Array, real: str) -> list[str]:
    """Print one mode's part of a table, long vectors over several lines."""
    if value.ndim == 1 and len(value) <= 6:
        return [f"{initialiser(value, real)}, /* {mode} */"]
    parts = value if value.ndim == 2 else [value[i:i + 6] for i in range(0, len(value), 6)]
    lines = [initialiser(part, real) for part in parts]
    lines = lines if value.ndim == 2 else [line.strip("{} ") for line in lines]
    return [f"{{ /* {mode} */", *(f"    {line}," for line in lines[:-1]), f"    {lines[-1]}", "},"]


class LoopPrinter:
    """Prints a map as loops over matrices; a matrix that is equal in all modes is stored once."""

    def __init__(self, spec: MapSpec):
        self.spec = spec
        self.tables: list[Table] = []
        self.multiply = 0

    def loops(self) -> Loops:
        """Print the whole function."""
        spec, names = self.spec, self.spec.names
        sums = ("common",) if spec.shared else SIDES
        inner = tuple(i for part in spec.common for i in self._common(part))
        offsets = {side: self._entry(spec.offset.label(side), spec.offset.side(side)) for side in SIDES}
        zero = literal(0.0, names.real)
        stages = [Stage(tuple(f"{names.real_type} {s} = {zero};" for s in sums), inner)] if inner else []
        if spec.shared or not inner:
            start = "common + " if inner else ""
            lines = tuple(f"{names.real_type} {side} = {start}{offsets[side]};" for side in SIDES)
        else:
            lines = tuple(f"{side} += {offsets[side]};" for side in SIDES)
        stages.append(Stage(lines, (self._state(),)))
        end = f" - {spec.minus}[i]" if spec.minus else ""
        stages.append(Stage(tuple(f"{spec.target(side)}[i] = {side}{end};" for side in SIDES), ()))
        by_mode = any(t.size.startswith(f"[{names.macro}_MODES]") for t in self.tables)
        prologue = (f"const uint32_t q = {spec.index};",) if by_mode else ()
        text = [line for stage in stages for line in (*stage.lines, *(u for i in stage.inner for u in i.updates))]
        add = self.multiply + len(spec.rows) * (4 if spec.minus else 2)
        return Loops(spec.name, spec.equation, spec.parameters, _unused(spec, [*text, *prologue]),
                     tuple(self.tables), prologue, spec.row_count, tuple(stages), spec.tail, self.multiply, add)

    def _entry(self, name: str, values: Array, count: str = "") -> str:
        """Store a table; return how its row i (and column j, of ``count``) is written."""
        spec, real = self.spec, self.spec.names.real
        size = f"[{spec.row_count}]" + (f"[{count}]" if count else "")
        index = "[i][j]" if count else "[i]"
        if np.all(values == values[0]):
            rows, mode = [f"{initialiser(row, real)}," for row in values[0]], ""
        else:
            rows = [line for mode, value in zip(spec.names.modes, values) for line in _mode_rows(mode, value, real)]
            size, mode = f"[{spec.names.macro}_MODES]{size}", "[q]"
        if all(t.name != name for t in self.tables):
            self.tables.append(Table(name, size, (), tuple(rows)))
        return f"{name}{mode}{index}"

    def _common(self, part: Linear) -> list[Inner]:
        """Print the loop that adds K v; none if K is zero in every mode."""
        if not (np.any(part.lo) or np.any(part.hi)):
            return []
        sides = {"common": "hi"} if self.spec.shared else {side: side for side in SIDES}
        cells = {total: self._entry(part.label(side), part.side(side), part.count) for total, side in sides.items()}
        self.multiply += len(cells) * part.lo[0].size
        return [Inner(part.count, tuple(f"{total} += ({cell} * {part.operand}[j]);"
                                        for total, cell in cells.items()))]

    def _state(self) -> Inner:
        """Print the loop over S; where entries may be negative, their sign selects the bound."""
        state, zero, updates = self.spec.state, literal(0.0, self.spec.names.real), []
        signed = self.spec.by_sign and (np.any(state.lo < 0) or np.any(state.hi < 0))
        for side, other in (SIDES, SIDES[::-1]):
            cell = self._entry(state.label(side), state.side(side), state.count)
            own, opposite = f"{state.operand}_{side}[j]", f"{state.operand}_{other}[j]"
            own = f"(({cell} >= {zero}) ? {own} : {opposite})" if signed else own
            updates.append(f"{side} += ({cell} * {own});")
        self.multiply += 2 * state.lo[0].size
        return Inner(state.count, tuple(updates))
