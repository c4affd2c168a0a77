"""A polytopic observer as C: the weights as operations, the sums of the step, members and tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.polytopic_step import LIBM, TRUTHS, Program
from ..observers.polytopic_tables import PolytopicTables
from .cprint import Term, count_operations, initialiser, literal, macro_names, product, sum_lines
from .families import Member, Word, state_layout
from .feedback_parts import LawView, law_view
from .manual import ESTIMATED, THRESHOLDS, Bit
from .maps import Names, Table
from .parts import Field, Move, Operations, Parts, Size, assign, vector_table

Array = np.ndarray


@dataclass(frozen=True)
class PolytopicView:
    """Sizes, statements, tables. Of ``libm``, ``varies``, ``weighted`` (the name of the raw residual) one entry or
    none, and of ``silent`` one where there is no libm, which may set errno; ``reads`` and ``called`` are the parameter
    ``in`` of the weights, ``idle`` and ``unread`` say that nothing reads it. ``anew`` and ``again`` say when the
    thresholds start again, ``sure`` is a line or none; ``laws`` is the tracking law, where there is one.
    """

    sizes: tuple[Size, ...]
    libm: tuple[str, ...]
    silent: tuple[str, ...]
    reads: str
    called: str
    idle: tuple[str, ...]
    varies: tuple[str, ...]
    weights: tuple[str, ...]
    estimate: tuple[str, ...]
    residual: tuple[str, ...]
    shown: tuple[str, ...]
    move: tuple[str, ...]
    thresholds: Table
    limits: tuple[Table, ...]
    row: str
    unread: tuple[str, ...]
    anew: str
    sure: tuple[str, ...]
    again: str
    laws: tuple[LawView, ...] = ()


def parts(t: PolytopicTables, s, names: Names, signals: tuple) -> Parts:
    """Decide what is the polytopic observer's own.

    Parameters
    ----------
    t : PolytopicTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and measured parameters.

    Returns
    -------
    Parts
    """
    _, u, y, theta = signals
    m, real, (n, p) = names.macro, names.real_type, t.T2.shape
    words: list[Word] = [("since", "", f"samples since a start of the table of thresholds, 0 to {t.last << t.shift}")]
    numbers: list[Member] = [(real, "z", f"[{m}_NX]", ("state of the observer",)),
                             (real, "y", f"[{m}_NY]", ("last measurement",))]
    bits = tuple(Bit(stem, f"0x{1 << c.index:X}U", f"residual {c.name} beyond its bound")
                 for c, stem in zip(y, macro_names(c.name for c in y)))
    seen = "M (y - C x_hat)" if t.weighted else "y - C x_hat"
    word = "uint32_t"
    estimate, bound = "estimate of x at this sample", "largest magnitude of r without a fault; 0 after predict"
    if not s.assures:
        bound = "magnitude of r that is taken for a fault's, calibrated; 0 after predict"
    if t.faults:
        estimate, bound = "estimate of x, then of the faults, at this sample", "r is as near to that; 0 after predict"
        seen += ": what the faults do to y"
    out = ((real, "x_hat", f"[{m}_NX]", (estimate,)),
           (real, "r", f"[{m}_NY]", (f"residual {seen}; 0 after predict",)),
           (real, "r_bound", f"[{m}_NY]", (bound,)),
           (word, "raw", "", (f"{m}_BIT_ of what is beyond its bound at this sample; 0 after predict",)),
           (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
           (word, "latched", "", ("alarm bits as kept; act on these",)),
           (word, "assured", "", ("1: the bounds and alarms of this sample are guaranteed; 0: they are not",)),
           (word, "inside", "", ("1: x_hat is where the weights are in force; 0: it is not",)),
           (word, "settled", "", ("1: r_bound has come down to where it stays; 0: it may be higher",)))
    move, sums = steps(t)
    called = bool(t.weights.count(*LIBM, "sqrt"))
    read = {k for op in t.weights.operations for k in op.args if n <= k < t.weights.inputs}
    begin = (*assign("s->z", t.z0, t.real), *assign("s->y", t.y0, t.real), f"s->since = {t.start << t.shift}U;")
    whole = (*assign("s->z", t.z_mid, t.real), *assign("s->y", t.y_mid, t.real), "s->since = 0U;")
    rows = [f"{initialiser(row, t.real)}," for row in t.h]
    each = f", {1 << t.shift} samples each" if t.shift else ""
    notes = {0: f"/* from anywhere{each} */", t.last: "/* for ever */"}
    table = tuple(line for k, row in enumerate(rows) for line in ([notes[k]] if k in notes else []) + [row])
    shown = tuple(statement(f"out->r[{i}]", terms_of(row, [f"r[{k}]" for k in range(p)], t.real), t.real)
                  for i, row in enumerate(t.M))
    view = PolytopicView(
        sizes=(Size("NH", f"{len(t.F) + t.known.shape[1]}U",
                    "vertices" + f", and {t.known.shape[1]} known terms behind them" * bool(t.known.size)),
               *((Size("NF", f"{t.faults}U", "faults: the last entries of x_hat"),) if t.faults else ()),
               Size("ROWS", f"{t.last + 1}U", "rows of the table of thresholds; the last holds for ever"),
               Size("LAST", f"{t.last << t.shift}U", "s->since once the last row holds")),
        libm=("",) * called, silent=("",) * (not called), reads=f"const {names.prefix}_in *in, " if read else "",
        called="in, " if read else "", idle=() if read or u else ("(void)in;",), varies=("",) * bool(sums["inner"]),
        weights=weight_lines(t.weights, n, t.G.shape[2], t.real, real),
        estimate=tuple(statement(f"x_hat[{i}]", terms, t.real) for i, terms in enumerate(sums["x_hat"])),
        residual=tuple(statement(f"r[{i}]", terms, t.real) for i, terms in enumerate(sums["r"])), shown=shown,
        move=move, thresholds=Table("threshold", f"[{m}_ROWS][{m}_NY]", (), table),
        limits=(vector_table("least", f"{m}_NX", t.z_lo, t.real), vector_table("most", f"{m}_NX", t.z_hi, t.real)),
        row=f"(s->since >> {t.shift}U)" if t.shift else "s->since", unread=() if u or theta else ("in",),
        laws=() if t.law is None else (law_view(t, names, y, _operations(t, sums) + _weights(t, sums["x_hat"])),),
        anew="false" if t.faults else "again && (out->raw == 0U)",
        sure=("out->assured = 1U; /* the faults are part of the estimate and spoil nothing */",) if t.faults else (),
        again="anew || (!kept) || (!inside)" if t.faults and not t.at_estimate else "anew || (!kept)")
    return Parts(
        noun=ESTIMATED if t.faults else THRESHOLDS,
        header="polytopic.h.jinja", self_test="harness/test_polytopic.c.jinja", bits=bits, maps=(),
        state=state_layout(names, s, p, numbers, n + p, [], words), out_fields=tuple(Field(*f) for f in out),
        operations=_operations(t, sums), cuts=(), start=begin, whole_range=whole, crossed=(), late=(),
        move=Move("", ""), sets=(view,), told=False)


def terms_of(row: Array, names: list[str], real: str) -> list[Term]:
    """Products of a row with what the names stand for, without those with 0.

    Parameters
    ----------
    row : ndarray (n,)
    names : list of str
    real : {"float32", "float64"}
    """
    return [term for c, name in zip(row, names) for term in product(float(c), name, real)]


def statement(target: str, terms: list[Term], real: str) -> str:
    """One assignment, its sum over several lines where it is long.

    Parameters
    ----------
    target : str
    terms : list of Term
    real : {"float32", "float64"}
    """
    return f"{target} = " + "\n        ".join(sum_lines(terms, real)) + ";"


def steps(t: PolytopicTables, outputs: list[str] | None = None, first: int = 0) -> tuple[tuple[str, ...],
                                                                                       dict[str, list]]:
    """Print z+, and give the terms of x_hat, r and of each part of z+.

    Parameters
    ----------
    t : PolytopicTables
        Or a member of a bank.
    outputs : list of str, optional
        What the C calls the outputs.
    first : int
        Where its z begins in that of the C.
    """
    real, (p, n), m = t.real, t.C.shape, t.G.shape[2]
    operands = [*(f"x_hat[{k}]" for k in range(n)), *(f"in->u[{k}]" for k in range(m)), *(f"r[{k}]" for k in range(p)),
                *(f"h[{k}]" for k in range(len(t.F), len(t.F) + t.known.shape[1]))]
    outputs = outputs or [f"y[{k}]" for k in range(p)]

    def terms(row: Array, names: list[str]) -> list[Term]:
        return terms_of(row, names, real)

    x_hat = [[("+", f"s->z[{first + i}]"), *terms(t.T2[i], outputs)] for i in range(n)]
    r = [[("+", outputs[i]), *terms(-t.C[i], operands[:n])] for i in range(p)]
    lines, inner, outer = [], [], []
    for i in range(n):
        row = terms(np.where(t.shared[i], t.gains[0, i], 0), operands)
        for j, M in enumerate(t.gains):
            own = terms(np.where(t.shared[i], 0, M[i]), operands)
            if own:
                inner.append(own)
                lines.append(statement(f"v[{j}]", own, real))
                row.append(("+", f"(h[{j}] * v[{j}])"))
        outer.append(row)
        lines.append(statement(f"s->z[{first + i}]", row, real))
    return tuple(lines), {"x_hat": x_hat, "r": r, "inner": inner, "outer": outer}


def _operations(t: PolytopicTables, parts: dict[str, list]) -> Operations:
    """Count a step."""
    counts = [count_operations(terms) for key in parts if key != "x_hat" for terms in parts[key]]
    multiply, add = (sum(c[k] for c in counts) for k in (0, 1))
    weighted = [count_operations(terms_of(row, ["r"] * len(row), t.real)) for row in t.M] if t.weighted else []
    multiply, add = multiply + sum(a for a, _ in weighted), add + sum(b for _, b in weighted)
    # Ranges of what comes in and of z, thresholds and the signs of what they are compared with.
    ranges = 2 * (len(t.u_lo) + len(t.y_lo) + len(t.theta_lo) + len(t.z_lo) + len(t.M))
    return Operations(multiply, add, ranges) + _weights(t, parts["x_hat"])


def _weights(t: PolytopicTables, x_hat: list[list[Term]]) -> Operations:
    """Count the estimate and its weights."""
    w, (multiply, add) = t.weights, np.sum([count_operations(terms) for terms in x_hat], axis=0).tolist()
    return Operations(multiply + w.count("mul"), add + w.count("add", "sub"),
                      w.count("ge", "le", "gt", "min", "max", "abs") + 2 * w.count("div"), w.count("div"))


def weight_lines(w: Program, n_x: int, n_u: int, real: str, kind: str) -> tuple[str, ...]:
    """Print the operations of the weights, one statement each.

    Parameters
    ----------
    w : Program
        Over x_hat, u, theta; its last result is a truth.
    n_x, n_u : int
    real : {"float32", "float64"}
    kind : str
        The C type of numbers.
    """
    suffix, most = ("f", "FLT_MAX") if real == "float32" else ("", "DBL_MAX")
    zero, lines = literal(0.0, real), []

    def name(k: int) -> str:
        if k < n_x:
            return f"x_hat[{k}]"
        if k < n_x + n_u:
            return f"in->u[{k - n_x}]"
        if k < w.inputs:
            return f"in->theta[{k - n_x - n_u}]"
        if k < w.first:
            value = w.constants[k - w.inputs]
            return literal(value, real) if value >= 0 else f"({literal(value, real)})"
        return f"t{k - w.first}"

    if not any(k < n_x for k in (*w.results, *(k for op in w.operations for k in op.args))):
        lines.append("(void)x_hat;")
    signs = {"add": "+", "sub": "-", "mul": "*", "ge": ">=", "le": "<=", "gt": ">", "and": "&&"}
    for k, op in enumerate(w.operations, w.first):
        a = [name(i) for i in op.args]
        if op.name in signs:
            value = f"({a[0]} {signs[op.name]} {a[1]})"
        elif op.name == "div":
            value = f"(({a[1]} > {zero}) || ({a[1]} < {zero})) ? ({a[0]} / {a[1]}) : {most}"
        elif op.name == "select":
            value = f"{a[0]} ? {a[1]} : {a[2]}"
        elif op.name in ("min", "max"):
            value = f"({a[0]} {'<' if op.name == 'min' else '>'} {a[1]}) ? {a[0]} : {a[1]}"
        elif op.name == "abs":
            value = f"({a[0]} < {zero}) ? -{a[0]} : {a[0]}"
        elif op.name == "neg":
            value = f"-{a[0]}"
        else:
            value = f"{op.name}{suffix}({', '.join(a)})"
        lines.append(f"const {'bool' if op.name in TRUTHS else kind} {name(k)} = {value};")
    lines += [f"h[{j}] = {name(k)};" for j, k in enumerate(w.results[:-1])]
    return (*lines, f"inside = {name(w.results[-1])};")
