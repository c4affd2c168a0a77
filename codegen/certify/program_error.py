"""How far a program of the C can be from the formula that it stands for: weights and known terms in floating point.

Every value has bounds and an error, from the inputs on: constants are rounded to the type, each operation loses at
most a unit roundoff and the smallest normal number. A choice between values is one of two kinds: the larger or smaller
of the two that it compares, and `select` of a conjunction, which is its first value wherever the program says that it
is in force. Functions of the libm promise nothing and have no bound here.
"""

from __future__ import annotations

from collections.abc import Sequence

from flint import fmpq

from ..errors import CertificateError
from .exact import Q
from .rounding import TINY, UNIT

#: Value bounds and error.
Value = tuple[fmpq, fmpq, fmpq]


def program_errors(program, inputs: Sequence[Value], real: str, units: fmpq | int = 2) -> list[Value]:
    """Bounds and error of every result but the last, which is a truth.

    Parameters
    ----------
    program : Program
    inputs : sequence of (lo, hi, error)
        Rational; the error is that of what the C is given.
    real : {"float32", "float64"}
    units : fmpq or int
        Relative error of a constant at most, in unit roundoffs: one of the type is near a number of the plant file, or
        near what rounded numbers of it make.

    Returns
    -------
    results : list of (lo, hi, error)

    Raises
    ------
    CertificateError
        An operation has no bound.
    """
    values: list[Value | None] = list(inputs)
    for c in program.constants:
        size = Q(c)
        values.append((size, size, units * UNIT[real] * abs(size) + TINY[real]))
    for k, op in enumerate(program.operations):
        values.append(_operation(program, k, op, [values[i] for i in op.args], real))
    out = [values[k] for k in program.results[:-1]]
    if any(v is None for v in out):
        raise CertificateError("certificate: a weight is a truth (found), expected a number.")
    return out


def _operation(program, k: int, op, args: list, real: str) -> Value | None:
    """Bounds and error of one operation; None for a truth."""
    name = op.name
    if name in ("ge", "le", "gt", "and"):
        return None
    if any(v is None for v in (args[1:] if name == "select" else args)):
        raise CertificateError("certificate: a weight or known term reads an estimate (found), expected inputs, "
                               "parameters and states that an output is.")
    if name == "select":
        return _select(program, op, args)
    (a_lo, a_hi, a), (b_lo, b_hi, b) = (*args, (fmpq(0), fmpq(0), fmpq(0)))[:2]
    a_size, b_size = max(abs(a_lo), abs(a_hi)), max(abs(b_lo), abs(b_hi))
    if name in ("neg", "abs", "min", "max"):  # exact
        if name == "neg":
            return -a_hi, -a_lo, a
        if name == "abs":
            return (fmpq(0) if a_lo <= 0 <= a_hi else min(abs(a_lo), abs(a_hi))), a_size, a
        pick = min if name == "min" else max
        return pick(a_lo, b_lo), pick(a_hi, b_hi), max(a, b)
    if name == "add":
        lo, hi, error = a_lo + b_lo, a_hi + b_hi, a + b
    elif name == "sub":
        lo, hi, error = a_lo - b_hi, a_hi - b_lo, a + b
    elif name == "mul":
        ends = [x * y for x in (a_lo, a_hi) for y in (b_lo, b_hi)]
        lo, hi, error = min(ends), max(ends), a_size * b + b_size * a + a * b
    elif name == "div":
        least = min(abs(b_lo), abs(b_hi))
        if b_lo <= 0 <= b_hi or least <= b:
            raise CertificateError("certificate: a divisor of a weight or known term may be zero, or is as small as "
                                   "its rounding. Narrow the ranges.")
        ends = [x / y for x in (a_lo, a_hi) for y in (b_lo, b_hi)]
        lo, hi, error = min(ends), max(ends), (a + max(map(abs, ends)) * b) / (least - b)
    else:
        raise CertificateError(f"certificate: {name} of the libm has no bound of its error (found in a weight or known "
                               "term), so that there is no threshold. Write it with + - * /.")
    size = max(abs(lo), abs(hi)) + error
    return _short(lo, hi, error + UNIT[real] * size + TINY[real])


def _select(program, op, args: list) -> Value:
    """A choice that is continuous, or the first value of one that says whether the program is in force."""
    truth = program.operations[op.args[0] - program.first]
    _, (a_lo, a_hi, a), (b_lo, b_hi, b) = args
    if truth.name == "and":
        return a_lo, a_hi, a
    if truth.name == "gt" and truth.args == op.args[1:]:
        return max(a_lo, b_lo), max(a_hi, b_hi), max(a, b)
    raise CertificateError("certificate: a weight or known term jumps between formulas (a removable quotient, found), "
                           "which has no bound of its error here. Write it without.")


def _short(lo: fmpq, hi: fmpq, error: fmpq) -> Value:
    """The same bounds, with fewer digits and no narrower."""
    def grid(x: fmpq, up: bool) -> fmpq:
        scaled = x * 2**80
        whole = -((-scaled.p) // scaled.q) if up else scaled.p // scaled.q
        return fmpq(whole, 2**80)

    return grid(lo, False), grid(hi, True), grid(error, True)
