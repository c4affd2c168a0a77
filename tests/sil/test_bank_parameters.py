"""A bank whose weights read a measured parameter, of a discrete plant: C as reference, refusals, and who is named."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers import small_banks
from helpers.folders import built, write
from helpers.tools import need

from codegen.observers import BankObserver, Supervision
from codegen.observers.supervisor import BAD_INPUT, BAD_OUTPUT, BAD_PARAMETER

need("gcc")


@pytest.mark.parametrize("real, layout", [("float32", "table"), ("float64", "loop")])
def test_the_c_equals_the_reference(real, layout, tmp_path):
    """Faults, lost and refused samples, a parameter beyond its bounds, at their ends, or no number: every answer."""
    d = small_banks.frozen()
    design = replace(d, observer=BankObserver(d.observer.tables, Supervision((2, 3), False, 4, 3, assures=False)))
    t = d.observer.tables[real]
    u, y, q, theta = (np.repeat(v, 3, axis=0) for v in small_banks.stimulus(d.plant, 300, 1, [(0, 60, 110, "0.5")]))
    theta[1, 40], theta[1, 41], y[1, 80], y[2, 200:203] = 0.7001, np.nan, [0, 5, 0], np.nan
    theta[2, 100], theta[2, 101:140] = np.inf, np.random.default_rng(0).uniform(0.15, 0.75, (39, 1))
    theta[0, 20], theta[0, 21], u[2, 250] = t.theta_lo, t.theta_hi, np.nan
    y[2, 260:] = np.random.default_rng(1).uniform(t.y_lo, t.y_hi, y[2, 260:].shape)
    trace = design.observer.run_many(u, y, q, real, theta=theta)
    assert built(design, tmp_path, real, layout).run_many(u, y, q, theta=theta).differs(trace) == []
    assert set(np.unique(trace.status)) == {0, BAD_INPUT, BAD_OUTPUT, BAD_PARAMETER}
    assert trace.status[1, 39:42].tolist() == [0, BAD_PARAMETER, BAD_PARAMETER] and not trace.status[0].any()
    assert 5 < (trace.status[2, 101:140] == BAD_PARAMETER).sum() < 20  # a sixth beyond, on either side
    assert not trace.ready[1, 42:42 + t.settle].any() and trace.ready[0].all()  # refused: all starts anew
    assert {-1, 0} <= set(np.unique(trace.isolated)) and trace.raw_bits.mean() > 0


def test_the_self_test_passes_and_notices_another_parameter(tmp_path):
    folder = write(small_banks.frozen(), tmp_path)
    text = (folder / "tanks.c").read_text()
    assert "t2 ? in->theta[0] : 0.2F" in text
    for changed, expected in ((text, 0), (text.replace("t2 ? in->theta[0]", "t2 ? 0.3F"), 1),
                              (text.replace("!tanks_theta_accepted(in)", "false"), 1)):
        (folder / "tanks.c").write_text(changed)
        subprocess.run(["gcc", "-std=c99", "-ffp-contract=off", "tanks.c", "test_tanks.c", "-o", "t"], cwd=folder,
                       check=True)
        assert subprocess.run(["./t"], cwd=folder, check=False).returncode == expected


def test_the_faulty_sensor_is_named_and_the_valve_alone_raises_nothing():
    """Both sensors in turn; with another reading of the valve than the true one there are false alarms."""
    d = small_banks.frozen()
    u, y, q, theta = small_banks.stimulus(d.plant, 300, 5, [(0, 60, 110, "0.3"), (1, 200, 250, "-0.3")])
    trace = d.observer.run_many(u, y, q, theta=theta)
    named = trace.isolated[0]
    assert (named[65:110] == 0).all() and (named[206:250] == 1).all() and set(np.unique(named)) == {-1, 0, 1}
    u, y, q, theta = map(np.concatenate, zip(*(small_banks.stimulus(d.plant, 200, seed) for seed in range(3))))
    both = d.observer.run_many(*(np.tile(v, (2, *[1] * (v.ndim - 1))) for v in (u, y, q)), theta=np.concatenate(
        [theta, np.roll(theta, 5, axis=1)]))
    assert not both.alarm[:3].any() and both.alarm[3:].any(axis=1).all()


def test_a_discrete_plant_of_its_state_is_told_apart_too():
    d = small_banks.frozen("state")
    u, y, q, theta = small_banks.stimulus(d.plant, 300, 2, [(0, 60, 110, "0.5"), (1, 200, 250, "-0.5")])
    assert theta.shape[-1] == 0
    named = d.observer.run_many(u, y, q).isolated[0]
    assert (named[66:110] == 0).all() and (named[208:250] == 1).all() and set(np.unique(named)) == {-1, 0, 1}
