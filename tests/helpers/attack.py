"""An adversary of observers beside a mode estimator: it sees where the bounds are, and drives the truth into them.

The truth is in balls (``small_modes.moved``), the observer is stepped along with it. Every few samples the adversary
aims at one bound: carried back through the error loop of the active mode (plant, point observer or filter), the row
says which end of each disturbance and of the noise drives the error that way. Modes change at once, or later.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from flint import arb, ctx

from codegen.observers import FollowerTables, Supervision, TrailingTables

from .small_modes import moved

Array = np.ndarray
FARTHEST = 12  # samples from an aim to its bound
START = 5  # samples after which the initial box is forgotten


@dataclass
class Found:
    """How near the truth came to the bounds of each state, in widths; what was broken; largest share of a threshold."""

    near: list
    lost: list = field(default_factory=list)
    share: float = 0.0


def loop(plant, t, q: int):
    """Error loop of mode q: F, G (of w), L (of the noise, a sample later), N (of the noise at once), rows to aim at."""
    A, B, C, V = plant.enclosed.modes[q].A, plant.modes[q].Bw, plant.modes[q].C, plant.modes[q].Dv
    n, unit = len(A), np.eye(len(A))
    B = B if plant.kind == "discrete" else plant.sample_period * B
    if isinstance(t, TrailingTables):
        M, L, K, Dy = (getattr(t.told, name)[q].astype(float) for name in ("M", "L", "K", "Dy"))
        F = np.block([[A, np.zeros((n, len(M)))], [L @ C, M]])
        rows = [(np.concatenate([d @ C, k]), d @ V) for d, k in zip(Dy, K)]
        return F, np.vstack([B, np.zeros((len(M), B.shape[1]))]), np.vstack([0 * A @ C.T @ V, L @ V]), None, rows
    if isinstance(t, FollowerTables):
        L, N = t.told.L[q].astype(float), t.told.N[q].astype(float)
        T = unit - N @ C
        return T @ A - L @ C, T @ B, -L @ V, -N @ V, [(row, -row @ N @ V) for row in unit]
    # Boxes: noise decides where the measurement cuts, so that the end aimed at is the truth.
    return A, B, np.zeros((n, V.shape[1])), -np.linalg.pinv(C) @ V, [(row, -row @ np.linalg.pinv(C) @ V) for row in
                                                                    (*unit, *t.S.astype(float))]


class Aim:
    """One row of one loop, some samples ahead: weights of w and v until then."""

    def __init__(self, plant, t, q: int, rng):
        F, G, L, N, rows = loop(plant, t, q)
        row, now = rows[rng.integers(len(rows))]
        sign, self.left = rng.choice([-1, 1]), int(rng.integers(1, FARTHEST))
        row, self.w, self.v = sign * row, [np.zeros(G.shape[1])], [sign * now]
        for _ in range(self.left):
            self.w.insert(0, row @ G)
            before = row @ F
            self.v.insert(0, row @ L + (before @ N if N is not None else 0))
            row = before
        self.at = 0

    def ends(self, rng, weights: Array, lo: Array, hi: Array) -> Array:
        """The end of each range that the weights ask for; any where they do not care."""
        return np.where(weights > 0, hi, np.where(weights < 0, lo, rng.choice([lo, hi])))


def attacked(plant, observer, t, gap: int, runs: int, steps: int, seed: int) -> Found:
    """Attack tables of one number type.

    Parameters
    ----------
    plant : Plant
    observer : type
        Of ``observers.FAMILIES``.
    t : ModeTables
    gap : int
        Samples between switches at least.
    runs, steps, seed : int
    """
    before, ctx.prec = ctx.prec, 200
    try:
        return _attacked(plant, observer({t.real: t}, Supervision()), t, gap, runs, steps, np.random.default_rng(seed))
    finally:
        ctx.prec = before


def _attacked(plant, ob, t, gap: int, runs: int, steps: int, rng) -> Found:
    found, trace, cont = Found([np.inf] * plant.n_x), ob.empty(t, (runs, steps)), plant.kind == "continuous"
    ob.start(t, runs)
    truth = [Truth(plant, t, gap, rng, fast=run % 2 == 0) for run in range(runs)]
    for k in range(steps):
        signals = [one.measured(k) for one in truth]
        u, y, theta = (np.array(part).reshape(runs, -1) for part in zip(*signals))
        read = np.empty((runs, 0)) if t.vary is None else t.vary.read(theta)
        out = trace.row((slice(None), k))
        ob._one(t, *(a.astype(t.dtype) for a in (u, y)), np.zeros(runs, int), read.astype(t.dtype), out)
        for s, one in enumerate(truth):
            for i, (low, x, high) in enumerate(zip(out.x_lo[s].astype(float), one.x, out.x_hi[s].astype(float))):
                room = min(float((x - arb(low)).lower()), float((arb(high) - x).lower()))
                found.near[i] = min(found.near[i], room / (high - low)) if k > START else found.near[i]
                found.lost += [("bound", s, k)] * (room < 0)
            known = cont or k > 0  # of a discrete plant the mode of the step that led here
            found.lost += [("mode", s, k)] * (known and not int(out.mode_set[s]) >> one.mode & 1)
            found.lost += [("alarm", s, k)] * bool(out.raw_bits[s])
            if isinstance(t, TrailingTables) and known and out.mode[s] == one.mode and np.isfinite(out.f_hat[s]).all():
                share = float(np.max(np.abs(out.f_hat[s]).astype(float) / out.f_bound[s].astype(float)))
                found.share = max(found.share, share)
                found.lost += [("f_bound", s, k)] * (share > 1)
            one.move(k)
    return found


class Truth:
    """One run of the plant under attack."""

    def __init__(self, plant, t, gap: int, rng, fast: bool):
        self.plant, self.t, self.gap, self.rng, self.fast = plant, t, gap, rng, fast
        self.x = [arb(float(rng.choice(ends))) for ends in zip(plant.x0_lo, plant.x0_hi)]
        self.mode, self.cont = int(rng.integers(plant.n_modes)), plant.kind == "continuous"
        self.due = arb(float(rng.choice([0, 2 ** -40, 0.3, 1 - 2 ** -40]))) if self.cont else arb(int(rng.integers(2)))
        self.aim = None

    def measured(self, k: int) -> tuple:
        """u, y and parameters of this sample, noise as the aim asks."""
        m, rng = self.plant.modes[self.mode], self.rng
        if self.aim is None or self.aim.at > self.aim.left:
            self.aim = Aim(self.plant, self.t, self.mode, rng)
        self.u = np.array([rng.choice(ends) for ends in zip(*self.plant.limits("u"))])
        self.theta = [float(rng.choice(ends)) for ends in zip(*self.plant.limits("theta"))]
        v = self.aim.ends(rng, self.aim.v[self.aim.at], m.v_lo, m.v_hi)
        y = [sum((arb(float(a)) * b for row, values in ((m.C, self.x), (m.D, map(arb, map(float, self.u))),
                                                        (m.Dv, map(arb, map(float, v))))
                  for a, b in zip(row[i], values)), arb(0)) for i in range(self.plant.n_y)]
        return self.u, [float(value.mid()) for value in y], self.theta

    def move(self, k: int) -> None:
        """A period, in which the mode may change."""
        weights, self.aim.at = self.aim.w[self.aim.at], self.aim.at + 1
        cuts = [arb(k), arb(k + 1)]
        if self.due < k + 1 and self.cont:
            cuts.insert(1, self.due)
        for a, b in zip(cuts, cuts[1:]):
            if self.due < k + 1 and a >= self.due:
                self.mode = int(self.rng.choice([q for q in range(self.plant.n_modes) if q != self.mode]))
                late = 0 if self.fast else int(self.rng.integers(2 * FARTHEST))
                self.due += self.gap + late + (arb(float(self.rng.choice([0, 2 ** -40, 0.37]))) if self.cont else 0)
                self.aim.at = self.aim.left + 1  # the loop is another one
            m = self.plant.modes[self.mode]
            w = self.aim.ends(self.rng, weights, m.w_lo, m.w_hi)
            self.x = moved(m, self.x, self.u, w, self.theta, (b - a) * self.plant.sample_period if self.cont else None)
