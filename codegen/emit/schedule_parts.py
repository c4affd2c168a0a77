"""The list of thresholds along a schedule, as C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .families import Member, Word
from .maps import Names, Table
from .parts import Size
from .threshold_parts import limit_of, others_of

Array = np.ndarray


@dataclass(frozen=True)
class ScheduleView:
    """Sizes and tables; ``cycle`` and ``entry`` are numbers, ``place`` the statement that finds the row, ``row`` it."""

    numbers: int
    sizes: tuple[Size, ...]
    place: tuple[str, ...]
    row: str
    cycle: tuple[str, ...]
    entry: tuple[str, ...]
    limit: Table
    widths: Table
    thresholds: Table
    by_table: tuple[Table, ...]


def view(t, names: Names) -> ScheduleView:
    """Print the tables."""
    z, m = t.shape, names.macro
    notes = [f"from the initial box, sample {k}" for k in range(z.rows)]
    notes += [f"anew, sample {k}, {mode}" for k in range(z.rows) for mode in names.modes]
    notes += [f"for ever, phase {k}, {names.modes[q]}" for k, q in enumerate(z.cycle)]

    def rows(name: str, values: Array, size: str) -> Table:
        lines = tuple(f"{initialiser(row, t.real)}, /* {note} */" for row, note in zip(values, notes))
        return Table(name, f"[{m}_ROWS][{m}_{size}]", (), lines)

    return ScheduleView(
        numbers=0,
        sizes=(Size("PERIOD", f"{len(z.cycle)}U", "samples after which the schedule repeats"),
               Size("BEGIN", f"{z.rows}U", "rows from the initial box, one per sample; as many anew, for each mode"),
               Size("SETTLED", f"(2U * {m}_BEGIN)", "count from which on the phase alone decides"),
               Size("ROWS", f"({m}_BEGIN + ({m}_BEGIN * {m}_MODES) + {m}_PERIOD)", "rows of the table"),
               Size("DIRECTIONS", f"{z.h.shape[1]}U",
                    "directions in which the residual has a threshold; the outputs first")),
        place=(f"const uint32_t row = {names.prefix}_row(s, in);",), row="[row]",
        cycle=tuple(f"{q}U" for q in z.cycle), entry=tuple(f"{k}U" for k in z.entry), limit=limit_of(t, m),
        widths=rows("width", z.hx, "NX"), thresholds=rows("threshold", z.h, "DIRECTIONS"), by_table=others_of(t, m))


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    z, m = t.shape, names.macro
    return [], [("phase_at", "", f"sample of the schedule, 0 to {len(z.cycle) - 1}; {m}_PERIOD: not known"),
                ("since", "", f"samples since the initial box, from {z.rows} on since the table started anew; "
                              f"{z.settled}: long ago")], 0
