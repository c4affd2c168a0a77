"""Boxes that the reduced error set enters and keeps, in the coordinates in which it is boxed, under a dwell time.

Boxing leaves the row sums b of |B H| as they are, and with M = S B a step of mode p, seen in the coordinates of the
mode q that follows, obeys ``b+ <= |B_q S_p| (b + inside_p + rounding) + |B_q| (what the step adds)``. One box per mode
and samples that it has lasted (capped at the dwell time), found by a linear program, proved in rationals on the numbers
of the C.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq_mat
from scipy.optimize import linprog

from .exact import product, rational, up
from .reduction import every_sample
from .sets import ZonotopeDemands, column

Array = np.ndarray


class Boxes:
    """The steps between boxes, exact.

    Parameters
    ----------
    t : PointTables
    demands : ZonotopeDemands
    dwell : int
        Samples that every mode lasts at least.
    """

    def __init__(self, t, demands: ZonotopeDemands, dwell: int):
        z, n, modes = t.shape, len(t.box), range(len(t.A))
        self.steps, self.dwell = every_sample(len(t.A), dwell), dwell
        unit = rational(np.eye(n))
        self.B = [rational(z.B[q]) if z.oblique else unit for q in modes]
        S = [rational(z.S[q]) if z.oblique else demands.of.M[q] for q in modes]
        # The sum of a box may be rounded up by as much as ``inside`` allows for rounding it down.
        inside = [rational(z.inside[q]) if z.oblique else demands.e for q in modes]
        slip = [least - product(abs(B), column(demands.e)).ravel() for least, B in zip(demands.inside(), self.B)]
        slip = slip or [demands.chain(demands.reach)] * len(t.A)
        self.maps = {(p, q): abs(product(self.B[q], S[p])) for p in modes for q in modes}
        self.added = {}
        for p in modes:
            push = np.max(abs(rational(z.F[p])).sum(axis=2), axis=0) + demands.carry(demands.of.M[p])
            push = push + demands.turn(p, True)
            for q in modes:
                self.added[p, q] = (product(self.maps[p, q], column(inside[p] + slip[p]))
                                    + product(abs(self.B[q]), column(push))).ravel()
        self.mode = [q for q, _ in self.steps.states]
        self.scale = [np.maximum(np.abs(np.array(b, dtype=float)) @ t.limit.astype(float), 1e-300) for b in self.B]

    def found(self) -> Array | None:
        """Half widths (S, n), the smallest sum of them; None where there are none."""
        count, n = len(self.steps.states), len(self.scale[0])
        rows, most = [], []
        for s, e in zip(self.steps.source, self.steps.target):
            p, q = self.mode[s], self.mode[e]
            block = np.zeros((n, count, n))
            block[:, s] += np.array(self.maps[p, q], dtype=float) * (1 + 1e-7) * self.scale[p] / self.scale[q][:, None]
            block[:, e] -= np.eye(n)
            rows.append(block.reshape(n, -1))
            most.append(-np.array(self.added[p, q], dtype=float) * (1 + 1e-7) / self.scale[q])
        solved = linprog(np.ones(count * n), A_ub=np.concatenate(rows), b_ub=np.concatenate(most),
                         bounds=[(1e-9, None)] * (count * n))
        if solved.status != 0:
            return None
        return solved.x.reshape(count, n) * np.array([self.scale[q] for q in self.mode]) * (1 + 1e-6)

    def broken(self, half: Array) -> tuple[int, int] | None:
        """Mode and coordinate where half widths (S, n) are not kept and entered; None where they are."""
        half = rational(half)
        for s, e in zip(self.steps.source, self.steps.target):
            p, q = self.mode[s], self.mode[e]
            moved = product(self.maps[p, q], column(half[s])).ravel()
            for i in range(half.shape[1]):
                if moved[i] + self.added[p, q][i] > half[e][i] or moved[i] >= half[e][i]:
                    return q, i
        return None

    def in_x(self, half: Array) -> Array:
        """Half widths (n,) in the coordinates of x that hold all boxes, rounded up."""
        out = []
        for q, box in zip(self.mode, rational(half)):
            back = fmpq_mat(*self.B[q].shape, list(self.B[q].ravel())).inv()
            size = np.array([abs(x) for x in back.entries()], dtype=object).reshape(self.B[q].shape)
            out.append([up(x) for x in product(size, column(box)).ravel()])
        return np.max(out, axis=0)
