/*
 * bench.h: an observer with its input and output, and the plain things that tests do with one. run.py writes
 * case.h, which names the design under test (T: its prefix, M: its macros), its ranges and its supervisor.
 * Inline: not every test uses every function.
 */
#ifndef BENCH_H
#define BENCH_H

#include "case.h"
#include "check.h"

/* The last state of a quiet run, so that each test starts from a used observer. */
typedef struct {
    T(state) s;
    T(in) in;
    T(out) out;
} bench;

#if CASE_NU > 0
static const T(real) u_lo[] = CASE_U_LO;
static const T(real) u_hi[] = CASE_U_HI;
#endif
#if CASE_NTHETA > 0
static const T(real) theta_lo[][M(NTHETA)] = CASE_THETA_LO;
static const T(real) theta_hi[][M(NTHETA)] = CASE_THETA_HI;
#endif
static const T(real) y_lo[] = CASE_Y_LO;
static const T(real) y_hi[] = CASE_Y_HI;
static const T(real) x_lo[] = CASE_X_LO;
static const T(real) x_hi[] = CASE_X_HI;
#if CASE_HAS_Z
static const T(real) z_lo[] = CASE_Z_LO;
static const T(real) z_hi[] = CASE_Z_HI;
#endif
static const T(real) x0_lo[] = CASE_X0_LO;
static const T(real) x0_hi[] = CASE_X0_HI;

/* Whether nothing starts again while a fault is seen: a filter, an observer, or a bank of them. */
#define FOLLOWS (CASE_FILTER || CASE_POLYTOPIC || CASE_BANK)

/* How many numbers are held against a bound, each with a bit: residuals, or estimates of faults. */
#if CASE_FILTER || CASE_BANK
#define CHECKED M(NF)
#else
#define CHECKED M(NY)
#endif

/* What a quiet answer says of its guarantee: there is none where thresholds are calibrated, or nothing is proved. */
#define SURE ((CASE_ASSURES != 0) ? 1U : 0U)

/* What y may be, minus the y that was measured; what an estimate may be, minus the estimate. */
static inline T(real) r_least(const T(out) *out, uint32_t i)
{
#if CASE_FILTER
    return -out->f_hat[i] - out->f_bound[i];
#elif CASE_POINT || CASE_POLYTOPIC || CASE_BANK
    return -out->r[i] - out->r_bound[i];
#else
    return out->r_lo[i];
#endif
}

static inline T(real) r_most(const T(out) *out, uint32_t i)
{
#if CASE_FILTER
    return -out->f_hat[i] + out->f_bound[i];
#elif CASE_POINT || CASE_POLYTOPIC || CASE_BANK
    return -out->r[i] + out->r_bound[i];
#else
    return out->r_hi[i];
#endif
}

/* The mode that the observer is told; where nobody tells it, a word that nothing reads. */
static inline uint32_t *told(T(in) *in)
{
#if CASE_TOLD
    return &in->mode;
#else
    static uint32_t nobody;

    (void)in;
    return &nobody;
#endif
}

/* Whether the weights are in force at the estimate; other observers have none. */
static inline uint32_t in_force(const T(out) *out)
{
#if CASE_POLYTOPIC
    return out->inside;
#else
    (void)out;
    return 1U;
#endif
}

/* The alarm bit of an output. */
static inline uint32_t bit_of(uint32_t i)
{
#if CASE_BOXES
    (void)i;
    return M(BIT_NO_MODE);
#elif CASE_SLIDING
    (void)i;
    return M(BIT_TWICE);
#else
    return (uint32_t)1U << i;
#endif
}

static inline T(real) not_a_number(void)
{
    static volatile T(real) zero = 0;

    return zero / zero;
}

static inline T(real) huge(void)
{
    static volatile T(real) zero = 0;

    return 1 / zero;
}

/* A little beyond an end, much less than one in a thousand of it. */
static inline T(real) beyond(T(real) lo, T(real) hi, int above)
{
    const T(real) end = (above != 0) ? hi : lo;
    const T(real) size = (end > 0) ? end : -end;
    const T(real) by = ((size > 0) ? size : (hi - lo)) / 65536;

    return (above != 0) ? (end + by) : (end - by);
}

/* All bytes, padding too, so that comparing bytes compares values. */
static inline void wipe(bench *b)
{
    unsigned char *byte = (unsigned char *)b;

    for (uint32_t i = 0U; i < sizeof(*b); i++)
    {
        byte[i] = 0U;
    }
}

static inline void inputs_in_the_middle(T(in) *in)
{
#if CASE_NU > 0
    for (uint32_t i = 0U; i < M(NU); i++)
    {
        in->u[i] = (u_lo[i] / 2) + (u_hi[i] / 2);
    }
#endif
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        in->y[i] = (y_lo[i] / 2) + (y_hi[i] / 2);
    }
#if CASE_NTHETA > 0
    for (uint32_t i = 0U; i < M(NTHETA); i++)
    {
        T(real) least = theta_lo[0][i];
        T(real) most = theta_hi[0][i];

        for (uint32_t q = 1U; q < M(MODES); q++) /* a value that every mode accepts */
        {
            least = (theta_lo[q][i] > least) ? theta_lo[q][i] : least;
            most = (theta_hi[q][i] < most) ? theta_hi[q][i] : most;
        }
        in->theta[i] = (least / 2) + (most / 2);
    }
#endif
    *told(in) = 0U;
}

static inline void start(bench *b)
{
    wipe(b);
    inputs_in_the_middle(&b->in);
    T(init)(&b->s);
}

#if CASE_HAS_FRAMES
/* Bounds of modes anywhere, crossed ones too, of any modes if asked for; else they start from the boxes. */
static inline void plant_frames(bench *b, int live, uint32_t (*drawn_below)(uint32_t))
{
    b->s.framed = (live != 0) ? drawn_below(1U << M(MODES)) : 0U;
    b->s.measured = drawn_below(2U);
    for (uint32_t i = 0U; i < M(NFRAME); i++)
    {
        const T(real) middle = (x_hi[0] - x_lo[0]) * (((T(real))drawn_below(4000U) / 1000) - 2);

        b->s.frame_lo[i] = middle - ((x_hi[0] - x_lo[0]) * ((T(real))drawn_below(3000U) / 1000));
        b->s.frame_hi[i] = middle - ((x_hi[0] - x_lo[0]) * ((T(real))drawn_below(2000U) / 1000));
    }
}
#endif

#if CASE_FOLLOWS
/* An observer anywhere, its estimate beyond the ranges too, with a set of any size, in any mode or none. */
static inline void plant_observer(T(state) *s, uint32_t (*drawn_below)(uint32_t))
{
    s->followed = drawn_below(M(MODES) + 1U);
    s->measured = drawn_below(2U);
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        const T(real) size = x_hi[i] - x_lo[i];

        s->told_x_hat[i] = size * (((T(real))drawn_below(4000U) / 1000) - 2);
        s->told_lo[i] = s->told_x_hat[i];
        s->told_hi[i] = s->told_x_hat[i];
    }
    for (uint32_t i = 0U; i < M(NTOLD); i++)
    {
        s->told_shape[i] = ((x_hi[0] - x_lo[0]) * (T(real))drawn_below(1000U)) / (T(real))(1000U << drawn_below(12U));
    }
}
#endif

#if CASE_HAS_FILTERS
/* Filters anywhere, started in any way any time ago, of any modes if asked for; else they start from the boxes. */
static inline void plant_filters(T(state) *s, int live, uint32_t (*drawn_below)(uint32_t))
{
    s->running = (live != 0) ? drawn_below(1U << M(MODES)) : 0U;
    s->settled = drawn_below(M(MODES));
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        s->told_stage[q] = drawn_below(M(STAGES));
        s->told_since[q] = drawn_below(M(LAST) + 1U);
    }
    for (uint32_t i = 0U; i < M(NXI); i++)
    {
        s->told_xi[i] = (x_hi[0] - x_lo[0]) * (((T(real))drawn_below(4000U) / 2000) - 1);
    }
}
#endif

#endif
