/*
 * The supervisor against a second one, written here from the header's words: history of whole samples instead
 * of one word per bit, counters as in the manual. Framers are planted in the state, so that a sample is within
 * or outside its bounds as the test wants, whatever the plant.
 */
#include "bench.h"

/* What the supervisor should remember. seen[0] is the raw word of the last measured sample. */
typedef struct {
    uint32_t seen[32];
    uint32_t latched;
    uint32_t hold;
    uint32_t run;
    uint32_t mode;
    uint32_t bucket;
    uint32_t too_fast;
} expected;

static uint32_t drawn = 1U;

static uint32_t draw(uint32_t below)
{
    drawn = (drawn * 1664525U) + 1013904223U;
    return (drawn >> 8) % below;
}

#if CASE_BOXES || CASE_SLIDING
#include "planted_modes.h"
#elif CASE_POLYTOPIC
#include "polytopic_plant.h"
#elif CASE_BANK
#include "bank_plant.h"
#else
#include "planted_states.h"
#endif

static int same_dwell(const T(state) *s, const expected *e)
{
#if CASE_DWELL_ADD > 0
    CHECK((s->bucket == e->bucket) && (s->too_fast == e->too_fast));
#endif
    (void)s;
    (void)e;
    return 0;
}

static void expect_dwell(expected *e, uint32_t mode)
{
    e->bucket -= (e->bucket > CASE_DWELL_DRAIN) ? CASE_DWELL_DRAIN : e->bucket;
    if ((e->mode != M(MODES)) && (e->mode != mode))
    {
        e->bucket += CASE_DWELL_ADD;
    }
    e->too_fast = (e->bucket > CASE_DWELL_LIMIT) ? 1U : ((e->bucket == 0U) ? 0U : e->too_fast);
    e->bucket = (e->bucket > CASE_DWELL_LIMIT) ? CASE_DWELL_LIMIT : e->bucket;
    e->mode = mode;
}

static uint32_t expect_alarm(expected *e, uint32_t raw)
{
    uint32_t alarm = 0U;

    for (uint32_t k = 31U; k > 0U; k--)
    {
        e->seen[k] = e->seen[k - 1U];
    }
    e->seen[0] = raw;
    for (uint32_t i = 0U; i < M(BITS); i++)
    {
        uint32_t votes = 0U;

        for (uint32_t k = 0U; k < CASE_DEBOUNCE_N; k++)
        {
            votes += (e->seen[k] >> i) & 1U;
        }
        alarm |= (votes >= CASE_DEBOUNCE_M) ? ((uint32_t)1U << i) : 0U;
    }
    e->latched = (CASE_LATCH != 0) ? (e->latched | alarm) : alarm;
    e->hold = (raw != 0U) ? CASE_HOLD : ((e->hold > 0U) ? (e->hold - 1U) : 0U);
    return alarm;
}

static uint32_t undisturbed(const expected *e)
{
    const int latched = (CASE_LATCH != 0) && (e->latched != 0U);
    const int held = (CASE_COUNTS_HOLD != 0) && (e->hold != 0U);

    return ((latched || held || (e->too_fast != 0U)) ? 0U : 1U) * SURE;
}

/* The bits that the residual bounds of an answer ask for. */
static uint32_t outside(const T(out) *out)
{
    uint32_t raw = 0U;

#if CASE_BOXES /* each box on its own may be empty as well: tests/sil; then every mode is possible since long */
    raw = out->raw;
#elif CASE_SLIDING
    raw = of_numbers(out);
#endif
    for (uint32_t i = 0U; (CASE_SLIDING == 0) && (i < CHECKED); i++)
    {
#if CASE_BOXES
        raw |= ((out->r_lo[i] > 0) || (out->r_hi[i] < 0)) ? bit_of(i) : 0U;
#elif CASE_FILTER
        raw |= ((out->f_hat[i] > out->f_bound[i]) || (out->f_hat[i] < -out->f_bound[i])) ? ((uint32_t)1U << i) : 0U;
#elif CASE_POINT || CASE_POLYTOPIC || CASE_BANK
        raw |= ((out->r[i] > out->r_bound[i]) || (out->r[i] < -out->r_bound[i])) ? ((uint32_t)1U << i) : 0U;
#else
        raw |= ((out->r_lo[i] > 0) || (out->r_hi[i] < 0)) ? ((uint32_t)1U << i) : 0U;
#endif
    }
#if CASE_BOXES
    raw |= ((out->raw != 0U) && (out->age != M(OLDEST))) ? ~0U : 0U;
#elif CASE_SLIDING
    CHECK(M(BITS) == (GUIDED_BITS + 1U));
#elif FOLLOWS
    CHECK(M(BITS) == CHECKED);
#elif CASE_POINT
    raw |= out->raw & ~(((uint32_t)1U << M(NY)) - 1U); /* outside of the set, within every bound: tests/sil */
#else
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        raw |= ((M(BITS) > M(NY)) && (out->x_lo[i] > out->x_hi[i])) ? ((uint32_t)1U << M(NY)) : 0U;
    }
#endif
    return raw;
}

/* The framers, or estimate and set, of the state are the declared range. */
static int starts_again(const T(state) *s)
{
#if CASE_BOXES
    T(state) whole;

    T(reset)(&whole);
    return same_bytes(s->box_lo, whole.box_lo, sizeof(whole.box_lo)) && same_bytes(s->alive, whole.alive, sizeof(whole.alive))
        && same_bytes(s->box_hi, whole.box_hi, sizeof(whole.box_hi));
#elif CASE_SLIDING
    T(state) whole;

    T(reset)(&whole);
    return same_bytes(s->box_lo, whole.box_lo, sizeof(whole.box_lo)) && (s->fresh == whole.fresh) && (s->age == 0U)
        && same_bytes(s->box_hi, whole.box_hi, sizeof(whole.box_hi)) && (s->armed == whole.armed) && (s->last == 0U);
#elif CASE_BANK
    return at_start(s);
#elif FOLLOWS
    static const uint32_t nothing;

    return same_bytes(&s->since, &nothing, sizeof(nothing));
#elif CASE_POINT
    T(state) whole;
    int same = 1;

    T(reset)(&whole);
#if CASE_HAS_SHAPE
    same = same && same_bytes(s->shape, whole.shape, sizeof(whole.shape));
#endif
#if CASE_N_COUNTS > 0
    {
        const uint32_t *counts[] = CASE_COUNTS(s);
        const uint32_t *wide[] = CASE_COUNTS(&whole);

        for (uint32_t i = 0U; i < CASE_N_COUNTS; i++)
        {
            same = same && (*counts[i] == *wide[i]);
        }
    }
#endif
    return same && same_bytes(s->x_hat, whole.x_hat, sizeof(whole.x_hat));
#else
    return same_bytes(s->x_lo, x_lo, sizeof(x_lo)) && same_bytes(s->x_hi, x_hi, sizeof(x_hi));
#endif
}

static int measured(bench *b, expected *e)
{
    uint32_t alarm;
    int again;
#if CASE_SLIDING
    const T(state) before = b->s;
#endif

    CHECK(T(step)(&b->s, &b->in, &b->out) == M(OK));
#if CASE_SLIDING
    CHECK((b->out.raw & M(BIT_TWICE)) == twice(&before, &b->out));
#endif
    CHECK(b->out.raw == outside(&b->out));
    expect_dwell(e, *told(&b->in));
    CHECK(same_dwell(&b->s, e) == 0);
    alarm = expect_alarm(e, b->out.raw);
    again = (b->out.raw != 0U) ? ((e->run + 1U) >= CASE_RECOVER) : (e->run > 0U);
    e->run = (again || (b->out.raw == 0U)) ? 0U : (e->run + 1U);
#if CASE_BANK /* never starts by itself */
    again = 0;
#elif FOLLOWS /* starts at the end of a fault only, however long it lasts */
    e->run = ((again != 0) && (b->out.raw != 0U)) ? 1U : e->run;
    again = (again != 0) && (b->out.raw == 0U) && (CASE_HOLDS_FAULTS == 0);
#endif
    CHECK((b->out.alarm == alarm) && (b->out.latched == e->latched) && (b->s.run == e->run));
    CHECK(b->out.assured == ((CASE_HOLDS_FAULTS != 0) ? in_force(&b->out)
        : ((b->out.raw == 0U) ? (undisturbed(e) & in_force(&b->out) & SURE) : 0U)));
    CHECK((again == 0) || starts_again(&b->s)); /* the cut alone may leave the whole range as well */
#if CASE_HAS_PHASE
    CHECK(b->s.phase == ((again != 0) ? 0U : 2U));
#endif
    return 0;
}

static int missing(bench *b, expected *e)
{
    b->out.raw = ~0U;
    b->out.alarm = ~0U;
    b->out.latched = ~e->latched;
    b->out.assured = 2U;
    CHECK(T(predict)(&b->s, &b->in, &b->out) == M(OK));
    expect_dwell(e, *told(&b->in));
    CHECK(same_dwell(&b->s, e) == 0);
    CHECK((b->out.raw == 0U) && (b->out.alarm == 0U) && (b->out.latched == e->latched));
    CHECK((b->s.run == e->run) && (b->out.assured == (undisturbed(e) & in_force(&b->out) & SURE)));
    for (uint32_t i = 0U; i < CHECKED; i++)
    {
        CHECK((r_least(&b->out, i) <= 0) && (r_least(&b->out, i) >= 0));
        CHECK((r_most(&b->out, i) <= 0) && (r_most(&b->out, i) >= 0));
    }
    return 0;
}

static int begin(bench *b, expected *e)
{
    start(b);
    for (uint32_t k = 0U; k < 32U; k++)
    {
        e->seen[k] = 0U;
    }
    e->latched = 0U;
    e->hold = 0U;
    e->run = 0U;
    e->mode = M(MODES);
    e->bucket = 0U;
    e->too_fast = 0U;
    return 0;
}

/* Faults in bursts, one long enough to recover within it; modes held or changed at every sample. */
static int any_sequence(void)
{
    bench b;
    expected e;
    uint32_t kind = 0U;
    uint32_t hurry = 0U;

    (void)begin(&b, &e);
    for (uint32_t k = 0U; k < (2000U + (4U * CASE_RECOVER)); k++)
    {
        int wrong;

        kind = (draw(4U) == 0U) ? draw(4U) : kind;
        hurry = (draw(CASE_DWELL_LIMIT + 5U) == 0U) ? draw(2U) : hurry;
        kind = (k < (CASE_RECOVER + 2U)) ? 1U : kind;
        *told(&b.in) = ((hurry != 0U) || (draw(20U) == 0U)) ? draw(M(MODES)) : *told(&b.in);
        plant(&b, kind);
        wrong = (draw(5U) == 0U) ? missing(&b, &e) : measured(&b, &e);
        CHECK(wrong == 0);
        if (draw(100U) == 0U)
        {
            T(reset)(&b.s);
            CHECK(starts_again(&b.s));
            (void)begin(&b, &e);
        }
    }
    return 0;
}

/* Faults without end start the framers again each time that the manual says. */
static int a_fault_that_stays(void)
{
    bench b;
    expected e;

    (void)begin(&b, &e);
    for (uint32_t k = 1U; k <= (2U * CASE_RECOVER); k++)
    {
        plant(&b, 1U + (k % 2U));
        CHECK(measured(&b, &e) == 0);
        CHECK(b.out.raw != 0U);
#if !FOLLOWS || CASE_BANK
        CHECK(b.s.run == (k % CASE_RECOVER));
#endif
    }
    return 0;
}

/* One sample outside, then quiet until the hold time is over and longer. */
static int hold_time(void)
{
    bench b;
    expected e;

    (void)begin(&b, &e);
    for (uint32_t k = 0U; k < (CASE_HOLD + 3U); k++)
    {
        plant(&b, (k == 0U) ? 1U : 0U);
        CHECK(measured(&b, &e) == 0);
        CHECK(missing(&b, &e) == 0);
    }
    return 0;
}

/* As fast as can be until the bucket overflows, then slowly until it has run empty. */
static int dwell_bucket_fills_and_drains(void)
{
    bench b;
    expected e;

    (void)begin(&b, &e);
    for (uint32_t k = 0U; k < ((2U * CASE_DWELL_LIMIT) + 10U); k++)
    {
        *told(&b.in) = k % M(MODES);
        plant(&b, 0U);
        CHECK((((k % 3U) == 1U) ? missing(&b, &e) : measured(&b, &e)) == 0);
    }
    CHECK((CASE_DWELL_ADD == 0U) || (M(MODES) == 1U) || (b.out.assured == 0U));
    for (uint32_t k = 0U; k < ((2U * CASE_DWELL_LIMIT) + 10U); k++)
    {
        plant(&b, 0U);
        CHECK((((k % 3U) == 1U) ? missing(&b, &e) : measured(&b, &e)) == 0);
    }
    CHECK(b.out.assured == SURE);
    return 0;
}

int main(void)
{
    RUN(any_sequence);
    RUN(a_fault_that_stays);
    RUN(hold_time);
    RUN(dwell_bucket_fills_and_drains);
    return 0;
}
