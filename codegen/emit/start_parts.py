"""The table of a point observer that is started anew in every mode, as C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .families import Member, Word
from .maps import Names, Table
from .parts import Size
from .threshold_parts import limit_of, others_of, staged

Array = np.ndarray


@dataclass(frozen=True)
class StartView:
    """Sizes and tables; ``place`` are the statements that find the row of the tables, ``row`` its indices."""

    numbers: int
    sizes: tuple[Size, ...]
    place: tuple[str, ...]
    row: str
    starts: Table
    cap: str
    limit: Table
    widths: Table
    thresholds: Table
    by_table: tuple[Table, ...]


def view(t, names: Names) -> StartView:
    """Print the tables."""
    z, m = t.shape, names.macro
    parts, _, rows, count = z.h.shape

    def nested(name: str, values: Array, size: str) -> Table:
        return staged(name, values, size, names, lambda k: f"size {k}" if k < z.anew else "anew")

    return StartView(
        numbers=0,
        sizes=(Size("STAGES", f"{parts}U", "parts of the table, one per size of the start, and one for any error"),
               Size("ANEW", f"{z.anew}U", "that of any error"),
               Size("ROWS", f"{rows}U", "samples since the start; the last row is for all later"),
               Size("DIRECTIONS", f"{count}U", "directions in which the residual has a threshold; the outputs first")),
        place=(f"const uint32_t stage = {names.prefix}_stage(s);", f"const uint32_t row = {names.prefix}_row(s);"),
        row="[stage][in->mode][row]",
        starts=Table("start", f"[{m}_ANEW][{m}_NX]", (), tuple(f"{initialiser(row, t.real)}," for row in z.sizes)),
        cap=f"{z.cap}U", limit=limit_of(t, m), widths=nested("width", z.hx, "NX"),
        thresholds=nested("threshold", z.h, "DIRECTIONS"), by_table=others_of(t, m))


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    z = t.shape
    return [], [("stage", "", f"size of the start, 0 to {z.anew - 1}; {z.anew}: any error"),
                ("since", "", f"samples since the start, at most {z.cap}")], 0
