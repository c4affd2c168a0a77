"""Expressions as sympy objects, for what has to be differentiated or bounded.

A module of its own, because importing sympy takes half a second that most commands need not pay.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy

from codegen.plant.expression import Domain, ExpressionError, check_power, evaluate, parse

_NOT_REAL = "the expression has no real value (a root or logarithm). Correct it"


def symbolic(text: str, symbols: Mapping[str, Any]) -> Any:
    """Return the expression as a sympy object.

    Parameters
    ----------
    text : str
        An expression as in a plant file.
    symbols : mapping
        Name -> sympy object.

    Returns
    -------
    value : sympy object

    Raises
    ------
    ExpressionError
        As for `evaluate`; or a number is too large, an exponent is no plain number, a division is by zero, the value is
        not real.
    """
    domain = Domain(lambda value: sympy.Rational(repr(value)), _power, _FUNCTIONS)
    try:
        value = evaluate(parse(text), {"pi": sympy.pi, **symbols}, domain)
    except ExpressionError:
        raise
    except (ValueError, TypeError):  # sympy's Min and Max, of what cannot be compared
        raise ExpressionError(_NOT_REAL) from None
    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise ExpressionError("the expression divides by zero. Correct it")
    value = value.replace(sympy.cot, lambda a: sympy.cos(a) / sympy.sin(a))  # what sympy makes of tan(a + pi/2)
    if value.has(sympy.I) or any(f.func not in _KNOWN for f in value.atoms(sympy.Function)):
        raise ExpressionError(_NOT_REAL)  # functions of other names come from imaginary arguments
    return value


def _power(base: Any, exponent: Any) -> Any:
    if exponent.is_number and not (exponent.is_Rational and abs(exponent) <= 64):
        raise ExpressionError(f"the exponent {exponent} is not at most 64. Use a number below")
    if base.is_Rational and exponent.is_Integer:
        check_power(int(base.p), int(base.q), int(exponent))
    return base**exponent


def _exp(argument: Any) -> Any:
    # sympy compares numbers by evaluating them, and exp(exp(exp(9))) would take for ever.
    if argument.is_number and not abs(float(argument)) <= 700:
        raise ExpressionError("exp of a number is too large for float64. Correct the expression")
    return sympy.exp(argument)


_FUNCTIONS = {
    "sin": sympy.sin,
    "cos": sympy.cos,
    "tan": sympy.tan,
    "exp": _exp,
    "log": sympy.log,
    "sqrt": sympy.sqrt,
    "abs": sympy.Abs,
    "sign": sympy.sign,
    "floor": sympy.floor,
    "min": sympy.Min,
    "max": sympy.Max,
    "where": lambda condition, a, b: sympy.Piecewise((a, condition), (b, True)),
}
_KNOWN = {sympy.sin, sympy.cos, sympy.tan, sympy.exp, sympy.log, sympy.Abs, sympy.sign, sympy.floor, sympy.Min,
          sympy.Max, sympy.Piecewise}
