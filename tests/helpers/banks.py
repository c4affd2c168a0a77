"""The bank of the thesis's example, frozen in tests/data, and runs of its plant with one sensor fault each.

Its weights need the libm, so that it has no folder in generated/.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import codegen
from codegen.plant.descriptor_many import simulate_many
from codegen.plant.model import Fault

DATA = Path(__file__).resolve().parents[1] / "data" / "dlpv_bank.json"
#: The shapes are printed (sine, step, ramp), sizes and times are not: samples, and the value.
FAULTS = ((50, 850, "sin(2*pi*0.25*(t - 0.5))"), (50, 450, "1"), (50, 1050, "0.1*(t - 0.5)"))


@lru_cache
def design():
    return codegen.read_design(DATA)


@lru_cache
def driver():
    scratch = Path(tempfile.mkdtemp(prefix="residua-bank-"))
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    return codegen.build(codegen.generate(design(), scratch / "dlpv"))


def runs(rows, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs, outputs (S, K, ..) and modes of runs: per row its seed and its faults (channel, from, to, value)."""
    base = replace(design().plant.scenarios[0], steps=steps)
    truths = simulate_many(design().plant, [(replace(base, fault=tuple(Fault(*f) for f in faults)), seed)
                                            for seed, faults in rows])
    return np.array([r.u for r in truths]), np.array([r.y for r in truths]), np.zeros((len(rows), steps), int)


@lru_cache
def one_fault_each() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Six runs: a sine on sensor 1, a step on sensor 2, a ramp on sensor 3, two seeds each."""
    return runs([(10 * k + seed, [(k, *f)]) for k, f in enumerate(FAULTS) for seed in range(2)], 1120)
