"""Where every constant of a polytopic observer, and of a law beside it, stands in its C.

Its sums are statements in a fixed order: of z each row has what all vertices share, and before it what every vertex
adds. They are read term by term from the syntax tree, operand against operand; an operand that the tables do not know
is an error. What is compared, cut and counted is held to the tree of the C as it is printed anew (``own_places``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from pycparser import c_ast, c_generator

from ..errors import CertificateError
from .c_reader import Node, Source, walk
from .symbolic import NOWHERE, Coefficient, number

Row = dict[str, Coefficient]
ONE = Fraction(1)


def read_polytopic(source: Source, prefix: str, t, found) -> set[str]:
    """Read every constant but those of the input checks.

    Parameters
    ----------
    source : Source
        Its tree is that of the C as it must be.
    prefix : str
    t : PolytopicTables
    found : object
        ``add`` takes what is read.

    Returns
    -------
    functions : set of str
        Those that were read.

    Raises
    ------
    CertificateError
        A number or a term differs from the tables.
    """
    r = _Reader(source, prefix, t.real, found)
    n, p, m, h = len(t.T2), len(t.C), t.G.shape[2], len(t.F)
    hat, out, u = ([f"{name}[{k}]" for k in range(count)] for name, count in (("x_hat", n), ("r", p), ("in->u", m)))
    if hasattr(t, "algebraic"):
        read_solved(r, t, u)
    else:
        r.rows("estimate", "x_hat", [f"s->z[{i}]" for i in range(n)], (("T2", t.T2, [f"y[{k}]" for k in range(p)]),))
    r.rows("residual", "r", [f"y[{i}]" for i in range(p)], (("minus_C", -t.C, hat),))
    r.rows("step", "out->r", [""] * p, (("M", t.M, out),))
    known = [f"h[{h + k}]" for k in range(t.known.shape[1])]
    r.blended("move", "s->z", (("F", t.F, hat), ("G", t.G, u), ("minus_K", -t.K, out)), (("known", t.known, known),))
    for function, fields in (("init", ("z0", "y0")), ("whole_range", ("z_mid", "y_mid"))):
        for name, vector in zip(fields, ("s->z", "s->y")):
            r.vector(function, vector, name, getattr(t, name))
    for function, table, name, values in (("outside", "threshold", "h", t.h), ("move", "least", "z_lo", t.z_lo),
                                          ("move", "most", "z_hi", t.z_hi)):
        r.table(function, table, name, values)
    r.program("weights", t.weights.constants)
    if t.law is not None:
        law = t.law
        s = [f"law->s[{k}]" for k in range(len(law.rows))]
        r.blended("command", "in->u", (("Kx", law.Kx, hat), ("Ki", law.Ki, s)), ())
        for function, table, name, values in (("command", "least", "u_lo", t.u_lo), ("command", "most", "u_hi", t.u_hi),
                                              ("integrate", "limit", "limit", law.limit)):
            r.table(function, table, name, values)
        for c in r.constants("integrate"):
            if c.value:
                found.add("period", "", f"{prefix}_integrate", (), law.period, c)
        for k, c in enumerate(r.constants("ref_accepted")):
            found.add("reference", "", f"{prefix}_ref_accepted", (k // 2,), law.reference[k // 2],
                      Coefficient(abs(c.value), c.literal, c.line))
    return r.seen


def read_solved(r: _Reader, t, u: list[str]) -> None:
    """Read the estimate of an observer that solves the algebraic equations: all other states are those of z.

    Parameters
    ----------
    r : _Reader
    t : DescriptorTables
    u : list of str
        What the C calls the inputs.

    Raises
    ------
    CertificateError
        A number or a term differs from the tables.
    """
    z = [f"s->z[{k}]" for k in range(len(t.z0))]
    r.blended("estimate", "x_hat", (("P", t.P, z), ("Q", t.Q, u)), (), "g" if t.uneven else "h",
              {k: z[k] for k in t.moving.tolist()})
    if not t.uneven:
        return
    wanted = {f"g[{j}]": ("pivot", (j,), d) for j, d in enumerate(t.pivot)} | {
        "pivot": ("least_pivot", (), t.least_pivot)}
    for node in walk(r.body("estimate")):
        target = r.text.visit(node.lvalue) if isinstance(node, c_ast.Assignment) else ""
        if target in wanted:
            whole = target.replace("g", "h") == r.text.visit(node.rvalue)  # a pivot of 1
            for c in [Coefficient(ONE, "", node.coord.line)] if whole else r.numbers(node.rvalue):
                r.add("estimate", *wanted[target], c)


class _Reader:
    """Reads statements of one C."""

    def __init__(self, source: Source, prefix: str, real: str, found):
        self.source, self.prefix, self.real, self.found = source, prefix, real, found
        self.text, self.seen = c_generator.CGenerator(), set()

    def body(self, function: str) -> Node:
        """The body of a function."""
        self.seen.add(f"{self.prefix}_{function}")
        return self.source.function(f"{self.prefix}_{function}").body

    def add(self, function: str, name: str, index: tuple[int, ...], value, c: Coefficient) -> None:
        """Keep a constant."""
        self.found.add(name, "", f"{self.prefix}_{function}", index, value, c)

    def statements(self, function: str, target: str) -> Iterator[tuple[str, int, Row, int]]:
        """Name, index, terms and line of the assignments to elements of ``target``, or of v, outside of loops."""
        for node in (n for item in self.body(function).block_items for n in _outside_loops(item)):
            if not isinstance(node, c_ast.Assignment) or node.op != "=":
                continue
            place = re.fullmatch(r"(.*)\[(\d+)\]", self.text.visit(node.lvalue))
            if place and place[1] in (target, "v"):
                yield place[1], int(place[2]), dict(self.terms(node.rvalue)), node.coord.line

    def terms(self, node: Node, sign: int = 1) -> Iterator[tuple[str, Coefficient]]:
        """Operand and coefficient of every term of a sum; one that is a number alone is nothing."""
        if isinstance(node, c_ast.BinaryOp) and node.op in "+-":
            yield from self.terms(node.left, sign)
            yield from self.terms(node.right, sign if node.op == "+" else -sign)
        elif isinstance(node, c_ast.UnaryOp) and node.op == "-":
            yield from self.terms(node.expr, -sign)
        elif isinstance(node, c_ast.BinaryOp) and isinstance(node.left, c_ast.Constant):
            value, line = node.left.value, node.left.coord.line
            yield self.text.visit(node.right), Coefficient(sign * number(value, self.real), value, line)
        elif isinstance(node, c_ast.Constant):
            if number(node.value, self.real):
                self.refuse(node.coord.line, f"adds {node.value}")
        else:
            yield self.text.visit(node), Coefficient(Fraction(sign), "", node.coord.line)

    def rows(self, function: str, target: str, first: list[str], parts: tuple) -> None:
        """Read a vector of sums: each operand of ``first`` once, then products with the rows of matrices."""
        rows = {i: row for name, i, row, _ in self.statements(function, target) if name == target}
        for i, operand in enumerate(first):
            row = rows.pop(i, {})
            if operand and row.pop(operand, NOWHERE).value != ONE:
                self.refuse(0, f"has no {operand} in row {i} of {target}")
            for name, M, operands in parts:
                for k, place in enumerate(operands):
                    self.add(function, name, (i, k), M[i, k], row.pop(place, NOWHERE))
            self.nothing_left(row, f"row {i} of {target}")
        self.nothing_left(rows, function)

    def blended(self, function: str, target: str, parts: tuple, shared: tuple, weight: str = "h",
                copies: dict[int, str] | None = None) -> None:
        """Read a vector of sums of weights times what each vertex says; ``shared`` are terms without weights.

        Of the rows in ``copies``, which are in no matrix, each is that one operand.
        """
        copies = copies or {}
        own: dict[int, Row] = {}
        done = 0
        for name, i, row, line in self.statements(function, target):
            if name == "v":
                own[i] = row
                continue
            weighted = {j: row.pop(f"{weight}[{j}] * v[{j}]", NOWHERE) for j in own}
            if any(c.value != ONE for c in weighted.values()) or i != done:
                self.refuse(line, f"{target}[{i}] is no sum of weights times what the vertices say")
            if i in copies and row.pop(copies[i], NOWHERE).value != ONE:
                self.refuse(line, f"{target}[{i}] is not {copies[i]}")
            at = i - sum(k < i for k in copies)
            for label, M, operands in () if i in copies else parts:
                for k, place in enumerate(operands):
                    all_of = row.pop(place, None)
                    for j in range(len(M)):
                        alone = own.get(j, {}).pop(place, NOWHERE)
                        if all_of and alone.value:
                            self.refuse(line, f"{place} is read twice")
                        self.add(function, label, (j, at, k), M[j, at, k], all_of or alone)
            for label, M, operands in shared:
                for k, place in enumerate(operands):
                    self.add(function, label, (i, k), M[i, k], row.pop(place, NOWHERE))
            for rest in (row, *own.values()):
                self.nothing_left(rest, f"{target}[{i}]")
            own, done = {}, done + 1
        if done != parts[0][1].shape[1] + len(copies):
            self.refuse(0, f"has {done} rows of {target}")

    def vector(self, function: str, target: str, name: str, values) -> None:
        """Read a vector of numbers."""
        rows = {}
        for node in walk(self.body(function)):
            place = re.fullmatch(r"(.*)\[(\d+)\]", self.text.visit(node.lvalue)) if isinstance(
                node, c_ast.Assignment) else None
            if place and place[1] == target:
                rows[int(place[2])] = next(self.numbers(node.rvalue))
        for i, value in enumerate(values):
            self.add(function, name, (i,), value, rows.pop(i, NOWHERE))
        self.nothing_left(rows, target)

    def table(self, function: str, table: str, name: str, values) -> None:
        """Read a table, number for number."""
        declared = [n for n in walk(self.body(function)) if isinstance(n, c_ast.Decl) and n.name == table and n.init]
        read = list(self.numbers(declared[0].init)) if len(declared) == 1 else []
        if len(read) != values.size:
            self.refuse(0, f"{function} has {len(read)} numbers in the table {table}")
        for (index, value), c in zip(np.ndenumerate(values), read):
            self.add(function, name, index, value, c)

    def program(self, function: str, constants: tuple[float, ...]) -> None:
        """Read the numbers of the program of the weights: each is one of its constants, and each of these is there."""
        missing = set(range(len(constants)))
        for c in self.numbers(self.body(function)):
            places = [k for k, value in enumerate(constants) if Fraction(value) == c.value]
            if c.value and not places:
                self.refuse(c.line, f"{c.literal} is no number of the weights")
            for k in places:
                self.add(function, "weights", (k,), constants[k], c)
            missing -= set(places)
        self.nothing_left({str(k): constants[k] for k in missing}, "the program of the weights")

    def constants(self, function: str) -> Iterator[Coefficient]:
        """Every number of the statements of a function, tables apart."""
        for item in self.body(function).block_items:
            if not isinstance(item, c_ast.Decl) or not isinstance(item.init, c_ast.InitList):
                yield from self.numbers(item)

    def numbers(self, node: Node, sign: int = 1) -> Iterator[Coefficient]:
        """Every real number below a node, with the sign before it."""
        if isinstance(node, c_ast.Constant):
            if node.type in ("float", "double"):
                yield Coefficient(sign * number(node.value, self.real), node.value, node.coord.line)
            return
        negative = isinstance(node, c_ast.UnaryOp) and node.op == "-" and isinstance(node.expr, c_ast.Constant)
        for _, child in node.children():
            yield from self.numbers(child, -1 if negative else 1)

    def nothing_left(self, row: dict, where: str) -> None:
        """Refuse terms that the tables do not know."""
        if row:
            self.refuse(0, f"{where} has {', '.join(map(str, row))}, which the tables do not know")

    def refuse(self, line: int, words: str) -> None:
        """Raise."""
        where = f"{self.source.name}:{line}" if line else self.source.name
        raise CertificateError(f"{where}: {words} (found), expected the C of the design. Print it again.")


def _outside_loops(node: Node) -> Iterator[Node]:
    """A statement and those in its branches, in their order."""
    yield node
    if isinstance(node, c_ast.Compound | c_ast.If):
        for _, child in node.children():
            yield from _outside_loops(child)
