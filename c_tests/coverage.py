"""Coverage of generated folders by their tests: ``python c_tests/coverage.py [FOLDER ...]``.

Statements and branches by gcov (gcc, -O0), conditions by MC/DC (clang-19). The tests are the unit tests of this
folder and the golden test of theirs; none alone is asked to be complete. Default: every folder in generated/.
Prints each line that is not covered; none: exit status 0.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from run import UNIT_TESTS, case, folders  # noqa: E402

#: Branches that no call takes, by family: a discrete plant changes its mode at samples, so that J is zero, and what is
#: added to a box that a switch gives birth to is rounding.
NEVER = dict.fromkeys(("follower", "trailing"), r"if \(added_(lo|hi)\[i\] [<>] 0\.0F?\)")
MCDC = ["-fprofile-instr-generate", "-fcoverage-mapping", "-fcoverage-mcdc"]


@dataclass(frozen=True)
class Coverage:
    """What the tests of one folder reach: (covered, all) of each kind, and the places that they do not."""

    name: str
    statements: tuple[int, int]
    branches: tuple[int, int]
    conditions: tuple[int, int]
    missed: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether everything is covered, and something is."""
        return all(done == whole for done, whole in (self.statements, self.branches, self.conditions)) and (
            self.statements[1] > 0)

    def __str__(self) -> str:
        figures = (("statements", self.statements), ("branches", self.branches), ("MC/DC", self.conditions))
        return f"{self.name}: " + ", ".join(f"{what} {done}/{whole}" for what, (done, whole) in figures)


def run(command: list, cwd: Path) -> str:
    """Run a command that must succeed; return what it printed.

    Raises
    ------
    RuntimeError
        It failed.
    """
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=300)
    if done.returncode:
        raise RuntimeError(f"{command[0]}: status {done.returncode}: {(done.stderr or done.stdout)[:2000]}")
    return done.stdout


def programs(folder: Path, prefix: str, compiler: list, scratch: Path) -> list[str]:
    """Compile the observer once, instrumented, and link both tests to it; return the programs."""
    paths = [f"-I{scratch}", f"-I{folder}", f"-I{HERE}"]
    flags = ["-std=c99", "-O0", "-ffp-contract=off", *paths]
    run([*compiler, *flags, "-c", folder / f"{prefix}.c", "-o", "observer.o"], scratch)
    tests = {source.stem: source for source in (*UNIT_TESTS, folder / f"test_{prefix}.c")}
    for name, source in tests.items():
        run([compiler[0], *flags, "-c", source, "-o", f"{name}.o"], scratch)
        run([*compiler, "observer.o", f"{name}.o", "-o", name], scratch)
    return list(tests)


def by_gcov(folder: Path, prefix: str, scratch: Path, never: str):
    """Count statements and branches, those in lines that match ``never`` left out.

    Returns
    -------
    statements, branches : (int, int)
    missed : list of str
    """
    for program in programs(folder, prefix, ["gcc", "--coverage"], scratch):
        run([f"./{program}"], scratch)
    report = json.loads(run(["gcov", "--json-format", "--stdout", "--branch-probabilities", "observer.o"], scratch))
    lines = [line for f in report["files"] if f["file"].endswith(f"{prefix}.c") for line in f["lines"]]
    text = (folder / f"{prefix}.c").read_text(encoding="ascii").splitlines()
    branches = [(line["line_number"], branch["count"]) for line in lines for branch in line["branches"]
                if not re.search(never, text[line["line_number"] - 1])]
    missed = [f"line {line['line_number']} is not run" for line in lines if not line["count"]]
    missed += [f"line {number}: a branch is not taken" for number, count in branches if not count]
    return ((sum(line["count"] > 0 for line in lines), len(lines)),
            (sum(count > 0 for _, count in branches), len(branches)), missed)


def by_clang(folder: Path, prefix: str, scratch: Path):
    """Count the conditions whose effect on their decision is shown (MC/DC).

    Returns
    -------
    conditions : (int, int)
    missed : list of str
    """
    names = programs(folder, prefix, ["clang-19", *MCDC], scratch)
    for name in names:
        run(["env", f"LLVM_PROFILE_FILE={name}.profraw", f"./{name}"], scratch)
    run(["llvm-profdata-19", "merge", "-o", "all.profdata", *(f"{name}.profraw" for name in names)], scratch)
    report = json.loads(run(["llvm-cov-19", "export", names[0], "-instr-profile=all.profdata"], scratch))["data"][0]
    (of_file,) = [f for f in report["files"] if f["filename"].endswith(f"/{prefix}.c")]
    missed = [f"line {record[0]}: condition {i + 1} of {len(record[-1])} does not show its effect"
              for record in of_file["mcdc_records"] for i, shown in enumerate(record[-1]) if not shown]
    counts = of_file["summary"]["mcdc"]
    return (counts["covered"], counts["count"]), missed


def measure(folder: Path) -> Coverage:
    """Run the tests of a folder under both tools.

    Parameters
    ----------
    folder : Path
        With the C, its golden test and resources.json.

    Returns
    -------
    coverage : Coverage
    """
    folder = folder.resolve()
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        (scratch / "case.h").write_text(case(record), encoding="ascii")
        statements, branches, not_run = by_gcov(folder, record["prefix"], scratch,
                                                  NEVER.get(record["family"], "(?!)"))
        conditions, not_shown = by_clang(folder, record["prefix"], scratch)
    return Coverage(folder.name, statements, branches, conditions, tuple(not_run + not_shown))


def main(arguments: list[str]) -> int:
    """Measure the folders, print figures and what is missed, return the exit status."""
    found = [measure(folder) for folder in [Path(a) for a in arguments] or folders()]
    for coverage in found:
        print("\n    ".join([str(coverage), *coverage.missed]))
    return 0 if all(coverage.complete for coverage in found) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
