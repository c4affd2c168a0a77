"""How far a floating-point sum can be from the exact one: the outward margins of the framers.

The C evaluates ``((t1 + t2) + ...) + tn`` with t = coefficient * value. With unit roundoff u every product
is off by at most u |product|, every sum by at most u |sum|, each plus the smallest normal number (so that
a target which flushes subnormals to zero is covered too). A fused multiply-add makes one of the two
errors instead of both, so the same bound holds whether the compiler contracts or not.
"""

from __future__ import annotations

from flint import fmpq

#: Unit roundoff and smallest normal number.
UNIT = {"float32": fmpq(1, 2**24), "float64": fmpq(1, 2**53)}
TINY = {"float32": fmpq(1, 2**126), "float64": fmpq(1, 2**1022)}


def input_error(magnitude: fmpq, real: str) -> fmpq:
    """How far the caller's nearest float may be from the physical value of at most this magnitude."""
    return UNIT[real] * magnitude + TINY[real]


def sum_error(terms: list[tuple[fmpq, fmpq]], real: str) -> tuple[fmpq, fmpq]:
    """Bound the rounding error of a sum of products in evaluation order.

    Parameters
    ----------
    terms : list of (coefficient, bound on the magnitude of the value)
        In the order of the C; an offset is a term with coefficient 1 and the offset as its value.
    real : {"float32", "float64"}

    Returns
    -------
    error : fmpq
        Largest distance of the computed from the exact sum.
    magnitude : fmpq
        Largest magnitude of the computed sum.
    """
    u, tiny = UNIT[real], TINY[real]
    total, error, first = fmpq(0), fmpq(0), True
    for coefficient, bound in terms:
        size = abs(coefficient) * abs(bound)
        if size == 0:
            continue
        # The coefficient 1 needs no product (a value *bounded* by 1 does); only flushing can touch such a term.
        slip = tiny if abs(coefficient) == 1 else u * size + tiny
        total += size + slip
        error += slip
        if not first:
            slip = u * total + tiny
            total += slip
            error += slip
        first = False
    return error, total
