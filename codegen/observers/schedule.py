"""Run-time family "schedule": a point observer whose modes come in a known turn, its residual set a table by sample.

What the residual can be without a fault depends on the mode sequence alone; where that is known, thresholds along it
are a list (``analysis.set_schedule``), exact in the chosen directions, and one counter tells where in the list a sample
is::

    1  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    2  count on; where the mode is not that of the schedule, start anew at the phase at which this mode is entered
    3  alarm where |d_i' r| > h[row, i]

Rows are by sample from the initial box on, by sample and mode wherever the table started anew, and by phase for ever
after either. It starts anew after a reset, a missing sample, a mode out of turn, an upset count, and where the estimate
has left the box that the margins rest on: the rows then hold for every error that is possible. So nothing that the
firmware may meet makes a false alarm, only wider bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointTables, plain
from .thresholds import ThresholdObserver, outside

Array = np.ndarray


@dataclass(frozen=True)
class ScheduleTables:
    """The numbers of the table; N modes, J rows after a start, P samples in a period.

    Parameters
    ----------
    cycle : tuple of int
        Modes of one period.
    entry : tuple of int
        Phase at which each mode is entered; P for one that is not in the schedule.
    rows : int
        J.
    directions : ndarray (m, n_y)
        The coordinates first.
    h : ndarray (J + J N + P, m)
        Bounds of |d' r|: from the initial box, anew by sample and mode, by phase.
    hx : ndarray (J + J N + P, n_x)
        Half widths of the bounds of x.
    """

    cycle: tuple[int, ...]
    entry: tuple[int, ...]
    rows: int
    directions: Array
    h: Array
    hx: Array

    @property
    def settled(self) -> int:
        """Count from which on the phase alone decides."""
        return 2 * self.rows

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)} | {
            "cycle": list(self.cycle), "entry": list(self.entry)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> ScheduleTables:
        """Rebuild from ``to_dict``."""
        arrays = {name: np.array(data[name], dtype=np.float64).astype(real) for name in ("directions", "h", "hx")}
        return cls(cycle=tuple(int(q) for q in data["cycle"]), entry=tuple(int(k) for k in data["entry"]),
                   rows=int(data["rows"]), **arrays)


class ScheduleObserver(ThresholdObserver):
    """The observer with a list; see ``Runner`` for the calls. Its set is the pair (phase, since).

    ``since`` counts 0..J - 1 from the initial box, J..2 J - 1 after a start anew; 2 J: settled.
    """

    family = "schedule"
    shape_class = ScheduleTables

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """Phase 0 for the initial box, none for any other."""
        z = t.shape
        return np.tile([0, 0] if first else [len(z.cycle), z.rows], (len(half), 1))

    def placed(self, t: PointTables, q: Array, at: Array) -> Array:
        """Phase and count at a sample of mode q: anew where it is not the mode of the phase."""
        z, (phase, since) = t.shape, at.T
        cycle, entry = np.array([*z.cycle, -1]), np.array(z.entry)
        there = (cycle[np.minimum(phase, len(z.cycle))] == q) & (since <= z.settled)
        return np.stack([np.where(there, phase, entry[q]), np.where(there, since, z.rows)], axis=1)

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, at: Array, measured: bool) -> Array:
        """Phase and count one sample later, before its mode is looked at (``placed``)."""
        z, (phase, since) = t.shape, self.placed(t, p, at).T
        phase = np.where(phase + 1 == len(z.cycle), 0, phase + 1)
        onward = np.where(since == z.rows - 1, z.settled, np.minimum(since + 1, z.settled))
        return np.stack([phase, onward if measured else np.full_like(since, z.rows)], axis=1)

    def _row(self, t, q, at):
        z, (phase, since) = t.shape, self.placed(t, q, at).T
        anew = z.rows + (since - z.rows) * len(t.A) + q
        return np.where(since < z.rows, since, np.where(since < z.settled, anew, z.rows * (1 + len(t.A)) + phase))

    def radius(self, t: PointTables, q: Array, origin: Array, at: Array) -> Array:
        """Half widths of the bounds of x."""
        return t.shape.hx[self._row(t, q, at)]

    def judged(self, t: PointTables, q: Array, origin: Array, at: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside."""
        return outside(t.shape.directions, t.shape.h[self._row(t, q, at)], r)
