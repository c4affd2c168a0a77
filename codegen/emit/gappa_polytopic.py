"""The sums of a polytopic observer in Gappa's words: estimate, residual, what every vertex says of z, and z itself.

The weights are numbers in [0, 1 + 4 eps], which ``weight_program`` makes them and the C checks where they are
normalised; what their sum is off by 1 is no rounding of a sum and has its own part in the thresholds. Each sum is
stated by itself: what it reads of another sum is a number of its largest magnitude. Of a design that estimates faults
the known terms are such numbers too. A tracking law has margins of its own proof. Where the observer solves the
algebraic equations their sums take the place of the estimate's; weights g that are quotients are like the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..certify.descriptor_bounds import algebraic_rounding, solved_sums
from ..certify.exact import Q, down, up
from ..certify.fault_bounds import slips
from ..certify.polytope_rounding import sums as rounded_sums
from .gappa_sums import _join, _product

Array = np.ndarray


@dataclass(frozen=True)
class PolytopicSum:
    """One sum: name, what it is, its terms in evaluation order, what it may be off by."""

    name: str
    note: str
    terms: tuple[str, ...]
    margin: float


def stated(plant, t, prefix: str) -> tuple[list[PolytopicSum], list[tuple[str, str, str]]]:
    """State every sum of a polytopic observer, and name the numbers that they read, with the ends of their ranges.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    prefix : str
        Of the observer.

    Returns
    -------
    sums : list of PolytopicSum
        Those that are a number alone are left out.
    operands : list of (str, str, str)
    """
    known = slips(t, plant.polytope.premises).size if t.known.size else ()
    found = rounded_sums(t, known, algebraic_rounding(t) if hasattr(t, "algebraic") else None)
    rows = [s for s in _sums(t, found, prefix) if len(s.terms) > 1 or "*" in s.terms[0]]
    return rows, list(_operands(t, found, known))


def _sums(t, found, prefix: str) -> Iterator[PolytopicSum]:
    p, n = t.C.shape
    measured, estimates, residuals = (_names(v, k) for v, k in (("y", p), ("x_hat", n), ("r", p)))
    values = [*estimates, *_names("u", t.G.shape[2]), *residuals, *_names("g", t.known.shape[1])]
    if hasattr(t, "algebraic"):
        yield from _solved(t, prefix)
    else:
        for i in range(n):
            yield PolytopicSum(f"{prefix}_estimate_{i}", f"x_hat[{i}]", _join([f"z_{i}", *_row(t.T2[i], measured)]),
                               down(found.x_hat[i][0]))
    for i in range(p):
        yield PolytopicSum(f"{prefix}_residual_{i}", f"r[{i}]", _join([f"y_{i}", *_row(-t.C[i], estimates)]),
                           down(found.r[i][0]))
    for i in range(p) if t.weighted else ():
        yield PolytopicSum(f"{prefix}_shown_{i}", f"r[{i}] as answered", _join(_row(t.M[i], residuals)),
                           down(found.weighted[i][0]))
    for i in range(n):
        blended = []
        for j, M in enumerate(t.gains):
            own = _row(np.where(t.shared[i], 0, M[i]), values)
            if own:
                yield PolytopicSum(f"{prefix}_vertex_{i}_{j}", f"z[{i}] as vertex {j} says", _join(own),
                                   down(found.vertex[i][j][0]))
                blended.append(f"(h_{j} * v_{i}_{j})")
        terms = [*_row(np.where(t.shared[i], t.gains[0, i], 0), values), *blended]
        yield PolytopicSum(f"{prefix}_move_{i}", f"z[{i}] of the next sample", _join(terms), down(found.z[i][0]))


def _solved(t, prefix: str) -> Iterator[PolytopicSum]:
    """The sums of the algebraic states; all others of x_hat are z."""
    values, weight = [*_names("z", len(t.z0)), *_names("u", t.Q.shape[2])], "g" if t.uneven else "h"
    for row, (i, (vertex, (error, _))) in enumerate(zip(t.algebraic, solved_sums(t))):
        blended = []
        for j, M in enumerate(t.solved):
            own = _row(np.where(t.common[row], 0, M[row]), values)
            if own:
                yield PolytopicSum(f"{prefix}_solved_{i}_{j}", f"x_hat[{i}] as vertex {j} says", _join(own),
                                   down(vertex[j][0]))
                blended.append(f"({weight}_{j} * a_{i}_{j})")
        terms = [*_row(np.where(t.common[row], t.solved[0, row], 0), values), *blended]
        yield PolytopicSum(f"{prefix}_estimate_{i}", f"x_hat[{i}]", _join(terms), down(error))


def _operands(t, found, known) -> Iterator[tuple[str, str, str]]:
    for vector in ("z", "y", "u"):
        lo, hi = (getattr(t, f"{vector}_{side}").astype(float) for side in ("lo", "hi"))
        yield from ((f"{vector}_{j}", min(a, 0.0).hex(), max(b, 0.0).hex()) for j, (a, b) in enumerate(zip(lo, hi)))
    for vector, sizes in (("x_hat", [m for _, m in found.x_hat]), ("r", [m for _, m in found.r]), ("g", known)):
        yield from ((f"{vector}_{j}", (-up(m)).hex(), up(m).hex()) for j, m in enumerate(sizes))
    yield from ((f"h_{j}", 0.0.hex(), down(1 + found.off).hex()) for j in range(len(t.F)))
    if hasattr(t, "algebraic"):
        yield from ((f"g_{j}", 0.0.hex(), down(1 + found.off).hex()) for j in range(len(t.F)) if t.uneven)
        for i, (row, _) in zip(t.algebraic, solved_sums(t)):
            yield from ((f"a_{i}_{j}", (-up(m)).hex(), up(m).hex()) for j, (_, m) in enumerate(row) if m != Q(0))
    for i, row in enumerate(found.vertex):
        yield from ((f"v_{i}_{j}", (-up(m)).hex(), up(m).hex()) for j, (_, m) in enumerate(row) if m != Q(0))


def _names(vector: str, count: int) -> list[str]:
    return [f"{vector}_{j}" for j in range(count)]


def _row(row: Array, names: list[str]) -> list[str]:
    return [_product(c, name) for c, name in zip(row, names) if c != 0]
