"""What the expressions of a polytopic plant may name, with ranges: states, inputs, parameters and constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb, prod
from typing import Any

import numpy as np
import sympy

from codegen.errors import PlantError
from codegen.plant.enclosure import Box
from codegen.plant.expression import ExpressionError
from codegen.plant.factors import is_real_number
from codegen.plant.model import Signal
from codegen.plant.names import check_symbols
from codegen.plant.schema import PlantFile
from codegen.plant.symbolic import symbolic

ARGUMENTS = ("x", "u", "theta")
MOST_TERMS = 1000


@dataclass(frozen=True)
class Names:
    """What the expressions may name: symbols with their ranges, and constants."""

    symbols: tuple[Any, ...]
    ranges: Mapping[Any, tuple[str, Signal]]
    known: Mapping[str, Any]

    def read(self, place: str, text: str, without: tuple, why: str) -> Any:
        """Return an expression.

        Parameters
        ----------
        place, text : str
        without : tuple
            Functions that cannot be used here.
        why : str
            What to use instead.

        Raises
        ------
        PlantError
            It cannot be read, is not real, has a varying exponent, one of these functions, or too many terms.
        """
        try:
            value = symbolic(text, self.known)
        except ExpressionError as error:
            raise PlantError(f"{place}: {error}.") from None
        if any(not p.exp.is_number for p in value.atoms(sympy.Pow)):
            raise PlantError(f"{place}: an exponent varies (expected numbers). Write exp(...) of it.")
        numbers = [n for n in sympy.preorder_traversal(value)
                   if n.is_number and (n.is_Pow or n.is_Rational or n.func is sympy.log)]
        if not all(map(is_real_number, numbers)):
            raise PlantError(f"{place}: holds a number with no real value (a root or logarithm), or one too large. "
                             "Correct it.")
        found = next((f for f in without if value.has(f)), None)
        if found is not None:
            raise PlantError(f"{place}: {found.__name__.lower()} cannot stand here (expected {why}). Rewrite it.")
        if (terms := _terms(value)) > MOST_TERMS:
            raise PlantError(f"{place}: has {terms} terms when multiplied out (expected at most {MOST_TERMS}). "
                             "Simplify it.")
        return value

    def box(self, place: str, *expressions: Any) -> Box:
        """Return the ranges of all symbols of these expressions.

        Parameters
        ----------
        place : str
            What depends on them.
        *expressions : sympy.Expr

        Raises
        ------
        PlantError
            A signal has no range.
        """
        used = sorted(set().union(*(e.free_symbols for e in expressions)), key=str)
        out = {}
        for symbol in used:
            key, signal = self.ranges[symbol]
            if not np.isfinite(signal.lo) or not np.isfinite(signal.hi):
                raise PlantError(f"signals.{key}.{signal.name}: has no range (expected one, {place} depends on it). "
                                 "Add range = [lo, hi].")
            out[symbol] = (signal.lo, signal.hi)
        return out


def _terms(expression: Any) -> int:
    """How many terms an expression has when it is multiplied out, at most."""
    sizes = [_terms(a) for a in expression.args]
    if expression.is_Add:
        return sum(sizes)
    if expression.is_Mul:
        return prod(sizes)
    if expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
        return comb(sizes[0] + int(expression.exp) - 1, int(expression.exp))
    return 1


def names_of(file: PlantFile, signals: Mapping[str, tuple[Signal, ...]]) -> Names:
    """Return what the expressions of a polytopic plant may name.

    With equations every state and input must have a name that can stand in them; with vertices those that have none
    cannot be used.

    Parameters
    ----------
    file : PlantFile
    signals : mapping
        From `signals_of`.

    Returns
    -------
    names : Names

    Raises
    ------
    PlantError
        A name has a meaning of its own, or is used twice.
    """
    channels = [(vector, s) for vector in ARGUMENTS for s in signals[vector]]
    if file.nonlinear is None:
        channels = [(vector, s) for vector, s in channels if s.name.isidentifier()]
    check_symbols(file.constants, (), [(f"signals.{vector}", s.name) for vector, s in channels])
    symbols = tuple(sympy.Symbol(s.name if s.name.isidentifier() else f"{vector}_{i}", real=True)
                    for vector in ARGUMENTS for i, s in enumerate(signals[vector]))
    ranges = dict(zip(symbols, ((v, s) for v in ARGUMENTS for s in signals[v])))
    constants = {name: sympy.Rational(repr(value)) for name, value in file.constants.items()}
    usable = {s.name: symbol for symbol, (v, s) in ranges.items() if (v, s) in channels}
    return Names(symbols, ranges, {**constants, **usable})
