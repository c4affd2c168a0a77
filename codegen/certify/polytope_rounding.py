r"""What the C of a polytopic observer may be off by: every sum in its order, what comes in, weights that are not 1.

Every sum of the C in its order (``rounding.sum_error``), what conversion does to u and y, and weights whose sum is not
1: ``weight_program`` makes them numbers in [0, 1], and their sum is 1 but for the rounding of a tree of products, or
found to be so by the C itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from .exact import Q
from .rounding import UNIT, input_error, sum_error

Array = np.ndarray


@dataclass(frozen=True)
class Rounding:
    """What the C may be off by; rational object arrays.

    Parameters
    ----------
    y : ndarray (p,), u : ndarray (m,)
        Of the numbers that it is given.
    x_hat : ndarray (n,), r : ndarray (p,), weighted : ndarray (p,), z : ndarray (n,)
        Of its sums, that of z with weights that do not add up to 1.
    """

    y: Array
    u: Array
    x_hat: Array
    r: Array
    weighted: Array
    z: Array


def sizes(lo: Array, hi: Array) -> Array:
    """Largest magnitudes of ranges, exactly."""
    return np.array([max(abs(Q(a)), abs(Q(b))) for a, b in zip(lo, hi)], dtype=object).reshape(len(lo))


@dataclass(frozen=True)
class Sums:
    """(error, largest magnitude) of every sum of the C: of x_hat, r, M r, of what vertex j says of z_i, of z_i.

    ``off`` is how far the sum of the weights may be from 1.
    """

    x_hat: list
    r: list
    weighted: list
    vertex: list[list]
    z: list
    off: fmpq


def off_one(t) -> fmpq:
    """How far the sum of the weights is from 1: what the C accepts, and the rounding of the sum that it looked at.

    Parameters
    ----------
    t : PolytopicTables
    """
    return (8 * len(t.F) + 4) * 2 * UNIT[t.real]


def sums(t, known=(), x_hat: list[tuple[fmpq, fmpq]] | None = None) -> Sums:
    """Bound the rounding of every sum of the C of tables by itself, in its order of evaluation.

    Parameters
    ----------
    t : PolytopicTables
    known : sequence of fmpq
        Largest magnitudes of the known terms.
    x_hat : list of (fmpq, fmpq), optional
        Rounding and magnitude of its entries, where it is not z + T2 y.
    """
    real, z, y, u = t.real, sizes(t.z_lo, t.z_hi), sizes(t.y_lo, t.y_hi), sizes(t.u_lo, t.u_hi)

    def row(coefficients, operands, first=()):
        return sum_error([*first, *((Q(c), b) for c, b in zip(coefficients, operands))], real)

    x_hat = x_hat or [row(t.T2[i], y, [(fmpq(1), z[i])]) for i in range(len(z))]
    most = [m for _, m in x_hat]
    r = [row(t.C[i], most, [(fmpq(1), y[i])]) for i in range(len(y))]
    weighted = [row(M, [m for _, m in r]) for M in t.M] if t.weighted else [(fmpq(0), m) for _, m in r]
    operands = [*most, *u, *(m for _, m in r), *known]
    off, vertex, after = off_one(t), [], []
    for i in range(len(z)):
        vertex.append([row(np.where(t.shared[i], 0, M[i]), operands) for M in t.gains])
        terms = [(Q(c), b) for c, b in zip(np.where(t.shared[i], t.gains[0, i], 0), operands)]
        after.append(sum_error([*terms, *((1 + off, m) for _, m in vertex[i])], real))
    return Sums(x_hat, r, weighted, vertex, after, off)


def rounding(t, known=(), x_hat: list[tuple[fmpq, fmpq]] | None = None) -> Rounding:
    """Bound what the C of tables rounds: the sums of the vertices by their weights.

    Parameters
    ----------
    t : PolytopicTables
    known : sequence of fmpq
        Largest magnitudes of the known terms.
    x_hat : list of (fmpq, fmpq), optional
        Rounding and magnitude of its entries, where it is not z + T2 y.
    """
    real, y, u, found = t.real, sizes(t.y_lo, t.y_hi), sizes(t.u_lo, t.u_hi), sums(t, known, x_hat)
    off = found.off
    after = [error + (1 + off) * max(e for e, _ in own) + off * max(m for _, m in own)
             for (error, _), own in zip(found.z, found.vertex)]
    vectors = [[input_error(b, real) for b in y], [input_error(b, real) for b in u],
               *([e for e, _ in values] for values in (found.x_hat, found.r, found.weighted)), after]
    return Rounding(*(np.array(v, dtype=object).reshape(len(v)) for v in vectors))
