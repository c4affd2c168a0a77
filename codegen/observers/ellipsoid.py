"""Run-time family "ellipsoid": a point observer whose error lies in an ellipsoid, with weights fixed offline.

At sample k, from estimate, shape X, input, output and mode p of sample k-1::

    1  X = (1 + alpha) M_p X M_p' + H_p + rounding              H: disturbance and noise, times 1 + 1/alpha
    2  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    3  R = (1 + beta) C X C' + V + rounding;  alarm where r' R^-1 r > 1, or a residual is beyond its bound
    4  keep x_hat, u, y, mode

Source: Zammali (2020), 6.3.3, Theorem 22, as corrected in ``synthesis``; an outer ellipsoid of a sum for any weights,
so that no square root is needed. The bounds of single residuals and states are tangents of the square root,
``sqrt(X_ii) <= (X_ii / c + c) / 2`` for any c > 0, the smallest of a few. r' R^-1 r <= 1 is decided without a division
for two outputs; for more by directions chosen offline, ``(d' r)^2 <= d' R d``, which never alarm falsely.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointObserver, PointTables, centred, outward_up, plain
from .zonotope import times

Array = np.ndarray


@dataclass(frozen=True)
class EllipsoidTables:
    """The numbers of the error set; N modes, O origins (``PointTables.origins``).

    Parameters
    ----------
    weight : ndarray (n_x,)
        Powers of two that make the trace of X one of states of like size.
    g, gb, gr : ndarray (N,)
        1 + alpha of a measured step, of one without measurement, and 1 + beta of the residual.
    H, Hb : ndarray (N, O, n_x, n_x), V : ndarray (N, O, n_y, n_y)
        What noise adds to each.
    k, kb : ndarray (N, n_x), kr : ndarray (N, n_y)
        What rounding adds to the diagonals, times the weighted trace of X.
    a, b : ndarray (K, n_x), ay, by : ndarray (K, n_y)
        Tangents: the square root of z is at most the smallest a z + b.
    spread : ndarray (O, n_x)
        What the bounds of x have beyond the ellipsoid.
    directions : ndarray (m, n_y)
        For more than two outputs.
    slack, floor : ndarray ()
        Relative and absolute rounding of the membership test.
    """

    weight: Array
    g: Array
    gb: Array
    gr: Array
    H: Array
    Hb: Array
    V: Array
    k: Array
    kb: Array
    kr: Array
    a: Array
    b: Array
    ay: Array
    by: Array
    spread: Array
    directions: Array
    slack: Array
    floor: Array

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> EllipsoidTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        y = sizes[3]
        arrays = {f.name: np.array(data[f.name], dtype=np.float64).astype(real) for f in fields(cls)}
        return cls(**arrays | {"directions": arrays["directions"].reshape(-1, y)})


def shape_of_box(half: Array, dtype) -> Array:
    """Diagonal of the smallest ellipsoid around a box, rounded up: (..., n_x) -> (..., n_x)."""
    return outward_up(np.nextafter(half.shape[-1] * half.astype(np.float64) ** 2, np.inf) * (half > 0), dtype)


def sandwich(g: Array, A: Array, X: Array, H: Array, k: Array, trace: Array) -> Array:
    """Return ``g A X A' + H + diag(k) trace``, symmetric: the C's lower triangle, mirrored.

    Shapes: g (S,), A (S, r, n), X (S, n, n), H (S, r, r), k (S, r), trace (S,).
    """
    Z = times(times(A, X), A.swapaxes(1, 2))
    total = g[:, None, None] * Z + H
    i = np.arange(A.shape[1])
    total[:, i, i] = total[:, i, i] + k * trace[:, None]
    lower = np.tril(total)
    return lower + np.tril(total, -1).swapaxes(1, 2)


def root(z: Array, a: Array, b: Array) -> Array:
    """Upper bound of the square root of z (S, n): the smallest tangent."""
    best = a[0] * z + b[0]
    for j in range(1, len(a)):
        other = a[j] * z + b[j]
        best = np.where(other < best, other, best)
    return best


class EllipsoidObserver(PointObserver):
    """The observer with an ellipsoid; see ``Runner`` for the calls."""

    family = "ellipsoid"
    shape_class = EllipsoidTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Estimate and shape of another initial box; see ``Runner.initial``."""
        if x0_lo is None and x0_hi is None:
            return [None, None]
        ends = [record["ranges"][f"x0_{side}"] if x0 is None else x0 for side, x0 in (("lo", x0_lo), ("hi", x0_hi))]
        centre, half = (np.broadcast_to(a, shape) for a in centred(*ends, dtype))
        X = np.zeros((*shape, shape[1]), dtype=dtype)
        i = np.arange(shape[1])
        X[:, i, i] = shape_of_box(half, dtype)
        return [np.ascontiguousarray(centre), X]

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """The set of a box: half widths (S, n_x) -> shapes (S, n_x, n_x)."""
        X = np.zeros((*half.shape, half.shape[1]), dtype=t.dtype)
        i = np.arange(half.shape[1])
        X[:, i, i] = shape_of_box(half, t.dtype)
        return X

    def trace(self, t: PointTables, X: Array) -> Array:
        """Weighted trace."""
        total = t.shape.weight[0] * X[:, 0, 0]
        for i in range(1, X.shape[1]):
            total = total + t.shape.weight[i] * X[:, i, i]
        return total

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, X: Array, measured: bool) -> Array:
        """The set one step of the modes p later."""
        z = t.shape
        M, g, H, k = (t.M, z.g, z.H, z.k) if measured else (t.A, z.gb, z.Hb, z.kb)
        return sandwich(g[p], M[p], X, H[p, np.minimum(origin, t.origins - 1)], k[p], self.trace(t, X))

    def radius(self, t: PointTables, q: Array, origin: Array, X: Array) -> Array:
        """Half widths of the bounds of x."""
        i = np.arange(X.shape[1])
        return t.shape.spread[origin] + root(X[:, i, i], t.shape.a, t.shape.b)

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether the set is within its limits, and no square below zero (an upset of the memory), per run."""
        return ((radius >= 0) & (radius <= t.limit)).all(axis=1)

    def judged(self, t: PointTables, q: Array, origin: Array, X: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside: a bit per output and, with several, one for the set."""
        z, n_y = t.shape, r.shape[1]
        R = sandwich(z.gr[q], t.C[q], X, z.V[q, origin], z.kr[q], self.trace(t, X))
        i = np.arange(n_y)
        bound = root(R[:, i, i], z.ay, z.by)
        raw = ~(np.abs(r) <= bound)
        return bound, raw if n_y == 1 else np.concatenate([raw, ~within(z, R, bound, r)[:, None]], axis=1)


def within(z, R: Array, bound: Array, r: Array) -> Array:
    """Whether several residuals are in the ellipsoid together, as far as the test can tell; never for NaN.

    Parameters
    ----------
    z : EllipsoidTables
        ``slack``, ``floor`` and ``directions`` are read.
    R : ndarray (S, n_y, n_y), bound : ndarray (S, n_y), r : ndarray (S, n_y)

    Returns
    -------
    inside : ndarray (S,) bool
    """
    n_y = r.shape[1]
    if n_y == 2:
        both = R[:, 0, 0] * R[:, 1, 1]
        most = (both - R[:, 1, 0] * R[:, 1, 0]) + z.slack * both + z.floor * (R[:, 0, 0] + R[:, 1, 1]) + z.floor
        cross = (r[:, 0] * r[:, 1]) * R[:, 1, 0]
        return (r[:, 0] * r[:, 0]) * R[:, 1, 1] - cross - cross + (r[:, 1] * r[:, 1]) * R[:, 0, 0] <= most
    inside = np.ones(len(r), dtype=bool)
    for d in z.directions:
        value, most, size = d[0] * r[:, 0], np.zeros(len(r), R.dtype), np.zeros(len(r), R.dtype)
        for j in range(1, n_y):
            value = value + d[j] * r[:, j]
        for j in range(n_y):
            size = size + np.abs(d[j]) * bound[:, j]
            row = d[0] * R[:, j, 0]
            for h in range(1, n_y):
                row = row + d[h] * R[:, j, h]
            most = most + d[j] * row
        inside &= value * value <= most + z.slack * (size * size) + z.floor
    return inside
