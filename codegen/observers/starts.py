"""Error set of a point observer that runs in one mode at a time: a table by size of the start and samples since.

It is started from a box of half widths that are known at run time only, in one mode, and started again where the mode
may be another (``follower``). So what its error and its residual can be depends on where it started, on the mode and on
how long ago that was; no dwell time is needed::

    1  a start of half widths d: the smallest of the listed sizes that holds d, the last row of sizes where none does
    2  |x - x_hat| <= hx[size, q, since],  alarm where |d_i' r| > h[size, q, since, i]

The last size holds every error that is possible while x and the estimate are in their boxes: after a missing sample,
and where the estimate has left its box.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointTables, plain
from .thresholds import ThresholdObserver

Array = np.ndarray


@dataclass(frozen=True)
class StartTables:
    """The numbers of the table; N modes, K sizes.

    Parameters
    ----------
    sizes : ndarray (K, n_x)
        Half widths of starts, the largest first.
    directions : ndarray (m, n_y)
        The coordinates first.
    h : ndarray (K + 1, N, J + 1, m)
        Bounds of |d' r|, by size, mode and samples since the start (the last for all later).
    hx : ndarray (K + 1, N, J + 1, n_x)
        Half widths of the bounds of x.
    """

    sizes: Array
    directions: Array
    h: Array
    hx: Array

    @property
    def anew(self) -> int:
        """Index of every error that is possible."""
        return len(self.sizes)

    @property
    def cap(self) -> int:
        """Where the count of samples stops."""
        return self.h.shape[2] - 1

    def to_dict(self) -> dict:
        """Return plain lists for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> StartTables:
        """Rebuild from ``to_dict``."""
        return cls(**{f.name: np.array(data[f.name], dtype=np.float64).astype(real) for f in fields(cls)})


class StartObserver(ThresholdObserver):
    """Arithmetic of such a set, which is the pair (size, since); it runs inside of ``follower`` alone."""

    family = "starts"
    shape_class = StartTables

    def begun(self, t: PointTables, half: Array) -> Array:
        """The set of a start from boxes of half widths (S, n_x)."""
        z = t.shape
        held = (half[:, None] <= z.sizes).all(axis=2)
        last = len(z.sizes) - 1 - np.argmax(held[:, ::-1], axis=1)
        return np.stack([np.where(held.any(axis=1), last, z.anew), np.zeros(len(half), dtype=int)], axis=1)

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, at: Array, measured: bool) -> Array:
        """Size and count one sample later, in the same mode."""
        if not measured:
            return self.whole(t, np.zeros((len(p), len(t.box))))
        size, since = at.T
        return np.stack([size, np.minimum(since + 1, t.shape.cap)], axis=1)
