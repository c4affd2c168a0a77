"""The box of a point observer, as C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.box import turned_start
from ..observers.point import centred
from .cprint import initialiser
from .families import Member, Word
from .maps import Names, Table
from .parts import Operations, Size
from .pieces import mode_rows

Array = np.ndarray


@dataclass(frozen=True)
class BoxStep:
    """A function that moves the half widths by a step: its name, heading, tables, origin of the estimate after it."""

    name: str
    equation: tuple[str, ...]
    tables: tuple[Table, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class BoxView:
    """Sizes and tables; ``last`` and ``origin`` are expressions of the last mode and of the noise in the estimate.

    ``plain`` has an entry where b is of the states themselves, ``turned`` the sizes of the coordinates where not.
    """

    numbers: int
    sizes: tuple[Size, ...]
    last: str
    origin: str
    forget: tuple[str, ...]
    start: Table
    whole: Table
    limit: Table
    spread: Table
    steps: tuple[BoxStep, ...]
    output: tuple[Table, ...]
    plain: tuple[str, ...]
    turned: tuple[Table, ...]


def view(t, names: Names) -> BoxView:
    """Print the tables."""
    z, m, real = t.shape, names.macro, t.real
    tnl, origins = t.kind == "tnl", f"[{m}_ORIGINS]"

    def vector(name, values):
        return Table(name, f"[{m}_NX]", (), (initialiser(values, real).strip("{} ") + ",",))

    def by_mode(name, values, size):
        lines = tuple(line for mode, value in zip(names.modes, values) for line in mode_rows(mode, value, real))
        return Table(name, f"[{m}_MODES]{size}", (), lines)

    def step(name, equation, P, g, after):
        return BoxStep(f"{names.prefix}_set_{name}", (equation,), (
            by_mode("size", P, f"[{m}_NX][{m}_NX]"), by_mode("added", g, f"{origins}[{m}_NX]")), after)

    half = [centred(getattr(t, f"{n}_lo"), getattr(t, f"{n}_hi"), t.dtype)[1] for n in ("x0", "x")]
    half = [turned_start(z.Z, h[None])[0] if z.turned else h for h in half]
    return BoxView(
        numbers=len(t.box),
        sizes=(Size("NSHAPE", f"{m}_NX", "numbers of the error set"),
               Size("ORIGINS", f"{t.origins}U", "noise in the estimate: that of each mode's gain, or none"
                    if tnl else "the estimate never holds noise of its own sample")),
        last=names.last if len(t.A) > 1 else "0U",
        origin=f"(s->origin < {m}_ORIGINS) ? s->origin : 0U" if tnl else "0U",
        forget=(f"s->origin = {m}_MODES;",) * tnl, start=vector("half", half[0]), whole=vector("half", half[1]),
        limit=vector("limit", t.limit),
        spread=Table("spread", f"{origins}[{m}_NX]", (), tuple(f"{initialiser(v, real)}," for v in z.spread)),
        steps=(step("forward", "b = |M| b + g: the half widths after a measured step", z.P, z.g,
                    ("s->origin = p;",) * tnl),
               step("blind", "b = |A| b + g: after a step without measurement", z.Pb, z.gb,
                    (f"s->origin = {m}_MODES;",) * tnl)),
        output=(by_mode("size", z.S, f"[{m}_NY][{m}_NX]"), by_mode("noise", z.rho, f"{origins}[{m}_NY]")),
        plain=("i",) * (not z.turned),
        turned=(Table("size", f"[{m}_NX][{m}_NX]", (),
                      tuple(f"{initialiser(v, real)}," for v in z.R)),) * z.turned)


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    m = names.macro
    words: list[Word] = [("origin", "", "mode whose gain put this sample's noise into x_hat; "
                                        f"{m}_MODES: no noise of it is in")] * (t.kind == "tnl")
    note = "half widths of the error set" + ", turned" * t.shape.turned
    return [(names.real_type, "shape", f"[{m}_NSHAPE]", (note,))], words, len(t.box)


def operations(t) -> Operations:
    """Count the dearest sample: at one that starts again the half widths of x are formed twice."""
    n, n_y, turned = len(t.box), t.C.shape[1], bool(t.shape.turned)
    both = n * n * (1 + 2 * turned) + n_y * n
    return Operations(both, both + 2 * n * (not turned), 4 * n + 2 * n_y)
