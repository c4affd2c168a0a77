"""The steering-fault filter of a vehicle, whole: measurement sets and numbers of speed ranges, on host and board.

    python -m benchmarks.vehicle    some minutes; writes VEHICLE.md, and vehicle.json: constants and proof of each level

The car, ranges and sizes are those of ``tests/data/vehicle.toml``; the plant file of each row is made by the script
that makes the gallery's (``make_vehicle.py``), with the speed dependence covered exactly. Every row is designed,
certified on the constants of the C, printed, compiled, run against the reference bit by bit, validated, and run on a
Cortex-M4F.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import codegen
from codegen.analysis.validate import validate
from codegen.certify.exact import up
from codegen.certify.switched_gain import check_gain
from codegen.designs import pretty
from codegen.emit.render import template_root
from codegen.plant.load import gallery_folder, loads
from codegen.synthesis.fault_filter import stated
from codegen.target.onboard import run_on

HERE = Path(__file__).resolve().parent
TABLE, KEPT, DATA = HERE / "VEHICLE.md", HERE / "vehicle.json", HERE.parent / "tests" / "data" / "vehicle.toml"
BOARD = "m4f"
#: Measurement set and number of speed ranges; three are those of the data file, more are geometric between its ends.
CASES = (("steering_unknown", 3), ("a_y", 3), ("both", 3), ("both", 4), ("both", 6))
WORDS = {"steering_unknown": "a_y, steering unknown", "a_y": "a_y, steering known", "both": "a_y and yaw rate"}
OPTIONS = {"threshold": '"calibrated"', "set_rows": 60}


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    measured: str
    ranges: int
    level: float
    reached: float
    guaranteed: float
    calibrated: float
    runs: int
    delay: int | None
    flash: int
    state: int
    instructions: int
    kept: dict


def data() -> dict:
    """Contents of the data file."""
    return tomllib.loads(DATA.read_text())


def plant(measured: str, ranges: int, **options):
    """The plant file of a row.

    Parameters
    ----------
    measured : {"steering_unknown", "a_y", "both"}
    ranges : int
    **options
        Of ``[observer]``, as TOML.

    Returns
    -------
    Plant
    """
    d, make = data(), runpy.run_path(str(gallery_folder() / "data" / "make_vehicle.py"))
    f = d["filter"]
    sizes = {"x": tuple(f["x_size"])} | {k: float(f[k]) for k in ("steering", "wind", "a_y", "yaw_rate", "fault",
                                                                  "target")}
    speeds = [float(v) for v in f["speeds"]]
    if ranges != len(speeds) - 1:
        speeds = (speeds[0] * (speeds[-1] / speeds[0]) ** (np.arange(ranges + 1) / ranges)).tolist()
    text = make["plant_text"](d["vehicle"], sizes, f["sample_period"], speeds, False, 8, measured)
    lines = "".join(f"{k} = {v}\n" for k, v in options.items())
    return loads(text.replace("set_rows = 8\n", lines))


def whole(measured: str, ranges: int, folder: Path, board: bool = True, **options) -> Row:
    """Take one row all the way.

    Parameters
    ----------
    measured : str
    ranges : int
    folder : Path
        Where the C goes; not there yet.
    board : bool
        On the simulated board as well.
    **options
        As ``plant``.

    Returns
    -------
    Row

    Raises
    ------
    AssertionError
        C and reference differ, or a promise is broken.
    """
    made = codegen.design(plant(measured, ranges, **options))
    out = codegen.generate(made, folder)
    outcomes = validate(made, codegen.build(out))
    assert outcomes and all(o.passed and not o.differences for o in outcomes)
    cert, t = made.certificate["float32"], made.observer.tables["float32"]
    c = cert.get("calibration")
    last = np.max(t.h[-1].astype(float))
    (episode,) = [e for o in outcomes for e in o.episodes]
    run = run_on(out, BOARD, template_root() / "harness" / "board") if board else None
    assert run is None or (run.self_test == 0 and run.same_as_host)
    return Row(measured, ranges, cert["level"], cert["reached"], np.max(c["guaranteed"]) if c else last, last,
               c["runs"] if c else 0, episode.delay, run.flash_bytes if run else 0, run.state_bytes if run else 0,
               run.counts["step"].most if run else 0, kept(t, cert))


def kept(t, cert: dict) -> dict:
    """What the level of a row can be proved from again: the constants of the C, and the certificate of the energy.

    Parameters
    ----------
    t : FilterTables
    cert : dict
    """
    constants = {k: getattr(t, k).astype(float).tolist() for k in ("M", "L", "G", "K", "Dy", "Du")}
    return {"level": cert["level"], "constants": constants, "energy": cert["energy"]}


def proved(measured: str, ranges: int, row: dict) -> float:
    """The level of a row, proved again from what is kept of it, exactly.

    Parameters
    ----------
    measured : str
    ranges : int
    row : dict
        Of ``kept``.

    Raises
    ------
    CertificateError
        It is not proved by that.
    """
    made_for = plant(measured, ranges, **OPTIONS)
    problem, units = stated(made_for, made_for.options)
    gains = units.gains({k: np.array(v, dtype="float32") for k, v in row["constants"].items()})
    return up(check_gain(problem.modes, problem.names, problem.switching, gains, row["energy"])) ** 0.5


def write(rows: list[Row]) -> str:
    """The table."""
    f, printed = data()["filter"], data()["levels"]
    lines = ["# The steering-fault filter of a vehicle", "",
             f"{f['speeds'][0]} to {f['speeds'][-1]} m/s, {f['sample_period']:g} s, fault {f['fault']:g} rad, noise "
             f"{f['a_y']:g} m/s2 and {f['yaw_rate']:g} rad/s; float32, layout \"table\"; Cortex-M4F, gcc -O2.",
             "Made by `python -m benchmarks.vehicle`.", "",
             "| measured | ranges | level, certified | a run reaches | by another cover | threshold, guaranteed | "
             "calibrated | from runs | step of the fault found after | flash | state | instructions |",
             "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|"]
    for r in rows:
        other = printed[r.measured]["robust"] if r.ranges == 3 else printed[f"ranges_{r.ranges}"]
        delay = "-" if r.delay is None else f"{r.delay} samples"
        lines.append(f"| {WORDS[r.measured]} | {r.ranges} | {r.level:.4f} | {r.reached:.4f} | {other:g} | "
                     f"{r.guaranteed:.4f} | {r.calibrated:.4f} | {r.runs} | {delay} | {r.flash} | {r.state} | "
                     f"{r.instructions} |")
    return "\n".join([*lines, "", NOTES])


NOTES = """\
- Level: energy gain from all unknowns to the error of the estimate, certified on the constants of the C for
  every speed in the ranges and any switching between them. "By another cover": the same problem with the rest of the
  cover as a full block (`tests/data/vehicle.toml`); here it is a disturbance at the declared ranges.
- Thresholds in rad, of the largest mode. Guaranteed: no estimate exceeds it without a fault, whatever wind, driver,
  noise and speed do; that is for a driver who steers from stop to stop at random, and more than the fault. Calibrated:
  a run of 2 s with uniform disturbances has a false alarm with at most 1 % probability, with 95 % confidence.
- The fault: a step of its declared size in the second third of the scenario "offset of the steering".
- Instructions: of the dearest step. Flash and state in bytes.
"""


def main() -> int:
    """Measure all rows and write the table."""
    rows = []
    for measured, ranges in CASES:
        with tempfile.TemporaryDirectory() as scratch:
            rows.append(whole(measured, ranges, Path(scratch) / "vehicle", **OPTIONS))
        print(rows[-1], flush=True)
    TABLE.write_text(write(rows), encoding="utf-8")
    KEPT.write_text(pretty({f"{r.measured} {r.ranges}": r.kept for r in rows}, 2) + "\n", encoding="ascii")
    return 0


if __name__ == "__main__":
    sys.exit(main())
