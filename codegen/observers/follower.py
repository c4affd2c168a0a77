"""Run-time family "follower": a point observer with an error set that follows the decision of a mode estimator.

The mode estimator (``mode_set``) says at every sample which hypotheses (mode, age) are possible, and holds a box for
each. One point observer, as it is where the mode is told (``point``, any set of ``SETS``), runs beside it in the mode
that is decided for:

1. it moves by the step of its mode, as long as a hypothesis of that mode says that it was active all through the last
   period; where the residual is outside its set, or its bounds are apart from the boxes, these hypotheses are wrong;
2. their boxes are cut to what its bounds make of S x. That of (q, 0) is not, which began within the period;
3. the decision is made from what is left. Where another mode is decided for, or (q, 0) is possible, the observer starts
   anew: its estimate is the centre of the bounds over all hypotheses of that mode, its set the box around it. So does
   one whose set is a table (``starts``) at a missing sample and at the next.

Why the truth is kept: under every hypothesis of its mode that is possible after step 3 the observer's set holds the
state. It does when it starts, from all of them. A sample later a hypothesis is either one of these, a sample older: the
mode was active all through the period, and a told observer's step carries the set; or it is (q, 0), and the observer
starts again from all. So what steps 1 and 2 exclude or cut is wrong or not reached while no fault acts. No hypothesis
left is a fault, or an assumption broken. Between its starts the observer sees one mode alone: nothing rests on how fast
the plant switches. While several modes are possible the bounds are those over all of their boxes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .inner import SETS, begun, chosen, moved, settled
from .mode_observer import ModeObserver, ModeTrace, expected, merged
from .mode_set import ModeSet, ModeState, image
from .mode_tables import ModeTables
from .point import PointTables, residual
from .supervisor import judge, undisturbed
from .told import PointAnswers, ToldPoint, behind

Array = np.ndarray

@dataclass(frozen=True)
class FollowerTables(ToldPoint, ModeTables):
    """Constants of the estimator, and of the point observer that follows it.

    Parameters
    ----------
    told : PointTables
        Of the observer that is told its mode.
    set : {"zonotope", "box", "ellipsoid", "ellipsoid_trace", "starts"}
        Its family.
    S_rounded : ndarray (n_x, n_x), xi_room : ndarray (n_x,)
        S in the type of the C, and what that and the product may lose.
    grow, floor : ndarray ()
        A half width as computed, times the first and plus the second, is at least the half width.
    square : ndarray ()
        The square of a half width, times this and plus ``floor``, is at least n_x times the square: for an ellipsoid.
    """

    told: PointTables | None = None
    set: str = ""
    S_rounded: Array | None = None
    xi_room: Array | None = None
    grow: Array | None = None
    floor: Array | None = None
    square: Array | None = None

    @property
    def by_squares(self) -> bool:
        """Whether a set begins with squares of half widths."""
        return self.set.startswith("ellipsoid")

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> FollowerTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``ModeTables``."""
        mode = ModeTables.from_dict(data, sizes)
        more = {name: np.array(data[name], dtype=np.float64).astype(mode.dtype)
                for name in ("S_rounded", "xi_room", "grow", "square", "floor")}
        told = PointTables.from_dict(data["told"], mode.sizes, SETS[data["set"]].shape_class)
        return behind(cls, mode, **more, set=data["set"], told=told)


@dataclass(frozen=True)
class FollowerTrace(PointAnswers, ModeTrace):
    """Answers of a point observer that follows a mode estimator; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi, r_lo, r_hi, alarm, alarm_bits, latched_bits, raw_bits, assured, status, mode, mode_set, settled_set, age
        As in ``ModeTrace``.
    x_hat : ndarray (K, n_x)
        Estimate in the mode that is decided for.
    """

    x_hat: Array
    estimator = ModeTrace


class FollowerObserver(ModeObserver):
    """The observer among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "follower"
    tables_class = FollowerTables
    trace_class = FollowerTrace

    def start(self, t: FollowerTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``)."""
        super().start(t, runs, x0_lo, x0_hi)
        n_modes, n, n_u, n_y = t.sizes
        self.inner = t.alone
        self.followed = np.full(runs, n_modes)
        self.x_hat = np.zeros((runs, n), dtype=t.dtype)
        self.set = self.inner.whole(t.told, self.x_hat)  # not read before it starts
        self.origin = np.full(runs, t.told.origins - 1)
        self.u, self.y = np.zeros((runs, n_u), dtype=t.dtype), np.zeros((runs, n_y), dtype=t.dtype)
        self.full = np.zeros(runs, dtype=bool)

    def sample(self, t: FollowerTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: FollowerTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        run, rows, n_modes = ModeSet(t), np.arange(len(on)), t.sizes[0]
        seen, before = run.seen(u, y), run.cut(self.state, None)
        r_lo, r_hi = expected(t, before, seen)
        now = merged(measured, run.cut(before, seen), before)
        now, followed, point, own = self.pursued(t, now, measured, u, y)
        raw, whole = ~now.alive.any(axis=(1, 2)), run.everywhere(t.wide_lo, t.wide_hi, measured.shape)
        now = merged(raw, whole, now)
        now.mode = self.state.mode
        followed = np.where(raw, n_modes, followed)
        mode, lives = run.decided(now), now.alive.any(axis=2)
        lo, hi = hulls(t, now, now.alive, followed, *own)
        anew = (followed != mode) | now.alive[rows, mode, 0]
        anew |= t.by_table & ~(self.full & measured)  # a table is of measured steps
        point = chosen(anew, self.started(t, lo[rows, mode], hi[rows, mode]), point)
        after = merged(raw, now, run.carry(now, u))
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw[:, None])
        free = undisturbed(self.supervision, self.guard)
        again = again & measured
        fresh = merged(again, whole, after)
        fresh.mode = mode
        self.state = merged(on, fresh, self.state)
        self.state.mode = np.where(on, mode, now.mode)
        judged = on & measured
        self.x_hat, self.set, self.origin = chosen(on, point, (self.x_hat, self.set, self.origin))
        self.followed = np.where(on, np.where(raw | again, n_modes, mode), self.followed)
        self.u, self.y = np.where(on[:, None], u, self.u), np.where(judged[:, None], y, self.y)
        self.full = np.where(on, judged, self.full)
        out.x_hat[on] = point[0][on]
        out.x_lo[on] = np.where(lives[..., None], lo, np.inf).min(axis=1)[on]
        out.x_hi[on] = np.where(lives[..., None], hi, -np.inf).max(axis=1)[on]
        out.r_lo[judged], out.r_hi[judged] = r_lo[judged], r_hi[judged]
        self._answer(out, on, measured, now, mode, raw, alarm, np.where(measured, assured, free))

    def pursued(self, t: FollowerTables, now: ModeState, measured: Array, u: Array, y: Array):
        """Move the observer in its mode, drop or cut what it excludes: steps 1 and 2.

        Returns
        -------
        now : ModeState
        followed : ndarray (S,) int
            Mode of the observer, N where nothing of it holds.
        point : (x_hat, set, origin)
        own : (ndarray (S, n_x), ndarray (S, n_x))
            Bounds of x.
        """
        told, rows, n_modes = t.told, np.arange(len(measured)), t.sizes[0]
        p = np.minimum(self.followed, n_modes - 1)
        older = np.arange(t.ages + 1) > 0
        kept = (self.followed < n_modes) & (now.alive[rows, p] & older).any(axis=-1)
        point = (self.x_hat, self.set, self.origin)
        point = moved(self.inner, told, p, self.full & measured, point, (self.u, self.y), y)
        x, shape, origin, radius = settled(self.inner, told, p, point)
        r = residual(told, p, x, u, y)
        outside = self.inner.judged(told, p, origin, shape, r)[1].any(axis=1) & measured & kept
        own = np.clip(x - radius, -told.box, told.box), np.clip(x + radius, -told.box, told.box)
        now.alive[rows, p] &= ~(outside[:, None] & older)
        narrow(t, now, rows, p, kept, *own)
        kept = kept & (now.alive[rows, p] & older).any(axis=-1)
        lo, hi = hulls(t, now, now.alive & older, np.where(kept, p, n_modes), *own)
        apart = kept & ~np.all(lo[rows, p] <= hi[rows, p], axis=-1)
        now.alive[rows, p] &= ~(apart[:, None] & older)
        return now, np.where(kept & ~apart, p, n_modes), (x, shape, origin), own

    def started(self, t: FollowerTables, lo: Array, hi: Array) -> tuple[Array, Array, Array]:
        """Estimate, set and origin from bounds of x (S, n_x), cut to the declared range; its own if as wide."""
        lo, hi = (np.where(b < t.x_lo, t.x_lo, np.where(b > t.x_hi, t.x_hi, b)) for b in (lo, hi))
        two = t.dtype.type(0.5)
        x = two * lo + two * hi
        half, below = hi - x, x - lo
        half = np.where(below > half, below, half) * t.grow + t.floor
        if t.by_squares:
            shape = np.zeros((*half.shape, half.shape[1]), dtype=t.dtype)
            i = np.arange(half.shape[1])
            shape[:, i, i] = t.square * (half * half) + t.floor
        elif t.by_table:
            shape = self.inner.begun(t.told, half)
        else:
            shape = self.inner.whole(t.told, half)
        whole = begun(self.inner, t.told, len(x))
        return chosen((half > t.widest).any(axis=1), whole, (x, shape, np.full(len(x), t.told.origins - 1)))

    def reset(self, t: FollowerTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        super().reset(t, on)
        self.followed = np.where(on, t.sizes[0], self.followed)


def narrow(t: FollowerTables, now: ModeState, rows: Array, p: Array, kept: Array, lo: Array, hi: Array) -> None:
    """Cut the boxes of modes p that are older than the period to what bounds of x make of S x; in place.

    Parameters
    ----------
    t : FollowerTables
    now : ModeState
    rows, p : ndarray (S,) int
    kept : ndarray (S,) bool
    lo, hi : ndarray (S, n_x)
    """
    below, above = image(t.S_rounded, lo, hi, np.zeros(lo.shape, t.dtype))
    older = np.arange(now.alive.shape[-1]) > 0
    which = (kept[:, None] & older)[..., None]
    below, above = (below - t.xi_room)[:, None], (above + t.xi_room)[:, None]
    least, most = now.lo[rows, p], now.hi[rows, p]
    now.lo[rows, p] = least = np.where(which & (least < below), below, least)
    now.hi[rows, p] = most = np.where(which & (most > above), above, most)
    now.alive[rows, p] &= ~which[..., 0] | np.all(least <= most, axis=-1)


def hulls(t: FollowerTables, now: ModeState, alive: Array, followed: Array, own_lo: Array,
          own_hi: Array) -> tuple[Array, Array]:
    """Bounds of x over the hypotheses of every mode, those that the observer covers cut to its bounds.

    Parameters
    ----------
    t : FollowerTables
    now : ModeState
    alive : ndarray (S, N, M + 1) bool
        Hypotheses that count.
    followed : ndarray (S,) int
        Mode of the observer, N for none.
    own_lo, own_hi : ndarray (S, n_x)
        Its bounds.

    Returns
    -------
    lo, hi : ndarray (S, N, n_x)
        Infinite where a mode is impossible.
    """
    below, above = image(t.S_inverse, now.lo, now.hi, np.zeros(now.lo.shape, t.dtype))
    here = alive[..., None]
    below, above = np.where(here, below - t.x_room, np.inf), np.where(here, above + t.x_room, -np.inf)
    lo, hi = below[:, :, 1:].min(axis=2), above[:, :, 1:].max(axis=2)
    its = (followed[:, None] == np.arange(alive.shape[1]))[..., None]
    lo, hi = np.where(its & (own_lo[:, None] > lo), own_lo[:, None], lo), np.where(
        its & (own_hi[:, None] < hi), own_hi[:, None], hi)
    return np.minimum(lo, below[:, :, 0]), np.maximum(hi, above[:, :, 0])
