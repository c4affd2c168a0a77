"""Where an entry of the plant file stands: its path in the TOML, and the line, checked by reading it back."""

from __future__ import annotations

import re
import tomllib

LONGEST = 400  # lines of one entry


def plant_lines(text: str) -> dict[str, int | None]:
    """Locate every entry of a plant file down to the keys of its tables.

    Parameters
    ----------
    text : str
        TOML.

    Returns
    -------
    lines : dict
        Path (``signals.x``, ``mode[1].A``) -> line, from 1; None where the line cannot be told for certain.
    """
    lines = text.split("\n")
    candidates = _candidates(lines)
    return {path: next((n for n in candidates.get(path, ()) if _reads_back(lines, n, path, value)), None)
            for path, value in _entries(tomllib.loads(text))}


def _entries(data: dict):
    """Yield path and value of every key that a table holds; a key outside tables is its own path."""
    for name, table in data.items():
        if isinstance(table, dict):
            yield from ((f"{name}.{key}", value) for key, value in table.items())
        elif isinstance(table, list) and table and all(isinstance(t, dict) for t in table):
            yield from ((f"{name}[{i}].{key}", value) for i, t in enumerate(table) for key, value in t.items())
        else:
            yield name, table


def _candidates(lines: list[str]) -> dict[str, list[int]]:
    """Lines that look like the beginning of an entry, per path."""
    found: dict[str, list[int]] = {}
    table, counts = "", {}
    for n, line in enumerate(lines, 1):
        if head := re.match(r"\s*\[\[\s*(\w+)\s*\]\]", line):
            index = counts[head[1]] = counts.get(head[1], -1) + 1
            table = f"{head[1]}[{index}]."
        elif head := re.match(r"\s*\[\s*(\w+)\s*\]\s*(#.*)?$", line):
            table = f"{head[1]}."
        elif key := re.match(r"\s*(\w+)\s*=", line):
            found.setdefault(table + key[1], []).append(n)
    return found


def _reads_back(lines: list[str], first: int, path: str, value) -> bool:
    """Whether the entry that begins at a line has the value that the whole file gives it."""
    key = path.rsplit(".", 1)[-1]
    for last in range(first, min(first + LONGEST, len(lines) + 1)):
        try:
            return tomllib.loads("\n".join(lines[first - 1:last])).get(key) == value
        except tomllib.TOMLDecodeError:
            continue
    return False
