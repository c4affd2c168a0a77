"""Values of formulas over boxes in ball arithmetic: midpoint and radius, from outside, whatever is rounded."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from math import inf, nextafter
from operator import add, mul
from typing import Any

from flint import arb, fmpq


def ball(lo: float | fmpq, hi: float | fmpq) -> arb:
    """The ball of an interval.

    Parameters
    ----------
    lo, hi : float or fmpq
    """
    return arb(lo).union(arb(hi))


def value(expression: Any, at: Mapping[Any, arb]) -> arb:
    """Value of an expression, not finite where it has none in this box.

    Parameters
    ----------
    expression : sympy.Expr
        Of numbers, symbols, + - * / **, exp, log, sin, cos, tan and sqrt.
    at : mapping
        sympy.Symbol -> ball.

    Raises
    ------
    TypeError
        Another function.
    """
    import sympy
    e = expression
    if e.is_Symbol:
        return at[e]
    if e.is_Rational:
        return arb(fmpq(int(e.p), int(e.q)))
    if e.is_Float:
        return arb(float(e))
    if e is sympy.pi:
        return arb.pi()
    if e is sympy.E:
        return arb(1).exp()
    if e.func is sympy.Pow:
        base, exponent = e.args
        if exponent.is_Integer:
            return value(base, at) ** int(exponent)
        root = value(base, at)
        return root.sqrt() if exponent == sympy.Rational(1, 2) else (value(exponent, at) * root.log()).exp()
    values = [value(a, at) for a in e.args]
    if e.func in (sympy.Add, sympy.Mul):
        return reduce(add if e.func is sympy.Add else mul, values)
    names = {sympy.exp: "exp", sympy.log: "log", sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan",
             sympy.Abs: "__abs__"}
    if e.func not in names:
        raise TypeError(f"{e.func} has no ball here")
    return getattr(values[0], names[e.func])()


def ends(ball: arb) -> tuple[float, float]:
    """Doubles outside a ball.

    Parameters
    ----------
    ball : arb
        Finite.
    """
    lo, hi = ball.lower(), ball.upper()
    return nextafter(float(lo), -inf), nextafter(float(hi), inf)
