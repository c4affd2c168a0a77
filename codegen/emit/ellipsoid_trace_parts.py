"""The ellipsoid of least trace of a point observer, as C."""

from __future__ import annotations

from dataclasses import dataclass

from ..observers.ellipsoid import shape_of_box
from ..observers.ellipsoid_trace import STEPS
from ..observers.point import centred
from .cprint import initialiser, literal
from .ellipsoid_parts import Form, lower_of, membership, state
from .maps import Names, Table
from .parts import Operations, Size
from .pieces import mode_rows

__all__ = ["operations", "state", "view"]


@dataclass(frozen=True)
class TraceView:
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
    scale: Table
    scale_y: Table
    steps: tuple[Form, ...]
    output: Form
    two: tuple[str, ...]
    by_table: tuple[Table, ...]
    one: str
    half: str
    least: str
    slack: str
    floor: str


def view(t, names: Names) -> TraceView:
    """Print the tables."""
    z, m, real, n_y, tnl = t.shape, names.macro, t.real, t.C.shape[1], t.kind == "tnl"

    def vector(name, values, count):
        return Table(name, f"[{m}_{count}]", (), (initialiser(values, real).strip("{} ") + ",",))

    def rows(name, values, size):
        return Table(name, size, (), tuple(f"{initialiser(v, real)}," for v in values))

    def by_mode(name, values, size):
        lines = tuple(line for mode, value in zip(names.modes, values) for line in mode_rows(mode, value, real))
        return Table(name, f"[{m}_MODES]{size}", (), lines)

    def form(name, equation, matrix, A, S, inverse, k, weight, count, after):
        return Form(f"{names.prefix}_{name}", equation, matrix, (
            by_mode(matrix, A, f"[{m}_{count}][{m}_NX]"),
            by_mode("noise", lower_of(S), f"[{m}_ORIGINS][({m}_{count} * ({m}_{count} + 1U)) / 2U]"),
            by_mode("inverse", inverse, f"[{m}_ORIGINS]"), by_mode("rounding", k, f"[{m}_{count}]"),
            vector("weight", weight, count)), after)

    squares = [shape_of_box(centred(getattr(t, f"{n}_lo"), getattr(t, f"{n}_hi"), t.dtype)[1], t.dtype)
               for n in ("x0", "x")]
    more = z.directions if n_y > 2 else z.directions[:0]
    best = "a the root of the ratio of the traces"
    return TraceView(
        numbers=len(t.box) ** 2,
        sizes=(Size("NSHAPE", f"({m}_NX * {m}_NX)", "numbers of the error set"),
               Size("TANGENTS", f"{len(z.a)}U", "bounds that a square root starts from, the least counts"),
               Size("HERON", f"{STEPS}U", "steps to the square root from there"),
               Size("ORIGINS", f"{t.origins}U", "noise in the estimate: that of each mode's gain, or none"
                    if tnl else "the estimate never holds noise of its own sample")),
        last=names.last if len(t.A) > 1 else "0U",
        origin=f"(s->origin < {m}_ORIGINS) ? s->origin : 0U" if tnl else "0U",
        forget=(f"s->origin = {m}_MODES;",) * tnl, start=vector("square", squares[0], "NX"),
        whole=vector("square", squares[1], "NX"), limit=vector("limit", t.limit, "NX"),
        weight=vector("weight", z.weight, "NX"), spread=rows("spread", z.spread, f"[{m}_ORIGINS][{m}_NX]"),
        slopes=vector("slope", z.a, "TANGENTS"), offsets=vector("offset", z.b, "TANGENTS"),
        scale=vector("scale", z.scale, "NX"), scale_y=vector("scale", z.scale_y, "NY"),
        steps=(form("set_forward", (f"X = (1 + 1/a) (M X M' + rounding) + (1 + a) H, {best}: after a measured step",),
                    "M", t.M, z.H, z.r, z.k, z.weight, "NX", ("s->origin = p;",) * tnl),
               form("set_blind", (f"X = (1 + 1/a) (A X A' + rounding) + (1 + a) H, {best}: without measurement",),
                    "A", t.A, z.Hb, z.rb, z.kb, z.weight, "NX", (f"s->origin = {m}_MODES;",) * tnl)),
        output=form("outside", (f"R = (1 + 1/a) (C X C' + rounding) + (1 + a) V, {best}; bounds of the residuals,",
                                "and bits of what cannot happen without a fault."), "C", t.C, z.V, z.rv, z.kr,
                    z.weight_y, "NY", ()),
        two=(f"{m}_BIT_TOGETHER",) * (n_y == 2),
        by_table=(rows("direction", more, f"[{len(more)}U][{m}_NY]"),) * bool(len(more)), one=literal(1.0, real),
        half=literal(0.5, real), least=literal(z.least, real), slack=literal(z.slack, real),
        floor=literal(z.floor, real))


def operations(t) -> Operations:
    """Count the dearest sample: as with fixed weights, but for the roots."""
    n, n_y, tangents = len(t.box), t.C.shape[1], len(t.shape.a)
    out = Operations(0, 0, 0)
    for r in (n, n_y):  # A X, its product with A', both factors, the diagonal, two traces, the weight of a root
        carried, entries = r * n * n + n, r * (r + 1) // 2
        out += Operations(carried + entries * (n + 2) + 2 * r + 1, carried + entries * (n + 1) + 2 * r + 2, 0, 1)
    roots = 2 * n + n_y
    out += Operations(2 * roots, 2 * n, 2 * roots)
    roots += 2
    out += Operations(roots * (tangents + STEPS), roots * (tangents + STEPS), roots * tangents, roots * STEPS)
    return out + membership(t)
