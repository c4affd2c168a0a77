"""Static analysis of generated folders: ``python c_tests/analyse.py [FOLDER ...]``.

clang-tidy without any accepted finding, cppcheck with MISRA C:2012 less the deviations of templates/MISRA.md.
Default: every folder in generated/. Prints each finding that is not listed; none: exit status 0.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEVIATIONS = ROOT / "templates" / "MISRA.md"
TIDY = ["clang-tidy-19", "--quiet", "--warnings-as-errors=*",
        "--checks=-*,bugprone-*,cert-*,clang-analyzer-*,misc-*,performance-*,portability-*,readability-*,"
        "-readability-magic-numbers,-readability-identifier-length,-readability-uppercase-literal-suffix,"
        "-readability-function-cognitive-complexity,-bugprone-easily-swappable-parameters"]
# 32-bit ARM; the macros are those of <float.h>, which cppcheck does not read.
CPPCHECK = ["--std=c99", "--platform=arm32-wchar_t4", "--addon=misra", "--enable=warning,style,performance,portability",
            "--check-level=exhaustive", "--inconclusive", "-q", "--template={id}\t{file}\t{line}\t{message}",
            "-DFLT_RADIX=2", "-DFLT_MANT_DIG=24", "-DDBL_MANT_DIG=53"]


@dataclass(frozen=True)
class Deviation:
    """One row of the table: which finding is accepted where, and why."""

    finding: str
    file: str
    line: str
    reason: str

    def covers(self, finding: Finding, prefix: str) -> bool:
        """Whether a finding in the C with this prefix is accepted."""
        pattern = self.line.replace("<p>", re.escape(prefix)).replace("<P>", re.escape(prefix.upper()))
        return (finding.id == self.finding and finding.file == f"{prefix}{self.file}"
                and re.search(pattern, finding.text) is not None)


@dataclass(frozen=True)
class Finding:
    """What cppcheck said, with the line of C that it said it of."""

    id: str
    file: str
    number: int
    text: str
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.number}: {self.id}: {self.message}: {self.text.strip()}"


def deviations(text: str | None = None) -> list[Deviation]:
    """Parse the table of deviations.

    Parameters
    ----------
    text : str, optional
        Default: that of templates/MISRA.md.

    Returns
    -------
    deviations : list of Deviation

    Raises
    ------
    ValueError
        A row has no reason, or not the four columns.
    """
    text = DEVIATIONS.read_text(encoding="ascii") if text is None else text
    rows = []
    for line in text.splitlines():
        if not line.startswith("| `"):
            continue
        found = re.fullmatch(r"\| `([^`]+)` \| `([^`]+)` \| `([^`]+)` \| ([^`|]+) \|", line)
        if not found or len(found[4]) < 20:
            raise ValueError(f"{DEVIATIONS.name}: {line!r} is no row of four columns with a reason.")
        rows.append(Deviation(found[1], found[2], found[3].replace(r"\|", "|"), found[4]))
    return rows


def prefix_of(folder: Path) -> str:
    """Return the prefix of the C in a folder, from its resources.json."""
    return json.loads((folder / "resources.json").read_text(encoding="ascii"))["prefix"]


def cppcheck(folder: Path) -> list[Finding]:
    """Run cppcheck with MISRA over the C of a folder; return all that it finds, deviations too."""
    beside = Path(sys.executable).parent / "cppcheck"
    command = [str(beside) if beside.is_file() else "cppcheck", *CPPCHECK, f"{prefix_of(folder)}.c"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    if done.returncode:
        raise RuntimeError(f"cppcheck: status {done.returncode}: {done.stdout}{done.stderr}")
    findings = []
    for line in done.stderr.splitlines():
        identifier, file, number, message = line.split("\t")
        lines = (folder / file).read_text(encoding="ascii").splitlines() if file != "nofile" else [""]
        findings.append(Finding(identifier, file, int(number), lines[max(int(number), 1) - 1], message))
    return findings


def tidy(folder: Path) -> list[str]:
    """Run clang-tidy over the C of a folder; return its findings."""
    name = TIDY[0] if shutil.which(TIDY[0]) else "clang-tidy"
    done = subprocess.run([name, *TIDY[1:], f"{prefix_of(folder)}.c", "--", "-std=c99"], cwd=folder,
                          capture_output=True, text=True, check=False, timeout=300)
    findings = [line for line in done.stdout.splitlines() if re.search(r": (error|warning):", line)]
    return findings or ([done.stdout + done.stderr] if done.returncode else [])


def unlisted(folder: Path) -> list[str]:
    """Return every finding in a folder that MISRA.md does not list, and all of clang-tidy."""
    prefix, accepted = prefix_of(folder), deviations()
    return [str(f) for f in cppcheck(folder) if not any(d.covers(f, prefix) for d in accepted)] + tidy(folder)


def main(arguments: list[str]) -> int:
    """Analyse the folders, print the findings, return the exit status."""
    folders = [Path(a) for a in arguments] or sorted(p.parent for p in (ROOT / "generated").glob("*/design.json"))
    findings = [f"{folder.name}: {finding}" for folder in folders for finding in unlisted(folder)]
    print("\n".join(findings) or f"{len(folders)} designs: no finding that templates/MISRA.md does not list")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
