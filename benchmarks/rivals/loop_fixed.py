"""A hand-written loop with sizes known to the compiler: constant tables, one pass per row."""

from ..cases import Case
from ._tables import arrays, at, split

NEEDS, HEADER = "", ""

POINT = """
void loop_fixed_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    int i, j;
    for (i = 0; i < BENCH_NX; i++) {{ out->x[i] = s->x[i]; }}
    for (i = 0; i < BENCH_NY; i++) {{
        bench_real sum = -in->y[i];
        for (j = 0; j < BENCH_NX; j++) {{ sum += {C}[i][j] * out->x[j]; }}
        out->r[i] = sum;
    }}
    for (i = 0; i < BENCH_NX; i++) {{
        bench_real sum = 0;
        for (j = 0; j < BENCH_NX; j++) {{ sum += {A}[i][j] * out->x[j]; }}
        for (j = 0; j < BENCH_NU; j++) {{ sum += {B}[i][j] * in->u[j]; }}
        for (j = 0; j < BENCH_NY; j++) {{ sum += {K}[i][j] * out->r[j]; }}
        s->x[i] = sum;
    }}
}}
"""
INTERVAL = """
void loop_fixed_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    int i, j;
    for (i = 0; i < BENCH_NX; i++) {{ out->x_lo[i] = s->x_lo[i]; out->x_hi[i] = s->x_hi[i]; }}
    for (i = 0; i < BENCH_NY; i++) {{
        bench_real lo = {c_lo}[i] - in->y[i], hi = {c_hi}[i] - in->y[i];
        for (j = 0; j < BENCH_NX; j++) {{
            lo += {C_pos}[i][j] * out->x_lo[j] - {C_neg}[i][j] * out->x_hi[j];
            hi += {C_pos}[i][j] * out->x_hi[j] - {C_neg}[i][j] * out->x_lo[j];
        }}
        out->r_lo[i] = lo;
        out->r_hi[i] = hi;
    }}
    for (i = 0; i < BENCH_NX; i++) {{
        bench_real common = 0, lo, hi;
        for (j = 0; j < BENCH_NU; j++) {{ common += {G}[i][j] * in->u[j]; }}
        for (j = 0; j < BENCH_NY; j++) {{ common += {L}[i][j] * in->y[j]; }}
        lo = common + {d_lo}[i];
        hi = common + {d_hi}[i];
        for (j = 0; j < BENCH_NX; j++) {{
            lo += {M}[i][j] * out->x_lo[j];
            hi += {M}[i][j] * out->x_hi[j];
        }}
        s->x_lo[i] = lo;
        s->x_hi[i] = hi;
    }}
}}
"""


def sources(case: Case) -> dict[str, str]:
    """Write a case."""
    whole = split(case)
    leave = () if case.observer == "point" else ("C",)
    text = POINT if case.observer == "point" else INTERVAL
    names = {name: at(whole, name) for name in whole.tables}
    return {"loop_fixed.c": '#include "bench.h"\n' + arrays(whole, leave) + text.format(**names)}
