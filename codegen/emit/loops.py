"""An affine map (``maps.MapSpec``) as one function of loops over matrices."""

from __future__ import annotations

import numpy as np

from .cprint import REAL_BYTES, initialiser, literal
from .maps import Inner, Linear, Loops, MapSpec, Stage, Table
from .pieces import bounds, mode_rows, unused

Array = np.ndarray


class LoopPrinter:
    """Prints a map as loops over matrices; a matrix that is equal in all modes is stored once."""

    def __init__(self, spec: MapSpec):
        self.spec = spec
        self.tables: list[Table] = []
        self.multiply = self.compare = 0
        self.numbers = 0
        self.apart = spec.shared and len(spec.sides) > 1  # the common part is a sum of its own

    def loops(self) -> Loops:
        """Print the whole function."""
        spec, names = self.spec, self.spec.names
        sums = ("common",) if self.apart else tuple(map(_total, spec.sides))
        inner = tuple(i for part in spec.common for i in self._common(part))
        stages = [Stage(tuple(f"{names.real_type} {s} = {literal(0.0, names.real)};" for s in sums), inner)]
        starts = {side: [*["common"] * (self.apart and bool(inner)), *self._offset(side)] for side in spec.sides}
        if self.apart or not inner:
            stages = stages if inner else []
            lines = tuple(f"{names.real_type} {_total(side)} = {' + '.join(start) or literal(0.0, names.real)};"
                          for side, start in starts.items())
        else:
            lines = tuple(f"{_total(side)} += {start[0]};" for side, start in starts.items() if start)
        stages.append(Stage(lines, (self._state(),)))
        end = f" - {spec.minus}[i]" if spec.minus else f" + {spec.plus}[i]" if spec.plus else ""
        stages.append(Stage(tuple(f"{spec.target(side)}[i] = {_total(side)}{end};" for side in spec.sides), ()))
        by_mode = any(t.size.startswith(f"[{names.macro}_MODES]") for t in self.tables)
        prologue = (f"const uint32_t q = {spec.index};",) if by_mode else ()
        text = [line for stage in stages for line in (*stage.lines, *(u for i in stage.inner for u in i.updates))]
        add = self.multiply + len(spec.rows) * len(spec.sides) * (2 if end else 1)
        return Loops(spec.name, spec.equation, spec.parameters, unused(spec, [*text, *prologue]), tuple(self.tables),
                     prologue, spec.row_count, tuple(stages), spec.tail, self.multiply, add, self._flash(stages),
                     self.compare)

    def _flash(self, stages: list[Stage]) -> int:
        """Estimate the bytes of code and constants on a Cortex-M4F at -Os: as measured, within a tenth or two."""
        updates = [u for stage in stages for inner in stage.inner for u in inner.updates]
        each = 30 if self.spec.names.real == "float32" else 70  # double: calls of a library
        choices = any(" ? " in u for u in updates)
        return 40 + each * (len(updates) + choices) + REAL_BYTES[self.spec.names.real] * self.numbers

    def _offset(self, side: str) -> list[str]:
        """Return how the offset's row i is written; nothing if it is zero in every mode."""
        offset = self.spec.offset
        return [self._entry(offset.label(side), offset.side(side))] if np.any(offset.side(side)) else []

    def _entry(self, name: str, values: Array, count: str = "") -> str:
        """Store a table; return how its row i (and column j, of ``count``) is written."""
        spec, real = self.spec, self.spec.names.real
        size = f"[{spec.row_count}]" + (f"[{count}]" if count else "")
        index = "[i][j]" if count else "[i]"
        if np.all(values == values[0]):
            rows, mode = [f"{initialiser(row, real)}," for row in values[0]], ""
        else:
            rows = [line for mode, value in zip(spec.names.modes, values) for line in mode_rows(mode, value, real)]
            size, mode = f"[{spec.names.macro}_MODES]{size}", "[q]"
        if all(t.name != name for t in self.tables):
            self.numbers += values.size if mode else values[0].size
            self.tables.append(Table(name, size, (), tuple(rows)))
        return f"{name}{mode}{index}"

    def _common(self, part: Linear) -> list[Inner]:
        """Print the loop that adds K v; none if K is zero in every mode."""
        if not (np.any(part.lo) or np.any(part.hi)):
            return []
        sides = {"common": "hi"} if self.apart else {_total(side): side for side in self.spec.sides}
        cells = {total: self._entry(part.label(side), part.side(side), part.count) for total, side in sides.items()}
        self.multiply += len(cells) * part.lo[0].size
        return [Inner(part.count, tuple(f"{total} += ({cell} * {part.operand}[j]);"
                                        for total, cell in cells.items()))]

    def _state(self) -> Inner:
        """Print the loop over S; where entries may be negative, their sign selects the bound."""
        state, zero, updates = self.spec.state, literal(0.0, self.spec.names.real), []
        signed = self.spec.by_sign and (np.any(state.lo < 0) or np.any(state.hi < 0))
        for side in self.spec.sides:
            cell = self._entry(state.label(side), state.side(side), state.count)
            own, opposite = (f"{bound}[j]" for bound in bounds(self.spec, side))
            own = f"(({cell} >= {zero}) ? {own} : {opposite})" if signed else own
            updates.append(f"{_total(side)} += ({cell} * {own});")
        self.multiply += len(self.spec.sides) * state.lo[0].size
        self.compare += len(self.spec.sides) * state.lo[0].size * bool(signed)
        return Inner(state.count, tuple(updates))


def _total(side: str) -> str:
    """Return the name of the running sum of one bound."""
    return side or "total"
