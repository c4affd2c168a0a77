"""The exact tools under the certificate: LDL', directed rounding, the bound on rounding errors, dwell time."""

import math
from fractions import Fraction
from itertools import product as every

import numpy as np
import pytest
from exact import Q, nearest
from flint import fmpq
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.algebra.dwell import admissible, ratio, shortest, switching_factor
from codegen.certify import rounding
from codegen.certify.dwell import decays, factor, root_above
from codegen.certify.exact import down, exact_pivots, leading_failure, up
from codegen.certify.rounding import TINY, UNIT, input_error, sum_error
from codegen.errors import CertificateError
from codegen.observers.supervisor import Supervision, SupervisorState, watch_dwell

F32 = np.float32
quick = settings(max_examples=300, deadline=None, derandomize=True)


# -- positive definiteness -------------------------------------------------------------------------
def hilbert(n):
    return np.array([[fmpq(1, i + j + 1) for j in range(n)] for i in range(n)], dtype=object)


def test_known_definite_and_indefinite_matrices():
    tiny = fmpq(1, 2**300)
    one = fmpq(1)
    assert leading_failure(hilbert(14)) is None  # condition number 1e20: no float algorithm could say so
    assert leading_failure([[one, one], [one, one + tiny]]) is None
    assert leading_failure([[one, one], [one, one]]) == 1  # semidefinite is not definite
    assert leading_failure([[one, one], [one, one - tiny]]) == 1
    assert leading_failure([[0 * one]]) == 0
    assert leading_failure([[0 * one, one], [one, one]]) == 0
    assert leading_failure([[-one]]) == 0
    assert leading_failure([[one, 0, 2 * one], [0, one, 0], [2 * one, 0, one]]) == 2
    shifted = hilbert(8)
    for i in range(8):
        shifted[i, i] -= fmpq(1, 10**9)  # smallest eigenvalue of the Hilbert matrix is 1.1e-10
    assert leading_failure(shifted) is not None


@quick
@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_decision_is_that_of_the_construction(n, seed):
    """S = F' diag(d) F with unit triangular F: definite if and only if every d is positive."""
    rng = np.random.default_rng(seed)
    F = [[fmpq(int(rng.integers(-9, 10)), 7) if j > i else fmpq(int(i == j)) for j in range(n)] for i in range(n)]
    d = [fmpq(int(x), int(rng.integers(1, 10**9))) for x in rng.integers(-1, 12, n)]
    S = [[sum((F[k][i] * d[k] * F[k][j] for k in range(n)), fmpq(0)) for j in range(n)] for i in range(n)]
    first = next((k for k in range(n) if d[k] <= 0), None)
    assert leading_failure(S) == first
    assert exact_pivots(S) == (d if first is None else d[:first + 1])


# -- directed rounding -----------------------------------------------------------------------------
rationals = st.tuples(st.integers(-10**30, 10**30), st.integers(1, 10**30), st.integers(-200, 90)).map(
    lambda t: fmpq(t[0], t[1]) * fmpq(2) ** t[2])


@quick
@given(rationals, st.sampled_from(["float32", "float64"]))
def test_up_and_down_are_directed_and_tight(value, real):
    kind = np.dtype(real).type
    high, low = up(value, real), down(value, real)
    assert Q(low) <= value <= Q(high)
    assert float(kind(high)) == high and float(kind(low)) == low, "a number of the type"
    assert Q(high) == Q(low) == value or kind(high) == np.nextafter(kind(low), kind(np.inf))


@quick
@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_float_is_its_own_bound(x):
    assert up(Q(x), "float32") == down(Q(x), "float32") == x


def test_what_does_not_fit_is_refused():
    for value in (fmpq(2) ** 128, -(fmpq(2) ** 128)):
        with pytest.raises(CertificateError, match="expected a finite number"):
            up(value, "float32") if value > 0 else down(value, "float32")


# -- rounding errors of a sum ----------------------------------------------------------------------
def flushed(x: fmpq, flush: bool) -> fmpq:
    """What a target keeps that sets subnormal results to zero."""
    return fmpq(0) if flush and abs(x) < fmpq(1, 2**126) else x


def computed(terms, fused: bool, flush: bool = False) -> fmpq:
    """((c1 x1 + c2 x2) + ...) in float32, each operation rounded; fused: product and sum rounded once."""
    total = None
    for c, x in terms:
        exact = Q(c) * Q(x)
        if total is None:
            total = flushed(Q(nearest(exact)), flush)
        elif fused:
            total = flushed(Q(nearest(total + exact)), flush)
        else:
            total = flushed(Q(nearest(total + flushed(Q(nearest(exact)), flush))), flush)
    return total


def violated(terms, bounds, **options) -> bool:
    """Whether the bound for magnitudes ``bounds`` is broken by these values."""
    error, magnitude = sum_error([(Q(c), Q(b)) for (c, _), b in zip(terms, bounds)], "float32")
    got, right = computed(terms, **options), sum((Q(c) * Q(x) for c, x in terms), fmpq(0))
    return abs(got - right) > error or abs(got) > magnitude


sizes = st.one_of(*(st.floats(-(2.0**e), 2.0**e, width=32) for e in (0, 13, -62, -124)),
                  st.sampled_from([1.0, -1.0, 0.5, 2.0**-126, 2.0**-140, 2.0**-149, 1 + 2.0**-23]))


@settings(max_examples=1500, deadline=None, derandomize=True)
@given(st.lists(st.tuples(sizes, sizes), min_size=1, max_size=7), st.booleans(), st.booleans(), st.booleans())
def test_sum_error_bounds_float32_sums(terms, fused, flush, tight):
    """With and without fused multiply-add, with subnormals kept or flushed; bounds tight or rounded up to 1."""
    bounds = [abs(x) if tight else max(1.0, abs(x)) for _, x in terms]
    assert not violated([(F32(c), F32(x)) for c, x in terms], bounds, fused=fused, flush=flush)


def hard_sums(count=1500, seed=0):
    """Products and short sums whose errors come near the bound, at every scale, values bounded by 1 among them."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        n = 1 + k % 3
        scale = 2.0 ** rng.integers(-80, 30) if k % 4 else 2.0 ** rng.integers(-75, -60)
        c = (rng.uniform(0.5, 1, n) * scale).astype(F32)
        x = (rng.uniform(0.5, 1, n) * (1 if k % 2 else scale)).astype(F32)
        yield list(zip(c, x)), [1.0 if k % 2 else float(v) for v in x]


def broken(**options):
    return sum(violated(terms, bounds, **options) for terms, bounds in hard_sums())


@pytest.mark.parametrize("fused", [False, True])
def test_hard_sums_keep_to_the_bound(fused):
    assert broken(fused=fused) == 0
    assert broken(fused=fused, flush=True) == 0


def test_mutant_half_the_unit_roundoff_is_caught(monkeypatch):
    monkeypatch.setitem(rounding.UNIT, "float32", fmpq(1, 2**25))
    assert broken(fused=False) > 50
    assert broken(fused=True) > 50


def test_mutant_without_subnormals_is_caught(monkeypatch):
    monkeypatch.setitem(rounding.TINY, "float32", fmpq(0))
    assert broken(fused=False) > 0
    assert broken(fused=False, flush=True) > 0


def test_a_value_bounded_by_one_is_not_one():
    """|u| <= 1 does not make c * u exact. (The bound once took "value bound 1" for "the number 1".)"""
    c, x = F32(0.3), F32(0.7)
    assert abs(Q(c * x) - Q(c) * Q(x)) > 0
    assert sum_error([(Q(c), fmpq(1))], "float32")[0] >= UNIT["float32"] * Q(c)
    # The offset, and a coefficient 1, are exact, but for a target that flushes subnormals.
    tiny = TINY["float32"]
    assert sum_error([(fmpq(1), Q(c))], "float32") == (tiny, Q(c) + tiny)
    assert sum_error([(fmpq(-1), fmpq(3))], "float32") == (tiny, 3 + tiny)
    assert violated([(F32(1), F32(2.0**-140))], [2.0**-140], fused=False, flush=True) is False


@quick
@given(st.fractions(-10**6, 10**6), st.sampled_from(["float32", "float64"]))
def test_input_error_covers_the_callers_rounding(value, real):
    value = fmpq(value.numerator, value.denominator)
    assert abs(Q(nearest(value, real)) - value) <= input_error(abs(value), real)
    assert abs(Q(nearest(value, real)) - value) <= input_error(abs(Q(nearest(value, real))), real)
    assert TINY[real] > 0


# -- dwell time ------------------------------------------------------------------------------------
def by_definition(modes, tau, chatter):
    """Definition 9 word for word: every stretch of s samples holds at most N0 + s/tau switches."""
    switches = [k for k in range(1, len(modes)) if modes[k] != modes[k - 1]]
    return all(b - a + 1 <= chatter + (switches[b] - switches[a]) / tau + 1e-9
               for a in range(len(switches)) for b in range(a, len(switches)))


def by_monitor(modes, add, drain, limit):
    """What the integer bucket of the firmware says: too fast at any sample?"""
    s = Supervision(dwell_add=add, dwell_drain=drain, dwell_limit=limit)
    state, on = SupervisorState(1, 1, 9), np.array([True])
    for q in modes:
        watch_dwell(s, state, on, np.array([q]), 9)
        if state.too_fast[0]:
            return False
    return True


def test_leaky_bucket_is_definition_9():
    """300 random sequences, both the float bucket of ``admissible`` and the integer bucket of the C."""
    rng, yes = np.random.default_rng(0), 0
    for _ in range(300):
        add, drain, chatter = int(rng.integers(1, 30)), int(rng.integers(1, 9)), int(rng.integers(1, 5))
        p = rng.uniform(0.02, 0.6)
        modes = np.cumsum(rng.random(60) < p) % 3
        right = by_definition(modes, add / drain, chatter)
        assert admissible(tuple(modes), add / drain, chatter) == right
        assert by_monitor(modes, add, drain, chatter * add) == right
        yes += right
    assert 60 < yes < 240


def greedy_run(rng, rho, lam, tau, chatter, steps=400):
    """Largest V of a comparison system that jumps whenever the bucket lets it."""
    bucket, V, worst = 0.0, 0.0, 0.0
    for _ in range(steps):
        V = (1 - lam) * V + 1.0
        bucket = max(0.0, bucket - 1 / tau)
        if bucket + 1 <= chatter + 1e-12 and rng.random() < 0.95:
            bucket, V = bucket + 1, rho * V
        worst = max(worst, V)
    return worst


def test_switching_bound_on_random_comparison_systems():
    """V <= factor c^2 in 300 systems that switch as fast as they may; the bound is not idle."""
    rng, best = np.random.default_rng(1), 0.0
    for _ in range(300):
        lam, rho = rng.uniform(0.05, 0.9), rng.uniform(1.01, 8)
        add, drain = ratio(max(1.0, shortest(rho, lam) * rng.uniform(1.02, 3)))
        chatter = int(rng.integers(1, 4))
        bound = factor(Q(rho), Q(lam), add, drain, chatter)
        share = greedy_run(rng, rho, lam, add / drain, chatter) / float(bound)
        assert share <= 1 + 1e-9
        assert math.isclose(float(bound), switching_factor(rho, lam, add / drain, chatter), rel_tol=1e-9)
        best = max(best, share)
    assert best > 0.8


def test_one_mode_bound_fails_under_switching():
    """Dossier 2.5: two nilpotent modes, P = diag(1, 4) and diag(4, 1), decay 0.76, a switch at every sample.

    Each mode satisfies ``M' P M < (1 - a) P`` with input, the dwell time asked for is below one sample, and
    yet |e| grows to 20.03 where the bound printed for Theorems 10, 17, 18 (root taken, one-mode factor)
    allows 6.63. With the switching factor it is 115.6.
    """
    M = [np.array([[0, 0.95], [0, 0]]), np.array([[0, 0], [0.95, 0]])]
    P, alpha, rho = [np.array([1.0, 4.0]), np.array([4.0, 1.0])], 0.76, 4.0
    gamma2 = max(smallest_gain(m, p, alpha) for m, p in zip(M, P))
    assert shortest(rho, alpha) == pytest.approx(0.971, abs=5e-4)
    chi2 = 2.0  # input (1, 1) at every sample
    e = np.zeros(2)
    for k in range(2000):
        e = M[k % 2] @ e + 1.0
    assert np.linalg.norm(e) == pytest.approx(20.03, abs=0.01)
    one_mode = math.sqrt(gamma2 * chi2 / alpha)
    assert one_mode == pytest.approx(6.63, abs=0.005)
    assert one_mode < np.linalg.norm(e)
    right = math.sqrt(float(factor(Q(rho), Q(alpha), 1, 1, 1)) * gamma2 * chi2)
    assert right == pytest.approx(115.6, abs=0.05)
    assert np.linalg.norm(e) < right


def smallest_gain(M, P, alpha):
    """Least g with (M e + d)' P (M e + d) <= (1 - alpha) e' P e + g |d|^2."""
    R = (1 - alpha) * np.diag(P) - M.T @ np.diag(P) @ M
    X = M.T @ np.diag(P)
    return float(np.max(np.linalg.eigvalsh(np.diag(P) + X.T @ np.linalg.solve(R, X))))


def test_dwell_decision_is_exact():
    """(1 - lam)^add rho^drain < 1 at the very edge."""
    lam = fmpq(3, 4)
    assert not decays(fmpq(4), lam, 1, 1) and decays(fmpq(4) - fmpq(1, 10**40), lam, 1, 1)
    assert not decays(fmpq(16), lam, 2, 1) and decays(fmpq(16), lam, 201, 100)
    assert factor(fmpq(16), lam, 2, 1, 1) is None
    assert factor(fmpq(1), lam, 1, 1, 5) == 1 / lam


def test_chatter_bound_is_never_rounded_down():
    """A chatter bound of 1.004 may not be proved with 1 (as ``limit_denominator`` had it)."""
    plain, more = (factor(fmpq(2), fmpq(1, 2), 3, 1, n) for n in (1, 1.004))
    assert more > plain * Q(2**0.004) * fmpq(999999, 1000000)
    assert factor(fmpq(2), fmpq(1, 2), 3, 1, 1.5) < more * 2


@quick
@given(st.fractions(1, 50), st.integers(1, 40), st.integers(1, 40))
def test_root_above_is_above_and_close(base, power, root):
    base = fmpq(base.numerator, base.denominator)
    r = root_above(base, power, root)
    assert r**root >= base**power
    assert (r * (1 - fmpq(1, 2**30))) ** root < base**power


@quick
@given(st.floats(1, 500))
def test_ratio_is_not_below_the_dwell_time(tau):
    add, drain = ratio(tau)
    assert Fraction(add, drain) >= Fraction(tau) - Fraction(1, 10**11) and add / drain <= tau + 1 / 32
    assert all(isinstance(n, int) for n in (add, drain))


def test_all_short_sequences_agree_with_the_definition():
    """Every sequence of 9 samples over two modes."""
    for modes in every(range(2), repeat=9):
        assert admissible(modes, 2.5, 1) == by_definition(modes, 2.5, 1)
