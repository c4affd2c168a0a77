"""Run-time family "guided": framers in the mode that an estimator by sliding modes decides for.

The estimator (``sliding``) decides for one mode at every sample, and has a pair of bounds that is right while its
decision is. One pair of framers, as they are where the mode is told (``tnl``; N = 0 for the classical observer), runs
beside it:

1. where the estimator's bounds are the declared range (from a detection until its decision is taken up, after an alarm,
   a reset, a missing sample) the framers start there;
2. else they move by the step of the mode that is decided for, which is that of the last sample, and are cut to the
   estimator's bounds;
   In other coordinates they carry z = Z x beside x (``changed``), which starts from what Z makes of x and is cut to it;
3. what they expect of y is the residual interval; zero outside it, or crossed bounds, sets a bit of the alarm.

So where no fault acts and the decision has been the true mode since it was taken up, the framers hold the state: they
start from what holds it, the step of the true mode carries it, the bounds that they are cut to hold it. Nothing is
known of the decision, so ``assured`` is never set, and a bit other than the estimator's own is a fault or a decision
that is not right (yet). An alarm begins everything anew, the estimator too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .changed import blind_step, measured_step, turned
from .framer import FramerTables, residuals
from .sliding import SlidingObserver
from .sliding_tables import SlidingTables
from .told import Told, behind

Array = np.ndarray


@dataclass(frozen=True)
class GuidedTables(Told, SlidingTables):
    """Constants of the estimator, and of the framers that it guides.

    Parameters
    ----------
    told : FramerTables
        Of the observer that is told its mode.
    """

    told: FramerTables | None = None

    @property
    def vary(self):
        """Parameters of the framers, if any are measured: the C reads them."""
        return self.told.vary if self.told.vary is not None and self.told.vary.parameters else None

    @property
    def clamp(self) -> bool:
        """Whether the framers are cut to the declared ranges."""
        return self.told.clamp

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> GuidedTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``SlidingTables``."""
        own = SlidingTables.from_dict(data, sizes)
        return behind(cls, own, told=FramerTables.from_dict(data["told"], own.sizes))


class GuidedObserver(SlidingObserver):
    """The framers among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "guided"
    tables_class = GuidedTables

    def bits(self, t: GuidedTables) -> int:
        """Alarm bits: the estimator's, one per output, crossed bounds."""
        return t.sizes[3] + 2

    def start(self, t: GuidedTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``); framers start from the declared range."""
        super().start(t, runs, x0_lo, x0_hi)
        _, n, n_u, p = t.sizes
        self.frame = [np.zeros((runs, n), t.dtype) for _ in range(2)]
        self.frame_z = None if t.told.change is None else tuple(self.frame)
        self.before = [np.zeros((runs, count), t.dtype) for count in (n_u, p, t.vary.parameters if t.vary else 0)]

    def _answered(self, t: GuidedTables, step: Array, kept: Array, answer, u: Array, y: Array, theta: Array, r):
        """Bounds, residuals and alarm bits of the framers."""
        (shown, decided), (*last, before) = answer, self.before
        between = (before + theta) * t.dtype.type(0.5) if t.vary and t.vary.midpoint else before
        moved, z = measured_step(t.told, decided, self.frame, self.frame_z, *last, y, between, theta - before)
        blind, blind_z = blind_step(t.told, decided, self.frame, self.before[0])
        lo, hi = (np.where(step[:, None], a, b) for a, b in zip(moved, blind))
        lo, hi = np.where(lo > shown[0], lo, shown[0]), np.where(hi < shown[1], hi, shown[1])
        self.frame = [np.where(kept[:, None], a, b) for a, b in zip((lo, hi), shown)]
        self.before = [u, y, theta]
        r_lo, r_hi = residuals(t.told, decided, *self.frame, u, y)
        crossed = (self.frame[0] > self.frame[1]).any(axis=1)
        if z is not None:
            z = tuple(np.where(step[:, None], a, b) for a, b in zip(z, blind_z))
            self.frame_z = turned(t.told, kept, self.frame, z)
            crossed = crossed | (self.frame_z[0] > self.frame_z[1]).any(axis=1)
        return self.frame, (r_lo, r_hi), np.column_stack([(r_lo > 0) | (r_hi < 0), crossed])
