/*
 * bank_plant.h: the state of a bank of observers as test_supervisor.c wants it.
 */
#ifndef BANK_PLANT_H
#define BANK_PLANT_H

#include "bench.h"

/* Observers at rest that measure nothing; averages zero (0), far off on either side (1, 2), or anywhere (3). */
static void plant(bench *b, uint32_t what)
{
    for (uint32_t i = 0U; i < M(NZ); i++)
    {
        b->s.z[i] = 0;
    }
    for (uint32_t i = 0U; i < M(NA); i++)
    {
        b->s.a[i] = (what == 0U) ? 0 : (((what == 3U) ? (T(real))draw(4000U) : (T(real))(1000000U + i)) / 10000);
        b->s.a[i] = ((what == 2U) || ((what == 3U) && (draw(2U) == 0U))) ? -b->s.a[i] : b->s.a[i];
    }
    b->s.wait = 0U;
    for (uint32_t i = 0U; i < M(NY); i++)
    {
        b->in.y[i] = 0;
    }
}

/* Whether the observers are at their start. */
static int at_start(const T(state) *s)
{
    T(state) whole;

    T(reset)(&whole);
    return (s->wait == whole.wait) && same_bytes(s->a, whole.a, sizeof(whole.a)) && same_bytes(s->z, whole.z, sizeof(whole.z));
}

#endif
