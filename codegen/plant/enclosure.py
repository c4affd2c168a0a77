r"""Least and largest value of an expression over a box, from outside: what is returned is never too narrow.

Branch and bound with interval arithmetic (mpmath's, outward rounded). Boxes are halved where the bound is still
loose; a variable in which the expression only rises or falls over a box is put to the better end of it.

A quotient whose zero is removable, such as sin(x)/x, is written as `quotient`: near zero its values are among those
of the derivative of its numerator, by the mean value theorem.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from functools import cache
from itertools import count
from typing import Any

import mpmath
import numpy as np
import sympy

Box = dict[Any, tuple[float, float]]
#: Relative gap at which a bound is tight enough, and the number of boxes after which it is taken as it is.
GAP, BOXES = 1e-7, 500
#: Below this distance from zero a removable quotient is its limit. What that changes in the product is of its square.
NEAR = sympy.Rational(1, 10**8)
_FUNCTIONS = {sympy.sin: mpmath.iv.sin, sympy.cos: mpmath.iv.cos, sympy.exp: mpmath.iv.exp}


class UnboundedError(ValueError):
    """The expression has no bounds over the box: it divides by zero, or leaves the domain of a root or logarithm."""


def enclosure(expression: Any, box: Mapping[Any, tuple[float, float]]) -> tuple[float, float]:
    """Return bounds of an expression over a box, tight to about seven digits where 500 boxes suffice.

    Parameters
    ----------
    expression : sympy.Expr
        Of the operations and functions that a plant file knows, except where, sign and floor.
    box : mapping
        sympy.Symbol -> (lo, hi), finite, for every symbol of the expression.

    Returns
    -------
    lo, hi : float

    Raises
    ------
    UnboundedError
        No finite bounds were found.
    """
    used = {s: tuple(map(float, box[s])) for s in sorted(expression.free_symbols, key=str)}
    return _least(expression, used), -_least(-expression, used)


def quotient(numerator: Any, symbol: Any) -> Any:
    """Return numerator/symbol for a numerator that is zero where the symbol is; its limit there.

    Parameters
    ----------
    numerator : sympy.Expr
        Smooth; of this symbol alone.
    symbol : sympy.Symbol

    Returns
    -------
    value : sympy.Expr
    """
    limit = sympy.diff(numerator, symbol).subs(symbol, 0)
    return sympy.Piecewise((numerator / symbol, sympy.Abs(symbol) > NEAR), (limit, True))


def lower_bound(expression: Any, box: Mapping[Any, tuple[float, float]], enough: float) -> float:
    """Return a lower bound of an expression over a box, no tighter than needed to tell that ``enough`` is one.

    Parameters
    ----------
    expression : sympy.Expr
    box : mapping
        As for `enclosure`.
    enough : float

    Raises
    ------
    UnboundedError
        No finite bound was found.
    """
    return _least(expression, {s: tuple(map(float, box[s])) for s in expression.free_symbols}, enough)


def _least(expression: Any, box: Box, enough: float = float("inf")) -> float:
    """Lower bound of the minimum."""
    smooth = not expression.has(sympy.Piecewise, sympy.Abs, sympy.Min, sympy.Max)
    slopes = {s: sympy.diff(expression, s) for s in box} if smooth else {}
    number, found = count(), float("inf")

    def entry(part: Box) -> tuple[float, int, Box]:
        nonlocal found
        part = _narrowed(part, slopes)
        low = _ends(_interval(expression, {s: mpmath.iv.mpf(list(v)) for s, v in part.items()}))[0]
        middle = {s: mpmath.iv.mpf((a + b) / 2) for s, (a, b) in part.items()}
        found = min(found, _ends(_interval(expression, middle))[1])
        return low, next(number), part

    waiting = [entry(box)]
    for k in range(max(50, 20 * BOXES // max(20, expression.count_ops()))):
        low, _, part = waiting[0]
        widest = max(part, key=lambda s: (part[s][1] - part[s][0]) / (box[s][1] - box[s][0] or 1.0), default=None)
        if widest is None or part[widest][0] == part[widest][1]:
            break
        if k == 200 and low == -float("inf"):
            break
        if low >= enough or low >= found - GAP * max(abs(found), 1e-3):
            break
        heapq.heappop(waiting)
        a, b = part[widest]
        for half in ((a, (a + b) / 2), ((a + b) / 2, b)):
            heapq.heappush(waiting, entry({**part, widest: half}))
    if not abs(waiting[0][0]) < float("inf"):
        raise UnboundedError
    return waiting[0][0]


def _narrowed(box: Box, slopes: Mapping[Any, Any]) -> Box:
    """The end of each variable where the expression is least, as far as its slope has one sign over the box."""
    out = dict(box)
    for symbol, slope in slopes.items():
        try:
            low, high = _ends(_interval(slope, {s: mpmath.iv.mpf(list(v)) for s, v in box.items()}))
        except UnboundedError:
            continue
        if not high - low < float("inf"):  # there may be a pole
            continue
        if low >= 0:
            out[symbol] = (box[symbol][0],) * 2
        elif high <= 0:
            out[symbol] = (box[symbol][1],) * 2
    return out


def _ends(value: Any) -> tuple[float, float]:
    """Ends of an interval as floats; at 53 bits they are floats already."""
    return tuple(float(mpmath.mp.make_mpf(end)) for end in value._mpi_)


def _interval(expression: Any, box: Mapping[Any, Any]) -> Any:
    """Interval of an expression; infinite where it has none in this box, to be halved further."""
    head, args = expression.func, expression.args
    if expression.is_Symbol:
        return box[expression]
    if expression.is_Rational:
        return mpmath.iv.mpf(int(expression.p)) / int(expression.q)
    if expression is sympy.pi:
        return mpmath.iv.pi
    if expression is sympy.E:
        return mpmath.iv.e
    if head is sympy.Piecewise:
        return _removable(expression, box)
    if head is sympy.Pow:
        return _power(_interval(args[0], box), args[1])
    values = [_interval(a, box) for a in args]
    if head is sympy.Add:
        return sum(values[1:], values[0])
    if head is sympy.Mul:
        out = values[0]
        for value in values[1:]:
            out = out * value
        return out
    if head in (sympy.Min, sympy.Max):
        pick = min if head is sympy.Min else max
        ends = [_ends(v) for v in values]
        return mpmath.iv.mpf([pick(a for a, _ in ends), pick(b for _, b in ends)])
    if head is sympy.Abs:
        low, high = _ends(values[0])
        return mpmath.iv.mpf([max(low, -high, 0.0), max(-low, high)])
    if head is sympy.tan:
        return mpmath.iv.sin(values[0]) / mpmath.iv.cos(values[0])  # mpmath's own is wrong across a pole
    if head is sympy.log:
        return _logarithm(values[0])
    if head in _FUNCTIONS:
        return _FUNCTIONS[head](values[0])
    raise TypeError(f"{head} is no function that has an interval here")


def _logarithm(value: Any) -> Any:
    low, high = _ends(value)
    if high <= 0:
        raise UnboundedError
    return mpmath.iv.log(value) if low > 0 else mpmath.iv.mpf(["-inf", mpmath.iv.log(mpmath.iv.mpf(high)).b])


def _power(base: Any, exponent: Any) -> Any:
    low, high = _ends(base)
    if exponent.is_Integer:
        if exponent < 0 and low <= 0 <= high:
            return mpmath.iv.mpf(["-inf", "inf"])
        return base ** int(exponent)
    if low < 0 or (low == 0 and exponent.is_negative):
        raise UnboundedError
    if exponent == sympy.Rational(1, 2):
        return mpmath.iv.sqrt(base)
    if low == 0:
        raise UnboundedError
    return mpmath.iv.exp(_interval(exponent, {}) * mpmath.iv.log(base))


@cache
def _slope(value: Any, symbol: Any) -> Any:
    return sympy.diff(sympy.expand(value * symbol), symbol)


def _removable(expression: Any, box: Mapping[Any, Any]) -> Any:
    """A `quotient`: itself away from zero, the slope of its numerator between zero and there otherwise."""
    value = expression.args[0].expr
    (symbol,) = value.free_symbols
    low, high = _ends(box[symbol])
    hull = {symbol: mpmath.iv.mpf([min(low, 0.0), max(high, 0.0)])}
    slope = _interval(_slope(value, symbol), hull)
    if not (low > NEAR or high < -NEAR):
        return slope if np.isfinite(_ends(slope)).all() else mpmath.iv.mpf(["-inf", "inf"])
    (a, b), (c, d) = _ends(_interval(value, box)), _ends(slope)
    if not d - c < float("inf"):  # a pole between zero and here: the mean value theorem does not hold
        return _interval(value, box)
    # Both hold: the quotient is loose near zero, the slope far from it.
    return mpmath.iv.mpf([max(a, c), min(b, d)])
