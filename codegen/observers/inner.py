"""A point observer that runs inside of another one, in the mode that this one decides for: which sets, moves, starts.

It is the observer that is told its mode (``point``), without calls of its own: who drives it says in which mode it
moves, with or without its measurement, and when it starts anew. Its state is the triple (x_hat, set, origin).
"""

from __future__ import annotations

import numpy as np

from .box import BoxObserver
from .ellipsoid import EllipsoidObserver
from .ellipsoid_trace import EllipsoidTraceObserver
from .point import PointObserver, PointTables, blind, centred, forward
from .starts import StartObserver
from .supervisor import Supervision
from .zonotope import ZonotopeObserver

Array = np.ndarray
#: Sets that start from any box at run time; of tables those that are made for it.
SETS = {"zonotope": ZonotopeObserver, "box": BoxObserver, "ellipsoid": EllipsoidObserver,
        "ellipsoid_trace": EllipsoidTraceObserver, "starts": StartObserver}


def alone(told: PointTables, family: str) -> PointObserver:
    """The observer that is told its mode, by itself."""
    return SETS[family]({told.real: told}, Supervision())


def chosen(which: Array, one: tuple, other: tuple) -> tuple:
    """The first estimate, set and origin for the runs in ``which``, the second ones for the others."""
    return tuple(np.where(which.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(one, other))


def anywhere(inner: PointObserver, told: PointTables, runs: int) -> tuple[Array, Array, Array]:
    """Estimate, set and origin of the declared range."""
    centre, half = (np.broadcast_to(a, (runs, len(a))) for a in centred(told.x_lo, told.x_hi, told.dtype))
    return centre, inner.whole(told, half), np.full(runs, told.origins - 1)


def begun(inner: PointObserver, told: PointTables, runs: int) -> tuple[Array, Array, Array]:
    """The same at a start: of a table by size of the start the part for the declared range, not that for any error."""
    centre, shape, origin = anywhere(inner, told, runs)
    if isinstance(inner, StartObserver):
        half = centred(told.x_lo, told.x_hi, told.dtype)[1]
        shape = inner.begun(told, np.broadcast_to(half, centre.shape))
    return centre, shape, origin


def moved(inner: PointObserver, told: PointTables, p: Array, full: Array, point: tuple, last: tuple, y: Array) -> tuple:
    """Estimate, set and origin a period later, all of it in the modes p.

    Parameters
    ----------
    inner : PointObserver
    told : PointTables
    p : ndarray (S,) int
    full : ndarray (S,) bool
        Where this sample has its measurement, and the last one had.
    point : (x_hat, set, origin)
    last : (ndarray (S, n_u), ndarray (S, n_y))
        Inputs and measurements of the last sample.
    y : ndarray (S, n_y)

    Returns
    -------
    (x_hat, set, origin)
    """
    (x, shape, origin), (u, before), none = point, last, told.origins - 1
    with_y = (forward(told, p, x, u, before, y), inner.moved(told, p, p, origin, shape, True),
              p if none else np.zeros_like(p))
    without = blind(told, p, x, u), inner.moved(told, p, p, origin, shape, False), np.full_like(p, none)
    return chosen(full, with_y, without)


def settled(inner: PointObserver, told: PointTables, p: Array, point: tuple) -> tuple[Array, Array, Array, Array]:
    """Start again from the declared range where the set is beyond its limits, as the observer that is told.

    Returns
    -------
    x_hat, set, origin, radius
        The last the half widths of the bounds of x.
    """
    x, shape, origin = point
    radius = inner.radius(told, p, origin, shape)
    grown = ~inner.fits(told, x, radius)
    x, shape, origin = chosen(grown, anywhere(inner, told, len(x)), point)
    return x, shape, origin, np.where(grown[:, None], inner.radius(told, p, origin, shape), radius)
