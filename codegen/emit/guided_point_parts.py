"""A point observer that sliding modes guide, in a view: the estimator's part, and the observer as inner C."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..observers.supervisor import Supervision
from . import guided_parts, point_parts, sliding_parts
from .cprint import macro_names
from .driven_parts import Copy
from .families import state_layout
from .follower_parts import held, inner_c, inner_names
from .manual import Bit
from .maps import Names, Table
from .parts import Field, Operations, Parts, Size, vector_table
from .sliding_parts import SlidingView


@dataclass(frozen=True)
class GuidedPointView(SlidingView):
    """Beside the estimator's: the inner C of the observer, and what of its state is kept.

    ``copies`` and ``words`` are lent to it, ``carried`` are vectors that it gives back; ``reads`` are arguments of its
    bounds beside its state; ``begun`` starts a table from the declared range, whose half widths are in ``widest``.
    """

    told: str
    copies: tuple[Copy, ...]
    carried: tuple[Copy, ...]
    words: tuple[str, ...]
    reads: str
    widest: tuple[Table, ...]
    begun: tuple[str, ...]


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the guided point observer's own.

    Parameters
    ----------
    family : {"guided_point"}
    t : GuidedPointTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks and of the observer's maps; the pairs are loops over tables in each.

    Returns
    -------
    Parts
    """
    m, real, (x, u, y, _) = names.macro, names.real_type, signals
    own = sliding_parts.parts("sliding", t, s, names, signals, layout)
    told = point_parts.parts(t.set, t.told, Supervision(), inner_names(names), signals, layout)
    numbers, words, kept = sliding_parts.members(t, names)
    rest = held(told, t, names, signals)
    stems = (*macro_names((c.name for c in y), ["TWICE", "TOGETHER", "CROSSED"]), "TOGETHER")
    bits = (*own.bits, *(Bit(stem, f"0x{2 << i:X}U", f"{b.text} in out->mode")
                         for i, (stem, b) in enumerate(zip(stems, told.bits))))
    bits += (Bit("CROSSED", f"0x{1 << len(bits):X}U", "a lower bound in out->mode above the upper one"),)
    count = 2 * t.sizes[0] * t.sizes[1] + 2 * len(x) + len(kept) + len(rest.clear)
    state = state_layout(names, s, len(bits), numbers + rest.members, count, kept + rest.clear, words + rest.initial)
    size = (Size("NTOLD", f"{rest.shape}U", "numbers of the error set"),) * bool(rest.shape)
    view = GuidedPointView(
        **vars(own.sets[0]) | {"sizes": (*own.sets[0].sizes, *size)}, told=inner_c(told, t, names, u),
        copies=rest.vectors, carried=rest.carried, words=rest.words, reads="&given, " * t.by_table,
        widest=(vector_table("widest", f"{m}_NX", t.widest, t.real),) * t.by_table,
        begun=(f"{names.prefix}_told_set_box(&held, widest);",) * t.by_table)
    out = (Field(real, "x_hat", f"[{m}_NX]", ("estimate of x at this sample, in out->mode",)),
           *(Field(*f) for f in guided_parts.out_fields(names)))
    return replace(own, header="guided_point.h.jinja", self_test="harness/test_guided_point.c.jinja", bits=bits,
                   out_fields=out, state=state,
                   operations=own.operations + told.operations + Operations(0, 2 * len(y), 3 * len(x)), sets=(view,),
                   lengths=(*own.lengths, *(("NTOLD", rest.shape),) * bool(rest.shape)))
