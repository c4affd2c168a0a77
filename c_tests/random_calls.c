/*
 * Random calls from random states, for mutate.py: their answers as one number. Framers lie anywhere in the ranges, so
 * that each coefficient, bound and magnitude decides somewhere; that the answers are right is for the comparison with
 * the numpy reference to say (tests/sil), which is with == on the same C.
 */
#include "bench.h"

uint32_t random_calls(uint32_t part);

static uint32_t seed;

/* From the high bits: the low ones repeat so soon that draws would depend on each other. */
static uint32_t draw(uint32_t below)
{
    seed = (seed * 1664525U) + 1013904223U;
    return (uint32_t)(((uint64_t)seed * below) >> 32U);
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

#if !CASE_POINT && !CASE_BOXES && !FOLLOWS && !CASE_SLIDING
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

#if CASE_POINT && CASE_HAS_SHAPE
#include "random_shapes.h"
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
        s->box_hi[i] = s->box_lo[i] + (between(0, most - least) / (T(real))(1U << draw(12U)));
    }
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        s->alive[q] = draw(2U * whole.alive[q]) | ((draw(2U) == 0U) ? whole.alive[q] : 0U);
    }
#if CASE_HAS_FRAMES
    for (uint32_t i = 0U; i < M(NFRAME); i++)
    {
        s->frame_lo[i] = between(x_lo[i % M(NX)], x_hi[i % M(NX)]);
        s->frame_hi[i] = between(s->frame_lo[i], x_hi[i % M(NX)]);
    }
    s->framed = draw(1U << M(MODES));
    s->measured = draw(2U);
#endif
#if CASE_FOLLOWS
    plant_observer(s, draw);
#endif
#if CASE_HAS_FILTERS
    plant_filters(s, 1, draw);
#endif
    s->decided = draw(M(MODES));
    if (draw(2U) == 0U) /* where a measurement can please every mode: what comes after the boxes decides */
    {
        for (uint32_t i = 0U; i < M(NSHAPE); i++)
        {
            s->box_lo[i] = whole.box_lo[(M(OLDEST) * M(NX)) + (i % M(NX))];
            s->box_hi[i] = whole.box_hi[(M(OLDEST) * M(NX)) + (i % M(NX))];
        }
        for (uint32_t q = 0U; q < M(MODES); q++)
        {
            s->alive[q] = (uint32_t)1U << M(OLDEST);
        }
#if CASE_HAS_FILTERS
        for (uint32_t i = 0U; i < M(NXI); i++)
        {
            s->told_xi[i] /= (T(real))(1U << draw(17U));
        }
        s->running |= (draw(4U) != 0U) ? (((uint32_t)1U << M(MODES)) - 1U) : 0U;
#endif
    }
}
#elif CASE_SLIDING
#include "sliding_states.h"
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
#elif CASE_BANK
    for (uint32_t i = 0U; i < M(NZ); i++) /* anywhere, some far off */
    {
        s->z[i] = between(x_lo[i % M(NX)], x_hi[i % M(NX)]) / (T(real))(1U << draw(12U)) * ((draw(16U) == 0U) ? 1024 : 1);
    }
    for (uint32_t i = 0U; i < M(NA); i++)
    {
        s->a[i] = between(-1, 1) / (T(real))(1U << draw(8U));
    }
    for (uint32_t i = 0U; i < M(NF); i++)
    {
        s->left[i] = draw(3U);
    }
    s->wait = (draw(4U) == 0U) ? draw(3U) : 0U;
#elif CASE_POLYTOPIC
    for (uint32_t i = 0U; i < M(NX); i++) /* anywhere, some beyond every limit, some so that the measurement fits */
    {
        s->z[i] = between(x_lo[i], x_hi[i]) / (T(real))(1U << draw(12U)) * ((draw(16U) == 0U) ? 1024 : 1);
    }
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        s->y[i] = between(y_lo[i], y_hi[i]);
    }
    s->since = draw(M(LAST) + 2U);
#elif CASE_POINT
    static const T(real) offs[] = { 1024, 2, 2, 1, (T(real))1 / 16384, (T(real))1 / 16384, (T(real))1 / 16384, 0 };
    const T(real) off = offs[draw(8U)];

    for (uint32_t i = 0U; i < M(NX); i++) /* far off, anywhere, where a measurement can be near, or zero */
    {
        s->x_hat[i] = between(x_lo[i], x_hi[i]) * off;
    }
    s->phase = (draw(2U) == 0U) ? draw(3U) : 0U; /* the estimate as it is: its residual is easy to make small */
#if CASE_HAS_ORIGIN
    s->origin = draw(M(MODES) + 2U);
#endif
#if CASE_HAS_SHAPE
    any_shape(s);
#endif
#if CASE_N_COUNTS > 0
    {
        static const uint32_t tops[] = CASE_TOPS;
        uint32_t *counts[] = CASE_COUNTS(s);

        for (uint32_t i = 0U; i < CASE_N_COUNTS; i++)
        {
            *counts[i] = draw(tops[i] + ((draw(16U) == 0U) ? 16U : 1U)); /* beyond the tables, too */
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

#if CASE_POINT || CASE_BOXES || CASE_SLIDING
#include "random_edges.h"
#endif

#if CASE_POINT
/* A mode in which the set keeps its place in the tables. */
static void any_mode(bench *b)
{
#if CASE_N_COUNTS > 0
    for (uint32_t k = 0U; k < M(MODES); k++)
    {
        bench trial = *b;

        trial.s.phase = 0U;
        (void)T(predict)(&trial.s, &trial.in, &trial.out);
        if (trial.s.since == b->s.since)
        {
            break;
        }
        b->in.mode = (b->in.mode + 1U) % M(MODES);
    }
#else
    (void)b;
#endif
}

/* The estimate, or the set, so many times as large. */
static bench grown(const bench *b, uint32_t set, T(real) times)
{
    bench trial = *b;

#if CASE_HAS_SHAPE
    for (uint32_t i = 0U; (set != 0U) && (i < M(NSHAPE)); i++)
    {
        trial.s.shape[i] *= times;
    }
#endif
    for (uint32_t i = 0U; (set == 0U) && (i < M(NX)); i++)
    {
        trial.s.x_hat[i] *= times;
    }
    return trial;
}

/* An estimate or a set at the edge of starting anew, to the last bit: what every limit of a size decides. */
static void any_limit(bench *b)
{
    const uint32_t set = (CASE_HAS_SHAPE != 0) ? draw(2U) : 0U;
    T(real) inside = 0;
    T(real) beyond = 4096;
    T(real) middle = 1;

    b->s.phase = 0U;
    while ((middle > inside) && (middle < beyond))
    {
        const bench trial = grown(b, set, middle);
        bench after = trial;

        (void)T(predict)(&after.s, &after.in, &after.out);
        if (same_bytes(after.s.x_hat, trial.s.x_hat, sizeof(trial.s.x_hat)))
        {
            inside = middle;
        }
        else
        {
            beyond = middle;
        }
        middle = (inside + beyond) / 2;
        middle = (beyond < (T(real))0.0001) ? 0 : middle;
    }
    *b = grown(b, set, (draw(2U) == 0U) ? inside : beyond);
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

#if CASE_LAW
#include "random_law.h"
#endif

/* One part of the calls, each with draws of its own. */
uint32_t random_calls(uint32_t part)
{
    uint32_t digest = 2166136261U;

    bench anew;

    start(&anew);
    T(reset)(&anew.s);
    digest = add(digest, &anew.s, (uint32_t)sizeof(anew.s));
    seed = (part + 1U) * 2654435769U;
    for (uint32_t n = 0U; n < 500U; n++)
    {
        bench b;

        start(&b);
        for (uint32_t call = 0U; call < 4U; call++)
        {
            any_inputs(&b.in);
            if (call > 0U)
            {
                any_framers(&b.s);
#if CASE_POINT
                any_mode(&b);
                if (draw(8U) == 0U)
                {
                    any_limit(&b);
                }
                else
                {
                    any_edge(&b);
                }
#elif CASE_BOXES || CASE_SLIDING
                if (draw(4U) != 0U)
                {
                    any_edge(&b);
                }
#if CASE_GUIDES_POINT || CASE_FOLLOWS
                if (draw(8U) == 0U)
                {
                    any_told_limit(&b);
                }
#endif
#endif
            }
            digest += (uint32_t)((draw(4U) != 0U) ? T(step)(&b.s, &b.in, &b.out) : T(predict)(&b.s, &b.in, &b.out));
            digest = add(add(digest, &b.s, (uint32_t)sizeof(b.s)), &b.out, (uint32_t)sizeof(b.out));
#if CASE_LAW
            any_framers(&b.s);
            digest = steer(digest, &b);
#endif
        }
    }
    return digest;
}
