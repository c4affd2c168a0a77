/*
 * What a multiplication and an addition cost beside a copy: for the lower bound where a library calculates.
 */
#include "bench.h"

void probe_copy_step(bench_state *s, const bench_in *in, bench_out *out);
void probe_multiply_step(bench_state *s, const bench_in *in, bench_out *out);
void probe_add_step(bench_state *s, const bench_in *in, bench_out *out);

void probe_copy_step(bench_state *s, const bench_in *in, bench_out *out)
{
    (void)s;
    *(bench_real *)out = in->y[0];
}

void probe_multiply_step(bench_state *s, const bench_in *in, bench_out *out)
{
    (void)s;
    *(bench_real *)out = in->y[0] * in->u[0];
}

void probe_add_step(bench_state *s, const bench_in *in, bench_out *out)
{
    (void)s;
    *(bench_real *)out = in->y[0] + in->u[0];
}
