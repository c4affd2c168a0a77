"""A mode estimator by sliding modes in a view: tables of what its template loops over, members of its structs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.ellipsoid_trace import STEPS
from ..observers.sliding import OLDEST
from .cprint import initialiser, literal
from .families import Member, Word, state_layout
from .manual import PAIRS, Bit
from .maps import Names, Table
from .parts import Field, Move, Operations, Parts, Size, vector_table

Array = np.ndarray


@dataclass(frozen=True)
class Side:
    """One bound of every pair: "hi" or "lo", its tables."""

    name: str
    K: Table
    tables: tuple[Table, ...]


@dataclass(frozen=True)
class SlidingView:
    """Sizes, tables of each function, numbers.

    ``feeds`` is D where it is not zero, ``driven`` what inputs do in a period; ``unread`` the parameter that is not
    read without inputs.
    """

    sizes: tuple[Size, ...]
    sides: tuple[Side, ...]
    H: Table
    noise: tuple[Table, ...]
    feeds: tuple[Table, ...]
    driven: tuple[Table, ...]
    start: tuple[Table, ...]
    wide: tuple[Table, ...]
    limit: Table
    z_limit: Table
    rate_limit: Table
    tangents: tuple[Table, ...]
    numbers: tuple[Size, ...]
    half: str
    one: str
    unread: tuple[str, ...]


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the mode estimator's own.

    Parameters
    ----------
    family : {"sliding"}
    t : SlidingTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks; everything else is loops over tables in each.

    Returns
    -------
    Parts
    """
    modes, n, _, p = t.sizes
    numbers, words, kept = members(t, names)
    return Parts(
        noun=PAIRS, header="sliding.h.jinja", self_test="harness/test_sliding.c.jinja",
        bits=(Bit("TWICE", "0x1U", "two changes of the mode within its dwell time: a fault"),), maps=(),
        state=state_layout(names, s, 1, numbers, 2 * modes * n + 2 * n + len(kept), kept, words),
        out_fields=tuple(Field(*f) for f in out_fields(names)), operations=operations(t), cuts=(), start=(),
        whole_range=(), crossed=(), late=(), move=Move("", ""), sets=(view(t, names),),
        lengths=(("NSHAPE", modes * n), ("NTWIST", modes * p)), told=False)


def members(t, names: Names) -> tuple[list[Member], list[Word], list[str]]:
    """Vectors of numbers of the state, its words, and the numbers that ``clear`` sets to zero."""
    m, real, (modes, _, _, p) = names.macro, names.real_type, t.sizes
    bounds = {"lo": "lower", "hi": "upper"}
    numbers: list[Member] = [
        *((real, f"box_{k}", f"[{m}_NSHAPE]", (f"{w} bounds of x by mode: right while it is active",))
          for k, w in bounds.items()),
        *((real, f"shown_{k}", f"[{m}_NX]", (f"{w} bounds of x that are answered",)) for k, w in bounds.items()),
        *((real, f"twist_{k}", f"[{m}_NTWIST]", (f"sliding variables of the {w} bounds, about s - C x",))
          for k, w in bounds.items()),
        *((real, f"rate_{k}", f"[{m}_NTWIST]", (f"rates of s beyond those of the {w} bounds, 1/s",))
          for k, w in bounds.items()),
        (real, "level", f"[{m}_MODES]", ("means of the magnitudes of the rates, by mode",))]
    words: list[Word] = [
        ("decided", "0U", "mode of the last answer"), ("best", "0U", "candidate: mode of the least level"),
        ("age", "", f"samples since the last detection, to {OLDEST}"),
        ("since", "", f"samples since the span of time began, below {t.dwell}"),
        ("last", "", "length of the span before, if the mode has changed in it; 0: it has not, surely"),
        ("fresh", "", "bit q: the sliding variables of mode q begin at the next sample"),
        ("armed", "", "bit q: the pair of mode q has begun within the span"),
        ("refuted", "", "bit q: mode q was not active throughout the span")]
    kept = [f"s->{name}[{i}]" for name, count in (("twist_lo", modes * p), ("twist_hi", modes * p),
                                                   ("rate_lo", modes * p), ("rate_hi", modes * p), ("level", modes))
            for i in range(count)]
    return numbers, words, kept


def out_fields(names: Names) -> tuple[Member, ...]:
    """Members of the output struct."""
    m, real, word = names.macro, names.real_type, "uint32_t"
    return ((real, "x_lo", f"[{m}_NX]", ("lower bounds of x at this sample, while out->mode is right",)),
            (real, "x_hi", f"[{m}_NX]", ("upper bounds of x at this sample",)),
            (real, "r_lo", f"[{m}_NY]", ("least y that these expect, minus y; 0 after predict",)),
            (real, "r_hi", f"[{m}_NY]", ("largest y that these expect, minus y; 0 after predict",)),
            (word, "mode", "", ("the decision; nothing is proved of it",)),
            (word, "mode_set", "", ("bit q: the test of mode q holds at this sample; the true one's may fail",)),
            (word, "candidate", "", ("the mode of the least rates; out->mode follows it after a detection",)),
            (word, "age", "", (f"samples since a detection, to {OLDEST}; to {m}_BLANK: mode is the last one",)),
            (word, "raw", "", (f"{m}_BIT_TWICE where the mode has surely changed twice within its dwell time",)),
            (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
            (word, "latched", "", ("alarm bits as kept; act on these",)),
            (word, "assured", "", ("0 always: the decision is not guaranteed",)))


def view(t, names: Names) -> SlidingView:
    """Print the tables."""
    m, real, (n_modes, n, n_u, p) = names.macro, t.real, t.sizes

    def matrix(name: str, size: str, values: Array) -> Table:
        return Table(name, size, (), tuple(f"{initialiser(row, real)}," for row in values))

    def by_mode(name: str, values: Array, size: str) -> Table:
        lines: list[str] = []
        for value, label in zip(values, names.modes):
            if value.ndim == 1:
                lines.append(f"{initialiser(value, real)}, /* {label} */")
            else:
                lines += [f"{{ /* {label} */", *(f"    {initialiser(row, real)}," for row in value), "},"]
        return Table(name, f"[{m}_MODES]{size}", (), tuple(lines))

    def vector(name: str, values: Array, length: str = "NX") -> Table:
        return vector_table(name, f"{m}_{length}", values, real)

    x, xx, xy, yy = f"[{m}_NX]", f"[{m}_NX][{m}_NX]", f"[{m}_NX][{m}_NY]", f"[{m}_NY][{m}_NY]"
    sides = tuple(Side(side, by_mode("K", getattr(t, f"K_{side}"), yy), (
        by_mode("M", getattr(t, f"M_{side}"), xx), by_mode("L", getattr(t, f"L_{side}"), xy),
        by_mode("d", getattr(t, f"d_{side}"), x))) for side in ("lo", "hi"))
    constants = (("PERIOD", t.period, "tau"), ("TURN", t.turn, "tau k2"), ("PULL", t.pull, "tau k1"),
                 ("GROUND", t.ground, "h = tau^2 k2"), ("INVERSE", t.inverse, "1 / h"),
                 ("FOOT", t.foot, "root of h"), ("SMOOTH", t.smooth, "part of a sample in the mean of the rates"),
                 ("SHARE", t.share, "of the candidate's mean, below which another is the candidate"))
    return SlidingView(
        sizes=(Size("BLANK", f"{t.blank}U", "samples after a detection at which the decision stands still"),
               Size("DWELL", f"{t.dwell}U", "samples that a mode lasts at least"),
               Size("NSHAPE", f"{n_modes * n}U", "numbers of all pairs at one side"),
               Size("NTWIST", f"{n_modes * p}U", "sliding variables at one side"),
               Size("EVERY", f"0x{2**n_modes - 1:X}U", "bits of all modes"),
               Size("OLDEST", f"{OLDEST}U", "largest age"),
               Size("TANGENTS", f"{len(t.a)}U", "that a root starts from"),
               Size("HERON", f"{STEPS}U", "steps of a root")),
        sides=sides, H=matrix("H", f"[{m}_NY][{m}_NX]", t.H),
        noise=(vector("v_lo", t.v_lo, "NY"), vector("v_hi", t.v_hi, "NY")),
        feeds=(matrix("D", f"[{m}_NY][{m}_NU]", t.D),) * bool(np.any(t.D)),
        driven=(by_mode("G", t.G, f"[{m}_NX][{m}_NU]"),) * bool(n_u),
        start=(vector("least", t.x0_lo), vector("most", t.x0_hi)),
        wide=(vector("least", t.x_lo), vector("most", t.x_hi)),
        limit=vector("limit", t.limit), z_limit=vector("limit", t.z_limit, "NY"),
        rate_limit=vector("limit", t.rate_limit, "NY"),
        tangents=(vector("slope", t.a, "TANGENTS"), vector("offset", t.b, "TANGENTS")),
        numbers=tuple(Size(name, literal(value, real), note) for name, value, note in constants),
        half=literal(0.5, real), one=literal(1.0, real), unread=("in",) * (n_u == 0))


def operations(t) -> Operations:
    """Count the dearest step: every pair takes roots and begins anew."""
    N, n, n_u, p = t.sizes
    tangents, loops, rows = len(t.a), 2 * N * p, 2 * (N + 1) * n
    outputs = (5 * N + 2) * p  # bounds of an output, of which loops need one
    seen = (N * (5 + 2 * n) + 2 + 2 * n) * p * n_u * bool(np.any(t.D))
    sums = 2 * n * outputs + seen + rows * (n + n_u + p) + loops * p  # products, and the sums of them
    return Operations(
        multiply=sums + loops * (5 + tangents + STEPS) + N + 1,
        add=sums + loops * (9 + tangents + STEPS) + 4 * p * (N + 2) + 2 * N,
        compare=n * outputs + loops * (9 + tangents) + (N + 2) * (2 * p + n) + 2 * rows + 2 * N + n + 2 * n_u + 2 * p,
        divide=loops * STEPS)
