"""The families "interval" and "tnl" in a view: two framers, bits for crossed ones, the cut to the declared range."""

from __future__ import annotations

import numpy as np

from . import families, manual
from .cprint import literal
from .layouts import lay_out
from .maps import MapView, Names
from .parts import Cut, Field, Late, Move, Operations, Parts, assign, vector_table
from .varying import Varying, lay_out_varying


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the framers' own.

    Parameters
    ----------
    family : {"interval", "tnl"}
    t : FramerTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and the measured parameters.
    layout : {"literal", "table", "loop"}

    Returns
    -------
    Parts
    """
    x, u, y, theta = signals
    bits = manual.bits(y, t.shared)
    specs = families.specs(family, t, names, x, y)
    views = tuple((lay_out_varying if isinstance(spec, Varying) else lay_out)(spec, layout) for spec in specs)
    late = t.vary is not None and t.vary.late
    changes = tuple(lay_out(spec, layout) for spec in families.change_specs(t, names, x))
    operations = _operations(family, views, changes, t, (len(u), len(y), len(theta)))
    views = (*changes, *views)
    if late:
        views += tuple(lay_out_varying(spec, layout) for spec in families.late_specs(*specs[1:], names))
    state = families.state_fields(family, names, s, len(bits), (len(x), len(u), len(y), len(theta)),
                                  manual.changed(t, x, t.real) if changes else ())
    changed = (f"{names.prefix}_to_z(s);",) * bool(changes)
    return Parts(
        noun="framers", header="observer.h.jinja", self_test="harness/test.c.jinja",
        bits=bits, maps=views, state=state,
        out_fields=tuple(Field(*f) for f in families.out_fields(names)), operations=operations,
        cuts=cuts(names, t, layout),
        start=assign("s->x_lo", t.x0_lo, t.real) + assign("s->x_hi", t.x0_hi, t.real) + changed,
        whole_range=assign("s->x_lo", t.x_lo, t.real) + assign("s->x_hi", t.x_hi, t.real) + changed,
        crossed=() if t.shared else (bits[-1].macro,), late=_late(names.prefix) if late else (),
        move=_move(names.prefix, late))


def _late(prefix: str) -> tuple[Late, ...]:
    """The two moves where the mode is told late."""
    return (Late(f"{prefix}_either", f"{prefix}_forward(s, in, out);", f"{prefix}_forward_late(s, in, &other);"),
            Late(f"{prefix}_either_blind", f"{prefix}_blind(s, out);", f"{prefix}_blind_late(s, in, &other);"))


def _move(prefix: str, late: bool) -> Move:
    """Of the family "tnl"."""
    if late:
        return Move(f"{prefix}_either(s, in, out);", f"{prefix}_either_blind(s, in, out);")
    return Move(f"{prefix}_forward(s, in, out);", f"{prefix}_blind(s, out);")


def cuts(names: Names, t, layout: str) -> tuple[Cut, ...]:
    """The range of x, and that of z where the coordinates are changed."""
    sound = "Cut both framers to the declared range of x: sound as long as the state is in it."
    x = _cut(names, f"{names.prefix}_cut", "x", sound, t.x_lo, t.x_hi, layout)
    if t.change is None:
        return (x,)
    return (x, _cut(names, f"{names.prefix}_cut_z", "z", "Cut both framers to what z = Z x makes of the range of x.",
                    t.change.z_lo, t.change.z_hi, layout))


def _cut(names: Names, name: str, vector: str, what: str, lo, hi, layout: str) -> Cut:
    count = f"{names.macro}_NX"
    if layout == "loop":
        tables = (vector_table("least", count, lo, names.real), vector_table("most", count, hi, names.real))
        return Cut((), tables, (count,), name, vector, what)
    lines = tuple(f"{side}[{i}] = {names.prefix}_clip({side}[{i}], {literal(a, names.real)}, {literal(b, names.real)});"
                  for i, (a, b) in enumerate(zip(lo, hi)) for side in (f"{vector}_lo", f"{vector}_hi"))
    return Cut(lines, (), (), name, vector, what)


def _operations(family: str, views: tuple[MapView, ...], changes: tuple[MapView, ...], t,
                sizes: tuple[int, int, int]) -> Operations:
    """Count the dearest call: checks of the inputs, bounds of the residual, the dearest way of moving the framers."""
    n_x, (n_u, n_y, n_theta) = len(t.x_lo), sizes
    residual, forward, blind = (v.operations for v in views)
    cut = np.array([0, 0, 4 * n_x])
    forward, blind, again = forward + t.clamp * cut, blind + cut, 0 * cut
    if changes:  # from z to x and back, each with a cut of its own; a restart needs z too
        to_x, to_z = (v.operations + cut for v in changes)
        forward, blind, again = forward + to_x, blind + to_z, to_z
    moves = np.maximum(forward, blind)
    if t.vary is not None and t.vary.late:
        moves = 2 * moves + [0, 0, 2 * n_x]
    judged = residual + [0, 0, 2 * n_y + (0 if t.shared else n_x)]
    judged = judged + (moves + again if family == "tnl" else np.maximum(forward, again))
    multiply, add, compare = np.maximum(judged + [0, 0, 2 * n_y], moves)
    return Operations(int(multiply), int(add), int(compare) + 2 * (n_u + n_theta))
