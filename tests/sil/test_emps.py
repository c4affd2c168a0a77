"""The recorded bench: the firmware finds every labelled pulse in time, and is quiet on everything else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from codegen.analysis.validate import episodes
from codegen.designs import read_design
from codegen.emit.package import generate
from codegen.host.build import build
from codegen.plant.simulate import simulate

FOLDER = Path(__file__).resolve().parents[2] / "generated" / "emps_tnl-interval"
SETTLED = 33  # samples since the last pulse


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    design = read_design(FOLDER)
    driver = build(generate(design, tmp_path_factory.mktemp("emps") / "c"))
    assert driver.real == "float32" and design.plant.sample_period == 0.005

    def over(name):
        record = simulate(design.plant, name)
        return record, driver.run(u=record.u, y=record.y, q=record.q)

    return design, over


def test_no_alarm_on_the_training_record(bench):
    _, trace = bench[1]("train")
    assert len(trace.alarm) == 4968 and not trace.raw_bits.any() and trace.assured.all() and not trace.status.any()


def test_every_pulse_is_found_within_three_samples(bench):
    record, trace = bench[1]("pulses")
    found = episodes(record.f, trace.raw_bits != 0, ("actuator",), tail=0)
    assert len(found) == 25 and all(e.delay is not None and e.delay <= 3 for e in found)


def test_no_alarm_in_settled_fault_free_samples(bench):
    record, trace = bench[1]("pulses")
    active = record.f[:, 0] != 0
    recent = np.convolve(active, np.ones(SETTLED + 1))[: len(active)] > 0
    assert 1500 < np.sum(~recent) < 2000 and not trace.raw_bits[~recent].any()


def test_the_pulse_is_above_the_surely_detected_size(bench):
    assert bench[0].detection["float32"][0]["by_delay"][-1] < 5.0


def test_bounds_that_are_far_too_narrow_alarm(bench):
    """The quiet is earned: with a tenth of the bounds the training record itself raises alarms."""
    from dataclasses import replace

    from codegen.selection.select import choose

    plant = bench[0].plant
    tight = tuple(replace(m, w_lo=(m.w_lo + m.w_hi) / 2 + (m.w_lo - m.w_hi) / 20,
                          w_hi=(m.w_lo + m.w_hi) / 2 + (m.w_hi - m.w_lo) / 20) for m in plant.modes)
    design = choose(replace(plant, modes=tight), "tnl-interval", {"criterion": "detection"}, lambda text: None)
    record = simulate(plant, "train")
    assert design.observer.run(u=record.u, y=record.y, q=record.q).raw_bits.any()
