"""The interval set of a point observer: its limit, by simulation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from .certify.boxes import freeze_box
from .certify.order import patterns
from .certify.set_freeze import freeze_estimate
from .errors import DesignError
from .observers import BoxObserver, BoxTables, PointTables
from .plant.model import Plant
from .set_simulation import settled, simulated

Array = np.ndarray
STEPS = 60


def with_box(plant: Plant, gains: dict, real: str) -> PointTables:
    """Tables with a box, before anything is certified."""
    modes = plant.observed.modes
    limits = {k: plant.limits(k) for k in ("x", "u", "y")} | {"x0": (plant.x0_lo, plant.x0_hi)}
    estimate = freeze_estimate(modes, limits, gains, gains["limit"], real)
    return PointTables(**estimate, shape=freeze_box(BoxTables, modes, SimpleNamespace(**estimate)))


def boxed(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose the limit of a box.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
    dwell : int
        Samples that every mode lasts at least.

    Returns
    -------
    dict
        "set", "limit".

    Raises
    ------
    DesignError
        The box grows without bound.
    """
    half = np.max([(plant.limits("x")[1] - plant.limits("x")[0]) / 2, (plant.x0_hi - plant.x0_lo) / 2], axis=0)
    t = with_box(plant, gains | {"limit": 1e3 * half}, "float64")
    widths = simulated(t, half, np.array(patterns(plant.n_modes, dwell, STEPS)), BoxObserver)
    if settled(widths) is None:
        raise DesignError(f"{plant.name}: the interval set grows without bound, expected it to settle: the sizes of "
                          '|T A - L C| do, though the errors may not. Use set = "zonotope" or "ellipsoid", declare a '
                          "dwell time, or take gains that decay faster.")
    return {"set": "box", "limit": 1.25 * np.max(widths, axis=(0, 1))}
