"""The Gappa script of a design: every sum that the C rounds, and the room that its offset leaves for it.

``certify`` finds the rounding of a sum by a formula of its own, moves the offset outward by it and forgets it.
Here the margin is taken back from the finished tables: what of the offset is left once disturbance, noise and
the rounding of constants and inputs have had their part. Gappa must prove, from the sums alone, that no
rounding is larger. Of a point observer, whose set holds all roundings together, the margin of a sum is what the set
is given for it; of a filter or of boxes, what thresholds or tables hold.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..certify.containment import Containment, offset
from ..certify.exact import Q, down, up
from ..certify.filter_model import rounding_of
from ..certify.rounding import input_error
from ..certify.sets import SetDemands
from ..certify.variation import pace_rounding
from . import (
    driven_parts,
    families,
    filter_parts,
    gappa_boxes,
    gappa_pairs,
    gappa_polytopic,
    gappa_sums,
    guided_parts,
    point_parts,
    trailing_parts,
)
from .gappa_sums import SIDES, Magnitude, Sum
from .maps import MapSpec, Names
from .varying import Varying
from .view import DesignView

FORMAT = {"float32": "ieee_32", "float64": "ieee_64"}
ABOUT = ("operation rounded and once exact. What they may differ by is the margin: the part of the row's offset that",
         "disturbance, noise and the rounding of constants and inputs leave over. All layouts calculate these sums: a")
ABOUT_POINTS = ("operation rounded and once exact. What they may differ by is the margin: what the set of errors gets",
                "for the rounding of this sum, in every step. All layouts calculate these sums: a")
ABOUT_FILTERS = ("operation rounded and once exact. What they may differ by is the margin: what the thresholds hold",
                 "for the rounding of this sum, at every sample. All layouts calculate these sums: a")
ABOUT_BOXES = ("operation rounded and once exact. What they may differ by is the margin: what the boxes gain for the",
               "rounding of this sum, in every period. All layouts calculate these sums: a")
ABOUT_PAIRS = ("operation rounded and once exact. What they may differ by is the margin: what offsets and bounds of",
               "the noise hold for the rounding of this sum, at every sample. All layouts calculate these sums: a")
ABOUT_POLYTOPIC = ("operation rounded and once exact. What they may differ by is the margin: what the thresholds hold",
                   "for the rounding of this sum, weights being numbers in [0, 1]. All layouts calculate these sums: a")
ABOUT_DRIVEN = ("operation rounded and once exact. What they may differ by is the margin: of the framers what their",
                "offsets leave over, of the boxes what they gain for the rounding of this sum. All layouts calculate",
                "these sums: a")
ABOUT_FOLLOWER = ("operation rounded and once exact. What they may differ by is the margin: of the estimate what the",
                  "set of errors gets, of the boxes what they gain for the rounding of this sum. All layouts calculate",
                  "these sums: a")
ABOUT_TRAILING = ("operation rounded and once exact. What they may differ by is the margin: of filters what thresholds",
                  "hold, of the boxes what they gain for the rounding of this sum. All layouts calculate these sums: a")
ABOUT_GUIDED = ("operation rounded and once exact. What they may differ by is the margin: of the framers what their",
                "offsets leave over, of the pairs what offsets and bounds of the noise hold for the rounding of this",
                "sum, while the decision is right. All layouts calculate these sums: a")
ABOUT_GUIDED_POINT = (
    "operation rounded and once exact. What they may differ by is the margin: of the estimate what the set of errors",
    "gets, of the pairs what offsets and bounds of the noise hold for the rounding of this sum, while the decision is",
    "right. All layouts calculate these sums: a")
ABOUT_GUIDED_FILTER = (
    "operation rounded and once exact. What they may differ by is the margin: of filters what thresholds hold, of the",
    "pairs what offsets and bounds of the noise hold for the rounding of this sum, while the decision is right. All",
    "layouts calculate these sums: a")
OWN = r"\bm_(?=\d)"  # max(-x_lo, x_hi) of framers; boxes have one, too
LAST = "Last in a residual the measurement is subtracted: that keeps the sign, which is what an alarm looks at."
LAST_POINTS = "A comparison with a bound looks at the sign of a difference, which rounding keeps."


@dataclass(frozen=True)
class Row:
    """A sum of the C: Gappa name, what it is, its terms in evaluation order, the margin in hex and in decimal.

    ``exact`` are the same terms, with the exact magnitudes.
    """

    name: str
    note: str
    terms: tuple[str, ...]
    exact: tuple[str, ...]
    margin: str
    about: str


@dataclass(frozen=True)
class Operand:
    """A number that sums read: Gappa variable and the ends of its range, in hex."""

    name: str
    least: str
    most: str


@dataclass(frozen=True)
class Computed:
    """Magnitude of a computed coefficient: its name, the row that states the coefficient, and ranges in hex.

    ``most`` and ``exact_most`` bound the computed and the exact magnitude, ``slip`` what they may differ by: the
    margin of that row, as ``||a| - |b|| <= |a - b|``.
    """

    name: str
    row: str
    most: str
    exact_most: str
    slip: str


@dataclass(frozen=True)
class RoundingView:
    """Everything that ``rounding_<prefix>.g`` has and the observer's own view has not.

    ``largest`` is the largest number of the type, ``about`` says what the margins are and ``last`` what the sign of a
    difference is for.
    """

    format: str
    operands: tuple[Operand, ...]
    magnitudes: tuple[Computed, ...]
    rows: tuple[Row, ...]
    largest: str
    about: tuple[str, ...]
    last: str


def rounding(design, d: DesignView) -> RoundingView:
    """State the rounding of every row of every map, for every mode and both framers.

    Parameters
    ----------
    design : Design
    d : DesignView

    Returns
    -------
    view : RoundingView
        A row that is the same in several modes appears once. The maps of a mode that is told late are no rows of
        their own: they are the same sums.
    """
    t = design.observer.tables[d.real]
    names = Names(d.prefix, d.macro, d.real, tuple(m.name for m in d.modes), tuple(m.macro for m in d.modes))
    if d.sets:
        if d.family in ("polytopic", "descriptor"):
            return _of_polytopic(design.plant, t, d)
        if d.family == "driven":
            return _of_driven(design.plant, t, names, d)
        if d.family == "guided":
            return _of_guided(design.plant, t, names, d)
        if d.family == "guided_point":
            return _of_guided_point(design.plant, t, names, d)
        if d.family == "guided_filter":
            return _of_guided_filter(design.plant, t, names, d)
        if d.family == "follower":
            return _of_follower(design.plant, t, names, d)
        if d.family == "trailing":
            return _of_trailing(design.plant, t, names, d)
        about = _of_points if hasattr(t, "shape") else {"filter": _of_filter, "mode": _of_boxes,
                                                        "sliding": _of_pairs}[d.family]
        modes = (design.plant if d.family in ("mode", "sliding") else design.plant.enclosed.observed).modes
        return about(modes, t, names, d)
    specs = (*families.specs(design.observer.family, t, names, d.x, d.y), *families.change_specs(t, names, d.x))
    rows, computed = _of_framers(design.plant.observed.modes, t, names, specs)
    operands = dict.fromkeys(operand for spec in specs for operand in gappa_sums.operands(spec, t))
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in operands), computed, rows,
                        float(np.finfo(t.dtype).max).hex(), ABOUT, LAST)


def _of_framers(modes, t, names: Names, specs) -> tuple[tuple[Row, ...], tuple[Computed, ...]]:
    """State the sums of framers; the margin of each is what its offset leaves."""
    exact = Containment(modes, t)
    margins, rows, magnitudes = _margins(exact), [], {}
    for spec in specs:
        plain = spec.spec if isinstance(spec, Varying) else spec
        for side, i in itertools.product(SIDES, range(len(plain.rows))):
            sums = [gappa_sums.row(spec, t, q, side, i) for q in range(len(names.modes))]
            rows += _rows(plain, side, i, sums, margins)
            magnitudes |= {m: q for q, found in enumerate(sums) for m in found.magnitudes}
    computed = [_coefficient(exact, names, m, q) for m, q in magnitudes.items()]
    return (*rows, *(row for _, row in computed), *_parameters(names.prefix, t)), tuple(c for c, _ in computed)


def _of_points(modes, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of an estimate and its residual; the margin of each is what the set is given for its rounding."""
    specs, demands, rows = point_parts.maps(t, names, d.x, d.y), SetDemands(modes, t), []
    for spec, which in zip(specs, ("residual", "forward", "blind")):
        rounded = [demands.rounding(q, which) for q in range(len(names.modes))]
        margins = {(spec.offset.name, q, ""): [down(x) for x in row] for q, row in enumerate(rounded)}
        for i in range(len(spec.rows)):
            rows += _rows(spec, "", i, [gappa_sums.row(spec, t, q, "", i) for q in range(len(names.modes))], margins)
    operands = dict.fromkeys(operand for spec in specs for operand in gappa_sums.operands(spec, t))
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in operands), (), tuple(rows),
                        float(np.finfo(t.dtype).max).hex(), ABOUT_POINTS, LAST_POINTS)


def _of_filter(modes, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of a filter; the margin of each is what its thresholds hold for the rounding."""
    return _of_sums(t, names, filter_parts.maps(t, names, next(z.faults for z in d.sets)))


def _of_sums(t, names: Names, specs: tuple[MapSpec, ...]) -> RoundingView:
    """State estimate and step of filters, the tables of which are ``t``."""
    rows: list[Row] = []
    for spec, which in zip(specs, ("estimate", "forward")):
        margins = {(spec.offset.name, q, ""): [down(x) for x in rounding_of(t, which, q)]
                   for q in range(len(names.modes))}
        for i in range(len(spec.rows)):
            rows += _rows(spec, "", i, [gappa_sums.row(spec, t, q, "", i) for q in range(len(names.modes))], margins)
    operands = dict.fromkeys(operand for spec in specs for operand in gappa_sums.operands(spec, t, t.limit))
    return RoundingView(FORMAT[t.real], tuple(Operand(*o) for o in operands), (), tuple(rows),
                        float(np.finfo(t.dtype).max).hex(), ABOUT_FILTERS, LAST_POINTS)


def _of_boxes(modes, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of a mode estimator; the margin of each is what its tables hold for the rounding."""
    rows = tuple(_row(s.name, s.note, s.terms, s.margin) for s in gappa_boxes.sums(modes, t, names.prefix))
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in gappa_boxes.operands(t)), (), rows,
                        float(np.finfo(t.dtype).max).hex(), ABOUT_BOXES, LAST_POINTS)


def _of_pairs(modes, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of an estimator by sliding modes; the margin of each is what its offsets hold for the rounding."""
    rows = tuple(_row(s.name, s.note, s.terms, s.margin) for s in gappa_pairs.sums(modes, t, names.prefix))
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in gappa_pairs.operands(t)), (), rows,
                        float(np.finfo(t.dtype).max).hex(), ABOUT_PAIRS, LAST_POINTS)


def _of_polytopic(plant, t, d: DesignView) -> RoundingView:
    """State the sums of a polytopic observer; the margin of each is what its thresholds hold for the rounding."""
    sums, operands = gappa_polytopic.stated(plant, t, d.prefix)
    rows = tuple(_row(s.name, s.note, s.terms, s.margin) for s in sums)
    return RoundingView(FORMAT[d.real], tuple(Operand(*o) for o in operands), (), rows,
                        float(np.finfo(t.dtype).max).hex(), ABOUT_POLYTOPIC, LAST_POINTS)


def _of_driven(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the estimator, of the framers of every mode, and of S x."""
    specs = driven_parts.maps(t.told, names, d.x, d.y)
    rows, computed = _of_framers(plant.observed.modes, t.told, names, specs)
    boxes = itertools.chain(gappa_boxes.sums(plant.modes, t, names.prefix), gappa_boxes.narrowed(t, names.prefix))
    rows = (*(_row(s.name, s.note, s.terms, s.margin) for s in boxes), *(_own_magnitudes(row) for row in rows))
    operands = {name: ends for name, *ends in gappa_boxes.operands(t)}
    for name, *ends in (operand for spec in specs for operand in gappa_sums.operands(spec, t.told)):
        operands.setdefault(re.sub(OWN, r"frame_\g<0>", name), ends)  # what is accepted, is by both
    return RoundingView(FORMAT[d.real], tuple(Operand(name, *ends) for name, ends in operands.items()), computed, rows,
                        float(np.finfo(t.dtype).max).hex(), ABOUT_DRIVEN, LAST_POINTS)


def _of_guided(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the pairs, and of the framers in every mode."""
    pairs = _of_pairs(plant.modes, t, names, d)
    specs = guided_parts.maps(t.told, guided_parts.inner_names(names), d.x, d.y)
    rows, computed = _of_framers(plant.observed.modes, t.told, replace(names, prefix=f"{names.prefix}_told"), specs)
    operands = {o.name: o for o in pairs.operands}
    for operand in (Operand(*o) for spec in specs for o in gappa_sums.operands(spec, t.told)):
        operands.setdefault(operand.name, operand)  # what is accepted, is by both
    return replace(pairs, operands=tuple(operands.values()), magnitudes=computed, rows=(*pairs.rows, *rows),
                   about=ABOUT_GUIDED)


def _of_guided_point(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the pairs, and of the estimate in every mode."""
    pairs = _of_pairs(plant.modes, t, names, d)
    told = _of_points(plant.enclosed.modes, t.told, replace(names, prefix=f"{names.prefix}_told"), d)
    operands = {o.name: o for o in (*told.operands, *pairs.operands)}  # what is accepted, is by both
    return replace(told, operands=tuple(operands.values()), rows=(*pairs.rows, *told.rows), about=ABOUT_GUIDED_POINT)


def _of_guided_filter(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the pairs, and of the filter of every mode; where one starts is a table."""
    pairs = _of_pairs(plant.modes, t, names, d)
    told = _of_sums(t.told, names, trailing_parts.maps(t.told, names, next(z.faults for z in d.sets)))
    operands = {o.name: o for o in (*told.operands, *pairs.operands)}  # what is accepted, is by both
    return replace(told, operands=tuple(operands.values()), rows=(*pairs.rows, *told.rows), about=ABOUT_GUIDED_FILTER)


def _of_follower(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the estimator, of the estimate in every mode, and of S x of its bounds."""
    told = _of_points(plant.enclosed.modes, t.told, replace(names, prefix=f"{names.prefix}_told"), d)
    boxes = itertools.chain(gappa_boxes.sums(plant.modes, t, names.prefix),
                            gappa_boxes.narrowed(t, names.prefix, "s_told", "the estimate's bounds"))
    operands = {name: Operand(name, *ends) for name, *ends in gappa_boxes.operands(t)}
    operands = {o.name: o for o in told.operands} | operands  # what is accepted, is by both
    bounds = tuple(Operand(f"s_told_{side}_{k}", (-b).hex(), b.hex())
                   for k, b in enumerate(t.told.box.astype(float)) for side in SIDES)
    rows = (*(_row(s.name, s.note, s.terms, s.margin) for s in boxes), *told.rows)
    return replace(told, operands=(*operands.values(), *bounds), rows=rows, about=ABOUT_FOLLOWER)


def _of_trailing(plant, t, names: Names, d: DesignView) -> RoundingView:
    """State the sums of the estimator, of the filter of every mode, and of its start."""
    told = _of_sums(t.told, names, trailing_parts.maps(t.told, names, next(z.faults for z in d.sets)))
    boxes = itertools.chain(gappa_boxes.sums(plant.modes, t, names.prefix), gappa_boxes.begun(
        t.told, names.prefix, names.modes))
    operands = {name: Operand(name, *ends) for name, *ends in gappa_boxes.operands(t)}
    operands = {o.name: o for o in told.operands} | operands  # what is accepted, is by both
    centre = tuple(Operand(f"centre_{k}", float(lo).hex(), float(hi).hex()) for k, (lo, hi) in enumerate(zip(
        t.told.x_lo, t.told.x_hi)))
    rows = (*(_row(s.name, s.note, s.terms, s.margin) for s in boxes), *told.rows)
    return replace(told, operands=(*operands.values(), *centre), rows=rows, about=ABOUT_TRAILING)


def _own_magnitudes(row: Row) -> Row:
    """Call the magnitudes of framers otherwise than those of boxes."""
    terms, exact = (tuple(re.sub(OWN, r"frame_\g<0>", text) for text in part) for part in (row.terms, row.exact))
    return replace(row, terms=terms, exact=exact)


def _margins(exact: Containment) -> dict[tuple[str, int, str], list[float]]:
    """What each offset leaves for rounding, rounded down to a double: (name, mode, side) -> one per row."""
    found = {}
    for name, q, side, demands in exact.offsets():
        offsets = offset(exact.t, name, side)[q]
        outward = [Q(o) if side == "hi" else -Q(o) for o in offsets]
        found[name, q, side] = [down(o - (demand.need - demand.computed)) for o, demand in zip(outward, demands)]
    return found


def _rows(spec: MapSpec, side: str, i: int, sums: list[Sum], margins: dict) -> Iterator[Row]:
    """Give one row of a map, once per group of modes that have the same sum and margin."""
    groups: dict[tuple, list[int]] = {}
    for q, found in enumerate(sums):
        groups.setdefault((found, float(margins[spec.offset.name, q, side][i])), []).append(q)
    for (found, margin), modes in groups.items():
        which = " and ".join(f'"{spec.names.modes[q]}"' for q in modes)
        yield _row("_".join([spec.name, *([side] if side else []), f"{i}_mode_{modes[0]}"]),
                   ", ".join([spec.rows[i], *([side] if side else []), f"mode {which}"]), found.terms, margin,
                   found.exact)


def _row(name: str, note: str, terms: tuple[str, ...], margin: float, exact: tuple[str, ...] | None = None) -> Row:
    return Row(name, note, terms, terms if exact is None else exact, margin.hex(), f"{margin:.4g}")


def _coefficient(exact: Containment, names: Names, m: Magnitude, q: int) -> tuple[Computed, Row]:
    """State a computed coefficient whose magnitude is used: its own sum, with the error that the offsets hold."""
    L, (i, j) = exact.scheduled(q, "hi").L, m.index
    most, slip = L.most()[i, j], down(L.rounding(names.real)[i, j])
    row = _row(f"{names.prefix}_{m.name}", f'L[{i}][{j}], mode "{names.modes[q]}"', m.terms, slip)
    return Computed(m.name, row.name, up(most + Q(slip)).hex(), up(most).hex(), slip.hex()), row


def _parameters(prefix: str, t) -> list[Row]:
    """State the mean of each parameter at both ends of a step: what the caller's two roundings leave of three."""
    if t.vary is None or not t.vary.midpoint:
        return []
    most = np.maximum(abs(t.vary.theta_lo), abs(t.vary.theta_hi)).max(axis=0)
    means = [_row(f"{prefix}_theta_{j}", f"theta[{j}], mean of both ends of a step",
                  (f"({0.5.hex()} * (s_theta_{j} + in_theta_{j}))",), down(2 * input_error(Q(m), t.real)))
             for j, m in enumerate(most)]
    products = [_row(f"{prefix}_theta_{i}", f"theta[{j}] theta[{k}]",
                     (f"(in_theta_{j} * in_theta_{k})",), down(input_error(Q(most[j]) * Q(most[k]), t.real)))
                for i, (j, k) in enumerate(t.vary.products, len(most))]
    paced = [_row(f"{prefix}_g_{i}", f"least factor for a change of theta[{j}], without its own rounding",
                  (f"({top.hex()} - ((change_{i} * {pace.hex()}) * (change_{i} * {pace.hex()})))",),
                  down(pace_rounding(Q(1.0625), t.real)))
             for i, (j, pace, top) in enumerate(zip(t.vary.paced, t.vary.pace.astype(float).tolist(),
                                                    t.vary.top.astype(float).tolist()))] if t.vary.paced else []
    return [*means, *products, *paced]
