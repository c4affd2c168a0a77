/*
 * filter_ranges.h: what test_ranges.c tries on a fault estimation filter, which has no framers: its start, the rows of
 * its table, a state beyond every limit, the edge of an alarm.
 */
#ifndef FILTER_RANGES_H
#define FILTER_RANGES_H

#include "bench.h"

static int at_rest(const T(state) *s)
{
    for (uint32_t i = 0U; i < M(NS); i++)
    {
        CHECK((s->xi[i] <= 0) && (s->xi[i] >= 0));
    }
    return 0;
}

static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK((at_rest(&b.s) == 0) && (forgets(&b.s) == 0));
    CHECK((b.s.since == 0U) || (b.s.since == M(LOST)) || (b.s.since == M(LAST)));
    T(reset)(&b.s);
    CHECK((at_rest(&b.s) == 0) && (forgets(&b.s) == 0) && (b.s.since == 0U));
    return 0;
}

/* The table goes on row by row, from both of its beginnings to the last row, which holds; a lost sample leads back. */
static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n <= (M(LAST) + 1U); n++)
    {
        bench b;

        start(&b);
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            b.in.y[i] = 0;
        }
        b.s.since = (n <= M(LAST)) ? n : 0xFFFFFFFFU;
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK(b.s.since == ((((n + 1U) == M(LOST)) || (n >= M(LAST))) ? M(LAST) : (n + 1U)));
        b.s.since = n;
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.s.since == ((n >= M(LOST)) ? M(LOST) : 0U)) && (at_rest(&b.s) == 0));
    }
    return 0;
}

/* A state far beyond every limit, or no number at all, starts at zero and from anywhere. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < (M(NS) * 4U * M(MODES)); n++)
    {
        const T(real) bad[] = { not_a_number(), huge(), -huge(), (T(real))1e30 };
        bench b;

        start(&b);
        *told(&b.in) = n / (M(NS) * 4U);
        b.s.xi[(n / 4U) % M(NS)] = bad[n % 4U];
        b.s.since = M(LAST);
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((at_rest(&b.s) == 0) && (b.s.since == 0U));
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; i < M(NF); i++)
        {
            CHECK((b.out.f_hat[i] - b.out.f_hat[i]) >= 0);
        }
    }
    return 0;
}

/* The estimate of a filter at rest is linear in y: just within its bound it is no fault, a hair beyond it is. */
static int edge_of_an_alarm(void)
{
    for (uint32_t n = 0U; n < (M(NY) * 2U); n++)
    {
        bench b, trial;
        T(real) edge;

        start(&b);
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            b.in.y[i] = 0;
        }
        b.s.since = M(LAST);
        trial = b;
        trial.in.y[n / 2U] = y_hi[n / 2U] / 2;
        CHECK(T(step)(&trial.s, &trial.in, &trial.out) == M(OK));
        edge = ((trial.out.f_bound[0] / trial.out.f_hat[0]) * (y_hi[n / 2U] / 2)) * (((n % 2U) != 0U) ? 1 : -1);
        if ((edge > (y_lo[n / 2U] / 2)) && (edge < (y_hi[n / 2U] / 2)) && (M(NF) == 1U))
        {
            trial = b;
            trial.in.y[n / 2U] = edge - (edge / 65536);
            CHECK((T(step)(&trial.s, &trial.in, &trial.out) == M(OK)) && (trial.out.raw == 0U));
            trial = b;
            trial.in.y[n / 2U] = edge + (edge / 65536);
            CHECK((T(step)(&trial.s, &trial.in, &trial.out) == M(OK)) && (trial.out.raw == 1U));
        }
    }
    return 0;
}

#endif
