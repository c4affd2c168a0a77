"""Where every constant of a bank stands in its C: the sums of its members are read one after the other.

A member is a list of assignments: estimate, residual, for every state what each vertex says and their weighted sum, the
weighted residual and its average. Each sum is taken apart into operands and their coefficients, which must be those
of the tables, none more. A coefficient that all vertices share stands outside of their weights. The name of a constant
ends with the number of its member. Thresholds and limits are tables; the tree is compared before (``own_places``).
"""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np
from pycparser import c_ast, c_generator

from ..errors import CertificateError
from .c_reader import Node, Source, walk
from .symbolic import NOWHERE, Coefficient, number

Sum = dict[str, Coefficient]
PLACE = r"([a-z_>-]+)\[(\d+)U?\]"


def read_bank(source: Source, prefix: str, t, found) -> set[str]:
    """Read every constant but tables and the ranges of the input check.

    Parameters
    ----------
    source : Source
    prefix : str
    t : BankTables
    found : object
        ``add`` takes what is read.

    Returns
    -------
    set of str
        Functions that were read.

    Raises
    ------
    CertificateError
        A number, or a term, that the tables do not know.
    """
    at = 0
    for k, member in enumerate(t.members):
        _Reading(source, f"{prefix}_without_{k}", t, found).member(member, k, len(t.x_lo) * k, at)
        at += len(member.M)
    starts = _Reading(source, f"{prefix}_anew", t, found)
    for target, row, _ in starts.sums:
        name, i = starts.place(target) if "[" in target else ("", 0)
        if name == "s->z":
            k, j = divmod(i, len(t.x_lo))
            starts.add(f"z0_{k}", (j,), t.members[k].z0[j], row.get("", NOWHERE))
    weights = _Reading(source, f"{prefix}_weights", t, found)
    for c in weights.numbers(source.function(f"{prefix}_weights").body):
        same = [i for i, value in enumerate(t.weights.constants) if Fraction(value) == c.value]
        if c.value and not same:
            weights.refuse(f"{c.literal} in line {c.line}")
        for i in same:
            weights.add("weights", (i,), t.weights.constants[i], c)
    return {f"{prefix}_{name}" for name in ("anew", "weights", *(f"without_{k}" for k in range(len(t.members))))}


class _Reading:
    """The assignments of one function: target, operand -> coefficient ("" for a number alone), line."""

    def __init__(self, source: Source, function: str, t, found):
        self.source, self.function, self.t, self.found = source, function, t, found
        self.words, self.sums = c_generator.CGenerator(), []
        for node in walk(source.function(function).body):
            if isinstance(node, c_ast.Assignment):
                row: Sum = {}
                self.take(node.rvalue, 1, row)
                self.sums.append((self.words.visit(node.lvalue), row, node.coord.line))

    def take(self, node: Node, sign: int, row: Sum) -> None:
        """Collect the terms of a sum."""
        op = getattr(node, "op", "")
        if isinstance(node, c_ast.BinaryOp) and op in ("+", "-"):
            self.take(node.left, sign, row)
            self.take(node.right, sign if op == "+" else -sign, row)
        elif isinstance(node, c_ast.UnaryOp) and op == "-":
            self.take(node.expr, -sign, row)
        elif isinstance(node, c_ast.BinaryOp) and op == "*" and isinstance(node.left, c_ast.Constant):
            self.put(self.words.visit(node.right), self.coefficient(node.left, sign), row)
        elif isinstance(node, c_ast.Constant) and node.type in ("float", "double"):
            self.put("", self.coefficient(node, sign), row)
        else:
            self.put(self.words.visit(node), Coefficient(Fraction(sign), "", node.coord.line), row)

    def put(self, operand: str, c: Coefficient, row: Sum) -> None:
        """Keep a term; each operand comes once."""
        if operand in row:
            self.refuse(f"{operand} twice in line {c.line}")
        row[operand] = c

    def coefficient(self, node: Node, sign: int) -> Coefficient:
        """A number as it is written."""
        return Coefficient(sign * number(node.value, self.t.real), node.value, node.coord.line)

    def numbers(self, node: Node):
        """Every real number of a function, with the sign before it."""
        minus = {id(n.expr) for n in walk(node) if isinstance(n, c_ast.UnaryOp) and n.op == "-"}
        for n in walk(node):
            if isinstance(n, c_ast.Constant) and n.type in ("float", "double"):
                yield self.coefficient(n, -1 if id(n) in minus else 1)

    def place(self, target: str) -> tuple[str, int]:
        """Vector and index of an element."""
        match = re.fullmatch(PLACE, target)
        if match is None:
            self.refuse(target)
        return match[1], int(match[2])

    def add(self, name: str, index: tuple[int, ...], value, c: Coefficient) -> None:
        """Keep a constant."""
        self.found.add(name, "", self.function, index, value, c)

    def rest(self, row: Sum, where: str) -> None:
        """Refuse what is left of a sum."""
        if any(c.value for c in row.values()):
            self.refuse(f"{', '.join(row)} in {where}")

    def alone(self, row: Sum, operand: str, where: str) -> None:
        """Take an operand that stands there once, without a factor."""
        if row.pop(operand, NOWHERE).value != 1:
            self.refuse(f"no {operand} in {where}")

    def refuse(self, words: str) -> None:
        """Raise."""
        raise CertificateError(f"{self.source.name}: {self.function} has {words} (found), expected the sums of the "
                               "design. Print it again.")

    def member(self, m, k: int, z: int, a: int) -> None:
        """Read an observer whose states and averages begin at z and a."""
        n, p, inputs = len(m.T2), len(m.C), m.G.shape[2]
        hat, r = [f"x_hat[{j}]" for j in range(n)], [f"r[{j}]" for j in range(p)]
        y = [f"s->y[{j}]" for j in m.seen]
        parts = (("F", m.F, hat), ("G", m.G, [f"in->u[{j}]" for j in range(inputs)]), ("minus_K", -m.K, r))
        vertices: dict[int, Sum] = {}
        count, e = 0, -1
        for target, row, _ in self.sums:
            if target in ("inside", f"out->r[{k}]"):
                continue
            if target == "e":
                e += 1
                for j, operand in enumerate(r):
                    self.add(f"M_{k}", (e, j), m.M[e, j], row.pop(operand, NOWHERE))
                self.rest(row, target)
                continue
            name, i = self.place(target)
            if name == "v":
                vertices[i] = row
                continue
            if name == "x_hat":
                self.alone(row, f"s->z[{z + i}]", target)
                for j, operand in enumerate(y):
                    self.add(f"T2_{k}", (i, j), m.T2[i, j], row.pop(operand, NOWHERE))
            elif name == "r":
                self.alone(row, y[i], target)
                for j, operand in enumerate(hat):
                    self.add(f"minus_C_{k}", (i, j), -m.C[i, j], row.pop(operand, NOWHERE))
            elif name == "s->z":
                for j in vertices:
                    self.alone(row, f"h[{j}] * v[{j}]", target)
                for label, matrix, operands in parts:
                    for c, operand in enumerate(operands):
                        shared = row.pop(operand, None)
                        for j in range(len(matrix)):
                            own = vertices.get(j, {}).pop(operand, NOWHERE)
                            self.add(f"{label}_{k}", (j, i - z, c), matrix[j, i - z, c], shared or own)
                for j, own in vertices.items():
                    self.rest(own, f"v[{j}] of {target}")
                vertices, count = {}, count + 1
            elif name == "s->a" and i == a + e:
                self.alone(row, target, target)
                self.add("rate", (), self.t.rate, row.pop(f"e - {target}", NOWHERE))
            else:
                self.refuse(target)
            self.rest(row, target)
        if (count, e + 1) != (n, len(m.M)):
            self.refuse(f"{count} states and {e + 1} residuals")


def tables_of(t) -> dict[str, np.ndarray]:
    """What stands in the C as tables."""
    return {"bound": t.bound, "limit": t.limit, "most": t.most}
