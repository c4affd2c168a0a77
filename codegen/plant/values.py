"""The values of a plant file that are more than a number or a text: intervals, matrices, schedules.

Each check returns the value or raises a ValueError that says what was found and expected; pydantic adds the
place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


def interval(value: Any) -> list[float]:
    """Return ``[lo, hi]`` as floats.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Returns
    -------
    limits : list of float
        lo, hi.

    Raises
    ------
    ValueError
        Not two finite numbers, or the wrong way round.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"is {shown(value)} (expected two numbers). Write [lo, hi]")
    for bound in value:
        if not _is_number(bound):
            raise ValueError(f"holds {shown(bound)} (expected a finite number). Write [lo, hi]")
    lo, hi = float(value[0]), float(value[1])
    if lo > hi:
        raise ValueError(f"is the wrong way round (found [{lo:g}, {hi:g}]). Write [{hi:g}, {lo:g}]")
    return [lo, hi]


def matrix(value: Any) -> list[list[float | str]]:
    """Return the rows of a matrix, numbers as floats and expressions as they are.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Returns
    -------
    rows : list of lists

    Raises
    ------
    ValueError
        Not a list of rows of equal length, or an entry that is neither a finite number nor text.
    """
    if not isinstance(value, list):
        raise ValueError(f"is {shown(value)} (expected a list of rows). Write [[...], [...]]")
    rows = []
    for i, row in enumerate(value, start=1):
        if not isinstance(row, list):
            raise ValueError(
                f"is a plain list (found {shown(row)} as row {i}, expected a row). Write [[...], [...]]"
            )
        if len(row) != len(value[0]):
            raise ValueError(
                f"is ragged (row {i} has {len(row)} entries, row 1 has {len(value[0])}). Make its rows "
                f"equally long"
            )
        for j, entry in enumerate(row, start=1):
            if not isinstance(entry, str) and not _is_number(entry):
                raise ValueError(
                    f"holds {shown(entry)} at row {i}, column {j} (expected a finite number or an "
                    f"expression). Correct it"
                )
        rows.append([entry if isinstance(entry, str) else float(entry) for entry in row])
    return rows


def excitation(value: Any) -> str | list[str]:
    """Return "uniform", "corner" or a list of expressions.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Returns
    -------
    value : str or list of str

    Raises
    ------
    ValueError
        Anything else.
    """
    if value in ("uniform", "corner") or (isinstance(value, list) and all(isinstance(v, str) for v in value)):
        return value
    raise ValueError(
        f'is {shown(value)} (expected "uniform", "corner" or a list of expressions). Write e.g. '
        f'["0.1*sin(k)"]'
    )


def schedule(value: Any) -> list[tuple[int, str]] | Cycle:
    """Return (sample, mode name) pairs, or the cycle ``{ every = 5, order = ["a", "b"] }``.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Returns
    -------
    schedule : list of (int, str), or Cycle

    Raises
    ------
    ValueError
        Anything else.
    """
    if isinstance(value, dict):
        match value:
            case {"every": int() as every, "order": [str(), *_] as order} if every >= 1 and len(value) == 2:
                if all(isinstance(name, str) for name in order):
                    return Cycle(every, tuple(order))
        raise ValueError(
            f'is {shown(value)} (expected every >= 1 and order). Write e.g. {{ every = 5, order = ["a", '
            f'"b"] }}'
        )
    for entry in value if isinstance(value, list) else [value]:
        match entry:
            case [int() | float() as sample, str()] if not isinstance(sample, bool) and math.isfinite(sample):
                continue
        raise ValueError(f'holds {shown(entry)} (expected [sample, mode name]). Write e.g. [[0, "name"]]')
    return [tuple(entry) for entry in value]


def shared(value: Any) -> Any:
    """Refuse a matrix of a vertex that is the same for all of them.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Raises
    ------
    ValueError
        Always: the key is known, its place is another.
    """
    raise ValueError("is the same at all vertices of a polytopic plant (found one of a vertex). Move it to [common]")


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def shown(value: Any) -> str:
    """Return a TOML value as an error message shows it, on one line and not too long.

    Parameters
    ----------
    value : object
        As tomllib gives it.

    Returns
    -------
    text : str
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = '"' + " ".join(value.split()) + '"'
    else:
        text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


@dataclass(frozen=True)
class Cycle:
    """A mode schedule that goes through ``order`` again and again, ``every`` samples in each."""

    every: int
    order: tuple[str, ...]
