r"""Nonlinear right sides as factors: f(x, u) = A(x, u) x + B(x, u) u + c(x, u).

The way of writing f is not unique, and it decides what the outputs can see: a plant file may give A and B itself. What
`factorised` does without them: a product goes to the column of a state that is no premise, else of the first state in
it, else of the first input; sin(x) - sin(0) and its like go to the column of x as a quotient; the rest goes to c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy

from codegen.plant.enclosure import quotient


class SectorError(ValueError):
    """The equations have no such model: ``place`` is relative to [nonlinear], the text says what and what to do."""

    def __init__(self, place: str, text: str):
        super().__init__(text)
        self.place = place


def brief(expression: Any) -> str:
    """Return an expression as a message shows it: one line, not too long."""
    try:
        text = str(expression)
    except ValueError:  # an integer of thousands of digits
        return "of huge numbers"
    return text if len(text) <= 80 else text[:77] + "..."


def is_real_number(expression: Any) -> bool:
    """Whether an expression without symbols has a finite real value."""
    try:
        value = complex(expression.evalf())
    except (TypeError, ValueError, OverflowError):
        return False
    return value.imag == 0 and abs(value.real) < float("inf")


@dataclass(frozen=True)
class Factors:
    """f = A x + B u + c with entries that are expressions.

    Parameters
    ----------
    A : sympy.Matrix (n_x, n_x), B : sympy.Matrix (n_x, n_u), c : sympy.Matrix (n_x, 1)
    quotients : dict
        sympy.Symbol in the entries -> the `quotient` that it stands for.
    """

    A: Any
    B: Any
    c: Any
    quotients: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Wish:
    """A premise that the plant file names: its term, and its bounds where it gives some."""

    name: str
    term: Any
    bounds: tuple[float, float] | None = None


def factorised(f: Sequence[Any], x: Sequence[Any], u: Sequence[Any], wishes: Sequence[Wish] = ()) -> Factors:
    """Write f as A x + B u + c.

    Parameters
    ----------
    f : sequence of sympy.Expr (n_x)
    x, u : sequence of sympy.Symbol
    wishes : sequence of Wish
        Premises that shall be entries: a state that is one of them is a factor rather than a column.

    Returns
    -------
    factors : Factors

    Raises
    ------
    SectorError
        A term is no multiple of a state or input and not zero with one.
    """
    columns = [*x, *u]
    named = {tidy(w.term) for w in wishes}
    order = sorted(columns, key=lambda s: (s in named, columns.index(s)))
    out, quotients = sympy.zeros(len(f), len(columns) + 1), {}
    for i, row in enumerate(f):
        for term in sympy.Add.make_args(tidy(row)):
            powers = term.as_powers_dict()
            column = next((s for s in order if s in powers and powers[s].is_Integer and powers[s] > 0), None)
            if column is not None:
                out[i, columns.index(column)] += term / column
            elif not term.free_symbols & set(columns):
                out[i, len(columns)] += term
            else:
                size, core = term.as_coeff_Mul()
                symbol, value = _vanishing(i, core, columns)
                slope = sympy.Symbol(f"quotient_{core}")
                quotients[slope] = quotient(core - value, symbol)
                out[i, columns.index(symbol)] += size * slope
                out[i, len(columns)] += size * value
    return Factors(out[:, :len(x)], out[:, len(x):-1], out[:, -1:], quotients)


def _vanishing(i: int, term: Any, columns: list) -> tuple[Any, Any]:
    """The one state or input of a term such as sin(x), and the term's value at its zero."""
    used = [s for s in columns if s in term.free_symbols]
    value = term.subs(used[0], 0) if len(used) == 1 else sympy.nan
    if len(used) != 1 or term.free_symbols != {used[0]} or not is_real_number(value):
        raise SectorError(f"f.#{i + 1}", f"the term {brief(term)} is no multiple of a state or input (expected a "
                          "product with one, or a function of one alone). Give the factors A and B yourself.")
    return used[0], value


def checked(f: Sequence[Any], A: Any, B: Any, x: Sequence[Any], u: Sequence[Any]) -> Factors:
    """Return given factors, with the constants that they leave of f.

    Parameters
    ----------
    f : sequence of sympy.Expr (n_x)
    A : sympy.Matrix (n_x, n_x), B : sympy.Matrix (n_x, n_u)
    x, u : sequence of sympy.Symbol

    Raises
    ------
    SectorError
        f - A x - B u is more than constants.
    """
    rest = sympy.Matrix(f) - A * sympy.Matrix(x) - (B * sympy.Matrix(u) if u else sympy.zeros(len(f), 1))
    rest = rest.applyfunc(tidy)
    for i, left in enumerate(rest):
        if left.free_symbols:  # simplify would do it too, in minutes for some
            left = sympy.cancel(left)
            if any(f.free_symbols for f in left.atoms(sympy.sin, sympy.cos, sympy.tan)):
                left = sympy.trigsimp(left)
            rest[i] = left
        if left.free_symbols:
            raise SectorError(f"A.#{i + 1}", f"row {i + 1} of A x + B u differs from f by {brief(left)} (expected a "
                              "constant at most). Correct the row, or leave A and B out.")
    return Factors(A, B, rest)


def tidy(expression: Any) -> Any:
    """A sum of products whose denominators have no common factor: equal terms look equal, whatever their numbers."""
    out, kept = [], {}

    def keep(power: Any) -> Any:
        return kept.setdefault(power, sympy.Dummy())

    numerators = expression.replace(lambda e: e.is_Pow and e.exp.is_negative and e.base.is_Add, keep)
    back = {dummy: power for power, dummy in kept.items()}
    for term in sympy.Add.make_args(sympy.expand(numerators).xreplace(back)):
        factors = []
        for base, power in term.as_powers_dict().items():
            content, rest = base.as_content_primitive() if base.is_Add else (sympy.Integer(1), base)
            factors += [content**power, rest**power]
        out.append(sympy.Mul(*factors))
    return sympy.Add(*out)
