"""Does the compiled C do what the design promises? Every scenario of the plant file, judged sample by sample.

As long as no fault acts nothing may alarm and no state may leave its bounds. A fault spoils the framers; the
promise is in force again when they have restarted from the declared ranges after it, as the firmware does at the
first quiet sample after an alarm. A fault that raised no alarm leaves them spoilt: nothing is promised then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import PlantError
from ..observers import Trace
from ..observers.supervisor import BAD_INPUT, BAD_MODE, BAD_PARAMETER
from ..plant.model import Plant, PlantTrace, Scenario
from ..plant.simulate import simulate
from . import promised
from .mode_promise import dropped, keeps_the_true_mode, late, missed, unbound, understated, within_range
from .steering import Steering, steered
from .steering import names as names_of

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
        Samples with the promise in force at which a state was outside its bounds, or the true mode not among those
        called possible (records: not known, 0).
    false_alarms : int
        Samples with the promise in force at which an output was outside its bounds.
    settled : ndarray (K,) bool
        Where the promise is in force.
    episodes : list of Episode
    late : int
        Samples at which a mode was decided for that is certified to be ruled out by then; and faults after which modes
        were possible though none is certified to be.
    chance : int
        As ``false_alarms``, of thresholds that are calibrated and promise none.
    steering : Steering or None
        Of a run in which a tracking law steered the plant.
    """

    scenario: Scenario
    truth: PlantTrace
    trace: Trace
    differences: list[str]
    lost: int
    false_alarms: int
    settled: Array
    episodes: list[Episode]
    late: int = 0
    chance: int = 0
    steering: Steering | None = None

    @property
    def passed(self) -> bool:
        """C equals reference, nothing lost, no false alarm, no mode decided for too long, no law's promise broken."""
        kept = self.steering is None or not self.steering.broken
        return kept and not self.differences and self.lost == 0 and self.false_alarms == 0 and self.late == 0


def sound_samples(f: Array, trace: Trace, recover: int) -> Array:
    """Samples at which the framers are sound: no fault has touched them since they last started from a true box.

    Parameters
    ----------
    f : ndarray (K, n_f)
        The faults.
    trace : Trace
    recover : int
        Samples of alarm in a row after which the framers restart.

    Returns
    -------
    ndarray (K,) bool
    """
    active = np.any(f != 0, axis=1)
    raw, measured = trace.raw_bits != 0, ~np.isnan(trace.numbers()[-2]).any(axis=1)
    out = np.zeros(len(active), dtype=bool)
    sound, restarted, run = True, True, 0
    for k, now in enumerate(active):
        # The framers of sample k rest on samples k-1 and k, unless they restarted after sample k-1.
        sound = restarted or (sound and not now and not active[k - 1])
        out[k] = sound
        # As observers.supervisor.judge counts; a refused input, mode or parameter is answered by a reset.
        restarted = trace.status[k] in (BAD_MODE, BAD_INPUT, BAD_PARAMETER)
        if measured[k]:
            run, before = (run + 1 if raw[k] else 0), run
            restarted = run >= recover if raw[k] else before > 0
        run = 0 if restarted else run
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
    raw = trace.raw_bits != 0
    estimates = not trace.bounded  # nothing starts again while it sees a fault; it has no bounds of x
    sound = sound_samples(truth.f, trace, np.iinfo(int).max if estimates else plant.target.recover)
    settled = sound & ~np.any(truth.f != 0, axis=1)
    done = trace.status == 0
    found = episodes(truth.f, raw, tuple(s.name for s in plant.f), 3)
    if keeps_the_true_mode(trace):
        sound = settled  # such boxes are cut with every measurement, a faulty one too
    if estimates:
        return Outcome(scenario, truth, trace, differences, _beyond(plant, truth, trace), int(np.sum(
            raw & settled & done)), settled, found)
    lo, hi = plant.limits("x")
    # The simulated truth itself is only good to double precision.
    slack = 1e-12 * np.maximum(np.abs(lo), np.abs(hi))
    outside = np.any((truth.x > trace.x_hi + slack) | (truth.x < trace.x_lo - slack), axis=1) & ~unbound(truth, trace)
    outside |= dropped(plant.kind, truth, trace) | understated(plant.kind, truth, trace)
    return Outcome(scenario, truth, trace, differences, int(np.sum(outside & sound & done)),
                   int(np.sum(raw & settled & done)), settled, found)


def _beyond(plant: Plant, truth: PlantTrace, trace) -> int:
    """Assured samples at which an estimate of faults is further from what they do to y than its bound; 0 of others."""
    if not hasattr(trace, "x_hat") or trace.x_hat.shape[-1] == plant.n_x:
        return 0
    off = np.abs(trace.r - truth.f @ plant.polytope.Df.T) > trace.r_bound
    return int(np.sum(off.any(axis=1) & trace.assured & (trace.status == 0)))


def validate(design, driver, names: list[str] | None = None, seed: int = 0,
             progress=lambda text: None) -> list[Outcome]:
    """Run scenarios on the compiled C and on the reference; with a tracking law also in the loop with the true plant.

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

    Raises
    ------
    PlantError
        A scenario that the plant file does not have.
    """
    plant = design.plant
    law = getattr(next(iter(design.observer.tables.values())), "law", None)  # every number type has it
    loops = names_of(plant) if law is not None else []
    known = [s.name for s in plant.scenarios] + loops + promised.names(design)
    for name in names or ():
        if name not in known:
            raise PlantError(f'{plant.name}: scenario "{name}" (found), expected '
                             + (f"one of {', '.join(known)}." if known else "none: the plant file has no scenario."))
    scenarios = [s for s in plant.scenarios if not names or s.name in names]
    truths = []
    for scenario in scenarios:
        progress(f'scenario "{scenario.name}"')
        truths.append(simulate(plant, scenario, seed=seed))
    out = []
    if truths:
        progress(f"driving {len(truths)} scenarios, {max(len(t.q) for t in truths)} samples at most")
        out += judged(design, driver, scenarios, truths, design.certificate[driver.real])
    out += _steered(design, driver, loops, names, seed, progress)
    return out + _promised(design, driver, names, seed, progress)


def judged(design, driver, scenarios: list[Scenario], truths: list[PlantTrace], cert: dict,
           compared: bool = True) -> list[Outcome]:
    """Run the compiled C, and the reference beside it, and hold each run against a certificate.

    Parameters
    ----------
    design : Design
    driver : Driver
    scenarios : list of Scenario
    truths : list of PlantTrace
    cert : dict
    compared : bool
        False leaves the reference out.

    Returns
    -------
    list of Outcome
    """
    plant = design.plant
    u, y, q, theta = side_by_side(truths)
    traces = driver.run_many(u, y, q, theta=theta)
    references = design.observer.run_many(u, y, q, driver.real, theta=theta) if compared else traces
    out = []
    for i, (scenario, truth) in enumerate(zip(scenarios, truths)):
        own = (i, slice(len(truth.q)))
        trace = traces.row(own)
        outcome = judge(plant, scenario, truth, trace, trace.differs(references.row(own)))
        if not design.observer.supervision.assures and (cert["kind"] != "sliding" or "told" in cert):  # its alarms are
            outcome = replace(outcome, false_alarms=0, chance=outcome.false_alarms)
        if cert["kind"] == "mode":
            wrong = late(plant.kind, cert, truth, trace, outcome.settled)
            channels, inside = tuple(f.name for f in plant.f), within_range(plant, truth)
            wrong += missed(plant.kind, channels, cert, truth, trace, outcome.settled, inside)
            outcome = replace(outcome, late=wrong)
        out.append(outcome)
    return out


def _promised(design, driver, names: list[str] | None, seed: int, progress) -> list[Outcome]:
    """One outcome per promise of a fault: the run of it that was found last, with what went wrong in all of them."""
    out = []
    for name in promised.names(design):
        promise = promised.of(design.certificate[driver.real], name)
        if promise is None or names and name not in names:
            continue
        progress(f'scenario "{name}"')
        scenarios = promised.trials(design.plant, promise)
        truths = [simulate(design.plant, scenario, seed=seed) for scenario in scenarios]
        cert = design.certificate[driver.real] | {"faults": [promise]}
        runs = judged(design, driver, scenarios, truths, cert)
        worst = max(runs, key=lambda o: (not o.passed, *(np.inf if e.delay is None else e.delay for e in o.episodes)))
        counts = {name: sum(getattr(o, name) for o in runs) for name in ("lost", "false_alarms", "late")}
        out.append(replace(worst, **counts, differences=sorted({d for o in runs for d in o.differences})))
    return out


def _steered(design, driver, loops: list[str], names: list[str] | None, seed: int, progress) -> list[Outcome]:
    """The runs of a law in the loop with the plant, judged."""
    wanted = [name for name in loops if not names or name in names]
    out = []
    for run in steered(design, driver, wanted, seed, progress) if wanted else ():
        outcome = judge(design.plant, run.scenario, run.truth, run.trace, run.differences)
        out.append(replace(outcome, steering=run.steering))
    return out


def side_by_side(truths: list[PlantTrace]) -> tuple[Array, Array, Array, Array]:
    """Inputs, outputs, modes and parameters of runs of different lengths, for one call; missing samples at the end.

    Returns
    -------
    u : ndarray (S, K, n_u), y : ndarray (S, K, n_y), q : ndarray (S, K) int, theta : ndarray (S, K, n_theta)
    """
    steps = max(len(t.q) for t in truths)

    def padded(name: str, tail: float) -> Array:
        columns = [getattr(t, name) for t in truths]
        return np.stack([np.concatenate([c, np.full((steps - len(c), *c.shape[1:]), tail, c.dtype)]) for c in columns])

    return padded("u", 0.0), padded("y", np.nan), padded("q", 0), padded("theta", 0.0)
