"""Residual sets side by side on one plant: what each finds and costs, as firmware.

The plant of Zammali (2020), 6.3.5, whose modes last five samples and come in turn. Every method of residua is designed,
certified, printed and measured; a point observer with every set and every table that there is. Rows are the walk of
``codegen.compare``: a new set is a row by itself. (Gains of method "zonotope" are placed for faults on the state, of
which this plant has none: they are left out.)
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from codegen.analysis.set_history import watch
from codegen.compare import Compared, Variant, compare, variants
from codegen.observers import PointTables
from codegen.plant.load import load, loads
from codegen.plant.model import Plant
from codegen.synthesis import METHODS, SETS

Array = np.ndarray
HERE = Path(__file__).resolve().parent
RESULTS, TABLE = HERE / "sets.csv", HERE / "SETS.md"

PLANT, DWELL = "zammali_ellipsoid", 5
ORDERS = (5, 10, 20)
STATE_FAULTS = "zonotope"
#: Samples before the first onset, onsets, and samples in which a fault is to be found "eventually".
BEFORE, ONSETS, WITHIN = 20, 15, 15
#: Size of the fault whose response is taken: far below any set, so that nothing alarms and starts anew.
SMALL = 1e-6
#: Goals of f_on by kind of set: the figures of a prototype of each.
GOALS = {"interval": 0.116, "ellipsoid": 0.063, "zonotope": 0.058}
FIELDS = ("name", "kind", "family", "label", "on", "within", "promised_on", "promised_within", "multiply",
          "instructions", "ram", "flash", "stack", "reason")


def plant() -> Plant:
    """Return the plant, told that its modes last five samples (and, where residua reads that, come in turn)."""
    switching = f"\n[switching]\nminimum_dwell = {DWELL}\n"
    if "schedule" in SETS["tables"]:
        switching += f'schedule = {{ every = {DWELL}, order = ["1", "2", "3"] }}\n'
    return loads(load(PLANT).text + switching, name=PLANT)


def chosen(quick: bool) -> list[Variant]:
    """Return the rows: all with residuals that take the plant, or the cheapest set of each kind of one method."""
    able = [v for v in variants(ORDERS) if METHODS[v.method].module.inapplicable(plant()) is None
            and (METHODS[v.method].framers or METHODS[v.method].sets) and v.method != STATE_FAULTS]
    return [v for v in able if v.method == "ellipsoid" and v.options.get("order", 5) == 5] if quick else able


def kind_of(v: Variant) -> str:
    """Return the kind of set: interval, ellipsoid, zonotope, or the word of a table."""
    if METHODS[v.method].framers:
        return "interval"
    return v.options.get("tables", v.options.get("set", ""))


def sure(made, path: Array) -> tuple[float, float]:
    """Return the smallest step that is surely found along a schedule, at once and within ``WITHIN`` samples.

    The response of the residual to the step is measured on the reference; whatever disturbance and noise do, a residual
    is outside where it is moved by more than twice the set (by the width of an interval). The worst onset counts.

    Parameters
    ----------
    made : Design
    path : ndarray (K,) int

    Returns
    -------
    on, within : float
    """
    p, observer = made.plant, made.observer
    onsets = range(BEFORE, BEFORE + ONSETS)
    y = np.stack([outputs(p, path, len(path)), *(outputs(p, path, k) for k in onsets)])
    u, q = np.zeros((*y.shape[:2], p.n_u)), np.tile(path, (len(y), 1))
    trace = observer.run_many(u, y, q, "float64")
    assert not trace.raw_bits.any() and not trace.status.any()
    point = isinstance(observer.tables["float64"], PointTables)
    r = trace.r if point else (trace.r_lo + trace.r_hi) / 2
    moved = (r[1:] - r[0]) / SMALL
    if point:
        history = watch(observer, "float64", SimpleNamespace(u=u[0], y=y[0], q=path))
    found = []
    for k, response in zip(onsets, moved):
        at = np.arange(k, k + WITHIN + 1)
        seen = np.abs(response[at]).max(axis=1) > 1e-9
        with np.errstate(divide="ignore"):
            if point:
                rays = np.where(seen[:, None], response[at], 1.0)
                size = np.where(seen, 2 * history.reach(at, rays[:, None])[:, 0], np.inf)
            else:
                size = np.min((trace.r_hi - trace.r_lo)[0, at] / np.abs(response[at]), axis=1)
        found.append(np.minimum.accumulate(size))
    worst = np.max(found, axis=0)
    return float(worst[0]), float(worst[-1])


def outputs(p: Plant, path: Array, onset: int) -> Array:
    """Return the outputs of a plant at rest that meets a small step on its first fault channel, (K, n_y)."""
    x, y = np.zeros(p.n_x), []
    for k, q in enumerate(path):
        m, f = p.modes[q], SMALL * (k >= onset)
        y.append(m.C @ x + m.Df[:, 0] * f)
        x = m.A @ x + m.Bf[:, 0] * f
    return np.array(y)


def measure(quick: bool = False, progress=lambda text: None) -> list[dict]:
    """Measure every row; those without a design say why.

    Parameters
    ----------
    quick : bool
    progress : callable

    Returns
    -------
    records : list of dict
        ``FIELDS``.
    """
    rows, designs = chosen(quick), {}
    found = compare(plant(), rows, progress, lambda v, made: designs.__setitem__(v.name, made))
    path = np.tile(np.repeat(np.arange(3), DWELL), 5)[:BEFORE + ONSETS + WITHIN + 1]
    return [record(v, c, sure(designs[v.name], path) if not c.reason else (None, None)) for v, c in zip(rows, found)]


def record(v: Variant, c: Compared, figures: tuple) -> dict:
    """Return one line of the CSV file."""
    promised = c.faults[0] if c.faults else (None, None)
    return {k: x for k, x in (asdict(c) | {"kind": kind_of(v), "on": figures[0], "within": figures[1],
                                           "promised_on": promised[0], "promised_within": promised[-1]}).items()
            if k in FIELDS}


def write(records: Sequence[dict], path: Path = RESULTS) -> None:
    """Write the records as CSV; figures to six digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{x:.6g}" if isinstance(x, float) else "" if x is None else x for k, x in r.items()}
                         for r in records)


def read(path: Path = RESULTS) -> list[dict]:
    """Read records, all values text."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def goals(records: Sequence[dict]) -> dict[str, tuple[float, float, str]]:
    """Return the smallest f_on of each kind of set that has a goal: goal, what was reached, by which row."""
    out = {}
    for kind, goal in GOALS.items():
        own = [r for r in records if r["kind"] == kind and r["on"]]
        if own:
            best = min(own, key=lambda r: float(r["on"]))
            out[kind] = goal, float(best["on"]), best["name"]
    return out


def render(records: Sequence[dict]) -> str:
    """Print the records (values text) as Markdown."""
    def cell(text) -> str:
        return str(text) if text not in ("", None) else "-"

    def figure(text) -> str:
        return f"{float(text):.3g}" if text not in ("", None) else "-"

    made, lost = [r for r in records if not r["reason"]], [r for r in records if r["reason"]]
    lines = ["# Residual sets side by side", "",
             f"The plant of Zammali (2020), 6.3.5 (gallery: {PLANT}), modes in turn, {DWELL} samples each; float32,",
             "the layout of the plant file; Cortex-M4F, gcc -Os. Made by `python -m benchmarks.sets`.", "",
             "| set | gains | f_on | f_late | promised at once | promised in time | multiply-adds | instructions | RAM "
             "| flash | stack |", "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|"]
    lines += ["| " + " | ".join([r["name"], r["label"], *(figure(r[k]) for k in (
        "on", "within", "promised_on", "promised_within")), *(cell(r[k]) for k in (
            "multiply", "instructions", "ram", "flash", "stack"))]) + " |" for r in made]
    lines += [
        "", f"- f_on, f_late: smallest step of the sensor fault that is surely found, at once and within {WITHIN}",
        "  samples, whatever disturbance and noise do, along this schedule from sample "
        f"{BEFORE} on; the worst of {ONSETS} onsets.",
        "  The response has to exceed twice the firmware's own set (the width of an interval), asked of its own test.",
        "- Promised: what the certificate says, for every mode sequence with that dwell time; within 3 samples. It may",
        "  be below f_on where noise alone cannot fill the firmware's set: f_on counts the set twice.",
        "- Multiply-adds: of the dearest call. Instructions: of the dearest ordinary step of the self-test, in QEMU.",
        ""]
    lines += ["| kind of set | goal for f_on | reached | by |", "|---|--:|--:|---|"]
    lines += [f"| {kind} | {goal:g} | {reached:.3g}{'' if reached <= goal else ' (missed)'} | {name} |"
              for kind, (goal, reached, name) in goals(records).items()]
    lines += [""] * bool(lost) + [f"- No design: {r['name']}: {r['reason']}" for r in lost]
    return "\n".join(lines) + "\n"


def main(quick: bool = False) -> None:
    """Measure; print (quick), or write sets.csv and SETS.md."""
    import sys

    records = measure(quick, lambda text: print(text, file=sys.stderr, flush=True))
    if quick:
        print(render([{k: "" if x is None else str(x) for k, x in r.items()} for r in records]))
        return
    write(records)
    TABLE.write_text(render(read()), encoding="utf-8")
    print(f"{TABLE} written")


if __name__ == "__main__":
    import sys

    main("--quick" in sys.argv)
