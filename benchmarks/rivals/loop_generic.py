"""A hand-written matrix library: sizes at run time, one call per product."""

from ..cases import Case
from ._tables import arrays, at, split

NEEDS, HEADER = "", ""

LIBRARY = """#include "bench.h"
void mat_vec_add(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns);
void mat_vec_sub(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns);

void mat_vec_add(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns)
{
    int i, j;
    for (i = 0; i < rows; i++) {
        for (j = 0; j < columns; j++) { out[i] += matrix[i * columns + j] * vector[j]; }
    }
}

void mat_vec_sub(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns)
{
    int i, j;
    for (i = 0; i < rows; i++) {
        for (j = 0; j < columns; j++) { out[i] -= matrix[i * columns + j] * vector[j]; }
    }
}
"""
HEAD = """#include "bench.h"
void mat_vec_add(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns);
void mat_vec_sub(bench_real *out, const bench_real *matrix, const bench_real *vector, int rows, int columns);
"""
POINT = """
void loop_generic_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    int i;
    for (i = 0; i < BENCH_NY; i++) {{ out->r[i] = -in->y[i]; }}
    for (i = 0; i < BENCH_NX; i++) {{ out->x[i] = s->x[i]; s->x[i] = 0; }}
    mat_vec_add(out->r, {C}, out->x, BENCH_NY, BENCH_NX);
    mat_vec_add(s->x, {A}, out->x, BENCH_NX, BENCH_NX);
    mat_vec_add(s->x, {B}, in->u, BENCH_NX, BENCH_NU);
    mat_vec_add(s->x, {K}, out->r, BENCH_NX, BENCH_NY);
}}
"""
INTERVAL = """
void loop_generic_step(bench_state *s, const bench_in *in, bench_out *out)
{{
    bench_real common[BENCH_NX];
    int i;
    for (i = 0; i < BENCH_NY; i++) {{
        out->r_lo[i] = {c_lo}[i] - in->y[i];
        out->r_hi[i] = {c_hi}[i] - in->y[i];
    }}
    for (i = 0; i < BENCH_NX; i++) {{ out->x_lo[i] = s->x_lo[i]; out->x_hi[i] = s->x_hi[i]; common[i] = 0; }}
    mat_vec_add(out->r_lo, {C_pos}, out->x_lo, BENCH_NY, BENCH_NX);
    mat_vec_sub(out->r_lo, {C_neg}, out->x_hi, BENCH_NY, BENCH_NX);
    mat_vec_add(out->r_hi, {C_pos}, out->x_hi, BENCH_NY, BENCH_NX);
    mat_vec_sub(out->r_hi, {C_neg}, out->x_lo, BENCH_NY, BENCH_NX);
    mat_vec_add(common, {G}, in->u, BENCH_NX, BENCH_NU);
    mat_vec_add(common, {L}, in->y, BENCH_NX, BENCH_NY);
    for (i = 0; i < BENCH_NX; i++) {{ s->x_lo[i] = common[i] + {d_lo}[i]; s->x_hi[i] = common[i] + {d_hi}[i]; }}
    mat_vec_add(s->x_lo, {M}, out->x_lo, BENCH_NX, BENCH_NX);
    mat_vec_add(s->x_hi, {M}, out->x_hi, BENCH_NX, BENCH_NX);
}}
"""


def sources(case: Case) -> dict[str, str]:
    """Write a case."""
    whole = split(case)
    leave = () if case.observer == "point" else ("C",)
    text = POINT if case.observer == "point" else INTERVAL
    names = {name: at(whole, name) for name in whole.tables}
    return {"loop_generic_library.c": LIBRARY,
            "loop_generic.c": HEAD + arrays(whole, leave, flat=True) + text.format(**names)}
