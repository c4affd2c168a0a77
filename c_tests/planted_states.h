/*
 * What test_supervisor.c plants in framers, in estimates with their sets, and in filters.
 */

/*
 * Framers around everything (0), or far off on either side (1, 2), or anything between (3). An estimate whose set is
 * found by counts starts anew where it is far off: there it is at the end of its range, with the set of the initial box.
 */
static void plant(bench *b, uint32_t what)
{
#if CASE_FILTER /* a filter at rest, or far off, or anywhere: its estimate follows */
    for (uint32_t i = 0U; i < M(NS); i++)
    {
        b->s.xi[i] = (what == 0U) ? 0 : (((what == 3U) ? (T(real))draw(4000U) : (T(real))(1000000U + i)) / 1000);
        b->s.xi[i] = ((what == 2U) || ((what == 3U) && (draw(2U) == 0U))) ? -b->s.xi[i] : b->s.xi[i];
    }
    b->s.since = (what == 0U) ? M(LAST) : draw(M(LAST) + 1U);
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = 0;
    }
#else
#if CASE_POINT
    T(state) whole;
    const int narrow = (CASE_N_COUNTS > 0) ? (what != 0U) : (what == 3U);

    T(reset)(&whole);
#if CASE_HAS_SHAPE
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        b->s.shape[i] = narrow ? 0 : whole.shape[i];
    }
#endif
#if CASE_N_COUNTS > 0
    {
        uint32_t *counts[] = CASE_COUNTS(&b->s);
        uint32_t *wide[] = CASE_COUNTS(&whole);

        for (uint32_t i = 0U; i < CASE_N_COUNTS; i++)
        {
            *counts[i] = narrow ? 0U : *wide[i];
        }
    }
#endif
#endif
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        const T(real) size = x_hi[i] - x_lo[i];
        const T(real) far = (CASE_N_COUNTS > 0) ? (size / 2) : (size * (T(real))(1000U + (370U * i)));
        const T(real) part = (size / 4) * (T(real))draw(4000U) * (1 + ((T(real))i / 3));

#if CASE_POINT
        b->s.x_hat[i] = whole.x_hat[i];
        b->s.x_hat[i] += (what == 0U) ? 0 : ((what == 3U) ? (part / 2000) : ((what == 1U) ? far : -far));
#else
        b->s.x_lo[i] = (what == 1U) ? far : ((what == 3U) ? (part - (far / 2)) : -far);
        b->s.x_hi[i] = (what == 2U) ? -far : ((what == 3U) ? (b->s.x_lo[i] + (part / 100)) : far);
#endif
    }
#endif
#if CASE_HAS_PHASE
    b->s.phase = 0U;
#endif
}
