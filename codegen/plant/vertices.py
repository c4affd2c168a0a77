"""``[[vertex]]`` tables and ``[nonlinear]`` equations of a plant file, checked and turned into a `Polytope`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy

from codegen.errors import PlantError
from codegen.plant.enclosure import UnboundedError, enclosure, lower_bound
from codegen.plant.factors import SectorError, Wish, brief, checked, factorised
from codegen.plant.linearise import linearised
from codegen.plant.matrices import SHAPES, Source, check_shape, entries
from codegen.plant.model import Array, Signal
from codegen.plant.names import check_channels
from codegen.plant.polytopic import Known, Polytope, Vertex
from codegen.plant.schema import NonlinearTable, PlantFile, SwitchingTable
from codegen.plant.sector import corners, premises_of
from codegen.plant.signals import count, frozen
from codegen.plant.symbols import ARGUMENTS, Names, names_of

Signals = Mapping[str, tuple[Signal, ...]]
_NOT_SMOOTH = (sympy.Abs, sympy.Min, sympy.Max, sympy.Piecewise, sympy.sign, sympy.floor)
_JUMPS = (sympy.Piecewise, sympy.sign, sympy.floor)


def polytope_of(file: PlantFile, signals: Signals) -> Polytope | None:
    """Return the polytope of a plant file; None where it has modes.

    Parameters
    ----------
    file : PlantFile
    signals : mapping
        From `signals_of`.

    Returns
    -------
    polytope : Polytope or None

    Raises
    ------
    PlantError
        Modes or switching beside vertices; a matrix that is missing, has the wrong shape or varies; a name that no
        expression could use; a range that is missing; weights that are negative or all zero somewhere; equations
        that have no sector model.
    """
    if file.nonlinear is None and not file.vertex:
        return None
    place = "nonlinear" if file.nonlinear is not None else "vertices"
    if file.nonlinear is not None and file.vertex:
        raise PlantError("nonlinear: [[vertex]] tables are given too. Give one of them.")
    if file.mode:
        raise PlantError(f"{place}: [[mode]] tables are given too (found {len(file.mode)}). Give one of them.")
    if file.switching != SwitchingTable():
        raise PlantError(f"{place}: has no modes to switch between (found [switching]). Remove [switching].")
    if file.common.Dw is not None:
        raise PlantError(f"common.Dw: a plant of {place} has none (found one). Bound what w does to y by v.")
    names = names_of(file, signals)
    common = {name: _matrix(name, file, signals) for name in ("E", "C", "D", "Dv", "Df")}
    if file.vertex:
        return _of_vertices(file, signals, names, common)
    for name in ("A", "B") + (("E",) if file.nonlinear.E is not None else ()):
        if getattr(file.common, name) is not None:
            raise PlantError(f"common.{name}: is given beside [nonlinear] (found both). Give it in [nonlinear] only.")
    return _of_equations(file, signals, names, common)


def _matrix(name: str, file: PlantFile, signals: Signals, place: str = "", rows: list | None = None) -> Array:
    """A constant matrix of a vertex, or of [common] where that gives none; zero, or the identity for E, if neither."""
    shared = getattr(file.common, name)
    if rows is None and shared is None:
        vectors = [signals[v] for v in SHAPES[name]]
        if name in ("C", "Bw", "Dv", "A") and vectors[1]:
            raise PlantError(f"{place or f'common.{name}'} is missing (expected {len(vectors[0])}x{len(vectors[1])}: "
                             f"{SHAPES[name][0]} has {count(vectors[0])}, {SHAPES[name][1]} has {len(vectors[1])}). "
                             f"Add it to {'the vertex or to ' if place else ''}[common].")
        return frozen(np.eye(len(vectors[0])) if name == "E" else np.zeros(tuple(map(len, vectors))))
    source = Source(place, rows) if rows is not None else Source(f"common.{name}", shared)
    check_shape(source, name, signals)
    return entries(source, name, file.constants, {**signals, "theta": ()})[0]


def _of_vertices(file: PlantFile, signals: Signals, names: Names, common: dict[str, Array]) -> Polytope:
    check_channels("vertices", (t.name for t in file.vertex if t.name))
    vertices, raw = [], []
    for i, table in enumerate(file.vertex):
        place = f"vertices.{table.name or f'#{i + 1}'}"
        own = {name: _matrix(name, file, signals, f"{place}.{name}", getattr(table, name))
               for name in ("A", "B", "Bw", "Bf")}
        offset = [0.0] * len(signals["x"]) if table.offset is None else table.offset
        _check_length(f"{place}.offset", offset, signals["x"], "x")
        vertices.append(Vertex(table.name or f"vertex {i + 1}", **own, offset=frozen(offset)))
        raw.append((f"{place}.weight", table.weight))
    _check_faults(vertices, common, signals)
    return Polytope(**common, vertices=tuple(vertices), symbols=names.symbols, raw=_weights(raw, names, "vertices"))


def _weights(texts: list[tuple[str, str]], names: Names, place: str) -> tuple[Any, ...]:
    """Weights that are nowhere negative and nowhere all zero within the ranges."""
    raw = []
    for where, text in texts:
        weight = names.read(where, text, _JUMPS, "a function without jumps, of + - * / **, exp, min, max ...")
        box = names.box(where, weight)
        try:
            lo = lower_bound(weight, box, 0.0)
        except UnboundedError:
            raise PlantError(f"{where}: has no bounds within the ranges (it divides by zero or leaves the domain of a "
                             "root or logarithm). Narrow the ranges, or take another function.") from None
        if lo < -1e-6:
            raise PlantError(f"{where}: is {lo:.4g} somewhere within the ranges (expected at least 0). "
                             "Write max(..., 0), or take another function.")
        raw.append(weight)
    total = sympy.Add(*raw)
    # Exponentials are positive, however small; what is far from all centres is for the run time to scale.
    if not all(w.func is sympy.exp for w in raw) and not lower_bound(total, names.box(place, total), 1e-6) > 0:
        raise PlantError(f"{place}: all weights are zero together somewhere within the ranges (expected a sum above "
                         "0). Let neighbours overlap.")
    return tuple(raw)


def _of_equations(file: PlantFile, signals: Signals, names: Names, common: dict[str, Array]) -> Polytope:
    table = file.nonlinear
    _check_length("nonlinear.f", table.f, signals["x"], "x")
    why = "smooth functions: + - * / **, sin, cos, tan, exp, log, sqrt"
    f = [names.read(f"nonlinear.f.#{i + 1}", text, _NOT_SMOOTH, why) for i, text in enumerate(table.f)]
    if table.E is not None:
        common["E"] = _matrix("E", file, signals, "nonlinear.E", table.E)
    x, u = ([s for s, (vector, _) in names.ranges.items() if vector == v] for v in ("x", "u"))
    fixed = {name: _matrix(name, file, signals) for name in ("Bw", "Bf")}
    shared = {**common, "symbols": names.symbols, "equations": tuple(f)}
    if table.point:
        parts, raw = _points(table, f, x, u, signals, names)
        premises = ()
    else:
        known = shared["known"] = _known(table, common, (x, u), signals, names, why)
        rest = {k.row: f[k.row] - k.term for k in known}
        parts, premises = _sectors(table, [rest.get(i, row) for i, row in enumerate(f)], x, u, names, why)
        raw = () if premises else (sympy.Integer(1),)
    labels = [p.name or f"vertex {i + 1}" for i, p in enumerate(table.point)] or [
        f"vertex {i + 1}" for i in range(len(parts))]
    vertices = tuple(Vertex(label, frozen(A), frozen(B), **fixed, offset=frozen(c.ravel()))
                     for label, (A, B, c) in zip(labels, parts))
    _check_faults(vertices, common, signals)
    return Polytope(**shared, vertices=vertices, premises=tuple(premises), raw=raw)


def _points(table: NonlinearTable, f: list, x: list, u: list, signals: Signals, names: Names) -> tuple[list, tuple]:
    if table.A is not None or table.B is not None or table.premise or table.known is not None:
        raise PlantError("nonlinear.point: A, B, known or premise are given too (found sectors and points). Remove "
                         "one.")
    check_channels("nonlinear.point", (p.name for p in table.point if p.name))
    parts = []
    for i, point in enumerate(table.point):
        place = f"nonlinear.point.{point.name or f'#{i + 1}'}"
        for vector in ARGUMENTS:
            _check_length(f"{place}.{vector}", getattr(point, vector), signals[vector], vector)
        at = dict(zip(names.symbols, (*point.x, *point.u, *point.theta)))
        parts.append(_tried(place, linearised, f, x, u, at))
    raw = [(f"nonlinear.point.{p.name or f'#{i + 1}'}.weight", p.weight) for i, p in enumerate(table.point)]
    return parts, _weights(raw, names, "nonlinear.point")


def _sectors(table: NonlinearTable, f: list, x: list, u: list, names: Names, why: str) -> tuple[list, list]:
    wishes = []
    check_channels("nonlinear.premise", (p.name for p in table.premise))
    for p in table.premise:
        term = names.read(f"nonlinear.premise.{p.name}.term", p.term, _NOT_SMOOTH, why)
        if not term.free_symbols:
            raise PlantError(f"nonlinear.premise.{p.name}.term: is the constant {brief(term)} (expected a term that "
                             "varies). Remove the premise.")
        wishes.append(Wish(p.name, term, None if p.bounds is None else tuple(p.bounds)))
    if table.A is None and table.B is None:
        factors = _tried("nonlinear", factorised, f, x, u, wishes)
    else:
        given = [_symbolic_matrix(name, getattr(table, name), len(x), width, names, why)
                 for name, width in (("A", len(x)), ("B", len(u)))]
        factors = _tried("nonlinear", checked, f, *given, x, u)
    parts = [factors.A, factors.B, factors.c, *(sympy.Matrix([w.term]) for w in wishes),
             *(sympy.Matrix([q]) for q in factors.quotients.values())]
    box = names.box("nonlinear", *(sympy.Tuple(*(M.subs(factors.quotients))) for M in parts))
    factors, premises, symbols = _tried("nonlinear", premises_of, factors, wishes, box)
    return corners(factors, premises, symbols), premises


def _known(table: NonlinearTable, common: dict[str, Array], states_inputs: tuple[list, list], signals: Signals,
           names: Names, why: str) -> tuple[Known, ...]:
    """The part of f that is a function of inputs, exact parameters, and states that an output is."""
    if table.known is None:
        return ()
    _check_length("nonlinear.known", table.known, signals["x"], "x")
    found = []
    (x, u), bare = states_inputs, {key: common[key] for key in ("E", "C", "D", "Dv", "Df")}
    exact = {x[k] for k in Polytope(**bare, vertices=(), symbols=()).exact}
    exact |= {s for s, (vector, t) in names.ranges.items() if vector == "theta" and t.measured and t.error == 0}
    for i, text in enumerate(table.known):
        place = f"nonlinear.known.#{i + 1}"
        term = names.read(place, text, _NOT_SMOOTH, why)
        if other := sorted(map(str, term.free_symbols - exact - set(u))):
            raise PlantError(f"{place}: reads {other[0]}, which the observer does not know exactly (expected inputs, "
                             "parameters measured without error, and states that an output is, without noise, fault "
                             "or input). Leave it to A and B.")
        try:
            bounds = enclosure(term, names.box(place, term))
        except UnboundedError:
            raise PlantError(f"{place}: has no bounds over the ranges (it divides by zero or leaves the domain of a "
                             "root or logarithm). Narrow the ranges.") from None
        found += [Known(i, term, *bounds)] if term != 0 else []
    return tuple(found)


def _symbolic_matrix(name: str, rows: list | None, height: int, width: int, names: Names, why: str) -> Any:
    if rows is None:
        if width:
            raise PlantError(f"nonlinear.{name} is missing (expected {height}x{width} beside the other factor). Add "
                             "it, or leave A and B out.")
        return sympy.zeros(height, 0)
    found = (len(rows), len(rows[0]) if rows else 0)
    if found != (height, width):
        raise PlantError(f"nonlinear.{name} is {found[0]}x{found[1]}, expected {height}x{width}. Give {height} rows of "
                         f"{width}.")
    place = f"nonlinear.{name}: row {{}}, column {{}}"
    return sympy.Matrix(height, width, lambda i, j: names.read(
        place.format(i + 1, j + 1), entry, _NOT_SMOOTH, why) if isinstance(entry := rows[i][j], str)
        else sympy.Rational(repr(entry)))


def _tried(place: str, function, *arguments):
    """Call a function and say where in the file its SectorError lies."""
    try:
        return function(*arguments)
    except SectorError as error:
        raise PlantError(f"{'.'.join(p for p in (place, error.place) if p)}: {error}") from None


def _check_length(place: str, values: list, channels: tuple[Signal, ...], vector: str) -> None:
    if len(values) != len(channels):
        raise PlantError(f"{place}: has {len(values)} entries, expected {len(channels)} ({vector} has "
                         f"{count(channels)}). Give one per channel"
                         + (f": {', '.join(s.name for s in channels)}." if channels else "."))


def _check_faults(vertices, common: dict[str, Array], signals: Signals) -> None:
    if signals["f"] and not common["Df"].any() and not any(v.Bf.any() for v in vertices):
        raise PlantError(f"common: Bf and Df are both missing or zero (signals.f has {count(signals['f'])}). "
                         "Give Bf for a fault on the state, Df for a fault on an output.")
