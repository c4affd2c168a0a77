"""Filters beside a mode estimator in a view: the estimator's part, and the maps of the filters for a given mode."""

from __future__ import annotations

from dataclasses import dataclass, replace

from . import filter_parts, mode_parts
from .cprint import initialiser, literal
from .families import Member, Word, state_layout
from .layouts import lay_out
from .manual import Channel
from .maps import MapSpec, Names, Table
from .mode_parts import ModeView
from .parts import Field, Operations, Parts, Size, vector_table


@dataclass(frozen=True)
class TrailingView(ModeView):
    """Beside the estimator's: the faults, the tables of thresholds and limits, and what a start needs.

    ``row`` is the row of the thresholds that counts, ``stays`` the condition under which a filter goes on.
    """

    faults: tuple[Channel, ...]
    thresholds: Table
    told_limit: Table
    begin: tuple[Table, ...]
    middle: str
    grow: str
    floor: str
    row: str
    stays: str


def parts(t, s, names: Names, signals: tuple, layout: str, faults: tuple[Channel, ...]) -> Parts:
    """Decide what is the filters' own.

    Parameters
    ----------
    t : TrailingTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks and of the filters' maps; the boxes are loops over tables in each.
    faults : tuple of Channel

    Returns
    -------
    Parts
    """
    m, real, own = names.macro, names.real_type, t.told
    estimator = mode_parts.parts("mode", t, s, names, signals, layout)
    views = tuple(lay_out(spec, layout) for spec in maps(own, replace(names, checked=True), faults))
    count = len(own.M) * len(own.limit)
    numbers: list[Member] = [f for f in estimator.state.members if f[1] in ("box_lo", "box_hi")]
    numbers.append((real, "told_xi", f"[{m}_NXI]", (f"states of the filters, {m}_NS numbers per mode",)))
    numbers += [f for f in estimator.state.members if f[1] == "alive"]
    numbers += [("uint32_t", "told_stage", f"[{m}_MODES]", ("how the filter of a mode started: size of the box, or "
                                                            f"{m}_ANYWHERE",)),
                ("uint32_t", "told_since", f"[{m}_MODES]", (f"samples since then, 0 to {m}_LAST",))]
    words: list[Word] = [("decided", "0U", "mode of the last answer"),
                         ("settled", "0U", f"last one that may have been active since {m}_OLDEST samples"),
                         ("running", "0U", "bit q: the filter of mode q is within its thresholds unless a fault acts")]
    boxes = next(n for name, n in estimator.lengths if name == "NSHAPE")
    state = state_layout(names, s, 1, numbers, 2 * boxes + count, [f"s->told_xi[{i}]" for i in range(count)], words,
                         extra=3 * len(own.M))
    cleared = tuple(f"s->told_{name}[{q}] = 0U;" for name in ("stage", "since") for q in range(len(own.M)))
    out = tuple(Field(real, name, f"[{m}_NF]", (note,)) for name, note in (
        ("f_hat", "estimates of the faults in out->mode; 0 after predict"),
        ("f_bound", "largest magnitude of f_hat without a fault where out->mode is true; 0 after predict")))
    lengths = (("NXI", count), ("NS", len(own.limit)), ("NF", len(faults)))
    quiet = [*["(s->hold != 0U)"] * s.counts_hold, *["(s->latched != 0U)"] * s.latch]
    stays = " || ".join(["((alive & 1U) == 0U)", *quiet])
    view = _view(estimator.sets[0], own, names, faults, count, stays)
    cost = Operations(*(int(len(own.M) * x) for x in sum(2 * v.operations for v in views)))
    return replace(estimator, noun="boxes", header="trailing.h.jinja", self_test="harness/test_trailing.c.jinja",
                   maps=views, state=replace(state, clear=(*state.clear, *cleared)),
                   out_fields=(*estimator.out_fields[:4], *out, *estimator.out_fields[4:]),
                   operations=estimator.operations + cost + _more(t), sets=(view,),
                   lengths=(*estimator.lengths, *lengths))


def maps(told, names: Names, faults: tuple[Channel, ...]) -> tuple[MapSpec, ...]:
    """Estimate and step of the filter of mode q, whose state begins at xi."""
    p, out = names.prefix, []
    for spec, target in zip(filter_parts.maps(told, names, faults), ("f_hat", "next")):
        out.append(replace(spec, parameters=(f"const {p}_real *xi", f"const {p}_in *in", "uint32_t mode",
                                             f"{p}_real *{target}"), selector="mode", index="mode", target_lo=target,
                           target_hi=target, state=replace(spec.state, operand="xi")))
    return tuple(out)


def _view(mode: ModeView, t, names: Names, faults: tuple[Channel, ...], count: int, stays: str) -> TrailingView:
    """Print the tables of the filters beside those of the estimator."""
    m, real = names.macro, t.real
    def table(name: str, size: str, values) -> Table:
        return Table(name, size, (), tuple(f"{initialiser(row, real)}," for row in values))

    begin = (table("E", f"[{m}_MODES][{m}_NS][{m}_NX]", t.E), table("largest", f"[{m}_SIZES][{m}_NX]", t.sizes),
             vector_table("least", f"{m}_NX", t.x_lo, real), vector_table("most", f"{m}_NX", t.x_hi, real))
    own = (Size("NXI", f"{count}U", "states of the filters of all modes"),
           Size("SIZES", f"{t.anywhere}U", "sizes of a box from which a filter starts, the largest first"))
    return TrailingView(
        **vars(mode) | {"sizes": (*mode.sizes, *sizes(t, own))}, faults=faults, thresholds=thresholds(t, m),
        told_limit=vector_table("limit", f"{m}_NS", t.limit, real), begin=begin, middle=literal(0.5, real),
        grow=literal(t.grow, real), floor=literal(t.floor, real),
        row=row(t, "s->told_since[q]"), stays=stays)


def sizes(told, more: tuple[Size, ...] = ()) -> tuple[Size, ...]:
    """Sizes of filters that start at run time; ``more`` behind those of a filter."""
    return (Size("NS", f"{len(told.limit)}U", "states of a filter"), Size("NF", f"{told.K.shape[1]}U", "faults"), *more,
            Size("ANYWHERE", f"{told.anywhere}U", "s->told_stage of a filter that goes on from anywhere"),
            Size("STAGES", f"{told.anywhere + 1}U", "ways to start"),
            Size("ROWS", f"{told.h.shape[1]}U", "rows of thresholds after a start; the last holds for ever"),
            Size("LAST", f"{told.last}U", "s->told_since once the last row holds"))


def row(told, since: str) -> str:
    """The row of the thresholds that counts, so many samples since the start."""
    return f"({since} >> {told.shift}U)" if told.shift else since


def thresholds(told, macro: str) -> Table:
    """Print the thresholds of filters that start at run time, by how and how long ago."""
    lines: list[str] = []
    for stage, rows in enumerate(told.h):
        lines.append(f"{{ /* {'size ' + str(stage) if stage < told.anywhere else 'anywhere'} */")
        lines += [f"    {initialiser(row, told.real)}," for row in rows]
        lines.append("},")
    return Table("threshold", f"[{macro}_STAGES][{macro}_ROWS][{macro}_MODES][{macro}_NF]", (), tuple(lines))


def _more(t) -> Operations:
    """Count what joins both in the dearest sample, which starts every filter."""
    (n_modes, n, _, _), ages, own = t.sizes, t.ages + 1, t.told
    n_s, n_f = len(own.limit), own.K.shape[1]
    return Operations(multiply=n_modes * (2 * n * n * ages + 3 * n + n_s * n),
                      add=n_modes * (2 * n * n * ages + 2 * n * ages + 4 * n + n_s * n),
                      compare=n_modes * (n * n * ages + 2 * n * ages + 5 * n + n * own.anywhere + 4 * n_f + 2 * n_s))
