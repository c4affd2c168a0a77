"""The committed bank, and runs of its plant with one sensor fault after the other."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

import codegen
from codegen.plant.descriptor_many import simulate_many
from codegen.plant.model import Fault

from .scripts import GENERATED

FOLDER = next(f for f in GENERATED if f.name == "dlpv_bank")
#: The shapes are printed (sine, step, ramp), sizes and times are not: samples, and the value.
FAULTS = ((600, 1400, "sin(2*pi*0.25*t)"), (1700, 2100, "1"), (2400, 3400, "0.1*(t - 24)"))


@lru_cache
def design():
    return codegen.read_design(FOLDER)


@lru_cache
def driver():
    return codegen.build(FOLDER)


def runs(faults, steps: int, seeds) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs (S, K, ..) of runs without end of the sine at the input; faults as (channel, from, to, value)."""
    plant = design().plant
    scenario = replace(plant.scenarios[0], steps=steps, fault=tuple(Fault(*f) for f in faults))
    truths = simulate_many(plant, [(scenario, seed) for seed in seeds])
    return np.array([r.u for r in truths]), np.array([r.y for r in truths])


@lru_cache
def printed_course() -> tuple[np.ndarray, np.ndarray]:
    """Six runs with a sine on sensor 1, a step on sensor 2, a ramp on sensor 3, one after the other."""
    return runs([(k, *f) for k, f in enumerate(FAULTS)], 3400, range(100, 106))


def shares(isolated: np.ndarray, faults=FAULTS) -> tuple[list[float], list[int]]:
    """Share of each fault's time in which it is named, and how many samples name another one then."""
    windows = [isolated[:, start:stop] for start, stop, _ in faults]
    return ([float((w == k).mean()) for k, w in enumerate(windows)],
            [int(((w != k) & (w >= 0)).sum()) for k, w in enumerate(windows)])
