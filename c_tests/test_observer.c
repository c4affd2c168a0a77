/*
 * Unit tests that every generated observer must pass, whatever its plant. run.py writes case.h, which names
 * the design under test (T: its prefix, M: its macros), its declared ranges and its supervisor's settings.
 */
#include "bench.h"

/* Choose y in the middle of its bounds, found by a trial on a copy. Returns whether every y is in its range. */
static int measure_quietly(bench *b)
{
    bench trial = *b;
    int within = 1;

#if CASE_FILTER || CASE_BANK /* at rest, what measures nothing sees nothing */
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = 0;
        within &= ((y_lo[i] <= 0) && (y_hi[i] >= 0)) ? 1 : 0;
    }
    (void)trial;
    return within;
#elif CASE_POLYTOPIC /* the measurement of the initial box */
    T(init)(&trial.s);
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = trial.s.y[i];
        within &= ((y_lo[i] < b->in.y[i]) && (b->in.y[i] < y_hi[i])) ? 1 : 0;
    }
    return within;
#else
    inputs_in_the_middle(&trial.in);
    *told(&trial.in) = *told(&b->in);
    within &= (T(step)(&trial.s, &trial.in, &trial.out) == M(OK)) ? 1 : 0;
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = trial.in.y[i] + ((r_least(&trial.out, i) / 2) + (r_most(&trial.out, i) / 2));
        within &= ((b->in.y[i] >= y_lo[i]) && (b->in.y[i] <= y_hi[i])) ? 1 : 0;
    }
    return within;
#endif
}

/* Move one y so far from the middle that it must be outside its bounds; 0 if its range does not allow that. */
static int measure_a_fault(bench *b, uint32_t *bit)
{
    bench trial = *b;
    int found = 0;

#if CASE_SLIDING /* spans of time in which every mode is refuted are planted */
    (void)trial;
    b->s.refuted = M(EVERY);
    b->s.last = 1U;
    *bit = bit_of(0U);
    found = 1;
#elif CASE_BANK
    for (uint32_t i = 0U; i < M(NA); i++)
    {
        b->s.a[i] = 1000;
    }
    trial = *b;
    found = ((T(step)(&trial.s, &trial.in, &trial.out) == M(OK)) && (trial.out.raw != 0U)) ? 1 : 0;
    *bit = trial.out.raw;
#elif FOLLOWS
    for (uint32_t n = 0U; (n < (2U * M(NY))) && (found == 0); n++)
    {
        b->in.y[n / 2U] = ((n % 2U) != 0U) ? y_lo[n / 2U] : y_hi[n / 2U];
        trial = *b;
        (void)T(step)(&trial.s, &trial.in, &trial.out);
        found = (trial.out.raw != 0U) ? 1 : 0;
        *bit = trial.out.raw;
    }
#else
    if ((measure_quietly(b) != 0) && (measure_quietly(&trial) != 0))
    {
        (void)T(step)(&trial.s, &trial.in, &trial.out);
        for (uint32_t i = 0U; (i < M(NY)) && (found == 0); i++)
        {
            const T(real) width = r_most(&trial.out, i) - r_least(&trial.out, i);

            if ((trial.in.y[i] + width) < y_hi[i])
            {
                b->in.y[i] = y_hi[i];
                found = 1;
            }
            else if ((trial.in.y[i] - width) > y_lo[i])
            {
                b->in.y[i] = y_lo[i];
                found = 1;
            }
            else
            {
                /* the bounds are as wide as the range: try the next output */
            }
            *bit = (found != 0) ? bit_of(i) : *bit;
        }
    }
#endif
    return found;
}

static int state_has_no_padding(void)
{
    CHECK(sizeof(T(state)) == CASE_STATE_BYTES);
    return 0;
}

static int init_writes_every_byte(void)
{
    bench a, b;

    start(&a);
    wipe(&b);
    for (uint32_t i = 0U; i < sizeof(b.s); i++)
    {
        ((unsigned char *)&b.s)[i] = 0xA5U;
    }
    T(init)(&b.s);
    CHECK(same_bytes(&a.s, &b.s, sizeof(a.s)));
    T(reset)(&a.s);
    for (uint32_t i = 0U; i < sizeof(b.s); i++)
    {
        ((unsigned char *)&b.s)[i] = 0x5AU;
    }
    T(reset)(&b.s);
    CHECK(same_bytes(&a.s, &b.s, sizeof(a.s)));
    return 0;
}

static int a_measurement_in_the_middle_is_quiet(void)
{
    bench b;

    start(&b);
    if (measure_quietly(&b) != 0)
    {
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK((b.out.raw == 0U) && (b.out.alarm == 0U) && (b.out.latched == 0U) && (b.out.assured == SURE));
#if !FOLLOWS
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            CHECK(b.out.x_lo[i] <= b.out.x_hi[i]);
        }
#endif
        for (uint32_t i = 0U; i < CHECKED; i++)
        {
            CHECK((r_least(&b.out, i) <= 0) && (r_most(&b.out, i) >= 0));
        }
    }
    return 0;
}

static int fault_latch_and_reset(void)
{
    bench b;
    uint32_t bit = 0U;

    start(&b);
    if (measure_a_fault(&b, &bit) != 0)
    {
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK(((b.out.raw & bit) != 0U) && (b.out.assured == CASE_HOLDS_FAULTS));
        CHECK(((b.out.alarm & bit) != 0U) == (CASE_DEBOUNCE_M == 1U));
        CHECK(b.out.latched == b.out.alarm);
        if (b.out.alarm != 0U)
        {
            const uint32_t latched = b.out.latched;

            /* Without measurement there is no alarm, but it is not forgotten either. */
            CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
            CHECK((b.out.raw == 0U) && (b.out.alarm == 0U) && (b.out.latched == latched));
            CHECK(b.out.assured == ((CASE_HOLD == 0U) ? SURE : 0U));
            T(reset)(&b.s);
            CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
            CHECK((b.out.latched == 0U) && (b.out.assured == SURE));
        }
    }
    return 0;
}

/* One refused call: what is spoilt, and the answers of step and predict. */
typedef enum { MODE, INPUT, OUTPUT } part;
typedef enum { NAN_, ABOVE, BELOW, JUST_ABOVE } how;
typedef struct {
    part what;
    how by;
    T(status) step;
    T(status) predict;
} refusal;

static const refusal refusals[] = {
#if CASE_TOLD
    { MODE, JUST_ABOVE, M(BAD_MODE), M(BAD_MODE) },
    { MODE, ABOVE, M(BAD_MODE), M(BAD_MODE) },
#endif
#if CASE_NU > 0
    { INPUT, NAN_, M(BAD_INPUT), M(BAD_INPUT) },
    { INPUT, ABOVE, M(BAD_INPUT), M(BAD_INPUT) },
    { INPUT, BELOW, M(BAD_INPUT), M(BAD_INPUT) },
#endif
    { OUTPUT, NAN_, M(BAD_OUTPUT), M(OK) },
    { OUTPUT, ABOVE, M(BAD_OUTPUT), M(OK) },
    { OUTPUT, BELOW, M(BAD_OUTPUT), M(OK) },
};

static T(real) spoilt(how by, T(real) lo, T(real) hi)
{
    const T(real) width = (hi - lo) + 1;

    return (by == NAN_) ? not_a_number() : ((by == ABOVE) ? (hi + width) : (lo - width));
}

static int refused_calls_change_nothing(void)
{
    for (uint32_t n = 0U; n < (sizeof(refusals) / sizeof(refusals[0])); n++)
    {
        const refusal *const r = &refusals[n];
        bench b, before;

        start(&b);
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        if (r->what == MODE)
        {
            *told(&b.in) = (r->by == ABOVE) ? 0xFFFFFFFFU : M(MODES);
        }
        else if (r->what == OUTPUT)
        {
            b.in.y[M(NY) - 1U] = spoilt(r->by, y_lo[M(NY) - 1U], y_hi[M(NY) - 1U]);
        }
        else
        {
#if CASE_NU > 0
            b.in.u[M(NU) - 1U] = spoilt(r->by, u_lo[M(NU) - 1U], u_hi[M(NU) - 1U]);
#endif
        }
        before = b;
        CHECK(T(step)(&b.s, &b.in, &b.out) == r->step);
        CHECK(same_bytes(&b, &before, sizeof(b)));
        CHECK(T(predict)(&b.s, &b.in, &b.out) == r->predict);
        CHECK((r->predict == M(OK)) || same_bytes(&b, &before, sizeof(b)));
        CHECK((r->predict != M(OK)) || ((b.out.raw == 0U) && (b.out.alarm == 0U)));
    }
    return 0;
}

static int every_mode_is_accepted(void)
{
    bench b;

    start(&b);
    for (uint32_t round = 0U; round < 3U; round++)
    {
        for (*told(&b.in) = 0U; *told(&b.in) < M(MODES); (*told(&b.in))++)
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
        }
    }
    return 0;
}

static int two_instances_do_not_meet(void)
{
    bench alone, one, other;

    start(&alone);
    start(&one);
    start(&other);
    for (uint32_t k = 0U; k < 20U; k++)
    {
        *told(&alone.in) = k % M(MODES);
        *told(&one.in) = *told(&alone.in);
        *told(&other.in) = (k / 2U) % M(MODES);
        alone.in.y[0] = ((k % 3U) == 0U) ? y_hi[0] : ((y_lo[0] / 2) + (y_hi[0] / 2));
        one.in.y[0] = alone.in.y[0];
        other.in.y[0] = y_lo[0];
        CHECK(T(step)(&alone.s, &alone.in, &alone.out) == M(OK));
        CHECK(T(step)(&one.s, &one.in, &one.out) == M(OK));
        CHECK(T(step)(&other.s, &other.in, &other.out) == M(OK));
        CHECK(same_bytes(&alone, &one, sizeof(alone)));
    }
    return 0;
}

static int a_bad_sensor_for_ever_stays_bounded(void)
{
    bench b;

    start(&b);
    for (uint32_t k = 0U; k < 2000U; k++)
    {
        *told(&b.in) = (k / 7U) % M(MODES);
        b.in.y[0] = ((k % 2U) == 0U) ? y_hi[0] : y_lo[0];
        CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        /* finite: a number minus itself is zero */
#if CASE_FILTER
        for (uint32_t i = 0U; i < M(NF); i++)
        {
            CHECK(((b.out.f_hat[i] - b.out.f_hat[i]) >= 0) && (b.out.f_bound[i] > 0));
        }
#elif CASE_BANK
        for (uint32_t i = 0U; i < M(NF); i++)
        {
            CHECK(((b.out.r[i] - b.out.r[i]) >= 0) && (b.out.r_bound[i] > 0));
        }
#elif CASE_POLYTOPIC
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            CHECK((b.out.x_hat[i] - b.out.x_hat[i]) >= 0);
        }
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            CHECK(((b.out.r[i] - b.out.r[i]) >= 0) && (b.out.r_bound[i] > 0));
        }
#else
        for (uint32_t i = 0U; i < M(NX); i++)
        {
            CHECK((b.out.x_lo[i] - b.out.x_lo[i]) >= 0);
            CHECK((b.out.x_hi[i] - b.out.x_hi[i]) >= 0);
        }
#endif
    }
    return 0;
}

/* Counts by which a set is found in tables, beyond these: the set starts anew or holds, and stays a set. */
static int spoilt_counts(void)
{
#if CASE_N_COUNTS > 0
    for (uint32_t n = 0U; n < (CASE_N_COUNTS * 3U * M(MODES) * 2U); n++)
    {
        bench b;
        uint32_t *counts[] = CASE_COUNTS(&b.s);

        start(&b);
        for (uint32_t k = 0U; k <= (2U * (n / (CASE_N_COUNTS * 3U * M(MODES)))); k++) /* at once, and on the way */
        {
            CHECK(measure_quietly(&b) != 0);
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
        }
        b.s.phase = (n / CASE_N_COUNTS) % 3U;
        b.in.mode = (n / (3U * CASE_N_COUNTS)) % M(MODES);
        *counts[n % CASE_N_COUNTS] = 0xFFFFFFFEU;
        for (uint32_t call = 0U; call < 3U; call++)
        {
            CHECK(T(step)(&b.s, &b.in, &b.out) == M(OK));
            for (uint32_t i = 0U; i < M(NX); i++)
            {
                CHECK((b.out.x_hi[i] - b.out.x_lo[i]) > 0);
            }
        }
    }
#endif
    return 0;
}

/* Stays of every mode in turn, long and short, from init and from reset: the bounds settle, and hold for ever. */
static int counts_run_on(void)
{
#if CASE_N_COUNTS > 0
    for (uint32_t n = 0U; n < 4U; n++)
    {
        const uint32_t stay = ((n % 2U) != 0U) ? 40U : 9U;
        T(real) before[M(MODES)] = { 0 };
        bench b;

        start(&b);
        if (n > 1U)
        {
            T(reset)(&b.s);
        }
        for (uint32_t k = 0U; k < (stay * 80U); k++)
        {
            b.in.mode = (k / stay) % M(MODES);
            CHECK(measure_quietly(&b) != 0);
            CHECK((T(step)(&b.s, &b.in, &b.out) == M(OK)) && (b.out.raw == 0U));
            if ((k % stay) == (stay - 1U))
            {
                CHECK((k < (stay * 72U)) || (M(MODES) > 8U) || (b.out.r_bound[0] <= before[b.in.mode]));
                before[b.in.mode] = b.out.r_bound[0];
            }
        }
    }
#endif
    return 0;
}

int main(void)
{
    RUN(spoilt_counts);
    RUN(counts_run_on);
    RUN(state_has_no_padding);
    RUN(init_writes_every_byte);
    RUN(a_measurement_in_the_middle_is_quiet);
    RUN(fault_latch_and_reset);
    RUN(refused_calls_change_nothing);
    RUN(every_mode_is_accepted);
    RUN(two_instances_do_not_meet);
    RUN(a_bad_sensor_for_ever_stays_bounded);
    return 0;
}
