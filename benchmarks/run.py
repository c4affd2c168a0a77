"""One command, one run, one table: our layouts against what a user would pick instead.

    python -m benchmarks            measure everything (half an hour); writes results.csv, whole.csv, RESULTS.md,
                                    sets.csv, SETS.md
    python -m benchmarks --quick    a few rows, printed, nothing written
    python -m benchmarks --table    write RESULTS.md and SETS.md from the CSV files again

Needs gcc, valgrind, arm-none-eabi-gcc, qemu-system-arm and the package's extra ``bench``; Eigen (Debian: libeigen3-dev,
on the board also libstdc++-arm-none-eabi-newlib). A rival that is not installed is left out and named.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from . import cases, measure, ours, sets, table, whole
from .rivals import RIVALS

HERE = Path(__file__).resolve().parent
RESULTS, WHOLE, TABLE = HERE / "results.csv", HERE / "whole.csv", HERE / "RESULTS.md"


@dataclass(frozen=True)
class Setting:
    """One row of the table: the case, the machine and the compiler's option."""

    observer: str
    plant: str
    n: int
    modes: int
    real: str
    target: str
    optimise: str


def settings() -> list[Setting]:
    """Return all rows: the whole grid of sparse plants, and dense ones of one size."""
    grid = [("sparse", n, modes) for n in (2, 4, 6, 10) for modes in (1, 4, 8)] + [("dense", 6, 4)]
    return [Setting(observer, plant, n, modes, real, target, optimise) for observer in ("point", "interval")
            for plant, n, modes in grid for real in ("float32", "float64") for target in measure.TARGETS
            for optimise in ("-O2", "-Os")]


QUICK = (Setting("point", "sparse", 4, 4, "float32", "host", "-O2"),
         Setting("point", "sparse", 6, 1, "float32", "m4f", "-Os"),
         Setting("interval", "sparse", 4, 4, "float32", "m4f", "-Os"),
         Setting("interval", "sparse", 2, 4, "float64", "m4f", "-Os"))


def rivals(target: str) -> tuple[list[str], list[str]]:
    """Return the names of the rivals that can be built for a target, and of those that cannot."""
    able = [name for name, r in RIVALS.items()
            if measure.present(r) and (not r.HEADER or measure.able(target, r.HEADER))]
    return able, [name for name in RIVALS if name not in able]


@cache
def case_of(observer: str, plant: str, n: int, modes: int, real: str) -> cases.Case:
    """Return the case of a row."""
    return cases.make(observer, n, modes, real, plant == "dense")


@cache
def printed(name: str, *key) -> dict[str, str]:
    """Return a rival's code for the case with the arguments ``key``; printed once for all targets and options."""
    return RIVALS[name].sources(case_of(*key))


def run_one(setting: Setting, names: tuple[str, ...] | None = None) -> list[dict]:
    """Measure one row: a record per candidate.

    Parameters
    ----------
    setting : Setting
    names : tuple of str, optional
        Rivals; default: all that can be built.

    Returns
    -------
    records : list of dict
        As the lines of results.csv.
    """
    s = setting
    key = (s.observer, s.plant, s.n, s.modes, s.real)
    case = case_of(*key)
    names = tuple(rivals(s.target)[0]) if names is None else names
    candidates = ours.sources(case) | {name: printed(name, *key) for name in names}
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        row = measure.measure(case, candidates, s.target, s.optimise, Path(scratch))
    fastest = min((f.nanoseconds for n, f in row.figures.items() if n in names and f.nanoseconds), default=None)
    return [asdict(s) | {"bound": round(row.bound), "candidate": name, "instructions": f.instructions,
                         "flash_bytes": f.flash_bytes, "stack_bytes": "" if f.stack_bytes is None else f.stack_bytes,
                         "time_ratio": f"{f.nanoseconds / fastest:.2f}" if f.nanoseconds and fastest else ""}
            for name, f in row.figures.items()]


def write(records: list[dict], path: Path) -> None:
    """Write the records as CSV."""
    with path.open("w", newline="", encoding="ascii") as file:
        writer = csv.DictWriter(file, list(records[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)


def read(path: Path) -> list[dict]:
    """Read records, all values text."""
    with path.open(newline="", encoding="ascii") as file:
        return list(csv.DictReader(file))


def text() -> str:
    """Return RESULTS.md: what the two CSV files hold."""
    return f"{table.render(read(RESULTS))}\n{whole.render(read(WHOLE))}"


def main(arguments: list[str]) -> int:
    """Measure, or only print the table; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few rows, printed, nothing written")
    parser.add_argument("--table", action="store_true", help="write RESULTS.md from the CSV files, measure nothing")
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args(arguments)
    if not chosen.table:
        for target in measure.TARGETS:
            for name in rivals(target)[1]:
                print(f"{name} is not installed for {target}: left out", file=sys.stderr)
        rows = QUICK if chosen.quick else settings()
        with ProcessPoolExecutor(chosen.jobs) as pool:
            records = []
            for done, found in enumerate(pool.map(run_one, rows, chunksize=1 if chosen.quick else 4), 1):
                records += found
                print(f"{done}/{len(rows)}", end="\r", file=sys.stderr, flush=True)
        if chosen.quick:
            print(table.render([{k: str(v) for k, v in r.items()} for r in records]))
            sets.main(quick=True)
            return 0
        write(records, RESULTS)
        write(whole.measure(), WHOLE)
        sets.write(sets.measure())
    TABLE.write_text(text(), encoding="ascii")
    sets.TABLE.write_text(sets.render(sets.read()), encoding="utf-8")
    print(f"{TABLE} and {sets.TABLE} written")
    return 0
