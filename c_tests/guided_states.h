/*
 * States of what an estimator by sliding modes guides: framers, a point observer, or a filter.
 */

/* Whether it guides anything. */
#define GUIDES (CASE_GUIDED || CASE_GUIDES_POINT || CASE_GUIDES_FILTER)

/* How many alarm bits are not the estimator's. */
#if CASE_GUIDES_FILTER
#define GUIDED_BITS M(NF)
#elif GUIDES
#define GUIDED_BITS (M(NY) + 1U)
#else
#define GUIDED_BITS 0U
#endif

/* Whether that has bounds of its own. */
#define BOUNDS (CASE_GUIDED || CASE_GUIDES_POINT)

#if BOUNDS
/* The last sample that it had: any. */
static inline void plant_sample(T(state) *s, uint32_t (*drawn_below)(uint32_t))
{
#if CASE_NU > 0
    for (uint32_t i = 0U; i < M(NU); i++)
    {
        s->told_u[i] = u_lo[i] + ((u_hi[i] - u_lo[i]) * ((T(real))drawn_below(1000U) / 1000));
    }
#endif
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        s->told_y[i] = y_lo[i] + ((y_hi[i] - y_lo[i]) * ((T(real))drawn_below(1000U) / 1000));
    }
}
#endif

#if CASE_GUIDED
/* Framers anywhere, beyond the ranges and crossed too. */
static inline void plant_guided(T(state) *s, uint32_t (*drawn_below)(uint32_t))
{
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        const T(real) size = x_hi[i] - x_lo[i];

        s->told_lo[i] = x_lo[i] + (size * (((T(real))drawn_below(3000U) / 1000) - 1));
        s->told_hi[i] = s->told_lo[i] + (size * (((T(real))drawn_below(2000U) / 1000) - (T(real))0.25));
    }
    plant_sample(s, drawn_below);
}
#elif CASE_GUIDES_POINT
/* An estimate anywhere, far beyond the ranges too, with a set of any size, also of none that there is. */
static inline void plant_guided(T(state) *s, uint32_t (*drawn_below)(uint32_t))
{
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        s->told_x_hat[i] = x_lo[i] + ((x_hi[i] - x_lo[i]) * (((T(real))drawn_below(8000U) / 1000) - 4));
    }
    for (uint32_t i = 0U; i < M(NTOLD); i++)
    {
        const T(real) size = x_hi[i % M(NX)] - x_lo[i % M(NX)];

        s->told_shape[i] = (size * (T(real))drawn_below(1000U)) / (T(real))(1000U << drawn_below(12U));
        s->told_shape[i] *= (drawn_below(16U) == 0U) ? -1 : 1;
    }
    plant_sample(s, drawn_below);
}
#elif CASE_GUIDES_FILTER
/* A filter of any state, small and large, started in any way any time ago. */
static inline void plant_guided(T(state) *s, uint32_t (*drawn_below)(uint32_t))
{
    for (uint32_t i = 0U; i < M(NS); i++)
    {
        s->told_xi[i] = (x_hi[0] - x_lo[0]) * (((T(real))drawn_below(4000U) / 2000) - 1);
        s->told_xi[i] /= (T(real))(1U << drawn_below(16U));
    }
    s->told_stage = drawn_below(M(STAGES) + 1U);
    s->told_since = (drawn_below(4U) == 0U) ? (M(LAST) + drawn_below(2U)) : drawn_below(M(LAST));
}
#endif
