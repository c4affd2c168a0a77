"""Our layouts of a case: the maps that firmware gets, printed by the generator, and the call around them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from codegen.emit import families
from codegen.emit.layouts import LAYOUTS, lay_out
from codegen.emit.maps import Linear, MapSpec, Names
from codegen.emit.render import environment
from codegen.observers.framer import FramerTables

from .cases import Case

MAPS = """{% import "_c.jinja" as c %}
#include "bench.h"

{% for view in views %}
{{ c.map(view, d) -}}
{% endfor %}
"""


def sources(case: Case) -> dict[str, dict[str, str]]:
    """Print a case in every layout.

    Parameters
    ----------
    case : Case

    Returns
    -------
    sources : dict
        Candidate -> file name -> text.
    """
    return {layout: {f"{layout}.c": source(case, layout)} for layout in LAYOUTS}


def source(case: Case, layout: str) -> str:
    """Print a case in one layout."""
    residual, forward = specs(case)
    text = environment().from_string(MAPS).render(
        views=[lay_out(spec, layout) for spec in (residual, forward)], d=SimpleNamespace(prefix="bench"))
    copies = "".join(f"    out->x{s}[{i}] = s->x{s}[{i}];\n" for i in range(case.sizes[1]) for s in case.sides)
    return (f"{text}void {layout}_step(bench_state *s, const bench_in *in, bench_out *out)\n{{\n{copies}"
            "    bench_residual(in, out);\n    bench_forward(s, in, out);\n}\n")


def specs(case: Case) -> tuple[MapSpec, MapSpec]:
    """Return the maps of a case: the residual and the step forward."""
    modes, n_x, n_u, n_y = case.sizes
    names = Names("bench", "BENCH", case.real, tuple(str(q) for q in range(modes)),
                  tuple(f"BENCH_MODE_{q}" for q in range(modes)))
    x, y = (tuple(SimpleNamespace(index=i, name=v) for i in range(n)) for v, n in (("x", n_x), ("y", n_y)))
    if case.observer == "interval":
        residual, forward, _ = families.specs("interval", framer_tables(case), names, x, y)
        return residual, forward
    t, none = case.tables, np.zeros((modes, max(n_x, n_y)))
    common = {"selector": "in->mode", "index": "in->mode", "sides": ("",), "shared": True, "by_sign": False,
              "tail": (), "names": names, "target_hi": ""}
    residual = MapSpec("bench_residual", ("r = C x - y",), ("const bench_in *in", "bench_out *out"),
                       target_lo="out->r", rows=tuple(f"r[{c.index}]" for c in y), common=(),
                       offset=Linear("c", none[:, :n_y], none[:, :n_y]),
                       state=Linear("C", t["C"], t["C"], "out->x", "BENCH_NX"), minus="in->y", row_count="BENCH_NY",
                       **common)
    inputs = (Linear("B", t["B"], t["B"], "in->u", "BENCH_NU"), Linear("K", t["K"], t["K"], "out->r", "BENCH_NY"))
    forward = MapSpec("bench_forward", ("x+ = A x + B u + K r",),
                      ("bench_state *s", "const bench_in *in", "const bench_out *out"), target_lo="s->x",
                      rows=tuple(f"x[{c.index}]" for c in x), common=inputs,
                      offset=Linear("a", none[:, :n_x], none[:, :n_x]),
                      state=Linear("A", t["A"], t["A"], "out->x", "BENCH_NX"), minus="", row_count="BENCH_NX", **common)
    return residual, forward


def framer_tables(case: Case) -> FramerTables:
    """Return the tables of an interval case; what its two maps do not use is zero."""
    modes, n_x, n_u, n_y = case.sizes
    t, dtype = {name: table.astype(case.real) for name, table in case.tables.items()}, np.dtype(case.real)
    wide = {"M": t["M"], "G": t["G"], "L": t["L"], "N": np.zeros((modes, n_x, n_y), dtype)}
    zero = {"A": (modes, n_x, n_x), "B": (modes, n_x, n_u), "a_hi": (modes, n_x), "a_lo": (modes, n_x),
            "D": (modes, n_y, n_u), "x_lo": (n_x,), "x_hi": (n_x,), "x0_lo": (n_x,), "x0_hi": (n_x,), "box": (n_x,),
            "u_lo": (n_u,), "u_hi": (n_u,), "y_lo": (n_y,), "y_hi": (n_y,)}
    return FramerTables(real=case.real, clamp=False, C=t["C"], c_hi=t["c_hi"], c_lo=t["c_lo"], d_hi=t["d_hi"],
                        d_lo=t["d_lo"], **{f"{k}_{s}": v for k, v in wide.items() for s in ("hi", "lo")},
                        **{name: np.zeros(shape, dtype) for name, shape in zero.items()})
