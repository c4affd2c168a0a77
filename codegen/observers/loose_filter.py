"""A filter per mode that starts at run time: its constants, and thresholds by how it started and how long ago.

Beside ``filter``, whose table is of all mode sequences, each filter here is of one mode that stays. At a start the
plant is in a box with centre x and half widths d, and the filter's state is E x, as if it had followed the plant::

    1  f_hat = Du u + Dy y + K xi,   without a fault |f_hat| <= h[stage, since >> shift, q]
    2  xi+   = G u + L y + M xi
    3  stage: the smallest of the listed sizes that holds d; the last one is of a filter that goes on from any state
       within its limits, the plant anywhere in its declared range
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .framer import add_terms
from .point import plain

Array = np.ndarray


@dataclass(frozen=True)
class LooseFilter:
    """The numbers of the filters; N modes, Z sizes of a start.

    Parameters
    ----------
    real : {"float32", "float64"}
    M : ndarray (N, n_s, n_s), G : ndarray (N, n_s, n_u), L : ndarray (N, n_s, n_y)
        The step of the filter.
    K : ndarray (N, n_f, n_s), Du : ndarray (N, n_f, n_u), Dy : ndarray (N, n_f, n_y)
        The estimate.
    E : ndarray (N, n_s, n_x)
        State at a start, of x.
    sizes : ndarray (Z, n_x)
        Half widths of starts, the largest first, which is the declared range.
    h : ndarray (Z + 1, R, N, n_f)
        Bounds of |f_hat| without a fault, by size, samples since the start (the last row for all later) and mode; the
        last part from anywhere.
    shift : int
        A row holds for 2^shift samples.
    limit : ndarray (n_s,)
        Beyond it the state of a filter is put to zero.
    grow, floor : ndarray ()
        A half width as computed, times the first and plus the second, is at least the half width.
    x_lo, x_hi : ndarray (n_x,)
        Declared range.
    u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    """

    real: str
    M: Array
    G: Array
    L: Array
    K: Array
    Du: Array
    Dy: Array
    E: Array
    sizes: Array
    h: Array
    shift: int
    limit: Array
    grow: Array
    floor: Array
    x_lo: Array
    x_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array

    #: No parameters, no other coordinates (``FramerTables``).
    vary = change = None

    @property
    def box(self) -> Array:
        """Bounds of x: the declared range."""
        return self.x_hi

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def anywhere(self) -> int:
        """The stage of a filter that goes on from anywhere."""
        return len(self.sizes)

    @property
    def last(self) -> int:
        """Where the count of samples stops."""
        return (self.h.shape[1] - 1) << self.shift

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> LooseFilter:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        n, x, u, y = sizes
        s, f = len(data["limit"]), len(data["K"][0])
        shapes = {"M": (n, s, s), "G": (n, s, u), "L": (n, s, y), "K": (n, f, s), "Du": (n, f, u), "Dy": (n, f, y),
                  "E": (n, s, x), "sizes": (-1, x), "h": (len(data["h"]), -1, n, f), "limit": (s,), "grow": (),
                  "floor": (), "x_lo": (x,), "x_hi": (x,), "u_lo": (u,), "u_hi": (u,), "y_lo": (y,), "y_hi": (y,)}
        arrays = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(data["real"]) for k, s in shapes.items()}
        return cls(real=data["real"], shift=int(data["shift"]), **arrays)

    def estimates(self, xi: Array, u: Array, y: Array) -> Array:
        """What the filters of all modes estimate: (S, N, n_s), (S, n_u), (S, n_y) -> (S, N, n_f)."""
        return self._of("Du", "Dy", "K", xi, u, y)

    def moved(self, xi: Array, u: Array, y: Array) -> Array:
        """Their states a sample later, (S, N, n_s)."""
        return self._of("G", "L", "M", xi, u, y)

    def _of(self, of_u: str, of_y: str, of_xi: str, xi: Array, u: Array, y: Array) -> Array:
        out = []
        for q in range(len(self.M)):
            every = np.full(len(u), q)
            total = np.zeros((len(u), getattr(self, of_u).shape[1]), self.dtype)
            for name, values in ((of_u, u), (of_y, y), (of_xi, xi[:, q])):
                total = add_terms(total, getattr(self, name)[every], values)
            out.append(total)
        return np.stack(out, axis=1)

    def bounds(self, stage: Array, since: Array) -> Array:
        """Bounds of the estimates without a fault: (S, N), (S, N) -> (S, N, n_f)."""
        return self.h[stage, since >> self.shift, np.arange(len(self.M))]

    def started(self, lo: Array, hi: Array) -> tuple[Array, Array]:
        """State and stage of filters of all modes from bounds of x (S, N, n_x), cut to the declared range.

        Returns
        -------
        xi : ndarray (S, N, n_s)
        stage : ndarray (S, N) int
        """
        lo, hi = (np.where(b < self.x_lo, self.x_lo, np.where(b > self.x_hi, self.x_hi, b)) for b in (lo, hi))
        two = self.dtype.type(0.5)
        x = two * lo + two * hi
        half, below = hi - x, x - lo
        half = np.where(below > half, below, half) * self.grow + self.floor
        held = (half[:, :, None] <= self.sizes).all(axis=3)
        held[:, :, 0] = True  # none is larger than the declared range
        stage = len(self.sizes) - 1 - np.argmax(held[:, :, ::-1], axis=2)
        xi = np.zeros((*x.shape[:2], len(self.limit)), self.dtype)
        for k in range(x.shape[2]):
            xi = xi + self.E[:, :, k] * x[:, :, k, None]
        return xi, stage
