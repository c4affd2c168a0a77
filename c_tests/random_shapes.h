/*
 * Sets of errors as random_calls.c plants them.
 */

/* A set of any size up to some more than the whole range: what a step can leave, or now and then anything. */
static void any_shape(T(state) *s)
{
    T(state) whole;
    const T(real) share = (T(real))(1U << draw((draw(4U) == 0U) ? 30U : 12U)) / between(1, 2);
    const uint32_t some = draw(8U);

    T(reset)(&whole);
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        const T(real) size = whole.shape[(M(NSHAPE) == M(NX)) ? i : ((i % M(NX)) * (M(NX) + 1U))] / share;

        s->shape[i] = between((CASE_SIGNED_SHAPE || (some == 0U)) ? -size : 0, size);
    }
#if CASE_SQUARE_SHAPE
    if (some != 0U) /* F F', F with one column less or as many as rows */
    {
        T(real) factor[M(NSHAPE)];

        for (uint32_t i = 0U; i < M(NSHAPE); i++)
        {
            factor[i] = between(-1, 1);
        }
        for (uint32_t i = 0U; i < M(NSHAPE); i++)
        {
            const uint32_t row = i / M(NX);
            const uint32_t column = i % M(NX);
            const T(real) size = whole.shape[0] / share;

            s->shape[i] = 0;
            for (uint32_t k = some % 2U; k < M(NX); k++)
            {
                s->shape[i] += size * (factor[(row * M(NX)) + k] * factor[(column * M(NX)) + k]);
            }
        }
    }
#endif
}
