"""The mode estimator in a view: sizes and tables of what its template loops over, members of its structs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .families import Member, Word, state_layout
from .manual import Bit
from .maps import Names, Table
from .parts import Field, Move, Operations, Parts, Size, vector_table

Array = np.ndarray


@dataclass(frozen=True)
class ModeView:
    """Sizes, and the tables of each function.

    ``feeds`` is D where it is not zero, ``driven`` and ``jump_driven`` what inputs do in a period and in one with a
    switch. ``largest`` is the largest number of the type. ``inputs`` holds the macro of n_u, or nothing without;
    ``unread`` then the parameter that is not read.
    """

    sizes: tuple[Size, ...]
    largest: str
    limit: Table
    start: tuple[Table, ...]
    wide: tuple[Table, ...]
    noise: tuple[Table, ...]
    feeds: tuple[Table, ...]
    moves: tuple[Table, ...]
    driven: tuple[Table, ...]
    reach: Table
    jumps: tuple[Table, ...]
    jump_driven: tuple[Table, ...]
    back: tuple[Table, ...]
    inputs: tuple[str, ...]
    unread: tuple[str, ...]


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the mode estimator's own.

    Parameters
    ----------
    family : {"mode"}
    t : ModeTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks; the boxes are loops over tables in each.

    Returns
    -------
    Parts
    """
    m, count = names.macro, len(t.Phi) * (t.ages + 1) * len(t.limit)
    numbers: list[Member] = [
        (names.real_type, f"box_{side}", f"[{m}_NSHAPE]", note) for side, note in (
            ("lo", ("lower ends of the boxes of S x, the state in the coordinates of the design, outputs C x first;",
                    f"{m}_NX numbers per hypothesis, {m}_AGES hypotheses per mode, the youngest first")),
            ("hi", ("upper ends",)))]
    numbers.append(("uint32_t", "alive", f"[{m}_MODES]", ("bit a: the mode is possible since a samples",)))
    words: list[Word] = [("decided", "0U", "mode of the last answer")]
    state = state_layout(names, s, 1, numbers, 2 * count, [], words, extra=len(t.Phi))
    return Parts(
        noun="boxes", header="mode.h.jinja", self_test="harness/test_mode.c.jinja",
        bits=(Bit("NO_MODE", "0x1U", "no mode explains the measurements"),), maps=(), state=state,
        out_fields=tuple(Field(*f) for f in out_fields(names)), operations=operations(t), cuts=(), start=(),
        whole_range=(), crossed=(), late=(), move=Move("", ""), sets=(view(t, names, count),),
        lengths=(("NSHAPE", count),), told=False)


def out_fields(names: Names) -> tuple[Member, ...]:
    """Members of the output struct."""
    m, real, word = names.macro, names.real_type, "uint32_t"
    return ((real, "x_lo", f"[{m}_NX]", ("lower bounds of x at this sample, over all modes that are possible",)),
            (real, "x_hi", f"[{m}_NX]", ("upper bounds of x at this sample",)),
            (real, "r_lo", f"[{m}_NY]", ("least y that some mode expects, minus y; 0 after predict",)),
            (real, "r_hi", f"[{m}_NY]", ("largest y that some mode expects, minus y; 0 after predict",)),
            (word, "mode", "", ("the decision: the mode that explains the measurements for longest",)),
            (word, "mode_set", "", ("bit q: mode q is possible; the true one is among them",)),
            (word, "settled_set", "", ("the same without what may have begun within the last period only",)),
            (word, "age", "", (f"samples since when out->mode may be active; {m}_OLDEST: or longer",)),
            (word, "raw", "", (f"{m}_BIT_NO_MODE where no mode is possible at this sample; 0 after predict",)),
            (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
            (word, "latched", "", ("alarm bits as kept; act on these",)),
            (word, "assured", "", ("1: mode_set, bounds and alarms of this sample are guaranteed; 0: they are not",)))


def view(t, names: Names, count: int) -> ModeView:
    """Print the tables."""
    m, real = names.macro, t.real
    n_modes, _, n_u, _ = t.sizes
    pairs = [(i, j) for i in range(n_modes) for j in range(n_modes) if i != j]
    sizes = (Size("AGES", f"{t.ages + 1}U", "hypotheses per mode: since how many samples it is active"),
             Size("OLDEST", f"{t.ages}U", "age that means so long or longer"),
             Size("PAIRS", f"{len(pairs)}U", "switches from one mode to another"),
             Size("NSHAPE", f"{count}U", "numbers of all boxes at one side"))

    def row(value: Array) -> list[str]:
        return [f"{initialiser(r, real)}," for r in np.atleast_1d(value)]

    def table(name: str, size: str, values: Array, labels) -> Table:
        lines: list[str] = []
        for value, label in zip(values, labels):
            if value.ndim == 1:
                lines.append(f"{initialiser(value, real)}, /* {label} */")
            else:
                lines += [f"{{ /* {label} */", *(f"    {line}" for line in row(value)), "},"]
        return Table(name, size, (), tuple(lines))

    def by_mode(name: str, values: Array, size: str) -> Table:
        return table(name, f"[{m}_MODES]{size}", values, names.modes)

    def by_pair(name: str, values: Array, size: str) -> Table:
        return table(name, f"[{m}_PAIRS]{size}", np.array([values[i, j] for i, j in pairs]),
                     [f"{names.modes[i]} to {names.modes[j]}" for i, j in pairs])

    def vector(name: str, values: Array, length: str = "NX") -> Table:
        return vector_table(name, f"{m}_{length}", values, real)

    x, xx, xu = f"[{m}_NX]", f"[{m}_NX][{m}_NX]", f"[{m}_NX][{m}_NU]"
    return ModeView(
        sizes=sizes, largest="FLT_MAX" if real == "float32" else "DBL_MAX", limit=vector("limit", t.limit),
        start=(vector("least", t.start_lo), vector("most", t.start_hi)),
        wide=(vector("least", t.wide_lo), vector("most", t.wide_hi)),
        noise=(vector("v_lo", t.v_lo, "NY"), vector("v_hi", t.v_hi, "NY")),
        feeds=(Table("D", f"[{m}_NY][{m}_NU]", (), tuple(row(t.D))),) * bool(np.any(t.D)),
        moves=(by_mode("Phi", t.Phi, xx), by_mode("shift", t.shift, x)),
        driven=(by_mode("Gamma", t.Gamma, xu),) * bool(n_u), reach=by_mode("reach", t.reach, x),
        jumps=(by_pair("J", t.J, xx), by_pair("J_shift", t.J_shift, x), by_pair("J_radius", t.J_radius, xx),
               by_pair("J_reach", t.J_reach, x), by_pair("birth", t.birth, x)),
        jump_driven=(by_pair("J_u", t.J_u, xu), by_pair("J_u_radius", t.J_u_radius, xu)) * bool(n_u),
        back=(Table("back", xx, (), tuple(row(t.S_inverse))), vector("room", t.x_room)),
        inputs=(f"{m}_NU",) * bool(n_u), unread=("in",) * (n_u == 0))


def operations(t) -> Operations:
    """Count the dearest step: every hypothesis alive, every mode old enough to be left."""
    n_modes, n, n_u, p = t.sizes
    boxes, pairs, driven = n_modes * (t.ages + 1), n_modes * (n_modes - 1), bool(np.any(t.D))
    image = 2 * n * n
    multiply = boxes * (2 * image + n * n_u) + pairs * (2 * image + n * n + 3 * n * n_u) + 2 * p * n_u * driven
    add = boxes * (2 * image + 4 * n + n * n_u) + pairs * (2 * image + n * n + 7 * n + 3 * n * n_u)
    add += p * (6 + 2 * n_u * driven)
    compare = boxes * (3 * n + 5 * p + n * n + 2 * n) + pairs * (8 * n + 2 * n * n) + n_modes * 2 * n
    return Operations(multiply, add, compare + boxes * (n * n + 2 * n) + 2 * n_u + 2 * p)
