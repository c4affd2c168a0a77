"""When the promise is in force: sound framers, spoilt framers, restarts; and plants without any disturbance."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.analysis.validate import episodes, sound_samples
from codegen.observers import Trace
from codegen.plant.load import loads
from codegen.selection.select import choose

STILL = """
format = 1
name = "still"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "a", range = [-5, 5] }, { name = "b", range = [-5, 5] }]
u = []
y = [{ name = "a", range = [-9, 9] }]
f = [{ name = "gauge", range = [-1, 1] }]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[common]
A = [[0.5, 0.2], [0.1, 0.6]]
C = [[1, 0]]
Df = [[1]]
"""


def trace_of(raw, missing=()):
    """A trace with these alarms; the given samples have no measurement."""
    trace = Trace.empty((len(raw),), 1, 1, np.float32)
    trace.raw_bits[:] = raw
    trace.r_lo[:] = 0.0
    trace.r_lo[list(missing)] = np.nan
    return trace


def fault(length, *active):
    f = np.zeros((length, 1))
    f[list(active)] = 1.0
    return f


@pytest.mark.parametrize("active,raw,missing,sound", [
    ((), "000000", (), "111111"),
    ((2,), "000000", (), "110000"),          # never seen: spoilt for good
    ((2,), "001100", (), "110001"),          # quiet at 4: the framers of 5 start anew
    ((2, 3, 4, 5), "001000", (), "110010"),  # restarted within the fault: true again, then spoilt again
    ((2,), "001100", (4,), "110000"),        # no measurement at 4, so no quiet sample; 5 is the first
    ((1,), "011100", (), "100011"),          # three in a row at 3: restart (recover = 3)
])
def test_sound_samples(active, raw, missing, sound):
    raw = np.array([int(c) for c in raw])
    got = sound_samples(fault(len(raw), *active), trace_of(raw, missing), recover=3)
    assert "".join(str(int(x)) for x in got) == sound


def test_episodes_find_the_first_alarm_in_or_shortly_after():
    found = episodes(fault(12, 2, 3, 7), np.isin(np.arange(12), [3, 9]), ("gauge",), tail=3)
    assert [(e.start, e.stop, e.delay) for e in found] == [(2, 4, 1), (7, 8, 2)]


def test_a_plant_without_disturbance_and_noise_gets_a_design():
    design = choose(loads(STILL), None, {}, lambda text: None)
    threshold = design.detection["float32"][0]["by_delay"][-1]
    assert threshold is not None and 0 <= threshold < 1e-4  # what is left is rounding
