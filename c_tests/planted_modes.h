/*
 * What test_supervisor.c plants in mode estimators: boxes, or spans of time in which modes are refuted.
 */

#if CASE_BOXES
#if CASE_HAS_FILTERS
#define WIDTH 3 /* starts of all sizes */
#else
#define WIDTH 100
#endif

/* Boxes around everything (0), or far off on either side (1, 2), or narrow ones of some ages anywhere (3). */
static void plant(bench *b, uint32_t what)
{
    T(state) whole;

    T(reset)(&whole);
#if CASE_FOLLOWS
    plant_observer(&b->s, draw);
#endif
#if CASE_HAS_FRAMES
    plant_frames(b, what == 3U, draw);
#endif
#if CASE_HAS_FILTERS
    plant_filters(&b->s, what == 3U, draw);
#endif
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        b->s.alive[q] = (what == 3U) ? (1U + draw(whole.alive[q])) : whole.alive[q];
    }
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        const T(real) far = (x_hi[0] - x_lo[0]) * ((what == 1U) ? 1000000 : -1000000);
        const T(real) part = (x_hi[0] - x_lo[0]) * ((T(real))draw(4000U) / 1000);

        b->s.box_lo[i] = (what == 0U) ? whole.box_lo[i] : ((what == 3U) ? (part - (x_hi[0] - x_lo[0])) : far);
        b->s.box_hi[i] = (what == 0U) ? whole.box_hi[i] : ((what == 3U) ? (b->s.box_lo[i] + (part / WIDTH)) : far);
    }
#if CASE_HAS_FILTERS /* measured in the middle of one of the boxes, which begin with what is measured */
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        const uint32_t at = (draw(M(NSHAPE) / M(NX)) * M(NX)) + i;
        const T(real) middle = (b->s.box_lo[at] / 2) + (b->s.box_hi[at] / 2);

        b->in.y[i] = (middle < y_lo[i]) ? y_lo[i] : ((middle > y_hi[i]) ? y_hi[i] : middle);
        b->in.y[i] = (what == 3U) ? b->in.y[i] : 0;
    }
#endif
}
#else
#include "guided_states.h"

/* No mode refuted (0), every one in two spans of time (1, 2), or any spans, with pairs anywhere (3). */
static void plant(bench *b, uint32_t what)
{
    b->s.refuted = (what == 0U) ? 0U : ((what == 3U) ? draw(M(EVERY) + 1U) : M(EVERY));
    b->s.armed = (what == 3U) ? draw(M(EVERY) + 1U) : 0U;
    b->s.last = (what == 3U) ? draw(M(DWELL) + 1U) : ((what == 0U) ? 0U : what);
    b->s.since = (what == 3U) ? draw(M(DWELL)) : 0U;
    for (uint32_t i = 0U; (what == 3U) && (i < M(NSHAPE)); i++)
    {
        const T(real) size = x_hi[i % M(NX)] - x_lo[i % M(NX)];

        b->s.box_lo[i] = x_lo[i % M(NX)] + ((size / 1000) * (T(real))draw(1000U));
        b->s.box_hi[i] = b->s.box_lo[i] + ((size / 1000) * (T(real))draw(1000U));
    }
#if GUIDES
    if (what == 3U)
    {
        b->s.age = (draw(4U) == 0U) ? M(OLDEST) : draw((2U * M(BLANK)) + 3U);
        b->s.decided = draw(M(MODES));
        plant_guided(&b->s, draw);
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            const T(real) size = x_hi[i] - x_lo[i];

            b->s.shown_lo[i] = x_lo[i] + ((size / 1000) * (T(real))draw(500U));
            b->s.shown_hi[i] = x_hi[i] - ((size / 1000) * (T(real))draw(500U));
        }
    }
#endif
}

/* The bits that the numbers of an answer ask for, those of spans of time being held against twice(). */
static uint32_t of_numbers(const T(out) *out)
{
    uint32_t raw = out->raw & M(BIT_TWICE);

#if CASE_GUIDES_FILTER
    for (uint32_t i = 0U; i < M(NF); i++)
    {
        raw |= ((out->f_hat[i] > out->f_bound[i]) || (out->f_hat[i] < -out->f_bound[i])) ? ((uint32_t)2U << i) : 0U;
    }
#elif GUIDES
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        raw |= ((out->r_lo[i] > 0) || (out->r_hi[i] < 0)) ? ((uint32_t)2U << i) : 0U;
    }
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        raw |= (out->x_lo[i] > out->x_hi[i]) ? M(BIT_CROSSED) : 0U;
    }
#endif
    return raw;
}

/* The alarm that spans of time ask for, by the state before a sample and the modes that it refutes. */
static uint32_t twice(const T(state) *before, const T(out) *out)
{
    const uint32_t since = before->since + 1U;
    uint32_t all = 1U;

    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        const uint32_t now = ((before->armed >> q) & 1U) & (((out->mode_set >> q) & 1U) ^ 1U);

        all &= ((before->refuted >> q) & 1U) | now;
    }
    return ((all != 0U) && (before->last != 0U) && ((before->last + since) <= M(DWELL))) ? M(BIT_TWICE) : 0U;
}
#endif
