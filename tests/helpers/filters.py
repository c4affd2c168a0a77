"""The two examples of the H-infinity filter, from their data files."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path

import numpy as np
from flint import arb

from codegen.algebra.automaton import arbitrary
from codegen.plant.load import loads
from codegen.synthesis.hinf_cover import covered_mode
from codegen.synthesis.hinf_problem import FilterProblem, problem_of
from codegen.synthesis.hinf_weights import Weight, weight, weighted

DATA = Path(__file__).parents[1] / "data"


@lru_cache
def farhat(uncertain: bool = True, weights: bool = False) -> FilterProblem:
    """The example of the slides, through the plant file."""
    text = (DATA / "farhat.toml").read_text()
    plant = loads(text)
    problem = problem_of(plant)
    if weights:
        options = plant.options
        problem = weighted(problem, weight(**options["target"]), weight(**options["colour"]))
    return problem if uncertain else problem.nominal


def vehicle_data() -> dict:
    return tomllib.loads((DATA / "vehicle.toml").read_text())


def bicycle(p: dict) -> tuple[list, list]:
    """Coefficients of s = 1/v: [sideslip; yaw rate]' and lateral acceleration, of [x; steering; wind]."""
    moment = p["cr"] * p["lr"] - p["cf"] * p["lf"]
    stiff, turn = p["cf"] + p["cr"], p["cf"] * p["lf"] ** 2 + p["cr"] * p["lr"] ** 2
    m, Iz = p["m"], p["Iz"]
    motion = [[[0, -1, 0, 0], [moment / Iz, 0, p["cf"] * p["lf"] / Iz, p["lw"] / Iz]],
              [[-stiff / m, 0, p["cf"] / m, 1 / m], [0, -turn / Iz, 0, 0]],
              [[0, moment / m, 0, 0], [0, 0, 0, 0]]]
    outputs = [[[-stiff / m, 0, p["cf"] / m, 1 / m]], [[0, moment / m, 0, 0]]]
    return [np.array(M) for M in motion], [np.array(M) for M in outputs]


def low_pass(hertz: float, period: float) -> Weight:
    a = float(np.exp(-2 * np.pi * hertz * period))
    return weight([1 - a], [1, -a])


def vehicle(measured: str = "both", speeds=None, data: dict | None = None) -> FilterProblem:
    """The steering-fault filter; ``measured`` is "steering_unknown" or "a_y" (one output) or "both"."""
    data = data or vehicle_data()
    f = data["filter"]
    speeds = [float(v) for v in (f["speeds"] if speeds is None else speeds)]
    n_d = 5  # steering, wind, both noises, fault
    V = np.zeros((2, n_d))
    V[0, 0], V[1, 1], V[0, 4] = f["steering"], f["wind"], f["fault"]
    F = np.zeros((1, n_d))
    F[0, 2] = f["a_y"]
    rows = {"steering_unknown": [], "a_y": [([0, 0], [1, 0, 0, 0, 0])],
            "both": [([0, 1 / f["x_size"][1]], [0, 0, 0, f["yaw_rate"] / f["x_size"][1], 0]),
                     ([0, 0], [1, 0, 0, 0, 0])]}[measured]
    extra = (np.array([r[0] for r in rows], dtype=float).reshape(-1, 2),
             np.array([r[1] for r in rows], dtype=float).reshape(-1, n_d))
    motion, outputs = bicycle(data["vehicle"])
    modes = tuple(covered_mode(motion, outputs, f["sample_period"], (arb(1) / b, arb(1) / a), V, F, extra, 1,
                               np.array(f["x_size"])) for a, b in zip(speeds, speeds[1:]))
    names = tuple(f"{a:.3g} to {b:.3g} m/s" for a, b in zip(speeds, speeds[1:]))
    problem = FilterProblem(names, modes, arbitrary(len(modes)), 2)
    return weighted(problem, low_pass(f["target"], f["sample_period"]))
