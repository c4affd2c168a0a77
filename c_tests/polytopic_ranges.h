/*
 * polytopic_ranges.h: what test_ranges.c tries on a polytopic observer, which has no framers: its start, the rows of its
 * table, limits of its state, the edge of an alarm.
 */
#ifndef POLYTOPIC_RANGES_H
#define POLYTOPIC_RANGES_H

#include "bench.h"

static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK((forgets(&b.s) == 0) && (b.s.since <= M(LAST)));
    T(reset)(&b.s);
    CHECK((forgets(&b.s) == 0) && (b.s.since == 0U));
    return 0;
}

/* The table goes on row by row to the last, which holds; a sample without measurement, or z at a limit, leads back. */
static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n <= (M(LAST) + 1U); n++)
    {
        bench b;

        start(&b);
        T(reset)(&b.s);
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            b.in.y[i] = b.s.y[i];
        }
        b.s.since = (n <= M(LAST)) ? n : 0xFFFFFFFFU;
        CHECK((T(step)(&b.s, &b.in, &b.out) == M(OK)) && (b.out.settled == ((n >= M(LAST)) ? 1U : 0U)));
        CHECK(b.s.since == ((n >= M(LAST)) ? M(LAST) : (n + 1U)));
        b.s.since = n;
        CHECK((T(predict)(&b.s, &b.in, &b.out) == M(OK)) && (b.s.since == 0U));
    }
    return 0;
}

/* Far above a z leads to one limit, far below to the other, no number at all to the lower; each starts the table anew,
 * but where the state is solved for at every sample. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < (M(NX) * 4U); n++)
    {
        const T(real) bad[] = { not_a_number(), huge(), -huge(), (T(real))1e30 };
        bench b;

        start(&b);
        b.s.z[n / 4U] = bad[n % 4U];
        b.s.since = M(LAST);
        CHECK((T(step)(&b.s, &b.in, &b.out) == M(OK)) && (b.out.inside <= 1U));
        if (((CASE_SOLVED >> (n / 4U)) & 1U) == 0U)
        {
            CHECK(b.out.assured == ((CASE_HOLDS_FAULTS != 0) ? b.out.inside : 0U));
            CHECK(b.s.since == 0U);
        }
        for (uint32_t k = 0U; k < 3U; k++)
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            for (uint32_t i = 0U; i < M(NX); i++)
            {
                CHECK(((b.s.z[i] - b.s.z[i]) >= 0) && ((b.out.x_hat[i] - b.out.x_hat[i]) >= 0));
            }
        }
    }
    return 0;
}

/* The residual is affine in y: just within its bound it is no fault, a hair beyond it is. */
static int edge_of_an_alarm(void)
{
    for (uint32_t n = 0U; n < (M(NY) * 2U); n++)
    {
        const uint32_t i = n / 2U;
        bench b, trial;
        T(real) slope;
        T(real) here;
        T(real) edge;

        start(&b);
        T(reset)(&b.s);
        for (uint32_t k = 0U; k < M(NY); k++)
        {
            b.in.y[k] = b.s.y[k];
        }
        b.s.since = M(LAST);
        trial = b;
        CHECK(T(step)(&trial.s, &trial.in, &trial.out) == M(OK));
        here = trial.out.r[i];
        trial = b;
        trial.in.y[i] = b.in.y[i] + ((y_hi[i] - y_lo[i]) / 4);
        CHECK(T(step)(&trial.s, &trial.in, &trial.out) == M(OK));
        slope = (trial.out.r[i] - here) / ((y_hi[i] - y_lo[i]) / 4);
        if (!((slope > 0) || (slope < 0)))
        {
            continue; /* the estimate takes this output as it is */
        }
        edge = ((((n % 2U) != 0U) ? trial.out.r_bound[i] : -trial.out.r_bound[i]) - here) / slope;
        if (((b.in.y[i] + edge) > y_lo[i]) && ((b.in.y[i] + edge) < y_hi[i]))
        {
            trial = b;
            trial.in.y[i] = b.in.y[i] + (edge - (edge / 1024));
            CHECK(T(step)(&trial.s, &trial.in, &trial.out) == M(OK));
            CHECK((trial.out.raw & bit_of(i)) == 0U);
            trial = b;
            trial.in.y[i] = b.in.y[i] + (edge + (edge / 1024));
            CHECK(T(step)(&trial.s, &trial.in, &trial.out) == M(OK));
            CHECK((trial.out.raw & bit_of(i)) != 0U);
        }
    }
    return 0;
}

#endif
