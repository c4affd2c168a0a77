"""Proof of a table of thresholds by mode and samples since a switch, on the numbers of the table.

Shown with outward rounding, sharing no code with ``analysis.set_tables``: the boxes of every stage hold whatever can
leave the stages before it after the dwell time or later (the last stage: itself too), and every threshold is at least
the support of the residual set for every admissible past. What comes after many samples, and what becomes of rounding,
is bounded in a norm that is checked exactly (``rows``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq_mat

from ..algebra.error_set import ErrorRecursion
from ..errors import CertificateError
from .exact import product, rational, up
from .rows import WIDER, Generators, Norm, Powers, start

Array = np.ndarray


@dataclass(frozen=True)
class Room:
    """What a proved table has to spare: (least room, stage and mode) per stage and mode.

    Parameters
    ----------
    thresholds, boxes : list of (float, str)
    """

    thresholds: list
    boxes: list


@dataclass(frozen=True)
class DwellClaim:
    """What is claimed of a table (the fields of ``analysis.set_tables.DwellTable``).

    Parameters
    ----------
    directions : ndarray (d, m)
    h : ndarray (S, Q, J + 1, d)
    boxes : ndarray (S, Q, n)
    coordinates : ndarray (Q, n, n)
    dwell : int
    back : int
        Samples after a switch up to which the stay before it is looked at; later only the box of the stage is used.
    """

    directions: Array
    h: Array
    boxes: Array
    coordinates: Array
    dwell: int
    back: int


class Stay:
    """Upper bounds of supports along rows while one matrix acts again and again.

    Parameters
    ----------
    powers : Powers
    W : Generators
        Added by every step but the first.
    """

    def __init__(self, powers: Powers, W: Generators):
        self.powers, self.W, self.stop = powers, W, powers.last
        steps = powers.support(W, self.stop)
        self.before = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)]) * WIDER

    def added(self, first: Generators, stop: int) -> Array:
        """What steps 0..stop - 1 have added, the first of them ``first``."""
        out = np.zeros((stop, self.before.shape[1]))
        out[1:] = (self.powers.support(first, stop - 1) + self.before[:stop - 1]) * WIDER
        return out

    def later(self, entry: Generators, firsts: list[Generators]) -> Array:
        """Over all steps from ``stop`` on."""
        norm, left = self.powers.norm, self.powers.left(self.stop - 1)
        rest = norm.columns(self.W) / (1.0 - norm.mu) * WIDER
        gain = norm.columns(entry) + max(norm.columns(F) for F in firsts) + rest
        return (left * gain + self.before[self.stop - 1]) * WIDER

    def ever(self, entry: Generators, firsts: list[Generators], since: int) -> Array:
        """Over all steps from ``since`` on."""
        later = self.later(entry, firsts)
        if since >= self.stop:
            return later
        begin = self.powers.support(entry, self.stop)
        explicit = [((begin + self.added(F, self.stop)) * WIDER)[since:].max(axis=0) for F in firsts]
        return np.maximum(later, np.max(explicit, axis=0))


def prove_dwell(m: ErrorRecursion, H0: Array, claim: DwellClaim) -> Room:
    """Prove a table, or say where it does not hold.

    Parameters
    ----------
    m : ErrorRecursion
        With the constants that the firmware holds.
    H0 : ndarray (n, g)
        Generators of the first error.
    claim : DwellClaim
        Any object with its fields.

    Returns
    -------
    room : Room
        How much each table entry and box is beyond what it must be, rounded down.

    Raises
    ------
    CertificateError
        A box or a threshold is too small, with stage, mode and row.
    """
    proof = _Proof(m, np.asarray(H0, dtype=float), claim)
    for stage in range(len(claim.h)):
        if stage:
            proof.boxes(stage)
        for q in range(m.modes):
            proof.thresholds(stage, q)
    return proof.room


class _Proof:
    def __init__(self, m: ErrorRecursion, H0: Array, claim: DwellClaim):
        self.m, self.claim, self.last = m, claim, len(claim.h) - 1
        if m.modes > 1 and self.last < 1:
            raise CertificateError("tables: one stage (found), expected at least two where modes switch.")
        self.norms = [Norm(A) for A in m.A]
        self.before: dict[tuple[int, int], Stay] = {}
        self.tested: dict[int, Stay] = {}
        self.room = Room([], [])
        self.H0 = Generators.of(H0)
        self.W = [[Generators.of(m.W[i, q]) for q in range(m.modes)] for i in range(m.modes + 1)]
        back = [fmpq_mat([list(row) for row in rational(T)]).inv().tolist() for T in claim.coordinates]
        self.back = np.array([row for matrix in back for row in matrix], dtype=object)

    def stay(self, q: int, exact: Array, least: int = 0) -> Stay:
        return Stay(Powers(self.m.A[q], self.norms[q], *start(exact, self.norms[q]), least), self.W[q][q])

    def entry(self, stage: int, q: int) -> tuple[Generators, list[Generators]]:
        if stage == 0:
            return self.H0, [self.W[self.m.start][q]]
        box = Generators.box(self.claim.coordinates[q], self.claim.boxes[stage][q])
        return box, [self.W[i][q] for i in self.m.others(q)]

    def stages_before(self, stage: int) -> list[int]:
        return [stage - 1, stage] if stage == self.last else [stage - 1]

    def boxes(self, stage: int) -> None:
        Q, n = self.m.modes, self.m.A.shape[1]
        for i in range(Q):
            stay = self.stay(i, self.back)
            for p in self.stages_before(stage):
                leaving = stay.ever(*self.entry(p, i), self.claim.dwell).reshape(Q, n)
                for q in self.m.others(i):
                    if not np.all(leaving[q] <= self.claim.boxes[stage][q]):
                        raise CertificateError(f"tables: stage {stage}, mode {q}: an error that leaves mode {i} is "
                                               f"outside the box (found {leaving[q]}, expected at most "
                                               f"{self.claim.boxes[stage][q]}).")
                    self.room.boxes.append((_spare(self.claim.boxes[stage][q], leaving[q]), f"stage {stage}, mode {q}"))

    def thresholds(self, stage: int, q: int) -> None:
        m, h = self.m, self.claim.h[stage][q]
        J = len(h) - 1
        if q not in self.tested:
            self.tested[q] = self.stay(q, product(rational(self.claim.directions), rational(m.C[q])), J + 1)
        stay = self.tested[q]
        stop = max(J + 1, min(stay.stop, self.claim.back))
        entry, firsts = self.entry(stage, q)
        box, own = stay.powers.support(entry, stop), self.noise(q, q)
        need = np.zeros_like(box)
        for i in [m.start] if stage == 0 else m.others(q):
            begin = box.copy()
            if stage:
                back = min(stop, self.claim.back)
                begin[:back] = np.minimum(box[:back], self.entered(stage, i, q, stay.powers, back))
            noise = np.concatenate([self.noise(i, q)[None], np.tile(own, (stop - 1, 1))])
            need = np.maximum(need, (begin + stay.added(self.W[i][q], stop) + noise) * WIDER)
        tail = (stay.ever(entry, firsts, stop) + own) * WIDER
        need = np.concatenate([need[:J], np.maximum(need[J:].max(axis=0), tail)[None]])
        if not np.all(need <= h):
            j, d = np.argwhere(~(need <= h))[0]
            raise CertificateError(f"tables: stage {stage}, mode {q}, row {j}, direction {d}: threshold {h[j, d]:.9g} "
                                   f"(found), expected at least {need[j, d]:.9g}.")
        self.room.thresholds.append((_spare(h, need), f"stage {stage}, mode {q}"))

    def noise(self, i: int, q: int) -> Array:
        exact = abs(product(rational(self.claim.directions), rational(self.m.V[i, q]))).sum(axis=1)
        return np.array([up(x) for x in exact])

    def entered(self, stage: int, i: int, q: int, powers: Powers, back: int) -> Array:
        """Supports of the errors on leaving mode i for this stage, along the first rows of mode q."""
        count, n = powers.rows.shape[1:]
        if (q, i) not in self.before:
            error = powers.error[:back].ravel() * self.norms[i].against(self.norms[q]) * WIDER
            rows = Powers(self.m.A[i], self.norms[i], powers.rows[:back].reshape(-1, n), error, 0)
            self.before[q, i] = Stay(rows, self.W[i][i])
        there = self.before[q, i]
        found = [there.ever(*self.entry(p, i), self.claim.dwell) for p in self.stages_before(stage)]
        return np.max(found, axis=0).reshape(back, count)


def _spare(given: Array, need: Array) -> float:
    """Least difference, rounded down; both are numbers, not below zero where it counts."""
    return max(float(np.nextafter(np.min(given - need), -np.inf)), 0.0)
