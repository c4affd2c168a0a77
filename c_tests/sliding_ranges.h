/*
 * What test_ranges.c asks of a mode estimator by sliding modes: pairs of bounds per mode, loops, spans of time.
 */
#include "guided_states.h"

/* Every pair at a box, nothing remembered. */
static int begins_at(const T(state) *s, const T(real) *lo, const T(real) *hi)
{
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        CHECK(same_bytes(&s->box_lo[q * M(NX)], lo, M(NX) * sizeof(T(real))));
        CHECK(same_bytes(&s->box_hi[q * M(NX)], hi, M(NX) * sizeof(T(real))));
    }
    CHECK((s->fresh == M(EVERY)) && (s->armed == M(EVERY)) && (s->refuted == 0U));
    CHECK((s->decided == 0U) && (s->best == 0U) && (s->age == 0U) && (s->since == 0U) && (s->last == 0U));
    return 0;
}

/* Without a measurement: the bounds as they are while the decision stands, unless they have crossed. */
static int predicted(void)
{
    for (uint32_t n = 0U; n < 8U; n++)
    {
        bench b;

        start(&b);
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            b.s.shown_lo[i] = (x_lo[i] / 2) + (x_hi[i] / 2);
            b.s.shown_hi[i] = b.s.shown_lo[i];
#if CASE_GUIDED
            b.s.told_lo[i] = x_lo[i];
            b.s.told_hi[i] = x_hi[i];
#elif CASE_GUIDES_POINT
            b.s.told_x_hat[i] = b.s.shown_lo[i];
            b.s.told_shape[i] = ((n % 2U) != 0U) ? 0 : (x_hi[i] - x_lo[i]);
#endif
        }
#if BOUNDS && (CASE_NU > 0)
        for (uint32_t i = 0U; i < M(NU); i++)
        {
            b.s.told_u[i] = b.in.u[i];
        }
#endif
        b.s.shown_lo[0] = ((n % 2U) != 0U) ? x_hi[0] : b.s.shown_lo[0];
        b.s.age = M(BLANK) + 1U - ((n / 2U) % 2U);
        b.s.decided = M(MODES) - 1U + (n / 4U);
        b.s.best = b.s.decided;
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.out.mode == ((n < 4U) ? (M(MODES) - 1U) : 0U)) && (b.out.candidate == b.out.mode));
        if ((n % 4U) == 0U)
        {
            CHECK((b.out.x_lo[0] <= b.out.x_hi[0]) && (b.out.x_lo[0] >= b.out.x_hi[0]));
        }
        else if (BOUNDS && ((n % 4U) == 1U)) /* these go on, by a step of the mode */
        {
            CHECK((b.out.x_lo[0] >= x_lo[0]) && (b.out.x_lo[0] < b.out.x_hi[0]) && (b.out.x_hi[0] <= x_hi[0]));
            CHECK((b.out.x_lo[0] > x_lo[0]) || (b.out.x_hi[0] < x_hi[0]));
        }
        else
        {
            CHECK(same_bytes(b.out.x_lo, x_lo, sizeof(x_lo)) && same_bytes(b.out.x_hi, x_hi, sizeof(x_hi)));
        }
    }
    return 0;
}

static int init_and_reset_boxes(void)
{
    bench b;

    CHECK(predicted() == 0);

    start(&b);
    CHECK((forgets(&b.s) == 0) && (begins_at(&b.s, x0_lo, x0_hi) == 0));
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK(same_bytes(b.out.x_lo, x_lo, sizeof(x_lo)) && same_bytes(b.out.x_hi, x_hi, sizeof(x_hi)));
    CHECK((b.out.mode_set == M(EVERY)) && (b.out.mode == 0U) && (b.out.age == 0U));
    b.s.decided = M(MODES) - 1U;
    b.s.best = b.s.decided;
    b.s.rate_hi[0] = 1;
    b.s.level[0] = 1;
    T(reset)(&b.s);
    CHECK((forgets(&b.s) == 0) && (begins_at(&b.s, x_lo, x_hi) == 0));
    CHECK((b.s.rate_hi[0] <= 0) && (b.s.rate_hi[0] >= 0) && (b.s.level[0] <= 0) && (b.s.level[0] >= 0));
    return 0;
}

/* Pairs far off are refuted and begin anew; far within one bound only, the other is cut. */
static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n < (M(MODES) * 2U); n++)
    {
        const uint32_t at = (n / 2U) * M(NX);
        bench b;

        start(&b);
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            const T(real) far = (x_hi[i] - x_lo[i]) * 1000000;

            b.s.box_lo[at + i] = ((n % 2U) != 0U) ? -far : far;
            b.s.box_hi[at + i] = far;
        }
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            const T(real) some = (x_hi[i] - x_lo[i]) * 1000;

            CHECK((b.s.box_lo[at + i] > -some) && (b.s.box_hi[at + i] < some));
        }
    }
    return 0;
}

/* A state spoilt in memory, even to NaN, answers with numbers and modes, and is whole again after a few samples. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < (6U * M(NSHAPE)); n++)
    {
        const T(real) bad[] = { not_a_number(), huge(), -huge() };
        bench b;

        start(&b);
        for (uint32_t k = 0U; k < (n / M(NSHAPE)); k++)
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        }
        b.s.box_lo[n % M(NSHAPE)] = bad[n % 3U];
        b.s.shown_hi[n % M(NX)] = bad[(n + 1U) % 3U];
        b.s.twist_lo[n % M(NTWIST)] = bad[n % 3U];
        b.s.rate_hi[n % M(NTWIST)] = bad[n % 3U];
        b.s.level[n % M(MODES)] = bad[n % 3U];
#if CASE_GUIDED
        b.s.told_lo[n % M(NX)] = bad[n % 3U];
        b.s.told_hi[n % M(NX)] = bad[(n / 3U) % 3U];
        b.s.told_y[n % M(NY)] = bad[(n + 1U) % 3U];
#elif CASE_GUIDES_POINT
        b.s.told_x_hat[n % M(NX)] = bad[n % 3U];
        b.s.told_shape[n % M(NTOLD)] = bad[(n / 3U) % 3U];
        b.s.told_y[n % M(NY)] = bad[(n + 1U) % 3U];
#elif CASE_GUIDES_FILTER
        b.s.told_xi[n % M(NS)] = bad[n % 3U];
        b.s.told_stage = 0xFFFFFFFFU - (n % 2U);
        b.s.told_since = 0xFFFFFFFFU << (n % 32U);
#endif
        b.s.decided = 0xFFFFFFFFU;
        b.s.best = 0xFFFFFFFEU;
        b.s.age = ((n % 2U) != 0U) ? 0xFFFFFFFFU : 3U;
        b.s.since = 0xFFFFFFFFU - n;
        b.s.last = n * 0x10000000U;
        b.s.fresh = n;
        b.s.armed = 0xFFFFFFFFU;
        b.s.refuted = 0xFFFFFFFFU << (n % 32U);
        for (uint32_t k = 0U; k < 6U; k++)
        {
            CHECK(((k == 4U) ? T(predict)(&b.s, &b.in, &b.out) : T(step)(&b.s, &b.in, &b.out)) == M(OK));
            CHECK((b.out.mode < M(MODES)) && (b.out.mode_set <= M(EVERY)));
            for (uint32_t i = 0U; i < M(NX); i++)
            {
                CHECK(BOUNDS || (b.out.x_lo[i] <= b.out.x_hi[i])); /* of two the narrower may cross */
                CHECK((b.out.x_lo[i] <= huge()) && (b.out.x_hi[i] >= -huge()));
            }
        }
        for (uint32_t i = 0U; i < M(NTWIST); i++)
        {
            CHECK(((b.s.rate_hi[i] - b.s.rate_hi[i]) >= 0) && ((b.s.twist_lo[i] - b.s.twist_lo[i]) >= 0));
        }
        for (uint32_t q = 0U; q < M(MODES); q++)
        {
            CHECK((b.s.level[q] - b.s.level[q]) >= 0);
        }
    }
    return 0;
}

/* Two spans that last the dwell time together are an alarm, a sample more is none; one span alone is none. */
static int edge_of_an_alarm(void)
{
    for (uint32_t last = 0U; last <= M(DWELL); last++)
    {
        for (uint32_t since = 1U; since <= M(DWELL); since++)
        {
            bench b;

            start(&b);
            b.s.refuted = M(EVERY);
            b.s.last = last;
            b.s.since = since - 1U;
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            CHECK((b.out.raw & M(BIT_TWICE)) == (((last > 0U) && ((last + since) <= M(DWELL))) ? M(BIT_TWICE) : 0U));
        }
    }
    return 0;
}
