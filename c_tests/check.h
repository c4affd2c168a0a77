/*
 * check.h: the unit test framework of the generated C. No library, no output: a failed check ends the test
 * function with the number of its line, and main() returns it. The same tests run on the host, under
 * sanitizers and on a target.
 */
#ifndef CHECK_H
#define CHECK_H

#include <stdint.h>

/* Leave the test function with this line's number unless the condition holds. */
#define CHECK(condition)      \
    do                        \
    {                         \
        if (!(condition))     \
        {                     \
            return __LINE__;  \
        }                     \
    } while (0)

/* Run a test function; pass on the first failure. */
#define RUN(test)             \
    do                        \
    {                         \
        const int line = test(); \
        if (line != 0)        \
        {                     \
            return line;      \
        }                     \
    } while (0)

/* 1 if two objects of one size have the same bytes. */
static int same_bytes(const void *a, const void *b, uint32_t size)
{
    const unsigned char *p = (const unsigned char *)a;
    const unsigned char *q = (const unsigned char *)b;
    int same = 1;

    for (uint32_t i = 0U; i < size; i++)
    {
        same &= (p[i] == q[i]) ? 1 : 0;
    }
    return same;
}

#endif
