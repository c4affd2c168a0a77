"""Does the compiled C do what the design promises? Every scenario of the plant file, judged sample by sample.

Before the first fault nothing may alarm and no state may leave its bounds. While a fault acts the framers
may be wrong. After it, once ``hold`` samples have passed, the promise is in force again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers import Trace
from ..plant.model import Plant, PlantTrace, Scenario
from ..plant.simulate import simulate

Array = np.ndarray


@dataclass(frozen=True)
class Episode:
    """One stretch of a fault: channel, samples [start, stop), largest size, when it raised the alarm."""

    channel: str
    start: int
    stop: int
    size: float
    delay: int | None


@dataclass(frozen=True)
class Outcome:
    """One scenario, run on the compiled C and on the reference.

    Parameters
    ----------
    scenario : Scenario
    truth : PlantTrace
    trace : Trace
        Of the compiled C.
    differences : list of str
        Fields in which C and reference are not ``==`` (must be empty).
    lost : int
        Samples with the promise in force at which a state was outside its bounds (records: not known, 0).
    false_alarms : int
        Samples with the promise in force at which an output was outside its bounds.
    settled : ndarray (K,) bool
        Where the promise is in force.
    episodes : list of Episode
    """

    scenario: Scenario
    truth: PlantTrace
    trace: Trace
    differences: list[str]
    lost: int
    false_alarms: int
    settled: Array
    episodes: list[Episode]

    @property
    def passed(self) -> bool:
        """C equals reference, nothing lost, no false alarm."""
        return not self.differences and self.lost == 0 and self.false_alarms == 0


def settled_samples(f: Array, hold: int) -> Array:
    """True before any fault and again ``hold`` samples after one: f (K, n_f) -> (K,) bool."""
    active = np.any(f != 0, axis=1)
    out = np.ones(len(active), dtype=bool)
    quiet = hold + 1
    for k, now in enumerate(active):
        quiet = 0 if now else quiet + 1
        out[k] = quiet > hold
    return out


def episodes(f: Array, raw: Array, names: tuple[str, ...], tail: int) -> list[Episode]:
    """Stretches in which a channel is nonzero, with the delay of the first alarm in it (or ``tail`` after)."""
    out = []
    for j, name in enumerate(names):
        active = np.concatenate([[False], f[:, j] != 0, [False]])
        starts, stops = np.flatnonzero(~active[:-1] & active[1:]), np.flatnonzero(active[:-1] & ~active[1:])
        for start, stop in zip(starts, stops):
            hits = np.flatnonzero(raw[start:stop + tail])
            out.append(Episode(name, int(start), int(stop), float(np.max(np.abs(f[start:stop, j]))),
                               int(hits[0]) if len(hits) else None))
    return sorted(out, key=lambda e: e.start)


def judge(plant: Plant, scenario: Scenario, truth: PlantTrace, trace: Trace, differences: list[str]) -> Outcome:
    """Hold one run against the promise."""
    hold = plant.target.hold
    settled = settled_samples(truth.f, hold)
    lo, hi = plant.limits("x")
    # The simulated truth itself is only good to double precision.
    slack = 1e-12 * np.maximum(np.abs(lo), np.abs(hi))
    outside = np.any((truth.x > trace.x_hi + slack) | (truth.x < trace.x_lo - slack), axis=1)
    valid = settled & (trace.status == 0)
    # After an alarm the framers restart from the ranges; they are promised again once `assured` is back.
    fresh = ~np.cumsum(np.any(truth.f != 0, axis=1)).astype(bool)
    lost = int(np.sum(outside & valid & (fresh | trace.assured)))
    raw = trace.raw_bits != 0
    return Outcome(scenario, truth, trace, differences, lost, int(np.sum(raw & valid)), settled,
                   episodes(truth.f, raw, tuple(s.name for s in plant.f), 3))


def validate(design, driver, names: list[str] | None = None, seed: int = 0,
             progress=lambda text: None) -> list[Outcome]:
    """Run scenarios on the compiled C and on the reference.

    Parameters
    ----------
    design : Design
    driver : Driver
        Of ``host.build``.
    names : list of str, optional
        Scenario names; all by default.
    seed : int
    progress : callable

    Returns
    -------
    list of Outcome
    """
    plant = design.plant
    out = []
    for scenario in plant.scenarios:
        if names and scenario.name not in names:
            continue
        progress(f'scenario "{scenario.name}"')
        truth = simulate(plant, scenario, seed=seed)
        trace = driver.run(u=truth.u, y=truth.y, q=truth.q)
        reference = design.observer.run(u=truth.u, y=truth.y, q=truth.q, real=driver.real)
        out.append(judge(plant, scenario, truth, trace, trace.differs(reference)))
    return out
