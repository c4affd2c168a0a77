"""The residual sets that a firmware held its samples against: asked of its own test, so for every kind of set alike.

The reference runs as the compiled C does (they are ``==``), and what its membership test was given is kept. How far the
residual may go in a direction is then found by asking that test again: the region is convex and symmetric about zero.
Beside it stands the exact set: what disturbance and noise can make of the residual along the same modes, with nothing
reduced or rounded.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.error_set import ErrorRecursion, centre, tnl
from ..observers import PointTables
from ..observers.tnl import FRESH, FULL

Array = np.ndarray

#: Halvings of what is not known of a distance.
HALVINGS = 22
#: Directions of the half circle along which an outline or an area is measured.
RAYS = 90


@dataclass(frozen=True)
class SetHistory:
    """What the membership test of each sample was given.

    Parameters
    ----------
    observer : PointObserver
    t : PointTables
    q, origin : ndarray (K,) int
    sets : ndarray (K, ...)
        As the family carries them.
    bound : ndarray (K, n_y)
        Largest |r_i| without a fault.
    fresh, full : ndarray (K,) bool
        Samples at which the observer has started anew; those that follow a measured one.
    measured : ndarray (K,) bool
    """

    observer: object
    t: PointTables
    q: Array
    origin: Array
    sets: Array
    bound: Array
    fresh: Array
    full: Array
    measured: Array

    def reach(self, index: Array, directions: Array) -> Array:
        """Return how far the residual may go along directions.

        Parameters
        ----------
        index : ndarray (k,) int
            Samples.
        directions : ndarray (d, n_y) or (k, d, n_y)

        Returns
        -------
        length : ndarray (k, d)
            In units of the direction's own length.
        """
        k, d = len(index), directions.shape[-2]
        rays = np.broadcast_to(directions, (k, d, directions.shape[-1])).reshape(k * d, -1)
        at = np.repeat(np.asarray(index), d)
        with np.errstate(divide="ignore"):
            high = np.min(self.bound[at].astype(float) / np.abs(rays), axis=1)  # no further: a residual's own bound
        low = np.zeros_like(high)
        q, origin, sets = self.q[at], self.origin[at], self.sets[at]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            _, raw = self.observer.judged(self.t, q, origin, sets, (middle[:, None] * rays).astype(self.t.dtype))
            outside = raw.any(axis=1)
            low, high = np.where(outside, low, middle), np.where(outside, middle, high)
        return high.reshape(k, d)

    def outlines(self, index: Array, pair: tuple[int, int] = (0, 1)) -> Array:
        """Return points on the edges of sets, the other residuals being zero: (k,) -> (k, 2 RAYS, 2)."""
        rays = self._rays(np.asarray(index), pair)
        points = (self.reach(index, rays)[:, :, None] * rays)[:, :, list(pair)]
        return np.concatenate([points, -points], axis=1)

    def gauges(self, index: Array, r: Array) -> Array:
        """Return how far out residuals are, 1 on the edge of the set of their samples: r (k, n_y) -> (k,)."""
        still = ~np.any(r != 0, axis=1)
        length = self.reach(index, np.where(still[:, None], 1.0, r)[:, None].astype(float))[:, 0]
        with np.errstate(divide="ignore"):
            return np.where(still, 0.0, 1.0 / length)

    def areas(self, index: Array) -> Array:
        """Return the areas of the sets of two residuals, (k,) -> (k,)."""
        ring = self.outlines(index)
        onward = np.roll(ring, -1, axis=1)
        return (ring[..., 0] * onward[..., 1] - ring[..., 1] * onward[..., 0]).sum(axis=1) / 2

    def _rays(self, index: Array, pair: tuple[int, int]) -> Array:
        """Directions (k, RAYS, n_y) in the plane of two residuals, closer together where the set is long."""
        plane = np.eye(self.bound.shape[1])[list(pair)]
        rays = zonotope.fan(RAYS) @ (self.bound[index][:, list(pair), None].astype(float) * plane)
        for _ in range(2):  # spread evenly for the ellipse that has the moments of the corners found so far
            ring = (self.reach(index, rays)[:, :, None] * rays)[:, :, list(pair)]
            moments = ring.swapaxes(1, 2) @ ring
            moments += (1e-9 * np.trace(moments, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(2)
            rays = zonotope.fan(RAYS) @ np.linalg.cholesky(moments).swapaxes(1, 2) @ plane
        return rays


def watch(observer, real: str, truth) -> SetHistory:
    """Run the reference over a scenario and keep what its membership test was given.

    Parameters
    ----------
    observer : PointObserver
    real : {"float32", "float64"}
    truth : PlantTrace

    Returns
    -------
    SetHistory
    """
    t, kept = observer.tables[real], []
    watched = copy(observer)

    def judged(t, q, origin, shape, r):
        bound, raw = observer.judged(t, q, origin, shape, r)
        kept.append((q[0], np.array(origin)[0], np.array(shape)[0], bound[0], watched.phase[0]))
        return bound, raw

    watched.judged = judged
    watched.run(truth.u, truth.y, truth.q, real=real)
    q, origin, sets, bound, phase = (np.array(column) for column in zip(*kept))
    return SetHistory(observer, t, q, origin, sets, bound, phase == FRESH, phase == FULL,
                      ~np.isnan(truth.y).any(axis=1))


def noise_alone(plant, t: PointTables) -> ErrorRecursion | None:
    """Return how disturbance and noise move error and residual, without rounding; None where N != 0 and C is not one.

    Parameters
    ----------
    plant : Plant
    t : PointTables
    """
    modes = plant.enclosed.modes
    A, C, Bw, Dv = (np.stack([getattr(m, name) for m in modes]) for name in ("A", "C", "Bw", "Dv"))
    half = {v: np.stack([centre(getattr(m, f"{v}_lo"), getattr(m, f"{v}_hi"))[1] for m in modes]) for v in "wv"}
    try:
        return tnl(A, C, t.L.astype(float), t.N.astype(float), Bw, Dv, half["w"], half["v"])
    except ValueError:
        return None


def exact_sets(plant, history: SetHistory, most: int = 400) -> list[Array | None]:
    """Return the generators of the exact residual set at every sample.

    Parameters
    ----------
    plant : Plant
    history : SetHistory
    most : int
        Samples since the last start after which none is given: the set gains columns with every sample.

    Returns
    -------
    sets : list of ndarray (n_y, g) or None
        None after a missing measurement, until the observer starts anew.
    """
    m = noise_alone(plant, history.t)
    if m is None:
        return [None] * len(history.q)
    boxes = [np.diag((np.asarray(hi, float) - np.asarray(lo, float)) / 2)
             for lo, hi in ((plant.x0_lo, plant.x0_hi), plant.limits("x"))]
    out: list[Array | None] = []
    H, since = None, 0
    for k, q in enumerate(history.q):
        if history.fresh[k]:
            H, since, before = boxes[k > 0], 0, m.start
        elif H is not None and history.full[k] and history.measured[k] and since < most:
            p = history.q[k - 1]
            H = np.concatenate([m.A[p] @ H, m.W[before, p]], axis=1)
            before, since = p, since + 1
        else:
            H = None
        out.append(None if H is None or not history.measured[k] else
                   np.concatenate([m.C[q] @ H, m.V[before, q]], axis=1))
    return out


def hulls(sets: list[Array]) -> Array:
    """Return the half widths of residuals in exact sets, (k, n_y)."""
    return np.array([zonotope.hull(G) for G in sets])


def exact_areas(sets: list[Array]) -> Array:
    """Return the areas of exact sets of two residuals, (k,)."""
    return np.array([zonotope.area(G) for G in sets])
