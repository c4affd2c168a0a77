"""The table of a point observer without set arithmetic, as C."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .families import Member, Word
from .maps import Names, Table
from .parts import Operations, Size

Array = np.ndarray


@dataclass(frozen=True)
class ThresholdView:
    """Sizes and tables; ``switches`` has an entry where there are several modes, ``stays`` where there is one.

    ``short`` is the dwell time where it is more than a sample, and the entry of ``switches`` what follows on it.

    ``place`` are the statements that find the row of the tables, ``row`` its indices.

    ``reads`` is the second parameter of the function that counts, where it needs one.
    """

    numbers: int
    sizes: tuple[Size, ...]
    place: tuple[str, ...]
    row: str
    reads: str
    switches: tuple[str, ...]
    short: tuple[str, ...]
    stays: tuple[str, ...]
    cap: str
    limit: Table
    widths: Table
    thresholds: Table
    by_table: tuple[Table, ...]


def staged(name: str, values: Array, size: str, names: Names, words: Callable[[int], str]) -> Table:
    """Print a table by stage, mode and row; ``words`` says what a stage is."""
    lines = []
    for s, by_mode in enumerate(values):
        lines.append("{")
        for mode, rows in zip(names.modes, by_mode, strict=True):
            lines.append(f"    {{ /* {words(s)}, {mode} */")
            lines += [f"        {initialiser(row, names.real)}," for row in rows]
            lines.append("    },")
        lines.append("},")
    m = names.macro
    return Table(name, f"[{m}_STAGES][{m}_MODES][{m}_ROWS][{m}_{size}]", (), tuple(lines))


def view(t, names: Names) -> ThresholdView:
    """Print the tables."""
    z, m = t.shape, names.macro
    stages, modes, rows, count = z.h.shape

    def nested(name: str, values: Array, size: str) -> Table:
        return staged(name, values, size, names, lambda s: stage_words(s, z.anew))

    return ThresholdView(
        numbers=0,
        sizes=(Size("STAGES", f"{stages}U", "stages of the table, those from the initial box first"),
               Size("ANEW", f"{z.anew}U", "first stage of those from anywhere"),
               Size("ROWS", f"{rows}U", "samples since the mode was entered; the last row is for all later"),
               Size("DIRECTIONS", f"{count}U", "directions in which the residual has a threshold; the outputs first")),
        place=(f"const uint32_t stage = {names.prefix}_stage(s);", f"const uint32_t row = {names.prefix}_row(s);"),
        row="[stage][in->mode][row]", reads=f", const {names.prefix}_in *in" if modes > 1 else "",
        switches=("if" if z.dwell == 1 else "else if",) * (modes > 1),
        short=(f"{z.dwell}U",) * (z.dwell > 1),
        stays=("",) * (modes == 1), cap=f"{z.cap}U",
        limit=limit_of(t, m), widths=nested("width", z.hx, "NX"), thresholds=nested("threshold", z.h, "DIRECTIONS"),
        by_table=others_of(t, m))


def limit_of(t, m: str) -> Table:
    """Print the box that the estimate stays in."""
    return Table("limit", f"[{m}_NX]", (), (initialiser(t.box, t.real).strip("{} ") + ",",))


def others_of(t, m: str) -> tuple[Table, ...]:
    """Print the directions that are no coordinates, if there are any."""
    more = t.shape.directions[t.C.shape[1]:]
    return (Table("direction", f"[{m}_DIRECTIONS - {m}_NY][{m}_NY]", (),
                  tuple(f"{initialiser(d, t.real)}," for d in more)),) * bool(len(more))


def stage_words(stage: int, anew: int) -> str:
    """Name a stage in a comment."""
    switches = stage if stage < anew else stage - anew
    return ("from the initial box" if stage < anew else "anew") + (f", after {switches} switches" if switches else "")


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    z = t.shape
    return [], [("stage", "", f"stage of the table, 0 to {len(z.h) - 1}; {z.anew}: anew"),
                ("since", "", f"samples since the mode was entered or the table started, at most {z.cap}")], 0


def operations(t) -> Operations:
    """Count the dearest sample: directions that are no coordinates, thresholds, the box of the estimate."""
    n, n_y, rows = len(t.box), t.C.shape[1], len(t.shape.directions) - t.C.shape[1]
    return Operations(rows * n_y, rows * n_y, 2 * n + 2 * n_y + 2 * rows)
