"""A tracking law in the loop: the compiled C steers the true plant, held against its certificate at every sample.

Runs: references that jump from end to end of their ranges with disturbances anywhere and at their ends; signals that
drive each input as far as they can (``bad_signals``); from rest, the disturbance that the tracking error answers most;
from a corner of the initial box to rest; samples missing; and the faults of the plant file's scenarios. As long as no
fault acts and no sample is missing nothing may be cut, and states and inputs keep within what is certified.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..algebra.interval import sizes
from ..observers import PolytopicTrace
from ..observers.feedback import Tracker
from ..plant.excitation import faults
from ..plant.model import Plant, PlantTrace, Scenario
from .bad_signals import mean_loop, resonant, towards
from .closed_loop import ClosedLoop, Signals, closed_loop, drawn

Array = np.ndarray
LOOP, ENDS = "in the loop: ", "disturbances at their ends"
STEPS, FAR, LONG, PERIOD = 480, 160, 360, 240


@dataclass(frozen=True)
class Steering:
    """What a law did in one run, beside truth and trace.

    Parameters
    ----------
    ref : ndarray (K, k)
    limited : ndarray (K,)
    x_most : ndarray (n,), u_most : ndarray (m,)
        Certified magnitudes.
    figures : tuple of (str, float, float)
        What was found, and what is certified of it.
    broken : tuple of str
        Promises that were not kept.
    drawn : bool
        Whether the report has pictures of it.
    """

    ref: Array
    limited: Array
    x_most: Array
    u_most: Array
    figures: tuple[tuple[str, float, float], ...]
    broken: tuple[str, ...]
    drawn: bool = True


@dataclass(frozen=True)
class Steered:
    """One run: a scenario's name and length, what happened, whether C and reference agree."""

    scenario: Scenario
    truth: PlantTrace
    trace: PolytopicTrace
    differences: list[str]
    steering: Steering


@dataclass(frozen=True)
class Planned:
    """A run to come.

    ``kind`` says what is certified of it: "bounds" of quiet ones, of some also "energy" or "decay"; "faulty": nothing.
    """

    name: str
    ref: Array
    signals: Signals
    kind: str = "bounds"


def names(plant: Plant) -> list[str]:
    """Names of the runs, in their order.

    Parameters
    ----------
    plant : Plant
    """
    own = ["any disturbances", ENDS, *(f"towards the largest {s.name}" for s in plant.u),
           "from rest, the largest energy", "from the initial box to rest", "samples missing"]
    return [LOOP + name for name in (*own, *(s.name for s in plant.scenarios if s.fault))]


def planned(plant: Plant, t, seed: int = 0) -> list[Planned]:
    """All runs.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
        With a law.
    seed : int
    """
    mean, most = mean_loop(plant, t), t.law.reference

    def square(steps: int) -> Array:
        return np.where((np.arange(steps) // PERIOD) % 2 == 0, 1, -1)[:, None].astype(most.dtype) * most

    runs = [(square(STEPS), drawn(plant, STEPS, seed, "uniform")), (square(STEPS), drawn(plant, STEPS, seed, "corner")),
            *(towards(plant, t, mean, i, FAR) for i in range(plant.n_u)), resonant(plant, t, mean, LONG)]
    start = replace(drawn(plant, FAR, draw="none"), x0=drawn(plant, 1, seed, "corner").x0)
    runs += [(0 * square(FAR), start),
             (square(FAR), drawn(plant, FAR, seed, missing=np.arange(FAR) % 40 > 36))]
    for s in plant.scenarios:
        if s.fault:
            quiet = replace(s, csv="")
            runs.append((square(s.steps), drawn(plant, s.steps, seed, fault=faults(plant, quiet, None))))
    kinds = ["bounds"] * (2 + plant.n_u) + ["energy", "decay"] + ["faulty"] * len(runs)
    return [Planned(name, ref, signals, kind) for name, (ref, signals), kind in zip(names(plant), runs, kinds)]


def steered(design, driver, wanted: list[str], seed: int = 0, progress=lambda text: None) -> list[Steered]:
    """Run them on the compiled C, and what it was given on the reference.

    Parameters
    ----------
    design : Design
    driver : Driver
    wanted : list of str
        Names of runs.
    seed : int
    progress : callable

    Returns
    -------
    list of Steered
    """
    plant, cert, t = design.plant, design.certificate[driver.real], design.observer.tables[driver.real]
    runs, done = [run for run in planned(plant, t, seed) if run.name in wanted], []
    for run in runs:
        progress(run.name)
        done.append(closed_loop(plant, driver.tracker(), run.ref, run.signals))
    most, out = {name: np.array(cert["reached"][name]) for name in "xu"}, []
    for run, loop, (differences, z, s) in zip(runs, done, _replayed(design, driver.real, runs, done)):
        figures, broken = _held(plant, t, cert, run, loop, most, z, s)
        shown = bool(broken) or run.name == LOOP + ENDS or bool(run.signals.f.any())
        steering = Steering(run.ref, loop.limited, most["x"], most["u"], tuple(figures), tuple(broken), shown)
        out.append(Steered(Scenario(run.name, len(run.ref), ((0, 0),), ("0",) * plant.n_u), _truth(loop, plant),
                           loop.trace, differences, steering))
    return out


def _replayed(design, real: str, runs: list[Planned], done: list[ClosedLoop]) -> list[tuple[list[str], Array, Array]]:
    """In what the reference differs on the same references and measurements; its z and s before every sample."""
    unit = Tracker(type(design.observer)(design.observer.tables, design.observer.supervision), real, len(runs))
    most = max((len(run.ref) for run in runs), default=0)
    ref, y = (np.stack([np.concatenate([a, np.full((most - len(a), a.shape[1]), end)]) for a in columns])
              for columns, end in (([run.ref for run in runs], 0), ([loop.y for loop in done], np.nan)))
    commands, answers, z, s = [], [], [], []
    for k in range(most):
        z.append(unit.observer.z)
        s.append(unit.law.s)
        command, answer = unit.step(ref[:, k], y[:, k])
        commands.append(command)
        answers.append(answer)
    trace = PolytopicTrace(*(np.stack([getattr(a, name) for a in answers], axis=1)
                             for name in PolytopicTrace.__dataclass_fields__))
    u, limited, z, s = (np.stack(a, axis=1) for a in ([c.u for c in commands], [c.limited for c in commands], z, s))
    out = []
    for i, loop in enumerate(done):
        own = (i, slice(len(loop.y)))
        wrong = [name for name, said in (("u", u), ("limited", limited))
                 if not np.array_equal(said[own].astype(float), getattr(loop, name))]
        out.append((wrong + loop.trace.differs(trace.row(own)), z[own].astype(float), s[own].astype(float)))
    return out


def _held(plant: Plant, t, cert: dict, run: Planned, done: ClosedLoop, most: dict, z: Array, s: Array):
    """What a run reached of what is certified, and which promises it broke."""
    figures, broken = [], []
    if run.kind == "faulty":
        return figures, broken
    if done.limited.any():
        broken.append(f"an input or an integral was cut at {int(np.sum(done.limited != 0))} samples")
    for signals, values, bound in ((plant.x, done.x, most["x"]), (plant.u, done.u, most["u"])):
        share = np.abs(values).max(axis=0) / bound
        worst = int(np.argmax(share))
        figures.append((f"largest |{signals[worst].name}|", float(share[worst] * bound[worst]), float(bound[worst])))
        if share[worst] > 1:
            broken.append(f"{signals[worst].name} reached {share[worst] * bound[worst]:.6g}, certified is at most "
                          f"{bound[worst]:.6g}")
    if run.kind == "energy":
        found = _energy(plant, t, done)
        figures.append(("root of the energy of the tracking error over that of what disturbs", found, cert["level"]))
        broken += [f"the energy gain was {found:.6g}, certified is {cert['level']:.6g}"] * (found > cert["level"])
    if run.kind == "decay":
        factor = cert["loop"]["decay"]["factor"]
        found, slow = _decay(plant, cert, done, z, s)
        figures.append(("slowest decay per sample", found, factor))
        broken += [f"the loop did not shrink by {factor:.6g} at {slow} samples"] * (slow > 0)
    return figures, broken


def _energy(plant: Plant, t, done: ClosedLoop) -> float:
    """Root of the energy of the tracking error over that of disturbances and noises, in units of their sizes."""
    rows, d = list(t.law.rows), 0.0
    for name, values in (("w", done.signals.w.mean(axis=1)), ("v", done.signals.v)):
        d += np.sum((values / sizes(*plant.limits(name))) ** 2)
    return float(np.sqrt(np.sum((done.x @ plant.polytope.C[rows].T / t.law.reference) ** 2) / d))


def _decay(plant: Plant, cert: dict, done: ClosedLoop, z: Array, s: Array) -> tuple[float, int]:
    """Slowest factor of the norm of [T1 x - z; x; s] while it is above what sampling misses, and breaches."""
    T1, P = np.array(cert["T1"]), np.array(cert["loop"]["decay"]["P"])
    xi = np.concatenate([done.x @ T1.T - z, done.x, s], axis=1)
    norm = np.sqrt(np.einsum("ki,ij,kj->k", xi, P, xi))
    missed = np.array(cert["missed"])
    off = np.concatenate([np.abs(T1) @ missed, missed, np.zeros(s.shape[1])])
    room, factor = np.sqrt(off @ np.abs(P) @ off), cert["loop"]["decay"]["factor"]
    high = norm[:-1] > 10 * room
    return (float(np.max(norm[1:][high] / norm[:-1][high], initial=0.0)),
            int(np.sum(norm[1:] > factor * norm[:-1] + room)))


def _truth(done: ClosedLoop, plant: Plant) -> PlantTrace:
    steps = len(done.y)
    theta = np.zeros((steps, len(plant.theta)))
    return PlantTrace(x=done.x, u=done.u, y=done.y, q=np.zeros(steps, dtype=int), theta=theta,
                      w=done.signals.w[:, 0], v=done.signals.v, f=done.signals.f)
