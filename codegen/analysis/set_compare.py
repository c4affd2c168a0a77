"""The gains of a design with other sets: how close each comes to the exact set, along one scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..algebra import ellipsoid, residual_sets, zonotope
from ..errors import DesignError
from ..plant.model import Plant
from .set_blocks import block_table
from .set_history import SetHistory, noise_alone
from .set_tables import dwell_table

Array = np.ndarray
DIRECTIONS = 8  # of two residuals, in which sets are compared
ROWS, STAGES = 12, 4  # of a table of thresholds
BLOCK = 12  # samples
ORDERS = (5, 10, 20)
SAMPLES = 60  # at which the firmware's own set is measured

#: Name -> (recursion, path, half widths of the first error, directions, dwell) -> thresholds (K, d).
SETS: dict[str, Callable] = {
    "interval": lambda m, path, half, D, dwell: residual_sets.intervals(m, path, half) @ np.abs(D).T,
    "ellipsoid": lambda m, path, half, D, dwell: np.array([
        [np.sqrt(d @ R @ d) for d in D] for R in residual_sets.ellipsoids(m, path, ellipsoid.of_box(half))]),
    **{f"zonotope of order {n}": lambda m, path, half, D, dwell, n=n: residual_sets.thresholds(
        m, path, np.diag(half), D, max(n, len(half))) for n in ORDERS},
    "table by time since the switch": lambda m, path, half, D, dwell: dwell_table(
        m, dwell, np.diag(half), D, ROWS, STAGES).along(path),
    "generators, reduced at a switch": lambda m, path, half, D, dwell: block_table(
        m, D, BLOCK, max(ORDERS[0], len(half))).along(path, np.diag(half)),
}


@dataclass(frozen=True)
class Closeness:
    """How close a set comes to the exact one along a scenario: thresholds over its, infinite where it grows.

    Parameters
    ----------
    name : str
        A key of ``SETS``; empty: the firmware's own set.
    mean, worst : float
    """

    name: str
    mean: float
    worst: float


def closeness(plant: Plant, history: SetHistory, exact: list[Array | None], index: Array) -> list[Closeness]:
    """Compare the firmware's set, and others with the same gains, with the exact one; the first quarter is left out.

    Parameters
    ----------
    plant : Plant
    history : SetHistory
    exact : list of (ndarray or None)
    index : ndarray (k,) int
        Samples to be looked at, of the first stretch.

    Returns
    -------
    list of Closeness
        The firmware's first; empty where the exact set is not known from the first sample on.
    """
    m = noise_alone(plant, history.t)
    stop = next((k for k in range(1, len(exact)) if exact[k] is None or history.fresh[k]), len(exact))
    index = index[index < stop]
    settled = index[len(index) // 4:]
    if m is None or len(settled) < 2:
        return []
    D = zonotope.fan(DIRECTIONS) if plant.n_y == 2 else np.eye(plant.n_y)
    real = np.array([zonotope.support(exact[k], D) for k in settled])
    half = (np.asarray(plant.x0_hi, float) - np.asarray(plant.x0_lo, float)) / 2
    path, dwell = history.q[:stop].tolist(), least_dwell(plant)
    some = settled[np.unique(np.linspace(0, len(settled) - 1, SAMPLES).astype(int))]
    own = supports(history, some, D) / real[np.searchsorted(settled, some)]
    out = [Closeness("", float(own.mean()), float(own.max()))]
    for name, find in SETS.items():
        try:
            ratio = find(m, path, half, D, dwell)[settled] / real
        except (DesignError, ValueError):
            ratio = np.full(1, np.inf)
        out.append(Closeness(name, float(ratio.mean()), float(ratio.max())))
    return out


def supports(history: SetHistory, index: Array, D: Array) -> Array:
    """Return how far the firmware's set reaches in directions, (k, d): the largest d' r over points of its edge."""
    if D.shape[1] != 2:
        return history.bound[index].astype(float) @ np.abs(D).T
    return np.max(history.outlines(index) @ D.T, axis=1)


def least_dwell(plant: Plant) -> int:
    """Samples that every mode lasts at least: as declared, else 1."""
    s = plant.switching
    declared = s.average_dwell is not None and s.chatter == 1
    return max(1, int(s.average_dwell / plant.sample_period + 1e-9)) if declared else 1
