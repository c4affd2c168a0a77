"""How soon a mode estimator without a guarantee is right, and how often wrong: simulated over noise and period.

Random switches at any instant, at least a dwell time apart and at most two and a half; disturbances at their bounds,
changing at one sample in five; inputs at an end of their range, changing with the mode; uniform noise; parameters
anywhere, the same all through a run, their measurements off by uniform errors. A delay lasts from a switch to the
sample from which on the mode is right until the next switch. These are figures, no promises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from ..errors import DesignError

Array = np.ndarray
PERIODS = (0.5, 1.0, 2.0, 4.0)  # of the plant's
NOISES = (0.0, 1.0, 5.0, 25.0)  # of the declared bounds
PACES = (1.0, 2.0, 4.0)  # of the plant's dwell time
RUNS, DWELLS, SEED = 16, 6, 1


@dataclass(frozen=True)
class Course:
    """Runs side by side: x (S, K, n_x), u (S, K, n_u), y (S, K, n_y), of it the noise, q (S, K), theta (S, K, J) as it
    is read; switches per run as (time, mode).
    """

    x: Array
    u: Array
    y: Array
    noise: Array
    q: Array
    theta: Array
    switches: list


def scaled(plant, period: float, noise: float):
    """The same plant at another period and with other noise, as shares of its own."""
    modes = tuple(replace(m, v_lo=m.v_lo * noise, v_hi=m.v_hi * noise) for m in plant.modes)
    return replace(plant, sample_period=plant.sample_period * period, modes=modes)


def courses(plant, runs: int, steps: int, seed: int) -> Course:
    """Simulate; every piece between two instants exactly.

    Parameters
    ----------
    plant : Plant
        Continuous.
    runs, steps, seed : int

    Returns
    -------
    Course
    """
    T, dwell, N = plant.sample_period, plant.switching.average_dwell, plant.n_modes
    made: list = [[], [], [], [], [], [], []]
    for run in range(runs):
        rng = np.random.default_rng((seed, run))
        q, due = int(rng.integers(N)), dwell * rng.uniform(1, 2.5)
        x, u = rng.uniform(plant.x0_lo, plant.x0_hi), _corner(rng, *plant.limits("u"))
        w = _corner(rng, plant.modes[q].w_lo, plant.modes[q].w_hi)
        modes, read = _held(plant, rng, steps)
        whole = [_transition(m, T) for m in modes]
        rows: list = [[], [], [], [], []]
        switches = []
        for k in range(steps):
            m = modes[q]
            noise = m.Dv @ rng.uniform(m.v_lo, m.v_hi)
            for row, value in zip(rows, (x, u, m.C @ x + m.D @ u + noise, noise, q)):
                row.append(value)
            now, fed = k * T, u
            while due < (k + 1) * T:
                x = _transition(modes[q], due - now) @ np.concatenate([x, fed, w])
                q, now = int(rng.choice([i for i in range(N) if i != q])), due
                switches.append((due, q))
                due += dwell * rng.uniform(1, 2.5)
                u = _corner(rng, *plant.limits("u"))  # from the next sample on
                w = _corner(rng, plant.modes[q].w_lo, plant.modes[q].w_hi)
            left = whole[q] if now == k * T else _transition(modes[q], (k + 1) * T - now)
            x = left @ np.concatenate([x, fed, w])
            if rng.random() < 0.2:
                w = _corner(rng, plant.modes[q].w_lo, plant.modes[q].w_hi)
        for part, value in zip(made, (*map(np.array, rows), read[np.arange(steps), rows[-1]], switches)):
            part.append(value)
    x, u, y, noise, q, theta = (np.array(part) for part in made[:6])
    return Course(x, u.reshape(runs, steps, plant.n_u), y, noise, q, theta, made[6])


def _held(plant, rng, steps: int) -> tuple[list, Array]:
    """Modes whose parameters keep some value, and what is read of it at every sample in every mode: (K, N, J)."""
    if not plant.theta:
        return list(plant.modes), np.zeros((steps, plant.n_modes, 0))
    share, error = rng.random(len(plant.theta)), np.array([s.error for s in plant.theta])
    values = [lo + share * (hi - lo) for lo, hi in map(plant.theta_box, plant.modes)]
    off = error * rng.uniform(-1, 1, (steps, plant.n_modes, len(error)))
    return [_at(m, value) for m, value in zip(plant.modes, values)], np.array(values) + off


def _at(mode, theta: Array):
    """The mode with its parameters at a value."""
    moved = {name: getattr(mode, name) + sum((p * S for p, S in zip(theta, mode.theta_terms.get(name, ()))),
                                             0 * getattr(mode, name)) for name in "AB"}
    return replace(mode, **moved, theta_terms={}, theta_bounds=None)


def _corner(rng, lo: Array, hi: Array) -> Array:
    return np.where(rng.random(len(lo)) < 0.5, lo, hi)


def _transition(m, t: float) -> Array:
    """What [x; u; w] make of x in a time t."""
    parts = np.hstack([m.A, m.B, m.Bw])
    return expm(np.vstack([parts, np.zeros((parts.shape[1] - len(parts), parts.shape[1]))]) * t)[:len(parts)]


def delays(mode: Array, q: Array, switches: list, period: float) -> list[float]:
    """Delay of each switch that the next one leaves time to judge; infinite where the mode was never right.

    Parameters
    ----------
    mode, q : ndarray (K,)
        Decided and true mode.
    switches : list
        (time, mode).
    period : float
        Seconds.
    """
    ends = [int(np.ceil(t / period - 1e-9)) for t, _ in switches]
    out = []
    for (time, _), begin, end in zip(switches, ends, ends[1:]):
        wrong = np.flatnonzero(mode[begin:end] != q[begin:end])
        first = begin + (wrong[-1] + 1 if len(wrong) else 0)
        out.append(float(first * period - time) if first < end else np.inf)
    return out


def measured(plant, family: type, supervision, tables_for: Callable) -> list[dict]:
    """Run the reference over periods and noises.

    Parameters
    ----------
    plant : Plant
    family : type
        Of ``observers``.
    supervision : Supervision
    tables_for : callable
        Plant -> tables of the same design at its period and noise; DesignError where there are none.

    Returns
    -------
    list of dict
        "period" in s, "noise" as a share of the declared; "switches", "median" and "longest" delay in s (None: a mode
        was not found before the next switch), "missed", "wrong" share of samples with a wrong mode.
    """
    silent = all(not np.any(m.v_lo) and not np.any(m.v_hi) for m in plant.modes)
    cells = []
    for share in PERIODS:
        near = scaled(plant, share, 1.0)
        run = courses(near, RUNS, int(DWELLS * plant.switching.average_dwell / near.sample_period), SEED)
        for noise in NOISES[:1] if silent else NOISES:
            own = scaled(plant, share, noise)
            try:
                t = tables_for(own)
            except DesignError:
                continue
            y = np.clip(run.y + (noise - 1) * run.noise, t.y_lo, t.y_hi)
            trace = family({t.real: t}, supervision).run_many(run.u, y, run.q, t.real)
            cells.append({"period": own.sample_period, "noise": noise} | figures(trace, run, own.sample_period))
    return cells


def figures(trace, run: Course, period: float) -> dict:
    """Delays and share of wrong decisions of runs."""
    found = [d for mode, q, switches in zip(trace.mode, run.q, run.switches)
             for d in delays(mode, q, switches, period)]
    kept = [d for d in found if np.isfinite(d)]
    return {"switches": len(found), "missed": len(found) - len(kept), "median": rounded(np.median(found)),
            "longest": rounded(max(found)), "wrong": rounded(np.mean(trace.mode != run.q))}


def paced(plant, observer, real: str) -> list[dict]:
    """Run an observer with alarms over dwell times, without a fault: every alarm is a false one.

    Parameters
    ----------
    plant : Plant
    observer : GuidedObserver
    real : {"float32", "float64"}

    Returns
    -------
    list of dict
        "dwell" in s, the least between two switches; as of ``measured``; "alarms" share of samples with an alarm,
        "lost" share of samples at which a bound does not hold x.
    """
    cells, t, period = [], observer.tables[real], plant.sample_period
    for share in PACES:
        dwell = plant.switching.average_dwell * share
        slow = replace(plant, switching=replace(plant.switching, average_dwell=dwell))
        run = courses(slow, RUNS, int(DWELLS * dwell / period), SEED)
        trace = observer.run_many(run.u, np.clip(run.y, t.y_lo, t.y_hi), run.q, real, theta=run.theta)
        lost = ((run.x < trace.x_lo) | (run.x > trace.x_hi)).any(axis=-1)
        cells.append({"dwell": rounded(dwell)} | figures(trace, run, period)
                     | {"alarms": rounded(np.mean(trace.alarm != 0)), "lost": rounded(np.mean(lost))})
    return cells


def rounded(value: float) -> float | None:
    """Four digits; None where there is no number."""
    return float(f"{value:.4g}") if np.isfinite(value) else None
