"""Two tanks with three level sensors, two of which may fail: banks of two or four vertices, made in seconds.

The valve between them is set from outside: measured, known but for an error, or open the more the fuller tank a is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from unittest import mock

from codegen.analysis.validate import side_by_side
from codegen.designs import read_design
from codegen.pipeline import design as made
from codegen.plant.load import loads
from codegen.plant.model import Fault
from codegen.plant.simulate import simulate
from codegen.selection import banks

DATA = Path(__file__).resolve().parents[1] / "data"
TEXT = """
format = 1
name = "tanks"
title = "Two tanks, which level sensor is at fault"
source = "own"

[time]
kind = "discrete"
sample_period = 0.1

[signals]
x = [{ name = "a", unit = "m", range = [-2, 2] }, { name = "b", unit = "m", range = [-2, 2] }]
u = [{ name = "inflow", range = [-1, 1] }]
y = [{ name = "ya", range = [-4, 4] }, { name = "yb", range = [-4, 4] }, { name = "both", range = [-6, 6] }]
w = [{ name = "leak", bounds = [-0.01, 0.01] }]
v = [{ name = "va", bounds = [-0.01, 0.01] }, { name = "vb", bounds = [-0.01, 0.01] },
     { name = "vc", bounds = [-0.01, 0.01] }]
f = [{ name = "a sensor", range = [-1, 1] }, { name = "b sensor", range = [-1, 1] }]
theta = [{ name = "valve", bounds = [0.2, 0.7] }]

[initial]
x_lo = [0, 0]
x_hi = [0, 0]

[common]
C = [[1, 0], [0, 1], [1, 1]]
Bw = [[1], [0.5]]
Dv = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
Df = [[1, 0], [0, 1], [0, 0]]

[nonlinear]
E = [[1, 0], [0, 1]]
f = ["0.8*a - 0.2*valve*a + 0.1*inflow", "0.2*valve*a + 0.7*b"]

[observer]
method = "bank"
average = 0.5
keep = 2.0

[[scenario]]
name = "one sensor, then the other"
steps = 300
u = ["sin(0.3*t)"]
fault = [{ channel = "a sensor", from = 60, to = 110, value = "0.5" },
         { channel = "b sensor", from = 200, to = 250, value = "-0.5" }]
"""
CONTINUOUS = (('kind = "discrete"', 'kind = "continuous"'),
              ('"0.8*a - 0.2*valve*a + 0.1*inflow"', '"inflow - 2*a - 2*valve*a"'),
              ('"0.2*valve*a + 0.7*b"', '"2*valve*a - 3*b"'))
STATE = (('theta = [{ name = "valve", bounds = [0.2, 0.7] }]\n', ""),
         ('"0.8*a - 0.2*valve*a + 0.1*inflow"', '"0.75*a - 0.02*a**3 + 0.1*inflow"'),
         ('"0.2*valve*a + 0.7*b"', '"0.05*a + 0.02*a**3 + 0.7*b"'))
#: Changes of the text.
PLANTS = {"measured": (), "continuous": CONTINUOUS, "state": STATE,
          "error": (("bounds = [0.2, 0.7] }", "bounds = [0.2, 0.7], error = 0.02 }"),)}


def text_of(name: str) -> str:
    """The plant file."""
    text = TEXT
    for old, new in PLANTS[name]:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


@lru_cache
def design(name: str):
    """Its runs without fault are shorter than those that a user gets."""
    with mock.patch.object(banks, "JUDGED", 100):
        return made(loads(text_of(name)), "bank")


@lru_cache
def frozen(name: str = "measured"):
    """"measured" or "state" as they were designed, kept for tests of what is not the design."""
    return read_design(DATA / f"tanks_{name}_bank.json")


def stimulus(plant, steps: int, seed: int, faults=()) -> tuple:
    """Inputs, outputs, modes, parameters of one run of the scenario; faults are (channel, from, to, value)."""
    own = replace(plant.scenarios[0], steps=steps, fault=tuple(Fault(*f) for f in faults))
    return side_by_side([simulate(plant, own, seed=seed)])
