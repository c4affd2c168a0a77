"""Open points of Zammali (2020), on every plant of the gallery that has one: the design holds, who ignores it errs.

Nobody measures a parameter of a switched plant; a parameter is measured with an error; a mode is told one sample late.
The plant as the firmware sees it runs in exact rational arithmetic, unknowns and disturbances in corners, a switch at
any sample (``test_soundness_varying.simulate``). The compiled C contains its state at every sample. The same gains with
tables that ignore the point, and make the most of all else, do not.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact import false_alarms
from test_late import alone
from test_soundness_varying import Q, Runs, feed, missed, nearest, simulate

from codegen.certify.freeze import freeze, limits
from codegen.observers import FramerTables
from codegen.pipeline import design as make
from codegen.plant.load import gallery_names, load
from codegen.plant.simulate import told
from codegen.synthesis import METHODS


def tables_for(plant, design):
    """The design's gains, frozen for another plant; what the firmware accepts as a parameter is left as it is."""
    t = design.observer.tables["float32"]
    gains = {"L_hi": t.L_hi, "L_lo": t.L_lo, "N_hi": t.N_hi, "N_lo": t.N_lo, "L_theta": t.vary.L, "split": t.signed,
             "midpoint": t.vary.midpoint, "late": t.vary.late, "columns": t.vary.columns}
    made = freeze(FramerTables, plant.observed.modes, limits(plant), gains, "float32")
    return replace(made, vary=replace(made.vary, theta_lo=t.vary.theta_lo, theta_hi=t.vary.theta_hi))


def believing(design, change):
    """An observer with the design's gains that takes ``change(parameter)`` for the parameters of the plant."""
    plant = replace(design.plant, theta=tuple(change(s) for s in design.plant.theta))
    return type(design.observer)({"float32": tables_for(plant, design)}, design.observer.supervision)


def at_its_middle(s):
    middle = (s.lo + s.hi) / 2
    return s if s.measured else replace(s, lo=middle, hi=middle)


def read_exactly(s):
    return replace(s, error=0.0)


#: Point -> whether a plant has it, and the observer that ignores it.
POINTS = {
    "a parameter that nobody measures, in a switched plant": (
        lambda p: p.n_modes > 1 and any(not s.measured for s in p.theta), lambda d: believing(d, at_its_middle)),
    "a parameter measured with an error": (
        lambda p: any(s.error > 0 for s in p.theta), lambda d: believing(d, read_exactly)),
    "a mode told one sample late, the new mode believed": (
        lambda p: p.switching.late, lambda d: alone(d, lambda last, now: now)),
    "a mode told one sample late, the last mode believed": (
        lambda p: p.switching.late, lambda d: alone(d, lambda last, now: last)),
}
PLANTS = [p for p in map(load, gallery_names()) if p.switching.known and (not p.method or METHODS[p.method].framers)]
CASES = [(point, p.name) for point, (has, _) in POINTS.items() for p in PLANTS if has(p)]
_DONE = {}


def case(name, runs=8):
    """Design and exact runs of a gallery plant, made once."""
    if name not in _DONE:
        plant, rng = load(name), np.random.default_rng(len(name))
        out = [simulate(plant, 7 * s + len(name)) for s in range(runs)]
        x, u, y, q, theta = zip(*out)
        read = np.array([[[nearest(a) for a in row] for row in rows] for rows in y])
        q = np.array([told(plant, np.asarray(row), rng) for row in q])
        _DONE[name] = make(plant), Runs(list(x), np.array(u), read, q, np.array(theta))
    return _DONE[name]


def test_every_point_has_a_plant():
    assert {point for point, _ in CASES} == set(POINTS)


@pytest.mark.parametrize("name", sorted({name for _, name in CASES}))
def test_compiled_c_contains_the_exact_state(name, workshop):
    design, runs = case(name)
    lo, hi = ([Q(a) for a in side] for side in design.plant.limits("x"))
    assert all(a <= b <= c for run in runs.x for row in run for a, b, c in zip(lo, row, hi)), "runs keep to the ranges"
    trace = feed(workshop.driver(design), runs)
    assert np.all(trace.status == 0) and missed(trace, runs) == 0 and false_alarms(trace) == 0
    assert trace.differs(feed(design.observer, runs)) == []


@pytest.mark.parametrize("name", sorted({name for _, name in CASES}))
def test_same_plant_frozen_again_survives(name):
    """The control of the mutants: what they change is the plant that they believe in, nothing else."""
    design, runs = case(name)
    again = type(design.observer)({"float32": tables_for(design.plant, design)}, design.observer.supervision)
    assert missed(feed(again, runs), runs) == 0


@pytest.mark.parametrize(("point", "name"), CASES)
def test_who_ignores_it_loses_the_state(point, name):
    design, runs = case(name)
    assert missed(feed(POINTS[point][1](design), runs), runs) > 10


@pytest.mark.parametrize("name", sorted({name for _, name in CASES}))
def test_faults_are_promised_within_their_range(name):
    """What the point costs leaves a promise: each channel's surely detected step is inside the declared range."""
    design, _ = case(name)
    for signal, found in zip(design.plant.f, design.detection["float32"], strict=True):
        assert 0 < found["by_delay"][-1] < max(-signal.lo, signal.hi)
