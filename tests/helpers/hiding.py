"""An adversary that hides a step of a fault from a mode estimator: a linear program over the plant as it is.

From power-up on it picks the first state, inputs, disturbances, noise and the size of the fault at once, the box of the
true mode's hypothesis beside them. A box that is no larger than cut and prediction allow lives exactly where that of
the estimator does, so the program meets the estimator, but for its rounding; the plant is that of the file.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import linprog

from codegen.algebra.interval import neg, pos
from codegen.observers.mode_set import ModeSet

Array = np.ndarray


class Rows:
    """Rows of a linear program over boxed variables."""

    def __init__(self):
        self.lo, self.hi, self.rows, self.right = [], [], [], []

    def variables(self, lo, hi) -> Array:
        """Indices of new ones."""
        self.lo, self.hi = [*self.lo, *lo], [*self.hi, *hi]
        return np.arange(len(self.lo) - len(lo), len(self.lo))

    def below(self, right, *terms) -> None:
        """Sum of M z[idx] <= right, for (M, idx) in terms."""
        self.rows.append((terms, len(right)))
        self.right += list(right)

    def most(self, index: int) -> Array | None:
        """The point where one variable is largest; None where there is none."""
        A, at = np.zeros((len(self.right), len(self.lo))), 0
        for terms, count in self.rows:
            for M, idx in terms:
                A[at:at + count, idx] += M
            at += count
        found = linprog(-np.eye(len(self.lo))[index], A_ub=A, b_ub=self.right, bounds=[*zip(self.lo, self.hi)])
        return found.x if found.success else None


def step_of(plant, q: int, j: int) -> tuple[Array, ...]:
    """A, B, Bw and column j of Bf over a period; disturbances and the fault are held."""
    m, n = plant.modes[q], plant.n_x
    columns = np.hstack([m.B, m.Bw, m.Bf[:, [j]]])
    if plant.kind == "discrete":
        A = m.A
    else:
        whole = np.zeros((n + columns.shape[1],) * 2)
        whole[:n] = np.hstack([m.A, columns])
        A, columns = np.split(expm(whole * plant.sample_period)[:n], [n], axis=1)
    return A, *np.split(columns, [m.B.shape[1], m.B.shape[1] + m.Bw.shape[1]], axis=1)


def hidden(plant, t, q: int, j: int, sign: int, promise: dict) -> tuple[float, Array, Array]:
    """The largest step of fault j that mode q's own hypothesis outlives for the samples promised; its u and y.

    Parameters
    ----------
    plant : Plant
        Without parameters.
    t : ModeTables
    q, j, sign : int
    promise : dict
        "within" and "after".
    """
    start, m, out, n, p = promise["after"] + 1, plant.modes[q], Rows(), plant.n_x, plant.n_y
    (A, B, Bw, Bf), unit, d = step_of(plant, q, j), np.eye(n), sign * m.Df[:, [j]]
    up, down = pos(t.Phi[q].astype(float)), neg(t.Phi[q].astype(float))
    f, x = out.variables([0], [plant.f[j].hi if sign > 0 else -plant.f[j].lo]), out.variables(plant.x0_lo, plant.x0_hi)
    kept, before = [], None
    for k in range(start + promise["within"] + 1):
        u, v, w = (out.variables(*ends) for ends in (plant.limits("u"), (m.v_lo, m.v_hi), (m.w_lo, m.w_hi)))
        lo, hi = out.variables(-t.limit, t.limit), out.variables(-t.limit, t.limit)
        on, first = float(k >= start), unit[:p]
        out.below(t.v_hi, (m.C, x), (m.Dv, v), (on * d, f), (-first, lo))
        out.below(-t.v_lo, (-m.C, x), (-m.Dv, v), (-on * d, f), (first, hi))
        out.below(np.zeros(n), (unit, lo), (-unit, hi))
        if before is None:
            out.below(-t.start_lo, (-unit, lo))
            out.below(t.start_hi, (unit, hi))
        else:
            a, b, held = before
            out.below(t.reach[q] - t.shift[q], (-unit, lo), (up, a), (-down, b), (t.Gamma[q], held))
            out.below(t.reach[q] + t.shift[q], (unit, hi), (-up, b), (down, a), (-t.Gamma[q], held))
        before, state = (lo, hi, u), x
        kept.append((x, u, v, on))
        x = out.variables(*plant.limits("x"))
        for s in (1, -1):
            out.below(np.zeros(n), (s * unit, x), (-s * A, state), (-s * B, u), (-s * Bw, w), (-s * sign * on * Bf, f))
    z = out.most(f[0])
    size = z[f]
    us = np.array([z[u] for _, u, _, _ in kept])
    return float(size[0]), us, np.array([m.C @ z[x] + m.D @ z[u] + m.Dv @ z[v] + on * d @ size for x, u, v, on in kept])


def alarmed(t, u: Array, y: Array) -> bool:
    """Whether the estimator finds anything."""
    return any(answer.alarm for answer in ModeSet(t).run(u, y))
