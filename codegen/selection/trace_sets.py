"""The ellipsoid with weights chosen online of a point observer: units of its trace and limit, by simulation."""

from __future__ import annotations

import numpy as np

from ..certify import trace_ellipsoids
from ..certify.order import patterns
from ..errors import DesignError
from ..observers import EllipsoidTraceObserver, PointTables, Supervision, TraceTables
from ..plant.model import Plant
from .set_simulation import STEPS, estimate, half_widths, settled, simulated

Array = np.ndarray
#: A trace that shrinks by less in each mode is worth a search for better units.
SHRINKS = 0.98


def with_trace(plant: Plant, gains: dict, real: str) -> PointTables:
    """Tables with an ellipsoid of least trace, before anything is certified."""
    t = estimate(plant, gains, real)
    return PointTables(**vars(t), shape=trace_ellipsoids.freeze(
        TraceTables, plant.observed.modes, t, *(np.array(w) for w in gains["weights"]), gains["directions"]))


def traced(plant: Plant, gains: dict, dwell: int) -> dict:
    """Choose the units of the traces, and the limit.

    The units are the half widths themselves once settled, so that the least trace is that of states of like size; where
    the trace does not shrink in these, nearby ones are looked for in which it does.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    dwell : int
        Samples that every mode lasts at least.

    Returns
    -------
    dict
        "set", "limit", "weights", "directions" (none yet).

    Raises
    ------
    DesignError
        The ellipsoid grows without bound.
    """
    half = half_widths(plant)
    paths = np.array(patterns(plant.n_modes, dwell, STEPS))
    chosen = {"set": "ellipsoid_trace", "limit": 8 * np.sqrt(plant.n_x) * half,
              "directions": np.zeros((0, plant.n_y)), "weights": (trace_ellipsoids.powers(half), np.ones(plant.n_y))}
    for _ in range(3):  # the units depend on the sizes, a little
        t = with_trace(plant, gains | chosen, "float64")
        widths = simulated(t, half, paths, EllipsoidTraceObserver)
        steady = settled(widths)
        if steady is None:
            raise DesignError(f"{plant.name}: the ellipsoid grows without bound, expected it to settle. Declare a "
                              "longer dwell time, or take gains that decay faster.")
        weight = shrinking(t.M.astype(float), trace_ellipsoids.powers(steady))
        chosen["weights"] = weight, trace_ellipsoids.powers(residual_sizes(t, steady))
    return chosen | {"limit": np.maximum(1.25 * widths.max(axis=(0, 1)), 1.25 * np.sqrt(plant.n_x) * half)}


def residual_sizes(t: PointTables, steady: Array) -> Array:
    """About the half widths of the residuals for these of the states, (n_y,)."""
    run = EllipsoidTraceObserver({t.real: t}, Supervision())
    X = np.array([np.diag(steady**2)] * len(t.A))
    q = np.arange(len(t.A))
    R = run.shape_of_residuals(t, q, q if t.kind == "tnl" else 0 * q, X)
    return np.sqrt(np.einsum("qii->qi", R).max(axis=0))


def shrinking(M: Array, weight: Array) -> Array:
    """Weights near these, powers of four, in which the trace shrinks in every mode; the same where none is found.

    Parameters
    ----------
    M : ndarray (N, n, n)
    weight : ndarray (n,)
    """
    def worst(w):
        return max(np.linalg.norm(np.sqrt(w)[:, None] * m / np.sqrt(w), 2) for m in M) ** 2

    best, found = worst(weight), weight
    while best > SHRINKS:
        near = [found * 4.0 ** (sign * np.eye(len(weight))[i]) for i in range(len(weight)) for sign in (-1, 1)]
        least, w = min(((worst(w), w) for w in near), key=lambda pair: pair[0])
        if least >= best:
            break
        best, found = least, w
    return found if best < 1 else weight
