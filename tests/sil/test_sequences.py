"""Any sequence of samples, with NaN, infinities, subnormals and any mode: the C answers what the reference does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import built, write
from hypothesis import example, given, settings
from hypothesis import strategies as st

from codegen.designs import read_design
from codegen.host.build import build

GENERATED = Path(__file__).resolve().parents[2] / "generated"
NAMES = ("cart_tnl-interval", "lamouchi_component-interval", "zammali_fd_interval", "zammali_lpv_dt_lpv-interval")


@pytest.fixture(scope="module", params=NAMES)
def bench(request, tmp_path_factory):
    """Design and compiled driver."""
    design = read_design(GENERATED / request.param)
    return design, built(design, tmp_path_factory.mktemp(request.param))


def numbers(signals):
    """A vector: each number any float32 at all, or one of its range with both ends."""
    return st.tuples(*(st.one_of(st.floats(width=32), st.floats(np.float32(s.lo), np.float32(s.hi), width=32),
                                 st.sampled_from((float(np.float32(s.lo)), float(np.float32(s.hi)), 0.0, -0.0, 1e-45)))
                       for s in signals))


def statuses(design, driver) -> set[int]:
    """Drive any sequences: equal bit for bit, accepted bounds are numbers in order; return the statuses met."""
    plant, seen = design.plant, set()
    measured = [s for s in plant.theta if s.measured]
    mode = st.one_of(st.integers(0, plant.n_modes - 1), st.integers(0, 2**32 - 1))
    sample = st.tuples(numbers(plant.u), numbers(plant.y), numbers(measured), mode)
    # Each refusal at least once, whatever is drawn: a sample that is accepted, and the same with one part spoilt.
    fine = [tuple(float(np.float32((s.lo + s.hi) / 2)) for s in part) for part in (plant.u, plant.y, measured)] + [0]
    spoilt = [tuple(float("nan") for _ in part) for part in (plant.u, plant.y, measured)] + [plant.n_modes]
    told = [tuple(fine), *(tuple(spoilt[i] if i == at else fine[i] for i in range(4)) for at in range(4))]

    @settings(max_examples=150, deadline=None, derandomize=True, database=None)
    @example(told)
    @given(st.lists(sample, min_size=1, max_size=20))
    def run(samples):
        u, y, theta = (np.array([s[i] for s in samples], dtype=np.float32).reshape(len(samples), -1) for i in range(3))
        q = np.array([s[3] for s in samples])
        trace = driver.run(u, y, q, theta)
        with np.errstate(all="ignore"):
            assert trace.differs(design.observer.run(u, y, q, theta, real=driver.real)) == []
        done = (trace.status == 0) | (trace.status == 3)
        assert np.isfinite(trace.x_lo[done]).all() and np.all(trace.x_lo[done] <= trace.x_hi[done])
        assert not np.any(trace.assured & (trace.raw_bits != 0))
        seen.update(trace.status.tolist())

    run()
    return seen


def test_any_sequence(bench):
    design, driver = bench
    seen, plant = statuses(design, driver), design.plant
    measured = any(s.measured for s in plant.theta)
    assert {0, 1, 2, 3} - ({2} if not plant.u else set()) <= seen and (4 in seen) == measured


def test_a_guard_that_is_weaker_is_noticed(tmp_path):
    """The control: an input check that lets infinity pass."""
    design = read_design(GENERATED / NAMES[0])
    folder = write(design, tmp_path / "c")
    source = folder / "cart.c"
    weaker, count = re.subn(r"&& \(in->u\[0\] <= [^)]*\)", "&& (in->u[0] <= (in->u[0] + 1.0F))", source.read_text())
    assert count == 1
    source.write_text(weaker)
    with pytest.raises(AssertionError):
        statuses(design, build(folder))
