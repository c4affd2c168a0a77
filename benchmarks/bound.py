"""The lower bound of a case: loads, multiply-adds and stores of the nonzero entries, as scalar instructions.

Per sample, mean over the modes: one load per number of the state and the sample that is used, one per distinct
constant (not 0, not a factor 1 or -1); one multiplication per product; additions of each sum; one store per answer
and per number of the state; one return. Selecting the mode is free. Both bounds of an interval share the sum of the
input terms and each coefficient's load. Where the compiler uses a multiply-accumulate (gcc for Cortex-M4F at -Os: vmla,
which rounds twice) a product that is added is one instruction. Where double is a library (Cortex-M4F), a
multiplication and an addition cost what ``harness/probes.c`` measures in the same run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cases import Case


@dataclass(frozen=True)
class Work:
    """Instructions of a case by kind, mean over its modes; ``fused``: with multiply-accumulate, sums and products."""

    load: float
    multiply: float
    add: float
    fused: float
    store: float


def work(case: Case) -> Work:
    """Count a case.

    Parameters
    ----------
    case : Case

    Returns
    -------
    work : Work
    """
    return Work(*np.mean([_mode(case, q) for q in range(case.sizes[0])], axis=0))


def instructions(found: Work, fused: bool, multiply: float = 1.0, add: float = 1.0) -> float:
    """Return the bound; ``multiply`` and ``add`` are the cost of one, 1 where it is an instruction."""
    calculate = found.fused if fused else multiply * found.multiply + add * found.add
    return found.load + calculate + found.store + 1


def _mode(case: Case, q: int) -> tuple[int, ...]:
    t = {name: table[q] for name, table in case.tables.items()}
    _, n_x, _, n_y = case.sizes
    sides, constants, sums = len(case.sides), set(), []

    def factors(*rows):
        """Nonzero coefficients of a sum; the constants among them must be loaded."""
        found = np.abs(np.concatenate(rows))
        found = found[found > 0]
        constants.update(found[found != 1])
        return np.count_nonzero(found != 1), len(found)

    def offsets(name):
        constants.update(np.abs(t[name][t[name] != 0]))

    def row(products, terms, plain=0, times=1):
        sums.extend([(products, terms + plain)] * times)

    for i in range(n_y):
        row(*factors(t["C"][i]), plain=sides, times=sides)  # y, and the offset of an interval
    for i in range(n_x):
        if case.observer == "point":
            row(*factors(t["A"][i], t["B"][i], t["K"][i]))
        else:
            row(*factors(t["G"][i], t["L"][i]))
            row(*factors(t["M"][i]), plain=2, times=2)  # the sum above and the offset
    if case.observer == "interval":
        for name in ("c_lo", "c_hi", "d_lo", "d_hi"):
            offsets(name)
    sums = [(p, n) for p, n in sums if n]
    inputs = t["B" if case.observer == "point" else "G"]
    load = sides * n_x + n_y + np.count_nonzero(inputs.any(axis=0)) + len(constants)
    multiply, add = sum(p for p, _ in sums), sum(n - 1 for _, n in sums)
    fused = sum(n - 1 + (p == n) for p, n in sums)
    return load, multiply, add, fused, sides * (2 * n_x + n_y)
