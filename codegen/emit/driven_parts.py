"""Framers driven by a mode estimator in a view: the estimator's part, and the framers' maps for a given mode."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import families, framer_parts, manual, mode_parts
from .cprint import initialiser
from .families import Member, Word, state_layout
from .layouts import lay_out
from .maps import MapSpec, Names, Table
from .mode_parts import ModeView
from .parts import Cut, Field, Operations, Parts, Size, vector_table
from .varying import Varying, lay_out_varying


@dataclass(frozen=True)
class Copy:
    """A vector of the state that a step of every mode reads: its name, and the macro of its length."""

    name: str
    count: str


@dataclass(frozen=True)
class DrivenView(ModeView):
    """Beside the estimator's: S and its room, the box of the framers, what is copied for a step of a mode.

    ``held`` are the members of the struct that such a step reads, ``copies`` those of them that all modes share;
    ``step`` and ``blind`` are the calls of the maps, ``answers`` a struct that only they need, and ``moved`` the one
    that holds the result. ``turns`` is "z" where the coordinates are changed, else nothing.
    """

    forth: tuple[Table, ...]
    frame_limit: Table
    held: tuple[Field, ...]
    copies: tuple[Copy, ...]
    step: str
    blind: str
    answers: tuple[str, ...]
    moved: str
    turns: tuple[str, ...]


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the driven framers' own.

    Parameters
    ----------
    family : {"driven"}
    t : DrivenTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and the measured parameters.
    layout : {"literal", "table", "loop"}
        Of the framers' maps; the boxes are loops over tables in each.

    Returns
    -------
    Parts
    """
    x, u, y, theta = signals
    m, real = names.macro, names.real_type
    own = mode_parts.parts("mode", t, s, names, (x, u, y, ()), layout)
    views = tuple((lay_out_varying if isinstance(spec, Varying) else lay_out)(spec, layout)
                  for spec in maps(t.told, names, x, y))
    shared = tuple((name, f"{m}_{count}", f"{what} of the last {when}sample", n) for name, count, n, what, when in (
        ("u", "NU", len(u), "inputs", ""), ("y", "NY", len(y), "measurements", "measured "),
        ("theta", "NTHETA", len(theta), "parameters", "measured ")) if n)
    frames = len(names.modes) * len(x)
    numbers: list[Member] = [member for member in own.state.members if member[1] in ("box_lo", "box_hi")]
    numbers += [(real, f"frame_{side}", f"[{m}_NFRAME]", (f"{end} bounds of x per mode, {m}_NX numbers each",))
                for side, end in (("lo", "lower"), ("hi", "upper"))]
    turns, meaning = bool(t.told.change), manual.changed(t.told, x, t.real) if t.told.change else ()
    numbers += [(real, f"frame_z_{side}", f"[{m}_NFRAME]", (f"{end} bounds of z per mode, from which those of x follow"
                                                            f"{':' * bool(note)}", *note))
                for side, end, note in (("lo", "lower", meaning), ("hi", "upper", ()))] * turns
    numbers += [(real, name, f"[{count}]", (note,)) for name, count, note, _ in shared]
    numbers += [member for member in own.state.members if member[1] == "alive"]
    kept = [f"s->{name}[{i}]" for name, n in (
        ("frame_lo", frames), ("frame_hi", frames), *((("frame_z_lo", frames), ("frame_z_hi", frames)) * turns),
        *((name, n) for name, _, _, n in shared)) for i in range(n)]
    words: list[Word] = [("decided", "0U", "mode of the last answer"),
                         ("framed", "0U", "bit q: the bounds of mode q are those of the last sample"),
                         ("measured", "0U", "1: the last sample had its measurement")]
    boxes = next(n for name, n in own.lengths if name == "NSHAPE")
    state = state_layout(names, s, 1, numbers, 2 * boxes + len(kept), kept, words, extra=len(t.Phi))
    operations = own.operations + moves(views, t)
    return replace(own, noun="bounds", header="driven.h.jinja", maps=views, state=state, operations=operations,
                   cuts=cuts(names, t.told, layout),
                   sets=(view(own.sets[0], t, names, shared),),
                   lengths=(*own.lengths, ("NFRAME", frames)))


def maps(told, names: Names, x, y) -> tuple[MapSpec | Varying, ...]:
    """The maps that move framers that are told their mode, on a struct of their own in place of the state."""
    _, forward, blind = families.specs("tnl", told, names, x, y)
    return tuple(given(spec, names.prefix) for spec in (*families.change_specs(told, names, x), forward, blind))


def cuts(names: Names, told, layout: str) -> tuple[Cut, ...]:
    """The cuts of framers; that of x has another name, as boxes are cut too."""
    first, *others = framer_parts.cuts(names, told, layout)
    return replace(first, name=f"{first.name}_x"), *others


def given(spec: MapSpec | Varying, p: str) -> MapSpec | Varying:
    """The same map, of what is held for one mode; the name of its cut is another, as boxes are cut too."""
    own = spec.spec if isinstance(spec, Varying) else spec
    own = replace(own, parameters=tuple(text.replace(f"{p}_state", f"{p}_held") for text in own.parameters),
                  index="s->mode" if own.selector == "s->mode" else own.index,
                  tail=tuple(text.replace(f"{p}_cut(", f"{p}_cut_x(") for text in own.tail))
    return replace(spec, spec=own) if isinstance(spec, Varying) else own


def view(mode: ModeView, t, names: Names, shared) -> DrivenView:
    """Print the tables of the framers beside those of the estimator."""
    m, real = names.macro, names.real_type
    S = Table("forth", f"[{m}_NX][{m}_NX]", (), tuple(f"{initialiser(row, t.real)}," for row in t.S_rounded))
    turns, p = ("z",) * (t.told.change is not None), names.prefix
    sides = tuple((real, f"{v}_{side}", f"[{m}_NX]", ()) for v in ("x", *turns) for side in ("lo", "hi"))
    own = () if turns else ("own",)
    more = "".join(f", &{name}" for name in own)
    held = tuple(Field(*f) for f in (*sides, *((real, name, f"[{count}]", ()) for name, count, *_ in shared),
                                     ("uint32_t", "mode", "", ()),
                                     *((("uint32_t", "spare", "", ("not read",)),) * (t.real == "float64"))))
    frames = Size("NFRAME", f"{t.sizes[0] * t.sizes[1]}U", "bounds of x of all modes at one side")
    return DrivenView(**vars(mode) | {"sizes": (*mode.sizes, frames)},
                      forth=(S, vector_table("xi_room", f"{m}_NX", t.xi_room, t.real)),
                      frame_limit=vector_table("frame_limit", f"{m}_NX", t.told.box, t.real), held=held,
                      copies=tuple(Copy(name, count) for name, count, *_ in shared), turns=turns, answers=own,
                      moved="held" if turns else "own", step=f"{p}_forward(&held, in{more});",
                      blind=f"{p}_blind(&held{more});")


def moves(views, t) -> Operations:
    """Count the dearest sample of the framers of all modes, twice where nothing was possible."""
    (n_modes, n, _, _), ages = t.sizes, t.ages + 1
    *changes, forward, blind = (v.operations + [0, 0, 4 * n] for v in views)
    multiply, add, compare = (int(max(pair)) for pair in zip(forward, blind))
    for to_x, to_z in zip(changes[::2], changes[1::2]):  # one of both after a step, and z anew
        one, more, least = np.maximum(to_x, to_z) + 2 * to_z + [0, 0, 9 * n]
        multiply, add, compare = multiply + int(one), add + int(more), compare + int(least)
    boxes = ages * (4 * n * n)
    return Operations(n_modes * (multiply + 2 * n * n + 2 * boxes),
                      n_modes * (add + 2 * n * n + 2 * n + 2 * boxes + 4 * ages * n),
                      n_modes * (compare + 7 * n + 2 * n * n + ages * 3 * n + 2 * (boxes + 8 * n * ages + 5 * n))
                      + n_modes * 2 * n)
