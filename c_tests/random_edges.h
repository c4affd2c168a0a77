/*
 * Measurements at the edge of an answer, to the last bit, for random_calls.c: what every threshold and comparison
 * decides, along some ray.
 */

/* Whether modes are answered as well as alarms. */
#define DECIDES (CASE_BOXES || CASE_SLIDING)

/* A measurement between two, cut to its range. */
static void place(T(in) *in, const T(real) *quiet, const T(real) *ray, T(real) share)
{
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        in->y[i] = quiet[i] + (share * ray[i]);
        in->y[i] = (in->y[i] < y_lo[i]) ? y_lo[i] : ((in->y[i] > y_hi[i]) ? y_hi[i] : in->y[i]);
    }
}

/* The bits that a step would answer to it, of those asked for: alarms, possible modes, whether the decision is new. */
static uint32_t tried(const bench *b, uint32_t bits)
{
    bench trial = *b;
    uint32_t answer;

    (void)T(step)(&trial.s, &trial.in, &trial.out);
    answer = trial.out.raw;
#if DECIDES
    answer |= (trial.out.mode_set << 16U) | ((trial.out.age == 0U) ? 0x80000000U : 0U);
#endif
    return answer & bits;
}

/* Which bits: all, or one that others would hide; of a point that of all outputs together. */
static uint32_t any_bits(void)
{
#if DECIDES
    return (draw(2U) == 0U) ? 0xFFFFFFFFU : ((uint32_t)0x10000U << draw(M(MODES)));
#else
    return ((M(BITS) == M(NY)) || (draw(4U) == 0U)) ? 0xFFFFFFFFU : ((uint32_t)1U << M(NY));
#endif
}

/* A measurement in the middle of what is expected, or on a ray from there where the answer changes. */
static void any_edge(bench *b)
{
    const uint32_t bits = any_bits();
    const uint32_t alone = draw(8U * M(NY)); /* along one output, or between all */
    T(real) quiet[M(NY)] = { 0 };
    T(real) ray[M(NY)] = { 0 };
    T(real) inside = 0;
    T(real) beyond = 1;
    T(real) middle = (T(real))0.5;
    uint32_t first;

    for (uint32_t k = 0U; k < 3U; k++)
    {
        bench trial = *b;

        (void)T(step)(&trial.s, &trial.in, &trial.out);
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            const T(real) least = r_least(&trial.out, i);
            const T(real) most = r_most(&trial.out, i);

            quiet[i] = trial.in.y[i] + ((least + most) / 2);
            ray[i] = ((alone < M(NY)) && (alone != i)) ? 0 : (((most - least) / 2) * between(-4, 4));
        }
        place(&b->in, quiet, ray, 0);
    }
    first = tried(b, bits);
    while ((middle > inside) && (middle < beyond))
    {
        place(&b->in, quiet, ray, middle);
        if (tried(b, bits) != first)
        {
            beyond = middle;
        }
        else
        {
            inside = middle;
        }
        middle = (inside + beyond) / 2;
        middle = (beyond < (T(real))0.0001) ? 0 : middle; /* an edge at nothing is none */
    }
    place(&b->in, quiet, ray, (draw(2U) == 0U) ? inside : beyond);
}

#if CASE_GUIDES_POINT || CASE_FOLLOWS
/* The error set of the observer that is told its mode so many times as large, and after a step from there. */
static bench told_grown(const bench *b, T(real) times, int stepped)
{
    bench trial = *b;

    for (uint32_t i = 0U; i < M(NTOLD); i++)
    {
        trial.s.told_shape[i] *= times;
    }
    if (stepped != 0)
    {
        (void)T(step)(&trial.s, &trial.in, &trial.out);
    }
    return trial;
}

/* A set at the edge of starting anew, to the last bit: there a step leaves what it leaves of a far larger one. */
static void any_told_limit(bench *b)
{
    T(real) inside = 0;
    T(real) beyond = 1048576;
    T(real) middle = 1;
    const bench anew = told_grown(b, beyond, 1);

    while ((middle > inside) && (middle < beyond))
    {
        const bench trial = told_grown(b, middle, 1);

        if (same_bytes(trial.s.told_shape, anew.s.told_shape, sizeof(anew.s.told_shape)))
        {
            beyond = middle;
        }
        else
        {
            inside = middle;
        }
        middle = (inside + beyond) / 2;
        middle = (beyond < (T(real))0.0001) ? 0 : middle;
    }
    *b = told_grown(b, (draw(2U) == 0U) ? inside : beyond, 0);
}
#endif
