"""A bank of observers as C: one function per member, weights that all share, thresholds, who is to blame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.bank_tables import BankTables
from ..observers.bank_tables import Member as BankMember
from ..observers.polytopic_step import LIBM
from .cprint import comment, count_operations, literal, macro_names
from .families import Member, Word, state_layout
from .manual import MEMBERS, Bit
from .maps import Names, Table
from .parts import Field, Move, Operations, Parts, Size, assign, vector_table
from .polytopic_parts import statement, steps, terms_of, weight_lines


@dataclass(frozen=True)
class MemberView:
    """One observer: the name of its function, what it leaves out and reads, its statements."""

    name: str
    without: str
    reads: str
    outputs: str
    varies: tuple[str, ...]
    estimate: tuple[str, ...]
    residual: tuple[str, ...]
    move: tuple[str, ...]
    average: tuple[str, ...]


@dataclass(frozen=True)
class Blame:
    """A fault: its macro, number, name, and the members that it raises."""

    macro: str
    index: str
    name: str
    pattern: str


@dataclass(frozen=True)
class Limited:
    """A vector of the state, its size, and the table of its limits."""

    name: str
    size: str
    table: Table


@dataclass(frozen=True)
class BankView:
    """Sizes, members, thresholds. ``libm`` has one entry or none; ``reads`` and ``called`` are the parameter ``in`` of
    the weights, ``unread`` what the check does not read, ``idle`` says that no
    member reads it. ``anew`` starts the members.
    """

    sizes: tuple[Size, ...]
    faults: tuple[Blame, ...]
    members: tuple[MemberView, ...]
    libm: tuple[str, ...]
    reads: str
    called: str
    weights: tuple[str, ...]
    anew: tuple[str, ...]
    bound: Table
    limits: tuple[Limited, ...]
    patterns: tuple[str, ...]
    keep: str
    settle: str
    unread: tuple[str, ...]
    idle: tuple[str, ...]
    bridge: str
    gap: str


def parts(t: BankTables, s, names: Names, signals: tuple, faults: tuple[str, ...]) -> Parts:
    """Decide what is the bank's own.

    Parameters
    ----------
    t : BankTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and measured parameters.
    faults : tuple of str

    Returns
    -------
    Parts
    """
    _, u, y, theta = signals
    m, real, n, count = names.macro, names.real_type, len(t.x_lo), len(t.members)
    sums = sum(len(own.M) for own in t.members)
    words: list[Word] = [("wait", "", f"samples until the levels are judged, 0 to {max(t.settle, t.begin)}"),
                         ("credit", "", f"measured samples that pay for lost ones, 0 to {t.credit}")]
    numbers: list[Member] = [
        (real, "z", f"[{m}_NZ]", (f"states of the observers, {m}_NX numbers each",)),
        (real, "a", f"[{m}_NA]", ("moving averages of their weighted residuals",)),
        (real, "y", f"[{m}_NY]", ("last measurement",)),
        ("uint32_t", "left", f"[{m}_NF]", ("per observer: samples for which it stays raised",))]
    stems, short = macro_names(faults), tuple(map(comment, faults))
    bits = tuple(Bit(f"WITHOUT_{stem}", f"0x{1 << k:X}U", f"level of the observer without the sensors of {name} beyond "
                     "its bound") for k, (stem, name) in enumerate(zip(stems, short)))
    word = "uint32_t"
    out = ((real, "r", f"[{m}_NF]", ("levels: squares of the averaged, weighted residuals; 0 after predict",)),
           (real, "r_bound", f"[{m}_NF]", ("largest level that is no alarm; 0 after predict",)),
           ("int32_t", "isolated", "", (f"the fault that is to blame, {m}_F_; -1: none, or it cannot be told",)),
           (word, "raw", "", (f"{m}_BIT_ of what is beyond its bound at this sample; 0 after predict",)),
           (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
           (word, "latched", "", ("alarm bits as kept; act on these",)),
           (word, "assured", "", ("always 0: the thresholds are calibrated, not guaranteed",)),
           (word, "ready", "", ("1: the levels of this sample are judged; 0: not yet, or there are none",)),
           (word, "inside", "", ("1: all estimates are where the weights are in force; 0: one is not",)),
           (word, "raised", "", (f"{m}_BIT_ of the observers whose alarm is {t.keep} samples old at most",)))
    compared = 2 * (len(u) + len(y) + len(theta) + n * count + sums) + count
    views, operations, z, a = [], Operations(0, 0, compared), 0, 0
    for k, own in enumerate(t.members):
        view, counted = _member(names, t, own, k, (z, a), short[k], [c.name for c in y])
        views.append(view)
        operations, z, a = operations + counted, z + n, a + len(own.M)
    anew = [*assign("s->z", np.concatenate([own.z0 for own in t.members]), t.real),
            *assign("s->a", np.zeros(sums), t.real), f"s->wait = {t.settle}U;", "s->credit = 0U;"]
    quiet = (*assign("s->y", np.zeros(len(y)), t.real), *(f"s->left[{k}] = 0U;" for k in range(count)))
    reads = {k for op in t.weights.operations for k in op.args if n <= k < t.weights.inputs}
    patterns = [f"0x{sum(1 << p for p, raised in enumerate(row) if raised):X}U" for row in t.incidence]
    view = BankView(
        sizes=(Size("NF", f"{count}U", "faults, and observers"), Size("NH", f"{len(t.members[0].F)}U", "vertices"),
               Size("NZ", f"{z}U", "states of all observers"), Size("NA", f"{sums}U", "averages of all observers"),
               Size("GAP", f"{t.gap}U", "measured samples that pay for a lost one"),
               Size("CREDIT", f"{t.credit}U", "measured samples that are counted at most")),
        faults=tuple(Blame(stem, str(k), name, pattern)
                     for k, (stem, name, pattern) in enumerate(zip(stems, short, patterns))),
        members=tuple(views), libm=("",) * bool(t.weights.count(*LIBM, "sqrt")),
        reads=f"const {names.prefix}_in *in, " * bool(reads), called="in, " * bool(reads),
        weights=weight_lines(t.weights, n, t.members[0].G.shape[2], t.real, real), anew=tuple(anew),
        bound=vector_table("bound", f"{m}_NF", t.bound, t.real),
        limits=tuple(Limited(name, f"{m}_N{name.upper()}", vector_table(table, f"{m}_N{name.upper()}", values, t.real))
                     for name, table, values in (("z", "limit", t.limit), ("a", "most", t.most))),
        patterns=tuple(patterns), keep=f"{t.keep}U", settle=str(t.settle),
        unread=() if u or theta else ("in",), idle=() if u or reads else ("(void)in;",), bridge=str(t.bridge),
        gap=str(t.gap))
    start = (f"{names.prefix}_anew(s);", f"s->wait = {t.begin}U;", *quiet)
    return Parts(
        noun=MEMBERS, header="bank.h.jinja", self_test="harness/test_bank.c.jinja", bits=bits, maps=(),
        state=state_layout(names, s, count, numbers, z + sums + len(y), [], words, extra=count),
        out_fields=tuple(Field(*f) for f in out), operations=operations, cuts=(), start=start,
        whole_range=(f"{names.prefix}_anew(s);", *quiet), crossed=(), late=(), move=Move("", ""), sets=(view,),
        lengths=(("NZ", z), ("NA", sums), ("NF", count)), told=False)


def _member(names: Names, t: BankTables, own: BankMember, k: int, at: tuple[int, int], without: str,
            outputs: list[str]) -> tuple[MemberView, Operations]:
    """Print one observer, whose z and averages begin at given places; count its operations."""
    real, (z, a), p = t.real, at, len(own.seen)
    move, sums = steps(own, [f"s->y[{i}]" for i in own.seen], z)
    counts = [count_operations(terms) for key in sums for terms in sums[key]]
    lines, squares = [], []
    for i, row in enumerate(own.M):
        terms = terms_of(row, [f"r[{j}]" for j in range(p)], real)
        counts.append(count_operations(terms))
        lines += [statement("e", terms, real),
                  f"s->a[{a + i}] = s->a[{a + i}] + ({literal(t.rate, real)} * (e - s->a[{a + i}]));"]
        squares.append(("+", f"(s->a[{a + i}] * s->a[{a + i}])"))
    lines.append(statement(f"out->r[{k}]", squares, real))
    multiply, add = (sum(c[i] for c in counts) for i in (0, 1))
    size, w = len(own.M), t.weights
    view = MemberView(
        f"{names.prefix}_without_{k}", without, ", ".join(outputs[i] for i in own.seen), f"{p}U",
        ("",) * bool(sums["inner"]), *(tuple(statement(f"{name}[{i}]", terms, real) for i, terms in enumerate(
            sums[name])) for name in ("x_hat", "r")), move, tuple(lines))
    return view, Operations(multiply + 2 * size + w.count("mul"), add + 3 * size - 1 + w.count("add", "sub"),
                            w.count("ge", "le", "gt", "min", "max", "abs") + 2 * w.count("div"), w.count("div"))
