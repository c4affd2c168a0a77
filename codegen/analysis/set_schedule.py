"""T1: thresholds of a residual set along a known periodic schedule, one row per sample and no set work on the target.

Exact in the chosen directions for as many laps as the table holds; its last lap holds for all later ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.error_set import ErrorRecursion
from ..algebra.residual_sets import befores, thresholds
from .set_stay import OUTWARD, Stay

Array = np.ndarray

#: Laps that are looked at one by one; a lap may contract so much that a norm would be kept for nothing but the first.
LAPS = 3


@dataclass(frozen=True)
class ScheduleTable:
    """T1: thresholds of a known schedule, one row per sample; the last ``period`` rows repeat.

    Parameters
    ----------
    directions : ndarray (d, m)
    h : ndarray (K, d)
    period : int
    """

    directions: Array
    h: Array
    period: int

    def along(self, steps: int) -> Array:
        """Return the thresholds of samples 0..steps - 1.

        Parameters
        ----------
        steps : int

        Returns
        -------
        h : ndarray (steps, d)
        """
        k = np.arange(steps)
        return self.h[np.where(k < len(self.h), k, len(self.h) - self.period + (k - len(self.h)) % self.period)]


def schedule_table(m: ErrorRecursion, lead: Sequence[int], cycle: Sequence[int], H0: Array, directions: Array,
                   laps: int = 2) -> ScheduleTable:
    """Tabulate thresholds for the schedule ``lead`` and then ``cycle`` for ever (T1).

    Parameters
    ----------
    m : ErrorRecursion
    lead, cycle : sequence of int
        Modes; the lead may be empty.
    H0 : ndarray (n, g)
    directions : ndarray (d, m)
    laps : int
        Cycles that have rows of their own, at least 2; the last holds for all later ones, the others are exact.

    Returns
    -------
    table : ScheduleTable

    Raises
    ------
    DesignError
        The product over a cycle is not stable.
    """
    P, path = len(cycle), [*lead, *list(cycle) * max(laps, 2)]
    h = thresholds(m, path, H0, directions)
    H = np.asarray(H0, dtype=float)
    for k, (b, q) in enumerate(zip(befores(m, path), path)):
        if k >= len(path) - P:  # from here on every sample has its like a lap before: the same mode before it, too
            M, W = _lap(m, path, k, P)
            ever = Stay(M, W, directions @ m.C[q], LAPS, "schedule").ever(H, [W], 0)
            h[k] = np.maximum(h[k], ever + zonotope.support(m.V[b, q], directions))
        H = np.concatenate([m.A[q] @ H, m.W[b, q]], axis=1)
    return ScheduleTable(np.asarray(directions, dtype=float), h * OUTWARD, P)


@dataclass(frozen=True)
class PhaseTable:
    """T1 for firmware that may start at any phase of the schedule: where a mode is not the expected one it starts anew.

    Parameters
    ----------
    cycle : tuple of int
        Modes of one period.
    first : ndarray (J, d)
        Samples 0..J - 1 from the initial box on, which is at phase 0.
    anew : ndarray (J, Q, d)
        The same by mode from any error on, at whatever phase.
    lap : ndarray (P, d)
        By phase, for ever after J samples of either.
    """

    cycle: tuple[int, ...]
    first: Array
    anew: Array
    lap: Array


def phase_table(m: ErrorRecursion, cycle: Sequence[int], first: Array, anywhere: Array, directions: Array,
                rows: int) -> PhaseTable:
    """Tabulate thresholds of a periodic schedule from two sets of first errors (T1).

    Parameters
    ----------
    m : ErrorRecursion
    cycle : sequence of int
    first, anywhere : ndarray (n, g)
        Generators of the first error at sample 0, and wherever the firmware starts anew.
    directions : ndarray (d, m)
    rows : int
        J >= 1, samples after either start that have rows of their own.

    Returns
    -------
    table : PhaseTable

    Raises
    ------
    DesignError
        The product over a cycle is not stable.
    """
    P, d, cycle = len(cycle), len(directions), tuple(cycle)
    laps = [_lap(m, cycle * 2, P + i, P) for i in range(P)]
    stays = [Stay(M, W, directions @ m.C[q], LAPS, "schedule") for (M, W), q in zip(laps, cycle)]
    begin, lap = np.zeros((rows, d)), np.zeros((P, d))
    anew = np.array([np.broadcast_to(zonotope.support(C @ anywhere, directions) + zonotope.support(V, directions),
                                     (rows, d)) for C, V in zip(m.C, m.V[m.start])]).swapaxes(0, 1)
    anew[1:, sorted(set(cycle))] = 0.0  # a mode that is not in the schedule never gets beyond its first row
    for start, H in [(None, first), *((i, anywhere) for i in range(P))]:
        for k in range(rows + P):
            i = (k + (start or 0)) % P
            q, before = cycle[i], cycle[i - 1] if k else m.start
            noise = zonotope.support(m.V[before, q], directions)
            if k >= rows:
                lap[i] = np.maximum(lap[i], stays[i].ever(H, [laps[i][1]], 0) + noise)
            else:
                row = begin[k] if start is None else anew[k, q]
                np.maximum(row, zonotope.support(m.C[q] @ H, directions) + noise, out=row)
            H = np.concatenate([m.A[q] @ H, m.W[before, q]], axis=1)
    return PhaseTable(cycle, begin * OUTWARD, anew * OUTWARD, lap * OUTWARD)


def _lap(m: ErrorRecursion, path: Sequence[int], start: int, steps: int) -> tuple[Array, Array]:
    """Matrix and generators of one lap from a sample of the last lap of a path on."""
    W, M = np.zeros((m.A.shape[1], 0)), np.eye(m.A.shape[1])
    on = [*path, *path[-steps:]]  # one lap more
    for b, q in zip(on[start - 1:start + steps - 1], on[start:start + steps]):
        W, M = np.concatenate([m.A[q] @ W, m.W[b, q]], axis=1), m.A[q] @ M
    return M, W
