"""What the templates print: frozen views of a design, every decision taken, every number a string.

A template has no conditions. What a design may or may not have (inputs, a dwell monitor, a debounce
window) is therefore a tuple here, empty where the design does without.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import EmitError
from ..observers import (
    BankTables,
    DescriptorTables,
    DrivenTables,
    FilterTables,
    FollowerTables,
    GuidedFilterTables,
    GuidedPointTables,
    GuidedTables,
    ModeTables,
    PointTables,
    PolytopicTables,
    SlidingTables,
    TrailingTables,
)
from . import (
    bank_parts,
    descriptor_parts,
    driven_parts,
    families,
    filter_parts,
    follower_parts,
    framer_parts,
    guided_filter_parts,
    guided_parts,
    guided_point_parts,
    manual,
    mode_parts,
    point_parts,
    polytopic_parts,
    sliding_parts,
    trailing_parts,
)
from .cprint import C_TYPE, check_prefix, comment, initialiser, literal, macro_names
from .layouts import LAYOUTS
from .manual import Bit, Channel, Manual
from .maps import MapView, Names, Table
from .parts import Cut, Field, Late, Move, Operations, Parts, vector_table

Array = np.ndarray


@dataclass(frozen=True)
class RangeCheck:
    """A function that accepts a vector within its ranges: one expression (tables by mode in it), or a loop."""

    name: str
    vector: str
    what: str
    expressions: tuple[tuple[str, ...], ...]
    tables: tuple[Table, ...]
    counts: tuple[str, ...]
    by_mode: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Window:
    """Debounce over more than one sample: mask of the history, and what makes an alarm of it."""

    mask: str
    alarm: str
    votes: tuple[str, ...]


@dataclass(frozen=True)
class Dwell:
    """The leaky bucket's constants."""

    add: str
    drain: str
    limit: str


@dataclass(frozen=True)
class Guards:
    """What the preprocessor must find for the arithmetic to be the certified one."""

    mantissa: str
    digits: int


@dataclass(frozen=True)
class DesignView:
    """Everything the C of one design needs. ``x``, ``u``, ``y``, ``theta``, ``modes``, ``bits`` are its channels.

    ``sets`` holds the error set of a point observer, the tables of a filter, or nothing. ``skeleton`` is the template
    that a point observer's extends, ``alone`` has an entry where that is a file of its own.
    """

    prefix: str
    macro: str
    real: str
    c_type: str
    layout: str
    family: str
    version: str
    zero: str
    guards: Guards
    manual: Manual
    initial_box: tuple[str, ...]
    x: tuple[Channel, ...]
    u: tuple[Channel, ...]
    y: tuple[Channel, ...]
    theta: tuple[Channel, ...]
    input_groups: tuple[tuple[Channel, ...], ...]
    parameter_groups: tuple[tuple[Channel, ...], ...]
    modes: tuple[Channel, ...]
    bits: tuple[Bit, ...]
    in_fields: tuple[Field, ...]
    out_fields: tuple[Field, ...]
    state_fields: tuple[Field, ...]
    state_bytes: int
    operations: Operations
    maps: tuple[MapView, ...]
    checks: tuple[RangeCheck, ...]
    check_input: tuple[str, ...]
    check_parameters: tuple[str, ...]
    cuts: tuple[Cut, ...]
    start: tuple[str, ...]
    whole_range: tuple[str, ...]
    clear: tuple[str, ...]
    crossed: tuple[str, ...]
    windows: tuple[Window, ...]
    plain: tuple[str, ...]
    latch: str
    recover: int
    hold: tuple[str, ...]
    dwell: tuple[Dwell, ...]
    remember: tuple[str, ...]
    assured: str
    assured_blind: str
    late: tuple[Late, ...]
    move: Move
    last_items: tuple[str, ...]
    last_status: str
    last_refusal: str
    noun: str
    header: str
    self_test: str
    sets: tuple[object, ...]
    lengths: tuple[tuple[str, int], ...]
    skeleton: str = "observer.c.jinja"
    alone: tuple[str, ...] = ("",)


def build(design, real: str | None = None, layout: str | None = None, version: str = "") -> DesignView:
    """Decide everything about the C of a design.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}, optional
        Default: the plant file's.
    layout : {"literal", "table", "loop"}, optional
        Default: the plant file's.
    version : str
        Of the generator, for the banner.

    Returns
    -------
    view : DesignView

    Raises
    ------
    EmitError
        Unknown real or layout, a prefix that C refuses, a table with NaN, infinity or numbers that are not
        of type ``real``, more than 32 alarm bits, a dwell bucket beyond 32 bits.
    """
    plant, target, s = design.plant, design.plant.target, design.observer.supervision
    real, layout = real or target.real, layout or target.layout
    _check_choice("real", real, design.observer.tables)
    _check_choice("layout", layout, LAYOUTS)
    t = design.observer.tables[real]
    modes = [m.name for m in plant.modes] or ["the plant"]  # a polytopic plant has none
    names = Names(check_prefix(target.prefix), target.prefix.upper(), real, tuple(comment(m) for m in modes),
                  tuple(f"{target.prefix.upper()}_MODE_{n}" for n in macro_names(modes)))
    x = manual.channels(plant.estimated(len(t.x_lo)), t.x_lo, t.x_hi, real, "x")
    u = manual.channels(plant.u, t.u_lo, t.u_hi, real, "u")
    theta = parameters(plant, t, real)
    y = manual.channels(plant.y, t.y_lo, t.y_hi, real, "y")
    own = _parts(design, t, s, names, (x, u, y, theta), layout)
    bits = own.bits
    _check_words(s, len(bits))
    checks = tuple(_range_check(names, vector, lo, hi, layout)
                   for vector, lo, hi in (("u", t.u_lo, t.u_hi), ("y", t.y_lo, t.y_hi)) if len(lo))
    checks += (_parameter_check(names, t.vary.theta_lo, t.vary.theta_hi),) if theta else ()
    fields = own.state
    text = Manual(manual.banner(design, target.prefix, real, layout, version), manual.about(plant),
                  manual.proved(design, real), manual.assumed(design, t, s.monitors_dwell),
                  manual.alarm(s, target.prefix, own.noun, any(b.macro == "NO_MODE" for b in bits)), manual.dwell(s),
                  _resources(fields.size, own.operations))
    quiet = [*["(s->hold == 0U)"] * s.counts_hold, *["(s->latched == 0U)"] * s.latch,
             *["(s->too_fast == 0U)"] * s.monitors_dwell]
    modes = tuple(Channel(i, macro, name, "") for i, (macro, name) in enumerate(zip(names.mode_macros, names.modes)))
    return DesignView(
        prefix=names.prefix, macro=names.macro, real=real, c_type=C_TYPE[real], layout=layout,
        family=design.observer.family, version=version, zero=literal(0.0, real),
        guards=Guards(*(("FLT_MANT_DIG", 24) if real == "float32" else ("DBL_MANT_DIG", 53))), manual=text,
        initial_box=manual.initial_box(x, t, real), x=x, u=u, y=y, theta=theta,
        input_groups=(u,) if u else (), parameter_groups=(theta,) if theta else (), modes=modes, bits=bits,
        in_fields=tuple(Field(*f) for f in families.in_fields(names, len(u), len(theta), own.told)),
        out_fields=own.out_fields, state_fields=tuple(Field(*f) for f in fields.members),
        state_bytes=fields.size, operations=own.operations, maps=own.maps, checks=checks,
        check_input=tuple(c.name for c in checks if c.vector == "u"),
        check_parameters=tuple(c.name for c in checks if c.vector == "theta"), cuts=own.cuts,
        start=own.start, whole_range=own.whole_range, clear=fields.clear, crossed=own.crossed,
        windows=_windows(s, names.prefix),
        plain=("alarm",) if s.debounce[1] == 1 else (), latch="s->latched | alarm" if s.latch else "alarm",
        recover=max(s.recover, 1), hold=(f"{s.hold}U",) if s.counts_hold else (),
        dwell=(Dwell(f"{s.dwell_add}U", f"{s.dwell_drain}U", f"{s.dwell_limit}U"),) if s.monitors_dwell else (),
        remember=("s->mode = in->mode;",) if fields.has_mode else (),
        assured=_truth(["(!fault)", *quiet]) if s.assures else "0U",
        assured_blind=_truth(quiet) if s.assures else "0U",
        late=own.late, move=own.move,
        last_items=_last_items(names, bool(theta)),
        last_status=f"{names.macro}_BAD_{'PARAMETER' if theta else 'OUTPUT'}",
        last_refusal=f"{names.macro}_BAD_{'PARAMETER' if theta else 'INPUT'}", noun=own.noun, header=own.header,
        self_test=own.self_test, sets=own.sets, lengths=own.lengths)


def _parts(design, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """What is the family's own."""
    if isinstance(t, FilterTables | TrailingTables | GuidedFilterTables):
        faults = manual.channels(design.plant.f, *(side.astype(t.dtype) for side in design.plant.limits("f")), t.real,
                                 "f_hat")
        make = (filter_parts if isinstance(t, FilterTables) else guided_filter_parts
                if isinstance(t, GuidedFilterTables) else trailing_parts).parts
        return make(t, s, names, signals, layout, faults)
    if isinstance(t, BankTables):
        return bank_parts.parts(t, s, names, signals, tuple(f.name for f in design.plant.f))
    if isinstance(t, DescriptorTables):
        return descriptor_parts.parts(t, s, names, signals)
    if isinstance(t, PolytopicTables):
        return polytopic_parts.parts(t, s, names, signals)
    make = (driven_parts.parts if isinstance(t, DrivenTables) else
            follower_parts.parts if isinstance(t, FollowerTables) else
            mode_parts.parts if isinstance(t, ModeTables) else
            guided_parts.parts if isinstance(t, GuidedTables) else
            guided_point_parts.parts if isinstance(t, GuidedPointTables) else
            sliding_parts.parts if isinstance(t, SlidingTables) else
            point_parts.parts if isinstance(t, PointTables) else framer_parts.parts)
    return make(design.observer.family, t, s, names, signals, layout)


def _last_items(names: Names, parameters: bool) -> tuple[str, ...]:
    """Print the end of the status enumeration."""
    if not parameters:
        return (f"{names.macro}_BAD_OUTPUT = 3",)
    return (f"{names.macro}_BAD_OUTPUT = 3,",
            f"/* A parameter is NaN or beyond its bounds (of its mode, if these differ): call {names.prefix}_reset. */",
            f"{names.macro}_BAD_PARAMETER = 4")


def _truth(conditions: list[str]) -> str:
    """Print the conjunction as 0 or 1; 1 where there is no condition."""
    return f"({' && '.join(conditions)}) ? 1U : 0U" if len(conditions) > 1 else (
        f"{conditions[0]} ? 1U : 0U" if conditions else "1U")


def _check_choice(what: str, value: str, known) -> None:
    if value not in known:
        raise EmitError(f"{what}: {value!r} is unknown (expected {' or '.join(known)}). Choose one of these.")


def _check_words(s, n_bits: int) -> None:
    """Refuse what does not fit the 32-bit words of the supervisor."""
    if n_bits > 32:
        raise EmitError(f"alarm: {n_bits} bits (expected at most 32: one per output, one if the framers' gains "
                        "differ). Split the outputs over two observers.")
    if s.dwell_limit + s.dwell_add >= 2**32 or not 1 <= s.debounce[0] <= s.debounce[1] <= 32:
        raise EmitError(f"supervision: dwell bucket {s.dwell_limit} + {s.dwell_add} or debounce {s.debounce} does not "
                        "fit 32-bit words. Make the design again.")


def _range_check(names: Names, vector: str, lo: Array, hi: Array, layout: str) -> RangeCheck:
    """Accept a vector in its ranges; NaN fails every comparison, so it is refused as well."""
    what = "The inputs are numbers within their ranges." if vector == "u" else (
        "The measurements are numbers within their ranges.")
    name, count = f"{names.prefix}_{vector}_accepted", f"{names.macro}_N{vector.upper()}"
    if layout == "loop":
        tables = (vector_table("least", count, lo, names.real), vector_table("most", count, hi, names.real))
        return RangeCheck(name, vector, what, (), tables, (count,))
    lines = tuple(f"(in->{vector}[{i}] >= {literal(a, names.real)}) && (in->{vector}[{i}] <= {literal(b, names.real)})"
                  for i, (a, b) in enumerate(zip(lo, hi)))
    return RangeCheck(name, vector, what, (lines,), (), ())


def parameters(plant, t, real: str) -> tuple[Channel, ...]:
    """Describe the measured parameters, with the hull of their bounds over the modes."""
    if t.vary is None:
        return ()
    signals = [s for s in plant.theta if s.measured]
    return manual.channels(signals, t.vary.theta_lo.min(axis=0), t.vary.theta_hi.max(axis=0), real, "theta")


def _parameter_check(names: Names, lo: Array, hi: Array) -> RangeCheck:
    """Accept the parameters within the bounds of the mode in in->mode."""
    what, name = "The parameters are numbers within their bounds in this mode.", f"{names.prefix}_theta_accepted"
    if np.all(lo == lo[0]) and np.all(hi == hi[0]):
        what = "The parameters are numbers within their bounds."
        lines = tuple(f"(in->theta[{j}] >= {literal(a, names.real)}) && (in->theta[{j}] <= {literal(b, names.real)})"
                      for j, (a, b) in enumerate(zip(lo[0], hi[0])))
        return RangeCheck(name, "theta", what, (lines,), (), (), ())
    size = f"[{names.macro}_MODES][{names.macro}_NTHETA]"
    apart = {label: np.any(values != values[0]) for label, values in (("least", lo), ("most", hi))}
    tables = tuple(Table(label, size, (), tuple(f"{initialiser(row, names.real)}," for row in values))
                   for label, values in (("least", lo), ("most", hi)) if apart[label])

    def end(label: str, values: Array, j: int) -> str:
        same = np.all(values[:, j] == values[0, j])
        return literal(values[0, j], names.real) if same else f"{label}[in->mode][{j}]"

    lines = tuple(f"(in->theta[{j}] >= {end('least', lo, j)}) && (in->theta[{j}] <= {end('most', hi, j)})"
                  for j in range(lo.shape[1]))
    return RangeCheck(name, "theta", what, (lines,), (), (), tables)


def _windows(s, prefix: str) -> tuple[Window, ...]:
    """Debounce m of n: the cheapest test that says at least m of the last n bits are set."""
    m, n = s.debounce
    mask = f"0x{2**n - 1:X}U"
    if n == 1:
        return ()
    if m == 1:
        return (Window(mask, "s->history[i] != 0U", ()),)
    if m == n:
        return (Window(mask, f"s->history[i] == {mask}", ()),)
    return (Window(mask, f"{prefix}_ones(s->history[i]) >= {m}U", (f"{prefix}_ones",)),)


def _resources(size: int, operations: Operations) -> tuple[str, ...]:
    divisions = f"{operations.divide} divisions, " if operations.divide else ""
    return (f"state: {size} bytes per instance; no heap, no static variables",
            f"step, predict: at most {operations.multiply} multiplications, {divisions}{operations.add} additions and "
            f"{operations.compare} comparisons of real numbers")
