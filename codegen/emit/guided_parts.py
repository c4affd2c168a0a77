"""Framers guided by sliding modes in a view: the estimator's part, and the framers as inner C."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import families, framer_parts, manual, sliding_parts
from .cprint import literal, macro_names
from .families import Member, in_fields, state_layout
from .follower_parts import InnerView, Struct, whole
from .layouts import lay_out
from .manual import Bit
from .maps import MapSpec, Names
from .parts import Cut, Field, Operations, Parts
from .render import render
from .sliding_parts import SlidingView
from .varying import Varying, lay_out_varying


@dataclass(frozen=True)
class GuidedView(SlidingView):
    """Beside the estimator's: the inner C of the framers, the cuts in it, the calls of its maps.

    ``moved`` is the struct in which they leave their result, ``turns`` "z" where the coordinates are changed.
    """

    told: str
    cuts: tuple[Cut, ...]
    step: str
    blind: str
    moved: str
    turns: tuple[str, ...]


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the guided framers' own.

    Parameters
    ----------
    family : {"guided"}
    t : GuidedTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and the measured parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks and of the framers' maps; the pairs are loops over tables in each.

    Returns
    -------
    Parts
    """
    m, real, (x, u, y, theta) = names.macro, names.real_type, signals
    own = sliding_parts.parts("sliding", t, s, names, signals, layout)
    inner = inner_names(names)
    views = tuple((lay_out_varying if isinstance(spec, Varying) else lay_out)(spec, layout)
                  for spec in maps(t.told, inner, x, y))
    numbers, words, kept = sliding_parts.members(t, names)
    held: list[tuple[str, str, int, str]] = [
        (f"told_{side}", "NX", len(x), f"{end} bounds of x, of the framers of the mode in decided")
        for side, end in (("lo", "lower"), ("hi", "upper"))]
    held += [("told_u", "NU", len(u), "inputs of the last sample")] * bool(u)
    held.append(("told_y", "NY", len(y), "measurements of the last sample"))
    held += [("told_theta", "NTHETA", len(theta), "parameters of the last sample")] * bool(theta)
    more: list[Member] = [(real, name, f"[{m}_{count}]", (note,)) for name, count, _, note in held]
    turns = ("z",) * (t.told.change is not None)
    for side, end in (("lo", "lower"), ("hi", "upper")) if turns else ():
        what = manual.changed(t.told, x, t.real) if side == "lo" else ()
        more.append((real, f"told_z_{side}", f"[{m}_NX]", (f"{end} bounds of z, from which those of x follow"
                                                           f"{':' * bool(what)}", *what)))
        held.append((f"told_z_{side}", "NX", len(x), ""))
    kept += [f"s->{name}[{i}]" for name, _, count, _ in held for i in range(count)]
    bits = (*own.bits, *(Bit(stem, f"0x{2 << c.index:X}U", f"{c.name} outside its bounds in out->mode")
                         for c, stem in zip(y, macro_names((c.name for c in y), ["TWICE", "CROSSED"]))),
            Bit("CROSSED", f"0x{2 << len(y):X}U", "a lower bound in out->mode above the upper one"))
    reals = 2 * t.sizes[0] * t.sizes[1] + 2 * len(x) + len(kept)
    d, result = _inner(views, t, inner, names.prefix, (len(u), len(theta)), layout), "" if turns else ", &own"
    c = render("framers.c.jinja", d=d).rstrip("\n")
    return replace(own, header="guided.h.jinja", bits=bits, out_fields=tuple(Field(*f) for f in out_fields(names)),
                   state=state_layout(names, s, len(bits), numbers + more, reals, kept, words),
                   operations=own.operations + operations(views, t),
                   sets=(GuidedView(**vars(own.sets[0]), told=c, cuts=d.cuts, turns=turns,
                                  moved="held" if turns else "own",
                                  step=f"{inner.prefix}_forward(&held, &given{result});",
                                  blind=f"{inner.prefix}_blind(&held{result});"),))


def inner_names(names: Names) -> Names:
    """Names of the inner C, which is given a mode that has been checked."""
    return replace(names, prefix=f"{names.prefix}_told", checked=True)


def maps(told, inner: Names, x, y) -> tuple[MapSpec | Varying, ...]:
    """Residual, step and prediction of framers that are told a mode which is one."""
    residual, *moves = families.specs("tnl", told, inner, x, y)
    moves = [replace(v, spec=replace(v.spec, index="s->mode")) if isinstance(v, Varying) else
             replace(v, index="s->mode") for v in moves]
    return residual, *families.change_specs(told, inner, x), *moves


def out_fields(names: Names) -> list[Member]:
    """Members of the output struct: the estimator's, of which some mean more."""
    raw = (f"{names.macro}_BIT_ of what is outside its bounds at this sample; 0 after predict",)
    return [(*f[:3], raw) if f[1] == "raw" else f for f in sliding_parts.out_fields(names)]


def _inner(views: tuple, t, inner: Names, outer: str, counts: tuple[int, int], layout: str) -> InnerView:
    """Collect what the inner C prints of the framers."""
    bounds = [f for f in families.out_fields(inner) if f[2]]
    given = [f for f in in_fields(inner, *counts) if f[1] != "spare"]
    turned = [(f[0], f[1].replace("x_", "z_"), *f[2:]) for f in bounds[:2]] * (t.told.change is not None)
    state = [*bounds[:2], *turned, *given]
    structs = [Struct(name, whole([Field(*f) for f in members], t.real))
               for name, members in (("state", state), ("in", given), ("out", bounds))]
    return InnerView(inner.prefix, inner.macro, outer, literal(0.0, t.real), (), tuple(structs), views,
                     framer_parts.cuts(inner, t.told, layout), (), ())


def operations(views: tuple, t) -> Operations:
    """Count the dearest sample of the framers."""
    n, p = len(t.x_lo), len(t.v_lo)
    residual, *changes, forward, blind = (v.operations for v in views)
    moves = np.maximum(forward + [0, 0, 4 * n * t.clamp], blind + [0, 0, 4 * n])
    for to_x, to_z in zip(changes[::2], changes[1::2]):  # one of both after a step, and z of x
        moves = moves + np.maximum(to_x, to_z) + to_z + [0, 0, 11 * n]
    multiply, add, compare = (a + b for a, b in zip(residual, moves))
    parameters = t.vary.parameters if t.vary else 0
    return Operations(int(multiply), int(add), int(compare) + 3 * n + 2 * p + 2 * parameters)
