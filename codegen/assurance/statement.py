"""What the assurance file states of a folder: claims, constants and lines, all from design.json and the C."""

from __future__ import annotations

from pathlib import Path

from .. import __version__
from .checks import digests
from .claims import Claim, claims
from .places import Constant, constants
from .plant_lines import plant_lines

FORMAT = 1


def stated(folder: Path, design, record: dict) -> dict:
    """State everything but the checks: a function of design.json and the C alone, so the same bytes every time.

    Parameters
    ----------
    folder : Path
    design : Design
    record : dict
        Contents of resources.json.

    Returns
    -------
    document : dict
        With ``checks`` empty.

    Raises
    ------
    CertificateError
        The C does not hold the constants of the design, or a claim has no condition.
    """
    prefix, real, layout = record["prefix"], record["real"], record["layout"]
    text, header = ((folder / f"{prefix}.{end}").read_text(encoding="ascii") for end in "ch")
    found = constants(design, real, layout, text, header)
    lines = plant_lines(design.plant.text)
    return {"format": FORMAT, "tool": f"residua {__version__}", "state": "current",
            "design": {"plant": design.plant.name, "method": design.method, "family": design.observer.family,
                       "real": real, "layout": layout, "prefix": prefix, "certificate": design.digest,
                       "plant_sha256": design.plant_sha256},
            "files": file_digests(folder, prefix),
            "claims": [_claim(c, found, lines, f"{prefix}.c") for c in claims(design, real)],
            "constants": [{"name": c.name, "mode": c.mode, "file": f"{prefix}.c", "function": c.function,
                           "entries": [{"index": list(e.index), "value": e.value, "literal": e.literal,
                                        "lines": list(e.lines)} for e in c.entries]} for c in found],
            "checks": []}


def _claim(claim: Claim, found: tuple[Constant, ...], lines: dict, file: str) -> dict:
    """One claim with the entries of the plant file and the lines of C that it is about."""
    concerned = [c for c in found if c.name in claim.constants or c.name.removesuffix("_lo").removesuffix("_hi")
                 in claim.constants]
    wanted = [path for path in lines if _last(path) in claim.plant or path in claim.plant]
    return {"id": claim.id, "claim": claim.text, "plant": [{"entry": p, "line": lines[p]} for p in wanted],
            "condition": {"words": claim.words, "formula": claim.formula, "source": claim.source, "code": claim.code},
            "margins": [m.to_dict() for m in claim.margins],
            "constants": list(dict.fromkeys(c.name for c in concerned)),
            "lines": {file: _ranges({n for c in concerned for e in c.entries for n in e.lines})},
            "checks": list(claim.checks)}


def _last(path: str) -> str:
    """``A`` of ``mode[0].A`` and ``common.A``, ``mode.bounds`` of ``mode[0].bounds``; names of constants together."""
    table, _, key = path.rpartition(".")
    if table == "constants":
        return "constants"
    return key if table == "common" or (table.startswith("mode[") and key != "bounds") else (
        "mode.bounds" if key == "bounds" else path)


def _ranges(numbers: set[int]) -> list[list[int]]:
    """Join line numbers that follow one another to [first, last]."""
    out: list[list[int]] = []
    for n in sorted(numbers):
        if out and n == out[-1][1] + 1:
            out[-1][1] = n
        else:
            out.append([n, n])
    return out


def file_digests(folder: Path, prefix: str) -> dict:
    """Return the sha256 of the files that the statement is about."""
    return digests(folder, ("design.json", f"{prefix}.c", f"{prefix}.h"))
