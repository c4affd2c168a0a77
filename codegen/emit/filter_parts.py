"""A fault estimation filter as C: its maps, table of thresholds, members."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser, macro_names
from .families import Member, Word, mode_word, state_layout
from .layouts import lay_out
from .manual import FILTERS, Bit, Channel
from .maps import Linear, MapSpec, Names, Table
from .parts import Field, Move, Operations, Parts, Size, assign

Array = np.ndarray


@dataclass(frozen=True)
class FilterView:
    """Sizes, faults, tables; ``row`` is the row that counts, ``again`` and ``known`` are conditions: the table starts
    anew, the plant's set holds. ``what`` is what the firmware does, ``lost`` what holds after a lost sample.
    """

    sizes: tuple[Size, ...]
    faults: tuple[Channel, ...]
    thresholds: Table
    limit: Table
    row: str
    again: str
    known: str
    what: tuple[str, ...]
    lost: tuple[str, ...]


#: What an estimate, its bound and a lost sample mean, of thresholds that are guaranteed, and that are calibrated.
WHAT = (("At every sample it takes the inputs, the measurements and the mode, and answers with an estimate of each",
         "fault, with the largest estimate that is possible without a fault, and with alarm bits. An estimate beyond",
         "that bound cannot happen without a fault. The estimate goes on while a fault lasts."),
        ("At every sample it takes the inputs, the measurements and the mode, and answers with an estimate of each",
         "fault, with its threshold, and with alarm bits. THE THRESHOLDS ARE CALIBRATED: without a fault an estimate",
         "rarely exceeds them, but it may; assured is always 0. The estimate goes on while a fault lasts."))
LOST = (("bounds of the next estimates are higher for a while and stay guaranteed. There is no estimate: "
         "f_hat, f_bound, raw",
         "and alarm are 0, and the alarm's debounce and latch stand still."),
        ("thresholds of the next estimates are higher for a while. There is no estimate: f_hat, f_bound, raw and alarm",
         "are 0, and the alarm's debounce and latch stand still."))
BOUND = ("largest magnitude of f_hat without a fault; 0 after predict",
         "threshold of |f_hat|, calibrated; 0 after predict")
ASSURED = ("1: the bounds and alarms of this sample are guaranteed; 0: they are not",
           "0: the thresholds are calibrated, not guaranteed")


def maps(t, names: Names, faults) -> tuple[MapSpec, MapSpec]:
    """State the estimate and the filter's step."""
    p, m = names.prefix, names.macro
    n, n_s = t.M.shape[:2]

    def linear(name, value, operand, count):
        return Linear(name, value, value, operand, f"{m}_{count}")

    def inputs(of_u: str, of_y: str):
        u, y = getattr(t, of_u), getattr(t, of_y)
        return (*((linear(of_u, u, "in->u", "NU"),) if u.shape[2] else ()), linear(of_y, y, "in->y", "NY"))

    def zero(rows: int) -> Linear:
        nothing = np.zeros((n, rows), t.dtype)
        return Linear("zero", nothing, nothing)

    common = {"names": names, "shared": True, "by_sign": False, "minus": "", "sides": ("",), "selector": "in->mode",
              "index": "in->mode", "tail": ()}
    estimate = MapSpec(
        f"{p}_estimate", ("f_hat = Du u + Dy y + K xi" if t.G.shape[2] else "f_hat = Dy y + K xi",),
        (f"const {p}_state *s", f"const {p}_in *in", f"{p}_out *out"), target_lo="out->f_hat", target_hi="out->f_hat",
        rows=tuple(f"f_hat[{c.index}] {c.name}" for c in faults), common=inputs("Du", "Dy"), offset=zero(len(faults)),
        state=linear("K", t.K, "s->xi", "NS"), row_count=f"{m}_NF", **common)
    forward = MapSpec(
        f"{p}_forward", ("xi+ = G u + L y + M xi" if t.G.shape[2] else "xi+ = L y + M xi",),
        (f"const {p}_state *s", f"const {p}_in *in", f"{p}_real *next"), target_lo="next", target_hi="next",
        rows=tuple(f"xi[{i}]" for i in range(n_s)), common=inputs("G", "L"), offset=zero(n_s),
        state=linear("M", t.M, "s->xi", "NS"), row_count=f"{m}_NS", **common)
    return estimate, forward


def parts(t, s, names: Names, signals: tuple, layout: str, faults: tuple[Channel, ...]) -> Parts:
    """Decide what is the filter's own.

    Parameters
    ----------
    t : FilterTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
    faults : tuple of Channel

    Returns
    -------
    Parts
    """
    _, u, y, _ = signals
    p, m, real = names.prefix, names.macro, names.real_type
    rows, modes, n_f = t.h.shape
    n_s = t.M.shape[1]
    views = tuple(lay_out(spec, layout) for spec in maps(t, names, faults))
    words: list[Word] = [mode_word(m)] if s.monitors_dwell else []
    words.append(("since", "", f"samples since a start of the table of thresholds, 0 to {(rows - 1) << t.shift}"))
    numbers: list[Member] = [(real, "xi", f"[{m}_NS]", ("state of the filter",))]
    kind = int(not s.assures)
    bits = tuple(Bit(stem, f"0x{1 << c.index:X}U", f"estimate of {c.name} beyond its bound")
                 for c, stem in zip(faults, macro_names(c.name for c in faults)))
    begin = assign("s->xi", np.zeros(n_s, t.dtype), t.real)
    out = ((real, "f_hat", f"[{m}_NF]", ("estimates of the faults; 0 after predict",)),
           (real, "f_bound", f"[{m}_NF]", (BOUND[kind],)),
           ("uint32_t", "raw", "", (f"{m}_BIT_ of what is beyond its bound at this sample; 0 after predict",)),
           ("uint32_t", "alarm", "", ("the same after the debounce; 0 after predict",)),
           ("uint32_t", "latched", "", ("alarm bits as kept; act on these",)),
           ("uint32_t", "assured", "", (ASSURED[kind],)))
    fast = " || (s->too_fast != 0U)" if s.monitors_dwell else ""
    operations = sum(v.operations for v in views) + [0, 0, 2 * (len(u) + len(y) + n_s + n_f)]
    lines = [f"{initialiser(row, t.real)}," for row in t.h]
    each = f", {1 << t.shift} samples each" if t.shift else ""
    notes = {0: f"from anywhere{each}", t.lost: f"after a sample without measurement{each}", rows - 1: "for ever"}
    thresholds = tuple(line for k, row in enumerate(lines)
                       for line in ([f"/* {notes[k]} */"] if k in notes else []) + [row])
    view = FilterView(
        sizes=(Size("NS", f"{n_s}U", "states of the filter"), Size("NF", f"{n_f}U", "faults"),
               Size("ROWS", f"{rows}U", "rows of the table of thresholds; the last holds for ever"),
               Size("LOST", f"{t.lost << t.shift}U", "s->since after a sample without measurement"),
               Size("LAST", f"{(rows - 1) << t.shift}U", "s->since once the last row holds")),
        faults=faults, thresholds=Table("threshold", f"[{m}_ROWS][{m}_MODES][{m}_NF]", (), thresholds),
        limit=Table("limit", f"[{m}_NS]", (), (initialiser(t.limit, t.real).strip("{} ") + ",",)),
        row=f"(s->since >> {t.shift}U)" if t.shift else "s->since", again=f"(again && (out->raw == 0U)){fast}",
        known=f"(s->since >= {m}_LOST)" + (" && (s->too_fast == 0U)" if s.monitors_dwell else ""),
        what=WHAT[kind], lost=LOST[kind])
    return Parts(
        noun=FILTERS, header="filter.h.jinja", self_test="harness/test_filter.c.jinja", bits=bits, maps=views,
        state=state_layout(names, s, n_f, numbers, n_s, [], words), out_fields=tuple(Field(*f) for f in out),
        operations=Operations(*operations.tolist()), cuts=(),
        start=(*begin, f"s->since = {t.start << t.shift}U;"), whole_range=(*begin, "s->since = 0U;"), crossed=(),
        late=(),
        move=Move(f"{p}_forward(s, in, next);", "", f"{p}_estimate(s, in, out);"), sets=(view,),
        lengths=(("NS", n_s), ("NF", n_f)))
