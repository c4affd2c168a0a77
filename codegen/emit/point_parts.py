"""Point observers in a view: the maps of the estimate, and of its error set the tables and sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.point import centred
from ..observers.zonotope import set_work
from . import (
    block_parts,
    box_parts,
    ellipsoid_parts,
    ellipsoid_trace_parts,
    schedule_parts,
    start_parts,
    threshold_parts,
)
from .cprint import initialiser, literal, macro_names
from .families import Member, Word, mode_word, state_layout
from .layouts import lay_out
from .manual import Bit
from .maps import Linear, MapSpec, Names, Table
from .parts import Cut, Field, Move, Operations, Parts, Size, assign
from .pieces import mode_rows

Array = np.ndarray


@dataclass(frozen=True)
class Steps:
    """A function that moves the set by a step: its name, heading, matrices, tables, origin of the estimate after it."""

    name: str
    equation: tuple[str, ...]
    matrix: str
    turn: tuple[str, ...]
    tables: tuple[Table, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class SetView:
    """The error set: sizes, tables of each function, statements where the family or the plant differ.

    ``numbers`` is the length of the state's ``shape``; ``last`` and ``origin`` are expressions of the last mode and of
    the index of the noise that the estimate holds; ``start`` and ``whole`` hold the half widths of the initial box and
    of the ranges; ``by_normals``, ``by_pairs`` and ``by_table`` are the directions of the membership test, one or none,
    ``room`` how many residual vectors it needs (generators, for pairs unit vectors too),
    ``together`` the bit that it sets. ``plain`` where columns are compared by squares in the coordinates of x, else
    ``columns``; ``turned`` where boxes are in other coordinates, else ``copied``; ``squared`` or ``girard`` by what
    columns are compared; ``back`` the matrix that takes a box on.
    """

    numbers: int
    sizes: tuple[Size, ...]
    last: str
    origin: str
    forget: tuple[str, ...]
    start: Table
    whole: Table
    limit: Table
    weight: Table
    rounding: tuple[Table, ...]
    plain: tuple[str, ...]
    turned: tuple[str, ...]
    copied: tuple[str, ...]
    columns: tuple[str, ...]
    squared: tuple[str, ...]
    girard: tuple[str, ...]
    back: str
    spread: Table
    steps: tuple[Steps, ...]
    output: tuple[Table, ...]
    noises: tuple[str, ...]
    room: str
    by_normals: tuple[str, ...]
    by_pairs: tuple[str, ...]
    by_table: tuple[Table, ...]
    together: tuple[str, ...]
    slack: str
    floor: str
    compares: int


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the point observers' own.

    Parameters
    ----------
    family : {"zonotope", "thresholds", "schedule", "blocks", "ellipsoid", "box", "ellipsoid_trace", "starts"}
    t : PointTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}

    Returns
    -------
    Parts
    """
    x, u, y, _ = signals
    p, m = names.prefix, names.macro
    bits = alarm_bits(y, family != "box")
    views = tuple(lay_out(spec, layout) for spec in maps(t, names, x, y))
    words: list[Word] = [mode_word(m)] if s.monitors_dwell or len(names.modes) > 1 else []
    words.append(("phase", f"{m}_FRESH", "0: x_hat is this sample's; 1: last sample's, without y; 2: with y"))
    online = family not in TABLES
    family_state, family_operations, family_view = FAMILY[family]
    own, more, count = family_state(t, names)
    words += more
    numbers: list[Member] = [(names.real_type, "x_hat", f"[{m}_NX]", ("estimate of x; unit and order of x",))]
    numbers += [(names.real_type, "u", f"[{m}_NU]", ("inputs of the last sample",))] * bool(u)
    numbers.append((names.real_type, "y", f"[{m}_NY]", ("measurements of the last measured sample",)))
    numbers += own
    kept = [f"s->{v}[{i}]" for v, signals in (("u", u), ("y", y)) for i in range(len(signals))]
    state = state_layout(names, s, len(bits), numbers, len(x) + len(kept) + count, kept, words)
    centre = {name: centred(getattr(t, f"{name}_lo"), getattr(t, f"{name}_hi"), t.dtype)[0] for name in ("x0", "x")}
    reads = ", in" if family == "thresholds" and len(names.modes) > 1 else ""
    view = family_view(t, names)
    calls = (f"{p}_set_forward(s{reads});", f"{p}_settle(s, {'' if online else 'in, '}out);")
    return Parts(
        noun="estimates", header="point.h.jinja", self_test="harness/test_point.c.jinja", bits=bits,
        maps=views, state=state,
        out_fields=tuple(Field(*f) for f in out_fields(names)),
        operations=family_operations(t) + estimate(t, views, len(u)),
        cuts=(Cut(tuple(f"x_hat[{i}] = {p}_clip(x_hat[{i}], {literal(-b, t.real)}, {literal(b, t.real)});"
                        for i, b in enumerate(t.box)), (), ()),),
        start=assign("s->x_hat", centre["x0"], t.real), whole_range=assign("s->x_hat", centre["x"], t.real),
        crossed=(), late=(), move=Move(f"{p}_forward(s, in, out);", f"{p}_blind(s, out);", *calls),
        sets=(view,), lengths=(("NSHAPE", view.numbers),))


def state_of(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of a zonotope in the state, and how many numbers."""
    m = names.macro
    words: list[Word] = [("origin", "", "mode whose gain put this sample's noise into x_hat; "
                                        f"{m}_MODES: no noise of it is in")] * (t.kind == "tnl")
    numbers = [(names.real_type, "shape", f"[{m}_NSHAPE]",
                (f"generators of the error set, {m}_NX numbers each, one generator after the other",))]
    return numbers, words, t.shape.columns * len(t.box)


def alarm_bits(y, together: bool) -> tuple[Bit, ...]:
    """One bit per output, and with several one for what only their set shows, if it shows anything."""
    own = [Bit(stem, f"0x{1 << c.index:X}U", f"{c.name} outside its bounds")
           for c, stem in zip(y, macro_names((c.name for c in y), ["TOGETHER"]))]
    more = [Bit("TOGETHER", f"0x{1 << len(y):X}U", "the residuals together outside their set")]
    return (*own, *more * (together and len(y) > 1))


def maps(t, names: Names, x, y) -> tuple[MapSpec, MapSpec, MapSpec]:
    """State the residual, and the estimate's step with and without its measurement."""
    p, m = names.prefix, names.macro
    states, outputs = (tuple(f"{v}[{c.index}] {c.name}" for c in cs) for v, cs in (("x", x), ("y", y)))

    def linear(name, value, operand="", count=""):
        return Linear(name, value, value, operand, f"{m}_{count}")

    def inputs(name, value, operand):
        return (linear(name, value, operand, "NU"),) if value.shape[2] else ()

    common = {"names": names, "shared": True, "by_sign": False, "minus": "", "sides": ("",)}
    residual = MapSpec(
        f"{p}_residual", ("r = y - (C x_hat + D u + c)",), (f"const {p}_in *in", f"{p}_out *out"), "in->mode",
        "in->mode", "out->r", "out->r", outputs, inputs("minus_D", -t.D, "in->u"), offset=linear("minus_c", -t.c),
        state=linear("minus_C", -t.C, "out->x_hat", "NX"), tail=(), row_count=f"{m}_NY", plus="in->y", **common)
    last = {"selector": "s->mode", "index": names.last, "target_lo": "out->x_hat", "target_hi": "out->x_hat",
            "rows": states, "tail": (f"{p}_cut(out->x_hat);",), "row_count": f"{m}_NX", **common}
    tnl = (linear("N", t.N, "in->y", "NY"),) if t.kind == "tnl" else ()
    forward = MapSpec(
        f"{p}_forward", (f"x_hat+ = M x_hat + G u + L y + {'N y+ + ' if tnl else ''}d",),
        (f"const {p}_state *s", f"const {p}_in *in", f"{p}_out *out"),
        common=(*inputs("G", t.G, "s->u"), linear("L", t.L, "s->y", "NY"), *tnl), offset=linear("d", t.d),
        state=linear("M", t.M, "s->x_hat", "NX"), **last)
    blind = MapSpec(
        f"{p}_blind", ("x_hat+ = A x_hat + B u + a",), (f"const {p}_state *s", f"{p}_out *out"),
        common=inputs("B", t.B, "s->u"), offset=linear("a", t.a), state=linear("A", t.A, "s->x_hat", "NX"), **last)
    return residual, forward, blind


def out_fields(names: Names) -> tuple[Member, ...]:
    """Members of the output struct."""
    m, real, word = names.macro, names.real_type, "uint32_t"
    return ((real, "x_hat", f"[{m}_NX]", ("estimate of x at this sample",)),
            (real, "x_lo", f"[{m}_NX]", ("lower bounds of x at this sample",)),
            (real, "x_hi", f"[{m}_NX]", ("upper bounds of x at this sample",)),
            (real, "r", f"[{m}_NY]", ("residual: y minus what the estimate expects; 0 after predict",)),
            (real, "r_bound", f"[{m}_NY]", ("largest magnitude of r without a fault; 0 after predict",)),
            (word, "raw", "", (f"{m}_BIT_ of what is outside at this sample; 0 after predict",)),
            (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
            (word, "latched", "", ("alarm bits as kept; act on these",)),
            (word, "assured", "", ("1: the bounds and alarms of this sample are guaranteed; 0: they are not",)))


def zonotope(t, names: Names) -> SetView:
    """Print the tables of a zonotope."""
    n_y = t.C.shape[1]
    z, m, real = t.shape, names.macro, t.real
    n_x, added, noises = len(t.box), z.F.shape[3], z.V.shape[3]
    modes, origins = f"[{m}_MODES]", f"[{m}_ORIGINS]"
    sizes = [Size("ORDER", f"{z.order}U", "generators after a reduction"),
             Size("KEPT", f"{z.order - n_x}U", "of them kept, the others are a box"),
             Size("ADDED", f"{added}U", "generators of disturbance and noise that a step adds"),
             Size("COLUMNS", f"({m}_ORDER + {m}_ADDED)", "generators of the error set"),
             Size("NOISES", f"{noises}U", "generators of noise in the residual"),
             Size("TERMS", f"({m}_COLUMNS + {m}_NOISES)", "generators of the residual's set"),
             *[Size("EDGES", f"({m}_TERMS + {m}_NY)", "generators of the residual's set and unit vectors")] * z.pairs,
             Size("ORIGINS", f"{t.origins}U", "noise in the estimate: that of each mode's gain, or none"
                  if t.kind == "tnl" else "the estimate never holds noise of its own sample"),
             Size("NSHAPE", f"({m}_NX * {m}_COLUMNS)", "numbers of the error set")]

    def vector(name, values, count):
        return Table(name, f"[{m}_{count}]", (), (initialiser(values, real).strip("{} ") + ",",))

    def by_mode(name, values, size):
        rows = tuple(line for mode, value in zip(names.modes, values) for line in mode_rows(mode, value, real))
        return Table(name, f"{modes}{size}", (), rows)

    def columns(values):
        return values.swapaxes(2, 3).reshape(*values.shape[:2], -1)  # one generator after the other

    def turn(S):
        if not z.oblique:
            return ()
        return (by_mode("basis", z.B, f"[{m}_NX][{m}_NX]"), by_mode("back", S, f"[{m}_NX][{m}_NX]"),
                by_mode("rounding", z.inside, f"[{m}_NX]"))

    plain = z.key == "squared" and not z.oblique
    steps = tuple(Steps(f"{names.prefix}_set_{name}", equation, matrix,
                        ("basis[p], back[p], rounding[p], ",) * z.oblique,
                        (by_mode(matrix, M, f"[{m}_NX][{m}_NX]"), *turn(S),
                         by_mode("added", columns(F), f"{origins}[{m}_NX * {m}_ADDED]")), after)
                  for name, matrix, M, S, F, equation, after in (
                      ("forward", "M", t.M, z.S, z.F,
                       ("The set after a measured step: M times the reduced set, and what disturbance and noise add.",),
                       ("s->origin = p;",) * (t.kind == "tnl")),
                      ("blind", "A", t.A, z.Sb, z.Fb, ("The set after a step without measurement.",),
                       (f"s->origin = {m}_MODES;",) * (t.kind == "tnl"))))
    output = [by_mode("C", t.C, f"[{m}_NY][{m}_NX]"), by_mode("rho", z.rho, f"[{m}_NY]")]
    if noises:
        output.append(by_mode("noise", columns(z.V), f"{origins}[{m}_NY * {m}_NOISES]"))
    by_table = n_y > 2 and len(z.directions) > 0 and not z.pairs
    directions = (Table("direction", f"[{len(z.directions)}U][{m}_NY]", (),
                        tuple(f"{initialiser(d, real)}," for d in z.directions)),) * by_table
    half = [centred(getattr(t, f"{name}_lo"), getattr(t, f"{name}_hi"), t.dtype)[1] for name in ("x0", "x")]
    kept = z.order - n_x
    return SetView(
        numbers=z.columns * n_x, sizes=tuple(sizes),
        last=names.last if len(t.A) > 1 else "0U",
        origin=f"(s->origin < {m}_ORIGINS) ? s->origin : 0U" if t.kind == "tnl" else "0U",
        forget=(f"s->origin = {m}_MODES;",) * (t.kind == "tnl"), start=vector("half", half[0], "NX"),
        whole=vector("half", half[1], "NX"), limit=vector("limit", t.limit, "NX"),
        weight=vector("weight", z.weight, "NX"),
        rounding=(vector("rounding", z.e, "NX"),) * (not z.oblique), plain=("",) * plain, turned=("",) * z.oblique,
        copied=("",) * (not z.oblique), columns=("",) * (not plain), squared=("",) * (z.key == "squared"),
        girard=("",) * (z.key == "girard"),
        back="back" if z.oblique else "matrix",
        spread=Table("spread", f"{origins}[{m}_NX]", (), tuple(f"{initialiser(v, real)}," for v in z.spread)),
        steps=steps, output=tuple(output), noises=(f"{m}_NOISES",) * bool(noises),
        room=f"{m}_EDGES" if z.pairs else f"{m}_TERMS", by_normals=(f"{m}_TERMS",) * (n_y == 2),
        by_pairs=(literal(1.0, real),) * z.pairs, by_table=directions,
        together=(f"{m}_BIT_TOGETHER",) * (n_y == 2 or z.pairs or bool(directions)), slack=literal(z.slack, real),
        floor=literal(z.floor, real), compares=kept * z.columns - kept * (kept + 1) // 2)


def operations(t) -> Operations:
    """Count the dearest sample of a zonotope."""
    z = t.shape
    own = set_work(len(t.box), t.C.shape[1], z.order, z.F.shape[3], z.V.shape[3], len(z.directions), z.pairs, z.oblique,
                   z.key == "girard")
    return Operations(own.multiply, own.add, own.compare)


def estimate(t, views, n_u: int) -> Operations:
    """Count what all point observers do: checks of u and y, estimate and residual, the box around the estimate."""
    residual, forward, blind = (v.operations for v in views)
    n, n_y = len(t.box), t.C.shape[1]
    return Operations(*(residual + np.maximum(forward, blind) + [0, 2 * n, 2 * (n_u + n_y + n)]))


#: Families whose set is a table, at least in part: what it says depends on the mode now.
TABLES = ("thresholds", "schedule", "blocks", "starts")
#: Members of the state, operations and view of each family.
FAMILY = {"zonotope": (state_of, operations, zonotope),
          "thresholds": (threshold_parts.state, threshold_parts.operations, threshold_parts.view),
          "starts": (start_parts.state, threshold_parts.operations, start_parts.view),
          "schedule": (schedule_parts.state, threshold_parts.operations, schedule_parts.view),
          "blocks": (block_parts.state, block_parts.operations, block_parts.view),
          "ellipsoid": (ellipsoid_parts.state, ellipsoid_parts.operations, ellipsoid_parts.view),
          "box": (box_parts.state, box_parts.operations, box_parts.view),
          "ellipsoid_trace": (ellipsoid_trace_parts.state, ellipsoid_trace_parts.operations,
                              ellipsoid_trace_parts.view)}
