"""Gappa on the rounding of the generated C: no sum is rounded by more than its offset has room for.

The offsets were found with a formula of our own (``certify.rounding``). Gappa repeats that part of the proof
with its own theorems about floating-point numbers, from the script that was printed beside the C.

What is not in it: fused multiply-add and flushing of subnormal numbers, which the C forbids.
"""

from __future__ import annotations

import re
import subprocess
import time
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
    for name in rounded:
        alarms += _alarms(alone(text, rounded, name), name)
    return RoundingResult(not alarms, tuple(alarms), len(rounded), time.monotonic() - begin, version)


def alone(text: str, rows: list[str], name: str) -> str:
    """A script with one of its rows alone: Gappa's time grows faster than their number.

    Parameters
    ----------
    text : str
    rows : list of str
        Names of all rows.
    name : str
        Of the one to keep.

    Returns
    -------
    str
    """
    for other in set(rows) - {name}:
        text = re.sub(rf"(?m)^(?:exact_)?{other} (?:r=|=)\n(?:    .*\n)+", "", text)
        text = re.sub(rf"(?m)^ +\|{other} - exact_{other}\| <= .*\n", "", text)
    return text


def _alarms(text: str, row: str) -> list[str]:
    """What Gappa cannot show of a script of one row."""
    done = _run(["/dev/stdin"], text)
    said = [" ".join(line.split()) for line in done.stderr.splitlines() if not line.startswith("Warning: renaming")]
    # One that cannot be read, as opposed to one that is not true.
    if done.returncode and not any(words in line for line in said for words in UNTRUE):
        raise ToolError(f"gappa: failed with status {done.returncode}: {' '.join(said)[:300]}")
    # Once a row fails, Gappa lists hypotheses without bounds as well; or it says nothing but that.
    return [line for line in said if "exact_" in line] or [f"exact_{row}: {line}" for line in said] if (
        done.returncode) else []


def require_rounding(result: RoundingResult) -> None:
    """Refuse a result with a row that is not proved.

    Raises
    ------
    ValidationError
    """
    if not result.proved:
        raise ValidationError(f"Gappa: the rounding margins are not all proved: {' '.join(result.alarms)[:300]}. Print "
                              "the C again; if that does not help, report it.")


def _run(arguments: list[str], text: str = "") -> subprocess.CompletedProcess:
    try:
        return subprocess.run(["gappa", *arguments], input=text, capture_output=True, text=True, timeout=LIMIT,
                              check=False)
    except FileNotFoundError:
        raise ToolError("gappa: not found. Install it (Debian: apt-get install gappa).") from None
    except subprocess.TimeoutExpired:
        raise ToolError(f"gappa: no answer within {LIMIT} s. Stopped.") from None
