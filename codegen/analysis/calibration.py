"""Thresholds calibrated by fault-free runs: which runs are drawn, and how many of them.

A calibrated threshold is a statement about runs like those drawn (``order_statistics``), never about all that the
bounds admit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import CertificateError, PlantError
from ..plant.model import Plant, PlantTrace, Scenario
from ..plant.simulate import draws, simulate_all
from .order_statistics import Calibration, calibrate, confidence, runs_needed
from .validate import side_by_side

Array = np.ndarray
#: A mode that has no dwell time lasts so many samples on average.
STAY = 20


@dataclass(frozen=True)
class Population:
    """Fault-free runs of a plant that are drawn at random: what a calibration speaks of.

    Parameters
    ----------
    steps : int
    w, v, theta : {"uniform", "corner"}
        Independent at every draw (``draws``); theta as fast as its rates allow.
    modes : {"random", "scenario"}
        Modes of random order and length (the dwell time and STAY beyond it on average), or those of the scenario drawn.
    gap, bridge : int
        Measured samples that pay for a lost one, and lost ones that they pay for at most: see ``losses``.
    """

    steps: int = 200
    w: str = "uniform"
    v: str = "uniform"
    theta: str = "uniform"
    modes: str = "random"
    gap: int = 0
    bridge: int = 0

    def words(self, plant: Plant) -> tuple[str, ...]:
        """What the runs have in common."""
        drawn = {"uniform": "uniform within their bounds", "corner": "at ends of their bounds"}
        of = {"w": ("disturbances", plant.n_w), "v": ("noises", plant.n_v), "theta": ("parameters", len(plant.theta))}
        told = [f"{of[name][0]} {drawn[getattr(self, name)]}, drawn anew {draws(plant, name)}"
                for name in of if of[name][1]]
        modes = {"random": "modes in random order that keep to the declared switching", "scenario": "modes as in the "
                 "scenarios of the plant file"}
        told += [modes[self.modes]] * (plant.n_modes > 1)
        told += ["inputs as in the scenarios of the plant file"] * bool(plant.u)
        lost = f"1 to {self.bridge} measurements in succession missing now and then, each paid for by {self.gap} others"
        lost = lost if self.bridge else "no measurement missing"
        return (f"{self.steps} samples from the initial box", *told, lost)


def pattern(plant: Plant, steps: int, rng: np.random.Generator) -> tuple[tuple[int, int], ...]:
    """A random mode sequence that keeps to the declared switching, as (sample, mode) pairs.

    Parameters
    ----------
    plant : Plant
    steps : int
    rng : Generator

    Returns
    -------
    tuple of (int, int)
    """
    s, count = plant.switching, max(plant.n_modes, 1)
    if s.schedule:
        turn = [s.schedule[k % len(s.schedule)] for k in range(steps)]
        return tuple((k, q) for k, q in enumerate(turn) if k == 0 or q != turn[k - 1])
    least = 1 if s.average_dwell is None else int(np.ceil(s.average_dwell / plant.sample_period - 1e-9))
    out, at, q = [], 0, int(rng.integers(count))
    while at < steps:
        out.append((at, q))
        at += steps if count == 1 else max(least, 1) + int(rng.geometric(1 / STAY)) - 1
        q = (q + int(rng.integers(1, max(count, 2)))) % count
    return tuple(out)


def losses(population: Population, runs: int, seed: int = 0) -> Array:
    """Samples that are lost in random runs (N, K) bool: bursts of 1 to ``bridge``, soon after they are paid for.

    Each measured sample adds one to a credit of at most ``gap bridge``, a lost one takes ``gap``. A burst of random
    length comes up to two gaps after the credit pays for it, so that most of what may be lost is lost.

    Parameters
    ----------
    population : Population
    runs : int
    seed : int
    """
    out = np.zeros((runs, population.steps), dtype=bool)
    gap, bridge = population.gap, population.bridge
    for row, child in zip(out, np.random.SeedSequence(seed).spawn(runs)):
        rng, at, credit = np.random.default_rng(child), 0, 0
        while bridge and at < population.steps:
            burst = int(rng.integers(1, bridge + 1))
            wait = max(burst * gap - credit, 0) + int(rng.integers(2 * gap + 1))
            row[at + wait:at + wait + burst] = True
            at, credit = at + wait + burst, min(credit + wait, gap * bridge) - burst * gap
    return out


def drawn(plant: Plant, population: Population, runs: int, seed: int = 0) -> list[tuple[Scenario, int]]:
    """Draw independent runs without fault: the scenario of each, and the seed of its signals.

    Parameters
    ----------
    plant : Plant
    population : Population
    runs : int
    seed : int

    Returns
    -------
    list of (Scenario, int)

    Raises
    ------
    PlantError
        The plant has inputs and no scenario that says what they do, or a scenario does not go on for so long.
    """
    base = [s for s in plant.scenarios if not s.csv]
    if not base and (plant.n_u or population.modes == "scenario"):
        raise PlantError(f"{plant.name}: no scenario without a record (found), expected one that says what the inputs "
                         "do in a campaign. Add a [[scenario]].")
    base = base or [Scenario("runs without fault", population.steps, ((0, 0),), ())]
    out = []
    for child in np.random.SeedSequence(seed).spawn(runs):
        rng = np.random.default_rng(child)
        own = base[int(rng.integers(len(base)))]
        mode = own.mode if population.modes == "scenario" else pattern(plant, population.steps, rng)
        asked = replace(own, name="runs without fault", steps=population.steps, mode=mode, w=population.w,
                        v=population.v, theta=population.theta, fault=())
        out.append((asked, int(rng.integers(2**63))))
    return out


def fault_free_runs(plant: Plant, population: Population, runs: int, seed: int = 0) -> list[PlantTrace]:
    """Simulate what ``drawn`` draws.

    Parameters
    ----------
    plant : Plant
    population : Population
    runs : int
    seed : int

    Returns
    -------
    list of PlantTrace

    Raises
    ------
    PlantError
        As ``drawn``.
    """
    return simulate_all(plant, drawn(plant, population, runs, seed))


def stated_runs(plant: Plant, c: dict, blocks: int) -> tuple:
    """Make the runs of a calibration again, once what it says of them is found to be true.

    Parameters
    ----------
    plant : Plant
    c : dict
        "calibration" of a certificate.
    blocks : int
        Values that the confidence is about.

    Returns
    -------
    u, y, q, theta
        See ``side_by_side``.

    Raises
    ------
    CertificateError
        The confidence is more than the runs allow, or they were drawn otherwise.
    """
    level = confidence(c["runs"], c["probability"], blocks)
    if c["confidence"] > level:
        raise CertificateError(f"certificate: {c['runs']} runs give a confidence of {level:.6g}, not "
                               f"{c['confidence']:.6g}.")
    population = Population(steps=c["steps"])
    if list(population.words(plant)) != c["conditions"]:
        raise CertificateError("certificate: the conditions of the calibration are not those of its runs.")
    return side_by_side(fault_free_runs(plant, population, c["runs"], c["seed"]))


def campaign(design, statistic: Callable[[object, Array], Array], probability: float, wanted: float,
             population: Population | None = None, rank: int = 1, seed: int = 0,
             real: str | None = None) -> Calibration:
    """Calibrate thresholds of a design's reference over as many fault-free runs as the confidence takes.

    Parameters
    ----------
    design : Design
        With ``plant`` and ``observer``.
    statistic : callable
        (trace of all runs (N, K, ...), modes (N, K)) -> values (N, ...); no NaN.
    probability : float
    wanted : float
        Confidence.
    population : Population, optional
    rank : int
        The larger, the less the thresholds depend on chance, and the more runs it takes.
    seed : int
    real : {"float32", "float64"}, optional
        Default: the plant file's.

    Returns
    -------
    Calibration

    Raises
    ------
    PlantError
        No runs can be drawn.
    ValueError
    """
    plant, population = design.plant, population or Population()

    def values(truths: list[PlantTrace]) -> Array:
        u, y, q, theta = side_by_side(truths)
        trace = design.observer.run_many(u, y, q, real or plant.target.real, theta=theta)
        return np.asarray(statistic(trace, q))

    first = values(fault_free_runs(plant, population, 1, seed))
    blocks = rank * max(int(np.prod(first.shape[1:])), 1)
    runs = runs_needed(probability, wanted, blocks)
    found = calibrate(values(fault_free_runs(plant, population, runs, seed)), probability, population.steps, rank)
    return replace(found, seed=seed, conditions=population.words(plant))
