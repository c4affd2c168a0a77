"""Fault injection on the compiled C: false alarms, which share of the faults is found and how soon, by size.

Runs are drawn at random: modes that keep to the declared switching, half of the runs with signals uniform within their
bounds, half at the ends of them. Those in which a state leaves its declared range are left out, as nothing is claimed
of them; where these are most, modes are those of the scenarios. In every run but those without fault one channel steps
once, in the second half, to a size of either sign, and stays. What is guaranteed is held against each of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .analysis.calibration import Population, drawn
from .analysis.validate import Outcome, judged
from .designs import Design
from .errors import PlantError
from .plant.model import Fault, Plant, Scenario, Signal
from .plant.simulate import simulate_all
from .report.outcome_words import promise

#: Sizes that are tried, of the least that is surely found; of the range where none is, or only beyond it.
SHARES, OF_RANGE = (0.25, 0.5, 0.75, 1.001, 2.0), (0.01, 0.03, 0.1, 0.3, 1.0)
STEPS = 200  # samples of a run, where no scenario is longer


@dataclass(frozen=True)
class Row:
    """What the runs with one size of one fault gave.

    Parameters
    ----------
    channel : str
        Empty: no fault.
    size : float
    runs : int
    alarmed : int
        Runs with an alarm while no fault acted that is false, by chance too where thresholds are calibrated.
    delays : tuple of int
        Of the faults found, in samples, from least to most.
    promised : int
        Runs in which finding it in time was guaranteed.
    outcomes : tuple of Outcome
    """

    channel: str
    size: float
    runs: int
    alarmed: int
    delays: tuple[int, ...]
    promised: int
    outcomes: tuple[Outcome, ...]


def signs(signal: Signal, size: float) -> list[int]:
    """Which signs a fault of this size may have.

    Parameters
    ----------
    signal : Signal
    size : float
    """
    return [sign for sign in (1, -1) if signal.lo <= sign * size <= signal.hi]


def sizes(design: Design, real: str, channel: str) -> list[float]:
    """Sizes of a fault that are tried.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    channel : str

    Returns
    -------
    list of float
        Within the range of the fault.
    """
    sure = [size for row in design.detection[real] if row["channel"] == channel for size in row["by_delay"]
            if size is not None]
    sure += [f["size"] for f in design.certificate[real].get("faults", ()) if f["channel"] == channel]
    signal = next(f for f in design.plant.f if f.name == channel)
    most = max(abs(signal.lo), abs(signal.hi))
    if not np.isfinite(most):
        most = 10 * min(sure, default=1.0)
    tried = [share * min(sure) for share in SHARES] if sure else []
    tried = [size for size in tried if signs(signal, size)] or [share * most for share in OF_RANGE]
    return [size for size in tried if signs(signal, size)]


def inside(plant: Plant, runs: int, seed: int, modes: str) -> list[tuple[Scenario, int]]:
    """Draw runs without fault, and leave out those in which a state leaves its declared range.

    Parameters
    ----------
    plant : Plant
    runs : int
    seed : int
    modes : {"random", "scenario"}

    Returns
    -------
    list of (Scenario, int)
    """
    enough = min if modes == "scenario" else max  # each of them is one that may be drawn
    steps = enough([s.steps for s in plant.scenarios if not s.csv], default=STEPS)
    every = [pair for i, kind in enumerate(("uniform", "corner")) for pair in
             drawn(plant, Population(steps, kind, kind, modes=modes), (runs + 1 - i) // 2, seed + i)]
    lo, hi = plant.limits("x")
    truths = simulate_all(plant, every)
    return [pair for pair, truth in zip(every, truths) if np.all((truth.x >= lo) & (truth.x <= hi))]


def campaign(design: Design, driver, runs: int = 100, seed: int = 0,
             progress: Callable[[str], None] = lambda text: None) -> list[Row]:
    """Inject faults of several sizes into random runs.

    Parameters
    ----------
    design : Design
    driver : Driver
        Of ``host.build``.
    runs : int
        Without fault, and with each size of each.
    seed : int
    progress : callable

    Returns
    -------
    list of Row
        The first is without fault.

    Raises
    ------
    PlantError
        The plant has inputs and no scenario that says what they do, or no run stays within the declared ranges.
    """
    plant = design.plant
    progress(f"{runs} runs to be drawn")
    base = inside(plant, runs, seed, "random")
    if 2 * len(base) < runs and plant.n_modes > 1:
        base = max(base, inside(plant, runs, seed, "scenario"), key=len)
    if not base:
        raise PlantError(f"{plant.name}: a state leaves its declared range in each of {runs} random runs without fault "
                         "(found), expected some that stay. Give a [[scenario]] whose inputs hold the plant within its "
                         "ranges.")
    steps = base[0][0].steps
    rows = [_row(design, driver, "", 0.0, base, progress)]
    rng = np.random.default_rng(seed)
    for j, signal in enumerate(plant.f):
        for size in sizes(design, driver.real, signal.name):
            either = signs(signal, size)
            faulty = [(replace(s, name=f"{signal.name} {size:g}", fault=(Fault(
                j, int(rng.integers(steps // 2, 3 * steps // 4 + 1)), steps, repr(float(rng.choice(either) * size))),)),
                own) for s, own in base]
            rows.append(_row(design, driver, signal.name, size, faulty, progress))
    return rows


def _row(design: Design, driver, channel: str, size: float, drawn_runs: list, progress) -> Row:
    """Simulate these runs, drive the C with them, judge them."""
    progress(f"{len(drawn_runs)} runs {f'with {channel} {size:.3g}' if channel else 'without fault'}")
    real, scenarios = driver.real, [scenario for scenario, _ in drawn_runs]
    cert = design.certificate[real]
    outcomes = judged(design, driver, scenarios, simulate_all(design.plant, drawn_runs), cert, compared=False)
    episodes = [(o, e) for o in outcomes for e in o.episodes]
    return Row(channel, size, len(outcomes), sum(o.false_alarms + o.chance > 0 for o in outcomes),
               tuple(sorted(e.delay for _, e in episodes if e.delay is not None)),
               sum(promise(design, real, o, e)[0] is not None for o, e in episodes), tuple(outcomes))
