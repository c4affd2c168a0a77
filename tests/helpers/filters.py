"""The two examples of the H-infinity filter, from their data files."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path

import numpy as np
from flint import arb

from codegen.algebra.automaton import arbitrary
from codegen.certify.filter_model import joint_mode
from codegen.plant.load import loads
from codegen.selection.filter_tables import corners, floats
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


def hostile(d, q, seed: int, anywhere: bool = False):
    """u and y of a run without fault: unknown numbers at their ends, all else at the side that drives the last |f_hat|.

    Where bounds are not symmetric the driving values are cut to them, so that the run is possible.
    """
    plant, t, rng = d.plant, d.observer.tables["float64"], np.random.default_rng(seed)
    every = [[(c, joint_mode(c, t, p)) for c in corners(m)] for p, m in enumerate(plant.observed.modes)]
    chosen = [every[p][rng.integers(len(every[p]))] for p in q]
    sizes = [plant.n_w, plant.n_v, plant.n_u]
    row, sign = floats(chosen[-1][1].O)[seed % plant.n_f], []
    for k in reversed(range(len(q))):
        W = floats(chosen[k][1].W)
        sign.insert(0, np.where(row @ W > 0, 1, -1) if k < len(q) - 1 else rng.choice([-1, 1], W.shape[1]))
        row = row @ floats(chosen[k][1].J) if k < len(q) - 1 else row
    start = plant.limits("x") if anywhere else (plant.x0_lo, plant.x0_hi)
    x, u, y = np.where(row[:plant.n_x] > 0, start[1], start[0]), [], []
    for k, (m, _) in enumerate(chosen):
        w, v, now = np.split(sign[k][:sum(sizes)], np.cumsum(sizes)[:2])
        limits = (m.w_lo, m.w_hi), (m.v_lo, m.v_hi), plant.limits("u")
        w, v, now = (np.clip(s * np.maximum(-lo, hi), lo, hi) for s, (lo, hi) in zip((w, v, now), limits))
        u.append(now)
        y.append(m.C @ x + m.D @ now + m.Dw @ w + m.Dv @ v)
        x = m.A @ x + m.B @ now + m.Bw @ w
    return np.array(u), np.array(y)
