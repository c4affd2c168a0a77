"""Eigen: fixed-size matrices mapped onto constant arrays; vectorised by itself where the processor can."""

from ..cases import Case
from ._tables import arrays, at, split

NEEDS, HEADER = "", "Eigen/Dense"

HEAD = """#include <Eigen/Dense>
#include "bench.h"

template <int rows, int columns> using Table = Eigen::Map<const Eigen::Matrix<bench_real, rows, columns>>;
template <int rows> using Vector = Eigen::Map<Eigen::Matrix<bench_real, rows, 1>>;
"""
START = """
extern "C" void eigen_step(bench_state *s, const bench_in *in, bench_out *out);
extern "C" void eigen_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    const Table<BENCH_NU, 1> u(in->u);
    const Table<BENCH_NY, 1> y(in->y);
"""
POINT = START + """
    Vector<BENCH_NX> x(out->x), next(s->x);
    Vector<BENCH_NY> r(out->r);
    x = next;
    r.noalias() = Table<BENCH_NY, BENCH_NX>({C}) * x - y;
    next.noalias() = Table<BENCH_NX, BENCH_NX>({A}) * x + Table<BENCH_NX, BENCH_NU>({B}) * u
        + Table<BENCH_NX, BENCH_NY>({K}) * r;
}}
"""
INTERVAL = START + """
    const Table<BENCH_NY, BENCH_NX> pos({C_pos}), neg({C_neg});
    const Table<BENCH_NX, BENCH_NX> M({M});
    Vector<BENCH_NX> x_lo(out->x_lo), x_hi(out->x_hi), next_lo(s->x_lo), next_hi(s->x_hi);
    x_lo = next_lo;
    x_hi = next_hi;
    Vector<BENCH_NY>(out->r_lo).noalias() = pos * x_lo - neg * x_hi + Table<BENCH_NY, 1>({c_lo}) - y;
    Vector<BENCH_NY>(out->r_hi).noalias() = pos * x_hi - neg * x_lo + Table<BENCH_NY, 1>({c_hi}) - y;
    Eigen::Matrix<bench_real, BENCH_NX, 1> common;
    common.noalias() = Table<BENCH_NX, BENCH_NU>({G}) * u + Table<BENCH_NX, BENCH_NY>({L}) * y;
    next_lo.noalias() = M * x_lo + common + Table<BENCH_NX, 1>({d_lo});
    next_hi.noalias() = M * x_hi + common + Table<BENCH_NX, 1>({d_hi});
}}
"""


def sources(case: Case) -> dict[str, str]:
    """Write a case."""
    whole = split(case)
    leave = () if case.observer == "point" else ("C",)
    text = POINT if case.observer == "point" else INTERVAL
    prefixed = Case(**{**vars(whole), "tables": {f"t_{n}": t for n, t in whole.tables.items() if n not in leave}})
    names = {name[2:]: at(prefixed, name) for name in prefixed.tables}
    return {"eigen.cpp": HEAD + arrays(prefixed, flat=True, columns=True) + text.format(**names)}
