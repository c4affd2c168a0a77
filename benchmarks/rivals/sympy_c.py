"""Sympy: the equations as expressions, common subexpressions taken out, printed by its C99 printer, per mode."""

from __future__ import annotations

import numpy as np

from ..cases import Case

NEEDS, HEADER = "sympy", ""


def sources(case: Case) -> dict[str, str]:
    """Print a case."""
    modes = case.sizes[0]
    functions = "\n".join(_function(case, q) for q in range(modes))
    cases = "\n".join(f"    case {q}: mode_{q}(s, in, out); break;" for q in range(modes))
    return {"sympy_c.c": f"""#include "bench.h"
{functions}
void sympy_c_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    switch (in->mode) {{
{cases}
    default: break;
    }}
}}
"""}


def _function(case: Case, q: int) -> str:
    """Print one mode: the inputs into locals, the subexpressions, the results."""
    import sympy
    from sympy.codegen.ast import float32, float64, real
    from sympy.printing.c import C99CodePrinter

    _, n_x, n_u, n_y = case.sizes
    printer = C99CodePrinter({"type_aliases": {real: {"float32": float32, "float64": float64}[case.real]}})

    def vector(stem, n):
        return sympy.Matrix(sympy.symbols(f"{stem}_:{n}"))

    def matrix(name, part=lambda x: x):
        return sympy.Matrix(part(case.tables[name][q])).applyfunc(lambda v: sympy.Integer(v) if v == int(v) else v)

    u, y = vector("u", n_u), vector("y", n_y)
    x = {s: vector(f"x{s}", n_x) for s in case.sides}
    if case.observer == "point":
        r = {"": matrix("C") * x[""] - y}
        move = {"": matrix("A") * x[""] + matrix("B") * u + matrix("K") * r[""]}
    else:
        lo, hi = x["_lo"], x["_hi"]
        pos, neg = matrix("C", lambda c: np.maximum(c, 0)), matrix("C", lambda c: np.maximum(-c, 0))
        r = {"_lo": pos * lo - neg * hi + matrix("c_lo") - y, "_hi": pos * hi - neg * lo + matrix("c_hi") - y}
        move = {s: matrix("M") * x[s] + matrix("G") * u + matrix("L") * y + matrix(f"d{s}") for s in case.sides}
    targets = [f"out->r{s}[{i}]" for s in case.sides for i in range(n_y)]
    targets += [f"s->x{s}[{i}]" for s in case.sides for i in range(n_x)]
    shared, results = sympy.cse([e for group in (r, move) for s in case.sides for e in group[s]])
    lines = [f"const bench_real u_{i} = in->u[{i}];" for i in range(n_u)]
    lines += [f"const bench_real y_{i} = in->y[{i}];" for i in range(n_y)]
    lines += [f"const bench_real x{s}_{i} = s->x{s}[{i}];" for s in case.sides for i in range(n_x)]
    lines += [f"out->x{s}[{i}] = x{s}_{i};" for s in case.sides for i in range(n_x)]
    lines += [f"const bench_real {name} = {printer.doprint(value)};" for name, value in shared]
    lines += [f"{target} = {printer.doprint(value)};" for target, value in zip(targets, results)]
    body = "\n".join(f"    {line}" for line in lines)
    return f"static void mode_{q}(bench_state *s, const bench_in *in, bench_out *out)\n{{\n{body}\n}}\n"
