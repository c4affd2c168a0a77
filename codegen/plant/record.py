"""Recorded signals: a CSV file whose columns are named after the plant's signals."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen.errors import PlantError
from codegen.plant.messages import unknown
from codegen.plant.model import Array, Signal

DATA_FOLDER = Path(__file__).parents[1] / "gallery" / "data"


@dataclass(frozen=True)
class Record:
    """A CSV file, read: columns of text and the line on which each row stands.

    Parameters
    ----------
    name : str
        As written in the plant file; for messages.
    columns : dict
        Column name -> list of K cells.
    lines : tuple of int
        Line number of each row.
    """

    name: str
    columns: dict[str, list[str]]
    lines: tuple[int, ...]

    @property
    def steps(self) -> int:
        """Number of rows K."""
        return len(self.lines)

    def has(self, signals: tuple[Signal, ...]) -> bool:
        """Return True when there are signals and each has a column.

        Parameters
        ----------
        signals : tuple of Signal
            Of one vector.

        Returns
        -------
        complete : bool

        Raises
        ------
        PlantError
            Some of them have a column and others not.
        """
        missing = [s.name for s in signals if s.name not in self.columns]
        if missing and len(missing) < len(signals):
            raise PlantError(
                f'{self.name}: has no column "{missing[0]}" (found: {", ".join(self.columns)}). Add the '
                f"column."
            )
        return bool(signals) and not missing

    def numbers(self, signals: tuple[Signal, ...], gaps: bool = False) -> Array:
        """Return the columns of some signals.

        Parameters
        ----------
        signals : tuple of Signal
            Each with a column.
        gaps : bool
            Accept empty cells and ``nan`` (a missing sample); they become NaN.

        Returns
        -------
        values : ndarray (K, n)

        Raises
        ------
        PlantError
            A cell is no finite number.
        """
        table = np.empty((self.steps, len(signals)))
        for j, signal in enumerate(signals):
            for i, cell in enumerate(self.columns[signal.name]):
                table[i, j] = self._number(cell, i, signal.name, gaps)
        return table

    def modes(self, names: tuple[str, ...]) -> Array:
        """Return the ``mode`` column as indices from 0; its cells are mode names or indices.

        Parameters
        ----------
        names : tuple of str
            Mode names, in order.

        Returns
        -------
        q : ndarray (K,) int

        Raises
        ------
        PlantError
            A cell is neither.
        """
        index = {name: q for q, name in enumerate(names)}
        index = {str(q): q for q in range(len(names))} | index
        for line, cell in zip(self.lines, self.columns["mode"]):
            if cell not in index:
                raise PlantError(f"{self.name}: line {line}: {unknown('mode', cell, names)}")
        return np.array([index[cell] for cell in self.columns["mode"]], dtype=int)

    def _number(self, cell: str, row: int, column: str, gaps: bool) -> float:
        try:
            value = float(cell) if cell else np.nan
        except ValueError:
            value = np.inf
        if np.isinf(value) or (np.isnan(value) and not gaps):
            raise PlantError(
                f'{self.name}: line {self.lines[row]}: column "{column}" holds "{cell[:40]}" '
                "(expected a finite number). Correct the cell."
            )
        return value


def find_record(name: str, folder: str) -> Path:
    """Return the path of a CSV file: beside the plant file, or among the gallery's data.

    Parameters
    ----------
    name : str
        As written in the plant file.
    folder : str
        The plant file's folder.

    Returns
    -------
    path : Path

    Raises
    ------
    PlantError
        No such file.
    """
    for base in (Path(folder), DATA_FOLDER, DATA_FOLDER.parent):
        if (base / name).is_file():
            return base / name
    raise PlantError(
        f'csv: there is no file "{name}" (looked in {folder or "the current folder"} and in the gallery '
        "data). Correct the name; it is relative to the plant file."
    )


def read_record(name: str, folder: str) -> Record:
    """Read a CSV file; lines that start with ``#`` and empty lines are skipped.

    Parameters
    ----------
    name : str
        As written in the plant file.
    folder : str
        The plant file's folder.

    Returns
    -------
    record : Record

    Raises
    ------
    PlantError
        The file is missing, unreadable, not UTF-8 or holds no row; a row is too short or too long; a column
        comes twice.
    """
    path = find_record(name, folder)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise PlantError(f"{name}: cannot be read ({type(error).__name__}). Save it as UTF-8 text.") from None
    numbered = [(i, line) for i, line in enumerate(text.splitlines(), start=1)]
    numbered = [(i, line) for i, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if len(numbered) < 2:
        raise PlantError(f"{name}: has no rows (expected a line of column names, then numbers). Fill it.")
    cells = [[cell.strip() for cell in row] for row in csv.reader(line for _, line in numbered)]
    header, rows = cells[0], cells[1:]
    lines = tuple(i for i, _ in numbered[1:])
    for name_ in header:
        if header.count(name_) > 1:
            raise PlantError(f'{name}: the column "{name_}" comes twice. Rename one.')
    for line, row in zip(lines, rows):
        if len(row) != len(header):
            raise PlantError(
                f"{name}: line {line} has {len(row)} cells, expected {len(header)} (the columns). Correct "
                f"the line."
            )
    return Record(name, {column: [row[j] for row in rows] for j, column in enumerate(header)}, lines)
