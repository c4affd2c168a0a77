"""Run-time family "guided_point": a point observer in the mode that an estimator by sliding modes decides for.

The estimator (``sliding``) decides for one mode at every sample, and has a pair of bounds that is right while its
decision is. One point observer, as it is where the mode is told (``point``, any set of ``inner.SETS``), runs beside it:

1. where the estimator's bounds are the declared range (from a detection until its decision is taken up, after an alarm,
   a reset, a missing sample) it starts there, in the mode that is decided for;
2. else it moves by the step of that mode, which is that of the last sample;
3. its bounds are cut to the estimator's. A residual outside what its set allows, or crossed bounds, set a bit of the
   alarm.

So where no fault acts and the decision has been the true mode since it was taken up, the observer's set holds the
state: it starts from what holds it, and the step of the true mode carries it. Nothing is known of the decision, so
``assured`` is never set, and a bit other than the estimator's own is a fault or a decision that is not right (yet). An
alarm begins everything anew, the estimator too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .inner import SETS, begun, chosen, moved, settled
from .point import PointTables, centred, residual
from .sliding import SlidingObserver, SlidingTrace
from .sliding_tables import SlidingTables
from .told import PointAnswers, ToldPoint, behind

Array = np.ndarray


@dataclass(frozen=True)
class GuidedPointTables(ToldPoint, SlidingTables):
    """Constants of the estimator, and of the point observer that it guides.

    Parameters
    ----------
    told : PointTables
        Of the observer that is told its mode.
    set : {"zonotope", "box", "ellipsoid", "ellipsoid_trace", "starts"}
        Its family.
    """

    told: PointTables | None = None
    set: str = ""

    @property
    def middle(self) -> Array:
        """Centre of the declared range (n_x,), as it is rounded."""
        return centred(self.told.x_lo, self.told.x_hi, self.dtype)[0]

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> GuidedPointTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``SlidingTables``."""
        own, family = SlidingTables.from_dict(data, sizes), data["set"]
        told = PointTables.from_dict(data["told"], own.sizes, SETS[family].shape_class)
        return behind(cls, own, set=family, told=told)


@dataclass(frozen=True)
class GuidedPointTrace(PointAnswers, SlidingTrace):
    """Answers of a point observer that sliding modes guide; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status, mode, mode_set, candidate, age
        As in ``SlidingTrace``; residuals are those of the observer.
    x_hat : ndarray (K, n_x)
        Estimate in the mode that is decided for.
    """

    x_hat: Array
    estimator = SlidingTrace


class GuidedPointObserver(SlidingObserver):
    """The observer among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "guided_point"
    tables_class = GuidedPointTables
    trace_class = GuidedPointTrace

    def bits(self, t: GuidedPointTables) -> int:
        """Alarm bits: the estimator's, those of the observer, crossed bounds."""
        return 2 + t.alone.bits(t.sizes[3])

    def start(self, t: GuidedPointTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``); the observer starts from the declared range."""
        super().start(t, runs, x0_lo, x0_hi)
        self.inner = t.alone
        self.point = begun(self.inner, t.told, runs)
        self.before = tuple(np.zeros((runs, count), t.dtype) for count in t.sizes[2:])

    def sample(self, t: GuidedPointTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: GuidedPointTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        super().sample(t, on, measured, u, y, q, theta, out)
        out.x_hat[on] = self.point[0][on]

    def _answered(self, t: GuidedPointTables, step: Array, kept: Array, answer, u: Array, y: Array, theta: Array, r):
        """Bounds, residuals and alarm bits of the observer."""
        (shown, p), told = answer, t.told
        point = moved(self.inner, told, p, step, self.point, self.before, y)
        *point, radius = settled(self.inner, told, p, chosen(kept, point, begun(self.inner, told, len(p))))
        self.point, self.before = tuple(point), (u, y)
        x, shape, origin = point
        lo, hi = x - radius, x + radius
        bounds = [np.where(kept[:, None] & closer, own, end) for closer, own, end in zip(
            (lo > shown[0], hi < shown[1]), (lo, hi), shown)]
        r = residual(told, p, x, u, y)
        r_bound, raw = self.inner.judged(told, p, origin, shape, r)
        crossed = (bounds[0] > bounds[1]).any(axis=1)
        return bounds, (-r - r_bound, -r + r_bound), np.column_stack([raw, crossed])
