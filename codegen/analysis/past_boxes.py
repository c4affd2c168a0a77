"""Upper bounds of interval sets and of ellipsoids of least trace along mode sequences, for ``past_sets``.

A box obeys its own recursion, which is monotone. The weight a of an ellipsoid of least trace depends on its size, so
that the shape is not monotone in the one before; but with shapes above and below the firmware's the weight is between
two numbers, and these give shapes above and below the next one. What is known of the start is soon forgotten, and the
two close in on each other. Besides, the weighted trace of the next set is at most ``LOSS`` times the least there is,
however little is known of its shape.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..observers.ellipsoid_trace import root
from .past_sets import OUTWARD
from .past_shapes import Shapes

Array = np.ndarray
#: Over the least trace (``certify.trace_ellipsoids``); rounding of the weight, and of a root that bounds a residual.
LOSS, CLOSE, LONG = 1.0 + 1.0 / 60.0, 1e-4, 1.001


class Widths:
    """The half widths of a box, as the firmware holds them.

    Parameters
    ----------
    t : PointTables
        With a ``BoxTables``.
    """

    def __init__(self, t):
        z = t.shape
        self.P, self.g, self.S, self.rho, self.R = (getattr(z, k).astype(float) for k in ("P", "g", "S", "rho", "R"))
        self.room = 1.0 + (len(self.R) + 2) * float(np.finfo(t.real).eps)
        self.last = self.g.shape[1] - 1

    def first(self, limit: Array) -> Array:
        """No b is larger whose bounds of x are within these half widths."""
        with np.errstate(divide="ignore"):
            return np.min(limit[:, None] / self.R, axis=0)

    def begin(self, b: Array) -> Array:
        """See ``Follower``."""
        return b

    def step(self, b: Array, p: Array, before: Array) -> Array:
        """See ``Follower``."""
        return ((self.P[p] @ b[:, :, None])[:, :, 0] + self.g[p, np.minimum(before, self.last)]) * self.room

    def around(self, b: Array) -> Array:
        """See ``Follower``."""
        return b.max(axis=0)

    def chosen(self, b: Array, at: Array) -> Array:
        """See ``Follower``."""
        return b[at]

    def support(self, b: Array, q: Array, before: Array, D: Array) -> Array:
        """What |d' r| has to exceed for an alarm in modes q, (P, d): each residual is tested alone."""
        bound = (self.S[q] @ b[:, :, None])[:, :, 0] + self.rho[q, np.minimum(before, self.last)]
        return bound @ np.abs(D).T * self.room * OUTWARD


class Traced(Shapes):
    """An ellipsoid of least trace: (shape above the firmware's, shape below, bound of its weighted trace).

    Parameters
    ----------
    t : PointTables
        With a ``TraceTables``.
    """

    def __init__(self, t):
        z = t.shape
        self.M, self.C = t.M.astype(float), t.C.astype(float)
        names = ("weight", "weight_y", "k", "kr", "r", "rv", "slack", "floor", "scale_y")
        self.weight, self.weight_y, self.k, self.kr, self.r, self.rv, self.slack, self.floor, self.scale = (
            getattr(z, name).astype(float) for name in names)
        self.H, self.V = (self._roomy(getattr(z, name).astype(float), t.real) for name in "HV")
        self.own, self.roots = z.V.astype(float), SimpleNamespace(
            **{name: getattr(z, name).astype(float) for name in ("a", "b", "least")})
        self.last = self.H.shape[1] - 1
        s = np.sqrt(self.weight)
        self.carried = np.array([np.linalg.norm(s[:, None] * M / s, 2) ** 2 for M in self.M])
        self.carried += 3.0 * self.k @ self.weight

    def first(self, limit: Array) -> Array:
        """An entry is a shape above all sets and, beneath it, one below: here none."""
        above = super().first(limit)
        return np.concatenate([above, np.zeros_like(above)])

    def begin(self, entry: Array) -> tuple[Array, Array, Array]:
        """See ``Follower``."""
        X, Y = np.split(entry, 2, axis=1)
        return X, Y, np.einsum("pii,i->p", X, self.weight)

    def _sums(self, state: tuple[Array, Array, Array], A: Array, k: Array, weight: Array, S: Array,
              inverse: Array) -> tuple[Array, Array]:
        """Shapes above and below that of ``A E(X) + E(S)``."""
        X, Y, trace = state
        i = np.arange(A.shape[1])
        above, below = (A @ Z @ A.swapaxes(1, 2) for Z in (X, Y))
        above[:, i, i] += 2.0 * k * trace[:, None]  # what is added, and what rounding may add once more
        least, most = (np.einsum("pii,i->p", Z, weight) * inverse for Z in (below, above))
        small = np.sqrt(np.maximum(least, self.roots.least)) * (1.0 - CLOSE)
        large = root(self.roots, most) * (1.0 + CLOSE)
        small, large = small[:, None, None], large[:, None, None]
        return ((1.0 + 1.0 / small) * above + (1.0 + large) * S,
                ((1.0 + 1.0 / large) * below + (1.0 + small) * S) * (1.0 - 10.0 * CLOSE))

    def step(self, state: tuple[Array, Array, Array], p: Array, before: Array) -> tuple[Array, Array, Array]:
        """See ``Follower``."""
        o = np.minimum(before, self.last)
        S = self.H[p, o]
        above, below = self._sums(state, self.M[p], self.k[p], self.weight, S, self.r[p, o])
        added = np.einsum("pii,i->p", S, self.weight)
        trace = LOSS * (np.sqrt(self.carried[p] * state[2]) + np.sqrt(added)) ** 2 * OUTWARD
        trace = np.minimum(trace, np.einsum("pii,i->p", above, self.weight))
        round_one = trace[:, None, None] * np.diag(1.0 / self.weight)  # no set of that trace is outside
        rounder = len(self.weight) * trace < np.einsum("pii,i->p", above, self.weight)
        return np.where(rounder[:, None, None], round_one, above), below, trace

    def around(self, state: tuple[Array, Array, Array]) -> Array:
        """Above, and below: means, scaled until all shapes are between them."""
        n, s = len(self.weight), np.sqrt(self.weight)
        alike = state[1] * s * s[:, None]
        mean = alike.mean(axis=0) + 1e-12 * np.eye(n)
        least = np.linalg.eigvals(np.linalg.solve(mean, alike)).real.min()
        below = mean * max(least - 1e-9, 0.0) * (1.0 - CLOSE) / s / s[:, None]
        return np.concatenate([super().around(state[0]), below])

    def chosen(self, state: tuple[Array, Array, Array], at: Array) -> tuple[Array, Array, Array]:
        """See ``Follower``."""
        return tuple(part[at] for part in state)

    def support(self, state: tuple[Array, Array, Array], q: Array, before: Array, D: Array) -> Array:
        """What |d' r| has to exceed for an alarm in modes q, (P, d); for one and two residuals any d is tested."""
        o = np.minimum(before, self.last)
        R = self._sums(state, self.C[q], self.kr[q], self.weight_y, self.V[q, o], self.rv[q, o])[0]
        diagonal = np.einsum("pii->pi", R)
        roots = np.maximum(np.sqrt(self.weight_y * diagonal), np.sqrt(self.roots.least))
        return self.tested(R, self.scale * roots * LONG, self.own[q, o], D)
