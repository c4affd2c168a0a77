/*
 * Run the golden self-test of an observer, then the samples on standard input, with counted numbers; print the work of
 * each call. One file with the observer, so that its calls can be led here by names.
 *
 * Macros: HEADER, SOURCE and TEST are the observer's files, T(name) is <prefix>_name, M(name) is <PREFIX>_name,
 * COUNTED_STEP and COUNTED_PREDICT the names by which the self-test calls. A sample is 0 (predict), 1 (step) or 2
 * (start anew, no numbers), the mode, u, y and theta; TOLD is the mode's member of the input, where it has one. Printed
 * per call: 0 or 1 (of a tracking law 2, coast, or 3, track), the status, the bits of raw, the work.
 */
#include <stdio.h>
#include "counted.h"
#include HEADER
#include SOURCE

static void print(int call, int status, uint32_t raw)
{
    printf("%d %d %u %u %u %u %u %u %u\n", call, status, (status == 0) ? raw : 0U, done.multiply, done.divide, done.add,
           done.compare, done.selections, done.exchanges);
}

static T(status) counted_step(T(state) *s, const T(in) *in, T(out) *out)
{
    done = work();
    const T(status) status = T(step)(s, in, out);
    print(1, (int)status, out->raw);
    return status;
}

static T(status) counted_predict(T(state) *s, const T(in) *in, T(out) *out)
{
    done = work();
    const T(status) status = T(predict)(s, in, out);
    print(0, (int)status, out->raw);
    return status;
}

#ifdef LAW
static T(status) counted_track(T(state) *s, T(law) *law, const T(real) *ref, T(in) *in, T(out) *out)
{
    done = work();
    const T(status) status = T(track)(s, law, ref, in, out);
    print(3, (int)status, out->raw);
    return status;
}

static T(status) counted_coast(T(state) *s, T(law) *law, T(in) *in, T(out) *out)
{
    done = work();
    const T(status) status = T(coast)(s, law, in, out);
    print(2, (int)status, out->raw);
    return status;
}
#endif

#include RENAMES
#include TEST

static int read(REAL *numbers, uint32_t count)
{
    int all = 1;

    for (uint32_t i = 0U; i < count; i++)
    {
        double x = 0.0;

        all = all && (scanf("%lf", &x) == 1);
        numbers[i] = REAL((RAW)x);
    }
    return all;
}

int main(void)
{
    T(state) s;
    T(in) in;
    T(out) out;
    int call;
    unsigned mode;

    out.raw = 0U;
    printf("self_test %d\n", T(self_test)());
    while (scanf("%d", &call) == 1)
    {
        if (call == 2)
        {
            T(init)(&s);
            printf("run\n");
        }
        else if ((scanf("%u", &mode) == 1)
#ifdef INPUTS
            && read(in.u, INPUTS)
#endif
            && read(in.y, M(NY))
#ifdef PARAMETERS
            && read(in.theta, PARAMETERS)
#endif
        )
        {
#ifdef TOLD
            in.TOLD = mode;
#endif
            (void)((call == 1) ? counted_step(&s, &in, &out) : counted_predict(&s, &in, &out));
        }
        else
        {
            return 1;
        }
    }
    return 0;
}
