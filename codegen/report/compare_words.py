"""What other methods would give on the same plant, as a table: promises and cost side by side."""

from __future__ import annotations

from collections.abc import Sequence

from . import words
from .design_words import NEVER
from .table import Cell, Row, Table, table


def tables(design, compared: Sequence) -> tuple[Table, ...]:
    """Tabulate a comparison; nothing where none was run.

    Parameters
    ----------
    design : Design
    compared : sequence of Compared
        Of ``compare``.

    Returns
    -------
    tuple of Table
    """
    made = [c for c in compared if not c.reason]
    if not made:
        return ()
    plant, period = design.plant, design.plant.sample_period
    within = max((len(by) - 1 for c in made for by in c.faults), default=0)
    head = ("method", "#relative width", *(f"#{f.name}, {words.within(d, period)}" for f in plant.f
                                           for d in dict.fromkeys((0, within))), "#a mode lasts", "#multiply-adds",
            "#instructions", "#flash", "#RAM", "#stack")
    rows = []
    for c in made:
        sizes = [_size(by[d], f.unit) for by, f in zip(c.faults, plant.f) for d in dict.fromkeys((0, within))]
        cells = [Cell(c.name), *(Cell(text, "num") for text in (
            words.at_most(c.width, 3), *sizes, "any" if not c.dwell else words.number(c.dwell),
            *(words.NONE if n is None else words.integer(n) for n in (
                c.multiply, c.instructions, c.flash, c.ram, c.stack))))]
        rows.append(Row(tuple(cells), "chosen" if is_this(design, c) else ""))
    notes = ["Each was designed, certified, printed and compiled like this firmware, with the same number type and "
             "layout. Relative width: guaranteed, states in units of their ranges, summed. Columns named after a "
             "fault: the smallest step that is surely detected. A mode lasts: samples that the guarantee asks for. "
             "Multiply-adds: of the dearest call. Instructions: of the dearest ordinary step of its self-test, on "
             f"a simulated Cortex-M4F. Bytes for {words.listed(sorted({c.chip for c in made}))}, -Os.",
             *_reasons(compared)]
    return (table("Other methods on this plant", head, rows, notes),)


def is_this(design, c) -> bool:
    """Whether a row is the design of the report itself."""
    return (c.method, c.family, c.label) == (design.method, design.observer.family, design.choice[0]["design"])


def _size(x: float | None, unit: str) -> str:
    return NEVER if x is None else words.quantity(words.at_most(x), unit)


def _reasons(compared: Sequence) -> list[str]:
    """One line per reason why there is no design."""
    groups: dict[str, list[str]] = {}
    for c in compared:
        if c.reason:
            groups.setdefault(c.reason, []).append(c.name)
    return [f"No design: {words.listed(names)}: {reason}" for reason, names in groups.items()]
