"""The assurance file in words: what each claim rests on, and which checks were run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from . import words
from .table import Cell, Table, table

JOINED = "\u2060"  # no line break here
STATES = {"passed": "ok", "failed": "bad", "stale": "warn", "not run": "warn"}


@dataclass(frozen=True)
class AssuranceWords:
    """What the report says of ``assurance.json``; without the file one sentence that says so."""

    about: str
    claims: tuple[Table, ...]
    checks: tuple[Table, ...]


def words_of(folder: Path) -> AssuranceWords:
    """Say what the folder's assurance file says.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    AssuranceWords
    """
    try:
        document = json.loads((Path(folder) / "assurance.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return AssuranceWords("There is no assurance.json in this folder; residua generate writes it.", (), ())
    about = ("From the plant file to the lines of C that hold it, claim by claim. assurance.json has every constant "
             "with its line, every entry of the plant file, and the digests of what was checked; residua assurance . "
             "checks it against the C. This page shows its state when the firmware was made: a check that is run "
             "later enters its result there.")
    states = {e["id"]: e["state"] for e in document["checks"]}
    claims = table("What each claim rests on", ("claim", "plant file, line", "condition", "constants", "lines of the C",
                                                "margin", "checks"),
                   [_claim(c, states) for c in document["claims"]],
                   ("Margin: what is left of the tightest inequality of the condition, in its units, rounded down; 0 "
                    "is met with equality, and any margin that is not met would have stopped the design.",))
    checks = table("Checks", ("check", "what it shows", "state", "with", "command"),
                   [(e["id"], e["what"], Cell(e["state"], STATES[e["state"]]), e["tool"] or words.NONE, e["command"])
                    for e in document["checks"]])
    return AssuranceWords(about, (claims,), (checks,))


def _claim(c: dict, states: dict[str, str]) -> tuple:
    lines = "; ".join(spans_of(spans) for spans in c["lines"].values() if spans)
    tables: dict[str, list[str]] = {}
    for p in c["plant"]:
        name, _, key = p["entry"].rpartition(".")
        tables.setdefault(name, []).append(f"{key} {p['line'] or ''}".strip())
    plant = "; ".join(f"{name}: {', '.join(keys)}".removeprefix(": ") for name, keys in tables.items())
    least = min((m["margin"] for m in c["margins"]), default=None)
    condition = c["condition"]
    source = condition["source"].split(": ")[0]  # after "own derivation:" the words of the code follow
    return (c["claim"], plant or words.NONE, f"{condition['words']} {condition['formula']} ({source})",
            ", ".join(c["constants"]) or words.NONE, lines or words.NONE, words.at_least(least),
            _checked(c["checks"], states))


def _checked(ids: list[str], states: dict[str, str]) -> Cell:
    """The checks of a claim by their states: green only where all passed."""
    by_state = {state: [i for i in ids if states[i] == state] for state in ("failed", "stale", "passed", "not run")}
    text = "; ".join(f"{state}: {', '.join(found)}" for state, found in by_state.items() if found)
    kind = "bad" if by_state["failed"] else "warn" if by_state["stale"] or not by_state["passed"] else (
        "" if by_state["not run"] else "ok")
    return Cell(text, kind)


def spans_of(spans: list[list[int]]) -> str:
    """Line numbers: ``12, 15–18``.

    Parameters
    ----------
    spans : list of [first, last]

    Returns
    -------
    text : str
    """
    return ", ".join(str(first) if first == last else f"{first}–{JOINED}{last}" for first, last in spans)
