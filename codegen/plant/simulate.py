"""The true plant, simulated in float64: what the observers are tested against.

x+ = A x + B u + Bw w + Bf f,  y = C x + D u + Dw w + Dv v + Df f,  with the matrices of mode q[k] at theta[k]; of a
continuous plant x' in place of x+, integrated between the samples (``continuous``), where w and theta move too.
Polytopic plants are in ``descriptor``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from codegen.errors import PlantError
from codegen.plant import descriptor
from codegen.plant.continuous import BLOCK, PIECES, fine, transitions
from codegen.plant.descriptor_many import simulate_many
from codegen.plant.excitation import disturbances, faults, given_theta, initial_state, inputs, jumps, scheduling
from codegen.plant.messages import unknown
from codegen.plant.model import Array, Mode, Plant, PlantTrace, Scenario
from codegen.plant.record import Record, read_record


def simulate(
    plant: Plant, scenario: str | int | Scenario, seed: int = 0, theta: Array | None = None
) -> PlantTrace:
    """Run a scenario on the true plant, or read the record that it names.

    Parameters
    ----------
    plant : Plant
    scenario : str, int or Scenario
        A scenario of the plant by name or index, or one of your own.
    seed : int
        Of the random signals; the same seed gives the same run.
    theta : ndarray (K, n_theta), optional
        Scheduling parameters in place of the scenario's; of a continuous plant linear between its rows.

    Returns
    -------
    trace : PlantTrace
        K samples in float64. For a record x, w and v are NaN, and y is NaN where a sample is missing.

    Raises
    ------
    PlantError
        No such scenario; an expression has no value or leaves the declared limits; the CSV record is wrong.
    """
    chosen = _scenario(plant, scenario)
    place = f"{plant.name}: scenarios.{chosen.name}"
    try:
        record = read_record(chosen.csv, plant.folder) if chosen.csv else None
        if record is not None and record.has(plant.y):
            return _recorded(plant, chosen, record, theta)
        rng = np.random.default_rng(seed)
        if plant.polytope is not None:
            trace = descriptor.simulated(plant, chosen, record, theta, rng)
            return replace(trace, theta=reading(plant, chosen, trace.theta, rng))
        if plant.kind != "discrete":
            return _integrated(plant, chosen, record, theta, rng)
        return _simulated(plant, chosen, record, theta, rng)
    except PlantError as error:
        raise PlantError(f"{place}: {error}") from None


def simulate_all(plant: Plant, runs: Sequence[tuple[Scenario, int]]) -> list[PlantTrace]:
    """Run scenarios of one length without records, each with its seed, as `simulate` does one by one.

    Parameters
    ----------
    plant : Plant
    runs : sequence of (Scenario, int)

    Returns
    -------
    traces : list of PlantTrace

    Raises
    ------
    PlantError
        As `simulate`.
    """
    if plant.polytope is None or any(s.error for s in plant.theta):
        return [simulate(plant, scenario, seed=seed) for scenario, seed in runs]
    try:
        return simulate_many(plant, runs)
    except PlantError as error:
        raise PlantError(f"{plant.name}: scenarios.{runs[0][0].name}: {error}") from None


def draws(plant: Plant, vector: str) -> str:
    """Say how often w, v or theta is drawn: noise once a sample, the others on every piece that is simulated."""
    pieces = 1 if plant.kind == "discrete" else PIECES if plant.polytope is None else descriptor.PIECES
    return "at every sample" if vector == "v" or pieces == 1 else f"{pieces} times a sample"


def range_violations(plant: Plant, trace: PlantTrace) -> list[str]:
    """Return one line per state or output channel that leaves its declared range.

    Parameters
    ----------
    plant : Plant
    trace : PlantTrace

    Returns
    -------
    lines : list of str
        ``x.speed: 3.2 at sample 17 is outside [-3, 3]``, the first sample of each channel; empty when all
        is in
        range. Samples that are NaN do not count.
    """
    lines = []
    for vector, values in (("x", trace.x), ("y", trace.y)):
        lo, hi = plant.limits(vector)
        outside = (values < lo) | (values > hi)
        for j in np.flatnonzero(outside.any(axis=0)):
            k = int(np.argmax(outside[:, j]))
            signal = getattr(plant, vector)[j]
            lines.append(
                f"{vector}.{signal.name}: {values[k, j]:g} at sample {k} is outside [{signal.lo:g}, "
                f"{signal.hi:g}]"
            )
    return lines


def mode_signal(plant: Plant, scenario: Scenario, record: Record | None = None) -> Array:
    """Return the active mode of each sample, an int array (K,).

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    record : Record, optional
        Its mode column, if any, goes before the schedule.

    Returns
    -------
    q : ndarray (K,) int
    """
    if record is not None and "mode" in record.columns:
        return record.modes(tuple(mode.name for mode in plant.modes))[: scenario.steps]
    starts = np.array([sample for sample, _ in scenario.mode])
    modes = np.array([q for _, q in scenario.mode])
    return modes[np.searchsorted(starts, np.arange(scenario.steps), side="right") - 1]


def matrices_at(mode: Mode, theta: Array) -> dict[str, Array]:
    """Return the matrices of a mode at one value of theta, ``A(theta) = A + sum_j theta_j A_j``.

    Parameters
    ----------
    mode : Mode
    theta : ndarray (n_theta,)

    Returns
    -------
    matrices : dict
        "A", "B", ... -> ndarray.
    """
    names = ("A", "B", "C", "D", "Bw", "Dw", "Dv", "Bf", "Df")
    matrices = {name: getattr(mode, name) for name in names}
    for name, terms in mode.theta_terms.items():
        matrices[name] = matrices[name] + sum(value * term for value, term in zip(theta, terms))
    return matrices


def _scenario(plant: Plant, scenario: str | int | Scenario) -> Scenario:
    if isinstance(scenario, Scenario):
        return scenario
    names = [s.name for s in plant.scenarios]
    if isinstance(scenario, str):
        if scenario not in names:
            raise PlantError(f"{plant.name}: {unknown('scenario', scenario, names)}")
        return plant.scenarios[names.index(scenario)]
    if not 0 <= scenario < len(names):
        raise PlantError(
            f"{plant.name}: there is no scenario {scenario} (the plant has {len(names)}, counted from 0). "
            "Give an index in range, or a name."
        )
    return plant.scenarios[scenario]


def _simulated(
    plant: Plant, scenario: Scenario, record: Record | None, theta: Array | None, rng: np.random.Generator
) -> PlantTrace:
    steps = scenario.steps
    q = mode_signal(plant, scenario, record)
    u = inputs(plant, scenario, record)
    f = faults(plant, scenario, record)
    theta = scheduling(plant, scenario, rng, q) if theta is None else given_theta(plant, theta, steps)
    # Bounds of w and v per sample: they may differ by mode.
    limits = {
        name: np.array([getattr(plant.modes[i], name) for i in q])
        for name in ("w_lo", "w_hi", "v_lo", "v_hi")
    }
    w = disturbances(plant, scenario, "w", limits["w_lo"], limits["w_hi"], rng)
    v = disturbances(plant, scenario, "v", limits["v_lo"], limits["v_hi"], rng)
    x, y = np.empty((steps, plant.n_x)), np.empty((steps, plant.n_y))
    state = initial_state(plant, scenario, rng)
    for k in range(steps):
        m = matrices_at(plant.modes[q[k]], theta[k])
        x[k] = state
        y[k] = m["C"] @ state + m["D"] @ u[k] + m["Dv"] @ v[k] + m["Df"] @ f[k] + m["Dw"] @ w[k]
        state = m["A"] @ state + m["B"] @ u[k] + m["Bw"] @ w[k] + m["Bf"] @ f[k]
    return PlantTrace(x=x, u=u, y=y, q=told(plant, q, rng), theta=reading(plant, scenario, theta, rng), w=w, v=v, f=f)


def told(plant: Plant, q: Array, rng: np.random.Generator) -> Array:
    """Return the mode that the firmware is told: where that may be late, each switch at its sample or at the next.

    Every mode is told for a sample at least: after a switch that was told late a switch at once is late too.
    """
    if not plant.switching.late:
        return q
    out, behind = q.copy(), False
    for k in range(1, len(q)):
        behind = bool(q[k] != q[k - 1]) and (behind or bool(rng.integers(0, 2)))
        out[k] = q[k - 1] if behind else q[k]
    return out


def reading(plant: Plant, scenario: Scenario, theta: Array, rng: np.random.Generator) -> Array:
    """Return what the firmware reads of theta: the truth with the error of its measurement."""
    error = np.array([s.error for s in plant.theta])
    if not np.any(error):
        return theta
    sign = rng.uniform(-1.0, 1.0, theta.shape)
    return theta + error * (np.sign(sign) if scenario.theta == "corner" else sign)


def _integrated(
    plant: Plant, scenario: Scenario, record: Record | None, theta: Array | None, rng: np.random.Generator
) -> PlantTrace:
    """Run a continuous plant: mode, fault and (without a rate) input per sample, the rest on a finer grid."""
    steps, cut = scenario.steps, slice(None, None, PIECES)
    q, f = mode_signal(plant, scenario, record), faults(plant, scenario, record)
    dense_plant, dense = fine(plant, scenario)
    at = np.minimum(np.arange(dense.steps) // PIECES, steps - 1)
    between = q[at] if record is not None else mode_signal(plant, replace(dense, mode=tuple(
        (round(k * PIECES), i) for k, i in scenario.mode)))
    u = inputs(plant, scenario, record)
    held = np.array([s.rate == 0 for s in plant.u], dtype=bool)
    ramps = np.vstack([u, u[-1:]]) if len(plant.u) else np.empty((steps + 1, 0))
    if theta is None:
        theta = scheduling(dense_plant, dense, rng, between, PIECES)
    else:
        grid = np.arange(dense.steps) / PIECES
        theta = np.column_stack([np.interp(grid, np.arange(steps), c) for c in given_theta(plant, theta, steps).T]
                                or [np.empty((dense.steps, 0))])
    limits = {name: np.array([getattr(plant.modes[i], name) for i in q]) for name in ("v_lo", "v_hi")}
    limits |= {name: np.array([getattr(plant.modes[i], name) for i in between]) for name in ("w_lo", "w_hi")}
    w = disturbances(dense_plant, dense, "w", limits["w_lo"], limits["w_hi"], rng, PIECES)
    v = disturbances(plant, scenario, "v", limits["v_lo"], limits["v_hi"], rng)
    x, y = np.empty((steps, plant.n_x)), np.empty((steps, plant.n_y))
    state, h = initial_state(plant, scenario, rng), dense_plant.sample_period
    anew = jumps(plant, between, dense.steps)
    ends = [np.where(held, u[:, None], ramps[:-1, None] + ((np.arange(PIECES) + e) / PIECES)[:, None]
                     * np.diff(ramps, axis=0)[:, None]).reshape(-1, len(plant.u)) for e in (0, 1)]
    after = np.where(anew[1:, None], theta[:-1], theta[1:])
    for k in range(steps):
        if k % BLOCK == 0:
            now = slice(k * PIECES, min(k + BLOCK, steps) * PIECES)
            pieces = zip(*transitions(plant.modes, between[now], h, (theta[now], after[now]),
                                      tuple(v[now] for v in ends), w[now], np.repeat(f[k:k + BLOCK], PIECES, axis=0)))
        mode = plant.modes[q[k]]
        x[k] = state
        y[k] = mode.C @ state + mode.D @ u[k] + mode.Dw @ w[k * PIECES] + mode.Dv @ v[k] + mode.Df @ f[k]
        for Phi, c in islice(pieces, PIECES):
            state = Phi @ state + c
    return PlantTrace(x=x, u=u, y=y, q=told(plant, q, rng), theta=reading(plant, scenario, theta[:-1][cut], rng),
                      w=w[:-1][cut], v=v, f=f)


def _recorded(plant: Plant, scenario: Scenario, record: Record, theta: Array | None) -> PlantTrace:
    steps = scenario.steps
    empty = {
        name: np.full((steps, n), np.nan)
        for name, n in (("x", plant.n_x), ("w", plant.n_w), ("v", plant.n_v))
    }
    if plant.theta and theta is None and not any(s.measured for s in plant.theta) and not record.has(plant.theta):
        empty["theta"] = np.full((steps, len(plant.theta)), np.nan)  # nobody measures them: a record may go without
    elif plant.theta and theta is None:
        if not record.has(plant.theta):
            raise PlantError(f'{record.name}: has no column "{plant.theta[0].name}". Add it, or give theta.')
        theta = record.numbers(plant.theta)[:steps]
    if "theta" not in empty:
        empty["theta"] = given_theta(plant, np.empty((steps, 0)) if theta is None else theta, steps)
    return PlantTrace(
        u=inputs(plant, scenario, record),
        y=record.numbers(plant.y, gaps=True)[:steps],
        q=mode_signal(plant, scenario, record),
        f=faults(plant, scenario, record),
        **empty,
    )
