"""Run-time family "ellipsoid_trace": a point observer whose error lies in an ellipsoid, with weights chosen online.

At sample k, from estimate, shape X, input, output and mode p of sample k-1::

    1  Z = M_p X M_p' + rounding
    2  X = (1 + 1/a) Z + (1 + a) H_p,  a = root(tr(W Z) / tr(W H_p))       H: disturbance and noise
    3  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    4  R = (1 + 1/a) (C X C' + rounding) + (1 + a) V in the same way;  alarm where r' R^-1 r > 1, or a residual is
       beyond its bound
    5  keep x_hat, u, y, mode

Source: Zammali (2020), 6.3.3, (6.29) and Theorem 22, as corrected in ``synthesis``. *Any* a > 0 makes an outer
ellipsoid; the root of the ratio makes the one with the least weighted trace. So nothing but the size rests on how well
the root is found: the smallest of a few tangents, then three of Heron's steps ``c = (z / c + c) / 2``. Each c, whatever
it comes from, gives an upper bound of the root, which is what the bounds of states and residuals need.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .ellipsoid import EllipsoidObserver, within
from .point import PointTables, plain
from .zonotope import times

Array = np.ndarray
#: Heron's steps; from the tangents of ``certify.trace_ellipsoids`` they leave a part in 1700.
STEPS = 3


@dataclass(frozen=True)
class TraceTables:
    """The numbers of the error set; N modes, O origins (``PointTables.origins``).

    Parameters
    ----------
    weight : ndarray (n_x,), weight_y : ndarray (n_y,)
        W of the traces, powers of four that make states, and residuals, of like size.
    H, Hb : ndarray (N, O, n_x, n_x), V : ndarray (N, O, n_y, n_y)
        Shapes of what a step adds, with and without its measurement, and of the residual's noise.
    r, rb, rv : ndarray (N, O)
        One over the weighted traces of these.
    k, kb : ndarray (N, n_x), kr : ndarray (N, n_y)
        What rounding adds to the diagonals, times the weighted trace of X.
    a, b : ndarray (K,)
        Tangents that a root starts from.
    least : ndarray ()
        Smallest number that a root is taken of.
    scale : ndarray (n_x,), scale_y : ndarray (n_y,)
        Root of a state's, or residual's, 1 / W, with the rounding of a root.
    spread : ndarray (O, n_x)
        What the bounds of x have beyond the ellipsoid.
    directions : ndarray (m, n_y)
        For more than two outputs.
    slack, floor : ndarray ()
        Relative and absolute rounding of the membership test.
    """

    weight: Array
    weight_y: Array
    H: Array
    Hb: Array
    V: Array
    r: Array
    rb: Array
    rv: Array
    k: Array
    kb: Array
    kr: Array
    a: Array
    b: Array
    least: Array
    scale: Array
    scale_y: Array
    spread: Array
    directions: Array
    slack: Array
    floor: Array

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> TraceTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        arrays = {f.name: np.array(data[f.name], dtype=np.float64).astype(real) for f in fields(cls)}
        return cls(**arrays | {"directions": arrays["directions"].reshape(-1, sizes[3])})


def root(z: TraceTables, values: Array) -> Array:
    """Upper bound of the square root but for rounding, as the C computes it; any shape."""
    values = np.where(values < z.least, z.least, values)
    best = z.a[0] * values + z.b[0]
    for a, b in zip(z.a[1:], z.b[1:]):
        other = a * values + b
        best = np.where(other < best, other, best)
    half = z.a.dtype.type(0.5)
    for _ in range(STEPS):
        best = half * (values / best + best)
    return best


def carried(z: TraceTables, A: Array, X: Array, k: Array, trace: Array, weight: Array,
            inverse: Array) -> tuple[Array, Array]:
    """Return ``Z = A X A'`` with its rounding, (S, r, r), and the weight a of its sum with the noise, (S,).

    Shapes: A (S, r, n), X (S, n, n), k (S, r), trace (S,), weight (r,), inverse (S,).
    """
    Z = times(times(A, X), A.swapaxes(1, 2))
    i = np.arange(A.shape[1])
    Z[:, i, i] = Z[:, i, i] + k * trace[:, None]
    return Z, root(z, weighted(weight, Z) * inverse)


def merged(Z: Array, a: Array, noise: Array) -> Array:
    """Return the ellipsoid around those of Z and of the noise, each (S, r, r), with the weight a, (S,)."""
    one = a.dtype.type(1.0)
    total = (one + one / a)[:, None, None] * Z + (one + a)[:, None, None] * noise
    return np.tril(total) + np.tril(total, -1).swapaxes(1, 2)


def weighted(weight: Array, X: Array) -> Array:
    """Weighted trace, (r,), (S, r, r) -> (S,)."""
    total = weight[0] * X[:, 0, 0]
    for i in range(1, X.shape[1]):
        total = total + weight[i] * X[:, i, i]
    return total


class EllipsoidTraceObserver(EllipsoidObserver):
    """The observer with an ellipsoid of least trace; see ``Runner`` for the calls."""

    family = "ellipsoid_trace"
    shape_class = TraceTables

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, X: Array, measured: bool) -> Array:
        """The set one step of the modes p later."""
        z, o = t.shape, np.minimum(origin, t.origins - 1)
        M, H, inverse, k = (t.M, z.H, z.r, z.k) if measured else (t.A, z.Hb, z.rb, z.kb)
        with np.errstate(over="ignore", invalid="ignore"):  # of a set that has grown, which starts again
            Z, a = carried(z, M[p], X, k[p], weighted(z.weight, X), z.weight, inverse[p, o])
            return merged(Z, a, H[p, o])

    def radius(self, t: PointTables, q: Array, origin: Array, X: Array) -> Array:
        """Half widths of the bounds of x; no number where a square is below zero (an upset of the memory)."""
        z, i = t.shape, np.arange(X.shape[1])
        with np.errstate(over="ignore", invalid="ignore"):
            half = t.shape.spread[origin] + z.scale * root(z, z.weight * X[:, i, i])
        return np.where(X[:, i, i] >= 0, half, z.a.dtype.type(np.nan))

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether the set is within its limits, per run."""
        return (radius <= t.limit).all(axis=1)

    def shape_of_residuals(self, t: PointTables, q: Array, origin: Array, X: Array) -> Array:
        """R, (S, n_y, n_y)."""
        z = t.shape
        Z, a = carried(z, t.C[q], X, z.kr[q], weighted(z.weight, X), z.weight_y, z.rv[q, origin])
        return merged(Z, a, z.V[q, origin])

    def judged(self, t: PointTables, q: Array, origin: Array, X: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside: a bit per output and, with several, one for the set."""
        z, i = t.shape, np.arange(r.shape[1])
        R = self.shape_of_residuals(t, q, origin, X)
        bound = z.scale_y * root(z, z.weight_y * R[:, i, i])
        raw = ~(np.abs(r) <= bound)
        return bound, raw if r.shape[1] == 1 else np.concatenate([raw, ~within(z, R, bound, r)[:, None]], axis=1)
