"""How long a design takes: number of states, number of modes, method; where the time goes.

    python benchmarks/synthesis.py [--states 2 4 6 10] [--modes 1 4 8] [--methods ...] [--seed 1] [--out FOLDER]

Designs seeded random plants that have every kind of design by construction: A_q = M_q + K_q C with M_q >= 0 and all
row and column sums of M_q at most 0.7, so L = K_q makes A - L C = M_q, with one box and one P = I for all modes.
Writes synthesis.csv and SYNTHESIS.md into FOLDER (this one by default). Times are CPU seconds of this process, so
that another load on the machine does not count; the time on the clock stands beside them.
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import clarabel
import cvxpy
import numpy as np
import scipy

from codegen import pipeline
from codegen.errors import ResiduaError
from codegen.plant.load import gallery_names, load, loads
from codegen.selection import select
from codegen.synthesis import METHODS, detection

HERE = Path(__file__).parent
#: What is timed on its own: column -> object and name of the function.
PARTS = {
    "canonicalise": ((cvxpy.Problem, "get_problem_data"),),
    "solve": ((cvxpy.reductions.solvers.solving_chain.SolvingChain, "solve_via_data"),),
    "search": ((detection, "search"),),
    "exact": ((select, "certified"), (select, "claims_of")),
    "faults": ((select, "surely_detected"),),
}


@dataclass(frozen=True)
class Row:
    """One design: what was asked for, searches tried and candidates certified, what it cost, what came out."""

    plant: str
    n_x: int
    n_y: int
    n_modes: int
    method: str
    tried: int
    certified: int
    wall: float
    total: float
    canonicalise: float
    solve: float
    search: float
    exact: float
    faults: float
    outcome: str


def random_plant(n: int, modes: int, seed: int) -> str:
    """The plant file of a random plant with half as many outputs as states, one sensor and one state fault."""
    rng = np.random.default_rng([seed, n, modes])
    m = max(1, n // 2)
    C = np.hstack([np.eye(m), 0.3 * rng.uniform(-1, 1, (m, n - m))])

    def text(matrix) -> str:
        return str(np.round(matrix, 4).tolist())

    parts = []
    for q in range(modes):
        M = rng.random((n, n)) * (rng.random((n, n)) < 0.6) + np.diag(rng.random(n))
        M *= 0.7 / max(M.sum(axis=0).max(), M.sum(axis=1).max())
        A = M + 0.3 * rng.uniform(-1, 1, (n, m)) @ C
        parts.append(f'[[mode]]\nname = "mode {q}"\nA = {text(A)}\nB = {text(rng.uniform(-1, 1, (n, 1)))}\n'
                     f"Bw = {text(rng.uniform(-1, 1, (n, 2)))}\n")
    of_x = np.zeros((n, 2))
    of_x[0, 1] = 1.0  # seen at once by the first output
    of_y = np.zeros((m, 2))
    of_y[-1, 0] = 1.0

    def signals(stem: str, count: int, limit: str) -> str:
        return "[" + ", ".join(f'{{ name = "{stem}{i}", {limit} }}' for i in range(count)) + "]"

    return "\n".join([
        'format = 1', f'name = "random_{n}_{modes}"', 'title = "Random"', 'source = "benchmarks/synthesis.py"',
        'time = { kind = "discrete", sample_period = 1 }', "[signals]",
        f"x = {signals('x', n, 'range = [-50, 50]')}", f"u = {signals('u', 1, 'range = [-2, 2]')}",
        f"y = {signals('y', m, 'range = [-150, 150]')}", f"w = {signals('w', 2, 'bounds = [-0.1, 0.1]')}",
        f"v = {signals('v', m, 'bounds = [-0.01, 0.01]')}", f"f = {signals('f', 2, 'range = [-5, 5]')}",
        "[initial]", f"x_lo = {[-1] * n}", f"x_hi = {[1] * n}", "[common]", f"C = {text(C)}", f"Dv = {text(np.eye(m))}",
        f"Bf = {text(of_x)}", f"Df = {text(of_y)}", *parts])


@contextmanager
def stopwatch() -> Iterator[dict[str, float]]:
    """Time ``PARTS`` while the block runs; put everything back afterwards."""
    spent = dict.fromkeys(PARTS, 0.0)
    old = [(place, name, getattr(place, name)) for parts in PARTS.values() for place, name in parts]

    def timed(call: Callable, column: str) -> Callable:
        def wrapper(*args, **kwargs):
            before = time.process_time()
            try:
                return call(*args, **kwargs)
            finally:
                spent[column] += time.process_time() - before
        return wrapper

    for column, parts in PARTS.items():
        for place, name in parts:
            setattr(place, name, timed(getattr(place, name), column))
    try:
        yield spent
    finally:
        for place, name, call in old:
            setattr(place, name, call)


def measure(plant, method: str) -> Row:
    """Design one plant by one method."""
    head = (plant.name, plant.n_x, plant.n_y, plant.n_modes, method)
    reason = METHODS[method].module.inapplicable(plant)
    if reason is not None:
        return Row(*head, 0, 0, *[0.0] * (2 + len(PARTS)), f"does not apply: {reason}")
    said, certified, outcome = [], 0, "designed"
    with stopwatch() as spent:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            certified = len(pipeline.design(plant, method, said.append).choice)
        except ResiduaError as error:
            outcome = f"no design: {error}"
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    tried = sum(" boxes" not in line for line in said)  # the steps within a detection search are no tries of their own
    return Row(*head, tried, certified, wall, cpu, *spent.values(), outcome)


def table(rows: list[Row]) -> str:
    """SYNTHESIS.md."""
    lines = [
        "# Time of a design", "",
        "Written by `python benchmarks/synthesis.py`. *wall*: seconds on the clock (of a machine that others use too); "
        "all else CPU", "seconds. *canonicalise*, *solve*: cvxpy and its solvers (L-infinity and width design, whole "
        "line searches); *search*: the", "detection design; *exact*: rounding and the proof in exact arithmetic of "
        "every candidate; *faults*: surely detected faults of", "every candidate. *tried* without *certified*: "
        "infeasible at that decay rate, or lost in rounding. Random plants have a design", "by construction "
        "(`random_plant`); the gallery is at the end.", "",
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, numpy {np.__version__}, "
        f"scipy {scipy.__version__},", f"cvxpy {cvxpy.__version__}, clarabel {clarabel.__version__}.", "",
        f"| plant | n_x | n_y | modes | method | tried | certified | wall | total | {' | '.join(PARTS)} | |",
        "|---|--:|--:|--:|---|--:|--:|--:|--:|" + "--:|" * len(PARTS) + "---|"]
    for r in rows:
        times = " | ".join(f"{getattr(r, name):.2f}" for name in ("wall", "total", *PARTS))
        lines.append(f"| {r.plant} | {r.n_x} | {r.n_y} | {r.n_modes} | {r.method} | {r.tried} | {r.certified} | "
                     f"{times} | {'' if r.outcome == 'designed' else r.outcome} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, nargs="*", default=[2, 4, 6, 10])
    parser.add_argument("--modes", type=int, nargs="*", default=[1, 4, 8])
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--gallery", nargs="*", default=gallery_names())
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=HERE)
    given = parser.parse_args()
    plants = [loads(random_plant(n, modes, given.seed)) for n in given.states for modes in given.modes]
    plants += [load(name) for name in given.gallery]
    rows = []
    for plant in plants:
        for method in given.methods:
            rows.append(measure(plant, method))
            r = rows[-1]
            print(f"{r.plant:14} {r.method:14} {r.total:8.2f} s   "
                  + "  ".join(f"{name} {getattr(r, name):.2f}" for name in PARTS) + f"   {r.outcome[:60]}", flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    with open(given.out / "synthesis.csv", "w", encoding="ascii", newline="") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: round(v, 3) if isinstance(v, float) else v for k, v in asdict(r).items()} for r in rows)
    (given.out / "SYNTHESIS.md").write_text(table(rows), encoding="ascii")


if __name__ == "__main__":
    main()
