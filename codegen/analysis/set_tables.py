"""T2: thresholds of a residual set by mode and time since the mode was entered; no set work on the target.

The support of the residual set in a fixed direction d is the fault-free maximum of d' r. It depends on the mode
sequence alone: where a minimum dwell time is known, it is bounded by a table over the mode and how long it has been
active. (A known schedule: ``set_schedule``, T1. Any sequence, with one small matrix carried online: ``set_blocks``,
T3.) Rows are suprema over what the table does not tell apart, tails included; ``certify.set_bounds`` proves them with
outward rounding on the numbers of the table.

Source: Zammali (2020), chapter 6, has the online recursion only; the tables are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.bases import bases
from ..algebra.error_set import ErrorRecursion
from ..errors import DesignError
from .set_stay import OUTWARD, Stay

Array = np.ndarray

#: Rows after which the look back over the stay before is left out: little of it is left by then.
MOST_BACK = 64
#: Fewer where a mode settles so slowly that its list of steps would hold more numbers than that.
MOST_NUMBERS = 1_000_000


@dataclass(frozen=True)
class DwellTable:
    """T2: thresholds by stage, mode and samples since the mode was entered, for a minimum dwell time.

    Parameters
    ----------
    directions : ndarray (d, m)
    h : ndarray (S, Q, J + 1, d)
        Stage min(switches so far, S - 1), mode, min(samples since it was entered, J).
    boxes : ndarray (S, Q, n)
        ``|T_q^-1 e| <= b`` on entering mode q in stage s >= 1 (stage 0: zeros; there the first error counts). The last
        is mapped into itself.
    coordinates : ndarray (Q, n, n)
    dwell : int
        Samples a mode lasts at least.
    back : int
        Samples after a switch up to which the stay before it was looked at.
    """

    directions: Array
    h: Array
    boxes: Array
    coordinates: Array
    dwell: int
    back: int

    def along(self, path: Sequence[int]) -> Array:
        """Return the thresholds of a path from sample 0 on, as the firmware looks them up.

        Parameters
        ----------
        path : sequence of int

        Returns
        -------
        h : ndarray (K, d)
        """
        stage = j = 0
        out = []
        for k, q in enumerate(path):
            if k and q != path[k - 1]:
                stage, j = min(stage + 1, len(self.h) - 1), 0
            elif k:
                j = min(j + 1, self.h.shape[2] - 1)
            out.append(self.h[stage, q, j])
        return np.array(out)

    @property
    def words(self) -> int:
        """Numbers in the table."""
        return self.h.size


def dwell_table(m: ErrorRecursion, dwell: int, H0: Array, directions: Array, rows: int, stages: int = 3,
                coordinates: Array | None = None, inflate: float = 1.002) -> DwellTable:
    """Tabulate thresholds for every mode sequence in which a mode lasts at least ``dwell`` samples (T2).

    On entering a mode the error is in a box (in the coordinates of that mode); the box of a stage holds whatever can
    leave the stage before after ``dwell`` or more samples. The box of the last stage is the smallest one above the
    stage before that is mapped into itself, inflated and checked.

    Parameters
    ----------
    m : ErrorRecursion
    dwell : int
        At least 1 (any sequence).
    H0 : ndarray (n, g)
        Generators of the first error.
    directions : ndarray (d, m)
    rows : int
        J >= 0: the row J holds for all later samples.
    stages : int
        At least 2 with several modes: before the first switch, after it, ...; with one mode there is one.
    coordinates : ndarray (n, n) or (Q, n, n) or None
        T_q; None: those of x.
    inflate : float
        Above 1: by so much the last box is larger than the fixed point.

    Returns
    -------
    table : DwellTable

    Raises
    ------
    DesignError
        The boxes grow without bound, or a mode is not stable.
    """
    return _Dwell(m, dwell, H0, directions, rows, stages, coordinates).table(inflate)


def best_dwell_table(m: ErrorRecursion, dwell: int, H0: Array, directions: Array, rows: int,
                     stages: int = 3) -> tuple[str, DwellTable]:
    """Return the table of the coordinates with the smallest thresholds in the last stage.

    Parameters
    ----------
    m, dwell, H0, directions, rows, stages :
        As ``dwell_table``.

    Returns
    -------
    name : str
        Of the coordinates.
    table : DwellTable

    Raises
    ------
    DesignError
        In no coordinates is there one; that of the coordinates of x.
    """
    found, first = [], None
    for name, T in bases(m.A):
        try:
            table = dwell_table(m, dwell, H0, directions, rows, stages, T)
        except DesignError as error:
            first = first or error
            continue
        size = np.mean(np.log(np.maximum(table.h[-1], 1e-300)))
        found.append((size - (1e-3 if T is None else 0.0), len(found), name, table))
        if m.modes == 1:
            break  # the first error is all that ever enters
    if not found:
        raise first
    return min(found)[2:]


class _Dwell:
    """The computation of ``dwell_table``: boxes stage by stage, then the thresholds.

    A threshold looks back over one whole stay exactly, at the worst mode before and the worst time it lasted; only two
    switches back the error is taken from a box.
    """

    def __init__(self, m: ErrorRecursion, dwell: int, H0: Array, directions: Array, rows: int, stages: int,
                 coordinates: Array | None):
        Q, n = m.modes, m.A.shape[1]
        self.m, self.dwell, self.rows, self.stages = m, dwell, rows, stages if Q > 1 else 1
        self.H0, self.directions = np.asarray(H0, dtype=float), np.asarray(directions, dtype=float)
        eye = np.eye(n) if coordinates is None else coordinates
        self.T = np.array(np.broadcast_to(eye, (Q, n, n)), dtype=float)
        self.back = np.linalg.inv(self.T)
        self.boxes = [np.zeros((Q, n))]
        self.stays = [Stay(m.A[q], m.W[q, q], directions @ m.C[q], rows, f"mode {q}") for q in range(Q)]
        slowest = max(stay.last for stay in self.stays)
        self.back_to = max(1, min(MOST_BACK, MOST_NUMBERS // (len(self.directions) * n * slowest)))
        self.before: dict[tuple[int, int], Stay] = {}
        self.exits = [Stay(m.A[q], m.W[q, q], np.concatenate(self.back), 0, f"mode {q}") for q in range(Q)]

    def entry(self, stage: int, q: int) -> tuple[Array, list[Array]]:
        """What mode q starts from in a stage, and what its first step may add."""
        if stage == 0:
            return self.H0, [self.m.W[self.m.start, q]]
        return self.T[q] * self.boxes[stage][q], [self.m.W[i, q] for i in self.m.others(q)]

    def leave(self, stage: int) -> Array:
        """Boxes on entering each mode from a stage."""
        Q, n = self.m.modes, self.m.A.shape[1]
        box = np.zeros((Q, n))
        for i in range(Q):
            ever = self.exits[i].ever(*self.entry(stage, i), self.dwell).reshape(Q, n)
            for q in self.m.others(i):
                box[q] = np.maximum(box[q], ever[q])
        return box * OUTWARD

    def close(self, inflate: float) -> None:
        """Replace the last boxes by the smallest ones above that are mapped into themselves, inflated and checked.

        What leaves a mode is the largest of affine functions of its box. By policy iteration: for every side of a box
        the function that asks for most is chosen (or the side kept), and the linear equations are solved.
        """
        Q, n = self.m.modes, self.m.A.shape[1]
        low = self.boxes[-1].ravel()
        maps, constants = zip(*(self.affine(i) for i in range(Q)))
        box = low
        for _ in range(100):
            M, c = np.zeros((Q * n, Q * n)), low.copy()
            best = low.copy()
            for i in range(Q):
                own = slice(i * n, (i + 1) * n)
                asked = maps[i] @ box[own] + constants[i]
                j, rows = np.argmax(asked, axis=0), np.arange(Q * n)
                more = asked[j, rows] > best
                more[own] = False  # a mode does not follow itself
                best[more], M[more], c[more] = asked[j, rows][more], 0.0, constants[i][j, rows][more]
                M[more, own] = maps[i][j, rows][more]
            if np.all(best <= box * (1.0 + 1e-9)) and _:
                self.boxes[-1] = box.reshape(Q, n) * inflate
                if np.all(self.leave(-1) <= self.boxes[-1]):
                    return
                break
            try:
                box = np.linalg.solve(np.eye(Q * n) - M, c)
            except np.linalg.LinAlgError:
                break
            if not np.all((box >= low * (1.0 - 1e-9)) & np.isfinite(box)):
                break
        radii = [max(abs(np.linalg.eigvals(np.abs(self.back[q] @ np.linalg.matrix_power(A, self.dwell) @ self.T[q]))))
                 for q, A in enumerate(self.m.A)]
        worst = int(np.argmax(radii))
        raise DesignError(f"tables: no box of errors is mapped into itself for a dwell time of {self.dwell} "
                          f"samples (found; mode {worst} has spectral radius {radii[worst]:.4g} of |Ac^{self.dwell}|), "
                          "expected one. Declare a longer dwell time, choose other coordinates, or use "
                          'tables = "arbitrary".')

    def affine(self, i: int) -> tuple[Array, Array]:
        """What leaves mode i with a box b, per time of leaving and side: maps (J, Q n, n) @ b + constants (J, Q n)."""
        stay, (_, firsts) = self.exits[i], self.entry(-1, i)
        maps, constants = stay.affine(self.T[i], firsts, min(self.dwell, stay.last))
        little = 1e-9 * np.max(self.boxes[-1])  # so that the fixed point holds strictly where a mode has no noise
        return maps * OUTWARD, constants * OUTWARD + little

    def table(self, inflate: float) -> DwellTable:
        """All of it."""
        while len(self.boxes) < self.stages:
            self.boxes.append(self.leave(-1) if len(self.boxes) > 1 else self.leave(0))
        if self.stages > 1:
            self.close(inflate)
        h = np.array([[self.thresholds(s, q) for q in range(self.m.modes)] for s in range(self.stages)])
        return DwellTable(self.directions, h * OUTWARD, np.array(self.boxes), self.T, self.dwell, self.back_to)

    def thresholds(self, stage: int, q: int) -> Array:
        """Rows 0..J of a stage and mode."""
        m, J, stay = self.m, self.rows, self.stays[q]
        stop = max(J, min(stay.last - 1, self.back_to))
        entry, first = self.entry(stage, q)
        own = zonotope.support(m.V[q, q], self.directions)
        box = stay.left(entry, stop)
        best = np.zeros_like(box)
        for i in [m.start] if stage == 0 else m.others(q):
            start = box.copy()
            if stage:
                back = min(stop + 1, self.back_to)
                start[:back] = np.minimum(box[:back], self.entered(stage, i, q, stay.rows[:back]))
            h = start + stay.added(m.W[i, q], stop) + own
            h[0] += zonotope.support(m.V[i, q], self.directions) - own
            best = np.maximum(best, h)
        last = np.maximum(best[J:].max(axis=0), stay.ever(entry, first, stop) + own)
        return np.concatenate([best[:J], last[None]])

    def entered(self, stage: int, i: int, q: int, rows: Array) -> Array:
        """Supports of the errors on leaving mode i for mode q in this stage, along its rows (steps, d, n)."""
        if (q, i) not in self.before:
            flat = rows.reshape(-1, rows.shape[2])
            self.before[q, i] = Stay(self.m.A[i], self.m.W[i, i], flat, 0, f"mode {i}")
        stay = self.before[q, i]
        stages = [stage - 1, stage] if stage == self.stages - 1 else [stage - 1]
        return np.max([stay.ever(*self.entry(p, i), self.dwell) for p in stages], axis=0).reshape(rows.shape[:2])
