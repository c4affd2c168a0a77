"""What both CasADi rivals share: a function per mode, printed by its code generator, and the call around them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ..cases import Case


def sources(case: Case, kind: str) -> dict[str, str]:
    """Print a case by CasADi's code generator.

    Parameters
    ----------
    case : Case
    kind : {"SX", "MX"}
        Scalar or matrix expressions.

    Returns
    -------
    sources : dict
        File name -> text.
    """
    import casadi

    modes, n_x, n_u, n_y = case.sizes
    stem, symbol = f"casadi_{kind.lower()}", getattr(casadi, kind).sym

    def constant(name, part=lambda x: x):
        return casadi.sparsify(casadi.DM(part(case.tables[name][q])))

    functions = []
    for q in range(modes):
        u, y = symbol("u", n_u), symbol("y", n_y)
        if case.observer == "point":
            x = symbol("x", n_x)
            r = constant("C") @ x - y
            inputs, outputs = [x, u, y], [constant("A") @ x + constant("B") @ u + constant("K") @ r, r]
        else:
            lo, hi = symbol("x_lo", n_x), symbol("x_hi", n_x)
            pos, neg = constant("C", lambda x: np.maximum(x, 0)), constant("C", lambda x: np.maximum(-x, 0))
            common = constant("G") @ u + constant("L") @ y
            inputs = [lo, hi, u, y]
            outputs = [constant("M") @ lo + common + constant("d_lo"), constant("M") @ hi + common + constant("d_hi"),
                       pos @ lo - neg @ hi + constant("c_lo") - y, pos @ hi - neg @ lo + constant("c_hi") - y]
        functions.append(casadi.Function(f"{stem}_{q}", inputs, outputs))
    options = {"casadi_real": {"float32": "float", "float64": "double"}[case.real], "casadi_int": "int",
               "with_header": True}
    with tempfile.TemporaryDirectory() as scratch:
        generator = casadi.CodeGenerator(f"{stem}_kernel", options)
        for function in functions:
            generator.add(function)
        generator.generate(f"{scratch}/")
        texts = {f"{stem}_kernel.{end}": (Path(scratch) / f"{stem}_kernel.{end}").read_text() for end in "ch"}
    return texts | {f"{stem}.c": _call(case, stem, functions)}


def _call(case: Case, stem: str, functions) -> str:
    """Write the call: fill the argument arrays, give the work vectors, select the mode."""
    sizes = {name: max(getattr(f, name)() for f in functions) for name in ("sz_arg", "sz_res", "sz_iw", "sz_w")}
    copies = "\n".join(f"    for (i = 0; i < BENCH_NX; i++) {{ out->x{s}[i] = s->x{s}[i]; }}" for s in case.sides)
    arguments = [*(f"out->x{s}" for s in case.sides), "in->u", "in->y"]
    results = [*(f"s->x{s}" for s in case.sides), *(f"out->r{s}" for s in case.sides)]
    fill = [*(f"    arg[{i}] = {a};" for i, a in enumerate(arguments)),
            *(f"    res[{i}] = {r};" for i, r in enumerate(results))]
    cases = [f"    case {q}: {stem}_{q}(arg, res, iw, w, 0); break;" for q in range(len(functions))]
    fill = "\n".join(fill)
    cases = "\n".join(cases)
    return f"""#include "bench.h"
#include "{stem}_kernel.h"

void {stem}_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    const bench_real *arg[{sizes['sz_arg']}];
    bench_real *res[{sizes['sz_res']}];
    int iw[{sizes['sz_iw'] + 1}], i;
    bench_real w[{sizes['sz_w'] + 1}];
{copies}
{fill}
    switch (in->mode) {{
{cases}
    default: break;
    }}
}}
"""
