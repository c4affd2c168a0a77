"""Run-time family "mode" as the firmware runs it: the recursion of ``mode_set`` among input checks and alarms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra.interval import hull
from .mode_set import ModeSet, ModeState, pack_modes
from .mode_tables import ModeTables
from .runner import Runner, outward, pack
from .supervisor import SupervisorState, judge, undisturbed
from .trace import Trace, blank

Array = np.ndarray


@dataclass(frozen=True)
class ModeTrace(Trace):
    """Answers of a mode estimator; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; r_lo, r_hi are about what the modes possible before this sample expect, bit 0 of the alarm
        means that no mode explains the measurements.
    mode : ndarray (K,) uint32
        The decision.
    mode_set, settled_set : ndarray (K,) uint32
        Bit masks of the modes that are possible, and of those among them that do not date from the last period.
    age : ndarray (K,) uint32
        Samples since when the decided mode may be active; the oldest age means so long or longer.
    """

    mode: Array
    mode_set: Array
    settled_set: Array
    age: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype) -> ModeTrace:
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        return cls(*blank(shape, (n_x, n_x, n_y, n_y), dtype, 4))

    def words(self) -> list[Array]:
        """The fields that other families do not have, in their order."""
        return [self.mode, self.mode_set, self.settled_set, self.age]


class ModeObserver(Runner):
    """The estimator; see ``Runner`` for the calls. The mode that it is given is not read: the C has no such input."""

    family = "mode"
    tables_class = ModeTables
    trace_class = ModeTrace

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Boxes of another initial box; see ``Runner.initial``."""
        if x0_lo is None and x0_hi is None:
            return [None, None]
        lo, hi = (np.broadcast_to(np.asarray(record["ranges"][f"x0_{side}"] if x0 is None else x0, dtype=np.float64),
                                  shape) for side, x0 in (("lo", x0_lo), ("hi", x0_hi)))
        boxes = hull(np.array(record["mode"]["S"]), lo, hi)
        count = next(count for name, _, count in record["state"] if name == "box_lo") // shape[1]
        out = []
        for box, side in zip(boxes, (-np.inf, np.inf)):
            filled = np.zeros((shape[0], count, shape[1]), dtype=dtype)
            filled[:, record["mode"]["ages"]::record["mode"]["ages"] + 1] = outward(box, dtype, side)[:, None]
            out.append(filled)
        return out

    def run_many(self, u, y, q, real="float32", x0_lo=None, x0_hi=None, theta=None) -> ModeTrace:
        """As ``Runner.run_many``; q is not read."""
        return super().run_many(u, y, np.zeros(np.shape(q), dtype=np.int64), real, x0_lo, x0_hi, theta)

    def start(self, t: ModeTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``)."""
        lo, hi = t.start_lo, t.start_hi
        if x0_lo is not None or x0_hi is not None:
            ends = [np.asarray(own if x0 is None else x0, dtype=np.float64)
                    for own, x0 in ((t.x0_lo, x0_lo), (t.x0_hi, x0_hi))]
            lo, hi = hull(t.S.astype(np.float64), *ends)
        self.state = ModeSet(t).everywhere(outward(lo, t.dtype, -np.inf), outward(hi, t.dtype, np.inf), (runs,))
        self.guard = SupervisorState(runs, 1, t.sizes[0])

    def sample(self, t: ModeTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: ModeTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        run = ModeSet(t)
        seen, before = run.seen(u, y), run.cut(self.state, None)
        r_lo, r_hi = expected(t, before, seen)
        now = merged(measured, run.cut(before, seen), before)
        raw, whole = ~now.alive.any(axis=(1, 2)), run.everywhere(t.wide_lo, t.wide_hi, measured.shape)
        now = merged(raw, whole, now)
        now.mode = self.state.mode
        mode = run.decided(now)
        x_lo, x_hi = run.bounds(now)
        after = merged(raw, now, run.carry(now, u))
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw[:, None])
        free = undisturbed(self.supervision, self.guard)
        fresh = merged(again & measured, whole, after)
        fresh.mode = mode
        self.state = merged(on, fresh, self.state)
        self.state.mode = np.where(on, mode, now.mode)
        judged = on & measured
        out.x_lo[on], out.x_hi[on] = x_lo[on], x_hi[on]
        out.r_lo[judged], out.r_hi[judged] = r_lo[judged], r_hi[judged]
        self._answer(out, on, measured, now, mode, raw, alarm, np.where(measured, assured, free))

    def _answer(self, out: ModeTrace, on: Array, measured: Array, now: ModeState, mode: Array, raw: Array, alarm: Array,
                assured: Array) -> None:
        """What is said of hypotheses and alarms at this sample, whatever runs beside them."""
        judged = on & measured
        oldest = now.alive.shape[-1] - 1 - np.argmax(now.alive.any(axis=1)[:, ::-1], axis=1)
        for field, values in ((out.mode, mode), (out.age, oldest), (out.mode_set, pack_modes(now.alive)),
                              (out.settled_set, pack_modes(now.alive[..., 1:])), (out.assured, assured),
                              (out.latched_bits, pack(self.guard.latched))):
            field[on] = values[on]
        out.raw_bits[judged], out.alarm_bits[judged] = raw[judged], pack(alarm)[judged]
        out.alarm[judged] = alarm[judged].any(axis=1)

    def reset(self, t: ModeTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        runs, mode = len(on), np.where(on, 0, self.state.mode)
        self.state = merged(on, ModeSet(t).everywhere(t.wide_lo, t.wide_hi, (runs,)), self.state)
        self.state.mode = mode
        fresh = SupervisorState(runs, 1, t.sizes[0])
        for name, value in vars(self.guard).items():
            mask = on.reshape(-1, *[1] * (value.ndim - 1))
            setattr(self.guard, name, np.where(mask, getattr(fresh, name), value))

    def quiet_output(self, t: ModeTables, u: Array, q: int, theta: Array) -> Array:
        """A measurement that mode q explains, where it is possible, else the decided one; for the golden vectors."""
        run = ModeSet(t)
        before = run.cut(self.state, None)
        alive = before.alive[0]
        mode = q if alive[q].any() else int(run.decided(before)[0])
        age = int(np.flatnonzero(alive[mode])[-1])
        p = len(t.v_lo)
        lo, hi = before.lo[0, mode, age, :p].astype(float), before.hi[0, mode, age, :p].astype(float)
        y = 0.45 * lo + 0.55 * hi - run.seen(u[None], np.zeros((1, p), t.dtype))[0].astype(float)
        return np.clip(y, t.y_lo, t.y_hi).astype(t.dtype)


def expected(t: ModeTables, state: ModeState, seen: Array) -> tuple[Array, Array]:
    """Bounds of what y may be, minus y, over the hypotheses alive; the lower one above where none is."""
    p, here = len(t.v_lo), state.alive[..., None]
    least = np.where(here, state.lo[..., :p], t.limit[:p]).min(axis=(-3, -2))
    most = np.where(here, state.hi[..., :p], -t.limit[:p]).max(axis=(-3, -2))
    return (least + t.v_lo) - seen, (most + t.v_hi) - seen


def merged(which: Array, one: ModeState, other: ModeState) -> ModeState:
    """The first state for the runs in ``which``, the second one for the others; the decision is the second's."""
    boxes = which[:, None, None, None]
    return ModeState(np.where(boxes, one.lo, other.lo), np.where(boxes, one.hi, other.hi),
                     np.where(which[:, None, None], one.alive, other.alive), other.mode)
