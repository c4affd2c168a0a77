"""How the guaranteed width depends on the sampling period, and the longest period at which a design exists.

For every period the plant is sampled anew and the gains are designed anew (policy iteration, no solver of matrix
inequalities), so the curve is what a user would get who chose that period: not one set of gains run at other speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import DesignError
from .plant.model import Plant
from .synthesis.policy import capped, iterate
from .synthesis.problem import Problem

Array = np.ndarray
#: Factors on the plant file's period; the shortest stands for the continuous limit.
FACTORS = tuple(2.0**k for k in range(-6, 7))


@dataclass(frozen=True)
class PeriodPoint:
    """Steady guaranteed width of each state (n_x,) at a sampling period in seconds; None where no design exists."""

    period: float
    width: Array | None


def width_at(plant: Plant, period: float, tnl: bool, split: bool, share: float = np.inf) -> Array | None:
    """Smallest steady guaranteed width at a sampling period, None where there is none.

    Parameters
    ----------
    plant : Plant
        Continuous.
    period : float
        Seconds.
    tnl, split : bool
        As in ``synthesis.problem.Problem``.
    share : float
        Cap on N, see ``synthesis.policy.capped``: without one the narrowest bounds may see no fault.

    Returns
    -------
    ndarray (n_x,) or None
    """
    try:
        problem = Problem.of(replace(plant, sample_period=period), tnl, split)
        solved = iterate(problem, capped(problem, share))
    except DesignError:
        return None
    return None if solved is None else solved["width"]


def curve(plant: Plant, tnl: bool, split: bool, factors=FACTORS, share: float = np.inf) -> list[PeriodPoint]:
    """Widths over a range of sampling periods around the plant file's; arguments as ``width_at``."""
    return [PeriodPoint(plant.sample_period * f, width_at(plant, plant.sample_period * f, tnl, split, share))
            for f in factors]


def longest(plant: Plant, tnl: bool, split: bool, halvings: int = 16, steps: int = 5) -> float | None:
    """Longest period below the plant file's at which a design exists, to a few per cent; None if none was found."""
    lo, hi = None, plant.sample_period
    for _ in range(halvings):
        trial = hi / 2
        if width_at(plant, trial, tnl, split) is not None:
            lo = trial
            break
        hi = trial
    if lo is None:
        return None
    for _ in range(steps):
        middle = (lo * hi) ** 0.5
        lo, hi = (lo, middle) if width_at(plant, middle, tnl, split) is None else (middle, hi)
    return lo
