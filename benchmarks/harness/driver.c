/*
 * Run every candidate over the same samples: first how far its answers are from the expected ones, then what a call
 * costs. CANDIDATES is X(name) for each, the empty one first; one line is printed per candidate.
 *     on a board   name deviation ticks stack     (hexadecimal; the deviation as the bits of a float)
 *     on the host  the same with the ticks 0; with an argument "count": callgrind dumps, "time": nanoseconds
 */
#include "bench.h"
#include "samples.h"

typedef void step(bench_state *s, const bench_in *in, bench_out *out);
#define X(name) step name##_step;
CANDIDATES
#undef X

void empty_step(bench_state *s, const bench_in *in, bench_out *out)
{
    (void)s;
    (void)in;
    (void)out;
}

/* Largest difference of any answer; NaN counts as infinite. */
static float deviation(const bench_out *out, const bench_real *wanted)
{
    const bench_real *found = (const bench_real *)out;
    float worst = 0.0F;
    uint32_t i;

    for (i = 0U; i < ANSWERS; i++)
    {
        const float difference = (float)(found[i] - wanted[i]);
        const float size = (difference < 0.0F) ? -difference : difference;
        worst = (size <= worst) ? worst : ((size > worst) ? size : 1e30F);
    }
    return worst;
}

#if defined(ON_HOST)
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <valgrind/callgrind.h>

static void count(const char *name, step *f)
{
    bench_state s = START;
    bench_out out;
    uint32_t k;

    CALLGRIND_ZERO_STATS;
    for (k = 0U; k < SAMPLES; k++)
    {
        CALLGRIND_TOGGLE_COLLECT;
        f(&s, &samples[k], &out);
        CALLGRIND_TOGGLE_COLLECT;
    }
    CALLGRIND_DUMP_STATS_AT(name);
}

static double clock_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (1e9 * (double)now.tv_sec) + (double)now.tv_nsec;
}

/* Nanoseconds of one call: the least of several rounds, because other programs can only add to it. */
static double time_of(step *f)
{
    double least = 1e30;
    int round;

    for (round = 0; round < 15; round++)
    {
        bench_state s = START;
        bench_out out;
        double before = clock_ns(), spent;
        uint32_t k;

        for (k = 0U; k < 64U * SAMPLES; k++)
        {
            f(&s, &samples[k % SAMPLES], &out);
        }
        spent = (clock_ns() - before) / (64.0 * SAMPLES);
        least = (spent < least) ? spent : least;
    }
    return least;
}

static void check(const char *name, step *f)
{
    bench_state s = START;
    bench_out out;
    float worst = 0.0F;
    uint32_t k;

    (void)memset(&out, 0, sizeof out);
    for (k = 0U; k < SAMPLES; k++)
    {
        float here;

        f(&s, &samples[k], &out);
        here = deviation(&out, expected[k]);
        worst = (here > worst) ? here : worst;
    }
    printf("%s %g\n", name, (double)worst);
}

int main(int argc, char **argv)
{
    const char *what = (argc > 1) ? argv[1] : "check";

#define X(name)                                                \
    if (strcmp(what, "count") == 0) { count(#name, name##_step); } \
    else if (strcmp(what, "time") == 0) { printf(#name " %g\n", time_of(name##_step)); } \
    else { check(#name, name##_step); }
    CANDIDATES
#undef X
    return 0;
}
#else
#include "board.h"
#define SPAN 6144U /* bytes below the stack pointer that are painted */

static void put_number(uint32_t value)
{
    uint32_t shift;

    board_put(' ');
    for (shift = 32U; shift > 0U; shift -= 4U)
    {
        board_put("0123456789abcdef"[(value >> (shift - 4U)) & 15U]);
    }
}

static __attribute__((noinline)) uint32_t call(step *f, bench_state *s, const bench_in *in, bench_out *out,
                                               uint32_t *deepest)
{
    volatile unsigned char *floor_of_caller;
    uint32_t depth = SPAN, before, after, i;

    BOARD_STACK_POINTER(floor_of_caller);
    for (i = 1U; i <= SPAN; i++)
    {
        *(floor_of_caller - i) = 0xA5U;
    }
    before = board_ticks();
    f(s, in, out);
    after = board_ticks();
    while ((depth > 0U) && (*(floor_of_caller - depth) == 0xA5U))
    {
        depth--;
    }
    *deepest = (depth > *deepest) ? depth : *deepest;
    return (after - before) & board_ticks_mask;
}

static void run(const char *name, step *f)
{
    bench_state s = START;
    bench_out out;
    uint32_t k, ticks = 0U, deepest = 0U;
    union { float value; uint32_t bits; } worst = { 0.0F };

    for (k = 0U; k < (uint32_t)(sizeof out / sizeof(bench_real)); k++)
    {
        ((bench_real *)&out)[k] = 0;
    }
    for (k = 0U; k < SAMPLES; k++)
    {
        float here;

        ticks += call(f, &s, &samples[k], &out, &deepest);
        here = deviation(&out, expected[k]);
        worst.value = (here > worst.value) ? here : worst.value;
    }
    while (*name != '\0')
    {
        board_put(*name++);
    }
    put_number(worst.bits);
    put_number(ticks);
    put_number(deepest);
    board_put('\n');
}

/* The compilers may call these two for loops and structs; the board has no library. */
void *memcpy(void *to, const void *from, unsigned int count);
void *memcpy(void *to, const void *from, unsigned int count)
{
    uint32_t i;

    for (i = 0U; i < (count / 4U); i++)
    {
        ((volatile uint32_t *)to)[i] = ((const uint32_t *)from)[i];
    }
    return to;
}

void *memset(void *to, int value, unsigned int count);
void *memset(void *to, int value, unsigned int count)
{
    uint32_t i;

    for (i = 0U; i < count; i++)
    {
        ((volatile unsigned char *)to)[i] = (unsigned char)value;
    }
    return to;
}

int main(void)
{
#define X(name) run(#name, name##_step);
    CANDIDATES
#undef X
    return 0;
}
#endif
