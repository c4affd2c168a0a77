r"""How far a continuous polytopic plant moves within a sampling period, and what that does to an observer's error.

At any time t of the period E x' = f(t), the plant's flow, a mean of A_m x + B_m u + Bd_m d over the ranges, and the
algebraic rows S' f = 0, there and at the sample. So for a row a of numbers, W near the inverse of [E; S' A], exactly

    a (x(t) - x) = a W [int f; g] + a (I - W [E; S' A_t]) (x(t) - x),
    g = -S' ((A_t - A_0) x + (B_t - B_0) u) - S' (Bd_t d(t) - Bd_0 d),

A_t, A_0 the means of A_i by the weights at t and at the sample. Bounds of the mean over the period of its magnitude:

* |a W f| is at most its largest value at a vertex; and because S' f = 0, so is that of a W f + k S' f for any k, chosen
  such that what is algebraic is taken out. Half a period of it is the mean of the integral.
* the weights change by as much as ``weight_slopes`` says of the mean |x(t) - x|, or as they like where it says nothing.
* the last term by the mean |x(t) - x| itself, from the width of the ranges downwards: each turn is sound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from flint import fmpq

from .exact import Q, eye, product, rational, zeros
from .polytope_ranges import Ranges, columns, largest, reach
from .weight_slopes import Slope, slopes, steepness

Array = np.ndarray
#: Turns of the mean distance: every one of them is sound, and they come down fast.
TURNS = 30


@dataclass(frozen=True)
class Drift:
    """The mean distance of a plant from where it was at the sample.

    Parameters
    ----------
    moved : object array (n,)
        Per state.
    W : object array (n, n + k)
        Near the inverse of [E; S' A].
    flows : tuple of (A, B, Bd)
        Of every vertex, for u and d in their units.
    S : object array (n, k)
    E : object array (n, n)
    out : object array (n, k) of doubles
        Takes what is algebraic out of a row of the flow: k of the text.
    box : Ranges
    period : fmpq
    left : object array (k,)
        Bounds of the algebraic rows on the right.
    """

    moved: Array
    W: Array
    flows: tuple[tuple[Array, Array, Array], ...]
    S: Array
    E: Array
    out: Array
    box: Ranges
    period: fmpq
    left: Array

    def of(self, rows: Array) -> Array:
        """Bounds of the mean of |a (x(t) - x)| for every row a.

        Parameters
        ----------
        rows : object array (k, n)
        """
        n = len(self.E)
        near = product(rows, self.W)
        out = self.period / 2 * self._fastest(near[:, :n])
        if len(self.left):
            out = out + product(abs(near[:, n:]), self.left.reshape(-1, 1))[:, 0]
        lost = []
        for A, _, _ in self.flows:
            rest = rows - product(near[:, :n], self.E) - product(near[:, n:], product(self.S.T, A))
            lost.append(product(abs(rest), self.moved.reshape(-1, 1))[:, 0])
        return out + largest(lost)

    def _fastest(self, rows: Array) -> Array:
        """Largest |a f| of every row a."""
        plain = largest([_flow(rows, flow, self.box) for flow in self.flows])
        if not self.S.shape[1]:
            return plain
        freed = rows + product(rational(rows.astype(float) @ self.out), self.S.T)
        return np.minimum(plain, largest([_flow(freed, flow, self.box) for flow in self.flows]))


def _flow(rows: Array, flow, box: Ranges) -> Array:
    """Largest magnitude of rows of the flow of one vertex."""
    A, B, Bd = (product(rows, M) for M in flow)
    return abs(columns([(A, box.x), (B, box.u), (Bd, box.d)])).sum(axis=1)


def drift(plant, problem, box: Ranges, period: float) -> Drift:
    """Bound how far a plant moves.

    Parameters
    ----------
    plant : Plant
        Continuous.
    problem : DescriptorProblem
    box : Ranges
    period : float
    """
    E, A, B, Bd, S = (rational(getattr(problem, k)) for k in ("E", "A", "B", "Bd", "S"))
    B, Bd, n = B * rational(problem.u_unit), Bd * rational(problem.d_unit), len(problem.E)
    mean = problem.A.mean(axis=0)
    W = rational(np.linalg.pinv(np.concatenate([problem.E, problem.S.T @ mean], axis=0)))
    kernel = np.linalg.svd(problem.E)[2][np.linalg.matrix_rank(problem.E):].T
    out = -mean @ kernel @ np.linalg.pinv(problem.S.T @ mean @ kernel) if kernel.size else np.zeros((n, 0))
    known = slopes(plant.polytope, [*_ends(*plant.limits("x")), *_ends(*plant.limits("u"))], zeros(len(plant.u)))
    found = Drift(2 * box.x[1], W, tuple(zip(A, B, Bd)), S, E, out, box, Q(period), zeros(S.shape[1]))
    for _ in range(TURNS):
        found = replace(found, left=_left(found, known))
        moved = np.minimum(found.moved, found.of(eye(n)))
        moved = rational(np.nextafter(moved.astype(float), np.inf))  # short numbers again, none smaller
        if all(moved >= found.moved * fmpq(999999, 1000000)):
            break
        found = replace(found, moved=moved)
    return found


def _ends(lo: Array, hi: Array) -> list:
    return [(Q(a), Q(b)) for a, b in zip(lo, hi)]


def _left(found: Drift, known: tuple[Slope, ...] | None) -> Array:
    """The algebraic rows at t less those at the sample: by weights that moved, and by another disturbance."""
    S, box = found.S.T, found.box
    if not len(S):
        return zeros(0)
    still = [columns([(product(S, A), box.x), (product(S, B), box.u)]) for A, B, _ in found.flows]
    mean = sum(still[1:], still[0]) / len(still)
    steep, spread = steepness(known or (), np.array([a - mean for a in still], dtype=object))
    out = rational(spread)
    if known is not None:
        far = np.array([abs(s.state) @ found.moved for s in known], dtype=object)
        out = np.minimum(out, far @ rational(steep))
    noise = [product(S, Bd) for _, _, Bd in found.flows]
    if all(np.all(a == noise[0]) for a in noise):
        return out + 2 * product(abs(noise[0]), box.d[1].reshape(-1, 1))[:, 0]
    return out + 2 * largest([reach(a, box.d) for a in noise])
