"""A filter that sliding modes guide, in a view: the estimator's part, the maps of the filters, their starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from . import guided_parts, sliding_parts, trailing_parts
from .cprint import initialiser, macro_names
from .families import Word, state_layout
from .layouts import lay_out
from .manual import Bit, Channel
from .maps import Names, Table
from .parts import Field, Operations, Parts, vector_table
from .sliding_parts import SlidingView


@dataclass(frozen=True)
class GuidedFilterView(SlidingView):
    """Beside the estimator's: the faults, thresholds and limits of the filters, their states at a start.

    ``row`` is the row of the thresholds that counts.
    """

    faults: tuple[Channel, ...]
    thresholds: Table
    told_limit: Table
    begun: Table
    row: str


def parts(t, s, names: Names, signals: tuple, layout: str, faults: tuple[Channel, ...]) -> Parts:
    """Decide what is the guided filter's own.

    Parameters
    ----------
    t : GuidedFilterTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks and of the filters' maps; the pairs are loops over tables in each.
    faults : tuple of Channel

    Returns
    -------
    Parts
    """
    m, real, own = names.macro, names.real_type, t.told
    estimator = sliding_parts.parts("sliding", t, s, names, signals, layout)
    views = tuple(lay_out(spec, layout) for spec in trailing_parts.maps(own, replace(names, checked=True), faults))
    numbers, words, kept = sliding_parts.members(t, names)
    numbers.append((real, "told_xi", f"[{m}_NS]", ("state of the filter of the mode in decided",)))
    more: list[Word] = [("told_stage", "0U", f"how it started: 0 from the declared range, {m}_ANYWHERE from anywhere"),
                        ("told_since", "0U", f"samples since then, 0 to {m}_LAST")]
    kept += [f"s->told_xi[{i}]" for i in range(len(own.limit))]
    stems = macro_names((c.name for c in faults), ["TWICE"])
    bits = (*estimator.bits, *(Bit(stem, f"0x{2 << c.index:X}U", f"estimate of {c.name} beyond its bound in out->mode")
                               for c, stem in zip(faults, stems)))
    out = [Field(*f) for f in guided_parts.out_fields(names)]
    out[4:4] = [Field(real, name, f"[{m}_NF]", (note,)) for name, note in (
        ("f_hat", "estimates of the faults in out->mode; 0 after predict"),
        ("f_bound", "largest magnitude of f_hat without a fault while out->mode is right; 0 after predict"))]
    view = GuidedFilterView(
        **vars(estimator.sets[0]) | {"sizes": (*estimator.sets[0].sizes, *trailing_parts.sizes(own))}, faults=faults,
        thresholds=trailing_parts.thresholds(own, m), told_limit=vector_table("limit", f"{m}_NS", own.limit, t.real),
        begun=Table("begun", f"[{m}_MODES][{m}_NS]", (), tuple(f"{initialiser(row, t.real)}," for row in t.begun)),
        row=trailing_parts.row(own, "s->told_since"))
    count = 2 * t.sizes[0] * t.sizes[1] + 2 * t.sizes[1] + len(kept)
    multiply, add, compare = (int(x) for x in sum(v.operations for v in views))
    return replace(estimator, header="guided_filter.h.jinja", self_test="harness/test_guided_filter.c.jinja",
                   bits=bits, maps=views, state=state_layout(names, s, len(bits), numbers, count, kept, words + more),
                   out_fields=tuple(out), sets=(view,), operations=estimator.operations + Operations(
                       multiply, add, compare + 2 * (len(faults) + len(own.limit))),
                   lengths=(*estimator.lengths, ("NS", len(own.limit)), ("NF", len(faults))))
