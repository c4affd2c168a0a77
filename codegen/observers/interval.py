"""Run-time family "interval": the classical fault-detection interval observer.

At sample k, from the framers predicted for it::

    1  r = C x + D u + Dv v - y over the box      residual bounds, alarms
    2  x+ = M x + G u + L y + d                   framers for sample k+1, M = A - L C >= 0

Source: Zammali (2020), Theorem 13, (5.2), with the noise signs of asymmetric bounds corrected (see
``synthesis``). The state of the firmware is the pair of framers and the supervisor's counters. With a change of
coordinates z = Z x (Lamouchi (2016), section 4) it holds the framers of z too: step 2 moves these, those of x follow
from them; after init, a reset, a restart and a prediction it is the other way round.
"""

from __future__ import annotations

import numpy as np

from .coordinates import Coordinates
from .framer import FramerTables, open_loop, propagate, residuals, to_x, to_z
from .runner import Runner, outward, pack
from .supervisor import SupervisorState, judge, undisturbed, watch_dwell
from .trace import Trace

Array = np.ndarray


class IntervalObserver(Runner):
    """The observer as the firmware runs it, on S independent runs at once; see ``Runner`` for the calls.

    Parameters
    ----------
    tables : dict
        "float32" and "float64" -> FramerTables.
    supervision : Supervision
    """

    family = "interval"
    tables_class = FramerTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape, record, dtype):
        """As of every family; where the coordinates are changed also the box of z = Z x that belongs to one of x."""
        boxes = super().initial(x0_lo, x0_hi, shape, record, dtype)
        if "change" not in record:
            return boxes
        if boxes[0] is None and boxes[1] is None:
            return [*boxes, None, None]
        ends = [np.broadcast_to(np.array(record["ranges"][name], dtype), shape) if box is None else box
                for name, box in zip(("x0_lo", "x0_hi"), boxes)]
        z = to_z(Coordinates.from_dict(record["change"], np.dtype(dtype).name), *ends)
        return [*boxes, *map(np.ascontiguousarray, z)]

    # -- one sample ----------------------------------------------------------------------------
    def start(self, t: FramerTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None):
        """Set the framers of all runs to the initial box (``<p>_init``)."""
        self._fill(t, runs, t.x0_lo if x0_lo is None else outward(x0_lo, t.dtype, -np.inf),
                   t.x0_hi if x0_hi is None else outward(x0_hi, t.dtype, np.inf))

    def _fill(self, t, runs, lo, hi):
        n_bits = t.C.shape[1] + (0 if t.shared else 1)
        self.lo = np.broadcast_to(lo, (runs, len(t.box))).astype(t.dtype)
        self.hi = np.broadcast_to(hi, (runs, len(t.box))).astype(t.dtype)
        self.guard = SupervisorState(runs, n_bits, t.M_hi.shape[0])
        if t.change is not None:
            self.z = to_z(t.change, self.lo, self.hi)

    def _arrive(self, t, measured, y, theta, q):
        """Framers at this sample, per run with or without a measurement."""
        return self.lo, self.hi

    def _leave(self, t, on, measured, again, lo, hi, u, y, q, theta):
        """Store what the next sample needs, for the runs in ``on``."""
        z = None if t.change is None else self.z
        after = propagate(t, q, lo, hi, u, y, np.zeros_like(y), theta, z=z)
        next_lo, next_hi = after if z is None else to_x(t, *after)
        blind_lo, blind_hi = open_loop(t, q, lo, hi, u)
        self._keep(t, on, again, np.where(measured[:, None], next_lo, blind_lo),
                   np.where(measured[:, None], next_hi, blind_hi))
        if z is not None:
            moved, on = (measured & ~again)[:, None], on[:, None]
            self.z = tuple(np.where(on, np.where(moved, a, b), old)
                           for a, b, old in zip(after, to_z(t.change, self.lo, self.hi), z))

    def _keep(self, t, on, again, lo, hi):
        lo, hi = np.where(again[:, None], t.x_lo, lo), np.where(again[:, None], t.x_hi, hi)
        self.lo, self.hi = np.where(on[:, None], lo, self.lo), np.where(on[:, None], hi, self.hi)

    def sample(self, t: FramerTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: Trace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        lo, hi = self._arrive(t, measured, y, theta, q)
        r_lo, r_hi = residuals(t, q, lo, hi, u, y)
        raw = (r_lo > 0) | (r_hi < 0)
        if not t.shared:
            raw = np.concatenate([raw, (lo > hi).any(axis=1)[:, None]], axis=1)
        watch_dwell(self.supervision, self.guard, on, q, t.M_hi.shape[0])
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw)
        blind = undisturbed(self.supervision, self.guard)
        again = again & measured
        self._leave(t, on, measured, again, lo, hi, u, y, q, theta)
        seen = on & measured
        out.x_lo[on], out.x_hi[on] = lo[on], hi[on]
        out.r_lo[seen], out.r_hi[seen] = r_lo[seen], r_hi[seen]
        out.raw_bits[seen] = pack(raw)[seen]
        out.alarm_bits[seen] = pack(alarm)[seen]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[seen] = alarm[seen].any(axis=1)
        out.assured[on] = np.where(measured, assured, blind)[on]

    def reset(self, t: FramerTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        old_lo, old_hi, old, old_z = self.lo, self.hi, self.guard, getattr(self, "z", ())
        self._fill(t, len(on), t.x_lo, t.x_hi)
        self.lo = np.where(on[:, None], self.lo, old_lo)
        self.hi = np.where(on[:, None], self.hi, old_hi)
        if old_z:
            self.z = tuple(np.where(on[:, None], new, old) for new, old in zip(self.z, old_z))
        for name, value in vars(old).items():
            fresh = getattr(self.guard, name)
            mask = on if value.ndim == 1 else on[:, None]
            setattr(self.guard, name, np.where(mask, fresh, value))
