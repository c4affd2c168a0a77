"""The mode-estimation example at any period and noise, and true courses whose switches fall inside samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from codegen.observers import ModeTables
from codegen.plant.load import gallery_folder, loads
from codegen.synthesis.mode_tables import tables_of

FILE = gallery_folder() / "zammali_modes.toml"
DWELL = 0.15  # s, as in the file


@lru_cache
def example(period: float, noise: float):
    plant = loads(FILE.read_text())
    bound = np.array([noise])
    modes = tuple(replace(m, v_lo=-bound, v_hi=bound) for m in plant.modes)
    return replace(plant, sample_period=period, modes=modes)


@lru_cache
def tables(period: float, noise: float, ages: int, real: str = "float64"):
    return tables_of(ModeTables, example(period, noise), ages, real)


@dataclass(frozen=True)
class Course:
    """x (K, n_x), u (K, n_u), y (K, n_y), q (K,) the mode at each sample; switches as (time, mode)."""

    x: np.ndarray
    u: np.ndarray
    y: np.ndarray
    q: np.ndarray
    switches: list


def course(plant, steps: int, seed: int) -> Course:
    """Random switching at any instant, disturbance at its bounds, also within a period, noise at its ends."""
    rng = np.random.default_rng(seed)
    T, n = plant.sample_period, plant.n_x
    mode, at, switches = int(rng.integers(plant.n_modes)), 0.0, []
    while at < steps * T:
        at += DWELL * (1.0 if rng.random() < 0.5 else rng.uniform(1.0, 1.8)) + 1e-9
        mode = int(rng.choice([q for q in range(plant.n_modes) if q != (switches[-1][1] if switches else mode)]))
        switches.append((at, mode))
    begin = next(q for q in range(plant.n_modes) if q != switches[0][1])
    times, order = np.array([s for s, _ in switches]), [begin, *(q for _, q in switches)]
    u = np.tile(plant.limits("u")[0], (steps, 1))
    x, w = np.zeros(n), rng.choice([-1, 1], n)
    out = {"x": [], "y": [], "q": []}
    hold = rng.choice([0.0, 0.5, 0.98])  # noise that jumps, and noise that stays at one end
    v = 1.0
    for k in range(steps):
        v = v if rng.random() < hold else rng.choice([-1.0, 1.0])
        m = plant.modes[order[int(np.searchsorted(times, k * T, side="right"))]]
        out["x"].append(x.copy())
        out["y"].append(m.C @ x + v * m.v_hi)
        out["q"].append(plant.modes.index(m))
        inside = times[(times > k * T) & (times < (k + 1) * T)]
        cuts = np.concatenate([[k * T], np.sort(np.concatenate([inside, (k + rng.random(1)) * T])), [(k + 1) * T]])
        for a, b in zip(cuts, cuts[1:]):
            m = plant.modes[order[int(np.searchsorted(times, (a + b) / 2, side="right"))]]
            w = w if rng.random() < 0.8 else rng.choice([-1, 1], n)
            M = np.zeros((n + 1, n + 1))
            M[:n, :n], M[:n, n] = m.A, m.B @ u[k] + m.Bw @ (w * m.w_hi)
            x = (expm(M * (b - a)) @ np.append(x, 1.0))[:n]
    return Course(np.array(out["x"]), u, np.array(out["y"]), np.array(out["q"]), switches)
