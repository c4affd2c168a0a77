"""Run-time family "sliding": which mode is active, by whose bounds' outputs keep the rate of the measurement.

Plant ``x' = A_q x + B_q u + w``, ``y = C x + D u + v``, C common to the modes, u held, the mode q unknown. Every mode
has a pair of bounds, right while it is the active one, and per bound a super-twisting loop whose ``rate`` goes to what
the bound's output has of rate more than the measurement. With s = y - D u, per sample and mode i::

    1  test       C x_lo + v_lo <= s <= C x_hi + v_hi by signs of C, x_lo <= x_hi; where it fails, mode i was not active
                  all the time
    2  twist      e = z - s + C x,  b = e + tau rate,  c = b / h, g = 0 where |b| <= h, else c = sign b,
                  g = sqrt |b| - sqrt h;   rate -= tau k2 c,  z -= tau k1 g c        (h = tau^2 k2, k1 = 2 sqrt k2)
    3  restart    a pair that failed begins anew at the range of x, its z at s - C x
    4  move       x_hi+ = d_hi + G u + L_hi s + M_hi x_hi,  z+ = z - C L z + tau rate, so the lower bound
    5  mean       level_i += a (sum |rate| - level_i);  the candidate is the least, if it is below a share of the last's

A detection is a candidate other than the decision, or a failed test of the decided mode, ``blank`` samples or more
after the last; ``blank`` samples later the candidate is the decision. One pair more, begun then at the range of x, is
what is answered. Backward Euler in closed form: with k1 = 2 sqrt k2 the root of (tau k1)^2 + 4 (|b| - h) is that of
4 |b|, and nothing chatters.

Alarm: in a span of time in which every mode's test has failed after a restart within it, the mode has changed. Two such
spans within the dwell time cannot be without a fault.

Source: C. Zammali (2020), chapter 4, (4.3) to (4.37). There all pairs restart at a detection, the right one too, which
then looks wrong again: a livelock. Here a pair restarts when its own test fails, which the right one's does once at
most. The state of a pair that its mode has never refuted need not hold x: hence the pair that is answered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .ellipsoid_trace import root
from .mode_set import affine, image
from .runner import Runner, outward, pack
from .sliding_tables import SlidingTables
from .supervisor import SupervisorState, judge
from .trace import Trace, blank

Array = np.ndarray
#: Age beyond which nothing is counted.
OLDEST = 65535


@dataclass(frozen=True)
class SlidingTrace(Trace):
    """Answers of a mode estimator by sliding modes; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; bit 0 of the alarm: the mode has changed twice within its dwell time, or there is a fault.
    mode : ndarray (K,) uint32
        The decision.
    mode_set : ndarray (K,) uint32
        Bit mask of the modes whose test holds at this sample.
    candidate : ndarray (K,) uint32
        The mode of the least rates; the decision follows it after a detection.
    age : ndarray (K,) uint32
        Samples since the last detection.
    """

    mode: Array
    mode_set: Array
    candidate: Array
    age: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype) -> SlidingTrace:
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        return cls(*blank(shape, (n_x, n_x, n_y, n_y), dtype, 4))

    def words(self) -> list[Array]:
        """The fields that other families do not have, in their order."""
        return [self.mode, self.mode_set, self.candidate, self.age]


class SlidingObserver(Runner):
    """The estimator; see ``Runner`` for the calls. The mode that it is given is not read: the C has no such input."""

    family = "sliding"
    tables_class = SlidingTables
    trace_class = SlidingTrace

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Bounds of all modes for another initial box; see ``Runner.initial``."""
        count = next(count for name, _, count in record["state"] if name == "box_lo") // shape[1]
        boxes = super().initial(x0_lo, x0_hi, shape, record, dtype)
        return [None if box is None else np.ascontiguousarray(np.repeat(box[:, None], count, axis=1)) for box in boxes]

    def run_many(self, u, y, q, real="float32", x0_lo=None, x0_hi=None, theta=None) -> SlidingTrace:
        """As ``Runner.run_many``; q is not read."""
        return super().run_many(u, y, np.zeros(np.shape(q), dtype=np.int64), real, x0_lo, x0_hi, theta)

    def bits(self, t: SlidingTables) -> int:
        """Alarm bits."""
        return 1

    def start(self, t: SlidingTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``)."""
        modes, n, _, p = t.sizes
        self.guard = SupervisorState(runs, self.bits(t), modes)
        self.z, self.rate = ([np.zeros((runs, modes, p), t.dtype) for _ in range(2)] for _ in range(2))
        self.level = np.zeros((runs, modes), t.dtype)
        self.decided, self.best = np.zeros(runs, np.int64), np.zeros(runs, np.int64)
        self.x = [np.zeros((runs, modes, n), t.dtype) for _ in range(2)]
        self.shown = [np.zeros((runs, n), t.dtype) for _ in range(2)]
        self.fresh, self.armed, self.refuted = (np.zeros((runs, modes), bool) for _ in range(3))
        self.age, self.since, self.last = (np.zeros(runs, np.int64) for _ in range(3))
        self._lose(t, np.ones(runs, bool))
        for i, (own, x0) in enumerate(((t.x0_lo, x0_lo), (t.x0_hi, x0_hi))):
            box = outward(own if x0 is None else x0, t.dtype, (-np.inf, np.inf)[i])
            self.x[i] = np.broadcast_to(box if box.ndim == 1 else box[:, None], self.x[i].shape).astype(t.dtype)

    def _lose(self, t: SlidingTables, on: Array) -> None:
        """Begin all pairs of the runs in ``on`` at the range of x; rates and decision stay."""
        for i, end in enumerate((t.x_lo, t.x_hi)):
            self.x[i] = np.where(on[:, None, None], end, self.x[i])
            self.shown[i] = np.where(on[:, None], end, self.shown[i])
        self.fresh, self.armed = self.fresh | on[:, None], self.armed | on[:, None]
        self.refuted = self.refuted & ~on[:, None]
        self.age, self.since, self.last = (np.where(on, 0, a) for a in (self.age, self.since, self.last))

    def sample(self, t: SlidingTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: SlidingTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        step, modes = on & measured, t.sizes[0]
        seen = affine(y, -t.D, u)
        r_lo, r_hi = tested(t, self.x, seen[:, None])
        failed = ~(holds(r_lo, r_hi) & ordered(self.x))
        z, rate = self._twisted(t, seen)
        old = self.level
        total = np.zeros_like(old)
        for i in range(t.sizes[3]):
            total = (total + np.abs(rate[1][..., i])) + np.abs(rate[0][..., i])
        level = old + t.smooth * (total - old)
        level = np.where(level >= 0, level, np.zeros_like(level))
        rows, first = np.arange(len(on)), np.argmin(level, axis=1)
        best = np.where(level[rows, first] < t.share * level[rows, self.best], first, self.best)
        decided = np.where(self.age == t.blank, best, self.decided)
        crossed = ~ordered(self.shown)
        wrong = failed[rows, decided] | ~holds(*tested(t, self.shown, seen)) | crossed
        detected = (self.age >= t.blank) & ((best != decided) | wrong)
        wide = detected | (self.age <= t.blank)
        age = np.where(detected, 0, np.minimum(self.age + 1, OLDEST))
        wide = np.where(step, wide, (self.age <= t.blank) | crossed)
        shown = [np.where(wide[:, None], end, own) for end, own in zip((t.x_lo, t.x_hi), self.shown)]
        kept = np.where(step, ~wide, self.age > t.blank)
        bounds, (r_lo, r_hi), raw = self._answered(t, step, kept, (shown, decided), u, y, theta,
                                                   tested(t, shown, seen))
        raw = np.column_stack([self._watch(t, step, failed), raw])
        x = [np.where(failed[..., None], end, own) for end, own in zip((t.x_lo, t.x_hi), self.x)]
        self._move(t, step, u, seen, (x, z, rate), failed, (shown, decided))
        self.fresh = self.fresh & ~step[:, None]
        for name, value in (("level", level), ("best", best), ("decided", decided), ("age", age)):
            mask = step.reshape(-1, *[1] * (value.ndim - 1))
            setattr(self, name, np.where(mask, value, getattr(self, name)))
        alarm, again, _ = judge(self.supervision, self.guard, step, raw)
        out.age[on] = self.age[on]
        self._lose(t, on & (again | ~measured))
        out.x_lo[on], out.x_hi[on] = bounds[0][on], bounds[1][on]
        out.r_lo[step], out.r_hi[step] = r_lo[step], r_hi[step]
        out.mode[on], out.candidate[on] = self.decided[on], self.best[on]
        everything = np.uint32(2**modes - 1)
        out.mode_set[on] = np.where(measured, pack(~failed), everything)[on]
        out.raw_bits[step] = pack(raw)[step]
        out.alarm_bits[step] = pack(alarm)[step]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[step] = alarm[step].any(axis=1)

    def _answered(self, t: SlidingTables, step: Array, kept: Array, answer, u: Array, y: Array, theta: Array,
                  residuals):
        """Bounds, residuals and further alarm bits that are answered; ``kept``: bounds go on."""
        return answer[0], residuals, np.zeros((len(step), 0), bool)

    def _twisted(self, t: SlidingTables, seen: Array) -> tuple[list[Array], list[Array]]:
        """Sliding variables and rates after the correction, of all pairs."""
        z, rate, one = [], [], t.dtype.type(1.0)
        for x, own, v in zip(self.x, self.z, self.rate):
            b = ((own - seen[:, None]) + affine(np.zeros(t.sizes[3], t.dtype), t.H, x)) + t.period * v
            size = np.abs(b)
            inside = size <= t.ground
            c = np.where(inside, b * t.inverse, np.where(b < 0, -one, one))
            g = np.where(inside, np.zeros_like(b), root(t, size) - t.foot)
            keep = self.fresh[..., None]
            z.append(np.where(keep, own, own - (t.pull * g) * c))
            rate.append(np.where(keep, v, cut(v - t.turn * c, t.rate_limit)))
        return z, rate

    def _move(self, t: SlidingTables, step: Array, u: Array, seen: Array, twisted, failed: Array, answer) -> None:
        """Everything to the next sample, for the runs in ``step``."""
        (x, z, rate), (shown, decided) = twisted, answer
        sides = ((t.M_lo, t.L_lo, t.d_lo, t.K_lo), (t.M_hi, t.L_hi, t.d_hi, t.K_hi))
        anew, put = (failed | self.fresh)[..., None], step[:, None, None]
        for i, (M, L, d, K) in enumerate(sides):
            begun = seen[:, None] - affine(np.zeros(t.sizes[3], t.dtype), t.H, x[i])
            own = np.where(anew, begun, z[i])
            moved = carried((d, t.G, L, M), u[:, None], seen[:, None], x[i])
            turned = summed(own, -K, own) + t.period * rate[i]
            after = carried([part[decided] for part in (d, t.G, L, M)], u, seen, shown[i])
            self.x[i] = np.where(put, cut(moved, t.limit), self.x[i])
            self.z[i] = np.where(put, cut(turned, t.z_limit), self.z[i])
            self.rate[i] = np.where(put, rate[i], self.rate[i])
            self.shown[i] = np.where(step[:, None], cut(after, t.limit), self.shown[i])

    def _watch(self, t: SlidingTables, step: Array, failed: Array) -> Array:
        """Spans of time in which the mode has changed; whether two are within a dwell time."""
        refuted, since = self.refuted | (self.armed & failed), np.minimum(self.since + 1, t.dwell)
        over = refuted.all(axis=1)
        raw = over & (self.last > 0) & (self.last + since <= t.dwell)
        ends = over | (since >= t.dwell)
        put = step & ends
        last = np.where(over & (since < t.dwell), since, 0)
        armed = np.where(ends[:, None], failed, self.armed | failed)
        self.refuted = np.where(step[:, None], refuted & ~ends[:, None], self.refuted)
        self.armed = np.where(step[:, None], armed, self.armed)
        self.last = np.where(put, last, self.last)
        self.since = np.where(step, np.where(ends, 0, since), self.since)
        return raw

    def reset(self, t: SlidingTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, everything else as after power-on (``<p>_reset``)."""
        self._lose(t, on)
        for i in range(2):
            self.z[i], self.rate[i] = (np.where(on[:, None, None], np.zeros_like(a), a)
                                       for a in (self.z[i], self.rate[i]))
        self.level = np.where(on[:, None], np.zeros_like(self.level), self.level)
        self.decided, self.best = np.where(on, 0, self.decided), np.where(on, 0, self.best)
        clear = SupervisorState(len(on), 1, t.sizes[0])
        for name, value in vars(self.guard).items():
            mask = on.reshape(-1, *[1] * (value.ndim - 1))
            setattr(self.guard, name, np.where(mask, getattr(clear, name), value))

    def quiet_output(self, t: SlidingTables, u: Array, q: int, theta: Array) -> Array:
        """A measurement within the bounds of mode q; for the golden vectors."""
        below, above = image(t.H, self.x[0][0, q], self.x[1][0, q], np.zeros(t.sizes[3], t.dtype))
        y = 0.45 * below.astype(float) + 0.55 * above.astype(float)
        y = y - affine(np.zeros((1, t.sizes[3]), t.dtype), -t.D, u[None])[0].astype(float)
        return np.clip(y, t.y_lo, t.y_hi).astype(t.dtype)


def tested(t: SlidingTables, x: list[Array], seen: Array) -> tuple[Array, Array]:
    """Bounds of what s may be, minus s, by signs of C."""
    below, above = image(t.H, x[0], x[1], np.zeros((*x[0].shape[:-1], t.sizes[3]), t.dtype))
    return (below + t.v_lo) - seen, (above + t.v_hi) - seen


def summed(base: Array, A: Array, x: Array) -> Array:
    """Return base + A x, each product and sum rounded: (..., r), (..., r, n), (..., n) -> (..., r)."""
    total = base
    for k in range(A.shape[-1]):
        total = total + A[..., k] * x[..., k, None]
    return total


def carried(parts, u: Array, seen: Array, x: Array) -> Array:
    """A bound at the next sample, d + G u + L s + M x for ``parts`` d, G, L, M."""
    d, G, L, M = parts
    return summed(summed(summed(d, G, u), L, seen), M, x)


def ordered(x: list[Array]) -> Array:
    """Whether no lower bound is above the upper one, as both would hold x in the active mode."""
    return (x[0] <= x[1]).all(axis=-1)


def holds(r_lo: Array, r_hi: Array) -> Array:
    """Whether zero is within the bounds of all residuals; no number is not."""
    return ((r_lo <= 0) & (r_hi >= 0)).all(axis=-1)


def cut(value: Array, limit: Array) -> Array:
    """Cut to magnitudes; no number becomes the lower end."""
    value = np.where(value >= -limit, value, -limit)
    return np.where(value <= limit, value, limit)
