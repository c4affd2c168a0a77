"""Where every constant of a point observer stands in its C.

The maps of the estimate are executed with symbols, as those of framers are (``places``). What moves and tests the set
is no affine map, and the same text for all numbers: there every ``static const`` table and every number is read from
the syntax tree, a table must be a field of the design's tables number for number (in the memory's order, or generator
by generator), every field must be found, and all that is no number must be the tree of the C as it is printed anew. So
a family needs no reader of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from fractions import Fraction

import numpy as np
from pycparser import c_ast

from ..emit.render import render
from ..errors import CertificateError
from .c_reader import Node, Source, read, walk
from .symbolic import NOWHERE, Coefficient, Machine, Place, number

Array = np.ndarray
#: Fields that the C does not hold: ends of the initial box and of the ranges (it has centre and set of each), and how
#: the estimate is made (its maps are read one by one).
UNPRINTED = {"x_lo", "x_hi", "x0_lo", "x0_hi", "u_lo", "u_hi", "y_lo", "y_hi"}
READ_BY_MAPS = set("MGLNdABaCDc")
#: What the test of all residuals together reads, which not every number of outputs needs.
TOGETHER = {"directions", "slack", "floor"}
#: Numbers of the formulas themselves, which the printed tree holds to their places.
FORMULA = {0, 1, Fraction(1, 2)}


def read_sets(source: Source, design, d, t, read_apart: set[str], found) -> None:
    """Read everything of the C but the functions of ``read_apart``, which are read elsewhere.

    Parameters
    ----------
    source : Source
    design : Design
    d : DesignView
        Of the C as it must be.
    t : PointTables
    read_apart : set of str
    found : object
        ``add`` takes what is read.

    Raises
    ------
    CertificateError
        A number, a table or anything else differs from the tables or from the C as it is printed.
    """
    fresh = read(d.prefix, render(f"{d.family}.c.jinja", d=d), render(d.header, d=d))
    same_tree(source, fresh)
    known = known_of(type(design.observer)({t.real: t}, design.observer.supervision), t)
    read_starts(source, d.prefix, known, found)
    read_cut(source, d.prefix, t, found)
    modes, seen = [m.name for m in design.plant.modes], {"box", "x_hat", "x0_hat"}
    starts = {f"{d.prefix}_{name}" for name in ("init", "whole_range")}
    read_tables(source, d.real, known, modes, read_apart, starts, seen, found)
    require_all(source, known, seen | READ_BY_MAPS | TOGETHER | getattr(t.shape, "unprinted", set()))


def read_tables(source: Source, real: str, known: dict, modes: list[str], read_apart: set[str], starts: set[str],
                seen: set[str], found) -> None:
    """Read every table and number of the functions that are not read elsewhere.

    Parameters
    ----------
    source : Source
        Its tree is that of the C as it must be.
    real : {"float32", "float64"}
    known : dict
        Name -> numbers of the tables.
    modes : list of str
    read_apart : set of str
        Functions that are read elsewhere, starts whose single numbers are.
    starts : set of str
    seen : set of str
        Names found so far; those found here are added.
    found : object

    Raises
    ------
    CertificateError
        A table or number is none of ``known``.
    """
    for function, definition in source.functions.items():
        if function in read_apart:
            continue
        inside: set[int] = set()
        for node in walk(definition.body):
            if isinstance(node, c_ast.Decl) and isinstance(node.init, c_ast.InitList) and "static" in node.storage:
                if not any(_numbers(node, real, set())):
                    continue  # whole numbers: the tree is that of the C as it is printed anew
                inside |= {id(n) for n in walk(node)}
                side = f"{node.name}_{function.rsplit('_', 1)[-1]}"
                order = {k: known[k] for k in sorted(known, key=lambda k: (k not in (node.name, side), k in seen))}
                seen |= _match(source, function, node, order, modes, real, found)
        for c in () if function in starts else _numbers(definition.body, real, inside):
            name = next((k for k, v in known.items() if v.size == 1 and v.ndim == 0 and c.value
                         and Fraction(float(v)) == c.value), "")
            if name:
                found.add(name, "", function, (), known[name], c)
                seen.add(name)
            elif c.value not in FORMULA:
                raise CertificateError(f"{source.name}:{c.line}: {function} has {c.literal}, no number of the tables "
                                       "(expected none). Print it again.")


def require_all(source: Source, known: dict, seen: set[str]) -> None:
    """Refuse where numbers of the tables were not found in the C.

    Raises
    ------
    CertificateError
    """
    missing = [k for k, v in known.items() if np.any(v) and k not in seen]
    if missing:
        raise CertificateError(f"{source.name}: does not hold {', '.join(missing)} of the tables (expected every one). "
                               "Print it again.")


def same_tree(source: Source, fresh: Source) -> None:
    """Compare two C texts, comments and layout apart.

    Raises
    ------
    CertificateError
        Naming the first function that differs.
    """
    if list(source.functions) != list(fresh.functions):
        raise CertificateError(f"{source.name}: its functions are not those of the design (found "
                               f"{len(source.functions)}, expected {', '.join(fresh.functions)}). Print it again.")
    for name, definition in fresh.functions.items():
        pairs = zip(_words(source.functions[name]), _words(definition), strict=False)
        other = next((pair for pair in pairs if pair[0][0] != pair[1][0]), None)
        if other or sum(1 for _ in walk(source.functions[name])) != sum(1 for _ in walk(definition)):
            line = other[0][1] if other else source.functions[name].coord.line
            raise CertificateError(f"{source.name}:{line}: {name} is not what residua prints of this design. Print it "
                                   "again.")
    types, expected = ([w for n in s.others for w in _words(n)] for s in (source, fresh))
    other = next((line for (a, line), (b, _) in zip(types, expected) if a != b), None)
    if other is not None or len(types) != len(expected):
        raise CertificateError(f"{source.name}:{other or 1}: its types are not those that residua prints of this "
                               "design. Print it again.")
    if source.macros != fresh.macros:
        raise CertificateError(f"{source.name}: its macros, or those of its header, are not those of the design. Print "
                               "it again.")


def _words(node: Node) -> Iterator[tuple[tuple, int]]:
    """Kind and words of every node of a tree, each with its line."""
    for n in walk(node):
        yield (type(n).__name__, *(repr(getattr(n, a)) for a in n.attr_names)), n.coord.line if n.coord else 0


def known_of(runner, t) -> dict[str, Array]:
    """Numbers of the tables by name; of the sets of the initial box and of the ranges what the C holds."""
    known = {f.name: getattr(t, f.name) for f in fields(t)}
    known |= {f.name + " of the set" * (f.name in known): getattr(t.shape, f.name) for f in fields(t.shape)}
    known = {k: v for k, v in known.items() if isinstance(v, np.ndarray) and k not in UNPRINTED}
    for stem, first in (("x0", True), ("x", False)):
        runner.start(t, 1)
        if not first:
            runner.reset(t, np.ones(1, dtype=bool))
        known[f"{stem}_hat"] = runner.x_hat[0]
        whole = runner.set[0]
        if whole.dtype != t.dtype or hasattr(t.shape, "anywhere"):  # a table, or a set with starts of its own
            known.pop("limit", None)
        else:
            known[f"{stem}_set"] = np.diagonal(whole[:, :len(t.box)]).copy() if whole.ndim == 2 else whole
    return known


def _numbers(node: Node, real: str, without: set[int]) -> Iterator[Coefficient]:
    """Every real number of a tree, but in the nodes of ``without``."""
    for n in walk(node):
        if isinstance(n, c_ast.Constant) and n.type in ("float", "double") and id(n) not in without:
            yield Coefficient(number(n.value, real), n.value, n.coord.line)


def _entries(node: Node, real: str, sign: int = 1) -> Iterator[Coefficient]:
    """Numbers of an initialiser in order, with their signs."""
    if isinstance(node, c_ast.InitList):
        for e in node.exprs:
            yield from _entries(e, real)
    elif isinstance(node, c_ast.UnaryOp) and node.op == "-":
        yield from _entries(node.expr, real, -sign)
    else:
        yield Coefficient(sign * number(node.value, real), node.value, node.coord.line)


def _match(source: Source, function: str, node: Node, known: dict, modes: list[str], real: str, found) -> set[str]:
    """Find the fields that a table is, and keep its entries under the first of them; return all of them.

    Where fields are the same numbers, the one of the table's name comes first, then those not found before.
    """
    entries = list(_entries(node.init, real))
    values = [c.value for c in entries]
    names = {}
    for name, value in known.items():
        for order in _orders(name, value):
            if order.size == len(values) and all(Fraction(float(v)) == c for v, c in zip(value.ravel()[order], values)):
                names.setdefault(name, order)
    if not names:
        raise CertificateError(f"{source.name}:{node.coord.line}: table {node.name} of {function} is none of the "
                               "design's tables (expected one, number for number). Print it again.")
    name = next(iter(names))
    value = known[name]
    by_mode = value.ndim > (name == "H") + 1 and len(value) == len(modes) and name in MODE_FIRST
    for at, c in zip(names[name], entries):
        index = tuple(int(i) for i in np.unravel_index(at, value.shape))
        mode, index = (modes[index[0]], index[1:]) if by_mode else ("", index)
        found.add(name, mode, function, index, value.ravel()[at], c)
    return set(names)


#: Fields whose first axis is the mode: the document gives them mode by mode.
MODE_FIRST = {*"MACVHPS", "F", "Fb", "Hb", "rho", "k", "kb", "kr", "Pb", "gb", "powers", "rows", "Phi", "Gamma",
              "shift", "reach", "G", "M_hi", "M_lo", "L_hi", "L_lo", "K_hi", "K_lo", "d_hi", "d_lo"}


#: Fields whose first two axes are modes, of which the C has those of two different ones.
PAIRS = {"J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth"}


def _orders(name: str, value: Array) -> Iterator[Array]:
    """The orders in which a field may be printed.

    Its own, the directions beyond the outputs, column after column, or of symmetric matrices the lower triangles; of
    pairs of modes one order alone.
    """
    at = np.arange(value.size).reshape(value.shape)
    if name in PAIRS:
        yield at[~np.eye(len(value), dtype=bool)].ravel()
        return
    yield at.ravel()
    if value.ndim == 2 and len(value) > value.shape[1]:
        yield at[value.shape[1]:].ravel()  # the first directions are the outputs themselves
    if value.ndim >= 3 and value.shape[-2] == value.shape[-1] and np.array_equal(value, value.swapaxes(-2, -1)):
        yield at[(..., *np.tril_indices(value.shape[-1]))].ravel()
    if value.ndim >= 4:
        yield at.swapaxes(-2, -1).ravel()
        yield at.swapaxes(0, 1).ravel()  # mode by mode, in each the origins
        yield at.swapaxes(0, 1).swapaxes(-2, -1).ravel()


def read_starts(source: Source, prefix: str, known: dict, found,
                starts=(("init", "x0_hat"), ("whole_range", "x_hat"))) -> None:
    """Read the estimates of init and reset."""
    for function, name in starts:
        machine = Machine(source, known[name].dtype.name, skip=frozenset(source.functions))
        body = source.function(f"{prefix}_{function}").body
        for node in body.block_items or ():
            if isinstance(node, c_ast.Assignment):
                machine.block(node, {"s": Place("s")})
        for i, value in enumerate(known[name]):
            stored = machine.memory.get(f"s->x_hat[{i}]")
            c = NOWHERE if stored is None else stored.get("", NOWHERE) if set(stored) <= {""} else NOWHERE
            found.add(name, "", f"{prefix}_{function}", (i,), value, c)


def read_cut(source: Source, prefix: str, t, found) -> None:
    """Read the box to which the estimate is cut."""
    machine = Machine(source, t.real, clip=frozenset({f"{prefix}_clip"}))
    machine.call(f"{prefix}_cut")
    for i, value in enumerate(t.box):
        least, most = machine.clipped.get(f"x_hat[{i}]", (NOWHERE, NOWHERE))
        found.add("box", "", f"{prefix}_cut", (i,), value, most)
        found.add("box", "", f"{prefix}_cut", (i,), value, Coefficient(-least.value, least.literal, least.line))
