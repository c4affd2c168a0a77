/*
 * bank_ranges.h: what test_ranges.c tries on a bank of observers, which has no framers: its starts, the wait after them,
 * lost samples, spoilt states, the edge of an alarm, and whom it blames.
 */
#ifndef BANK_RANGES_H
#define BANK_RANGES_H

#include "bench.h"

/* At rest: observers at zero that measure nothing, averages of one size, judged at once. */
static void rest(bench *b, T(real) size)
{
    start(b);
    for (uint32_t i = 0U; i < M(NZ); i++)
    {
        b->s.z[i] = 0;
    }
    for (uint32_t i = 0U; i < M(NA); i++)
    {
        b->s.a[i] = size;
    }
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = 0;
    }
    b->s.wait = 0U;
}

/* How long a start from anywhere takes. */
static uint32_t settling(void)
{
    T(state) whole;

    T(reset)(&whole);
    return whole.wait;
}

/* Averages far beyond every bound that are not yet beyond their limits. */
static T(real) far_off(void)
{
    T(real) size = 1000;
    bench b;

    for (uint32_t n = 0U; n < 20U; n++)
    {
        rest(&b, size);
        (void)T(step)(&b.s, &b.in, &b.out);
        size = (b.s.wait > 0U) ? (size / 2) : size;
    }
    return size;
}

static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK((forgets(&b.s) == 0) && (b.s.wait <= settling()));
    T(reset)(&b.s);
    CHECK((forgets(&b.s) == 0) && (b.s.wait > 0U));
    for (uint32_t i = 0U; i < M(NF); i++)
    {
        CHECK(b.s.left[i] == 0U);
    }
    return 0;
}

/* Nothing is judged before its time, everything from then on; a lost sample that is not paid for begins anew. */
static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n < 3U; n++)
    {
        bench b;

        rest(&b, far_off());
        b.s.wait = n;
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.out.ready == ((n == 0U) ? 1U : 0U)) && ((b.out.raw != 0U) == (n == 0U)));
        CHECK(b.s.wait == ((n == 0U) ? 0U : (n - 1U)));
        CHECK((T(predict)(&b.s, &b.in, &b.out) == M(OK)) && (b.out.ready == 0U) && (b.out.raw == 0U));
        CHECK(b.s.wait == settling());
        for (uint32_t i = 0U; i < M(NA); i++)
        {
            CHECK((b.s.a[i] <= 0) && (b.s.a[i] >= 0));
        }
    }
    return 0;
}

/* A lost sample takes its pay, one short of that is too little. The last measurement stands in; averages stand still. */
static int lost_samples(void)
{
    for (uint32_t credit = 0U; credit <= M(CREDIT); credit++)
    {
        bench b;
        bench twin;

        rest(&b, 1);
        b.s.wait = 1U;
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            b.s.y[i] = (y_lo[i] / 2) + (y_hi[i] / 4);
            b.in.y[i] = y_hi[i];
        }
        b.s.credit = credit;
        twin = b;
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            twin.in.y[i] = b.s.y[i];
        }
        CHECK(T(step)(&twin.s, &twin.in, &twin.out) == M(OK));
        CHECK((twin.s.credit == ((credit < M(CREDIT)) ? (credit + 1U) : M(CREDIT))) && (twin.s.wait == 0U));
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.out.raw == 0U) && (b.out.ready == 0U) && same_bytes(b.s.y, twin.s.y, sizeof(b.s.y)));
        if (credit >= M(GAP))
        {
            CHECK(same_bytes(b.s.z, twin.s.z, sizeof(b.s.z)) && (b.s.wait == 1U) && (b.s.credit == (credit - M(GAP))));
        }
        else
        {
            CHECK((b.s.wait == settling()) && (b.s.credit == 0U));
        }
        for (uint32_t i = 0U; i < M(NA); i++)
        {
            const T(real) left = (credit >= M(GAP)) ? 1 : 0;

            CHECK((b.s.a[i] <= left) && (b.s.a[i] >= left));
        }
    }
    return 0;
}

/* A last measurement that memory has spoilt is not passed on, nor is a credit beyond what is counted kept. */
static int spoilt_measurement(void)
{
    for (uint32_t n = 0U; n < (M(NY) * 3U); n++)
    {
        const T(real) bad[] = { not_a_number(), huge(), -huge() };
        bench b;

        rest(&b, 0);
        b.s.y[n / 3U] = bad[n % 3U];
        b.s.credit = 0xFFFFFFFFU;
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; i < M(NZ); i++)
        {
            CHECK((b.s.z[i] - b.s.z[i]) >= 0);
        }
        b.s.credit = 0xFFFFFFFFU;
        CHECK((T(step)(&b.s, &b.in, &b.out) == M(OK)) && (b.s.credit == M(CREDIT)));
    }
    return 0;
}

/* What is no number any more, or beyond its limit, starts anew, and everything is finite again. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < ((M(NZ) + M(NA)) * 5U); n++)
    {
        const T(real) bad[] = { not_a_number(), huge(), -huge(), 1000000, -1000000 };
        const uint32_t at = n / 5U;
        bench b;

        rest(&b, 0);
        if (at < M(NZ))
        {
            b.s.z[at] = bad[n % 5U];
        }
        else
        {
            b.s.a[at - M(NZ)] = bad[n % 5U];
        }
        for (uint32_t k = 0U; k < 4U; k++)
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        }
        CHECK(b.s.wait > 0U);
        for (uint32_t i = 0U; i < M(NF); i++)
        {
            CHECK((b.out.r[i] - b.out.r[i]) >= 0);
        }
        for (uint32_t i = 0U; i < M(NZ); i++)
        {
            CHECK((b.s.z[i] - b.s.z[i]) >= 0);
        }
    }
    return 0;
}

/* The bit of each observer is the comparison of its level with its bound, down to the last size between. */
static int edge_of_an_alarm(void)
{
    for (uint32_t i = 0U; i < M(NF); i++)
    {
        T(real) quiet = 0;
        const T(real) most = far_off();
        T(real) loud = most;
        bench b;

        for (uint32_t n = 0U; n < 50U; n++)
        {
            const T(real) middle = (quiet / 2) + (loud / 2);

            rest(&b, middle);
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            CHECK(((b.out.raw & bit_of(i)) != 0U) == (b.out.r[i] > b.out.r_bound[i]));
            quiet = ((b.out.raw & bit_of(i)) != 0U) ? quiet : middle;
            loud = ((b.out.raw & bit_of(i)) != 0U) ? middle : loud;
        }
        CHECK((quiet > 0) && (loud < most) && ((loud - quiet) < (loud / 1000)));
    }
    return 0;
}

/* Exactly all but one are raised: that one's fault. Time runs down to nobody; an alarm raises for the whole time again. */
static int whom_it_blames(void)
{
    for (uint32_t mask = 0U; mask < ((uint32_t)1U << M(NF)); mask++)
    {
        int32_t expected = -1;
        uint32_t kept;
        bench b;

        rest(&b, 0);
        for (uint32_t i = 0U; i < M(NF); i++)
        {
            b.s.left[i] = (((mask >> i) & 1U) != 0U) ? 2U : 0U;
            expected = (mask == ((((uint32_t)1U << M(NF)) - 1U) & ~((uint32_t)1U << i))) ? (int32_t)i : expected;
        }
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.out.raised == mask) && (b.out.isolated == expected));
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK)); /* stands still */
        CHECK((b.out.raised == mask) && (b.out.isolated == expected));
        b.s.wait = 0U;
        CHECK((T(step)(&b.s, &b.in, &b.out) == M(OK)) && (b.out.raised == 0U) && (b.out.isolated == -1));
        rest(&b, far_off());
        for (uint32_t k = 0U; k < 32U; k++) /* whatever the debounce */
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            b.s.a[0] = far_off();
        }
        kept = b.s.left[0];
        CHECK((kept > 0U) && ((b.out.raised & 1U) == 1U));
    }
    return 0;
}

/* All that only a bank is tried for. */
#define RUN_BANK() \
    RUN(whom_it_blames); \
    RUN(lost_samples); \
    RUN(spoilt_measurement)

#endif
