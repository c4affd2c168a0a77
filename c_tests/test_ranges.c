/*
 * Ranges and framers: the ends of every declared range, the cut of the framers to the range of x, the edge of
 * an alarm, and a state that an upset of the memory has spoilt.
 */
#include "bench.h"

/* Step and predict answer as told; refused calls change nothing. */
static int answers(bench *b, T(status) step, T(status) predict)
{
    const bench before = *b;

    CHECK(T(step)(&b->s, &b->in, &b->out) == step);
    CHECK((step == M(OK)) || same_bytes(b, &before, sizeof(before)));
    CHECK(T(predict)(&b->s, &b->in, &b->out) == predict);
    CHECK((predict == M(OK)) || same_bytes(b, &before, sizeof(before)));
    return 0;
}

/* One channel at both ends, beyond them, infinite and NaN; then back in the middle. */
static int ends(bench *b, T(real) *channel, T(real) lo, T(real) hi, T(status) step)
{
    const T(status) predict = (step == M(BAD_OUTPUT)) ? M(OK) : step;
    const T(real) middle = *channel;
    const T(real) nan = not_a_number();
    const T(real) bad[] = { beyond(lo, hi, 0), beyond(lo, hi, 1), nan, -huge(), huge() };

    *channel = lo;
    CHECK(answers(b, M(OK), M(OK)) == 0);
    *channel = hi;
    CHECK(answers(b, M(OK), M(OK)) == 0);
    for (uint32_t i = 0U; i < (sizeof(bad) / sizeof(bad[0])); i++)
    {
        *channel = bad[i];
        CHECK(answers(b, step, predict) == 0);
    }
    *channel = middle;
    return 0;
}

static int every_end_of_every_range(void)
{
    bench b;

    start(&b);
    for (*told(&b.in) = 0U; *told(&b.in) < M(MODES); (*told(&b.in))++)
    {
#if CASE_NU > 0
        for (uint32_t i = 0U; i < M(NU); i++)
        {
            CHECK(ends(&b, &b.in.u[i], u_lo[i], u_hi[i], M(BAD_INPUT)) == 0);
        }
#endif
#if CASE_NTHETA > 0
        for (uint32_t i = 0U; i < M(NTHETA); i++)
        {
            CHECK(ends(&b, &b.in.theta[i], theta_lo[*told(&b.in)][i], theta_hi[*told(&b.in)][i], M(BAD_PARAMETER)) == 0);
        }
#endif
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            CHECK(ends(&b, &b.in.y[i], y_lo[i], y_hi[i], M(BAD_OUTPUT)) == 0);
        }
    }
#if CASE_TOLD
    CHECK(answers(&b, M(BAD_MODE), M(BAD_MODE)) == 0);
#endif
    return 0;
}

/* What a state says that remembers nothing. */
static int forgets(const T(state) *s)
{
#if CASE_HAS_PHASE
    static const bench nothing;

#if CASE_NU > 0
    CHECK(same_bytes(s->u, nothing.s.u, sizeof(s->u)));
#endif
    CHECK(same_bytes(s->y, nothing.s.y, sizeof(s->y)) && (s->phase == 0U));
#endif
#if CASE_HAS_MODE
    CHECK(s->mode == M(MODES));
#endif
#if CASE_DWELL_ADD > 0
    CHECK((s->bucket == 0U) && (s->too_fast == 0U));
#endif
    CHECK((s->run == 0U) && (s->latched == 0U));
    return 0;
}

#if CASE_BOXES
#include "ranges_of_boxes.h"
#elif CASE_SLIDING
#include "sliding_ranges.h"
#elif CASE_FILTER
#include "filter_ranges.h"
#elif CASE_POLYTOPIC
#include "polytopic_ranges.h"
#elif CASE_BANK
#include "bank_ranges.h"
#elif !CASE_POINT
static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK(same_bytes(b.s.x_lo, x0_lo, sizeof(x0_lo)) && same_bytes(b.s.x_hi, x0_hi, sizeof(x0_hi)));
    CHECK(forgets(&b.s) == 0);
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK(same_bytes(b.out.x_lo, x0_lo, sizeof(x0_lo)) && same_bytes(b.out.x_hi, x0_hi, sizeof(x0_hi)));
    T(reset)(&b.s);
    CHECK(same_bytes(b.s.x_lo, x_lo, sizeof(x_lo)) && same_bytes(b.s.x_hi, x_hi, sizeof(x_hi)));
    CHECK(forgets(&b.s) == 0);
    return 0;
}

/* Framers of one state far off, the others in the middle; then a sample without measurement cuts them. */
static void cut_from(bench *b, uint32_t mode, uint32_t which, int above)
{
    start(b);
    *told(&b->in) = mode;
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        const T(real) far = (x_hi[i] - x_lo[i]) * 1000000;
        const T(real) off = (above != 0) ? far : -far;

        b->s.x_lo[i] = (x_lo[i] / 2) + (x_hi[i] / 2) + ((i == which) ? off : 0);
        b->s.x_hi[i] = b->s.x_lo[i];
    }
    (void)T(predict)(&b->s, &b->in, &b->out);
    (void)T(predict)(&b->s, &b->in, &b->out); /* its answer shows the framers that the first one left */
}

/* Not beyond the range, and on its very end if near it. */
static int is_cut(T(real) value, T(real) lo, T(real) hi)
{
    const T(real) near = (hi - lo) / 100;

    CHECK((value >= lo) && (value <= hi));
    CHECK((value <= lo) || (value > (lo + near)));
    CHECK((value >= hi) || (value < (hi - near)));
    return 0;
}

/* Far above leads to one end of the range, far below to the other. */
static int reaches_both(T(real) above, T(real) below, T(real) lo, T(real) hi)
{
    return ((above >= hi) && (below <= lo)) || ((above <= lo) && (below >= hi));
}

static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n < (M(MODES) * M(NX)); n++)
    {
        bench a, b;

        cut_from(&a, n / M(NX), n % M(NX), 1);
        cut_from(&b, n / M(NX), n % M(NX), 0);
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            const int lower = reaches_both(a.out.x_lo[i], b.out.x_lo[i], x_lo[i], x_hi[i]);
            const int upper = reaches_both(a.out.x_hi[i], b.out.x_hi[i], x_lo[i], x_hi[i]);

            CHECK(lower == upper);
            CHECK(is_cut(a.out.x_lo[i], x_lo[i], x_hi[i]) == 0);
            CHECK(is_cut(a.out.x_hi[i], x_lo[i], x_hi[i]) == 0);
            CHECK(is_cut(b.out.x_lo[i], x_lo[i], x_hi[i]) == 0);
            CHECK(is_cut(b.out.x_hi[i], x_lo[i], x_hi[i]) == 0);
        }
    }
    return 0;
}

/* Both framers at one end of every range, and a call in this mode or after a switch: the next ones are in order, and
 * move apart by what is largest there. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < (M(MODES) * M(MODES) * 4U); n++)
    {
        const T(real) *const end = ((n % 2U) != 0U) ? x_hi : x_lo;
        bench b;

        start(&b);
        *told(&b.in) = (n / 4U) % M(MODES);
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            b.s.x_lo[i] = end[i];
            b.s.x_hi[i] = end[i];
        }
        *told(&b.in) = (n / 4U) / M(MODES);
        CHECK((((n / 2U) % 2U) != 0U) || (T(step)(&b.s, &b.in, &b.out) == M(OK)));
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        for (uint32_t i = 0U; (M(BITS) == M(NY)) && (i < M(NX)); i++)
        {
            CHECK(b.out.x_lo[i] <= b.out.x_hi[i]);
        }
    }
    return 0;
}
#else
/* The bounds hold the box, and little more: an ellipsoid around it is wider by the root of its sides. */
static int holds(const T(out) *out, const T(real) *lo, const T(real) *hi)
{
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        CHECK((out->x_lo[i] <= lo[i]) && (out->x_hi[i] >= hi[i]));
        CHECK((out->x_hi[i] - out->x_lo[i]) <= ((hi[i] - lo[i]) * (M(NX) + 1U)));
    }
    return 0;
}

static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK(forgets(&b.s) == 0);
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK(holds(&b.out, x0_lo, x0_hi) == 0);
    T(reset)(&b.s);
    CHECK(forgets(&b.s) == 0);
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK(holds(&b.out, x_lo, x_hi) == 0);
    return 0;
}

/* An estimate far off is brought back: into a box of some ranges about zero. */
static int framers_are_cut(void)
{
    for (uint32_t n = 0U; n < (M(MODES) * 6U); n++)
    {
        bench b;

        start(&b);
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        *told(&b.in) = (n / 2U) % M(MODES);
        b.s.phase = n / (2U * M(MODES)); /* as it is, to be moved without or with its measurement */
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            b.s.x_hat[i] = (((n % 2U) != 0U) ? 1 : -1) * ((x_hi[i] - x_lo[i]) * 1000000);
        }
        (void)T(predict)(&b.s, &b.in, &b.out);
        (void)T(predict)(&b.s, &b.in, &b.out);
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            CHECK((b.out.x_hat[i] < ((x_hi[i] - x_lo[i]) * 1000)) && (b.out.x_hat[i] > ((x_lo[i] - x_hi[i]) * 1000)));
        }
    }
    return 0;
}

/* A set spoilt in memory, even to NaN, starts again from the declared range. */
static int framers_at_the_ends(void)
{
#if CASE_HAS_SHAPE
    for (uint32_t n = 0U; n < (M(NSHAPE) * 2U); n++)
    {
        bench b;

        start(&b);
        for (uint32_t k = 0U; (n >= M(NSHAPE)) && (k < 3U); k++) /* under way, and the mode changes */
        {
            *told(&b.in) = (k / 2U) % M(MODES);
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        }
        b.s.shape[n % M(NSHAPE)] = ((n % 2U) != 0U) ? not_a_number() : huge();
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK)); /* by now the whole set is spoilt, if it is not mended */
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            CHECK((b.out.x_lo[i] - b.out.x_lo[i]) >= 0);
            CHECK((b.out.x_hi[i] - b.out.x_hi[i]) >= 0);
        }
    }
#endif
    return 0;
}
#endif

#if !FOLLOWS && !CASE_SLIDING
/* A measurement just on its bound is no fault; one a hair beyond it is. */
static int edge_of_an_alarm(void)
{
    for (uint32_t n = 0U; n < (M(NY) * 2U); n++)
    {
        const uint32_t i = n / 2U;
        bench b, trial;
        T(real) edge;

        start(&b);
        b.in.y[i] = 0;
        trial = b;
        if (T(step)(&trial.s, &trial.in, &trial.out) == M(OK))
        {
            edge = ((n % 2U) != 0U) ? r_most(&trial.out, i) : r_least(&trial.out, i);
            b.in.y[i] = edge;
#if CASE_POINT || CASE_BOXES /* the difference to the estimate, or to the noise, is rounded */
            b.in.y[i] -= ((((n % 2U) != 0U) ? 1 : -1) * (((edge > 0) ? edge : -edge) / 65536));
#endif
            trial = b;
            if ((edge > y_lo[i]) && (edge < y_hi[i]) && (T(step)(&trial.s, &trial.in, &trial.out) == M(OK)))
            {
                CHECK((trial.out.raw & bit_of(i)) == 0U);
            }
            b.in.y[i] = edge + ((((n % 2U) != 0U) ? 1 : -1) * (((edge > 0) ? edge : -edge) / 65536));
            trial = b;
            if (((edge > 0) || (edge < 0)) && (T(step)(&trial.s, &trial.in, &trial.out) == M(OK)))
            {
                CHECK((trial.out.raw & bit_of(i)) != 0U);
            }
        }
    }
    return 0;
}
#endif

#if CASE_HAS_PHASE
/* Whether a step from a spoilt state is that from a state with some mode: no switch, no other table. */
static int acts_as_some_mode(uint32_t mode, uint32_t phase)
{
    int found = 0;

    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        bench b, twin;

        start(&b);
        (void)T(step)(&b.s, &b.in, &b.out);
        *told(&b.in) = q;
        b.s.phase = phase;
        twin = b;
#if CASE_HAS_MODE
        b.s.mode = mode;
        twin.s.mode = q;
#endif
        (void)T(step)(&b.s, &b.in, &b.out);
        (void)T(step)(&twin.s, &twin.in, &twin.out);
        found |= same_bytes(&b, &twin, sizeof(b));
    }
    (void)mode;
    return found;
}
#endif
static int spoilt_state(void)
{
#if CASE_HAS_PHASE
    static const uint32_t phases[] = { 1U, 2U, 3U, 0xFFFFFFFFU };

    for (uint32_t n = 0U; n < 4U; n++)
    {
        CHECK(acts_as_some_mode(M(MODES), phases[n]) && acts_as_some_mode(0xFFFFFFFFU, phases[n]));
    }
#endif
    return 0;
}

/* A spoilt origin reads no other table than that of some mode. */
static int spoilt_origin(void)
{
#if CASE_HAS_ORIGIN
    for (uint32_t phase = 0U; phase < 3U; phase++)
    {
        bench b, twin;

        start(&b);
        (void)T(step)(&b.s, &b.in, &b.out);
        b.s.phase = phase;
        twin = b;
        b.s.origin = 0xFFFFFFFFU;
        twin.s.origin = 0U;
        (void)T(step)(&b.s, &b.in, &b.out);
        (void)T(step)(&twin.s, &twin.in, &twin.out);
        CHECK(same_bytes(&b.out, &twin.out, sizeof(b.out)));
    }
#endif
    return 0;
}

#if CASE_LAW
#include "law_ranges.h"
#else
#define RUN_LAW()
#endif

int main(void)
{
    RUN_LAW();
    RUN(spoilt_origin);
    RUN(every_end_of_every_range);
    RUN(init_and_reset_boxes);
    RUN(framers_are_cut);
    RUN(framers_at_the_ends);
    RUN(edge_of_an_alarm);
    RUN(spoilt_state);
#if CASE_BANK
    RUN_BANK();
#endif
    return 0;
}
