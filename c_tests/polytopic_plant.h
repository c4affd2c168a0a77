/*
 * polytopic_plant.h: the state of a polytopic observer as test_supervisor.c wants it.
 */
#ifndef POLYTOPIC_PLANT_H
#define POLYTOPIC_PLANT_H

#include "bench.h"

/* Where its own measurement is expected (0), or far off on either side (1, 2), or anywhere (3). */
static void plant(bench *b, uint32_t what)
{
    T(state) whole;

    T(reset)(&whole);
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        const T(real) far = (x_hi[i] - x_lo[i]) * (T(real))(1000U + (370U * i));
        const T(real) part = (x_hi[i] - x_lo[i]) * ((T(real))draw(4000U) / 8000);

        b->s.z[i] = whole.z[i];
        b->s.z[i] += (what == 0U) ? 0 : ((what == 3U) ? part : ((what == 1U) ? far : -far));
    }
    b->s.since = (what == 0U) ? M(LAST) : draw(M(LAST) + 1U);
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = whole.y[i];
        b->s.y[i] = whole.y[i];
    }
}

#endif
