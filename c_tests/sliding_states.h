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
    s->age = draw(2U * M(BLANK) + 3U);
    s->since = draw(M(DWELL) + 2U);
    s->last = draw(M(DWELL) + 2U);
    s->fresh = draw(M(EVERY) + 1U) & draw(M(EVERY) + 1U);
    s->armed = draw(M(EVERY) + 1U);
    s->refuted = draw(M(EVERY) + 1U);
#if GUIDES
    plant_guided(s, draw);
#endif
}
