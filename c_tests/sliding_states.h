/*
 * States of a mode estimator by sliding modes for random_calls.c.
 */
#include "guided_states.h"

/* Pairs of any size anywhere, loops near rest and far from it, any spans of time. */
static void any_framers(T(state) *s)
{
    T(state) whole;

    T(reset)(&whole);
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        const T(real) least = whole.box_lo[i];
        const T(real) most = whole.box_hi[i];

        s->box_lo[i] = between(least, most) * ((draw(8U) == 0U) ? 1024 : 1);
        s->box_hi[i] = s->box_lo[i] + ((most - least) / (T(real))(1U << draw(12U)));
    }
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        s->shown_lo[i] = between(x_lo[i], x_hi[i]);
        s->shown_hi[i] = between(s->shown_lo[i], x_hi[i]);
    }
    for (uint32_t i = 0U; i < M(NTWIST); i++)
    {
        s->twist_lo[i] = between(-1, 1) * (T(real))(1U << draw(12U)) / 64;
        s->twist_hi[i] = between(-1, 1) * (T(real))(1U << draw(12U)) / 64;
        s->rate_lo[i] = between(-1, 1) * (T(real))(1U << draw(16U));
        s->rate_hi[i] = between(-1, 1) * (T(real))(1U << draw(16U));
    }
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        s->level[q] = between(0, 1) * (T(real))(1U << draw(12U));
    }
    s->decided = draw(M(MODES) + 1U);
    s->best = draw(M(MODES) + 1U);
    s->age = (draw(16U) == 0U) ? (M(OLDEST) - draw(2U)) : draw(2U * M(BLANK) + 3U);
    s->since = draw(M(DWELL) + 2U);
    s->last = draw(M(DWELL) + 2U);
    s->fresh = draw(M(EVERY) + 1U) & draw(M(EVERY) + 1U);
    if (draw(16U) == 0U) /* small means, of all modes the same; none, or less: memory upset */
    {
        s->fresh = M(EVERY);
        for (uint32_t q = 0U; q < M(MODES); q++)
        {
            s->level[q] = (((T(real))draw(3U) - 1) * between(0, 1)) / (T(real))(1U << draw(12U));
            s->level[q] = (q > 0U) ? s->level[0] : s->level[q];
        }
        for (uint32_t i = 0U; i < M(NTWIST); i++)
        {
            s->rate_lo[i] = 0;
            s->rate_hi[i] = 0;
        }
    }
    s->armed = draw(M(EVERY) + 1U);
    s->refuted = draw(M(EVERY) + 1U);
    if (draw(2U) == 0U) /* where a measurement can please the decided mode: what it guides goes on */
    {
        s->decided = draw(M(MODES));
        s->best = s->decided;
        for (uint32_t q = 0U; q < M(MODES); q++)
        {
            s->level[q] = (q == s->decided) ? 0 : (T(real))1048576; /* above any mean of rates */
        }
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            const T(real) out = between(0, x_hi[i] - x_lo[i]) * (T(real))draw(2U); /* a step may leave the range */

            s->shown_lo[i] = whole.shown_lo[i] - out;
            s->shown_hi[i] = whole.shown_hi[i] + out;
            s->box_lo[(s->decided * M(NX)) + i] = whole.shown_lo[i];
            s->box_hi[(s->decided * M(NX)) + i] = whole.shown_hi[i];
        }
    }
#if GUIDES
    plant_guided(s, draw);
#endif
}
