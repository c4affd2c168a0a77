"""Expressions in the plant file, parsed against a whitelist and never executed.

``ast.parse`` only builds a tree. Every node of the tree is then looked at, and what is not a number, a
known name, ``+ - * / **``, a sign or a call of a known function is refused. The same walk serves three
kinds of values: exact numbers affine in theta (``affine.py``), numpy arrays over the samples, and sympy
objects.
"""

from __future__ import annotations

import ast
import operator
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MAX_LENGTH = 1000
MAX_DEPTH = 100
MAX_BITS = 4096  # of an exact power; 9**9**9 would have 1.2e9
SAMPLE_NAMES = ("k", "t", "pi")

_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_COMPARISONS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class ExpressionError(ValueError):
    """The expression is refused; the text says what was found and what to do, not where."""


@dataclass(frozen=True)
class Domain:
    """The kind of value that a walk over an expression computes.

    Parameters
    ----------
    number : callable
        Makes a value of an int or float literal.
    power : callable
        ``power(base, exponent)``; it refuses exponents that would take long.
    functions : mapping
        Function name -> callable.
    """

    number: Callable[[Any], Any]
    power: Callable[[Any, Any], Any]
    functions: Mapping[str, Callable[..., Any]]


def parse(text: str) -> ast.expr:
    """Return the syntax tree of an expression, without executing anything.

    Parameters
    ----------
    text : str
        As in a plant file.

    Returns
    -------
    tree : ast.expr

    Raises
    ------
    ExpressionError
        The text is too long, nests too deeply, or is no expression.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            f"the expression is too long (found {len(text)} characters, expected at most {MAX_LENGTH}). "
            "Shorten it, or give the signal as csv"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError(
            f'{_quoted(text)} is no expression (expected e.g. "2*sin(0.1*k)"). Correct it'
        ) from None
    level, depth = [tree], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise ExpressionError(
                f"the expression nests too deeply (expected at most {MAX_DEPTH} levels). Simplify it"
            )
        level = [child for node in level for child in ast.iter_child_nodes(node)]
    return tree


def evaluate(node: ast.expr, names: Mapping[str, Any], domain: Domain) -> Any:
    """Compute an expression's value in a domain.

    Parameters
    ----------
    node : ast.expr
        From `parse`.
    names : mapping
        Name -> value of the domain.
    domain : Domain

    Returns
    -------
    value : object
        Of the domain.

    Raises
    ------
    ExpressionError
        The tree holds anything but numbers, these names, operators and the domain's functions.
    """
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if not abs(value) <= sys.float_info.max:
                raise ExpressionError("a number is too large for float64. Use a smaller one")
            return domain.number(value)
        case ast.Name(id=name):
            if name not in names:
                raise ExpressionError(_unknown_name(name, names, domain.functions))
            return names[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -evaluate(operand, names, domain)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return evaluate(operand, names, domain)
        case ast.BinOp(left=left, op=op, right=right):
            a, b = evaluate(left, names, domain), evaluate(right, names, domain)
            return _binary(op, a, b, domain)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            return _call(name, args, names, domain)
    raise ExpressionError(
        f'"{_shown(node)}" is not allowed in an expression (expected numbers, names, + - * / **, '
        f"and {', '.join(domain.functions)}). Rewrite it with these"
    )


def sampled(text: str, constants: Mapping[str, float], k: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Evaluate a scenario expression of k and t.

    Parameters
    ----------
    text : str
    constants : mapping
        The plant file's ``[constants]``.
    k, t : ndarray (K,)
        Sample numbers and times in seconds.

    Returns
    -------
    values : ndarray (K,) float64
        May hold infinities and NaN, where the expression has no value.

    Raises
    ------
    ExpressionError
        As for `evaluate`.
    """
    names = {**constants, "k": k.astype(float), "t": t.astype(float), "pi": np.pi}
    with np.errstate(all="ignore"):
        value = evaluate(parse(text), names, _ARRAYS)
    return np.broadcast_to(np.asarray(value, dtype=float), k.shape).copy()


def check_power(numerator: int, denominator: int, exponent: int) -> None:
    """Refuse an exact power with more than `MAX_BITS` bits.

    Parameters
    ----------
    numerator, denominator : int
        Of the base.
    exponent : int

    Raises
    ------
    ExpressionError
        The power is too large.
    """
    bits = max(abs(numerator).bit_length(), denominator.bit_length())
    if bits * abs(exponent) > MAX_BITS and bits > 1:
        raise ExpressionError("a power is too large to be meant (expected below 1e308). Reduce the exponent")


def _binary(op: ast.operator, a: Any, b: Any, domain: Domain) -> Any:
    if isinstance(op, ast.Pow):
        return domain.power(a, b)
    if isinstance(op, ast.BitXor):
        raise ExpressionError('"^" is not allowed in an expression. Write ** for a power')
    if type(op) not in _OPERATORS:
        raise ExpressionError(
            f"the operator {type(op).__name__} is not allowed in an expression (expected + - * / **). "
            "Rewrite it with these"
        )
    try:
        return _OPERATORS[type(op)](a, b)
    except ZeroDivisionError:
        raise ExpressionError("the expression divides by zero. Correct it") from None


def _call(name: str, args: list[ast.expr], names: Mapping[str, Any], domain: Domain) -> Any:
    if name not in domain.functions:
        raise ExpressionError(
            f'the function "{name}" is not known (known: {", ".join(domain.functions)}). Use one of these'
        )
    if name in ("min", "max"):
        expected = max(2, len(args))
    else:
        expected = 3 if name == "where" else 1
    if len(args) != expected:
        raise ExpressionError(f"{name} takes {expected} arguments (found {len(args)}). Correct the call")
    if name == "where":
        values = [_condition(args[0], names, domain), *(evaluate(a, names, domain) for a in args[1:])]
    else:
        values = [evaluate(a, names, domain) for a in args]
    return domain.functions[name](*values)


def _condition(node: ast.expr, names: Mapping[str, Any], domain: Domain) -> Any:
    """The first argument of ``where``: one comparison or a chain such as ``10 <= k < 20``."""
    if not isinstance(node, ast.Compare) or any(type(op) not in _COMPARISONS for op in node.ops):
        raise ExpressionError(
            f'"{_shown(node)}" is no condition (expected a comparison such as 10 <= k < 20). Correct it'
        )
    values = [evaluate(part, names, domain) for part in (node.left, *node.comparators)]
    result = _COMPARISONS[type(node.ops[0])](values[0], values[1])
    for op, a, b in zip(node.ops[1:], values[1:], values[2:]):
        result = result & _COMPARISONS[type(op)](a, b)
    return result


def _unknown_name(name: str, names: Mapping[str, Any], functions: Mapping[str, Any]) -> str:
    if name in functions:
        return f'the function "{name}" needs arguments. Write {name}(...)'
    known = ", ".join(names) or "none"
    return f'the name "{name}" is not known (known: {known}). Use one of these, or declare it in [constants]'


def _quoted(text: str) -> str:
    """The text on one line, cut to a readable length."""
    flat = " ".join(text.split())
    return '"' + (flat if len(flat) <= 60 else flat[:57] + "...") + '"'


def _shown(node: ast.expr) -> str:
    try:
        return _quoted(ast.unparse(node))[1:-1]
    except RecursionError:
        return type(node).__name__


def _least(*values: Any) -> Any:
    return np.minimum.reduce(np.broadcast_arrays(*values))


def _greatest(*values: Any) -> Any:
    return np.maximum.reduce(np.broadcast_arrays(*values))


_ARRAYS = Domain(
    number=np.float64,
    power=lambda base, exponent: np.power(np.asarray(base, dtype=float), exponent),
    functions={
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "exp": np.exp,
        "log": np.log,
        "sqrt": np.sqrt,
        "abs": np.abs,
        "sign": np.sign,
        "floor": np.floor,
        "min": _least,
        "max": _greatest,
        "where": np.where,
    },
)
FUNCTION_NAMES = tuple(_ARRAYS.functions)
