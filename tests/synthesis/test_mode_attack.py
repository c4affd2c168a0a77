"""Where nobody tells the mode: an adversary drives the truth into the bounds; where they are right it stays."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flint import fmpq
from helpers import driven, follower, small_modes, trailing
from helpers.attack import attacked

from codegen.certify.ellipsoids import segments
from codegen.observers import FAMILIES

AGES = 3
#: Plants of each family whose bounds an adversary comes close to; the first, "between" and "hidden" switch within
#: samples.
CASES = {("mode", "no input, two outputs"): lambda real: small_modes.tables("no input, two outputs", AGES, real),
         **{("driven", name): lambda real, name=name: driven.tables(name, real)
            for name in ("hidden", "discrete", "turned")},
         **{("follower", name): lambda real, name=name: follower.tables(name, real)
            for name in ("box", "zonotope", "table")},
         **{("trailing", name): lambda real, name=name: trailing.tables(name, real)
            for name in ("pushed", "between")}}
PLANTS = {"mode": small_modes, "driven": driven, "follower": follower, "trailing": trailing}
RUNS, STEPS = 4, 50


@lru_cache
def plant(family, name):
    return PLANTS[family].plant(name)


def attack(case, t):
    return attacked(plant(*case), FAMILIES[case[0]], t, AGES + 1, RUNS, STEPS, 1)


@pytest.mark.parametrize("case", CASES, ids=" ".join)
def test_an_adversary_loses_nothing(case):
    """The state is in its bounds, the mode in the set, no alarm, no estimate beyond its bound, to the last digits."""
    found = attack(case, CASES[case]("float64"))
    assert found.lost == [] and 0 <= min(found.near) < 1e-10
    assert (0.8 < found.share <= 1) == (case[0] == "trailing")


def narrower(t, share, *names, told=False):
    """Tables with smaller constants; those of what is driven where told."""
    of = t.told if told else t
    changed = replace(of, **{name: getattr(of, name) * (1 - share) for name in names})
    return replace(t, told=changed) if told else changed


@pytest.mark.parametrize("case, share, names, told", [
    (("mode", "no input, two outputs"), 1e-6, ("v_lo", "v_hi"), False),
    (("driven", "hidden"), 1e-6, ("v_lo", "v_hi"), False),
    (("driven", "discrete"), 0.01, ("reach", "birth"), False),
    (("driven", "discrete"), 0.01, ("d_lo", "d_hi"), True),
    (("follower", "box"), 0.01, ("reach", "birth"), False),
    (("follower", "zonotope"), 0.01, ("reach", "birth"), False),
    (("trailing", "pushed"), 0.01, ("reach", "birth"), False),
    (("trailing", "pushed"), 0.01, ("h",), True),
    (("trailing", "between"), 1e-6, ("v_lo", "v_hi"), False)], ids=str)
def test_it_finds_what_is_a_little_too_narrow(case, share, names, told):
    assert attack(case, narrower(CASES[case]("float64"), share, *names, told=told)).lost


def test_an_ellipsoid_of_less_than_the_smallest_squares():
    """Of a plant that nothing disturbs only subnormal numbers are left, whose squares are zero."""
    least = fmpq(1, 2**1070)
    Q = segments(np.array([[least], [least]], dtype=object), np.array([least, fmpq(0)], dtype=object), np.ones(2))
    assert Q[0, 0] >= 4 * least**2 and Q[1, 1] >= least**2
