"""Gappa on the rounding of the generated C: no sum is rounded by more than its offset has room for.

The offsets were found with a formula of our own (``certify.rounding``). Gappa repeats that part of the proof
with its own theorems about floating-point numbers, from the script that was printed beside the C.

What is not in it: fused multiply-add and flushing of subnormal numbers, which the C forbids.
"""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import ToolError, ValidationError
from .prove import read_record

LIMIT = 1800  # seconds
#: How a script states a row: its rounded sum, the same sum exact, and what both may differ by.
STATED = {"rounded": r"(?m)^(\w+) r=$", "exact": r"(?m)^exact_(\w+) =$",
          "goal": r"(?m)^ +\|(\w+) - exact_\1\| <= -?0x\S+ /\\$"}

#: What it takes for granted of the magnitude of a coefficient.
TAKEN = r"(?m)^ +\|size_(\w+) - exact_size_\1\| <= (\S+) ->$"
#: A definition with the comment before it; what is assumed; the goals, the last of them without a row.
DEFINED = r"(?m)^# .*\n(\w+) r=\n(?:    .*\n)+?exact_\1 =\n(?:    .*\n)*?    .*;\n\n?"
ASSUMED = r"    (?:#|.* ->$)"
GOALS = r"(?ms)^    \(\n(.*)\n    \)\n\)\n\}"
#: Families whose C has no margin for rounding, and why.
WITHOUT = {"bank": "no rounding margins to prove: the thresholds of a bank are calibrated on the arithmetic of the C "
                   "itself; what rounding can do to its states is in their limits, which residua certify checks."}
#: What Gappa says of a script that it can read and cannot prove.
UNTRUE = ("not satisfied", "empty interval", "no contradiction was found")


@dataclass(frozen=True)
class RoundingResult:
    """What Gappa says about one folder.

    Parameters
    ----------
    proved : bool
    alarms : tuple of str
        What Gappa could not show; empty if it showed all.
    rows : int
        Number of different sums in the script.
    seconds : float
    version : str
        Of Gappa.
    """

    proved: bool
    alarms: tuple[str, ...]
    rows: int
    seconds: float
    version: str


def nothing_to_prove(folder: str | Path) -> str:
    """Say why there is no script for a folder; empty where there has to be one.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    why : str

    Raises
    ------
    ToolError
        The folder has no record.
    """
    return WITHOUT.get(read_record(Path(folder)).get("family"), "")


def prove_rounding(folder: str | Path) -> RoundingResult:
    """Prove the rounding margins of a folder that ``generate`` wrote.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    result : RoundingResult
        ``proved`` is False if anything was not: that is the caller's to judge.

    Raises
    ------
    ToolError
        The folder has no script or one that Gappa cannot read, or gappa is missing or gives no answer.
    """
    folder = Path(folder).resolve()
    script = folder / f"rounding_{read_record(folder)['prefix']}.g"
    if not script.is_file():
        raise ToolError(f"{script}: not found. Make the folder again with residua generate.")
    text = script.read_text(encoding="ascii")
    rounded, exact, goals = (re.findall(pattern, text) for pattern in STATED.values())
    if not rounded or not rounded == exact == goals:
        raise ToolError(f"{script}: states {len(rounded)} rounded sums, {len(exact)} exact and {len(goals)} margins "
                        "(expected as many of each, for the same rows). Make the folder again with residua generate.")
    # The magnitude of a coefficient is as far off as the coefficient: no hypothesis may say less than a goal shows.
    for name, slip in re.findall(TAKEN, text):
        if not re.search(rf"(?m)^ +\|(\w+)_{name} - exact_\1_{name}\| <= {re.escape(slip)} /\\$", text):
            raise ToolError(f"{script}: takes for granted what it does not state of {name}. Make the folder again with "
                            "residua generate.")
    version = _run(["--version"]).stdout.split()[-1]
    begin, alarms = time.monotonic(), []
    for row, part in parts(text):
        done = _run(["/dev/stdin"], part)
        said = [" ".join(line.split()) for line in done.stderr.splitlines() if not line.startswith("Warning: renaming")]
        # One that cannot be read, as opposed to one that is not true.
        if done.returncode and not any(words in line for line in said for words in UNTRUE):
            raise ToolError(f"gappa: failed with status {done.returncode}: {' '.join(said)[:300]}")
        if done.returncode:  # of a single goal it says no name
            alarms.append(f"{row}: {' '.join(said)}")
    return RoundingResult(not alarms, tuple(alarms), len(rounded), time.monotonic() - begin, version)


def parts(text: str) -> Iterator[tuple[str, str]]:
    """Split a script into one per goal: Gappa's time grows faster than the number of rows that it has before it.

    A part has the goal, the definition of its row and the assumptions about what this reads: with less assumed
    it proves no less.

    Parameters
    ----------
    text : str
        Script with a definition for each goal.

    Yields
    ------
    name : str
        ``exact_`` and the name of the row; of the last goal "difference".
    script : str

    Raises
    ------
    ToolError
        The script is of another form.
    """
    defined = {m[1]: m[0] for m in re.finditer(DEFINED, text)}
    goals = re.search(GOALS, text)
    if goals is None or not defined:
        raise ToolError("gappa: the script is not of the form that generate writes. Make the folder again with it.")
    frame = re.sub(DEFINED, "", text[:goals.start()])
    for goal in re.split(r" /\\\n", goals[1]):
        row = re.search(r"exact_(\w+)", goal)
        definition = defined[row[1]] if row else ""
        read = set(re.findall(r"\w+", definition + goal))
        taken = "".join(line for line in frame.splitlines(keepends=True)
                        if not re.match(ASSUMED, line) or read & set(re.findall(r"\b[a-z]\w+\b", line)) - {"in"})
        name = row[0] if row else "difference"
        yield name, f"{taken.replace('{', definition + '{', 1)}    (\n{goal}\n    )\n)\n}}\n"


def require_rounding(result: RoundingResult) -> None:
    """Refuse a result with a row that is not proved.

    Raises
    ------
    ValidationError
    """
    if not result.proved:
        raise ValidationError(f"Gappa: the rounding margins are not all proved: {' '.join(result.alarms)[:300]}. Print "
                              "the C again; if that does not help, report it.")


def _run(arguments: list[str], script: str = "") -> subprocess.CompletedProcess:
    try:
        return subprocess.run(["gappa", *arguments], input=script, capture_output=True, text=True, timeout=LIMIT,
                              check=False)
    except FileNotFoundError:
        raise ToolError("gappa: not found. Install it (Debian: apt-get install gappa).") from None
    except subprocess.TimeoutExpired:
        raise ToolError(f"gappa: no answer within {LIMIT} s. Stopped.") from None
