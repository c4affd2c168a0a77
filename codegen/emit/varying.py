"""Maps with parameters and radii as straight-line code: what ``maps.MapSpec`` and ``straight`` do not have.

Beside the affine map a ``Varying`` has slopes in the measured parameters, entries that take the opposite bound, and
radii. Row i becomes::

    M_i_j    = base + th_0 * slope + ...                      only where a slope is not zero
    common_i = sum of the input terms
    apart_i  = sum R m_j + sum S |u_j| + sum |L_i_j| E         m_j = max(-x_lo[j], x_hi[j])
    lo = common_i + d_lo + sum M x - apart_i,      hi = common_i + d_hi + sum M x + apart_i

in the order of ``codegen.observers.framer``. Products of parameters are parameters behind the measured ones; where a
radius shrinks with the change of a parameter, R_i_j and S_i_j are computed like M_i_j, from g in place of th. Loops
would have to interpolate zeros as well: all layouts are straight, "literal" with one function per mode, the others
over a row of coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .cprint import Term, constant, count_operations, literal, sum_lines
from .maps import Case, MapSpec, MapView, Row, Statement, Straight, Switch
from .pieces import arguments, bounds, unused
from .straight import Columns

Array = np.ndarray


@dataclass(frozen=True)
class Varying:
    """A map with what depends on parameters and what is only bounded.

    Parameters
    ----------
    spec : MapSpec
        Base values at theta = 0; both sides share all gains.
    theta : tuple of str
        C expression of each measured parameter in this step.
    slopes : dict
        Name of a Linear of ``spec`` -> ndarray (N, J, rows, columns); "R" and "S" where they shrink with g.
    flipped : ndarray (N, rows, n_x) bool or None
        Entries of the state matrix that take the opposite bound; None: by sign.
    R : ndarray (N, rows, n_x), S : ndarray (N, rows, n_u), E : ndarray (N, rows, n_y)
        Radii of the state, the input, and the noise through the gain named "L".
    inputs : str
        C array of u.
    near : str
        Stem of the C arrays with the bounds of x that the radii are taken from.
    L_sign, x_sign, u_sign : ndarray (N, rows, n_y), (n_x,), (n_u,)
        1 or -1 where L, x or u keep that sign over the bounds of theta or their ranges, so that a magnitude needs no
        comparison; 2 where L is zero; else 0.
    products : tuple of (int, int)
        Parameters behind those of ``theta``: th_j * th_k.
    paced : tuple of (str, float, float)
        Change of a parameter over the step, the factor on it, and what its square is taken from: g.
    """

    spec: MapSpec
    theta: tuple[str, ...]
    slopes: dict[str, Array]
    flipped: Array | None
    R: Array
    S: Array
    E: Array
    inputs: str
    near: str
    L_sign: Array
    x_sign: Array
    u_sign: Array
    products: tuple[tuple[int, int], ...] = ()
    paced: tuple[tuple[str, float, float], ...] = ()


def lay_out_varying(v: Varying, layout: str) -> MapView:
    """Print the map: per mode with its constants ("literal"), else over a table."""
    modes = np.arange(len(v.spec.names.modes))
    if layout != "literal" or len(modes) == 1:
        return MapView(straights=(body(v, modes, v.spec.name),))
    names, spec = v.spec.names, v.spec
    parts = [replace(body(v, modes[[q]], f"{spec.name}_{q}"), equation=(f'Mode "{names.modes[q]}".',)) for q in modes]
    given = ", ".join(arguments(spec))
    cases = [Case((names.mode_macros[q],), f"{part.name}({given})") for q, part in zip(modes, parts)]
    switch = Switch(spec.name, spec.equation, spec.parameters, spec.selector, (), tuple(cases[:-1]), cases[-1])
    return MapView(straights=tuple(parts), switches=(switch,))


class Printer:
    """Terms of one function; remembers which locals its rows ask for."""

    def __init__(self, v: Varying, modes: Array):
        self.v, self.modes, self.real = v, modes, v.spec.names.real
        self.columns = Columns()
        self.used: set[str] = set()
        self.operations = np.zeros(2, dtype=int)

    def statement(self, target: str, terms: list[Term]) -> Statement:
        """Print a sum and count its operations."""
        self.operations += np.array(count_operations(terms))
        return Statement(target, sum_lines(terms, self.real))

    def define(self, name: str, terms: list[Term]) -> Statement:
        """Declare a local."""
        return self.statement(f"const {self.v.spec.names.real_type} {name}", terms)

    def scheduled(self, part: str, i: int, j: int) -> bool:
        """Whether the entry of a Linear depends on theta in one of the modes."""
        slopes = self.v.slopes.get(part)
        return slopes is not None and bool(np.any(slopes[self.modes][:, :, i, j]))

    def coefficient(self, part: str, values: Array, i: int, j: int) -> Statement:
        """Interpolate one entry."""
        terms = self.columns.terms(f"{part}[{i}][{j}]", values[self.modes][:, i, j], "", self.real)
        local, name = ("g", "g") if part in "RS" else ("th", "theta")
        for p, slope in enumerate(self.v.slopes[part][self.modes].transpose(1, 0, 2, 3)):
            found = self.columns.terms(f"d{part}[{i}][{j}]/d{name}[{p}]", slope[:, i, j], f"{local}_{p}", self.real)
            self.used |= {f"{local}_{p}"} if found else set()
            terms += found
        return self.define(f"{part}_{i}_{j}", terms)

    def entry(self, part: str, values: Array, i: int, j: int, operand: str) -> list[Term]:
        """Term of one entry times its operand."""
        if self.scheduled(part, i, j):
            return [("+", f"({part}_{i}_{j} * {operand})")]
        return self.columns.terms(f"{part}[{i}][{j}]", values[self.modes][:, i, j], operand, self.real)

    def state(self, i: int, side: str) -> list[Term]:
        """Terms of the state in row i of one bound."""
        linear, (own, other) = self.v.spec.state, bounds(self.v.spec, side)
        values, terms = linear.side(side), []
        for j in range(values.shape[2]):
            if self.scheduled(linear.name, i, j):
                terms += self.entry(linear.name, values, i, j, f"{own}[{j}]")
                continue
            column = values[self.modes][:, i, j]
            opposite = column < 0 if self.v.flipped is None else self.v.flipped[self.modes][:, i, j]
            name = f"{linear.name}[{i}][{j}]"
            if opposite.all() or not opposite.any():
                terms += self.columns.terms(name, column, f"{other if opposite.all() else own}[{j}]", self.real)
            else:  # one column per bound, one of them zero in each mode
                terms += self.columns.terms(f"pos({name})", np.where(opposite, 0, column), f"{own}[{j}]", self.real)
                terms += self.columns.terms(f"-neg({name})", np.where(opposite, column, 0), f"{other}[{j}]", self.real)
        return terms

    def radius(self, i: int) -> list[Term]:
        """Terms by which both bounds of row i move apart."""
        v, terms = self.v, []
        for name, values, local in (("R", v.R, "m"), ("S", v.S, "a")):
            for j in range(values.shape[2]):
                found = self.entry(name, values, i, j, f"{local}_{j}")
                self.used |= {f"{local}_{j}"} if found else set()
                terms += found
        for j in range(v.E.shape[2]):
            magnitude = f"({self.magnitude(f'L_{i}_{j}', v.L_sign[self.modes][:, i, j])})"
            terms += self.columns.terms(f"E[{i}][{j}]", v.E[self.modes][:, i, j], magnitude, self.real)
        return terms


    def magnitude(self, name: str, signs: Array) -> str:
        """Print |name|; without a comparison where its sign is known in all modes."""
        if np.all(signs > 0):
            return name
        if np.all((signs == -1) | (signs == 2)):
            return f"-{name}"
        return f"({name} < {literal(0.0, self.real)}) ? -{name} : {name}"


def body(v: Varying, modes: Array, name: str) -> Straight:
    """Print the whole function for some modes."""
    spec, rows = v.spec, []
    p = Printer(v, modes)
    for i, note in enumerate(spec.rows):
        rows.append(Row(note, tuple(_row(p, i))))
    tables = p.columns.table(spec)
    prologue = (f"const {spec.names.real_type} *const k = table[{spec.index}];",) if tables else ()
    found = _locals(p)
    rows = [*([Row("parameters of this step, magnitudes of x and u", found)] if found else []), *rows]
    if spec.target_lo == f"{spec.state.operand}_lo":  # what is read must not be overwritten before the last row
        stores = [s for row in rows for s in row.statements if s.target.startswith("s->")]
        rows = [replace(row, statements=tuple(s for s in row.statements if s not in stores)) for row in rows]
        rows.append(Row("the new bounds, now that no row reads the old ones any more", tuple(stores)))
    text = [f"{s.target} {' '.join(s.lines)}" for row in rows for s in row.statements]
    texts = [line for s in found for line in s.lines]
    multiply, add = (int(n) for n in p.operations + [sum(t.count(" * ") for t in texts),
                                                     sum(t.count(" - ") + t.count(" + ") for t in texts)])
    return Straight(name, spec.equation, spec.parameters, unused(spec, [*text, *prologue]), tables, prologue,
                    tuple(rows), spec.tail, multiply, add, p.columns.flash(spec, multiply, add, len(modes)))


def _row(p: Printer, i: int) -> list[Statement]:
    """Coefficients, common part, radius and both bounds of row i."""
    spec = p.v.spec
    out, common = [], []
    for part in spec.common:
        for j in range(part.hi.shape[2]):
            if p.scheduled(part.name, i, j):
                out.append(p.coefficient(part.name, part.hi, i, j))
            common += p.entry(part.name, part.hi, i, j, f"{part.operand}[{j}]")
    for j in range(spec.state.hi.shape[2]):
        if p.scheduled(spec.state.name, i, j):
            out.append(p.coefficient(spec.state.name, spec.state.hi, i, j))
    if common:
        out.append(p.define(f"common_{i}", common))
    out += [p.coefficient(name, values, i, j) for name, values in (("R", p.v.R), ("S", p.v.S))
            for j in range(values.shape[2]) if p.scheduled(name, i, j)]
    apart = p.radius(i)
    if apart:
        out.append(p.define(f"apart_{i}", apart))
    offset, stores = spec.offset, []
    for side, sign in (("lo", "-"), ("hi", "+")):
        own = p.columns.terms(f"{offset.label(side)}[{i}]", offset.side(side)[p.modes][:, i], "", p.real)
        terms = [*([("+", f"common_{i}")] if common else []), *own, *p.state(i, side),
                 *([(sign, f"apart_{i}")] if apart else [])]
        out.append(p.define(f"{side}_{i}", terms or constant(0.0, p.real)))
        stores.append(Statement(f"{spec.target(side)}[{i}]", (f"{side}_{i}",)))
    return [*out, *stores]


def _locals(p: Printer) -> tuple[Statement, ...]:
    """Declare the parameters and magnitudes that the rows use."""
    real = p.v.spec.names.real_type
    lo, hi = f"{p.v.near}_lo", f"{p.v.near}_hi"
    texts = {f"th_{j}": text for j, text in enumerate(p.v.theta)}
    for i, (j, k) in enumerate(p.v.products, len(texts)):
        texts[f"th_{i}"] = f"th_{j} * th_{k}"
        p.used |= {f"th_{j}", f"th_{k}"} if f"th_{i}" in p.used else set()
    for i, (change, pace, top) in enumerate(p.v.paced):
        scale, most, zero = (literal(x, p.v.spec.names.real) for x in (pace, top, 0.0))
        texts |= {f"c_{i}": f"{scale} * ({change})", f"e_{i}": f"{most} - (c_{i} * c_{i})",
                  f"g_{i}": f"(e_{i} > {zero}) ? e_{i} : {zero}"}
        p.used |= {f"c_{i}", f"e_{i}"} if f"g_{i}" in p.used else set()
    for j, sign in enumerate(p.v.x_sign):
        texts[f"m_{j}"] = {1: f"{hi}[{j}]", -1: f"-{lo}[{j}]",
                           0: f"(-{lo}[{j}] > {hi}[{j}]) ? -{lo}[{j}] : {hi}[{j}]"}[int(sign)]
    texts |= {f"a_{j}": p.magnitude(f"{p.v.inputs}[{j}]", sign) for j, sign in enumerate(p.v.u_sign)}
    return tuple(Statement(f"const {real} {name}", (text,)) for name, text in texts.items() if name in p.used)
