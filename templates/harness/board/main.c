/*
 * Run the golden self-test of an observer on a board, and measure each of its calls on the way.
 *
 * The linker leads the self-test's calls of <prefix>_step to __wrap_<prefix>_step here (option --wrap), so the
 * self-test that runs is the one that a user runs. Printed at the end: one line per figure, name and
 * hexadecimal numbers. Compiled with -include <prefix>.h and with the macros
 *     T(name)  <prefix>_name    WRAP(name)  __wrap_<prefix>_name    CALL(name)  __real_<prefix>_name
 *     M(name)  <PREFIX>_name
 * With -DLAW a tracking law is measured too: <prefix>_track and <prefix>_coast, each with the observer's step in it.
 * With -DON_HOST only the digest is printed, by stdio: what a board must answer, bit for bit.
 */
#include <stdint.h>

#if defined(ON_HOST)
#include <stdio.h>
#define BOARD_STACK_POINTER(p) ((p) = 0)
#define SPAN 0U
static const uint32_t board_ticks_mask = 0U;
static uint32_t board_ticks(void) { return 0U; }
static void board_put(char c) { (void)putchar(c); }
#else
#include "board.h"
#define SPAN 1024U /* bytes below the stack pointer that are painted; of a deeper stack only these are seen */
#endif

int T(self_test)(void);

typedef T(status) call(T(state) *s, const T(in) *in, T(out) *out);
call CALL(step), CALL(predict), WRAP(step), WRAP(predict);
void CALL(reset)(T(state) *s);
void WRAP(reset)(T(state) *s);

/* Ticks of the calls of one kind. */
typedef struct {
    uint32_t calls;
    uint32_t least;
    uint32_t most;
} ticks;

#if defined(LAW)
typedef T(status) law_call(T(state) *s, T(law) *law, const T(real) *ref, T(in) *in, T(out) *out);
typedef T(status) blind_call(T(state) *s, T(law) *law, T(in) *in, T(out) *out);
law_call CALL(track), WRAP(track);
blind_call CALL(coast), WRAP(coast);
static ticks track, coast;
#endif

static ticks empty, step, ordinary, predict, refused;
static uint32_t digest = 2166136261U, calm, last_ticks, deepest;

/* What a call costs that does nothing: to be subtracted. */
static T(status) nothing(T(state) *s, const T(in) *in, T(out) *out)
{
    (void)s;
    (void)in;
    (void)out;
    return M(OK);
}

static void note(ticks *t)
{
    t->least = ((t->calls == 0U) || (last_ticks < t->least)) ? last_ticks : t->least;
    t->most = (last_ticks > t->most) ? last_ticks : t->most;
    t->calls++;
}

/*
 * Body of a function: call it, with its ticks in last_ticks and the bytes of stack that it has written in deepest.
 */
#define MEASURED(the_call) \
    volatile unsigned char *floor_of_caller; \
    uint32_t depth = SPAN, before, after; \
    T(status) status; \
\
    BOARD_STACK_POINTER(floor_of_caller); \
    for (uint32_t i = 1U; i <= SPAN; i++) \
    { \
        *(floor_of_caller - i) = 0xA5U; \
    } \
    before = board_ticks(); \
    status = (the_call); \
    after = board_ticks(); \
    while ((depth > 0U) && (*(floor_of_caller - depth) == 0xA5U)) \
    { \
        depth--; \
    } \
    deepest = (depth > deepest) ? depth : deepest; \
    last_ticks = (after - before) & board_ticks_mask; \
    return status

static __attribute__((noinline)) T(status) measure(call *f, T(state) *s, const T(in) *in, T(out) *out)
{
    MEASURED(f(s, in, out));
}

/* FNV-1a over the bytes of an answer. */
static void add_to_digest(const void *answer, uint32_t size)
{
    const unsigned char *byte = (const unsigned char *)answer;

    for (uint32_t i = 0U; i < size; i++)
    {
        digest = (digest ^ byte[i]) * 16777619U;
    }
}

/*
 * Ordinary: the guarantee is in force, nothing is outside its bounds, and the two samples before were measured
 * and within bounds too, so that no restart after a fault or a gap is part of it.
 */
T(status) WRAP(step)(T(state) *s, const T(in) *in, T(out) *out)
{
    const T(status) status = measure(CALL(step), s, in, out);

    if (status != M(OK))
    {
        note(&refused);
    }
    else
    {
        const int clean = (out->raw == 0U) && (out->alarm == 0U);

        note(&step);
        if (clean && (calm >= 2U) && (out->assured == 1U))
        {
            note(&ordinary);
        }
        calm = clean ? (calm + 1U) : 0U;
        add_to_digest(out, (uint32_t)sizeof(*out));
    }
    return status;
}

T(status) WRAP(predict)(T(state) *s, const T(in) *in, T(out) *out)
{
    const T(status) status = measure(CALL(predict), s, in, out);

    calm = 0U;
    if (status != M(OK))
    {
        note(&refused);
    }
    else
    {
        note(&predict);
        add_to_digest(out, (uint32_t)sizeof(*out));
    }
    return status;
}

void WRAP(reset)(T(state) *s)
{
    calm = 0U;
    CALL(reset)(s);
}

#if defined(LAW)
static __attribute__((noinline)) T(status) measure_track(T(state) *s, T(law) *law, const T(real) *ref, T(in) *in, T(out) *out)
{
    MEASURED(CALL(track)(s, law, ref, in, out));
}

static __attribute__((noinline)) T(status) measure_coast(T(state) *s, T(law) *law, T(in) *in, T(out) *out)
{
    MEASURED(CALL(coast)(s, law, in, out));
}

static T(status) note_law(ticks *kind, T(status) status, const T(law) *law, const T(in) *in, const T(out) *out)
{
    note((status == M(OK)) ? kind : &refused);
    if (status == M(OK))
    {
        add_to_digest(law, (uint32_t)sizeof(*law));
        add_to_digest(in->u, (uint32_t)sizeof(in->u));
        add_to_digest(out, (uint32_t)sizeof(*out));
    }
    return status;
}

T(status) WRAP(track)(T(state) *s, T(law) *law, const T(real) *ref, T(in) *in, T(out) *out)
{
    return note_law(&track, measure_track(s, law, ref, in, out), law, in, out);
}

T(status) WRAP(coast)(T(state) *s, T(law) *law, T(in) *in, T(out) *out)
{
    return note_law(&coast, measure_coast(s, law, in, out), law, in, out);
}
#endif

static void print_number(uint32_t value)
{
    board_put(' ');
    for (uint32_t shift = 32U; shift > 0U; shift -= 4U)
    {
        board_put("0123456789abcdef"[(value >> (shift - 4U)) & 15U]);
    }
}

static void print_name(const char *name)
{
    board_put('\n');
    while (*name != '\0')
    {
        board_put(*name++);
    }
}

static void print_ticks(const char *name, const ticks *t)
{
    print_name(name);
    print_number(t->calls);
    print_number(t->least);
    print_number(t->most);
}

int main(void)
{
    uint32_t result;

    (void)measure(nothing, 0, 0, 0);
    note(&empty);
    deepest = 0U; /* of the observer alone */
    result = (uint32_t)T(self_test)();
    print_name("self_test");
    print_number(result);
    print_name("digest");
    print_number(digest);
    print_name("state_bytes");
    print_number((uint32_t)sizeof(T(state)));
    print_name("stack_bytes");
    print_number(deepest);
    print_number(SPAN);
    print_ticks("empty", &empty);
    print_ticks("step", &step);
    print_ticks("ordinary", &ordinary);
    print_ticks("predict", &predict);
    print_ticks("refused", &refused);
#if defined(LAW)
    print_ticks("track", &track);
    print_ticks("coast", &coast);
#endif
    print_name("end\n");
    return 0;
}
