"""The ellipsoid of a point observer, as C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.ellipsoid import shape_of_box
from ..observers.point import centred
from .cprint import initialiser, literal
from .families import Member, Word
from .maps import Names, Table
from .parts import Operations, Size
from .pieces import mode_rows

Array = np.ndarray


@dataclass(frozen=True)
class Form:
    """A function that forms ``g A X A' + S + diag(k) trace``: its name, heading, tables, and what it does after."""

    name: str
    equation: tuple[str, ...]
    matrix: str
    tables: tuple[Table, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class EllipsoidView:
    """Sizes and tables; ``two`` and ``by_table`` are the tests of several outputs together, one of them or neither."""

    numbers: int
    sizes: tuple[Size, ...]
    last: str
    origin: str
    forget: tuple[str, ...]
    start: Table
    whole: Table
    limit: Table
    weight: Table
    spread: Table
    slopes: Table
    offsets: Table
    slopes_y: Table
    offsets_y: Table
    steps: tuple[Form, ...]
    output: Form
    two: tuple[str, ...]
    by_table: tuple[Table, ...]
    slack: str
    floor: str


def lower_of(S: Array) -> Array:
    """Return the lower triangles of symmetric matrices, row by row: all that the C reads."""
    return S[(..., *np.tril_indices(S.shape[-1]))]


def view(t, names: Names) -> EllipsoidView:
    """Print the tables."""
    z, m, real, n_y = t.shape, names.macro, t.real, t.C.shape[1]
    tnl = t.kind == "tnl"

    def vector(name, values, count):
        return Table(name, f"[{m}_{count}]", (), (initialiser(values, real).strip("{} ") + ",",))

    def rows(name, values, size):
        return Table(name, size, (), tuple(f"{initialiser(v, real)}," for v in values))

    def by_mode(name, values, size):
        lines = tuple(line for mode, value in zip(names.modes, values) for line in mode_rows(mode, value, real))
        return Table(name, f"[{m}_MODES]{size}", (), lines)

    def form(name, equation, matrix, A, S, g, k, count, after):
        return Form(f"{names.prefix}_{name}", equation, matrix, (
            by_mode(matrix, A, f"[{m}_{count}][{m}_NX]"),
            by_mode("noise", lower_of(S), f"[{m}_ORIGINS][({m}_{count} * ({m}_{count} + 1U)) / 2U]"),
            Table("factor", f"[{m}_MODES]", (), (initialiser(g, real).strip("{} ") + ",",)),
            by_mode("rounding", k, f"[{m}_{count}]")), after)

    halves = [shape_of_box(centred(getattr(t, f"{n}_lo"), getattr(t, f"{n}_hi"), t.dtype)[1], t.dtype)
              for n in ("x0", "x")]
    more = z.directions if n_y > 2 else z.directions[:0]
    return EllipsoidView(
        numbers=len(t.box) ** 2,
        sizes=(Size("NSHAPE", f"({m}_NX * {m}_NX)", "numbers of the error set"),
               Size("TANGENTS", f"{len(z.a)}U", "bounds of the square root of a state's size, the least counts"),
               Size("TANGENTS_Y", f"{len(z.ay)}U", "the same of a residual's size"),
               Size("ORIGINS", f"{t.origins}U", "noise in the estimate: that of each mode's gain, or none"
                    if tnl else "the estimate never holds noise of its own sample")),
        last=names.last if len(t.A) > 1 else "0U",
        origin=f"(s->origin < {m}_ORIGINS) ? s->origin : 0U" if tnl else "0U",
        forget=(f"s->origin = {m}_MODES;",) * tnl, start=vector("square", halves[0], "NX"),
        whole=vector("square", halves[1], "NX"), limit=vector("limit", t.limit, "NX"),
        weight=vector("weight", z.weight, "NX"), spread=rows("spread", z.spread, f"[{m}_ORIGINS][{m}_NX]"),
        slopes=rows("slope", z.a, f"[{m}_TANGENTS][{m}_NX]"), offsets=rows("offset", z.b, f"[{m}_TANGENTS][{m}_NX]"),
        slopes_y=rows("slope", z.ay, f"[{m}_TANGENTS_Y][{m}_NY]"),
        offsets_y=rows("offset", z.by, f"[{m}_TANGENTS_Y][{m}_NY]"),
        steps=(form("set_forward", ("X = (1 + alpha) M X M' + H + rounding: the set after a measured step",), "M", t.M,
                    z.H, z.g, z.k, "NX", ("s->origin = p;",) * tnl),
               form("set_blind", ("X = (1 + alpha) A X A' + H + rounding: after a step without measurement",), "A", t.A,
                    z.Hb, z.gb, z.kb, "NX", (f"s->origin = {m}_MODES;",) * tnl)),
        output=form("outside", ("R = (1 + beta) C X C' + V + rounding; bounds of the residuals, and bits of what "
                                "cannot happen without a fault.",), "C", t.C, z.V, z.gr, z.kr, "NY", ()),
        two=(f"{m}_BIT_TOGETHER",) * (n_y == 2),
        by_table=(rows("direction", more, f"[{len(more)}U][{m}_NY]"),) * bool(len(more)),
        slack=literal(z.slack, real), floor=literal(z.floor, real))


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    m = names.macro
    words: list[Word] = [("origin", "", "mode whose gain put this sample's noise into x_hat; "
                                        f"{m}_MODES: no noise of it is in")] * (t.kind == "tnl")
    return ([(names.real_type, "shape", f"[{m}_NSHAPE]", ("shape of the error set's ellipsoid, row by row",))], words,
            len(t.box) ** 2)


def operations(t) -> Operations:
    """Count the dearest sample: at one that starts again the half widths of x are formed twice."""
    n, n_y, z = len(t.box), t.C.shape[1], t.shape
    out = Operations(0, 0, 0)
    for r in (n, n_y):  # A X, its product with A', factor and noise, the diagonal, the trace; sums begin with 0
        both = r * n * n + r * (r + 1) // 2 * (n + 1) + r + n
        out += Operations(both, both, 0)
    for rows, tangents in ((2 * n, len(z.a)), (n_y, len(z.ay))):
        out += Operations(rows * tangents, rows * tangents, rows * (tangents + 1))
    return out + Operations(0, 2 * n, 0) + membership(t)


def membership(t) -> Operations:
    """Count the test of several outputs together."""
    n_y = t.C.shape[1]
    rows = len(t.shape.directions) if n_y > 2 else 0
    out = Operations(rows * (n_y * n_y + 3 * n_y + 3), rows * (n_y * n_y + 3 * n_y + 2), rows * (n_y + 1))
    return out + (Operations(10, 8, 1) if n_y == 2 else Operations(0, 0, 0))
