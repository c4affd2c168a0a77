"""Run-time family "blocks": a point observer whose error set is a small matrix, carried on only where a block ends.

A mode that stays is cut into blocks of at most J samples; H holds the error at the start of the block, and what j
samples of mode b make of it is a table (``analysis.set_blocks``)::

    1  where a block ends, at a switch or after J samples:  H = the l columns of [A_b^j H, G_b,j], reduced
    2  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    3  h_i = |D_b,j,i H|_1 + c_b,j,i + v_q,i,   alarm where |d_i' r| > h_i
    4  keep x_hat, u, y, mode

The reduction is that of family "zonotope", once per block; within the block the set is exact in the chosen directions.
Any mode sequence will do. After a reset, a missing sample, where H has grown beyond its limit and where the estimate
has left the box that the margins rest on, H starts anew from every error that is possible.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointTables, plain
from .thresholds import ThresholdObserver, outside
from .zonotope import reduced, times

Array = np.ndarray


@dataclass(frozen=True)
class BlockTables:
    """The numbers of the blocks; N modes, O origins (``PointTables.origins``), J samples, d = m + n_x directions.

    Parameters
    ----------
    order : int
        l > n_x, columns of H.
    weight : ndarray (n_x,)
        Of the squares in a column's key: powers of two.
    directions : ndarray (m, n_y)
        The coordinates first. The directions of the rows are these, then the states.
    rows : ndarray (N, J + 1, d, n_x)
        What H is multiplied with, j samples after the block's start.
    scalars : ndarray (O, N, J + 1, d)
        What disturbance, noise and rounding have added by then.
    noise : ndarray (O, N, d)
        Noise of the sample itself, by its mode.
    powers : ndarray (N, J, n_x, n_x), pushed : ndarray (O, N, J, n_x, g)
        What makes H of the next block, after j = 1..J samples.
    e : ndarray (n_x,)
        Box beside the generators: rounding of everything.
    start, anywhere : ndarray (n_x,)
        Half widths of the first errors: of the initial box, and of all.
    most : ndarray (n_x,)
        Row sums of |H| beyond which the set starts anew.
    wide : ndarray (n_x,)
        Half widths of the bounds of x beyond which it does.
    """

    order: int
    weight: Array
    directions: Array
    rows: Array
    scalars: Array
    noise: Array
    powers: Array
    pushed: Array
    e: Array
    start: Array
    anywhere: Array
    most: Array
    wide: Array

    #: As a zonotope's: what columns are compared by, and that boxes are in the coordinates of x.
    key = "squared"
    oblique = False

    @property
    def longest(self) -> int:
        """J, samples in a block at most."""
        return self.rows.shape[1] - 1

    @property
    def words(self) -> int:
        """Numbers in the tables."""
        return sum(a.size for a in (self.directions, self.rows, self.scalars, self.noise, self.powers, self.pushed))

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> BlockTables:
        """Rebuild from ``to_dict``."""
        return cls(order=int(data["order"]), **{f.name: np.array(data[f.name], dtype=np.float64).astype(real)
                                                for f in fields(cls) if f.name != "order"})


class BlockObserver(ThresholdObserver):
    """The observer with blocks; see ``Runner`` for the calls.

    Its set is one row of numbers: H, one generator after the other, then the mode of the block, the origin of the
    estimate at its start, and the samples since.
    """

    family = "blocks"
    shape_class = BlockTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Nothing, of estimate and set: see ``start``."""
        return super().initial(x0_lo, x0_hi, shape, record, dtype) * 2

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """The initial box, or every error that is possible."""
        z = t.shape
        H = np.zeros((len(half), z.order, len(t.box)), dtype=t.dtype)
        diagonal = np.arange(len(t.box))
        H[:, diagonal, diagonal] = z.start if first else z.anywhere
        return np.concatenate([H.reshape(len(half), -1), np.tile([0, t.origins - 1, 0], (len(half), 1))],
                              axis=1).astype(t.dtype)

    @staticmethod
    def parts(t: PointTables, at: Array) -> tuple[Array, Array, Array, Array]:
        """H (S, n_x, l), mode of the block, origin at its start, samples since."""
        H = at[:, :-3].reshape(len(at), t.shape.order, -1).swapaxes(1, 2)
        with np.errstate(invalid="ignore"):
            return H, *at[:, -3:].astype(int).T

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, at: Array, measured: bool) -> Array:
        """The set one sample later, in mode p: the block goes on, or ends and the next begins."""
        if not measured:
            return self.whole(t, at)
        z, (H, block, before, since) = t.shape, self.parts(t, at)
        ends = (since > 0) & ((p != block) | (since >= z.longest))
        j = np.maximum(since, 1) - 1
        kept, box = reduced(z, np.concatenate([times(z.powers[block, j], H), z.pushed[before, block, j]], axis=2))
        new = np.concatenate([box[:, :, None] * np.eye(len(t.box), dtype=t.dtype), kept], axis=2)
        hull = np.abs(new[:, :, 0])
        for c in range(1, z.order):
            hull = hull + np.abs(new[:, :, c])
        fits = (hull <= z.most).all(axis=1)
        again, _, _, _ = self.parts(t, self.whole(t, at))
        new = np.where(fits[:, None, None], new, again)
        H = np.where(ends[:, None, None], new, H).swapaxes(1, 2).reshape(len(at), -1)
        words = [np.where(ends | (since == 0), p, block),
                 np.where(ends, np.where(fits, origin, t.origins - 1), before), np.where(ends, 0, since) + 1]
        return np.concatenate([H, np.stack(words, axis=1)], axis=1).astype(t.dtype)

    def reach(self, t: PointTables, q: Array, origin: Array, at: Array) -> Array:
        """Bounds in all directions, those of x last: (S, d)."""
        z, (H, block, before, since) = t.shape, self.parts(t, at)
        total = z.scalars[before, block, since] + z.noise[origin, q]
        along = times(z.rows[block, since], H)
        for c in range(z.order):
            total = total + np.abs(along[:, :, c])
        return total

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether estimate and set are what the margins rest on, per run."""
        return super().fits(t, x, radius) & (radius <= t.shape.wide).all(axis=1)

    def radius(self, t: PointTables, q: Array, origin: Array, at: Array) -> Array:
        """Half widths of the bounds of x."""
        return self.reach(t, q, origin, at)[:, len(t.shape.directions):]

    def judged(self, t: PointTables, q: Array, origin: Array, at: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside."""
        return outside(t.shape.directions, self.reach(t, q, origin, at), r)
