"""An affine map (``maps.MapSpec``) as straight-line code that serves one mode or several.

Products with 0 are left out and products with 1 need no multiplication. A coefficient that the modes share is
written in the code; those that differ lie in a row of a table, which the mode selects.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .cprint import REAL_BYTES, Term, constant, count_operations, paragraph, product, sum_lines
from .maps import MapSpec, Row, Statement, Straight, Table
from .pieces import bounds, mode_rows, unused

Array = np.ndarray


class Columns:
    """The columns of the table layout: coefficients that differ between modes, equal ones merged."""

    def __init__(self):
        self.values: list[Array] = []
        self.names: list[dict[str, None]] = []  # ordered sets
        self.literals: set[float] = set()

    def terms(self, name: str, values: Array, operand: str, real: str) -> list[Term]:
        """Return the term ``values[q] * operand`` ("" for a number alone): literal if all modes agree."""
        if np.all(values == values[0]):
            self.literals |= {abs(float(values[0]))} - ({0.0, 1.0} if operand else {0.0})
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
                     for line in mode_rows(mode, row, spec.names.real))
        return (Table("table", f"[{spec.names.macro}_MODES][{len(self.values)}U]", note, rows),)

    def flash(self, spec: MapSpec, multiply: int, add: int, modes: int) -> int:
        """Estimate the bytes of code and constants on a Cortex-M4F at -Os: as measured, within a tenth or two.

        A float is loaded, multiplied and added by one instruction each (the last two may be one); for double a
        library is called.
        """
        literals, columns, results = len(self.literals), len(self.values), len(spec.rows) * len(spec.sides)
        numbers = (literals + modes * columns) * REAL_BYTES[spec.names.real]
        if spec.names.real == "float64":
            return 16 * (multiply + add) + 8 * results + numbers
        return 4 * (literals + columns + max(multiply, add)) + 8 * results + numbers


def straight(spec: MapSpec, modes: Array, name: str, which: Iterable[int]) -> Straight:
    """Print the rows ``which`` as straight-line code that serves ``modes``, with a table where they differ."""
    columns, rows, operations = Columns(), [], np.zeros(2, dtype=int)
    for i in which:
        common = _common_terms(spec, columns, modes, i, "hi") if spec.shared else []
        sums = [(f"const {spec.names.real_type} common_{i}", common)] if common else []
        for side in spec.sides:
            start = [("+", f"common_{i}")] if common else []
            start = start if spec.shared else _common_terms(spec, columns, modes, i, side)
            sums.append((f"{spec.target(side)}[{i}]", start + _own_terms(spec, columns, modes, i, side)))
        operations += sum(np.array(count_operations(terms)) for _, terms in sums)
        rows.append(Row(spec.rows[i], _statements(spec, i, sums)))
    tables, (multiply, add) = columns.table(spec), map(int, operations)
    prologue = (f"const {spec.names.real_type} *const k = table[{spec.index}];",) if tables else ()
    text = [f"{s.target} {' '.join(s.lines)}" for row in rows for s in row.statements]
    return Straight(name, spec.equation, spec.parameters, unused(spec, [*text, *prologue]), tables, prologue,
                    tuple(rows), spec.tail, multiply, add, columns.flash(spec, multiply, add, len(modes)))


def _statements(spec: MapSpec, i: int, sums: list[tuple[str, list[Term]]]) -> tuple[Statement, ...]:
    """Print the sums of row i.

    Where both bounds use the same entries of the table, they are stored after both are known: a store between
    would make the compiler load those entries again.
    """
    real, stores = spec.names.real, []
    if len(spec.sides) > 1 and any("(k[" in text for _, terms in sums[-2:] for _, text in terms):
        stores = [Statement(target, (f"{side}_{i}",)) for side, (target, _) in zip(spec.sides, sums[-2:])]
        known = [(f"const {spec.names.real_type} {s}_{i}", terms) for s, (_, terms) in zip(spec.sides, sums[-2:])]
        sums = [*sums[:-2], *known]
    return (*(Statement(target, sum_lines(terms, real)) for target, terms in sums), *stores)


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
    same, opposite = bounds(spec, side)
    for j in range(values.shape[2]):
        entry, name = values[:, i, j], f"{spec.state.label(side)}[{i}][{j}]"
        if not spec.by_sign or (entry >= 0).all():
            terms += columns.terms(name, entry, f"{same}[{j}]", real)
        elif (entry <= 0).all():
            terms += columns.terms(name, entry, f"{opposite}[{j}]", real)
        else:  # the sign depends on the mode: one column per bound, one of them zero in each mode
            terms += columns.terms(f"pos({name})", np.maximum(entry, 0), f"{same}[{j}]", real)
            terms += columns.terms(f"-neg({name})", np.minimum(entry, 0), f"{opposite}[{j}]", real)
    terms += [("-", f"{spec.minus}[{i}]")] if spec.minus else []
    return terms + ([("+", f"{spec.plus}[{i}]")] if spec.plus else [])
