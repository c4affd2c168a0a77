"""Run-time family "thresholds": a point observer whose residual set is a table, with no set arithmetic at run time.

What the residual can be without a fault depends on the mode sequence alone. In fixed directions d_i its bounds are
tabulated by stage, mode and samples since the mode was entered (``analysis.set_tables``)::

    1  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    2  count: the same mode again, or another one after at least the dwell time, or a start
    3  alarm where |d_i' r| > h[stage, q, since, i]

There are two rows of stages, one from the initial box and one from anywhere: after a reset, a missing sample, a mode
that has lasted less than the dwell time, and where the estimate has left the box that the margins rest on. A switch
leads to the next stage of its row, and the last stage of either holds for ever. So nothing that the firmware may meet
makes a false alarm, only wider bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointObserver, PointTables, plain

Array = np.ndarray


@dataclass(frozen=True)
class ThresholdTables:
    """The numbers of the table; N modes.

    Parameters
    ----------
    dwell : int
        Samples that a mode lasts at least (1: any sequence).
    anew : int
        First stage of those from anywhere; the stages before are those from the initial box.
    directions : ndarray (m, n_y)
        The coordinates first.
    h : ndarray (S, N, J + 1, m)
        Bounds of |d' r|, by stage, mode and samples since the mode was entered (the last for all later).
    hx : ndarray (S, N, J + 1, n_x)
        Half widths of the bounds of x.
    """

    dwell: int
    anew: int
    directions: Array
    h: Array
    hx: Array

    @property
    def cap(self) -> int:
        """Where the count of samples stops: beyond the table and the dwell time alike."""
        return max(self.h.shape[2] - 1, self.dwell)

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> ThresholdTables:
        """Rebuild from ``to_dict``."""
        arrays = {name: np.array(data[name], dtype=np.float64).astype(real) for name in ("directions", "h", "hx")}
        return cls(dwell=int(data["dwell"]), anew=int(data["anew"]), **arrays)


class ThresholdObserver(PointObserver):
    """The observer with a table; see ``Runner`` for the calls. Its set is the pair (stage, since)."""

    family = "thresholds"
    shape_class = ThresholdTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Nothing: see ``start``."""
        refuse(x0_lo, x0_hi)
        return [None]

    def start(self, t: PointTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None):
        """Set all runs to the initial box (``<p>_init``).

        Raises
        ------
        ValueError
            Another initial box than the plant file's, for which the table holds.
        """
        refuse(x0_lo, x0_hi)
        super().start(t, runs)

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """Stage 0 for the initial box, the first of the others for any other."""
        return np.tile([0 if first else t.shape.anew, 0], (len(half), 1))

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, at: Array, measured: bool) -> Array:
        """Stage and count one sample later: of mode q, after one of mode p."""
        if not measured:
            return np.tile([t.shape.anew, 0], (len(p), 1))
        z, (stage, since) = t.shape, at.T
        onward = np.minimum(stage + 1, np.where(stage < z.anew, z.anew, len(z.h)) - 1)
        entered = np.where(since + 1 >= z.dwell, onward, z.anew)
        same = q == p
        return np.stack([np.where(same, stage, entered), np.where(same, np.minimum(since + 1, z.cap), 0)], axis=1)

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether the estimate is inside the box that the margins rest on, per run."""
        return ((x > -t.box) & (x < t.box)).all(axis=1)

    def _row(self, t, q, at):
        return at[:, 0], q, np.minimum(at[:, 1], t.shape.h.shape[2] - 1)

    def radius(self, t: PointTables, q: Array, origin: Array, at: Array) -> Array:
        """Half widths of the bounds of x."""
        return t.shape.hx[self._row(t, q, at)]

    def judged(self, t: PointTables, q: Array, origin: Array, at: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside: a bit per output and, with several, one for the others."""
        return outside(t.shape.directions, t.shape.h[self._row(t, q, at)], r)


def outside(directions: Array, h: Array, r: Array) -> tuple[Array, Array]:
    """Compare residuals with bounds of |d' r| in directions of which the first are the coordinates.

    Parameters
    ----------
    directions : ndarray (m, n_y)
    h : ndarray (S, m)
    r : ndarray (S, n_y)

    Returns
    -------
    bound : ndarray (S, n_y)
        Of each residual.
    raw : ndarray (S, n_y) or (S, n_y + 1) bool
        What is outside: a bit per output and, with several, one for the others.
    """
    n_y = r.shape[1]
    raw = ~(np.abs(r) <= h[:, :n_y])
    if n_y == 1:
        return h[:, :1], raw
    others = np.zeros(len(r), dtype=bool)
    for i in range(n_y, len(directions)):
        value = directions[i, 0] * r[:, 0]
        for j in range(1, n_y):
            value = value + directions[i, j] * r[:, j]
        others |= ~(np.abs(value) <= h[:, i])
    return h[:, :n_y], np.concatenate([raw, others[:, None]], axis=1)


def refuse(x0_lo, x0_hi) -> None:
    """Refuse another initial box.

    Raises
    ------
    ValueError
    """
    if x0_lo is not None or x0_hi is not None:
        raise ValueError("x0_lo, x0_hi: given (expected none: the table of thresholds holds for the initial box of the "
                         'plant file; use tables = "none").')
