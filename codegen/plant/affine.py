"""Matrix entries that are expressions: exact numbers, affine in the scheduling parameters theta.

Decimals are read as the decimals they are (0.1 is 1/10) and the entry is rounded to float64 once, at the
end, so that a plain number stays the float64 that its text denotes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from codegen.plant.expression import Domain, ExpressionError, check_power, evaluate, parse


@dataclass(frozen=True)
class Affine:
    """The exact number ``constant + sum_j slopes[j] * theta_j``."""

    constant: Fraction
    slopes: tuple[Fraction, ...]

    @property
    def fixed(self) -> bool:
        """True when no theta enters."""
        return not any(self.slopes)

    def __neg__(self) -> Affine:
        return self._scaled(Fraction(-1))

    def __add__(self, other: Affine) -> Affine:
        slopes = tuple(a + b for a, b in zip(self.slopes, other.slopes))
        return Affine(self.constant + other.constant, slopes)

    def __sub__(self, other: Affine) -> Affine:
        return self + -other

    def __mul__(self, other: Affine) -> Affine:
        if other.fixed:
            return self._scaled(other.constant)
        return other._scaled(self._required("a product of two expressions of theta"))

    def __truediv__(self, other: Affine) -> Affine:
        return self._scaled(1 / other._required("a division by an expression of theta"))

    def __pow__(self, other: Affine) -> Affine:
        exponent = other._required("theta in an exponent")
        base = self._required("a power of an expression of theta") if exponent != 1 else None
        if base is None:
            return self
        if exponent.denominator == 1:
            check_power(base.numerator, base.denominator, int(exponent))
            if base == 0 and exponent < 0:
                raise ZeroDivisionError
            return Affine(base ** int(exponent), (Fraction(0),) * len(self.slopes))
        return _of_float(math.pow, (base, exponent), len(self.slopes))

    def _scaled(self, factor: Fraction) -> Affine:
        return Affine(self.constant * factor, tuple(s * factor for s in self.slopes))

    def _required(self, what: str) -> Fraction:
        if not self.fixed:
            raise ExpressionError(
                f"{what} (expected an entry affine in theta). Name the product as a theta of its own, "
                f"with bounds"
            )
        return self.constant


def affine(
    text: str, constants: Mapping[str, float], thetas: Sequence[str]
) -> tuple[float, tuple[float, ...]]:
    """Read a matrix entry.

    Parameters
    ----------
    text : str
        An expression of the constants and the theta names.
    constants : mapping
        The plant file's ``[constants]``.
    thetas : sequence of str
        Names of the scheduling parameters.

    Returns
    -------
    constant : float
    slopes : tuple of float
        One per theta: the entry is ``constant + sum_j theta_j * slopes[j]``.

    Raises
    ------
    ExpressionError
        The expression is refused, is not affine in theta, or has no finite value.
    """
    size = len(thetas)
    zero = (Fraction(0),) * size
    names = {name: Affine(_decimal(value), zero) for name, value in constants.items()}
    names["pi"] = Affine(Fraction(math.pi), zero)
    for j, name in enumerate(thetas):
        names[name] = Affine(Fraction(0), tuple(Fraction(int(i == j)) for i in range(size)))
    domain = Domain(lambda value: Affine(_decimal(value), zero), lambda a, b: a**b, _functions(size))
    try:
        value = evaluate(parse(text), names, domain)
        return float(value.constant), tuple(float(s) for s in value.slopes)
    except ZeroDivisionError:
        raise ExpressionError("the expression divides by zero. Correct it") from None
    except OverflowError:
        raise ExpressionError("the value is too large for float64. Correct the expression") from None


def _decimal(value: float) -> Fraction:
    """The decimal that the user wrote: the shortest one that denotes this float64."""
    return Fraction(repr(value))


def _functions(size: int) -> dict:
    """Functions of constants; a theta under a function is not affine."""
    table = {
        "sin": math.sin,
        "cos": math.cos,
        "tan": math.tan,
        "exp": math.exp,
        "log": math.log,
        "sqrt": math.sqrt,
        "abs": abs,
        "sign": lambda a: float((a > 0) - (a < 0)),
        "floor": math.floor,
        "min": min,
        "max": max,
    }

    def of(name: str):
        def call(*values: Affine) -> Affine:
            return _of_float(table[name], [v._required(f"theta under {name}") for v in values], size)

        return call

    return {name: of(name) for name in table}


def _of_float(function, values: Sequence[Fraction], size: int) -> Affine:
    try:
        value = function(*(float(v) for v in values))
    except ValueError:
        raise ExpressionError("the expression has no real value (a root or logarithm). Correct it") from None
    return Affine(_decimal(value), (Fraction(0),) * size)
