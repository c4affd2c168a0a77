"""Where the constants of a map with parameters and radii stand: base values, slopes and radii, read one by one.

Such a map computes its coefficients (``M_0_1 = base + slope * th_0``) and what moves both bounds apart
(``apart_0 = R * m_0 + S * a_0 + E * |L_0_0|``). Every local number is read as a sum of its own, the local operands
th, m and a must be what their names say, and a row may hold nothing else. A magnitude may be written without comparison
where the tables let the sign be only one.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from ..emit.maps import Linear
from ..emit.varying import Varying
from ..errors import CertificateError
from .c_reader import Source, apart
from .symbolic import NOWHERE, Affine, Machine, plain

SIDES = ("lo", "hi")


def read_varying(source: Source, v: Varying, t, q: int, mode: str, found) -> None:
    """Execute a map in one mode and compare everything that it is made of with the tables.

    Parameters
    ----------
    source : Source
    v : Varying
    t : FramerTables
        Of which ``v`` was made.
    q : int
    mode : str
        Its name.
    found : object
        Takes entries with ``add(name, mode, function, index, expected, coefficient)``.

    Raises
    ------
    CertificateError
        A constant differs, is missing, or is one too many.
    """
    spec = v.spec
    machine = Machine(source, spec.names.real, {"in->mode": q, "s->mode": q}, named=True,
                      skip=apart(spec.names.prefix))
    machine.call(spec.name)
    reader = _Reader(source, v, t, q, mode, found, machine)
    reader.operands()
    for side in SIDES:
        for i in range(len(spec.rows)):
            reader.row(side, i)
    reader.finish()


class _Reader:
    """One map in one mode; ``used`` are the locals that some row asked for."""

    def __init__(self, source: Source, v: Varying, t, q: int, mode: str, found, machine: Machine):
        self.source, self.v, self.t, self.q, self.mode, self.found = source, v, t, q, mode, found
        self.machine, self.defined, self.used = machine, machine.defined, set()

    def add(self, name: str, index: tuple[int, ...], expected, c) -> None:
        """Enter one number."""
        self.found.add(name, self.mode, self.v.spec.name, index, expected, c)

    def refuse(self, what: str):
        """Say what is not as the tables know it."""
        raise CertificateError(f"{self.source.name}: {self.v.spec.name} in mode {self.mode!r}: {what}, which the "
                               "tables do not know. Print it again.")

    def operands(self) -> None:
        """Check the parameters of the step and the magnitudes of state and input."""
        v, t, (lo, hi) = self.v, self.t, (f"{self.v.near}_{s}" for s in SIDES)
        allowed = {f"m_{j}": [{f"max(- {lo}[{j}], + {hi}[{j}])": 1}, *[{f"{hi}[{j}]": 1}] * bool(t.x_lo[j] >= 0),
                              *[{f"{lo}[{j}]": -1}] * bool(t.x_hi[j] <= 0)] for j in range(v.R.shape[2])}
        allowed |= {f"a_{j}": [{f"|+ {v.inputs}[{j}]|": 1}, *[{f"{v.inputs}[{j}]": 1}] * bool(t.u_lo[j] >= 0),
                               *[{f"{v.inputs}[{j}]": -1}] * bool(t.u_hi[j] <= 0)] for j in range(v.S.shape[2])}
        for j, text in enumerate(v.theta):
            _, mean, sum_of = text.rpartition(" * ")
            operand = f"+ {sum_of.strip('()')}" if mean else text
            allowed[f"th_{j}"] = [{operand: Fraction(1, 2) if mean else 1}]
            if mean and (c := self.defined.get(f"th_{j}", {}).get(operand)):
                self.add("theta_weight", (j,), 0.5, c)
        for i, (j, k) in enumerate(v.products, len(v.theta)):
            allowed[f"th_{i}"] = [{f"th_{j} * th_{k}": 1}]
            self.used |= {f"th_{j}", f"th_{k}"} & self.defined.keys()
        for i, (change, pace, top) in enumerate(v.paced):
            new, old = change.split(" - ")
            allowed |= {f"c_{i}": [{f"+ {new} - {old}": Fraction(pace)}],
                        f"e_{i}": [{"": Fraction(top), f"c_{i} * c_{i}": -1}], f"g_{i}": [{f"max(+ e_{i}, 0)": 1}]}
            for name, value, found in (("pace", pace, f"c_{i}"), ("top", top, f"e_{i}")):
                for c in self.defined.get(found, {}).values():
                    if c.literal and c.value == Fraction(value):
                        self.add(name, (i,), value, c)
        for name in self.defined.keys() & allowed.keys():
            self.used.add(name)
            if plain(self.defined[name]) not in allowed[name]:
                self.refuse(f"{name} is {self.text(name)}")

    def row(self, side: str, i: int) -> None:
        """Read one bound: common part, offset, state, radius."""
        spec = self.v.spec
        row = self.expand(self.machine.memory.get(f"{spec.target(side)}[{i}]", {}))
        common = self.part(row, f"common_{i}", 1)
        for part in spec.common:
            for j in range(part.side(side).shape[2]):
                self.entry(common, part, side, i, j, f"{part.operand}[{j}]")
        self.empty(common, f"common_{i}")
        self.add(spec.offset.label(side), (i,), spec.offset.side(side)[self.q, i], row.pop("", NOWHERE))
        own, other = (f"{spec.state.operand}_{s}" for s in (side, SIDES[side == "lo"]))
        for j, value in enumerate(spec.state.side(side)[self.q, i]):
            flipped = value < 0 if self.v.flipped is None else self.v.flipped[self.q, i, j]
            self.entry(row, spec.state, side, i, j, f"{other if flipped else own}[{j}]")
        self.radius(self.part(row, f"apart_{i}", 1 if side == "hi" else -1), i)
        self.empty(row, f"row {i}")

    def entry(self, row: Affine, part: Linear, side: str, i: int, j: int, operand: str) -> None:
        """Read one entry: a number, or a coefficient that is computed from the parameters."""
        slopes = self.v.slopes.get(part.name)
        local = self.part(row, f"{part.name}_{i}_{j}", 1, f" * {operand}")
        computed = f"{part.name}_{i}_{j}" in self.defined
        base = local.pop("", NOWHERE) if computed else row.pop(operand, NOWHERE)
        self.add(part.label(side), (i, j), part.side(side)[self.q, i, j], base)
        for p in range(0 if slopes is None else slopes.shape[1]):
            self.add(f"{part.name}_theta", (p, i, j), slopes[self.q, p, i, j], local.pop(f"th_{p}", NOWHERE))
        self.empty(local, f"{part.name}_{i}_{j}")

    def radius(self, apart: Affine, i: int) -> None:
        """Read what moves the bounds of row i apart."""
        v = self.v
        names = ("R", "S") if v.slopes else ("Ra", "Sa")
        for name, values, local in zip(names, (v.R, v.S), "ma"):
            slopes = v.slopes.get(name)
            for j in range(values.shape[2]):
                computed = self.part(apart, f"{name}_{i}_{j}", 1, f" * {local}_{j}")
                base = computed.pop("", NOWHERE) if f"{name}_{i}_{j}" in self.defined else apart.pop(
                    f"{local}_{j}", NOWHERE)
                self.add(name, (i, j), values[self.q, i, j], base)
                for p in range(0 if slopes is None else slopes.shape[1]):
                    self.add(f"{name}_pace", (p, i, j), slopes[self.q, p, i, j], computed.pop(f"g_{p}", NOWHERE))
                self.empty(computed, f"{name}_{i}_{j}")
        for j in range(v.E.shape[2]):
            lo, hi = self.gain_range(i, j)
            gain = f"L_{i}_{j}"
            if hi <= 0 and gain in apart:  # with the factor 1: no product
                apart[f"- {gain}"] = replace(apart[gain], value=-apart.pop(gain).value)
            allowed = [f"|+ {gain}|", *[gain] * (lo >= 0), *[f"- {gain}"] * (hi <= 0)]
            written = next((operand for operand in allowed if operand in apart), "")
            self.add("E", (i, j), v.E[self.q, i, j], apart.pop(written, NOWHERE))
        self.empty(apart, f"apart_{i}")

    def gain_range(self, i: int, j: int) -> tuple[Fraction, Fraction]:
        """Exact range of L(theta) in this mode."""
        lo = hi = Fraction(float(self.t.L_hi[self.q, i, j]))
        for p in range(self.t.vary.parameters):
            slope = Fraction(float(self.t.vary.L[self.q, p, i, j]))
            ends = [slope * Fraction(float(b[self.q, p])) for b in (self.t.vary.theta_lo, self.t.vary.theta_hi)]
            lo, hi = lo + min(ends), hi + max(ends)
        return lo, hi

    def part(self, row: Affine, name: str, sign: int, times: str = "") -> Affine:
        """Take a local (times an operand) out of a sum; return the sum that it stands for, empty without one."""
        if name not in self.defined:
            return {}
        self.used.add(name)
        c = row.pop(name + times, NOWHERE)
        if c.value != sign or c.literal:
            self.refuse(f"{float(c.value):g} times {name}{times}")
        return dict(self.defined[name])

    def expand(self, row: Affine) -> Affine:
        """A copy of the sum that a single local stands for."""
        while len(row) == 1 and plain(row).get(name := next(iter(row))) == 1 and name in self.defined:
            self.used.add(name)
            row = self.defined[name]
        return dict(row)

    def text(self, name: str) -> str:
        """The sum that a local stands for."""
        return " + ".join(f"{float(c):g} {operand}" for operand, c in plain(self.defined[name]).items()) or "0"

    def empty(self, row: Affine, where: str) -> None:
        """Refuse what is left."""
        if extra := plain(row):
            self.refuse(f"{where} has a term with {', '.join(extra)}")

    def finish(self) -> None:
        """Refuse locals that no row asked for."""
        if extra := self.defined.keys() - self.used:
            self.refuse(f"{', '.join(sorted(extra))} is in no row")
