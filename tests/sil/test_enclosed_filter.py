"""A fault estimation filter of a continuous plant, compiled: its bounds hold whatever moves between the samples."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.filters import hostile
from helpers.folders import built
from synthesis.test_enclosed import TEXT

import codegen
from codegen.plant.load import loads
from codegen.plant.simulate import simulate

#: The sensor's fault alone: what acts on the state is not seen at the sample at which it begins.
SENSOR = (TEXT.replace(', { name = "clog", range = [-2, 2] }]', "]").replace("minimum_dwell = 0.3\n", "")
          .replace("Df = [[1, 0], [0, 0]]\nBf = [[0, 0], [0, 5]]", "Df = [[1], [0]]")
          .replace('"zonotope"', '"hinf-filter"\nset_rows = 20'))
#: w turns four times a sample, so that its mean is zero, or stays at an end for two seconds.
FAST, SLOW = "sign(sin(2*pi*t/0.05))", "sign(sin(pi*t/2))"
LENGTH = 100


@lru_cache
def design():
    return codegen.design(loads(SENSOR))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return built(design(), tmp_path_factory.mktemp("filter") / "c")


def runs(size: float = 0.4):
    """The true plant at the corners of u, v and w, which is 0.2 give or take a size."""
    text = SENSOR.replace("bounds = [-0.2, 0.6]", f"bounds = [{0.2 - size}, {0.2 + size}]")
    truths = [simulate(loads(text.replace(f"0.4*{FAST}", f"{size}*{w}")), name, seed=seed)
              for w in (FAST, SLOW) for name in ("corner", "slow") for seed in (1, 2)]
    return tuple(np.stack([getattr(truth, k) for truth in truths]) for k in "uyq")


def test_bounds_hold_on_the_true_plant(compiled):
    """C and reference agree; no run exceeds a threshold, and with a disturbance half larger some do."""
    trace = compiled.run_many(*runs())
    assert not trace.differs(design().observer.run_many(*runs(), "float32"))
    assert not trace.raw_bits.any() and trace.assured.all() and not trace.status.any()
    share = np.max(np.abs(trace.f_hat) / trace.f_bound)
    assert 0.7 < share < 1
    assert compiled.run_many(*runs(0.6)).raw_bits.any()


def test_bounds_hold_on_what_encloses_it(compiled):
    """What is kept for the time between samples is used at its worst: close to the thresholds, and not beyond."""
    plant, observer = design().plant.enclosed, design().observer
    q = np.repeat(np.random.default_rng(2).integers(0, 2, (8, LENGTH // 4)), 4, axis=1)

    def driven(plant):
        worst = (hostile(SimpleNamespace(plant=plant, observer=observer), row, seed) for seed, row in enumerate(q))
        u, y = (np.array(a) for a in zip(*worst))
        return u, y, q

    trace = compiled.run_many(*driven(plant))
    assert not trace.differs(observer.run_many(*driven(plant), "float32"))
    assert not trace.raw_bits.any() and np.max(np.abs(trace.f_hat) / trace.f_bound) > 0.9
    wider = loads(SENSOR.replace("bounds = [-0.2, 0.6]", "bounds = [-0.22, 0.66]")).enclosed
    assert compiled.run_many(*driven(wider)).raw_bits.any()
