"""Run-time family "guided_filter": a filter that estimates faults, in the mode that sliding modes decide for.

The estimator (``sliding``) decides for one mode at every sample. One filter (``loose_filter``) runs beside it:

1. where the estimator's bounds are the declared range (from a detection until its decision is taken up, after an alarm,
   a reset, a missing sample) the filter of the mode that is decided for starts there, with the thresholds of a start;
2. else it goes on, in the same mode as at the last sample, with the thresholds of one sample more;
3. an estimate beyond its threshold sets a bit of the alarm. A state beyond its limits is put to zero, and the filter
   goes on with the thresholds from anywhere.

So where no fault acts and the decision has been the true mode since it was taken up, no estimate is beyond its bound:
plant and filter are in the set behind it at the start, and a step of the true mode keeps them there. Nothing is known
of the decision, so ``assured`` is never set, and a bit other than the estimator's own is a fault or a decision that is
not right (yet). The estimate goes on while an alarm lasts, until everything begins anew as in every family.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .loose_filter import LooseFilter
from .sliding import SlidingObserver, SlidingTrace
from .sliding_tables import SlidingTables
from .told import FaultAnswers, FaultObserver, Told, behind

Array = np.ndarray


@dataclass(frozen=True)
class GuidedFilterTables(Told, SlidingTables):
    """Constants of the estimator, and of the filters that it guides.

    Parameters
    ----------
    told : LooseFilter
    """

    told: LooseFilter | None = None

    @property
    def begun(self) -> Array:
        """States of the filters at a start from the declared range (N, n_s)."""
        lo, hi = (np.broadcast_to(end, (1, *self.d_lo.shape)) for end in (self.x_lo, self.x_hi))
        return self.told.started(lo, hi)[0][0]

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> GuidedFilterTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``SlidingTables``."""
        own = SlidingTables.from_dict(data, sizes)
        return behind(cls, own, told=LooseFilter.from_dict(data["told"], own.sizes))


@dataclass(frozen=True)
class GuidedFilterTrace(FaultAnswers, SlidingTrace):
    """Answers of a filter that sliding modes guide; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status, mode, mode_set, candidate, age
        As in ``SlidingTrace``; bit 1 + j of the alarm: the estimate of fault j is beyond its bound.
    f_hat : ndarray (K, n_f)
        Estimates of the faults in the mode that is decided for; NaN at a sample without measurement.
    f_bound : ndarray (K, n_f)
        Largest |f_hat| that is possible without a fault where that mode has been the true one since the start.
    """

    f_hat: Array
    f_bound: Array
    estimator = SlidingTrace


class GuidedFilterObserver(FaultObserver, SlidingObserver):
    """The filter among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "guided_filter"
    tables_class = GuidedFilterTables
    trace_class = GuidedFilterTrace

    def bits(self, t: GuidedFilterTables) -> int:
        """Alarm bits: the estimator's, one per fault."""
        return 1 + t.told.K.shape[1]

    def start(self, t: GuidedFilterTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``); the filter starts from the declared range."""
        super().start(t, runs, x0_lo, x0_hi)
        self.xi = np.zeros((runs, len(t.told.limit)), t.dtype)
        self.stage, self.lasted = np.zeros(runs, dtype=int), np.zeros(runs, dtype=int)

    def sample(self, t: GuidedFilterTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: GuidedFilterTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        super().sample(t, on, measured, u, y, q, theta, out)
        judged = on & measured
        out.f_hat[judged], out.f_bound[judged] = (a[judged] for a in self.estimate)

    def _answered(self, t: GuidedFilterTables, step: Array, kept: Array, answer, u: Array, y: Array, theta: Array, r):
        """Bounds and residuals of the estimator, alarm bits of the filter."""
        (shown, p), told, rows = answer, t.told, np.arange(len(step))
        xi = np.where(kept[:, None], self.xi, t.begun[p])
        stage, lasted = (np.where(kept, a, 0) for a in (self.stage, self.lasted))
        every = np.repeat(xi[:, None], t.sizes[0], axis=1)
        f_hat, bound = told.estimates(every, u, y)[rows, p], told.h[stage, lasted >> told.shift, p]
        moved = told.moved(every, u, y)[rows, p]
        inside = (np.abs(moved) <= told.limit).all(axis=1)
        self.xi = np.where(inside[:, None], moved, t.dtype.type(0))
        self.stage = np.where(inside, stage, told.anywhere)
        self.lasted = np.where(inside, np.minimum(lasted + 1, told.last), 0)
        self.estimate = f_hat, bound
        return shown, r, ~(np.abs(f_hat) <= bound)
