"""SymForce: the equations as expressions, one C++ template per mode by its generator, on Eigen vectors."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ..cases import Case

NEEDS, HEADER = "symforce", "Eigen/Core"


def sources(case: Case) -> dict[str, str]:
    """Print a case."""
    modes, n_x, n_u, n_y = case.sizes
    texts = {f"symforce_mode_{q}.h": _function(case, q) for q in range(modes)}
    includes = "\n".join(f'#include "{name}"' for name in texts)
    inputs = [f"Vector<{n_x}>(out->x{s})" for s in case.sides] + [f"Input<{n_u}>(in->u)", f"Input<{n_y}>(in->y)"]
    outputs = [f"r{s}" for s in case.sides] + [f"next{s}" for s in case.sides]
    call = ", ".join([*inputs, *(f"&{name}" for name in outputs)])
    cases = "\n".join(f"    case {q}: sym::Mode{q}<bench_real>({call}); break;" for q in range(modes))
    copies = "\n".join(f"    Vector<{n_x}>(out->x{s}) = Vector<{n_x}>(s->x{s});" for s in case.sides)
    results = "\n".join(f"    Eigen::Matrix<bench_real, {n}, 1> {name}{s};" for name, n in (("r", n_y), ("next", n_x))
                        for s in case.sides)
    back = "\n".join(f"    Vector<{n_y}>(out->r{s}) = r{s};\n    Vector<{n_x}>(s->x{s}) = next{s};" for s in case.sides)
    return texts | {"symforce_cpp.cpp": f"""#include <Eigen/Core>
#include "bench.h"
{includes}

template <int n> using Vector = Eigen::Map<Eigen::Matrix<bench_real, n, 1>>;
template <int n> using Input = Eigen::Map<const Eigen::Matrix<bench_real, n, 1>>;

extern "C" void symforce_cpp_step(bench_state *s, const bench_in *in, bench_out *out);
extern "C" void symforce_cpp_step(bench_state *s, const bench_in *in, bench_out *out)
{{
{results}
{copies}
    switch (in->mode) {{
{cases}
    default: return;
    }}
{back}
}}
"""}


def _function(case: Case, q: int) -> str:
    """Let SymForce print one mode."""
    import symforce

    symforce.set_epsilon_to_number()
    import symforce.symbolic as sf
    from symforce import codegen
    from symforce.values import Values

    _, n_x, n_u, n_y = case.sizes

    def vector(name, n):
        return sf.Matrix([sf.Symbol(f"{name}{i}") for i in range(n)])

    def matrix(name, part=lambda x: x):
        value = part(case.tables[name][q])
        return sf.Matrix(value.reshape(len(value), -1).tolist())

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
    inputs = Values(**{f"x{s}": v for s, v in x.items()}, u=u, y=y)
    outputs = Values(**{f"r{s}": v for s, v in r.items()}, **{f"next{s}": v for s, v in move.items()})
    generator = codegen.Codegen(inputs=inputs, outputs=outputs, config=codegen.CppConfig(), name=f"mode{q}")
    with tempfile.TemporaryDirectory() as scratch:
        generator.generate_function(Path(scratch))
        (header,) = Path(scratch).rglob("*.h")
        return header.read_text()
