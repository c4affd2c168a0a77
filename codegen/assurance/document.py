"""``assurance.json`` of an output folder: made with the C, brought up to date by the commands that check it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import contextmanager, suppress
from pathlib import Path

from .. import __version__
from ..errors import CertificateError, ResiduaError
from . import checks
from .statement import FORMAT, file_digests, stated

NAME = "assurance.json"


def write(folder: str | Path, design) -> Path:
    """Make the assurance file of a folder that ``generate`` wrote.

    Parameters
    ----------
    folder : str or Path
    design : Design
        The one in the folder.

    Returns
    -------
    path : Path

    Raises
    ------
    CertificateError
        The C does not hold the constants of the design, or a claim has no condition.
    OSError
        It cannot be written.
    """
    folder = Path(folder)
    record = _record(folder)
    document = stated(folder, design, record)
    measured = {name: m for name, m in record.get("measured", {}).items() if isinstance(m, dict)}
    document["checks"] = checks.of_design(folder, record["prefix"], measured)
    return _keep(folder, document)


def update(folder: str | Path, check: str, result, design: Callable) -> str:
    """Enter the result of a command; the command's own result does not depend on it.

    The file is made where it is missing. Where the C is not the one that it is about, it is stated anew; results
    of other checks on other files are kept as "stale".

    Parameters
    ----------
    folder : str or Path
    check : str
        Key of ``checks.CHECKS``.
    result : object
        See ``checks.outcome``.
    design : callable
        Reads the folder's design; called only where it is needed.

    Returns
    -------
    problem : str
        Why nothing, or not all, was entered; empty where all was.
    """
    folder = Path(folder)
    try:
        record = _record(folder)
        with _locked(folder):
            document, problem = _current(folder, record, design)
            entries = {e["id"]: e for e in document["checks"]}
            old = entries.get(check, {})
            found = checks.outcome(check, result, old.get("figures", {}) if old.get("state") != "stale" else {})
            if found is not None:
                entries[check] = checks.entry(folder, record["prefix"], check, *found)
                document["checks"] = list(entries.values())
                _keep(folder, document)
    except (OSError, ValueError, KeyError, TypeError, ResiduaError) as error:
        return f"{folder / NAME}: not updated ({error})."
    return problem and f"{folder / NAME}: {problem}"


def _current(folder: Path, record: dict, design: Callable) -> tuple[dict, str]:
    """Read the file, or state it anew; mark results on other files; say what is wrong."""
    try:
        document = json.loads((folder / NAME).read_text(encoding="utf-8"))
        old = {e["id"]: e for e in document["checks"] if e["state"] != "not run"}
    except (OSError, ValueError, KeyError, TypeError):
        document, old = {}, {}
    problem, fresh = "", [checks.entry(folder, record["prefix"], check) for check in checks.CHECKS]
    if document.get("files") != file_digests(folder, record["prefix"]) or document.get("state") != "current":
        try:
            made = design()
            document = stated(folder, made, record)
        except (OSError, ResiduaError) as error:
            problem = f"its claims are not about this C ({error})"
            empty = {"format": FORMAT, "tool": f"residua {__version__}", "design": {"prefix": record["prefix"]},
                     "files": {}, "claims": [], "constants": []}
            document = (document or empty) | {"state": f"stale: {error}"}
        fresh = checks.of_design(folder, record["prefix"], {}, stated=not problem)
    kept = [e if e["state"] != "not run" else old.get(e["id"], e) for e in fresh]
    document["checks"] = [_dated(folder, e) for e in kept]
    return document, problem


def _dated(folder: Path, entry: dict) -> dict:
    """Mark a result "stale" where a file that it looked at has changed."""
    changed = entry["ran_on"] != checks.digests(folder, entry["ran_on"])
    return entry | {"state": "stale"} if changed and entry["state"] != "not run" else entry


def verify(folder: str | Path, design) -> dict:
    """Check that the file says the truth about the folder beside it: state everything anew and compare.

    Parameters
    ----------
    folder : str or Path
    design : Design
        The folder's, rechecked.

    Returns
    -------
    document : dict

    Raises
    ------
    CertificateError
        Naming the first difference: a digest, a claim, a constant, a line, a result on other files.
    """
    folder = Path(folder)
    try:
        document = json.loads((folder / NAME).read_text(encoding="utf-8"))
        record = _record(folder)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CertificateError(f"{folder / NAME}: cannot be read ({error}). Make it again with residua generate.") \
            from error
    # Through JSON and back, as the file went.
    expected = json.loads(json.dumps(stated(folder, design, record)))
    for key, value in expected.items():
        if key != "checks" and document.get(key) != value:
            raise CertificateError(f"{folder / NAME}: {_difference(document.get(key), value, key)}. It is not about "
                                   "the files beside it: make it again with residua generate.")
    listed = document.get("checks")
    if not isinstance(listed, list) or [e.get("id") for e in listed] != list(checks.CHECKS):
        raise CertificateError(f"{folder / NAME}: not every check is listed (expected {', '.join(checks.CHECKS)}). "
                               "Make it again with residua generate.")
    for e in listed:
        if e["state"] in ("passed", "failed") and _dated(folder, e)["state"] == "stale":
            raise CertificateError(f"{folder / NAME}: check {e['id']} is called {e['state']}, but ran on other files. "
                                   f"Run it again: {e['command']}")
    return document


def _difference(found, expected, where: str) -> str:
    """Name the first place at which two documents differ."""
    if isinstance(found, dict) and isinstance(expected, dict) and found.keys() == expected.keys():
        key = next(k for k in expected if found[k] != expected[k])
        return _difference(found[key], expected[key], f"{where}.{key}")
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        i = next(i for i, (a, b) in enumerate(zip(found, expected)) if a != b)
        return _difference(found[i], expected[i], f"{where}[{i}]")
    return f"{where} is {json.dumps(found)[:80]} (found), expected {json.dumps(expected)[:80]}"


def _record(folder: Path) -> dict:
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    record["prefix"], record["real"], record["layout"]
    return record


def _keep(folder: Path, document: dict) -> Path:
    """Write the file, whole or not at all."""
    path = folder / NAME
    part = path.with_name(f".{NAME}.part")
    try:
        part.write_text(_pretty(document) + "\n", encoding="utf-8", newline="\n")
        os.replace(part, path)
    except OSError:
        with suppress(OSError):
            part.unlink()
        raise
    return path


def _pretty(value, depth: int = 0) -> str:
    """JSON with one entry per line down to the parts of a claim, and one line per item of a list of records."""
    inner = " " * (depth + 1)
    if isinstance(value, dict) and value and depth <= 3:
        rows = [f"{inner}{json.dumps(k)}: {_pretty(v, depth + 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(rows) + "\n" + " " * depth + "}"
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + ",\n".join(inner + _pretty(v, depth + 1) for v in value) + "\n" + " " * depth + "]"
    return json.dumps(value)


@contextmanager
def _locked(folder: Path):
    """Keep two commands on one folder apart while each reads, changes and writes; no lock where there is none."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
