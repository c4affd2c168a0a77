"""Exact check of the average dwell time, and of the factor that switching puts on every bound.

From ``V+ <= (1 - lam) V + c^2`` in a mode and ``V_q <= rho V_l`` at a switch, with at most N0 + s/tau
switches in s samples, counting jumps gives

    V_k <= rho^N0 s^k V_0 + rho^(N0 + 1/tau) c^2 / (1 - s),     s = (1 - lam) rho^(1/tau) < 1.

Seed 000 states the bounds of Theorems 10, 17 and 18 with the one-mode factor 1/lam; under switching that
does not hold (counterexample in tests/synthesis). Powers with fractional exponents are bounded by
rationals whose integer powers are compared.
"""

from __future__ import annotations

import math
from fractions import Fraction

from flint import fmpq

from .exact import Q


def decays(rho: fmpq, lam: fmpq, add: int, drain: int) -> bool:
    """Whether (1 - lam)^add rho^drain < 1, i.e. tau = add/drain is long enough."""
    return (1 - lam) ** add * rho**drain < 1


def root_above(base: fmpq, power: int, root: int) -> fmpq:
    """A rational r with r^root >= base^power, close to base^(power/root) >= 0."""
    target = base**power
    guess = Q(float(base) ** (power / root))
    while guess**root < target:
        guess *= fmpq(2**40 + 1, 2**40)
    return guess


def factor(rho: fmpq, lam: fmpq, add: int, drain: int, chatter: float) -> fmpq | None:
    """Rational upper bound of the factor on c^2, or None where the dwell time is too short."""
    if rho == 1:
        return 1 / lam
    if not decays(rho, lam, add, drain):
        return None
    s = (1 - lam) * root_above(rho, drain, add)
    if s >= 1:
        return None
    n0 = Fraction(math.ceil(Fraction(chatter) * 64), 64)  # never below the chatter bound that is claimed
    exponent = n0 + Fraction(drain, add)
    return root_above(rho, exponent.numerator, exponent.denominator) / (1 - s)
