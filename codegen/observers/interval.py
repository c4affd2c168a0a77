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

from .framer import FramerTables, open_loop, propagate, residuals, to_x, to_z
from .supervisor import (
    BAD_INPUT,
    BAD_MODE,
    BAD_OUTPUT,
    BAD_PARAMETER,
    OK,
    Supervision,
    SupervisorState,
    judge,
    undisturbed,
    watch_dwell,
)
from .trace import Trace

Array = np.ndarray


class IntervalObserver:
    """The observer as the firmware runs it, on S independent runs at once.

    Parameters
    ----------
    tables : dict
        "float32" and "float64" -> FramerTables.
    supervision : Supervision
    """

    family = "interval"

    def __init__(self, tables: dict[str, FramerTables], supervision: Supervision):
        self.tables = tables
        self.supervision = supervision

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

    # -- many samples --------------------------------------------------------------------------
    def run(self, u, y, q=None, theta=None, real="float32", x0_lo=None, x0_hi=None) -> Trace:
        """Run over K samples, exactly as the compiled C does.

        Parameters
        ----------
        u : ndarray (K, n_u), y : ndarray (K, n_y)
            A row of y with a NaN in it is a missing measurement (``<p>_predict``).
        q : ndarray (K,) int, optional
            Active mode, default 0.
        theta : ndarray (K, n_theta), optional
            Parameters, of which the measured ones are read (or these alone); needed where the tables have some.
        real : {"float32", "float64"}
        x0_lo, x0_hi : ndarray (n_x,), optional
            Another initial box than the plant file's.

        Returns
        -------
        Trace
        """
        y = np.asarray(y)
        q = np.zeros(len(y), dtype=np.int64) if q is None else np.asarray(q)
        theta = None if theta is None else np.asarray(theta)[None]
        return self.run_many(np.asarray(u)[None], y[None], q[None], real, x0_lo, x0_hi, theta).row(0)

    def run_many(self, u, y, q, real="float32", x0_lo=None, x0_hi=None, theta=None) -> Trace:
        """As ``run`` for S runs at once: u (S, K, n_u), y (S, K, n_y), q (S, K), theta (S, K, J)."""
        t = self.tables[real]
        u, y, q = np.asarray(u).astype(t.dtype), np.asarray(y).astype(t.dtype), np.asarray(q)
        theta = np.empty((*q.shape, 0)) if t.vary is None or theta is None else t.vary.read(np.asarray(theta))
        theta = theta.astype(t.dtype)
        runs, steps = q.shape
        trace = Trace.empty((runs, steps), len(t.box), t.C.shape[1], t.dtype)
        self.start(t, runs, x0_lo, x0_hi)
        for k in range(steps):
            self._one(t, u[:, k], y[:, k], q[:, k], theta[:, k], trace.row((slice(None), k)))
        return trace

    def _one(self, t, u, y, q, theta, out):
        """Check the inputs as the C does, then do what the header tells firmware to do on an error."""
        missing = np.isnan(y).any(axis=1)
        bad_mode = (q < 0) | (q >= t.M_hi.shape[0])
        bad_u = ~((u >= t.u_lo) & (u <= t.u_hi)).all(axis=1)
        bad_y = ~((y >= t.y_lo) & (y <= t.y_hi)).all(axis=1) & ~missing
        safe_theta = theta
        if t.vary is not None and t.vary.parameters:
            lo, hi = (b[np.where(bad_mode, 0, q)] for b in (t.vary.theta_lo, t.vary.theta_hi))
            bad_theta = ~((theta >= lo) & (theta <= hi)).all(axis=1)
            safe_theta = np.where(bad_theta[:, None], lo, theta)
        else:
            bad_theta = np.zeros(len(q), dtype=bool)
        status = np.where(bad_mode, BAD_MODE, np.where(bad_u, BAD_INPUT, np.where(
            bad_theta, BAD_PARAMETER, np.where(bad_y, BAD_OUTPUT, OK))))
        on = ~(bad_mode | bad_u | bad_theta)
        measured = on & ~bad_y & ~missing
        # Rows that are refused are computed with harmless numbers and then thrown away.
        safe_u, safe_y = np.where(on[:, None], u, t.u_lo), np.where(measured[:, None], y, t.y_lo)
        self.sample(t, on, measured, safe_u, safe_y, np.where(on, q, 0), safe_theta, out)
        if not on.all():
            self.reset(t, ~on)
        out.status[...] = status


def pack(bits: Array) -> Array:
    """Bits (S, n) to words (S,), bit j the column j."""
    return (bits.astype(np.uint32) << np.arange(bits.shape[1], dtype=np.uint32)).sum(axis=1, dtype=np.uint32)


def outward(x: Array, dtype, direction: float) -> Array:
    """Round to ``dtype`` towards ``direction`` (-inf or inf)."""
    x = np.asarray(x, dtype=np.float64)
    y = x.astype(dtype)
    wrong = (y.astype(np.float64) > x) if direction < 0 else (y.astype(np.float64) < x)
    return np.where(wrong, np.nextafter(y, np.array(direction, dtype=dtype)), y).astype(dtype)
