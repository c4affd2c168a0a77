"""Run-time family "mode": the modes that are still possible, invalidated one by one by the measurements.

Plant ``x' = A_q x + B_q u + w``, ``y = C x + D u + v`` with C common to the modes, w and v bounded, u held, the mode
unknown; it changes at any instant, not more often than every ``ages`` + 1 samples. In coordinates xi = S x whose first
components are C x, every hypothesis (mode, age) that is alive holds one box. Per sample:

1. cut the first components with y - D u - v; an empty box is the proof that its hypothesis is wrong;
2. none left: a fault, or bounds that do not hold. Start anew from the widest boxes;
3. carry every box over the period, ages by one, the oldest age meaning "at least so old";
4. a box of the oldest age in mode i gives birth to (j, 0) for every j: it switched within this period.

So the true (mode, age) is alive and holds the true state at every sample, through switches too. Every product and sum
is rounded by itself, in the order of the C; the tables hold what that can do.

Source: C. Zammali (2020), chapter 4, states the task (sliding modes there); this scheme is our own, with a guarantee.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .mode_tables import ModeTables

Array = np.ndarray


@dataclass
class ModeState:
    """Boxes lo, hi (..., N, M + 1, n_x), alive (..., N, M + 1) before the cut of the next sample; last decision."""

    lo: Array
    hi: Array
    alive: Array
    mode: Array | int = 0


@dataclass(frozen=True)
class ModeOutput:
    """Answer of one sample (arrays over runs, where there are several).

    Parameters
    ----------
    mode : int
        The decision: the mode of the oldest hypothesis alive; of several the last decision, else the first.
    mode_set : int
        Bit mask of the modes alive at any age: the true one is among them.
    settled_set : int
        The modes alive at age 1 or more: children just born, which nothing can tell yet, left out.
    x_lo, x_hi : ndarray (n_x,)
        Bounds of the state.
    alarm : bool
        No hypothesis was left.
    """

    mode: int
    mode_set: int
    settled_set: int
    x_lo: Array
    x_hi: Array
    alarm: bool


def image(A: Array, lo: Array, hi: Array, common: Array) -> tuple[Array, Array]:
    """Box of common + A x for x in a box, each product and sum rounded, columns in ascending order.

    Parameters
    ----------
    A : ndarray (rows, n)
    lo, hi : ndarray (..., n)
    common : ndarray (..., rows)

    Returns
    -------
    lo, hi : ndarray (..., rows)
    """
    below = above = common
    for k in range(A.shape[1]):
        up, a, b = A[:, k] >= 0, lo[..., k, None], hi[..., k, None]
        below = below + A[:, k] * np.where(up, a, b)
        above = above + A[:, k] * np.where(up, b, a)
    return below, above


def affine(base: Array, A: Array, x: Array) -> Array:
    """Return base + A x, each product and sum rounded: (..., rows), (rows, n), (..., n) -> (..., rows)."""
    total = np.broadcast_to(base, (*x.shape[:-1], base.shape[-1]))
    for k in range(A.shape[1]):
        total = total + A[:, k] * x[..., k, None]
    return total


class ModeSet:
    """The recursion in numpy, on one run or, with further leading axes, on many.

    Parameters
    ----------
    tables : ModeTables
    """

    def __init__(self, tables: ModeTables):
        self.tables = tables

    def start(self) -> ModeState:
        """State at power-up: every mode, long since, anywhere in the initial box."""
        return self.everywhere(self.tables.start_lo, self.tables.start_hi)

    def everywhere(self, lo: Array, hi: Array, runs: tuple[int, ...] = ()) -> ModeState:
        """Every mode, long since, anywhere in a box."""
        n_modes, n, _, _ = self.tables.sizes
        shape = (*runs, n_modes, self.tables.ages + 1, n)
        alive = np.zeros(shape[:-1], dtype=bool)
        alive[..., -1] = True
        zero = np.zeros(shape, dtype=self.tables.dtype)
        return ModeState(np.where(alive[..., None], lo[..., None, None, :], zero),
                         np.where(alive[..., None], hi[..., None, None, :], zero), alive,
                         np.zeros(runs, dtype=np.int64) if runs else 0)

    def seen(self, u: Array, y: Array) -> Array:
        """What is measured of C x and its noise, y - D u."""
        return affine(y, -self.tables.D, u)

    def cut(self, state: ModeState, seen: Array | None) -> ModeState:
        """Boxes cut to what the margins rest on, and with the measurement, where there is one; dead ones are zero."""
        t, p = self.tables, len(self.tables.v_lo)
        lo = np.where(state.lo >= -t.limit, state.lo, -t.limit)
        hi = np.where(state.hi <= t.limit, state.hi, t.limit)
        if seen is not None:
            least, most = (seen - t.v_hi)[..., None, None, :], (seen - t.v_lo)[..., None, None, :]
            lo[..., :p] = np.where(lo[..., :p] >= least, lo[..., :p], least)
            hi[..., :p] = np.where(hi[..., :p] <= most, hi[..., :p], most)
        alive = state.alive & np.all(lo <= hi, axis=-1)
        zero = np.zeros_like(lo)
        return ModeState(np.where(alive[..., None], lo, zero), np.where(alive[..., None], hi, zero), alive, state.mode)

    def decided(self, state: ModeState) -> Array:
        """The mode of the oldest hypothesis alive; of several the last decision, else the first."""
        ages = np.where(state.alive.any(axis=-1), state.alive.shape[-1] - np.argmax(state.alive[..., ::-1], axis=-1), 0)
        oldest = (ages == ages.max(axis=-1, keepdims=True)) & (ages > 0)
        kept = np.take_along_axis(oldest, np.asarray(state.mode)[..., None], axis=-1)[..., 0]
        return np.where(kept | ~oldest.any(axis=-1), state.mode, np.argmax(oldest, axis=-1))

    def bounds(self, state: ModeState) -> tuple[Array, Array]:
        """Bounds of x over all hypotheses alive; infinite where none is."""
        t = self.tables
        below, above = image(t.S_inverse, state.lo, state.hi, np.zeros(state.lo.shape, t.dtype))
        here = state.alive[..., None]
        lo = np.where(here, below - t.x_room, np.inf).min(axis=(-3, -2))
        hi = np.where(here, above + t.x_room, -np.inf).max(axis=(-3, -2))
        return lo, hi

    def carry(self, state: ModeState, u: Array) -> ModeState:
        """Boxes of the next sample, before its cut; births included."""
        t, n_modes = self.tables, self.tables.sizes[0]
        lo, hi = np.zeros_like(state.lo), np.zeros_like(state.hi)
        alive = np.zeros_like(state.alive)
        alive[..., 1:] = state.alive[..., :-1]
        alive[..., -1] |= state.alive[..., -1]
        for q in range(n_modes):
            old = state.alive[..., q, :]
            below, above = self.carried(q, (state.lo[..., q, :, :], state.hi[..., q, :, :]), u[..., None, :])
            below, above = below - t.reach[q], above + t.reach[q]
            lo[..., q, 1:, :], hi[..., q, 1:, :] = below[..., :-1, :], above[..., :-1, :]
            both, stays = (old[..., -1] & old[..., -2])[..., None], old[..., -1, None]
            for box, moved, pick in ((lo, below, np.minimum), (hi, above, np.maximum)):  # the two oldest become one
                one = pick(moved[..., -1, :], moved[..., -2, :])
                box[..., q, -1, :] = np.where(both, one, np.where(stays, moved[..., -1, :], moved[..., -2, :]))
        for i in range(n_modes):
            here, box = state.alive[..., i, -1], (state.lo[..., i, -1, :], state.hi[..., i, -1, :])
            for j in range(n_modes if here.any() else 0):
                if j != i:
                    below, above = self.born(i, j, box, u)
                    below, above = below - t.birth[i, j], above + t.birth[i, j]
                    first, wider = here & ~alive[..., j, 0], here & alive[..., j, 0]
                    for boxes, new, pick in ((lo, below, np.minimum), (hi, above, np.maximum)):
                        child = boxes[..., j, 0, :]
                        boxes[..., j, 0, :] = np.where(first[..., None], new, np.where(
                            wider[..., None], pick(child, new), child))
                    alive[..., j, 0] |= here
        zero = np.zeros_like(lo)
        return ModeState(np.where(alive[..., None], lo, zero), np.where(alive[..., None], hi, zero), alive, state.mode)

    def carried(self, q: int, box: tuple[Array, Array], u: Array) -> tuple[Array, Array]:
        """Box after one period in mode q, disturbances left out."""
        t = self.tables
        return image(t.Phi[q], *box, affine(t.shift[q], t.Gamma[q], u))

    def born(self, i: int, j: int, box: tuple[Array, Array], u: Array) -> tuple[Array, Array]:
        """Box after a period within which mode i became j, disturbances left out."""
        t = self.tables
        lo, hi = image(t.J[i, j], *box, affine(t.J_shift[i, j], t.J_u[i, j], u))
        size = np.where(-box[0] > box[1], -box[0], box[1])
        radius = affine(affine(t.J_reach[i, j], t.J_u_radius[i, j], np.abs(u)), t.J_radius[i, j], size)
        base, zero = self.carried(j, box, u), np.zeros_like(lo)
        return base[0] + np.minimum(lo - radius, zero), base[1] + np.maximum(hi + radius, zero)

    def step(self, state: ModeState, u: Array, y: Array) -> ModeOutput:
        """One sample of one run; ``state`` is updated.

        Parameters
        ----------
        state : ModeState
        u : ndarray (n_u,)
            Held until the next sample.
        y : ndarray (n_y,)

        Returns
        -------
        ModeOutput
        """
        t = self.tables
        u, y = np.asarray(u, dtype=t.real), np.asarray(y, dtype=t.real)
        now = self.cut(state, self.seen(u, y))
        alarm = not now.alive.any()
        if alarm:
            now = self.everywhere(t.wide_lo, t.wide_hi)
            now.mode = state.mode
        mode = int(self.decided(now))
        sets = [int(pack_modes(now.alive[..., first:])) for first in (0, 1)]
        out = ModeOutput(mode, *sets, *self.bounds(now), alarm)
        after = now if alarm else self.carry(now, u)
        state.lo, state.hi, state.alive, state.mode = after.lo, after.hi, after.alive, mode
        return out

    def run(self, u: Array, y: Array) -> list[ModeOutput]:
        """All samples of a run from power-up.

        Parameters
        ----------
        u : ndarray (K, n_u)
        y : ndarray (K, n_y)

        Returns
        -------
        list of ModeOutput
        """
        state = self.start()
        return [self.step(state, a, b) for a, b in zip(u, y)]


def pack_modes(alive: Array) -> Array:
    """Bit mask of the modes alive at any of the ages given: (..., N, ages) -> (...)."""
    weights = np.left_shift(1, np.arange(alive.shape[-2]))
    return (alive.any(axis=-1) * weights).sum(axis=-1)
