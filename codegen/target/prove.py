"""Frama-C Eva on the generated C: no run-time error, every number finite, a box that no call leaves.

Eva runs on the very text of ``<prefix>.c`` with the harness that was printed beside it. It calculates with
intervals in the C's own number type, rounding included, for every mode apart. Its exit status says nothing
about alarms: the gate is its list of properties, in which every one of ours must be "Valid".

What is not in it: NaN as an input (Frama-C 25 keeps NaN after ``v >= a``), which the tests of the C cover;
fused multiply-add and flushing of subnormal numbers, which the C forbids.
"""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from ..errors import ToolError, ValidationError

LIMIT = 1800  # seconds
# 32-bit, little endian, as a Cortex-M; modules named one by one because loading all takes longest.
OPTIONS = ("-no-autoload-plugins", "-load-module", "from,inout,eva,scope,report", "-machdep", "gcc_x86_32",
           "-eva-precision", "0", "-eva-split-return", "full",
           "-warn-special-float", "non-finite", "-from-verify-assigns", "-eva-msg-key=-final-states,-initial-state")
# Where paths are kept apart: the harness's rounds, and checks that lead to different answers.
PATHS = {"calls": 100_000, "one_step": 100, "one_predict": 100, "refused": 100, "{}_step": 200, "{}_predict": 200,
         "{}_check": 200, "{}_y_accepted": 500}

#: Where paths of a family are kept apart, and where the range of a number is looked at in parts: a mean reads what it
#: writes.
OWN_PATHS = {"bank": {"{}_sound": 200, "{}_bridged": 200}}
IN_PARTS = dict.fromkeys(("sliding", "guided", "guided_point", "guided_filter"), "{}_pair:16")

CALLS, LAW_CALLS = ("init", "step", "predict", "reset"), ("law_init", "track", "coast")
ASSERTS = ("state_is_in_box", "answer_is_whole", "nothing_is_written", "refused")  # functions of the harness


@dataclass(frozen=True)
class ProofResult:
    """What Eva says about one folder.

    Parameters
    ----------
    proved : bool
    alarms : tuple of str
        ``file:line: function: status: property`` of whatever is not proved; empty if all is.
    seconds : float
    version : str
        Of Frama-C.
    properties : dict
        Function -> number of its proved properties: contracts and assertions. Freedom from run-time errors is
        not counted: Eva lists such a property only where it fails.
    coverage : int
        Percent of the functions of C and harness, or of their statements, that are reached: the smaller one.
    """

    proved: bool
    alarms: tuple[str, ...]
    seconds: float
    version: str
    properties: dict[str, int]
    coverage: int


def prove(folder: str | Path) -> ProofResult:
    """Prove the C of a folder that ``generate`` wrote.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    result : ProofResult
        ``proved`` is False if anything was not: that is the caller's to judge.

    Raises
    ------
    ToolError
        The folder has no harness, or frama-c is missing or fails.
    """
    folder = Path(folder).resolve()
    record = read_record(folder)
    prefix, inputs = record["prefix"], record["n_u"]
    sources = [f"{prefix}.c", f"prove_{prefix}.c"]
    for name in sources:
        if not (folder / name).is_file():
            raise ToolError(f"{folder / name}: not found. Make the folder again with residua generate.")
    paths = PATHS | ({"{}_u_accepted": 500} if inputs else {})
    paths |= {"{}_theta_accepted": 500} if record.get("n_theta") else {}
    paths |= OWN_PATHS.get(record.get("family"), {})
    if "law" in record:
        paths |= {"one_tracked": 100, "one_coasted": 100, "law_refused": 100, "{}_track": 200, "{}_coast": 200}
    apart = ",".join(f"{name.format(prefix)}:{count}" for name, count in paths.items())
    longest = max([64, *(count + 1 for _, _, count in record.get("state", ()))])  # loops over an error set too
    parts = IN_PARTS.get(record.get("family"), "").format(prefix)
    options = [*OPTIONS, *(("-eva-subdivide-non-linear-function", parts) if parts else ())]
    version = _run(["-version"], folder).split()[0]
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        table = Path(scratch) / "properties.csv"
        said = _run([*options, "-eva-auto-loop-unroll", str(longest), "-main", f"prove_{prefix}", "-eva",
                     "-eva-slevel-function", apart, *sources, "-then", "-report-csv", str(table)], folder)
        if not table.is_file():
            raise ToolError("frama-c: wrote no list of properties. Run it again, or install another version.")
        with table.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
    seconds = time.monotonic() - begin
    alarms, properties = judge(rows, said, prefix, CALLS + LAW_CALLS * ("law" in record))
    covered = [int(percent) for percent in re.findall(r"(?:analyzed|reached) \(out of \d+\): (\d+)% coverage", said)]
    return ProofResult(not alarms, alarms, seconds, version, properties, min(covered, default=0))


def read_record(folder: Path) -> dict:
    """Return the record of a folder, resources.json: how its C is called, among others.

    Raises
    ------
    ToolError
        It is missing or damaged.
    """
    try:
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        return record | {"prefix": record["prefix"], "n_u": record["n_u"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ToolError(f"{folder / 'resources.json'}: cannot be read ({type(error).__name__}: {error}). "
                        "Make the folder with residua generate.") from error


def require(result: ProofResult) -> None:
    """Refuse a result with an alarm.

    Raises
    ------
    ValidationError
    """
    if not result.proved:
        raise ValidationError(f"Frama-C: {len(result.alarms)} properties are not proved (expected none); the first: "
                              f"{result.alarms[0]}. Print the C again; if that does not help, report it.")


def judge(rows: list[dict], said: str, prefix: str,
          calls: tuple[str, ...] = CALLS) -> tuple[tuple[str, ...], dict[str, int]]:
    """Read Frama-C's list of properties.

    Parameters
    ----------
    rows : list of dict
        Of the csv report.
    said : str
        What Eva printed.
    prefix : str
        Of the observer.
    calls : tuple of str
        Functions of the observer that the harness must have called.

    Returns
    -------
    alarms : tuple of str
        Empty if the whole proof was found.
    properties : dict
        Function -> number of proved properties.
    """
    ours = [r for r in rows if not r["directory"].startswith("FRAMAC_SHARE")]
    # Contracts of Frama-C's own functions are taken for granted, nothing of ours is.
    unproved = [r for r in rows if r["status"] != "Valid" and not (
        r["status"] == "Considered valid" and r["directory"].startswith("FRAMAC_SHARE"))]
    alarms = [f"{r['file']}:{r['line']}: {r['function']}: {r['status']}: {r['property']}" for r in unproved]
    alarms.sort(key=lambda text: ": Dead: " in text)  # not reached, because of those before
    properties = Counter(r["function"] for r in ours if r["status"] == "Valid")
    # A list without these is no proof, however clean: the harness was not walked through.
    kinds = {(r["property kind"], r["function"]) for r in ours}
    called = {kind for kind, _ in kinds}
    missing = [f"{prefix}_{call}: was not called" for call in calls
               if f"precondition of {prefix}_{call}" not in called]
    missing += [f"prove_{prefix}.c: no assertion of {name} was reached" for name in (*ASSERTS, f"prove_{prefix}")
                if ("user assertion", name) not in kinds]
    raised = re.search(r"by the Eva analyzer: +(\d+) errors? +(\d+) warnings?", said)
    if raised and any(int(n) for n in raised.groups()):
        missing.append(f"Eva: {raised.group(1)} errors, {raised.group(2)} warnings")
    return tuple(alarms + missing), dict(properties)


def _run(arguments: list[str], folder: Path) -> str:
    try:
        # It believes PWD more than the system.
        done = subprocess.run(["frama-c", *arguments], cwd=folder, env={**os.environ, "PWD": str(folder)},
                              capture_output=True, text=True, timeout=LIMIT, check=False)
    except FileNotFoundError:
        raise ToolError("frama-c: not found. Install it (Debian: apt-get install frama-c-base).") from None
    except subprocess.TimeoutExpired:
        raise ToolError(f"frama-c: no answer within {LIMIT} s. Stopped.") from None
    if done.returncode:
        lines = (done.stdout + done.stderr).splitlines()
        first = next((i for i, line in enumerate(lines) if "rror" in line or "aborted" in line), len(lines) - 1)
        reason = " ".join(" ".join(lines[first:first + 3]).split())
        raise ToolError(f"frama-c: failed with status {done.returncode}: {reason}")
    return done.stdout
