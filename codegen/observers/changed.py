"""Steps of framers whose mode nobody tells, in other coordinates: those of z = Z x move, those of x follow from them.

Without a measurement it is the other way round. Framers of x may be cut to other bounds, or start from them, between
two steps: those of z are what Z makes of x then, and no wider than they were where nothing but cuts was done. Where the
tables change no coordinates there is no z, and these are the steps of ``framer``.
"""

from __future__ import annotations

import numpy as np

from .framer import FramerTables, open_loop, propagate, to_x, to_z

Array = np.ndarray
Pair = tuple[Array, Array]


def measured_step(t: FramerTables, q: Array, x: Pair, z: Pair | None, u: Array, y: Array, y_next: Array,
                  theta: Array, change: Array) -> tuple[Pair, Pair | None]:
    """One step from a sample that was measured; arguments as of ``propagate``.

    Parameters
    ----------
    t : FramerTables
    q : ndarray (S,) int
    x : (ndarray (S, n_x), ndarray (S, n_x))
        Framers of x, lower and upper.
    z : the same, or None
        Of z, where the tables change coordinates.
    u : ndarray (S, n_u)
    y, y_next : ndarray (S, n_y)
    theta, change : ndarray (S, J)

    Returns
    -------
    x, z : as the arguments
    """
    after = propagate(t, q, *x, u, y, y_next, theta, z=z, change=change)
    return (after, None) if z is None else (to_x(t, *after), after)


def blind_step(t: FramerTables, q: Array, x: Pair, u: Array) -> tuple[Pair, Pair | None]:
    """One step from a sample without measurement; arguments and results as of ``measured_step``.

    Returns
    -------
    x, z : as the arguments
    """
    after = open_loop(t, q, *x, u)
    return after, None if t.change is None else to_z(t.change, *after)


def turned(t: FramerTables, moved: Array, x: Pair, z: Pair) -> Pair:
    """Framers of z for those of x, cut to those that moved.

    Parameters
    ----------
    t : FramerTables
    moved : ndarray (...) bool
        Whether x is no wider than what followed from ``z``.
    x, z : (ndarray (..., n_x), ndarray (..., n_x))

    Returns
    -------
    lo, hi : ndarray (..., n_x)
        Crossed where x and z contradict each other.
    """
    n, moved = len(t.box), moved[..., None]
    lo, hi = (a.reshape(x[0].shape) for a in to_z(t.change, x[0].reshape(-1, n), x[1].reshape(-1, n)))
    return np.where(moved & (z[0] > lo), z[0], lo), np.where(moved & (z[1] < hi), z[1], hi)
