"""Execution of generated C with symbols for what it reads: which sum of which literals each target gets.

Every number is an affine form: operand -> coefficient, and each coefficient remembers the literal it was written
as and its line. Loops, table look-ups and the choice of the mode are carried out; nothing is guessed from names.
What the subset does not know is an error.

Where coefficients are computed as well (they depend on parameters), a product of two operands is one operand,
``M_0_1 * s->x_lo[1]``, and every local number keeps its name, so that its own definition is read by itself.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from pycparser import c_ast

from ..errors import CertificateError
from .c_reader import Node, Source

COMPARE = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt, "==": operator.eq,
           "!=": operator.ne}
ROUNDS = 4096  # of one loop


@dataclass(frozen=True)
class Coefficient:
    """An exact value, the literal that stands for it ("" where 1 is not written), and its line."""

    value: Fraction
    literal: str
    line: int


NOWHERE = Coefficient(Fraction(0), "", 0)  # a product with 0 is left out
Affine = dict  # operand -> Coefficient; "" is the constant


@dataclass(frozen=True)
class Place:
    """A name of memory: ``s``, ``s->x_lo``, ``s->x_lo[0]``."""

    name: str


@dataclass
class Machine:
    """Memory and records of one execution.

    Parameters
    ----------
    source : Source
    real : {"float32", "float64"}
    memory : dict
        Place -> Affine or int. What is read without having been written is a symbol.
    clip, skip : frozenset of str
        Functions that cut a value to two bounds, and functions that are not followed.
    compared : list
        (operand, operator, Coefficient) of every comparison of a symbol with a number, which counts as true.
    clipped : dict
        Operand -> (lower, upper) Coefficient.
    named : bool
        Every local number stands for itself in what follows; its definition goes into ``defined``.
    defined : dict
        Name -> Affine.
    """

    source: Source
    real: str
    memory: dict = field(default_factory=dict)
    clip: frozenset = frozenset()
    skip: frozenset = frozenset()
    compared: list = field(default_factory=list)
    clipped: dict = field(default_factory=dict)
    named: bool = False
    defined: dict = field(default_factory=dict)

    def call(self, name: str, arguments: list | None = None) -> None:
        """Execute a function; its pointer parameters are symbols unless arguments are given."""
        definition = self.source.function(name)
        parameters = [p.name for p in definition.decl.type.args.params]
        given = arguments if arguments is not None else [Place(p) for p in parameters]
        self.block(definition.body, dict(zip(parameters, given, strict=True)))

    def block(self, node: Node, names: dict) -> bool:
        """Execute a statement; True where it leaves the function or the switch."""
        kind = type(node).__name__
        method = getattr(self, f"_{kind.lower()}", None)
        if method is None:
            self._refuse(node)
        return bool(method(node, names))

    def _compound(self, node, names):
        return any(self.block(item, names) for item in node.block_items or ())

    def _decl(self, node, names):
        value = self.value(node.init, names) if node.init is not None else 0
        if self.named and isinstance(value, dict):
            if node.name in self.defined:
                self._refuse(node)
            self.defined[node.name] = value
            value = operand(node.name, node.coord.line)
        names[node.name] = value

    def _assignment(self, node, names):
        value = self.value(node.rvalue, names)
        if node.op != "=":
            value = self._sum(self.value(node.lvalue, names), value, {"+=": 1, "-=": -1}[node.op])
        if isinstance(node.lvalue, c_ast.ID):
            names[node.lvalue.name] = value
        else:
            self.memory[self.place(node.lvalue, names).name] = value

    def _funccall(self, node, names):
        if node.name.name not in self.skip:
            self.call(node.name.name, [self.place(a, names) for a in node.args.exprs])

    def _cast(self, node, names):
        """``(void)(s)`` says that a parameter is not used."""

    def _return(self, node, names):
        if node.expr is not None:  # for what it compares
            self.value(node.expr, names)
        return True

    def _break(self, node, names):
        return True

    def _for(self, node, names):
        inner = dict(names)
        for declaration in node.init.decls:
            self.block(declaration, inner)
        counters = {d.name for d in node.init.decls}
        for _ in range(ROUNDS):
            if not self.value(node.cond, inner):
                break
            own = dict(inner)
            self.block(node.stmt, own)
            inner |= {k: own[k] for k in inner if k not in counters}
            inner[node.next.expr.name] += 1
        else:
            self._refuse(node)
        names |= {k: inner[k] for k in names}

    def _switch(self, node, names):
        chosen, taken = self.value(node.cond, names), False
        for item in node.stmt.block_items:
            taken = taken or isinstance(item, c_ast.Default) or self.value(item.expr, names) == chosen
            if taken and any(self.block(s, names) for s in item.stmts or ()):
                return

    def place(self, node: Node, names: dict) -> Place:
        """Return the name of memory that an expression denotes."""
        if isinstance(node, c_ast.ID) and isinstance(names.get(node.name), Place):
            return names[node.name]
        if isinstance(node, c_ast.StructRef) and node.type == "->":
            return Place(f"{self.place(node.name, names).name}->{node.field.name}")
        if isinstance(node, c_ast.ArrayRef):
            return Place(f"{self.place(node.name, names).name}[{self.value(node.subscript, names)}]")
        return self._refuse(node)

    def value(self, node: Node, names: dict):
        """Return what an expression is worth: int, bool, Affine, or a table as nested lists."""
        if isinstance(node, c_ast.Constant):
            if node.type in ("float", "double"):
                return {"": Coefficient(number(node.value, self.real), node.value, node.coord.line)}
            return int(node.value.rstrip("uU"), 0)
        if isinstance(node, c_ast.InitList):
            return [self.value(e, names) for e in node.exprs]
        if isinstance(node, c_ast.ID) and node.name in {**self.source.macros, **names}:
            known = names.get(node.name, self.source.macros.get(node.name))
            return self._load(known, node) if isinstance(known, Place) else known
        if isinstance(node, c_ast.ArrayRef) and isinstance(table := self._table(node.name, names), list):
            return table[self.value(node.subscript, names)]
        if isinstance(node, c_ast.ArrayRef | c_ast.StructRef):
            return self._load(self.place(node, names), node)
        if isinstance(node, c_ast.UnaryOp) and node.op == "-":
            return self._sum({}, self.value(node.expr, names), -1)
        if isinstance(node, c_ast.BinaryOp):
            return self._binary(node, names)
        if isinstance(node, c_ast.TernaryOp):
            if self.named and (chosen := self._magnitude(node, names)):
                return chosen
            return self.value(node.iftrue if self.value(node.cond, names) else node.iffalse, names)
        if isinstance(node, c_ast.FuncCall) and node.name.name in self.clip:
            return self._clip(*(self.value(a, names) for a in node.args.exprs))
        return self._refuse(node)

    def _table(self, node, names):
        """The table that is indexed, or None where memory is."""
        if isinstance(node, c_ast.ID):
            return names.get(node.name)
        if isinstance(node, c_ast.ArrayRef) and isinstance(outer := self._table(node.name, names), list):
            return outer[self.value(node.subscript, names)]
        return None

    def _load(self, place: Place, node: Node):
        return self.memory.get(place.name, operand(place.name, node.coord.line))

    def _magnitude(self, node, names):
        """``max(a, b)`` of ``a > b ? a : b`` and ``|a|`` of ``a < 0 ? -a : a``, each an operand; None for any other."""
        if not isinstance(node.cond, c_ast.BinaryOp) or node.cond.op not in "<>":
            return None
        parts = [self.value(n, names) for n in (node.cond.left, node.cond.right, node.iftrue, node.iffalse)]
        if not all(isinstance(part, dict) for part in parts):
            return None
        left, right, true, false = map(plain, parts)
        if node.cond.op == ">" and left and (true, false) == (left, right):
            return operand(f"max({shown(left)}, {shown(right)})", node.coord.line)
        if node.cond.op == "<" and left and not right and (true, false) == ({k: -c for k, c in left.items()}, left):
            return operand(f"|{shown(left)}|", node.coord.line)
        return self._refuse(node)

    def _clip(self, value, least, most):
        operand = _symbol(value)
        self.clipped[operand] = (least[""], most[""])
        return value

    def _binary(self, node, names):
        left = self.value(node.left, names)
        if node.op == "&&":
            return left and self.value(node.right, names)
        right = self.value(node.right, names)
        if isinstance(left, int) and isinstance(right, int):
            return {**COMPARE, "+": operator.add}[node.op](left, right)
        if node.op in COMPARE:
            if set(left) <= {""} and set(right) <= {""}:
                return COMPARE[node.op](*(x[""].value if x else Fraction(0) for x in (left, right)))
            self.compared.append((_symbol(left), node.op, right[""]))
            return True
        if node.op == "*":
            if self.named and (set(left) != {""} or list(plain(right).values()) != [1]):
                return self._product(left, right, node)
            (factor,) = left.values() if set(left) == {""} else self._refuse(node)
            return {_symbol(right): factor}
        return self._sum(left, right, {"+": 1, "-": -1}[node.op])

    def _product(self, left: Affine, right: Affine, node: Node) -> Affine:
        """A computed coefficient times an operand, or a number times a sum of operands: the other is one operand."""
        if set(left) == {""}:
            return {shown(plain(right)): left[""]}
        return operand(f"{_symbol(left)} * {_symbol(right)}", node.coord.line)

    def _sum(self, left: Affine, right: Affine, sign: int) -> Affine:
        out = dict(left)
        for operand, c in right.items():
            old = out.get(operand)
            if old is not None and old.value and c.value:
                raise CertificateError(f"{self.source.name}:{c.line}: two terms with {operand or 'no operand'} in one "
                                       "sum (expected one). Print the C again.")
            if old is None or not old.value:
                out[operand] = Coefficient(sign * c.value, c.literal, c.line)
        return out

    def _refuse(self, node):
        where = f":{node.coord.line}" if node.coord else ""
        raise CertificateError(f"{self.source.name}{where}: {type(node).__name__} is beyond what the reader of the C "
                               "knows (codegen/assurance/symbolic.py). Extend it, or print the C again.")


def operand(name: str, line: int) -> Affine:
    """An operand, once."""
    return {name: Coefficient(Fraction(1), "", line)}


def plain(value: Affine) -> dict[str, Fraction]:
    """The values alone of what is not zero."""
    return {name: c.value for name, c in value.items() if c.value}


def shown(values: dict[str, Fraction]) -> str:
    """A sum of operands, each with the factor 1 or -1, as a text."""
    if "" in values or any(abs(c) != 1 for c in values.values()):
        raise ValueError(f"{values} where operands alone belong")
    return " ".join(f"{'-' if c < 0 else '+'} {name}" for name, c in values.items()) or "0"


def _symbol(value: Affine) -> str:
    """The operand that a form consists of, and of nothing else."""
    ((operand, one),) = value.items()
    if one.value != 1 or one.literal:
        raise ValueError(f"{float(one.value)} {operand} where an operand alone belongs")
    return operand


def number(literal: str, real: str) -> Fraction:
    """Return the exact value of a C literal: the nearest number of its type, rounded once."""
    digits = literal.rstrip("fF")
    if (real == "float32") != (digits != literal):
        raise CertificateError(f"C literal {literal}: not of type {real}. Print the C again.")
    if real == "float64":
        return Fraction(float(digits))
    guess, wanted = np.float32(float(digits)), Fraction(digits)  # by way of double, perhaps one unit off
    near = (np.nextafter(guess, np.float32(s * np.inf)) for s in (-1, 1))
    return min((Fraction(float(x)) for x in (guess, *near) if np.isfinite(x)), key=lambda x: abs(x - wanted))
