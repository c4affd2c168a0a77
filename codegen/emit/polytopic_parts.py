"""A polytopic observer in a view: the weights as operations, the sums of the step, every number a string."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..observers.polytopic import LIBM, TRUTHS, PolytopicTables, Program
from .cprint import C_TYPE, Term, check_prefix, count_operations, literal, paragraph, product, sum_lines
from .manual import Channel, channels
from .parts import Operations

Array = np.ndarray


@dataclass(frozen=True)
class Check:
    """A function that accepts a vector within its ranges, and the answer where it does not; ``branch``: if, else if."""

    branch: str
    name: str
    vector: str
    status: str
    conditions: tuple[str, ...]


@dataclass(frozen=True)
class PolytopicView:
    """Everything the C needs. Tuples of ``inputs``, ``parameters`` and ``libm`` are empty where there are none."""

    prefix: str
    macro: str
    real: str
    c_type: str
    zero: str
    mantissa: str
    digits: int
    banner: tuple[str, ...]
    claims: tuple[str, ...]
    cost: str
    x: tuple[Channel, ...]
    u: tuple[Channel, ...]
    y: tuple[Channel, ...]
    theta: tuple[Channel, ...]
    vertices: int
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    libm: tuple[str, ...]
    reads: str
    called: str
    idle: tuple[str, ...]
    varies: tuple[str, ...]
    spare: tuple[str, ...]
    unchecked: tuple[str, ...]
    checks: tuple[Check, ...]
    rest: tuple[str, ...]
    measured: tuple[Check, ...]
    weights: tuple[str, ...]
    start: tuple[str, ...]
    estimate: tuple[str, ...]
    residual: tuple[str, ...]
    move: tuple[str, ...]


def view(plant, t: PolytopicTables, claims: list[str], prefix: str, version: str) -> PolytopicView:
    """Decide everything about the C of a polytopic observer.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    claims : list of str
        What is proved of these tables.
    prefix : str
    version : str
        Of the generator, for the banner.

    Returns
    -------
    PolytopicView

    Raises
    ------
    EmitError
        The prefix cannot start C names, or a number is none of the type.
    """
    p, m, real = check_prefix(prefix), prefix.upper(), t.real
    (_, n), h = t.C.shape, len(t.F)
    measured = [s for s in plant.theta if s.measured]
    names = {"u": plant.u, "y": plant.y, "theta": measured}
    checks = tuple(_check(p, m, vector, getattr(t, f"{vector}_lo"), getattr(t, f"{vector}_hi"), real)
                   for vector in ("u", "theta", "y") if len(names[vector]))
    before = [c for c in checks if c.vector != "y"]
    before = [replace(c, branch="else if" if k else "if") for k, c in enumerate(before)]
    # What the weights read of *in besides x_hat: where it is nothing, *in is no parameter.
    read = {k for op in t.weights.operations for k in op.args if n <= k < t.weights.inputs}
    step, parts = steps(t)
    mantissa = ("FLT_MANT_DIG", 24) if real == "float32" else ("DBL_MANT_DIG", 53)
    x = channels(plant.x, *(np.asarray(v).astype(real) for v in plant.limits("x")), real, "x_hat")
    counted = _operations(t, parts)
    return PolytopicView(
        prefix=p, macro=m, real=real, c_type=C_TYPE[real], zero=literal(0.0, real), mantissa=mantissa[0],
        digits=mantissa[1],
        banner=(*paragraph(f"{plant.name}: {plant.title or plant.name}"), f"residua {version}, polytopic observer"),
        claims=tuple(line for claim in claims for line in paragraph(claim, "- ", "  ")),
        cost=f"{counted.multiply} multiplications, {counted.add} additions, {counted.compare} comparisons, "
             f"{t.weights.count('div')} divisions, {t.weights.count(*LIBM)} calls of <math.h>",
        x=x, u=channels(plant.u, t.u_lo, t.u_hi, real, "u"), y=channels(plant.y, t.y_lo, t.y_hi, real, "y"),
        theta=channels(measured, t.theta_lo, t.theta_hi, real, "theta"), vertices=h,
        inputs=(f"{m}_NU",) * bool(plant.u), parameters=(f"{m}_NTHETA",) * bool(measured),
        libm=("",) * bool(t.weights.count(*LIBM, "sqrt")), reads=f"const {p}_in *in, " if read else "",
        called="in, " if read else "", idle=() if read or plant.u else ("(void)in;",),
        varies=("",) * bool(parts["inner"]), spare=("",) * (real == "float64"),
        unchecked=() if plant.u or measured else ("(void)in;",), checks=tuple(before),
        rest=("/* status stays OK */",) * (len(before) > 1),
        measured=tuple(c for c in checks if c.vector == "y"),
        weights=weight_lines(t.weights, plant.n_x, plant.n_u, real),
        start=(*(f"s->z[{i}] = {literal(v, real)};" for i, v in enumerate(t.z0)),
               *(f"s->y[{i}] = {literal(v, real)};" for i, v in enumerate(t.y0))),
        estimate=tuple(_statement(f"x_hat[{i}]", terms, real) for i, terms in enumerate(parts["x_hat"])),
        residual=tuple(_statement(f"r[{i}]", terms, real) for i, terms in enumerate(parts["r"])), move=step)


def _check(p: str, m: str, vector: str, lo: Array, hi: Array, real: str) -> Check:
    status = {"u": "BAD_INPUT", "theta": "BAD_PARAMETER", "y": "BAD_OUTPUT"}[vector]
    return Check("if", f"{p}_{vector}_accepted", vector, f"{m}_{status}",
                 tuple(f"(in->{vector}[{i}] >= {literal(a, real)}) && (in->{vector}[{i}] <= {literal(b, real)})"
                       for i, (a, b) in enumerate(zip(lo, hi))))


def _statement(target: str, terms: list[Term], real: str) -> str:
    """One assignment, its sum over several lines where it is long."""
    return f"{target} = " + "\n        ".join(sum_lines(terms, real)) + ";"


def steps(t: PolytopicTables) -> tuple[tuple[str, ...], dict[str, list]]:
    """Print z+, and give the terms of x_hat, r and of each part of z+.

    Parameters
    ----------
    t : PolytopicTables
    """
    real, (p, n), m = t.real, t.C.shape, t.G.shape[2]
    operands = [*(f"x_hat[{k}]" for k in range(n)), *(f"in->u[{k}]" for k in range(m)), *(f"r[{k}]" for k in range(p))]

    def terms(row: Array, names: list[str]) -> list[Term]:
        return [term for c, name in zip(row, names) for term in product(float(c), name, real)]

    x_hat = [[("+", f"s->z[{i}]"), *terms(t.T2[i], [f"y[{k}]" for k in range(p)])] for i in range(n)]
    r = [[("+", f"y[{i}]"), *terms(-t.C[i], operands[:n])] for i in range(p)]
    lines, inner, outer = [], [], []
    for i in range(n):
        row = terms(np.where(t.shared[i], t.gains[0, i], 0), operands)
        for j, M in enumerate(t.gains):
            own = terms(np.where(t.shared[i], 0, M[i]), operands)
            if own:
                inner.append(own)
                lines.append(_statement(f"v[{j}]", own, real))
                row.append(("+", f"(h[{j}] * v[{j}])"))
        outer.append(row)
        lines.append(_statement(f"s->z[{i}]", row, real))
    return tuple(lines), {"x_hat": x_hat, "r": r, "inner": inner, "outer": outer}


def _operations(t: PolytopicTables, parts: dict[str, list]) -> Operations:
    """Count a step."""
    counts = [count_operations(terms) for key in parts for terms in parts[key]]
    multiply, add = (sum(c[k] for c in counts) for k in (0, 1))
    w = t.weights
    ranges = 2 * (len(t.u_lo) + len(t.y_lo) + len(t.theta_lo))
    return Operations(multiply + w.count("mul"), add + w.count("add", "sub"),
                      ranges + w.count("ge", "le", "gt", "min", "max", "abs") + 2 * w.count("div"))


def weight_lines(w: Program, n_x: int, n_u: int, real: str) -> tuple[str, ...]:
    """Print the operations of the weights, one statement each.

    Parameters
    ----------
    w : Program
        Over x_hat, u, theta; its last result is a truth.
    n_x, n_u : int
    real : {"float32", "float64"}
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
        lines.append(f"const {'bool' if op.name in TRUTHS else C_TYPE[real]} {name(k)} = {value};")
    lines += [f"h[{j}] = {name(k)};" for j, k in enumerate(w.results[:-1])]
    return (*lines, f"inside = {name(w.results[-1])};")
