"""The checks that can be run on a folder, and what each of them leaves in the assurance file.

``CHECKS`` lists them all; one that was not run is listed as "not run" with the command that runs it. A result
names the tool, its version and the files it looked at, by their sha256; it never names a time.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import flint

from .. import __version__
from ..certify import independent
from ..target.fuzz import COMPILERS
from ..target.metrics import run

OWN = f"residua {__version__}"


@dataclass(frozen=True)
class Check:
    """A check: what it shows, the command that runs it, the files it looks at (``{p}`` is the prefix)."""

    what: str
    command: str
    files: tuple[str, ...] = ("{p}.c", "{p}.h")


CHECKS = {
    "exact": Check("every condition of the certificate holds in exact rational arithmetic", "residua certify .",
                   ("design.json",)),
    "detection": Check("the sizes of surely detected faults, computed again", "residua certify .", ("design.json",)),
    "independent": Check("certificate and constants, by a checker that shares no code with residua",
                         "python -m codegen.certify.independent .", ("design.json", "{p}.c")),
    "read-back": Check("every constant of the tables stands in the C at the lines given here, and no other",
                       "residua assurance .", ("design.json", "{p}.c", "{p}.h")),
    "compile": Check("a C99 compiler takes the C", "residua generate design.json -o ."),
    "validation": Check("every scenario on the compiled C: == reference, no state lost, no false alarm, faults found "
                        "as promised", "residua validate .", ("design.json", "{p}.c", "{p}.h")),
    "prove": Check("no run-time error, every number finite, a box that no call leaves", "residua prove .",
                   ("{p}.c", "{p}.h", "prove_{p}.c")),
    "rounding": Check("no sum is rounded by more than its offset has room for, by another prover's theorems",
                      "residua prove .", ("design.json", "{p}.c", "rounding_{p}.g")),
    "fuzz": Check("random states and calls under sanitizers", "residua fuzz ."),
    "target": Check("the golden self-test on simulated boards, bit for bit the host's", "residua target .",
                    ("{p}.c", "{p}.h", "test_{p}.c")),
}


def digests(folder: Path, names) -> dict[str, str | None]:
    """Return the sha256 of files; None for one that is not there."""
    paths = {name: Path(folder) / name for name in names}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
            for name, path in paths.items()}


def entry(folder: Path, prefix: str, check: str, state: str = "not run", figures: dict | None = None,
          tool: str = "") -> dict:
    """Make the record of a check.

    Parameters
    ----------
    folder : Path
    prefix : str
    check : str
        Key of ``CHECKS``.
    state : {"not run", "passed", "failed"}
    figures : dict, optional
    tool : str
        Name and version.

    Returns
    -------
    dict
    """
    c = CHECKS[check]
    ran_on = {} if state == "not run" else digests(folder, [name.format(p=prefix) for name in c.files])
    return {"id": check, "what": c.what, "command": c.command, "state": state, "tool": tool, "figures": figures or {},
            "ran_on": ran_on}


def outcome(check: str, result, before: dict) -> tuple[str, dict, str] | None:
    """Say what a command's result is worth.

    Parameters
    ----------
    check : str
        Key of ``CHECKS``.
    result : object
        What the command's function returned: ``ProofResult``, ``RoundingResult``, ``Fuzzed``, list of
        ``TargetRun``, and for "validation" the list of ``Outcome``, what ``pipeline.broken`` says of it, and the
        plant's scenarios.
    before : dict
        Figures of an earlier run on the same C, which boards not run now keep.

    Returns
    -------
    state, figures, tool : str, dict, str
        None where nothing was checked.
    """
    return {"validation": _validation, "prove": _proof, "rounding": _rounding, "fuzz": _fuzzed,
            "target": _boards}[check](result, before)


def _state(passed: bool) -> str:
    return "passed" if passed else "failed"


def _validation(result, before):
    outcomes, broken, scenarios = result
    if not outcomes or (len(outcomes) < len(scenarios) and not broken):
        return None  # a part of the scenarios shows less than all of them did
    episodes = [e for o in outcomes for e in o.episodes]
    figures = {"scenarios": [o.scenario.name for o in outcomes], "samples": sum(len(o.trace.status) for o in outcomes),
               "fields that differ from the reference": sorted({d for o in outcomes for d in o.differences}),
               "samples outside the bounds": sum(o.lost for o in outcomes),
               "false alarms": sum(o.false_alarms for o in outcomes), "faults": len(episodes),
               "faults found": sum(e.delay is not None for e in episodes), "promise broken": broken}
    return _state(not broken), figures, f"{OWN}, {version('gcc')}"


def _proof(result, before):
    figures = {"properties proved": sum(result.properties.values()), "alarms": list(result.alarms),
               "coverage in percent": result.coverage}
    return _state(result.proved), figures, f"Frama-C {result.version}"


def _rounding(result, before):
    return _state(result.proved), {"sums": result.rows, "alarms": list(result.alarms)}, f"Gappa {result.version}"


def _fuzzed(result, before):
    clang = next((c for c in COMPILERS if shutil.which(c)), COMPILERS[0])
    figures = {"sequences of calls": result.runs, "code edges reached": result.edges, "failure": result.message}
    return _state(not result.message), figures, f"libFuzzer of {version(clang)}"


def _boards(result, before):
    boards = before | {r.board: {"passed": r.passed, "self-test": r.self_test, "same bytes as host": r.same_as_host,
                                 "compiler": r.compiler, "simulator": r.simulator} for r in result}
    return _state(all(b["passed"] for b in boards.values())), boards, ", ".join(
        sorted({b["simulator"] for b in boards.values()}))


def of_design(folder: Path, prefix: str, measured: dict, stated: bool = True) -> list[dict]:
    """Return an entry for every check: those that need no command ran while the file was made.

    Parameters
    ----------
    folder : Path
    prefix : str
    measured : dict
        Of resources.json, where gcc has just compiled this C; else empty.
    stated : bool
        The claims were stated about this C. That computes what "exact", "detection" and "read-back" check, and
        fails otherwise.

    Returns
    -------
    list of dict
        In the order of ``CHECKS``.
    """
    done = {}
    if stated:
        done = {"exact": ("passed", {}, f"{OWN}, python-flint {flint.__version__}"),
                "detection": ("passed", {"tolerance": 1e-9}, OWN), "read-back": ("passed", {}, OWN)}
    if (folder / "design.json").is_file():
        status, says = _checker(folder, prefix)
        state = "not run" if status == 2 else _state(not status)  # 2: it knows no such set
        done["independent"] = (state, {"says": says}, f"{OWN}, Python's fractions" if state != "not run" else "")
    if measured:
        done["compile"] = ("passed", {k: {"flags": m.get("flags"), "flash_bytes": m.get("flash_bytes")}
                                      for k, m in measured.items()},
                           ", ".join(str(m.get("compiler")) for m in measured.values()))
    return [entry(folder, prefix, check, *done.get(check, ())) for check in CHECKS]


#: What the checker said of the very same files before, in this process.
_SAID: dict[str, tuple[int, list[str]]] = {}


def _checker(folder: Path, prefix: str) -> tuple[int, list[str]]:
    """Run the independent checker: its status and its words."""
    files = digests(folder, ("design.json", "resources.json", f"{prefix}.c", f"{prefix}.h"))
    key = "".join(map(str, files.values()))
    if key not in _SAID:
        ran = subprocess.run([sys.executable, independent.__file__, str(folder)], capture_output=True, text=True,
                             check=False)
        _SAID[key] = ran.returncode, ran.stderr.splitlines()[-1:] if ran.returncode else ran.stdout.splitlines()
    status, says = _SAID[key]
    return status, list(says)


def version(tool: str) -> str:
    """Return what a tool says of its version, on its first line."""
    return run([tool, "--version"]).splitlines()[0]
