/*
 * Random calls from random states, for mutate.py: their answers as one number. Framers lie anywhere in the ranges, so
 * that each coefficient, bound and magnitude decides somewhere; that the answers are right is for the comparison with
 * the numpy reference to say (tests/sil), which is with == on the same C.
 */
#include "bench.h"

uint32_t random_calls(void);

static uint32_t seed;

static uint32_t draw(uint32_t below)
{
    seed = (seed * 1664525U) + 1013904223U;
    return (seed >> 8U) % below;
}

static T(real) between(T(real) lo, T(real) hi)
{
    const T(real) value = lo + ((hi - lo) * ((T(real))draw(65536U) / 65536));

    return (value < lo) ? lo : ((value > hi) ? hi : value);
}

static void any_inputs(T(in) *in)
{
    *told(in) = draw(M(MODES));
#if CASE_NU > 0
    for (uint32_t i = 0U; i < M(NU); i++)
    {
        in->u[i] = between(u_lo[i], u_hi[i]);
        if ((draw(8U) == 0U) && (u_lo[i] <= 0) && (u_hi[i] >= 0)) /* small ones too: their sign may decide */
        {
            in->u[i] /= 65536;
        }
    }
#endif
#if CASE_NTHETA > 0
    for (uint32_t i = 0U; i < M(NTHETA); i++)
    {
        const T(real) least = theta_lo[*told(in)][i];
        const T(real) most = theta_hi[*told(in)][i];
        /* Anywhere, or at any small distance from the last one, which the step may look back to. */
        const T(real) step = (most - least) / (T(real))(1U << draw(10U));

        in->theta[i] = (draw(2U) == 0U) ? between(least, most) : (in->theta[i] + between(-step, step));
        in->theta[i] = (in->theta[i] < least) ? least : ((in->theta[i] > most) ? most : in->theta[i]);
    }
#endif
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        in->y[i] = between(y_lo[i], y_hi[i]);
    }
}

#if !CASE_POINT && !CASE_BOXES && !CASE_FILTER
static void any_box(T(real) *lo, T(real) *hi, const T(real) *least, const T(real) *most)
{
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        /* Wide, narrow or a point, so that sums of every size meet their offsets. */
        const T(real) end = least[i] + ((most[i] - least[i]) / (T(real))(1U << draw(12U)));

        lo[i] = between(least[i], most[i]);
        hi[i] = lo[i] + between(0, end - least[i]);
        hi[i] = (hi[i] > most[i]) ? most[i] : hi[i];
        if (draw(8U) == 0U)
        {
            lo[i] /= 4096;
            hi[i] /= 4096;
        }
        else if (draw(8U) == 0U) /* far outside: what follows is cut */
        {
            lo[i] *= 1024;
            hi[i] *= 1024;
        }
        else
        {
            /* as they are */
        }
    }
}
#endif

#if CASE_BOXES
/* Boxes of any size anywhere, of any modes and ages. */
static void any_framers(T(state) *s)
{
    T(state) whole;

    T(reset)(&whole);
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        const uint32_t at = (M(OLDEST) * M(NX)) + (i % M(NX));
        const T(real) least = whole.box_lo[at];
        const T(real) most = whole.box_hi[at];

        s->box_lo[i] = between(least, most) * ((draw(8U) == 0U) ? 1024 : 1);
        s->box_hi[i] = s->box_lo[i] + ((most - least) / (T(real))(1U << draw(12U)));
    }
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        s->alive[q] = draw(2U * whole.alive[q]) | ((draw(2U) == 0U) ? whole.alive[q] : 0U);
    }
    s->decided = draw(M(MODES));
}
#else
static void any_framers(T(state) *s)
{
#if CASE_FILTER
    for (uint32_t i = 0U; i < M(NS); i++)
    {
        /* Small and large, some beyond every limit. */
        s->xi[i] = between(-1, 1) * (T(real))(1U << draw(16U)) / 64;
    }
    s->since = draw(M(LAST) + 2U);
#elif CASE_POINT
    T(state) whole;
    const uint32_t share = draw(12U);

    T(reset)(&whole);
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        s->x_hat[i] = between(x_lo[i], x_hi[i]) * ((draw(8U) == 0U) ? 1024 : 1);
#if CASE_N_COUNTS > 0 /* where a measurement can be near */
        s->x_hat[i] /= (draw(8U) == 0U) ? 1 : 16384;
#endif
    }
#if CASE_HAS_SHAPE
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        const T(real) size = whole.shape[(i % M(NX)) * (M(NX) + 1U)] / (T(real))(1U << share);

        s->shape[i] = between(-size, size);
    }
#else
    (void)share;
#endif
#if CASE_N_COUNTS > 0
    {
        uint32_t *counts[] = CASE_COUNTS(s);

        s->phase = (draw(3U) == 0U) ? s->phase : 0U; /* the estimate as it is: its residual is easy to make small */
        for (uint32_t i = 0U; i < CASE_N_COUNTS; i++)
        {
            *counts[i] = draw((draw(3U) == 0U) ? 24U : 8U); /* beyond the tables, too */
        }
    }
#endif
#else
    any_box(s->x_lo, s->x_hi, x_lo, x_hi);
#endif
#if CASE_HAS_Z
    any_box(s->z_lo, s->z_hi, z_lo, z_hi);
#endif
}
#endif

#if CASE_N_COUNTS > 0
/* The answer to a step with measurements between two. */
static uint32_t tried(const bench *b, const T(real) *quiet, const T(real) *wild, T(real) share, T(out) *out)
{
    bench trial = *b;

    for (uint32_t i = 0U; i < M(NY); i++)
    {
        trial.in.y[i] = quiet[i] + (share * (wild[i] - quiet[i]));
    }
    trial.out.raw = 0U;
    (void)T(step)(&trial.s, &trial.in, &trial.out);
    *out = trial.out;
    return trial.out.raw;
}

/* Measurements at the edge of an alarm: what every threshold decides, along some ray. */
static void any_edge(bench *b)
{
    T(real) quiet[M(NY)];
    T(real) wild[M(NY)];
    T(real) inside = 0;
    T(real) beyond = 1;
    T(out) out;

    for (uint32_t i = 0U; i < M(NY); i++)
    {
        quiet[i] = b->in.y[i];
    }
    for (uint32_t k = 0U; k < 3U; k++)
    {
        (void)tried(b, quiet, quiet, 0, &out);
        for (uint32_t i = 0U; i < M(NY); i++)
        {
            quiet[i] -= out.r[i];
            wild[i] = quiet[i] + (out.r_bound[i] * between(-4, 4));
        }
    }
    for (uint32_t k = 0U; k < 12U; k++)
    {
        const T(real) middle = (inside + beyond) / 2;

        if (tried(b, quiet, wild, middle, &out) != 0U)
        {
            beyond = middle;
        }
        else
        {
            inside = middle;
        }
    }
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = quiet[i] + (((draw(2U) == 0U) ? inside : beyond) * (wild[i] - quiet[i]));
    }
}
#endif

static uint32_t add(uint32_t digest, const void *object, uint32_t size)
{
    const unsigned char *byte = (const unsigned char *)object;

    for (uint32_t i = 0U; i < size; i++)
    {
        digest = (digest ^ byte[i]) * 16777619U;
    }
    return digest;
}

uint32_t random_calls(void)
{
    uint32_t digest = 2166136261U;

    seed = 1U;
    for (uint32_t n = 0U; n < 2000U; n++)
    {
        bench b;

        start(&b);
        for (uint32_t call = 0U; call < 4U; call++)
        {
            any_inputs(&b.in);
            if (call > 0U)
            {
                any_framers(&b.s);
#if CASE_N_COUNTS > 0
                any_edge(&b);
#endif
            }
            digest += (uint32_t)((draw(4U) != 0U) ? T(step)(&b.s, &b.in, &b.out) : T(predict)(&b.s, &b.in, &b.out));
            digest = add(add(digest, &b.s, (uint32_t)sizeof(b.s)), &b.out, (uint32_t)sizeof(b.out));
        }
    }
    return digest;
}
