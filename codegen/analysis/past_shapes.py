"""Upper bounds of the sets that the families of point observers carry, for ``past_sets``; rounding included.

A zonotope reduced online: a column that nothing which the set may hold could push out of the ``order - n`` largest is
sure to be kept, and is followed as it is; all others count by their hull, which boxing leaves as it is. An ellipsoid
with fixed weights: the shape is linear in the one before, and monotone. A table by mode and samples since the mode was
entered: its rows, where it is not known when a mode was entered the largest of what they may be.
"""

from __future__ import annotations

import numpy as np

from ..algebra.error_set import of_tables
from .past_sets import OUTWARD

Array = np.ndarray


class Reduced:
    """A zonotope reduced at every sample, as the firmware holds it: (columns that are sure, others, their rounding).

    The others are what has been boxed, moved by a step: one column per state, none smaller than the firmware's.

    Parameters
    ----------
    t : PointTables
        With a ``ZonotopeTables``.
    """

    def __init__(self, t):
        z, n = t.shape, len(t.box)
        self.m = of_tables(t.M, t.C, z.F, z.V)
        self.e, self.rho, self.slack = z.e.astype(float), z.rho.astype(float), float(z.slack)
        weight = z.weight.astype(float)
        self.key, self.root = z.key, np.sqrt(weight) if z.key == "squared" else weight
        self.kept = z.order - n
        self.B = z.B.astype(float) if z.oblique else np.broadcast_to(np.eye(n), self.m.A.shape)
        self.S = z.S.astype(float) if z.oblique else self.m.A
        self.inside = z.inside.astype(float) if z.oblique else np.broadcast_to(self.e, (len(t.A), n))

    def first(self, limit: Array) -> Array:
        """See ``Follower``."""
        return limit

    def begin(self, box: Array) -> tuple[Array, Array, Array]:
        """A set of which nothing but its hull is known."""
        return np.zeros((*box.shape, 0)), box[:, :, None] * np.eye(box.shape[1]), np.zeros_like(box)

    def step(self, state: tuple[Array, Array, Array], p: Array, before: Array) -> tuple[Array, Array, Array]:
        """Select and box, then move; the rounding of a step adds to it at most what ``e`` holds."""
        (K, rest, off), B, M = state, self.B[p], self.m.A[p]
        size = self._size(B @ K)
        at = np.argsort(-size, axis=1, kind="stable")
        K, size = np.take_along_axis(K, at[:, None], axis=2), np.take_along_axis(size, at, axis=1)
        others = np.abs(B @ rest).sum(axis=2)
        slip = (np.abs(B) @ off[:, :, None])[:, :, 0] @ self.root  # keys and columns are rounded
        least = size * 0.999 - 2.0 * slip[:, None]
        known = (size[:, None, :] >= least[:, :, None]).sum(axis=2)  # that may be as large, itself included
        with np.errstate(divide="ignore", over="ignore"):
            unknown = np.where(least > 0, 1.001 * (others @ self.root)[:, None] / np.where(least > 0, least, 1), np.inf)
        sure = (known + np.floor(unknown) <= self.kept)[:, None]
        box = others + np.where(sure, 0.0, np.abs(B @ K)).sum(axis=2) + self.inside[p]
        K = M @ np.where(sure, K, 0.0)[:, :, :self.kept]
        rounded = np.broadcast_to(np.diag(self.e), M.shape)
        off = (np.abs(M) @ off[:, :, None])[:, :, 0] + self.e
        return (np.concatenate([K, self.m.W[before, p]], axis=2),
                np.concatenate([self.S[p] * box[:, None], rounded], axis=2), off)

    def _size(self, Z: Array) -> Array:
        """What columns are selected by, of the first power."""
        weighted = np.abs(Z) * self.root[:, None]
        if self.key == "squared":
            return np.linalg.norm(weighted, axis=1)
        return weighted.sum(axis=1) - weighted.max(axis=1)

    def around(self, state: tuple[Array, Array, Array]) -> Array:
        """See ``Follower``."""
        return (np.abs(state[0]).sum(axis=2) + np.abs(state[1]).sum(axis=2)).max(axis=0)

    def chosen(self, state: tuple[Array, Array, Array], at: Array) -> tuple[Array, Array, Array]:
        """See ``Follower``."""
        return tuple(part[at] for part in state)

    def support(self, state: tuple[Array, Array, Array], q: Array, before: Array, D: Array) -> Array:
        """What |d' r| has to exceed for an alarm in modes q, (P, d)."""
        own = np.eye(D.shape[1])
        h, unit = (self._plain(state, q, before, rows) for rows in (D, own))
        room = self.rho[q] + 2.0 * self.slack * unit
        return (h + room @ np.abs(D).T) * (1.0 + 2.0 * self.slack) * OUTWARD

    def _plain(self, state, q, before, D):
        K, rest, _ = state
        rows = D @ self.m.C[q]
        return (np.abs(rows @ K).sum(axis=2) + np.abs(rows @ rest).sum(axis=2)
                + np.abs(D @ self.m.V[before, q]).sum(axis=2) + self.rho[q] @ np.abs(D).T)


class Shapes:
    """An ellipsoid with fixed weights, as the firmware holds it.

    Parameters
    ----------
    t : PointTables
        With an ``EllipsoidTables``.
    """

    #: Of the emitted shapes, what rounding may add to their diagonals (``certify.ellipsoids.ROOM``).
    ROOM = {"float32": 2.0 ** -15, "float64": 2.0 ** -40}

    def __init__(self, t):
        z = t.shape
        self.M, self.C = t.M.astype(float), t.C.astype(float)
        self.weight = z.weight.astype(float) * (1.0 + 1e-3)
        self.g, self.k, self.gr, self.kr = (getattr(z, name).astype(float) for name in ("g", "k", "gr", "kr"))
        self.H, self.V = (self._roomy(getattr(z, name).astype(float), t.real) for name in "HV")
        self.own = z.V.astype(float)
        self.ay, self.by, self.slack, self.floor = (getattr(z, name).astype(float)
                                                    for name in ("ay", "by", "slack", "floor"))
        self.last = self.H.shape[1] - 1

    def _roomy(self, S: Array, real: str) -> Array:
        i = np.arange(S.shape[-1])
        S = S.copy()
        S[..., i, i] *= 1.0 + self.ROOM[real]
        return S

    def first(self, limit: Array) -> Array:
        """Above every shape whose diagonal is at most the squares of half widths: n times the diagonal of these."""
        return len(limit) * np.diag(limit * limit)

    def begin(self, X: Array) -> Array:
        """See ``Follower``."""
        return X

    def _image(self, g: Array, A: Array, X: Array, S: Array, k: Array) -> Array:
        trace = np.einsum("pii,i->p", X, self.weight)
        out = g[:, None, None] * (A @ X @ A.swapaxes(1, 2)) + S
        i = np.arange(A.shape[1])
        out[:, i, i] += 2.0 * k * trace[:, None]  # what is added, and what rounding may add once more
        return out

    def step(self, X: Array, p: Array, before: Array) -> Array:
        """See ``Follower``."""
        return self._image(self.g[p], self.M[p], X, self.H[p, np.minimum(before, self.last)], self.k[p])

    def around(self, X: Array) -> Array:
        """The mean of the shapes, scaled until it is above each of them."""
        scale = np.sqrt(np.maximum(np.einsum("pii->pi", X).max(axis=0), 1e-300))  # units of the states made alike
        alike = X / scale / scale[:, None]
        mean = alike.mean(axis=0) + 1e-6 * np.eye(len(scale))
        most = np.linalg.eigvals(np.linalg.solve(mean, alike)).real.max()
        return mean * most * (1.0 + 1e-9) * scale * scale[:, None]

    def chosen(self, X: Array, at: Array) -> Array:
        """See ``Follower``."""
        return X[at]

    def support(self, X: Array, q: Array, before: Array, D: Array) -> Array:
        """What |d' r| has to exceed for an alarm in modes q, (P, d); for one and two residuals any d is tested."""
        o = np.minimum(before, self.last)
        R = self._image(self.gr[q], self.C[q], X, self.V[q, o], self.kr[q])
        bound = np.min(self.ay * np.einsum("pii->pi", R)[:, None] + self.by, axis=1) * OUTWARD
        return self.tested(R, bound, self.own[q, o], D)

    def tested(self, R: Array, bound: Array, noise: Array, D: Array) -> Array:
        """The same for shapes R (P, n_y, n_y), bounds of single residuals (P, n_y) and the noise's shapes alone."""
        square, diagonal = np.einsum("di,pij,dj->pd", D, R, D), np.einsum("pii->pi", R)
        if R.shape[1] == 1:
            return bound * np.abs(D[:, 0])
        if R.shape[1] == 2:
            least = np.linalg.det(noise)  # R is above the noise's own shape
            product = diagonal.prod(axis=1)
            room = 2.0 * self.slack * product + 2.0 * self.floor * (1.0 + diagonal.sum(axis=1))
            return np.sqrt(square * (1.0 + room / np.where(least > 0, least, np.nan))[:, None]) * OUTWARD
        room = 2.0 * self.slack * (bound @ np.abs(D).T) ** 2 + 2.0 * self.floor
        alone = np.count_nonzero(D, axis=1) == 1
        single = bound @ np.abs(D).T
        return np.where(alone, single, np.sqrt(square + room)) * OUTWARD


class Rows:
    """A table of thresholds in its settled stages.

    A state is how many samples the mode of the sample before had lasted, at least, and whether that is exact.

    Parameters
    ----------
    t : PointTables
        With a ``ThresholdTables``.
    """

    def __init__(self, t):
        z, n_y = t.shape, t.C.shape[1]
        last = z.hx[[z.anew - 1, -1]].astype(float).max(axis=(0, 1, 2))
        settled = np.all(z.hx.astype(float) <= last, axis=3)[..., None]  # told by the width of the bounds of x
        h = np.where(settled, z.h.astype(float), 0.0).max(axis=0)
        slip = np.finfo(t.real).eps * (n_y + 2) * (h[..., :n_y] @ np.abs(z.directions.astype(float)).T)
        self.h = (h + slip) * OUTWARD  # d' r itself is rounded by the firmware
        self.later = np.maximum.accumulate(self.h[:, ::-1], axis=1)[:, ::-1]

    def first(self, limit: Array) -> Array:
        """See ``Follower``."""
        return limit * 0.0

    def begin(self, entry: Array) -> tuple[Array, Array]:
        """See ``Follower``: nothing is known."""
        return np.zeros(len(entry), dtype=int), np.zeros(len(entry), dtype=bool)

    def _now(self, state: tuple[Array, Array], q: Array, before: Array) -> tuple[Array, Array]:
        return np.where(q == before, state[0] + 1, 0), state[1] | (q != before)

    def step(self, state: tuple[Array, Array], p: Array, before: Array) -> tuple[Array, Array]:
        """See ``Follower``."""
        return self._now(state, p, before)

    def around(self, state: tuple[Array, Array]) -> Array:
        """See ``Follower``: the table needs none."""
        return np.zeros(1)

    def chosen(self, state: tuple[Array, Array], at: Array) -> tuple[Array, Array]:
        """See ``Follower``."""
        return state[0][at], state[1][at]

    def support(self, state: tuple[Array, Array], q: Array, before: Array, D: Array) -> Array:
        """The thresholds of the table, whose directions D are, (P, d)."""
        since, exact = self._now(state, q, before)
        row = np.minimum(since, self.h.shape[1] - 1)
        return np.where(exact[:, None], self.h[q, row], self.later[q, row])
