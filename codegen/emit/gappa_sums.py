"""The sums of the C in Gappa's words: terms in evaluation order, and the ranges of what they read.

A coefficient that depends on theta stands in its sum as the sum that it is itself. Two things the C takes from
comparisons are variables of their own: max(-x_lo, x_hi) and |u|, which are exact, and |L_i_j|. Gappa knows no error of
a magnitude, so that of a computed coefficient and that of the exact one are two variables, not further apart than the
coefficients are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .maps import MapSpec
from .varying import Varying

SIDES = ("lo", "hi")


@dataclass(frozen=True)
class Magnitude:
    """|L_i_j| where it depends on theta: Gappa variable, row and column of L, and the terms of L_i_j."""

    name: str
    index: tuple[int, int]
    terms: tuple[str, ...]


@dataclass(frozen=True)
class Sum:
    """Terms of one row, the same with exact magnitudes, and these magnitudes."""

    terms: tuple[str, ...]
    exact: tuple[str, ...]
    magnitudes: tuple[Magnitude, ...] = ()


def row(spec: MapSpec | Varying, t, q: int, side: str, i: int) -> Sum:
    """Print the sum of one row without the measurement at its end; terms with coefficient zero change nothing."""
    if isinstance(spec, MapSpec):
        last = [variable(spec.plus, i)] if spec.plus else []
        terms = _join([*_affine(spec, {}, t, q, side, i, None), *last])
        return Sum(terms, terms)
    flipped = None if spec.flipped is None else spec.flipped[q, i]
    affine = _affine(spec.spec, spec.slopes, t, q, side, i, flipped)
    radius = _radius(spec, "R", spec.R, "m", t, q, i) + _radius(spec, "S", spec.S, "a", t, q, i)
    gains, found, exact = {p.name: p for p in spec.spec.common}, [], list(radius)
    for j, c in enumerate(spec.E[q, i]):
        if c != 0:
            value = coefficient(gains["L"].hi, spec.slopes["L"], t, q, i, j)
            found.append(Magnitude(f"L_{i}_{j}_mode_{q}", (i, j), value))
            radius.append(_product(c, f"size_{found[-1].name}"))
            exact.append(_product(c, f"exact_size_{found[-1].name}"))
    sign = "-" if side == "lo" else ""
    terms, same = (_join([*affine, *([f"{sign}({' '.join(_join(r))})"] if r else [])]) for r in (radius, exact))
    return Sum(terms, same, tuple(found))


def _radius(spec: Varying, name: str, values, local: str, t, q: int, i: int) -> list[str]:
    """Print the terms of R or S in row i: constants, or what the change of the parameters makes of them."""
    out = []
    for j, c in enumerate(values[q, i]):
        steps = spec.slopes[name][q, :, i, j] if name in spec.slopes else ()
        if np.any(steps):
            out.append(f"(({' '.join(coefficient(values, spec.slopes[name], t, q, i, j, 'g'))}) * {local}_{j})")
        elif c != 0:
            out.append(_product(c, f"{local}_{j}"))
    return out


def _affine(spec: MapSpec, slopes: dict, t, q: int, side: str, i: int, flipped) -> list[str]:
    """Print the terms of inputs, outputs, offset and state, in evaluation order."""
    def term(name: str, values, j: int, operand: str) -> list[str]:
        if name in slopes and np.any(slopes[name][q, :, i, j]):
            return [f"(({' '.join(coefficient(values, slopes[name], t, q, i, j))}) * {operand})"]
        return [_product(values[q, i, j], operand)] if values[q, i, j] != 0 else []

    terms: list[str] = []
    for part in spec.common:
        values = part.side("hi" if spec.shared else side)
        for j in range(values.shape[2]):
            terms += term(part.name, values, j, variable(part.operand, j))
    offset = float(spec.offset.side(side)[q, i])
    terms += [offset.hex()] if offset else []
    values = spec.state.side(side)
    for j, c in enumerate(values[q, i]):
        opposite = spec.by_sign and c < 0 if flipped is None else flipped[j]
        bound = SIDES[1 - SIDES.index(side)] if opposite else side
        terms += term(spec.state.name, values, j, variable(f"{spec.state.operand}{'_' * bool(bound)}{bound}", j))
    return terms


def coefficient(values, slopes, t, q: int, i: int, j: int, of: str = "th") -> tuple[str, ...]:
    """Print one entry as interpolated from the parameters ("th") or the factors "g", in evaluation order."""
    base = float(values[q, i, j])
    steps = [_product(c, parameter(t, q, p) if of == "th" else f"g_{p}")
             for p, c in enumerate(slopes[q, :, i, j]) if c != 0]
    return _join([*([base.hex()] if base else []), *steps])


def _join(terms: list[str]) -> tuple[str, ...]:
    """Print a sum. A subtraction of c v and an addition of -c v are one operation in IEEE 754 arithmetic."""
    return tuple(terms[:1] + [f"- {text[1:]}" if text[0] == "-" else f"+ {text}" for text in terms[1:]]) or ("0",)


def _product(coefficient: float, operand: str) -> str:
    """Print ``coefficient * operand``; the coefficients 1 and -1 need no multiplication."""
    value, sign = float(coefficient), "-" if coefficient < 0 else ""
    return sign + (operand if abs(value) == 1 else f"({abs(value).hex()} * {operand})")


def variable(operand: str, j: int) -> str:
    """Turn the C operand ``in->u`` and an index into a Gappa variable."""
    return f"{operand.replace('->', '_')}_{j}"


def parameter(t, q: int, j: int) -> str:
    """Name parameter j of the step: one variable for all modes with the same bounds; a product has one per mode."""
    if j >= t.vary.parameters:
        return f"th_{j}_mode_{q}"
    same = (t.vary.theta_lo[:, j] == t.vary.theta_lo[q, j]) & (t.vary.theta_hi[:, j] == t.vary.theta_hi[q, j])
    return f"th_{j}_mode_{int(np.argmax(same))}"


def operands(spec: MapSpec | Varying, t, state=None) -> Iterator[tuple[str, str, str]]:
    """Name every number that the sums of a map read but magnitudes of coefficients, with the ends of its range.

    The ranges are those behind the margins, which the Frama-C harness shows the state never to leave; zero is what
    init and reset store. ``state`` bounds the state's numbers where they are not those of x.
    """
    plain = spec.spec if isinstance(spec, Varying) else spec
    for operand in (*(part.operand for part in plain.common), *([plain.plus] if plain.plus else [])):
        vector = operand.split("->")[1]
        lo, hi = (getattr(t, f"{vector}_{side}").astype(float) for side in SIDES)
        for j, (a, b) in enumerate(zip(np.minimum(lo, 0.0), np.maximum(hi, 0.0))):
            yield variable(operand, j), a.hex(), b.hex()
    box = t.box.astype(float)
    if state is None:
        state = t.change.box if plain.state.operand == "s->z" else t.box
    for side in plain.sides:
        for j, b in enumerate(state.astype(float)):
            yield variable(f"{plain.state.operand}{'_' * bool(side)}{side}", j), (-b).hex(), b.hex()
    if isinstance(spec, Varying):
        yield from _operands_varying(spec, t, box)


def _operands_varying(spec: Varying, t, box) -> Iterator[tuple[str, str, str]]:
    # Framers of a state that left its range may have crossed: then max(-x_lo, x_hi) can be negative.
    yield from ((f"m_{j}", (-b).hex(), b.hex()) for j, b in enumerate(box) if np.any(spec.R[:, :, j])
               or np.any(spec.slopes.get("R", spec.R)[..., j]))
    reach = np.maximum(abs(t.u_lo), abs(t.u_hi)).astype(float)
    yield from ((f"a_{j}", 0.0.hex(), b.hex()) for j, b in enumerate(reach) if np.any(spec.S[:, :, j])
               or np.any(spec.slopes.get("S", spec.S)[..., j]))
    lo, hi = t.vary.theta_lo.astype(float), t.vary.theta_hi.astype(float)
    for j in range(len(spec.theta)):
        yield from ((parameter(t, q, j), lo[q, j].hex(), hi[q, j].hex()) for q in range(len(lo)))
        if t.vary.midpoint:
            yield from ((f"{s}_theta_{j}", lo[:, j].min().hex(), hi[:, j].max().hex()) for s in ("s", "in"))
    for q in range(len(lo)) if spec.products else ():
        ends = t.vary.corners(q).astype(t.dtype)
        for j in range(t.vary.parameters, ends.shape[1]):
            out = ((ends[:, j].min(), -1), (ends[:, j].max(), 1))
            a, b = (np.nextafter(x, s * np.inf, dtype=t.dtype) for x, s in out)
            yield parameter(t, q, j), float(a).hex(), float(b).hex()
    for i, (_, pace, top) in enumerate(spec.paced):
        yield f"g_{i}", 0.0.hex(), top.hex()
        reach = 1.0625 / pace  # beyond the reach g is not relied on
        yield f"change_{i}", (-reach).hex(), reach.hex()
