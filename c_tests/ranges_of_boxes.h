/*
 * What test_ranges.c asks of a mode estimator, whose state holds one box per hypothesis.
 */

/* The bounds hold the box of x, and little more where S turns it. */
static int holds(const T(out) *out, const T(real) *lo, const T(real) *hi)
{
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        CHECK((out->x_lo[i] <= lo[i]) && (out->x_hi[i] >= hi[i]));
        CHECK((out->x_lo[i] - out->x_lo[i]) >= 0);
        CHECK((out->x_hi[i] - out->x_hi[i]) >= 0);
    }
    return 0;
}

/* Every mode is possible since long ago, nothing else is. */
static int knows_nothing(const bench *b)
{
    for (uint32_t q = 0U; q < M(MODES); q++)
    {
        CHECK(((b->out.mode_set >> q) & 1U) != 0U);
        CHECK(((b->out.settled_set >> q) & 1U) != 0U);
    }
    CHECK((b->out.mode == 0U) && (b->out.age == M(OLDEST)) && (b->out.raw == 0U));
    return 0;
}

static int init_and_reset_boxes(void)
{
    bench b;

    start(&b);
    CHECK((forgets(&b.s) == 0) && (b.s.decided == 0U));
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK((holds(&b.out, x0_lo, x0_hi) == 0) && (knows_nothing(&b) == 0));
    b.s.decided = M(MODES) - 1U;
    T(reset)(&b.s);
    CHECK((forgets(&b.s) == 0) && (b.s.decided == 0U));
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    CHECK((holds(&b.out, x_lo, x_hi) == 0) && (knows_nothing(&b) == 0));
    return 0;
}

/* Boxes far beyond the ranges are cut: the answer stays within some ranges about zero. */
static int framers_are_cut(void)
{
    bench b;

    start(&b);
    T(reset)(&b.s);
    for (uint32_t i = 0U; i < M(NSHAPE); i++)
    {
        b.s.box_lo[i] *= 100000;
        b.s.box_hi[i] *= 100000;
    }
    CHECK(T(predict)(&b.s, &b.in, &b.out) == M(OK));
    for (uint32_t i = 0U; i < M(NX); i++)
    {
        CHECK((b.out.x_hi[i] < ((x_hi[i] - x_lo[i]) * 10000)) && (b.out.x_lo[i] > ((x_lo[i] - x_hi[i]) * 10000)));
    }
    return 0;
}

/* A state spoilt in memory, even to NaN, answers with numbers and with modes. */
static int framers_at_the_ends(void)
{
    for (uint32_t n = 0U; n < (2U * M(NSHAPE)); n++)
    {
        bench b;

        start(&b);
        b.s.box_lo[n / 2U] = ((n % 2U) != 0U) ? not_a_number() : huge();
        b.s.box_hi[n / 2U] = ((n % 3U) != 0U) ? not_a_number() : -huge();
        for (uint32_t q = 0U; q < M(MODES); q++)
        {
            b.s.alive[q] = 0xFFFFFFFFU - ((n * 7U) << q);
        }
        b.s.decided = 0xFFFFFFFFU;
        for (uint32_t k = 0U; k < 4U; k++)
        {
            CHECK(((k == 2U) ? T(predict)(&b.s, &b.in, &b.out) : T(step)(&b.s, &b.in, &b.out)) == M(OK));
            CHECK((b.out.mode < M(MODES)) && (b.out.mode_set != 0U) && (b.out.age <= M(OLDEST)));
            for (uint32_t i = 0U; i < M(NX); i++)
            {
                CHECK((b.out.x_lo[i] - b.out.x_lo[i]) >= 0);
                CHECK((b.out.x_hi[i] - b.out.x_hi[i]) >= 0);
            }
        }
    }
    return 0;
}
