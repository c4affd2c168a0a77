r"""A formula as a list of operations, each on values before it: what C prints and numpy evaluates alike, bit by bit.

A sympy expression says nothing about the order of its operations; this list does. Rules of the translation:

* sums and products from left to right, the terms in sympy's order, a positive one first;
* whole powers by repeated multiplication, roots by sqrt, other powers by pow;
* a quotient is one guarded division: by zero it is the largest finite number, so that a branch that is not taken
  (sin(x)/x at zero) does no harm, and one that is taken is out of every range. Parts that expressions share are
  computed once, but nothing is taken out of a quotient.

All operations but exp, log, sin, cos, tan and pow are rounded correctly in IEEE 754 arithmetic; those six are the
libm's, of which no two give the same last bit: see ``observers.polytopic``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

#: Functions of the libm.
LIBM = ("exp", "log", "sin", "cos", "tan", "pow")
#: Operations whose value is true or false.
TRUTHS = ("ge", "le", "gt", "and")


@dataclass(frozen=True)
class Operation:
    """One operation.

    Parameters
    ----------
    name : str
        add, sub, mul, div, neg, abs, min, max, sqrt; one of `LIBM`; ge, le, gt, and; select (a if truth else b).
    args : tuple of int
        Values before it: inputs first, then constants, then operations.
    """

    name: str
    args: tuple[int, ...]


@dataclass(frozen=True)
class Program:
    """Operations in order.

    Parameters
    ----------
    inputs : int
    constants : tuple of float
    operations : tuple of Operation
    results : tuple of int
    """

    inputs: int
    constants: tuple[float, ...]
    operations: tuple[Operation, ...]
    results: tuple[int, ...]

    @property
    def first(self) -> int:
        """Number of the first operation's value."""
        return self.inputs + len(self.constants)

    def count(self, *names: str) -> int:
        """How many operations have one of these names."""
        return sum(op.name in names for op in self.operations)


class Builder:
    """Collects operations; equal ones once.

    Parameters
    ----------
    symbols : sequence of sympy.Symbol
        The inputs.
    """

    def __init__(self, symbols: Sequence[Any]):
        self.symbols = {s: ("input", k) for k, s in enumerate(symbols)}
        self._constants: dict[float, int] = {}
        self._operations: dict[Operation, int] = {}
        self._seen: dict[Any, tuple] = {}

    def constant(self, value: float) -> tuple:
        """A number.

        Parameters
        ----------
        value : float
        """
        return "constant", self._constants.setdefault(float(value), len(self._constants))

    def apply(self, name: str, *args: tuple) -> tuple:
        """An operation on values.

        Parameters
        ----------
        name : str
        args : tuples
            Of this builder.
        """
        return "operation", self._operations.setdefault(Operation(name, args), len(self._operations))

    def fold(self, name: str, values: Sequence[tuple]) -> tuple:
        """The values joined from left to right.

        Parameters
        ----------
        name : str
        values : sequence
            Not empty.
        """
        out = values[0]
        for value in values[1:]:
            out = self.apply(name, out, value)
        return out

    def done(self, results: Sequence[tuple]) -> Program:
        """The program with these results.

        Parameters
        ----------
        results : sequence
        """
        start = {"input": 0, "constant": len(self.symbols), "operation": len(self.symbols) + len(self._constants)}

        def place(value: tuple) -> int:
            return start[value[0]] + value[1]

        return Program(len(self.symbols), tuple(self._constants),
                       tuple(Operation(op.name, tuple(map(place, op.args))) for op in self._operations),
                       tuple(map(place, results)))

    def value(self, expression: Any) -> tuple:
        """An expression, translated.

        Parameters
        ----------
        expression : sympy.Expr

        Raises
        ------
        TypeError
            A function that has no operation here.
        """
        if expression not in self._seen:
            self._seen[expression] = self._translate(expression)
        return self._seen[expression]

    def _translate(self, e: Any) -> tuple:
        import sympy
        if e in self.symbols:
            return self.symbols[e]
        if e.is_number and not e.free_symbols:
            return self.constant(float(e))
        if e.func is sympy.Add:
            return self._sum(e.args)
        if e.func is sympy.Mul:
            return self._product(e)
        if e.func is sympy.Pow:
            return self._power(*e.args)
        if e.func in (sympy.Min, sympy.Max):
            return self.fold("min" if e.func is sympy.Min else "max", [self.value(a) for a in e.args])
        if e.func is sympy.Piecewise:
            (away, condition), (limit, _) = e.args
            if condition.func is not sympy.StrictGreaterThan or e.args[1][1] is not sympy.true:
                raise TypeError(f"{e} has no operation here")
            truth = self.apply("gt", self.value(condition.lhs), self.value(condition.rhs))
            return self.apply("select", truth, self.value(away), self.value(limit))
        names = {sympy.exp: "exp", sympy.log: "log", sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan",
                 sympy.Abs: "abs"}
        if e.func not in names:
            raise TypeError(f"{e.func} has no operation here")
        return self.apply(names[e.func], self.value(e.args[0]))

    def _sum(self, terms: Sequence[Any]) -> tuple:
        signed = [(bool(t.as_coeff_Mul()[0] < 0), t) for t in terms]
        signed.sort(key=lambda item: item[0])  # stable: the positive ones first
        out = self.value(signed[0][1])
        for negative, term in signed[1:]:
            out = self.apply("sub", out, self.value(-term)) if negative else self.apply("add", out, self.value(term))
        return out

    def _product(self, e: Any) -> tuple:
        import sympy
        number, rest = e.as_coeff_Mul()
        if number == -1:
            return self.apply("neg", self.value(rest))
        if number < 0:
            return self.apply("neg", self.value(-e))
        over = [f for f in sympy.Mul.make_args(rest) if f.func is sympy.Pow and f.args[1].could_extract_minus_sign()]
        factors = [self.value(f) for f in sympy.Mul.make_args(rest) if f not in over]
        if number != 1 or not factors:
            factors.insert(0, self.constant(float(number)))
        top = self.fold("mul", factors)
        if not over:
            return top
        return self.apply("div", top, self.fold("mul", [self._power(f.args[0], -f.args[1]) for f in over]))

    def _power(self, base: Any, exponent: Any) -> tuple:
        if exponent.could_extract_minus_sign():
            return self.apply("div", self.constant(1.0), self._power(base, -exponent))
        if exponent.is_Integer:
            return self.fold("mul", [self.value(base)] * int(exponent))
        if exponent.is_Rational and exponent.q == 2:
            return self.fold("mul", [self.value(base)] * (exponent.p // 2) + [self.apply("sqrt", self.value(base))])
        return self.apply("pow", self.value(base), self.value(exponent))
