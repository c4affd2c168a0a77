"""The set of a point observer carried on from block to block, as C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .families import Member, Word
from .maps import Names, Table
from .parts import Operations, Size
from .threshold_parts import limit_of, others_of

Array = np.ndarray


@dataclass(frozen=True)
class BlockView:
    """Sizes and tables of each function, statements where modes or origins differ.

    ``last`` finds the mode of the last sample where there are several; ``block``, ``before`` and ``origin`` are
    expressions of the block's mode, of the origin of the estimate at its start and of that at this sample; ``started``
    and ``forget`` keep or clear them, ``ends`` is when a block does; ``others`` has an entry where there are directions
    beside the outputs.
    """

    numbers: int
    sizes: tuple[Size, ...]
    block: str
    before: str
    origin: str
    last: tuple[str, ...]
    begun: tuple[str, ...]
    started: tuple[str, ...]
    forget: tuple[str, ...]
    anew: tuple[str, ...]
    moved: tuple[str, ...]
    ends: str
    start: Table
    anywhere: Table
    weight: Table
    rounding: Table
    most: Table
    powers: tuple[Table, ...]
    reach: tuple[Table, ...]
    limit: tuple[Table, ...]
    by_table: tuple[Table, ...]
    compares: int


def view(t, names: Names) -> BlockView:
    """Print the tables."""
    z, m, real, several, tnl = t.shape, names.macro, t.real, len(t.A) > 1, t.kind == "tnl"
    n, columns, kept = len(t.box), z.order + z.pushed.shape[4], z.order - len(t.box)

    def vector(name: str, values: Array) -> Table:
        return Table(name, f"[{m}_NX]", (), (initialiser(values, real).strip("{} ") + ",",))

    def table(name: str, values: Array, sizes: tuple[str, ...]) -> Table:
        return Table(name, "".join(f"[{m}_{s}]" for s in sizes), (), tuple(nested(values)))

    def nested(values: Array) -> list[str]:
        """Braces as deep as the axes, a vector to a line."""
        if values.ndim == 1:
            return [f"{initialiser(values, real)},"]
        return [line for v in values for line in (
            nested(v) if v.ndim == 1 else ["{", *(f"    {x}" for x in nested(v)), "},"])]

    pushed = z.pushed.swapaxes(3, 4)  # one generator after the other
    return BlockView(
        numbers=n * z.order,
        sizes=(Size("LONGEST", f"{z.longest}U", "samples in a block at most"),
               Size("ORDER", f"{z.order}U", "generators of the set at the start of a block"),
               Size("KEPT", f"{kept}U", "of them kept by a reduction, the others are a box"),
               Size("ADDED", f"{z.pushed.shape[4]}U", "generators that a block adds"),
               Size("COLUMNS", f"({m}_ORDER + {m}_ADDED)", "generators before the reduction"),
               Size("ORIGINS", f"{t.origins}U", "noise in the estimate: that of each mode's gain, or none"
                    if tnl else "the estimate never holds noise of its own sample"),
               Size("DIRECTIONS", f"{len(z.directions)}U",
                    "directions in which the residual has a threshold; the outputs first"),
               Size("REACHES", f"({m}_DIRECTIONS + {m}_NX)", "bounds: in these directions, then of the states"),
               Size("NSHAPE", f"({m}_NX * {m}_ORDER)", "numbers of the set")),
        block=f"(s->block < {m}_MODES) ? s->block : 0U" if several else "0U",
        before=f"(s->before < {m}_ORIGINS) ? s->before : 0U" if tnl else "0U",
        origin=f"(s->origin < {m}_ORIGINS) ? s->origin : 0U" if tnl else "0U",
        begun=("s->before = s->origin;",) * tnl, started=("s->block = p;",) * several,
        forget=("s->block = 0U;",) * several + (f"s->before = {m}_MODES;", f"s->origin = {m}_MODES;") * tnl,
        anew=(f"s->before = {m}_MODES;",) * tnl,
        last=(f"const uint32_t p = (s->mode < {m}_MODES) ? s->mode : 0U;",) * several,
        moved=("s->origin = p;" if several else "s->origin = 0U;",) * tnl,
        ends=(f"(p != s->block) || (s->since >= {m}_LONGEST)" if several else f"s->since >= {m}_LONGEST"),
        start=vector("half", z.start), anywhere=vector("half", z.anywhere), weight=vector("weight", z.weight),
        rounding=vector("rounding", z.e), most=vector("most", z.most),
        powers=(table("power", z.powers, ("MODES", "LONGEST", "NX", "NX")),
                table("added", pushed, ("ORIGINS", "MODES", "LONGEST", "ADDED", "NX"))),
        reach=(Table("factor", f"[{m}_MODES][{m}_LONGEST + 1U][{m}_REACHES][{m}_NX]", (), tuple(nested(z.rows))),
               Table("added", f"[{m}_ORIGINS][{m}_MODES][{m}_LONGEST + 1U][{m}_REACHES]", (), tuple(nested(z.scalars))),
               table("noise", z.noise, ("ORIGINS", "MODES", "REACHES"))),
        limit=(limit_of(t, m), vector("wide", z.wide)), by_table=others_of(t, m),
        compares=kept * columns - kept * (kept + 1) // 2)


def state(t, names: Names) -> tuple[list[Member], list[Word], int]:
    """Numbers and words of the state, and how many numbers."""
    m, tnl = names.macro, t.kind == "tnl"
    words: list[Word] = [("block", "", "mode of the block")] * (len(t.A) > 1)
    words += [("before", "", f"mode whose gain put noise into x_hat at the block's start; {m}_MODES: none is in"),
              ("origin", "", "the same of this sample")] * tnl
    words.append(("since", "", f"samples since the block's start, 0 to {t.shape.longest}"))
    numbers = [(names.real_type, "shape", f"[{m}_NSHAPE]",
                (f"of the set at the block's start, {m}_NX numbers each, one generator after the other",))]
    return numbers, words, t.shape.order * len(t.box)


def operations(t) -> Operations:
    """Count the dearest sample: a block ends, and the bounds of x are formed twice because the set starts anew."""
    z, n, n_y = t.shape, len(t.box), t.C.shape[1]
    columns, kept, others = z.order + z.pushed.shape[4], z.order - n, len(z.directions) - n_y
    reaches = z.rows.shape[2] + n
    multiply = reaches * n * z.order + n * n * z.order + 2 * n * columns + others * n_y
    add = (reaches * (n * z.order + z.order + 1) + n * n * z.order + n * columns + n * (columns - kept) + n * z.order
           + others * n_y)
    compares = kept * columns - kept * (kept + 1) // 2 + n * (columns - kept) + reaches * z.order + n * z.order
    return Operations(multiply, add, compares + 4 * n + 2 * n_y + 2 * others)
