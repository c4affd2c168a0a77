"""The signals that a scenario puts on the plant, each checked against its limits."""

from __future__ import annotations

import numpy as np

from codegen.errors import PlantError
from codegen.plant.expression import ExpressionError, sampled
from codegen.plant.model import Array, Plant, Scenario, Signal
from codegen.plant.record import Record

# A bound that an expression such as 0.3*sin(k) touches must not count as left for a rounding error.
_SLACK = 1e-12


def inputs(plant: Plant, scenario: Scenario, record: Record | None) -> Array:
    """Return the inputs u (K, n_u), of the record or of the scenario's expressions.

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    record : Record or None
        The scenario's CSV file, read.

    Returns
    -------
    u : ndarray (K, n_u)

    Raises
    ------
    PlantError
        An expression has no value, leaves the declared range or is faster than the rate.
    """
    if record is not None and record.has(plant.u):
        u = record.numbers(plant.u)[: scenario.steps]
    else:
        u = _evaluated(plant, scenario, "u", scenario.u)
    if plant.kind == "continuous":  # an input without a rate is held, and may jump at a sample
        step = np.array([s.rate * plant.sample_period if s.rate > 0 else np.inf for s in plant.u])
        _check_rate("u", plant.u, u, np.broadcast_to(step, u.shape))
    return _within("u", plant.u, u, *plant.limits("u"))


def faults(plant: Plant, scenario: Scenario, record: Record | None) -> Array:
    """Return the faults f (K, n_f): the record's label columns and the scenario's faults, added.

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    record : Record or None
        The scenario's CSV file, read.

    Returns
    -------
    f : ndarray (K, n_f)

    Raises
    ------
    PlantError
        An expression has no value, or a value other than zero leaves the declared range.
    """
    f = np.zeros((scenario.steps, plant.n_f))
    if record is not None:
        for j, signal in enumerate(plant.f):
            if signal.name in record.columns:
                f[:, j] = record.numbers((signal,))[: scenario.steps, 0]
    for fault in scenario.fault:
        window = slice(fault.start, fault.stop)
        place = f"fault.{plant.f[fault.channel].name}"
        f[window, fault.channel] += _values(plant, place, fault.value, np.arange(fault.start, fault.stop))
    lo, hi = plant.limits("f")
    quiet = f == 0  # no fault need not lie in the range of the faults
    return np.where(quiet, 0.0, _within("fault", plant.f, np.where(quiet, np.clip(0.0, lo, hi), f), lo, hi))


def disturbances(
    plant: Plant, scenario: Scenario, vector: str, lo: Array, hi: Array, rng: np.random.Generator, pieces: int = 1
) -> Array:
    """Return w, v or theta (K, n) as the scenario asks: "uniform", "corner" or expressions.

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    vector : {"w", "v", "theta"}
    lo, hi : ndarray (K, n)
        Bounds at each sample.
    rng : Generator
    pieces : int
        Rows per sample, where the plant is on a finer grid than its samples.

    Returns
    -------
    values : ndarray (K, n)

    Raises
    ------
    PlantError
        An expression has no value, or leaves the bounds.
    """
    wish = getattr(scenario, vector)
    if wish == "uniform":
        return rng.uniform(lo, hi)
    if wish == "corner":
        return _corner(lo, hi, rng)
    return _within(vector, getattr(plant, vector), _evaluated(plant, scenario, vector, wish, pieces), lo, hi)


def scheduling(
    plant: Plant, scenario: Scenario, rng: np.random.Generator, q: Array | None = None, pieces: int = 1
) -> Array:
    """Return theta (K, n_theta) inside its bounds and no faster than its rates.

    Where modes have bounds of their own, each mode has its own parameters: theta may jump at a switch.

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    rng : Generator
        numpy random generator.
    q : ndarray (K,) int, optional
        Modes, where these have bounds of their own.
    pieces : int
        Rows per sample, where the plant is on a finer grid than its samples.

    Returns
    -------
    theta : ndarray (K, n_theta)

    Raises
    ------
    PlantError
        An expression has no value, leaves the bounds or is faster than the rate.
    """
    shape = (scenario.steps, len(plant.theta))
    boxes = [plant.theta_box(mode) for mode in plant.modes] or [plant.limits("theta")]
    lo, hi = (np.broadcast_to(np.array([b[i] for b in boxes])[0 if q is None else q], shape) for i in (0, 1))
    theta = disturbances(plant, scenario, "theta", lo, hi, rng, pieces)
    step = np.tile([s.rate * plant.sample_period for s in plant.theta], (scenario.steps, 1))
    step[jumps(plant, q, scenario.steps)] = np.inf
    if not isinstance(scenario.theta, str):
        _check_rate("theta", plant.theta, theta, step)
        return theta
    for k in range(1, len(theta)):  # random values, reached no faster than the rate allows
        theta[k] = theta[k - 1] + np.clip(theta[k] - theta[k - 1], -step[k], step[k])
    return theta


def jumps(plant: Plant, q: Array | None, steps: int) -> Array:
    """Return the rows at which theta may jump (K,): switches, where modes have bounds of their own."""
    if q is None or all(mode.theta_bounds is None for mode in plant.modes):
        return np.zeros(steps, dtype=bool)
    return np.diff(q, prepend=q[:1]) != 0


def given_theta(plant: Plant, theta: Array, steps: int) -> Array:
    """Return a caller's theta, checked for its shape (K, n_theta) and bounds.

    Parameters
    ----------
    plant : Plant
    theta : ndarray (K, n_theta)
    steps : int
        K.

    Returns
    -------
    theta : ndarray (K, n_theta)
        float64.

    Raises
    ------
    PlantError
        Wrong shape, or outside the bounds.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (steps, len(plant.theta)):
        raise PlantError(
            f"theta is {theta.shape}, expected {(steps, len(plant.theta))} (samples, parameters). Correct it."
        )
    return _within("theta", plant.theta, theta, *plant.limits("theta"))


def initial_state(plant: Plant, scenario: Scenario, rng: np.random.Generator) -> Array:
    """Return x at sample 0: a corner of the initial box where w or v is "corner", else inside it.

    Parameters
    ----------
    plant : Plant
    scenario : Scenario
    rng : Generator
        numpy random generator.

    Returns
    -------
    x0 : ndarray (n_x,)
    """
    if "corner" in (scenario.w, scenario.v):
        return _corner(plant.x0_lo, plant.x0_hi, rng)
    return rng.uniform(plant.x0_lo, plant.x0_hi)


def _corner(lo: Array, hi: Array, rng: np.random.Generator) -> Array:
    return np.where(rng.integers(0, 2, size=lo.shape) == 1, hi, lo)


def _check_rate(vector: str, signals: tuple[Signal, ...], values: Array, step: Array) -> None:
    change = np.abs(np.diff(values, axis=0))
    for k, j in np.argwhere(change > step[1:] * (1 + 1e-9))[:1]:
        raise PlantError(
            f"{vector}.{signals[j].name}: changes by {change[k, j]:g} at sample {k + 1} (expected at most "
            f"{step[k + 1, j]:g}, its rate times the sample period). Slow it down, or raise the rate."
        )


def _evaluated(plant: Plant, scenario: Scenario, vector: str, texts: tuple[str, ...], pieces: int = 1) -> Array:
    k = np.arange(scenario.steps)
    columns = [
        _values(plant, f"{vector}.{signal.name}", text, k, pieces)
        for signal, text in zip(getattr(plant, vector), texts)
    ]
    return np.stack(columns, axis=1) if columns else np.empty((scenario.steps, 0))


def _values(plant: Plant, place: str, text: str, k: Array, pieces: int = 1) -> Array:
    try:
        values = sampled(text, plant.constants, k / pieces, k * plant.sample_period)
    except ExpressionError as error:
        raise PlantError(f"{place}: {error}.") from None
    if not np.isfinite(values).all():
        bad = k[np.argmin(np.isfinite(values))]
        raise PlantError(f'{place}: "{text}" has no finite value at sample {bad}. Correct the expression.')
    return values


def _within(vector: str, signals: tuple[Signal, ...], values: Array, lo: Array, hi: Array) -> Array:
    """Refuse the first value outside its limits, (n,) or where they follow the mode (K, n); clip the rest.

    A value outside by a rounding error alone is meant to be the bound, and becomes it: the containment
    that is
    tested holds for values inside the bounds, not 1e-16 beside them.
    """
    lo, hi = np.broadcast_to(lo, values.shape), np.broadcast_to(hi, values.shape)
    inside = (values >= lo - _SLACK * np.abs(lo)) & (values <= hi + _SLACK * np.abs(hi))
    for k, j in np.argwhere(~inside)[:1]:
        raise PlantError(
            f"{vector}.{signals[j].name}: is {values[k, j]:g} at sample {k} (expected inside "
            f"[{lo[k, j]:g}, {hi[k, j]:g}]). Reduce the signal, or widen the limits."
        )
    return np.clip(values, lo, hi)
