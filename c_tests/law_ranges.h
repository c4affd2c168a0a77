/*
 * law_ranges.h: what test_ranges.c tries on a tracking law: references at and beyond their ends, inputs and integrals
 * that are cut, samples without measurement.
 */
#ifndef LAW_RANGES_H
#define LAW_RANGES_H

#include "bench.h"

static const T(real) ref_most[] = CASE_REFERENCE;
static const T(real) s_most[] = CASE_LIMIT;

/* A used observer with the measurement of the initial box, a fresh law, references in the middle. */
static void begin(bench *b, T(law) *law, T(real) ref[M(NREF)])
{
    start(b);
    T(law_init)(law);
    for (uint32_t i = 0U; i < M(NREF); i++)
    {
        ref[i] = 0;
    }
}

static int near(T(real) a, T(real) b)
{
    return ((a - b) <= 0) && ((b - a) <= 0);
}

/* Every end of every reference is taken; beyond it, without a number, or with a measurement out of range nothing is. */
static int references(void)
{
    for (uint32_t n = 0U; n < (M(NREF) * 5U); n++)
    {
        const uint32_t i = n / 5U;
        const T(real) tried[] = { ref_most[i], -ref_most[i], beyond(-ref_most[i], ref_most[i], 0),
                                  beyond(-ref_most[i], ref_most[i], 1), not_a_number() };
        bench b, twin;
        T(law) law, old;
        T(real) ref[M(NREF)];

        begin(&b, &law, ref);
        CHECK(law.limited == 0U);
        ref[i] = tried[n % 5U];
        twin = b;
        old = law;
        if ((n % 5U) < 2U)
        {
            CHECK((T(track)(&b.s, &law, ref, &b.in, &b.out) == M(OK)) && (law.limited == 0U));
            CHECK((law.s[i] > 0) == (ref[i] > twin.in.y[i]));
            b.in.y[0] = huge();
            twin = b;
            old = law;
            CHECK(T(track)(&b.s, &law, ref, &b.in, &b.out) == M(BAD_OUTPUT));
        }
        else
        {
            CHECK(T(track)(&b.s, &law, ref, &b.in, &b.out) == M(BAD_INPUT));
        }
        CHECK(same_bytes(&b, &twin, sizeof(b)) && same_bytes(&law, &old, sizeof(law)));
    }
    return 0;
}

/* An integral far off moves an input to one end of its range, and comes back to its own limit. */
static int inputs_are_cut(void)
{
    uint32_t low = 0U, high = 0U;

    for (uint32_t n = 0U; n < (M(NREF) * 6U); n++)
    {
        const T(real) far[] = { (T(real))1e6, -(T(real))1e6, not_a_number() };
        const uint32_t i = n / 6U;
        bench b;
        T(law) law;
        T(real) ref[M(NREF)];

        begin(&b, &law, ref);
        law.s[i] = far[n % 3U];
        if ((n % 6U) < 3U)
        {
            CHECK(T(track)(&b.s, &law, ref, &b.in, &b.out) == M(OK));
            CHECK(law.limited == (M(CUT_INPUT) | M(CUT_INTEGRAL)));
            CHECK(near(law.s[i], ((n % 3U) == 0U) ? s_most[i] : -s_most[i]));
        }
        else
        {
            CHECK((T(coast)(&b.s, &law, &b.in, &b.out) == M(OK)) && (law.limited == M(CUT_INPUT)));
        }
        for (uint32_t k = 0U; k < M(NU); k++)
        {
            CHECK((b.in.u[k] >= u_lo[k]) && (b.in.u[k] <= u_hi[k]));
            low += (uint32_t)near(b.in.u[k], u_lo[k]);
            high += (uint32_t)near(b.in.u[k], u_hi[k]);
        }
    }
    CHECK((low > 0U) && (high > 0U));
    return 0;
}

/* Without measurement the law says of the last one what it would say of it again, and waits. */
static int coasting(void)
{
    bench b, twin;
    T(law) law, other;
    T(real) ref[M(NREF)];

    begin(&b, &law, ref);
    law.s[0] = s_most[0] / 2;
    twin = b;
    other = law;
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        twin.in.y[i] = twin.s.y[i];
        b.in.y[i] = not_a_number();
    }
    CHECK(T(track)(&twin.s, &other, ref, &twin.in, &twin.out) == M(OK));
    CHECK((T(coast)(&b.s, &law, &b.in, &b.out) == M(OK)) && (law.limited == 0U));
    CHECK(same_bytes(b.in.u, twin.in.u, sizeof(b.in.u)) && near(law.s[0], s_most[0] / 2));
    return 0;
}

#endif

#define RUN_LAW() \
    RUN(references); \
    RUN(inputs_are_cut); \
    RUN(coasting)
