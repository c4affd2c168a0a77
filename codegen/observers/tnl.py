"""Run-time family "tnl": the interval observer with the extra gain N on the new measurement.

At sample k, from the framers, input, output and mode p of sample k-1::

    1  x = M_p x- + G_p u- + L_p y- + N_p y + d_p      M = T A - L C >= 0,  T + N C = I,  G = T B
    2  r = C x + Dv v - y over the box                 residual bounds, alarms
    3  keep x, u, y, mode, theta

Source: Zammali (2020), Theorem 15, (5.23). The printed ``x_k = xi_k + N_q y_k`` must use the N of the mode that
produced xi_k, i.e. of sample k-1, which is why the firmware keeps its last mode. Keeping u and y too (the
printed form keeps xi instead) costs n_u + n_y words and lets a missing measurement be bridged by an
open-loop prediction: x_k could not be recovered from xi_k without y_k.
"""

from __future__ import annotations

import numpy as np

from .framer import open_loop, propagate
from .interval import IntervalObserver

FRESH, BLIND, FULL = 0, 1, 2  # what is kept of the last sample: the box for this one; no y; all


class TnlObserver(IntervalObserver):
    """The TNL observer as the firmware runs it; see ``IntervalObserver`` for the calls."""

    family = "tnl"

    def _fill(self, t, runs, lo, hi):
        super()._fill(t, runs, lo, hi)
        self.u = np.zeros((runs, t.G_hi.shape[2]), dtype=t.dtype)
        self.y = np.zeros((runs, t.C.shape[1]), dtype=t.dtype)
        self.theta = np.zeros((runs, 0 if t.vary is None else t.vary.parameters), dtype=t.dtype)
        self.phase = np.full(runs, FRESH)

    def _arrive(self, t, measured, y, theta, q):
        p = np.minimum(self.guard.mode, t.M_hi.shape[0] - 1)  # only read where a mode has been seen
        lo, hi = self._moved(t, measured, y, theta, p)
        if t.vary is not None and t.vary.late:  # the step may have been one of the mode that is told only now
            other_lo, other_hi = self._moved(t, measured, y, theta, q)
            lo, hi = np.minimum(lo, other_lo), np.maximum(hi, other_hi)
        fresh = (self.phase == FRESH)[:, None]
        return np.where(fresh, self.lo, lo), np.where(fresh, self.hi, hi)

    def _moved(self, t, measured, y, theta, p):
        """Framers after a step of mode p."""
        step = self.theta
        if t.vary is not None and t.vary.midpoint:
            step = (self.theta + theta) * t.dtype.type(0.5)
        corrected = propagate(t, p, self.lo, self.hi, self.u, self.y, y, step,
                              change=theta - self.theta)
        blind = open_loop(t, p, self.lo, self.hi, self.u)
        full = ((self.phase == FULL) & measured)[:, None]
        return tuple(np.where(full, c, b) for c, b in zip(corrected, blind))

    def _leave(self, t, on, measured, again, lo, hi, u, y, q, theta):
        self._keep(t, on, again, lo, hi)
        self.u = np.where(on[:, None], u, self.u)
        self.y = np.where((on & measured)[:, None], y, self.y)
        self.theta = np.where((on & measured)[:, None], theta, self.theta)
        self.phase = np.where(on, np.where(again, FRESH, np.where(measured, FULL, BLIND)), self.phase)

    def reset(self, t, on):
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        u, y, theta, phase = self.u, self.y, self.theta, self.phase
        super().reset(t, on)
        self.u = np.where(on[:, None], self.u, u)
        self.y = np.where(on[:, None], self.y, y)
        self.theta = np.where(on[:, None], self.theta, theta)
        self.phase = np.where(on, self.phase, phase)
