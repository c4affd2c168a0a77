"""Exact rational matrices and the one decision that needs an algorithm: positive definiteness."""

from __future__ import annotations

import numpy as np
from flint import arb, ctx, fmpq, fmpq_mat

from ..errors import CertificateError

Array = np.ndarray


def Q(value) -> fmpq:
    """The exact rational value of a float (or int, or fmpq).

    Raises
    ------
    CertificateError
        Infinite or not a number.
    """
    if isinstance(value, fmpq):
        return value
    try:
        return fmpq(*float(value).as_integer_ratio())
    except (OverflowError, ValueError):
        raise CertificateError(f"certificate: a constant is {float(value)} (found), expected a finite number. Where "
                               "it is a range too large for float32, use float64 or another unit.") from None


def rational(array: Array) -> Array:
    """Object array of the exact values; ``@``, ``+`` and ``*`` of numpy then are exact."""
    array = np.asarray(array)
    out = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        out[index] = Q(array[index])
    return out


def product(A: Array, B: Array) -> Array:
    """Exact matrix product of rational object arrays (empty inner dimension gives exact zeros)."""
    if A.shape[1] == 0:
        return zeros(A.shape[0], B.shape[1])
    return A @ B


def inverse(A: Array) -> Array:
    """Exact inverse of a rational object array.

    Raises
    ------
    CertificateError
        There is none.
    """
    try:
        found = fmpq_mat([[Q(x) for x in row] for row in A]).inv()
    except ZeroDivisionError:
        raise CertificateError("certificate: the change of coordinates has no inverse. Take another one.") from None
    out = zeros(*A.shape)
    for i, j in np.ndindex(A.shape):
        out[i, j] = found[i, j]
    return out


def zeros(*shape: int) -> Array:
    """Object array of exact zeros."""
    out = np.empty(shape, dtype=object)
    out.fill(fmpq(0))
    return out


def eye(n: int) -> Array:
    """Exact identity."""
    out = zeros(n, n)
    for i in range(n):
        out[i, i] = fmpq(1)
    return out


def leading_failure(S: Array) -> int | None:
    """Index of the first non-positive pivot of the symmetric rational S, or None: S is positive definite.

    Exact, so its answer is a proof either way.
    """
    found = exact_pivots(S)
    return len(found) - 1 if found and found[-1] <= 0 else None


def up(value: fmpq, real: str = "float64") -> float:
    """Smallest convenient float that is not below the rational ``value``."""
    return _directed(value, real, np.inf)


def down(value: fmpq, real: str = "float64") -> float:
    """Largest convenient float that is not above the rational ``value``."""
    return _directed(value, real, -np.inf)


def _directed(value: fmpq, real: str, direction: float) -> float:
    dtype = np.dtype(real).type
    with np.errstate(over="ignore"):  # an overflow becomes infinite, which Q refuses
        guess = dtype(float(value))
    while (Q(guess) < value) if direction > 0 else (Q(guess) > value):
        guess = np.nextafter(guess, dtype(direction))
    return float(guess)


def pivots(S: Array, bits: int = 320) -> list[fmpq]:
    """Numbers that no pivot of the symmetric rational S is below; the last is not positive where S is not definite.

    The elimination is done in balls, and where these are too wide exactly: fractions of thousands of digits take ten
    times as long, for matrices of thirty rows.

    Parameters
    ----------
    S : object array (n, n)
        Exact.
    bits : int
    """
    before, ctx.prec = ctx.prec, bits
    try:
        M, out = [[arb(x) for x in row] for row in S], []
        for k, row in enumerate(M):
            if not row[k] > 0:
                return exact_pivots(S) if row[k].contains(0) else [*out, _below(row[k])]
            out.append(_below(row[k]))
            for below in M[k + 1:]:
                factor = below[k] / row[k]
                for j in range(k + 1, len(M)):
                    below[j] -= factor * row[j]
        return out
    finally:
        ctx.prec = before


def _below(ball: arb) -> fmpq:
    """A number that is not above a ball, and above zero where the ball is."""
    least = float(ball.lower())
    return Q(np.nextafter(least, 0.0 if least > 0 else -np.inf)) if least else fmpq(0)


def exact_pivots(S: Array) -> list[fmpq]:
    """Pivots of symmetric elimination; ends at the first that is not positive.

    Of whole numbers, without fractions (Bareiss): they stay minors of S times its denominator.
    """
    whole, denominator = fmpq_mat([[Q(x) for x in row] for row in S]).numer_denom()
    rows, last, out = whole.tolist(), 1, []
    while rows:
        (pivot, *top), *below = rows
        out.append(fmpq(pivot, last * denominator))
        if pivot <= 0:
            break
        rows = [[(pivot * x - row[0] * t) // last for x, t in zip(row[1:], top)] for row in below]
        last = pivot
    return out
