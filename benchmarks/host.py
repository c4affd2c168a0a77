"""The compiled observer against the numpy reference on the gallery: microseconds per sample, and their ratio.

    python benchmarks/host.py [--runs 200] [--repeat 7] [--out FOLDER]

Every committed design, compiled as it is on the host, over its longest simulated scenario: one run of all samples
(``run``), and many runs in one call (``run_many``), whose reference is vectorised over the runs. Both answers must
be ``==``. The best of several repetitions counts. Writes host.csv into FOLDER (this one by default); status 1 where
the goal of 200 times the reference (``run``) is missed or an answer differs.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from codegen.designs import read_design
from codegen.emit.package import files
from codegen.host import build
from codegen.plant.simulate import simulate

HERE = Path(__file__).parent
GOAL = 200.0


def best(call: Callable[[], object], repeat: int) -> float:
    """Shortest of several runs, in CPU seconds (another load on the machine does not count)."""
    times = []
    for _ in range(repeat):
        before = time.thread_time()
        call()
        times.append(time.thread_time() - before)
    return min(times)


def measure(folder: Path, runs: int, repeat: int) -> dict:
    """One design: one run, and many runs of different seeds."""
    design = read_design(folder)
    scenario = max((s for s in design.plant.scenarios if not s.csv), key=lambda s: s.steps)
    truths = [simulate(design.plant, scenario, seed=seed) for seed in range(runs)]
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in files(design, measure=False).items():
            (Path(scratch) / name).write_text(text, encoding="ascii")
        driver = build(scratch)
    real = driver.real
    u, y = (np.stack([getattr(t, name) for t in truths]).astype(real) for name in "uy")
    q = np.stack([t.q for t in truths]).astype(np.uint32)
    first, one = truths[0], (u[0], y[0], q[0])
    c, reference = driver.run(*one, copy=False), design.observer.run(*one, real=real)
    many_c, many_reference = driver.run_many(u, y, q, copy=False), design.observer.run_many(u, y, q, real)
    steps = len(q[0])
    row = {"design": folder.name, "real": real, "samples": steps,
           "c_us": 1e6 / steps * best(lambda: driver.run(*one, copy=False), 10 * repeat),
           "c_converting_us": 1e6 / steps * best(lambda: driver.run(first.u, first.y, first.q), 10 * repeat),
           "reference_us": 1e6 / steps * best(lambda: design.observer.run(*one, real=real), repeat), "runs": runs,
           "c_many_us": 1e6 / (runs * steps) * best(lambda: driver.run_many(u, y, q, copy=False), repeat),
           "reference_many_us": 1e6 / (runs * steps) * best(lambda: design.observer.run_many(u, y, q, real), 1)}
    row |= {"ratio": row["reference_us"] / row["c_us"], "ratio_many": row["reference_many_us"] / row["c_many_us"]}
    return row | {"equal": not c.differs(reference) and not many_c.differs(many_reference)}


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--out", type=Path, default=HERE)
    given = parser.parse_args()
    rows = []
    print("microseconds per sample           run: C (converting)   reference   ratio | run_many: C  reference  ratio")
    for path in sorted((HERE.parent / "generated").glob("*/design.json")):
        r = measure(path.parent, given.runs, given.repeat)
        rows.append(r)
        print(f"{r['design']:28} {r['samples']:5} {r['c_us']:6.3f} ({r['c_converting_us']:.3f}) "
              f"{r['reference_us']:12.1f} {r['ratio']:8.0f} | {r['c_many_us']:8.4f} {r['reference_many_us']:10.3f} "
              f"{r['ratio_many']:6.0f}{'' if r['equal'] else '   DIFFERENT'}", flush=True)
    with open(given.out / "host.csv", "w", encoding="ascii", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows)
    return 0 if all(r["equal"] and r["ratio"] >= GOAL for r in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
