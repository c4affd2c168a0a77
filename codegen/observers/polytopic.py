r"""Run-time family "polytopic": an observer blended by weights at its estimate, thresholds for its residual.

At sample k, from the observer's state z::

    1  x_hat = z + T2 y,  r = y - C x_hat          estimate, residual
    2  alarm where |M r| > threshold[since >> shift]   no fault: it cannot exceed it
    3  h = weights at x_hat,  z+ = sum_j h_j (F_j x_hat + G_j u - K_j r), cut to its limits

The residual costs nothing: the gains act on it. Entries that all vertices share are added once, outside the sum of
the weights: an entry of every row is either shared or varies. The answer is M r, which is r where M = I.

The estimate needs no start value for what is algebraic: z starts at T1 E x0, and T2 y adds the rest from the first
measurement, so that an x0 that contradicts the algebraic equations does no harm. Without a measurement x_hat is
continued with the last y and r = 0.

``since`` counts the samples since the last start, up to the last row, which holds for ever. A start is anywhere: the
plant in its declared range, z within its limits. It follows a reset, a sample without measurement, the end of a fault
that has been seen, and a z that has run into its limits. So nothing that the firmware may meet makes a false alarm,
only higher thresholds for a while. While a fault is seen nothing starts again: the estimate goes on.

Where faults are part of the estimate (``PolytopicTables.faults``) they spoil nothing: what is assured stays so while
they act, and nothing starts again at their end. Where the weights are not in force nothing is assured; where they are
the plant's, of outputs that are exact, the thresholds start again, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .polytopic_step import step, summed
from .polytopic_tables import PolytopicTables
from .runner import Runner, pack
from .supervisor import SupervisorState, judge, undisturbed
from .thresholds import refuse
from .trace import Rows, blank

Array = np.ndarray


@dataclass(frozen=True)
class PolytopicTrace(Rows):
    """Answers of a polytopic observer; row k is what it says at sample k.

    Parameters
    ----------
    x_hat : ndarray (K, n_x)
        Estimate. NaN where the status is an error that left nothing to say.
    r : ndarray (K, n_y)
        Residual M (y - C x_hat); NaN at a sample without measurement.
    r_bound : ndarray (K, n_y)
        Largest |r| that is possible without a fault.
    alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; bit j is residual j.
    inside : ndarray (K,) uint32
        1 where the weights are in force: the estimate is where the model was made for.
    settled : ndarray (K,) uint32
        1 where r_bound is that of the last row.
    """

    x_hat: Array
    r: Array
    r_bound: Array
    alarm: Array
    alarm_bits: Array
    latched_bits: Array
    raw_bits: Array
    assured: Array
    status: Array
    inside: Array
    settled: Array

    @property
    def r_lo(self) -> Array:
        """Lower bound of what the residual may be, minus it, as the interval family answers."""
        return -self.r - self.r_bound

    @property
    def r_hi(self) -> Array:
        """Upper bound of what the residual may be, minus it."""
        return -self.r + self.r_bound

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype) -> PolytopicTrace:
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        return cls(*blank(shape, (n_x, n_y, n_y), dtype, 2))

    def words(self) -> list[Array]:
        """The fields that other families do not have, in their order."""
        return [self.inside, self.settled]


class PolytopicObserver(Runner):
    """The observer as the firmware runs it, on S independent runs at once; see ``Runner`` for the calls."""

    family = "polytopic"
    tables_class = PolytopicTables
    trace_class = PolytopicTrace
    advance = staticmethod(step)

    def empty(self, t, shape: tuple[int, ...]) -> PolytopicTrace:
        """Allocate the answers of runs of the given leading shape."""
        return PolytopicTrace.empty(shape, *t.C.shape[::-1], t.dtype)

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Nothing: the thresholds hold for the initial box of the plant file."""
        refuse(x0_lo, x0_hi)
        return []

    def run_many(self, u, y, q=None, real="float32", x0_lo=None, x0_hi=None, theta=None) -> PolytopicTrace:
        """As ``Runner.run_many``; q is not read."""
        return super().run_many(u, y, np.zeros(np.shape(y)[:2], dtype=np.int64), real, x0_lo, x0_hi, theta)

    def start(self, t: PolytopicTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``).

        Raises
        ------
        ValueError
            Another initial box than the plant file's, for which the thresholds hold.
        """
        refuse(x0_lo, x0_hi)
        self._fill(t, runs, t.z0, t.y0, t.start << t.shift)

    def _fill(self, t, runs: int, z: Array, y: Array, since: int) -> None:
        self.z, self.y = np.tile(z, (runs, 1)), np.tile(y, (runs, 1))
        self.since = np.full(runs, since)
        self.guard = SupervisorState(runs, len(t.M), 1)

    def sample(self, t: PolytopicTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: PolytopicTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        now = np.where(measured[:, None], y, self.y)
        x_hat, r, inside, after = self.advance(t, self.z, u, now, theta, measured)
        shown = summed(t.M, r) if t.weighted else r
        r_bound = t.h[np.minimum(self.since >> t.shift, t.last)]
        raw = ~(np.abs(shown) <= r_bound)
        seen = on & measured
        alarm, again, assured = judge(self.supervision, self.guard, seen, raw)
        free = undisturbed(self.supervision, self.guard)
        fault = raw.any(axis=1)
        self.guard.run = np.where(seen & again & fault, 1, self.guard.run)  # at the first quiet sample it still counts
        out.x_hat[on] = x_hat[on]
        out.r[seen], out.r_bound[seen] = shown[seen], r_bound[seen]
        out.raw_bits[seen] = pack(raw)[seen]
        out.alarm_bits[seen] = pack(alarm)[seen]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[seen] = alarm[seen].any(axis=1)
        out.inside[on], out.settled[on] = inside[on], (self.since >> t.shift >= t.last)[on]
        kept = ((after >= t.z_lo) & (after <= t.z_hi)).all(axis=1)
        sure = measured | free if t.faults else np.where(measured, assured, free)
        out.assured[on] = (sure & inside)[on]
        after = np.where(after >= t.z_lo, np.where(after <= t.z_hi, after, t.z_hi), t.z_lo)
        spoilt = ~inside & (not t.at_estimate) if t.faults else again & ~fault
        since = np.where(kept & seen & ~spoilt, np.minimum(self.since + 1, t.last << t.shift), 0)
        self.z, self.y = np.where(on[:, None], after, self.z), np.where(seen[:, None], y, self.y)
        self.since = np.where(on, since, self.since)

    def reset(self, t: PolytopicTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        before = {name: getattr(self, name) for name in ("z", "y", "since")}
        guard = self.guard
        self._fill(t, len(on), t.z_mid, t.y_mid, 0)
        for owner, old in ((self, before), (self.guard, vars(guard))):
            for name, value in old.items():
                mask = on if value.ndim == 1 else on[:, None]
                setattr(owner, name, np.where(mask, getattr(owner, name), value))
