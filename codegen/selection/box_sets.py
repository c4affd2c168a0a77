"""The interval set of a point observer: its coordinates, and its limit by simulation."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from ..certify.boxes import freeze_box
from ..certify.order import patterns
from ..errors import DesignError
from ..observers import BoxObserver, BoxTables, PointTables
from ..plant.model import Plant
from .set_simulation import STEPS, estimate, half_widths, settled, simulated

Array = np.ndarray
#: Of coordinates; beyond it the box of a box is larger than what is won.
WORST_CONDITION = 1e4


def with_box(plant: Plant, gains: dict, real: str) -> PointTables:
    """Tables with a box, before anything is certified."""
    t = estimate(plant, gains, real)
    return PointTables(**vars(t), shape=freeze_box(BoxTables, plant.observed.modes, t, np.array(gains["coordinates"])))


def boxed(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose coordinates and limit of a box: the states themselves where the box settles in these.

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
        "set", "coordinates", "limit".

    Raises
    ------
    DesignError
        The box grows without bound.
    """
    half = half_widths(plant)
    paths = np.array(patterns(plant.n_modes, dwell, STEPS))
    M = error_matrices(plant, gains)
    for found in (lambda: np.eye(plant.n_x), lambda: turning(M, half)):
        T = found()
        if T is None:
            break
        chosen = {"set": "box", "coordinates": T, "limit": 1e3 * half}
        t = with_box(plant, gains | chosen, "float64")
        widths = simulated(t, half, paths, BoxObserver)
        if settled(widths) is not None:
            start = np.abs(T) @ np.abs(np.linalg.inv(T)) @ half
            return chosen | {"limit": np.maximum(1.25 * np.max(widths, axis=(0, 1)), 1.05 * start)}
    raise DesignError(f"{plant.name}: the interval set grows without bound, expected it to settle: the sizes of "
                      '|T A - L C| do, though the errors may not. Use set = "zonotope" or "ellipsoid", declare a '
                      "dwell time, or take gains that decay faster.")


def error_matrices(plant: Plant, gains: dict) -> Array:
    """T A - L C of each mode, (N, n_x, n_x)."""
    return np.array([(np.eye(plant.n_x) - N @ m.C) @ m.A - L @ m.C
                     for m, L, N in zip(plant.observed.modes, gains["L"], gains["N"])])


def turning(M: Array, half: Array) -> Array | None:
    """Coordinates in which the sizes of the error matrices shrink in every mode; None where none are found.

    A search from the eigenvectors of each mode and of their mean for the smallest largest row sum of
    ``|T^-1 M_q T|``; any switching is allowed for.

    Parameters
    ----------
    M : ndarray (N, n, n)
    half : ndarray (n,)
        Units of the states.

    Returns
    -------
    T : ndarray (n, n) or None
    """
    n, M = len(half), M * half / half[:, None]

    def size(entries):
        T = entries.reshape(n, n)
        if not np.linalg.cond(T) < WORST_CONDITION:
            return np.inf
        return max(np.abs(np.linalg.solve(T, m @ T)).sum(axis=1).max() for m in M)

    best = None
    for first in (*M, M.mean(axis=0)):
        values, vectors = np.linalg.eig(first)
        real = np.where(values.imag < 0, vectors.imag, vectors.real)
        start = real if np.linalg.cond(real) < WORST_CONDITION else np.eye(n)
        found = minimize(size, start.ravel(), method="Nelder-Mead",
                         options={"maxfev": 400 * n * n, "adaptive": True, "fatol": 1e-3, "xatol": 1e-3})
        best = found if best is None or found.fun < best.fun else best
    if not best.fun < 1:
        return None
    T = best.x.reshape(n, n)
    return half[:, None] * (T / np.abs(T).max(axis=0))
