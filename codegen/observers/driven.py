"""Run-time family "driven": a pair of framers per possible mode, over the set of modes that nobody told.

The mode estimator (``mode_set``) says at every sample which hypotheses (mode, age) are possible. Framers of mode q, as
they are where the mode is told (``tnl``; N = 0 for the classical observer), are kept for every mode of the set:

1. they move by the step of their mode: they hold the state if that mode was active all through the last period;
2. all hypotheses of mode q but the one that was born within the period say that it was: their boxes are cut to what the
   framers make of S x. It begins with C x, which is cut by the measurement already: where zero is not in the framers'
   residual interval no box is left;
3. the state of (q, 0) is in the estimator's box alone, which knows of a switch at any instant: the framers are widened
   by it, at every sample at which it is possible, and start from it where they did not live;
4. they are cut to the estimator's boxes of their mode; empty: no hypothesis of mode q is left.

Framers in other coordinates carry z = Z x beside x (``changed``): 1 moves both; where 3 or a start has made x anew, z
is what Z makes of it; 4 cuts z to that, too.

So while no fault acts: where q is the true mode, its framers live and hold the state. Either the mode was active all
through the last period: then it was true at the last sample, too, its framers held the state and its step carries it;
what follows from the truth excludes nothing (1, 2). Or it began within the period (3). No mode left is a fault, or an
assumption broken. Framers never grow beyond the estimator's boxes, whatever the switching, and these profit from gains
and from measured parameters, which the estimator has not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .changed import blind_step, measured_step, turned
from .framer import FramerTables
from .mode_observer import ModeObserver, ModeTrace, expected, merged
from .mode_set import ModeSet, ModeState, image
from .mode_tables import ModeTables
from .supervisor import judge, undisturbed
from .told import Told, behind

Array = np.ndarray


@dataclass(frozen=True)
class DrivenTables(Told, ModeTables):
    """Constants of the estimator, and of the framers that it drives.

    Parameters
    ----------
    told : FramerTables
        Of the observer that is told its mode; C and D the same in all modes.
    S_rounded : ndarray (n_x, n_x), xi_room : ndarray (n_x,)
        S in the type of the C, and what that and the product may lose.
    """

    told: FramerTables | None = None
    S_rounded: Array | None = None
    xi_room: Array | None = None

    @property
    def vary(self):
        """Parameters and radii of the framers."""
        return self.told.vary

    @property
    def clamp(self) -> bool:
        """Whether the framers are cut to the declared ranges."""
        return self.told.clamp

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> DrivenTables:
        """Rebuild from ``to_dict``; ``sizes`` as of ``ModeTables``."""
        mode = ModeTables.from_dict(data, sizes)
        more = {name: np.array(data[name], dtype=np.float64).astype(mode.dtype) for name in ("S_rounded", "xi_room")}
        return behind(cls, mode, **more, told=FramerTables.from_dict(data["told"], mode.sizes))


class DrivenObserver(ModeObserver):
    """The framers among input checks and alarms; see ``Runner`` for the calls. No mode is read."""

    family = "driven"
    tables_class = DrivenTables

    def start(self, t: DrivenTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to the initial box (``<p>_init``)."""
        super().start(t, runs, x0_lo, x0_hi)
        self._forget(t, runs)

    def _forget(self, t: DrivenTables, runs: int) -> None:
        n_modes, n, n_u, n_y = t.sizes
        self.lo = self.hi = np.zeros((runs, n_modes, n), dtype=t.dtype)
        self.z = None if t.told.change is None else (self.lo, self.hi)
        self.framed = np.zeros((runs, n_modes), dtype=bool)
        self.u, self.y = np.zeros((runs, n_u), dtype=t.dtype), np.zeros((runs, n_y), dtype=t.dtype)
        self.theta = np.zeros((runs, 0 if t.vary is None else t.vary.parameters), dtype=t.dtype)
        self.full = np.zeros(runs, dtype=bool)

    def sample(self, t: DrivenTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: ModeTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        run = ModeSet(t)
        seen, before = run.seen(u, y), run.cut(self.state, None)
        r_lo, r_hi = expected(t, before, seen)
        now = merged(measured, run.cut(before, seen), before)
        lo, hi, z = self.moved(t, measured, y, theta)
        kept = self.framed & now.alive[..., 1:].any(axis=-1)
        now = narrowed(t, now, kept, lo, hi)
        lo, hi = framed(t, run, now, kept, lo, hi)
        sound = np.all(lo <= hi, axis=-1)
        if z is not None:
            z = turned(t.told, kept & now.alive[..., 1:].any(axis=-1) & ~now.alive[..., 0], (lo, hi), z)
            sound &= np.all(z[0] <= z[1], axis=-1)
        now.alive &= sound[..., None]
        raw, whole = ~now.alive.any(axis=(1, 2)), run.everywhere(t.wide_lo, t.wide_hi, measured.shape)
        now = merged(raw, whole, now)
        now.mode = self.state.mode
        anew = framed(t, run, whole, np.zeros_like(kept), lo, hi)
        lo, hi = (np.where(raw[:, None, None], a, b) for a, b in zip(anew, (lo, hi)))
        mode, lives = run.decided(now), now.alive.any(axis=2)
        after = merged(raw, now, run.carry(now, u))
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw[:, None])
        free = undisturbed(self.supervision, self.guard)
        again = again & measured
        fresh = merged(again, whole, after)
        fresh.mode = mode
        self.state = merged(on, fresh, self.state)
        self.state.mode = np.where(on, mode, now.mode)
        judged = on & measured
        self._keep(on, judged, lives & ~(raw | again)[:, None], (lo, hi), z, u, y, theta)
        out.x_lo[on] = np.where(lives[..., None], lo, np.inf).min(axis=1)[on]
        out.x_hi[on] = np.where(lives[..., None], hi, -np.inf).max(axis=1)[on]
        out.r_lo[judged], out.r_hi[judged] = r_lo[judged], r_hi[judged]
        self._answer(out, on, measured, now, mode, raw, alarm, np.where(measured, assured, free))

    def moved(self, t: DrivenTables, measured: Array, y: Array, theta: Array):
        """Framers of every mode after a step of their own: lo, hi (S, N, n_x), and those of z or None."""
        told, runs = t.told, len(measured)
        out, out_z = ([np.zeros_like(self.lo) for _ in range(2)] for _ in range(2))
        step = self.theta
        if told.vary is not None and told.vary.midpoint:
            step = (self.theta + theta) * t.dtype.type(0.5)
        corrected = (self.full & measured)[:, None]
        for p in range(t.sizes[0]):
            q, x = np.full(runs, p), (self.lo[:, p], self.hi[:, p])
            z = None if self.z is None else (self.z[0][:, p], self.z[1][:, p])
            full = measured_step(told, q, x, z, self.u, self.y, y, step, theta - self.theta)
            blind = blind_step(told, q, x, self.u)
            for to, a, b in zip((out, out_z), full, blind):
                for side in range(0 if a is None else 2):
                    to[side][:, p] = np.where(corrected, a[side], b[side])
        return *out, None if self.z is None else out_z

    def _keep(self, on: Array, judged: Array, lives: Array, x, z, u: Array, y: Array, theta: Array) -> None:
        """Store what the next sample needs, for the runs in ``on``."""
        def stored(new, old):
            return tuple(np.where((on[:, None] & lives)[..., None], a, b) for a, b in zip(new, old))

        self.framed = np.where(on[:, None], lives, self.framed)
        self.lo, self.hi = stored(x, (self.lo, self.hi))
        self.z = None if z is None else stored(z, self.z)
        self.u = np.where(on[:, None], u, self.u)
        self.y, self.theta = (np.where(judged[:, None], new, old) for new, old in ((y, self.y), (theta, self.theta)))
        self.full = np.where(on, judged, self.full)

    def reset(self, t: DrivenTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        super().reset(t, on)
        self.framed = self.framed & ~on[:, None]


def narrowed(t: DrivenTables, now: ModeState, kept: Array, lo: Array, hi: Array) -> ModeState:
    """Cut the boxes of hypotheses that are older than the period to what framers make of S x; arguments as ``framed``.

    Returns
    -------
    ModeState
    """
    below, above = image(t.S_rounded, lo, hi, np.zeros(lo.shape, t.dtype))
    older = np.arange(now.alive.shape[-1]) > 0
    which = (kept[..., None] & older)[..., None]
    below, above = (below - t.xi_room)[:, :, None], (above + t.xi_room)[:, :, None]
    now.lo = np.where(which & (now.lo < below), below, now.lo)
    now.hi = np.where(which & (now.hi > above), above, now.hi)
    now.alive = now.alive & np.all(now.lo <= now.hi, axis=-1)
    return now


def framed(t: DrivenTables, run: ModeSet, now: ModeState, kept: Array, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Framers of every mode that is possible, widened by what began within the period, cut to the estimator's boxes.

    Parameters
    ----------
    t : DrivenTables
    run : ModeSet
    now : ModeState
        After the cut with the measurement.
    kept : ndarray (S, N) bool
        Framers that have moved and hold.
    lo, hi : ndarray (S, N, n_x)

    Returns
    -------
    lo, hi : ndarray (S, N, n_x)
        Crossed where a mode is impossible.
    """
    below, above = image(t.S_inverse, now.lo, now.hi, np.zeros(now.lo.shape, t.dtype))
    alive, box = now.alive[..., None], t.told.box
    below, above = np.where(alive, below - t.x_room, np.inf), np.where(alive, above + t.x_room, -np.inf)
    kept = (kept & now.alive[..., 1:].any(axis=-1))[..., None]  # narrowing may have dropped them
    wide_lo, wide_hi = below.min(axis=2), above.max(axis=2)
    lo = np.where(kept, np.minimum(lo, below[:, :, 0]), wide_lo)
    hi = np.where(kept, np.maximum(hi, above[:, :, 0]), wide_hi)
    lo, hi = np.maximum(lo, wide_lo), np.minimum(hi, wide_hi)
    return np.maximum(lo, -box).astype(t.dtype), np.minimum(hi, box).astype(t.dtype)
