"""What the choice of every set begins with: the estimate in a number type, and mode sequences through the set.

Of these, how wide the bounds of x become, and whether they settle.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..certify.freeze import limits
from ..certify.set_freeze import freeze_estimate
from ..observers import PointTables, Supervision
from ..plant.model import Plant

Array = np.ndarray
STEPS = 60  # of a mode sequence


def estimate(plant: Plant, gains: dict, real: str, limit: Array | None = None) -> SimpleNamespace:
    """Tables of the estimate alone; ``limit`` of its set, else that of the gains."""
    limit = gains["limit"] if limit is None else limit
    return SimpleNamespace(**freeze_estimate(plant.observed.modes, limits(plant), gains, limit, real))


def half_widths(plant: Plant) -> Array:
    """Half widths of declared range or initial box, whichever is wider, (n_x,)."""
    return np.max([(plant.limits("x")[1] - plant.limits("x")[0]) / 2, (plant.x0_hi - plant.x0_lo) / 2], axis=0)


def simulated(t: PointTables, half: Array, paths: Array, observer: type) -> Array:
    """Half widths of the bounds of x along mode sequences from the set of a box, (K, S, n_x).

    Parameters
    ----------
    t : PointTables
    half : ndarray (n_x,)
    paths : ndarray (S, K) int
    observer : type
        Of the family of the tables.

    Returns
    -------
    widths : ndarray (K, S, n_x)
    """
    run = observer({t.real: t}, Supervision())
    H = run.whole(t, np.broadcast_to(half.astype(t.dtype), (len(paths), len(t.box))))
    origin, out = np.full(len(paths), t.origins - 1), []
    with np.errstate(over="ignore", invalid="ignore"):
        for q in paths.T:
            H = run.moved(t, q, q, origin, H, True)
            origin = q if t.kind == "tnl" else np.zeros_like(q)
            out.append(run.radius(t, q, origin, H))
    return np.array(out, dtype=float)


def settled(widths: Array) -> Array | None:
    """Largest half widths in the last third of all sequences; None where they still grow there."""
    third = len(widths) // 3
    middle, last = widths[third:2 * third].max(axis=(0, 1)), widths[2 * third:].max(axis=(0, 1))
    return last if np.all(np.isfinite(last)) and np.all(last <= 1.02 * middle) else None
