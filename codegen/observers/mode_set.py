"""Which modes are still possible: set-membership invalidation of hypotheses (mode, age) by sampled measurements.

Plant ``x' = A_q x + B_q u + w``, ``y = C x + D u + v`` with C common to the modes, w and v bounded, u held, the mode
unknown; it changes at any instant, not more often than every ``ages`` + 1 samples. In coordinates xi = S x whose first
components are C x, every hypothesis that is alive holds one box. Per sample:

1. cut the first components with y - D u - v; an empty box is the proof that its hypothesis is wrong;
2. none left: a fault, or bounds that do not hold. Start anew from the widest boxes;
3. carry every box over the period, ages by one, the oldest age meaning "at least so old";
4. a box of the oldest age in mode i gives birth to (j, 0) for every j: it switched within this period.

So the true (mode, age) is alive and holds the true state at every sample, through switches too.

Source: C. Zammali (2020), chapter 4, states the task (sliding modes there); this scheme is our own, with a guarantee.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..algebra.interval import neg, pos

Array = np.ndarray


@dataclass(frozen=True)
class ModeTables:
    """Constants of one period, each box enlarged for what rounding may add.

    Parameters
    ----------
    S : ndarray (n_x, n_x), S_inverse : ndarray (n_x, n_x)
    x_room : ndarray (n_x,)
        What S_inverse and its product may lose.
    Phi : ndarray (N, n_x, n_x), Gamma : ndarray (N, n_x, n_u), shift : ndarray (N, n_x)
        xi+ = Phi xi + Gamma u + shift +- reach.
    reach : ndarray (N, n_x)
    J : ndarray (N, N, n_x, n_x), J_u : ndarray (N, N, n_x, n_u), J_shift : ndarray (N, N, n_x)
        From mode i to j within the period: what is added lies between 0 and J xi + J_u u + J_shift +- (J_radius |xi| +
        J_u_radius |u| + J_reach).
    J_radius, J_u_radius, J_reach : ndarray (N, N, n_x, n_x), (N, N, n_x, n_u), (N, N, n_x)
    birth : ndarray (N, N, n_x)
        What the disturbances of both modes reach in the period; at least ``reach``.
    D : ndarray (n_y, n_u)
    v_lo, v_hi : ndarray (n_y,)
        Bounds of y - C x - D u.
    start_lo, start_hi : ndarray (n_x,)
        Box of xi at power-up.
    wide_lo, wide_hi : ndarray (n_x,)
        Box of xi by the declared ranges: start after an alarm.
    ages : int
        Oldest age M; the dwell time is at least M + 1 samples.
    real : str
    """

    S: Array
    S_inverse: Array
    x_room: Array
    Phi: Array
    Gamma: Array
    shift: Array
    reach: Array
    J: Array
    J_u: Array
    J_shift: Array
    J_radius: Array
    J_u_radius: Array
    J_reach: Array
    birth: Array
    D: Array
    v_lo: Array
    v_hi: Array
    start_lo: Array
    start_hi: Array
    wide_lo: Array
    wide_hi: Array
    ages: int
    real: str = "float64"

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Modes, states, inputs, outputs."""
        return self.Phi.shape[0], self.Phi.shape[1], self.Gamma.shape[2], len(self.v_lo)

    def to_dict(self) -> dict:
        """Return plain lists for design.json."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}

    @classmethod
    def from_dict(cls, data: dict) -> ModeTables:
        """Rebuild from ``to_dict``."""
        return cls(**{k: np.array(v, dtype=data["real"]) if isinstance(v, list) else v for k, v in data.items()})


@dataclass
class ModeState:
    """Boxes lo, hi (N, M + 1, n_x), alive (N, M + 1) before the cut of the next sample, and the last decision."""

    lo: Array
    hi: Array
    alive: Array
    mode: int = 0


@dataclass(frozen=True)
class ModeOutput:
    """Answer of one sample.

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


def image(A: Array, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Box of A x for x in a box."""
    P, N = pos(A), neg(A)
    return P @ lo - N @ hi, P @ hi - N @ lo


class ModeSet:
    """The recursion in numpy.

    Parameters
    ----------
    tables : ModeTables
    """

    def __init__(self, tables: ModeTables):
        self.tables = tables

    def start(self) -> ModeState:
        """State at power-up: every mode, long since, anywhere in the initial box."""
        return self._everywhere(self.tables.start_lo, self.tables.start_hi)

    def _everywhere(self, lo: Array, hi: Array) -> ModeState:
        n_modes, n, _, _ = self.tables.sizes
        shape = (n_modes, self.tables.ages + 1, n)
        alive = np.zeros(shape[:2], dtype=bool)
        alive[:, -1] = True
        return ModeState(np.broadcast_to(lo, shape).copy(), np.broadcast_to(hi, shape).copy(), alive)

    def step(self, state: ModeState, u: Array, y: Array) -> ModeOutput:
        """One sample; ``state`` is updated.

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
        real = np.dtype(t.real).type
        u, y = np.asarray(u, dtype=real), np.asarray(y, dtype=real)
        self._cut(state, u, y)
        alarm = not state.alive.any()
        if alarm:
            mode = state.mode
            fresh = self._everywhere(t.wide_lo, t.wide_hi)
            self._cut(fresh, u, y)
            if not fresh.alive.any():  # y itself is out of range
                fresh = self._everywhere(t.wide_lo, t.wide_hi)
            state.lo, state.hi, state.alive = fresh.lo, fresh.hi, fresh.alive
            state.mode = mode
        out = self._answer(state, alarm)
        self._carry(state, u)
        return out

    def _cut(self, state: ModeState, u: Array, y: Array) -> None:
        t, p = self.tables, len(y)
        seen = y - t.D @ u
        state.lo[..., :p] = np.maximum(state.lo[..., :p], seen - t.v_hi)
        state.hi[..., :p] = np.minimum(state.hi[..., :p], seen - t.v_lo)
        state.alive &= np.all(state.lo <= state.hi, axis=-1)

    def _answer(self, state: ModeState, alarm: bool) -> ModeOutput:
        t = self.tables
        oldest = int(np.max(np.flatnonzero(state.alive.any(axis=0))))
        candidates = np.flatnonzero(state.alive[:, oldest])
        if state.mode not in candidates:
            state.mode = int(candidates[0])
        lo, hi = state.lo[state.alive], state.hi[state.alive]
        boxes = [image(t.S_inverse, a, b) for a, b in zip(lo, hi)]
        bits = [sum(1 << int(q) for q in np.flatnonzero(state.alive[:, first:].any(axis=1))) for first in (0, 1)]
        return ModeOutput(state.mode, bits[0], bits[1], np.min([b[0] for b in boxes], axis=0) - t.x_room,
                          np.max([b[1] for b in boxes], axis=0) + t.x_room, alarm)

    def _carry(self, state: ModeState, u: Array) -> None:
        t = self.tables
        n_modes, _, _, _ = t.sizes
        lo, hi = np.full_like(state.lo, np.inf), np.full_like(state.hi, -np.inf)
        alive = np.zeros_like(state.alive)

        def add(q: int, age: int, box: tuple[Array, Array], reach: Array) -> None:
            lo[q, age] = np.minimum(lo[q, age], box[0] - reach)
            hi[q, age] = np.maximum(hi[q, age], box[1] + reach)
            alive[q, age] = True

        for i, age in zip(*np.nonzero(state.alive)):
            box = state.lo[i, age], state.hi[i, age]
            add(i, min(age + 1, t.ages), self.carried(i, box, u), t.reach[i])
            if age == t.ages:
                for j in range(n_modes):
                    if j != i:
                        add(j, 0, self.born(i, j, box, u), t.birth[i, j])
        state.lo, state.hi, state.alive = lo, hi, alive

    def carried(self, q: int, box: tuple[Array, Array], u: Array) -> tuple[Array, Array]:
        """Box after one period in mode q, disturbances left out."""
        lo, hi = image(self.tables.Phi[q], *box)
        move = self.tables.Gamma[q] @ u + self.tables.shift[q]
        return lo + move, hi + move

    def born(self, i: int, j: int, box: tuple[Array, Array], u: Array) -> tuple[Array, Array]:
        """Box after a period within which mode i became j, disturbances left out."""
        t = self.tables
        lo, hi = image(t.J[i, j], *box)
        size = np.maximum(np.abs(box[0]), np.abs(box[1]))
        move = t.J_u[i, j] @ u + t.J_shift[i, j]
        radius = t.J_radius[i, j] @ size + t.J_u_radius[i, j] @ np.abs(u) + t.J_reach[i, j]
        base = self.carried(j, box, u)
        zero = np.zeros_like(lo)
        return base[0] + np.minimum(lo + move - radius, zero), base[1] + np.maximum(hi + move + radius, zero)

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
