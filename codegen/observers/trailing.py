"""Run-time family "trailing": a filter per possible mode that estimates faults, over the set of modes nobody told.

The mode estimator (``mode_set``) says at every sample which hypotheses (mode, age) are possible, and holds a box for
each. Beside it runs a filter of every mode (``loose_filter``), each with a bound of its estimate that holds without a
fault where its mode has been active since its start:

1. hypotheses of mode q that are older than the period say that it was: where the estimate of the filter of mode q is
   beyond its bound they are wrong. (q, 0), which began within the period, is not;
2. the decision is made from what is left, and the answer is the estimate of the filter of that mode;
3. the filter of a mode that becomes possible, or may have begun within the period, starts from the bounds of x over
   its hypotheses;
4. where no hypothesis is left, a fault has acted, or an assumption is broken: an alarm. The mode estimator starts anew,
   the filters go on with the bounds of a start from anywhere, and the decision is the last one that was for a mode of
   the oldest age. From then on, until ``assured`` may return, a filter that runs in a mode that may have begun within
   the period goes on likewise: so the estimate goes on while the fault lasts, in the mode before it.

Why the truth is kept: where q is the true mode, plant and filter of mode q are in the set behind its bound. They are
when it starts, from any hypothesis of the mode, and where it goes on from anywhere. A sample later a hypothesis is
either one of these, a sample older: the mode was active all through the period, and a step of it carries the set; or it
is (q, 0), and the filter goes on from anywhere. So what step 1 excludes is wrong while no fault acts. A filter sees its
own mode alone: nothing rests on how fast the plant switches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .loose_filter import LooseFilter
from .mode_observer import ModeObserver, ModeTrace, expected, merged
from .mode_set import ModeSet, image
from .mode_tables import ModeTables
from .supervisor import judge, undisturbed
from .told import FaultAnswers, FaultObserver, Told, behind

Array = np.ndarray


@dataclass(frozen=True)
class TrailingTables(Told, ModeTables):
    """Constants of the estimator, and of the filters beside it.

    Parameters
    ----------
    told : LooseFilter
    """

    told: LooseFilter | None = None

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> TrailingTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``ModeTables``."""
        own = ModeTables.from_dict(data, sizes)
        return behind(cls, own, told=LooseFilter.from_dict(data["told"], own.sizes))


@dataclass(frozen=True)
class TrailingTrace(FaultAnswers, ModeTrace):
    """Answers of filters beside a mode estimator; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status, mode, mode_set, settled_set, age
        As in ``ModeTrace``.
    f_hat : ndarray (K, n_f)
        Estimates of the faults in the mode that is decided for; NaN at a sample without measurement.
    f_bound : ndarray (K, n_f)
        Largest |f_hat| that is possible without a fault where that mode is the true one.
    """

    f_hat: Array
    f_bound: Array
    estimator = ModeTrace


class TrailingObserver(FaultObserver, ModeObserver):
    """The filters among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "trailing"
    tables_class = TrailingTables
    trace_class = TrailingTrace

    def start(self, t: TrailingTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``)."""
        super().start(t, runs, x0_lo, x0_hi)
        n_modes = t.sizes[0]
        self.xi = np.zeros((runs, n_modes, len(t.told.limit)), dtype=t.dtype)
        self.stage, self.since = (np.zeros((runs, n_modes), dtype=int) for _ in range(2))
        self.running = np.zeros((runs, n_modes), dtype=bool)
        self.settled = np.zeros(runs, dtype=int)

    def sample(self, t: TrailingTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: TrailingTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        run, told, quiet = ModeSet(t), t.told, undisturbed(self.supervision, self.guard)
        seen, before = run.seen(u, y), run.cut(self.state, None)
        r_lo, r_hi = expected(t, before, seen)
        now = merged(measured, run.cut(before, seen), before)
        inside = (np.abs(told.estimates(self.xi, u, y)) <= told.bounds(self.stage, self.since)).all(axis=2)
        now.alive[..., 1:] &= ~(self.running & ~inside & measured[:, None])[..., None]
        raw, whole = ~now.alive.any(axis=(1, 2)), run.everywhere(t.wide_lo, t.wide_hi, measured.shape)
        now = merged(raw, whole, now)
        now.mode = np.where(raw, self.settled, self.state.mode)
        mode = run.decided(now)
        x_lo, x_hi = run.bounds(now)
        after = merged(raw, now, run.carry(now, u))
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw[:, None])
        free = undisturbed(self.supervision, self.guard)
        again = again & measured
        fresh = merged(again, whole, after)
        fresh.mode = mode
        self.state = merged(on, fresh, self.state)
        self.state.mode = np.where(on, mode, now.mode)
        judged, rows = on & measured, np.arange(len(on))
        self.settled = np.where(on & now.alive[rows, mode, -1], mode, self.settled)
        f_hat, f_bound = self._filtered(t, on, measured, raw, again, quiet, now, u, y)
        out.x_lo[on], out.x_hi[on] = x_lo[on], x_hi[on]
        out.r_lo[judged], out.r_hi[judged] = r_lo[judged], r_hi[judged]
        out.f_hat[judged], out.f_bound[judged] = f_hat[rows, mode][judged], f_bound[rows, mode][judged]
        self._answer(out, on, measured, now, mode, raw, alarm, np.where(measured, assured, free))

    def _filtered(self, t: TrailingTables, on: Array, measured: Array, raw: Array, again: Array, quiet: Array, now,
                  u: Array, y: Array) -> tuple[Array, Array]:
        """Start filters or let them go on, estimate, and move them to the next sample.

        Returns
        -------
        f_hat, f_bound : ndarray (S, N, n_f)
        """
        told, lives = t.told, now.alive.any(axis=2)
        young = now.alive[..., 0]
        kept = (self.running & now.alive[..., 1:].any(axis=2) & ~(young & quiet[:, None])) | raw[:, None]
        wide = kept & (young | raw[:, None])
        begun, stage = told.started(*hulls(t, now))
        anew = lives & ~kept
        xi = np.where(anew[..., None], begun, self.xi)
        stage = np.where(anew, stage, np.where(wide, told.anywhere, self.stage))
        since = np.where(anew | wide, 0, self.since)
        f_hat, f_bound = told.estimates(xi, u, y), told.bounds(stage, since)
        moved = told.moved(xi, u, y)
        within = (np.abs(moved) <= told.limit).all(axis=2)
        moved = np.where(within[..., None], moved, t.dtype.type(0))
        fresh = (raw | again)[:, None]
        here = (on & measured)[:, None]
        self.xi = np.where(here[..., None], moved, self.xi)
        self.stage = np.where(here, np.where(fresh, told.anywhere, stage), self.stage)
        self.since = np.where(here, np.where(fresh, 0, np.minimum(since + 1, told.last)), self.since)
        self.running = np.where(on[:, None], here & ((lives & within) | fresh), self.running)
        return f_hat, f_bound

    def reset(self, t: TrailingTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        super().reset(t, on)
        self.xi = np.where(on[:, None, None], t.dtype.type(0), self.xi)
        self.stage, self.since = (np.where(on[:, None], 0, a) for a in (self.stage, self.since))
        self.running = self.running & ~on[:, None]
        self.settled = np.where(on, 0, self.settled)


def hulls(t: TrailingTables, now) -> tuple[Array, Array]:
    """Bounds of x over all hypotheses of every mode, (S, N, n_x); infinite where a mode is impossible."""
    below, above = image(t.S_inverse, now.lo, now.hi, np.zeros(now.lo.shape, t.dtype))
    here = now.alive[..., None]
    return (np.where(here, below - t.x_room, np.inf).min(axis=2), np.where(here, above + t.x_room, -np.inf).max(axis=2))
