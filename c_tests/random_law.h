/*
 * random_law.h: random calls of a tracking law, for random_calls.c, which has the draws.
 */
#ifndef RANDOM_LAW_H
#define RANDOM_LAW_H

#include "bench.h"

static const T(real) ref_most[] = CASE_REFERENCE;
static const T(real) s_most[] = CASE_LIMIT;

/* An integral at which an input is cut, or hardly not, to the last bit. */
static void any_cut(const bench *b, T(law) *law)
{
    const uint32_t i = draw(M(NREF));
    const T(real) far = ((draw(2U) == 0U) ? 1 : -1) * s_most[i] * 4096;
    T(real) inside = 0;
    T(real) beyond = 1;
    T(real) middle = (T(real))0.5;

    while ((middle > inside) && (middle < beyond))
    {
        bench trial = *b;
        T(law) tried_law = *law;

        tried_law.s[i] = far * middle;
        (void)T(coast)(&trial.s, &tried_law, &trial.in, &trial.out);
        if (tried_law.limited != 0U)
        {
            beyond = middle;
        }
        else
        {
            inside = middle;
        }
        middle = (inside + beyond) / 2;
        middle = (beyond < (T(real))1e-12) ? 0 : middle; /* cut without it */
    }
    law->s[i] = far * ((draw(2U) == 0U) ? inside : beyond);
}

/* A call of the law: references anywhere, measurements large and small, integrals within their limits and beyond. */
static uint32_t steer(uint32_t digest, bench *b)
{
    const T(real) share = (T(real))1 / (T(real))(1U << draw(12U));
    T(law) law;
    T(real) ref[M(NREF)];

    T(law_init)(&law);
    digest = add(digest, &law, (uint32_t)sizeof(law));
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] *= share;
    }
    for (uint32_t i = 0U; i < M(NREF); i++)
    {
        ref[i] = between(-ref_most[i], ref_most[i]);
        law.s[i] = between(-s_most[i], s_most[i]) * ((draw(8U) == 0U) ? 16 : 1);
        if (draw(4U) == 0U) /* it stays where it is: at its very limit */
        {
            b->in.y[i] = ref[i];
            law.s[i] = (draw(2U) == 0U) ? s_most[i] : -s_most[i];
        }
    }
    if (draw(4U) == 0U)
    {
        any_cut(b, &law);
    }
    digest += (uint32_t)((draw(4U) != 0U) ? T(track)(&b->s, &law, ref, &b->in, &b->out)
                                          : T(coast)(&b->s, &law, &b->in, &b->out));
    digest = add(add(digest, &law, (uint32_t)sizeof(law)), &b->in, (uint32_t)sizeof(b->in));
    return add(add(digest, &b->s, (uint32_t)sizeof(b->s)), &b->out, (uint32_t)sizeof(b->out));
}

#endif
