"""The views that the HTML template prints: tables, cells, sections; all decided, all text."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup


@dataclass(frozen=True)
class Cell:
    """One cell: its text, and a CSS class ("", "num", "ok", "bad", "warn")."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Row:
    """One row; ``kind`` is a CSS class ("" or "chosen")."""

    cells: tuple[Cell, ...]
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table with its caption and remarks below it."""

    caption: str
    head: tuple[Cell, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Folded:
    """Tables that are shown on a click."""

    summary: str
    tables: tuple[Table, ...]


@dataclass(frozen=True)
class Plot:
    """An inline SVG and the words below it, if any."""

    svg: Markup
    caption: str

    @property
    def captions(self) -> tuple[str, ...]:
        """The words, where there are some."""
        return (self.caption,) if self.caption else ()


@dataclass(frozen=True)
class Fact:
    """A term and what is to be said of it; ``kind`` is a CSS class ("" or "mono")."""

    term: str
    text: str
    kind: str = ""


@dataclass(frozen=True)
class Link:
    """A file of the folder."""

    name: str
    text: str


def table(caption: str, head, rows, notes=()) -> Table:
    """Make a table from plain rows.

    Parameters
    ----------
    caption : str
    head : sequence of str
        A heading that starts with ``#`` belongs to a column of numbers.
    rows : iterable of sequences of (str or Cell)
    notes : sequence of str

    Returns
    -------
    Table
    """
    numeric = [h.startswith("#") for h in head]
    cells = tuple(Cell(h.lstrip("#"), "num" if n else "") for h, n in zip(head, numeric))
    return Table(caption, cells, tuple(_row(row, numeric) for row in rows), tuple(notes))


def _row(row, numeric) -> Row:
    if isinstance(row, Row):
        return row
    return Row(tuple(c if isinstance(c, Cell) else Cell(c, "num" if n else "") for c, n in zip(row, numeric)))


def verdict(good: bool, yes: str = "yes", no: str = "NO") -> Cell:
    """A cell that says whether all is well, in words and in colour."""
    return Cell(yes, "ok") if good else Cell(no, "bad")
