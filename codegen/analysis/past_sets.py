"""How large the set of a firmware can be along a mode sequence, whatever came before it.

A follower carries an upper bound of the firmware's own set, rounding included, for many mode sequences at once. It
starts from what holds the set at the first sample; the limits that the firmware checks do. What comes out after some
samples is smaller, and it may start again with that (``entered``): after so many samples since a start the set is
inside, whatever came before.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..algebra.error_set import ErrorRecursion

Array = np.ndarray
#: Everything is computed in double precision; a part in a million covers that generously.
OUTWARD = 1.0 + 1e-6
#: Sequences by which an entry is made smaller, and how often at most.
MOST_PATHS, MOST_ROUNDS = 750, 60
#: A round that makes no entry smaller by more than that is the last.
SETTLED = 1e-3


class Follower(Protocol):
    """Bounds of a set along P mode sequences; a state is whatever ``begin`` and ``step`` give.

    An entry holds every set that there may be at a sample: half widths (n,), or a shape (n, n).
    """

    def first(self, limit: Array) -> Array:
        """Entry from half widths (n,)."""

    def begin(self, entry: Array) -> object:
        """Start from entries (P, ...)."""

    def step(self, state: object, p: Array, before: Array) -> object:
        """One measured step of the modes p (P,), after the modes before."""

    def around(self, state: object) -> Array:
        """One entry that holds the sets of all sequences."""

    def chosen(self, state: object, at: Array) -> object:
        """The state of some of the sequences."""

    def support(self, state: object, q: Array, before: Array, D: Array) -> Array:
        """Bounds in directions D of the residual's set in modes q (P,), after the modes before: (P, d)."""


def sequences(modes: int, dwell: int, most: int, longest: int = 80) -> Array:
    """Return all mode sequences that a dwell time admits, as long as there are few enough.

    Parameters
    ----------
    modes, dwell : int
    most : int
        Sequences at most.
    longest : int
        Samples at most.

    Returns
    -------
    paths : ndarray (P, K) int
        Stretches of one; the modes at either end may have lasted, or last, for longer.
    """
    paths, run = np.arange(modes)[:, None], np.full(modes, dwell)  # the first may have been there for long
    while paths.shape[1] < longest:
        stay = np.concatenate([paths, paths[:, -1:]], axis=1), np.minimum(run + 1, dwell)
        free = run >= dwell
        leave = [np.concatenate([paths[free], (paths[free, -1:] + k) % modes], axis=1) for k in range(1, modes)]
        longer = np.concatenate([stay[0], *leave])
        if len(longer) > most:
            break
        run = np.concatenate([stay[1], np.ones(len(longer) - len(paths), dtype=int)])
        paths = longer
    return paths


def entered(follower: Follower, limit: Array, modes: int, dwell: int) -> tuple[Array, int]:
    """Return what holds the set at any sample after each mode, and after how many samples.

    Parameters
    ----------
    follower : Follower
    limit : ndarray (n,)
        Half widths that hold the set at any sample.
    modes, dwell : int

    Returns
    -------
    entries : ndarray (Q, ...)
    samples : int
        Since a start, from which on the set is inside.
    """
    paths = sequences(modes, dwell, MOST_PATHS)
    entries, samples = np.array([follower.first(np.asarray(limit, dtype=float))] * modes), 0
    for _ in range(MOST_ROUNDS):
        state, smaller = followed(follower, entries, paths), False
        new = entries.copy()
        for q in range(modes):
            found = follower.around(follower.chosen(state, paths[:, -2] == q)) * OUTWARD
            if total(found) < total(entries[q]):
                smaller |= total(found) < total(entries[q]) * (1.0 - SETTLED)
                new[q] = found
        entries, samples = new, samples + paths.shape[1] - 2
        if not smaller:
            break
    return entries, samples


def total(entry: Array) -> float:
    """Size of an entry: sum of half widths, or trace of a shape."""
    return float(entry.sum() if entry.ndim == 1 else np.trace(entry))


def followed(follower: Follower, entries: Array, paths: Array) -> object:
    """Return the state at the last sample of mode sequences that begin with the mode before an entry.

    Parameters
    ----------
    follower : Follower
    entries : ndarray (Q, ...)
        At the second sample, by the mode before it.
    paths : ndarray (P, K) int

    Returns
    -------
    state : object
    """
    state = follower.begin(entries[paths[:, 0]])
    for k in range(1, paths.shape[1] - 1):
        state = follower.step(state, paths[:, k], paths[:, k - 1])
    return state


class Exact:
    """The exact set of a recursion: what errors there are without a fault.

    Parameters
    ----------
    m : ErrorRecursion
        Its W and V hold rounding.
    """

    def __init__(self, m: ErrorRecursion):
        self.m = m

    def first(self, limit: Array) -> Array:
        """See ``Follower``."""
        return limit

    def begin(self, box: Array) -> Array:
        """Generators of a box."""
        return box[:, :, None] * np.eye(box.shape[1])

    def step(self, H: Array, p: Array, before: Array) -> Array:
        """See ``Follower``."""
        return np.concatenate([self.m.A[p] @ H, self.m.W[before, p]], axis=2)

    def around(self, H: Array) -> Array:
        """See ``Follower``."""
        return np.abs(H).sum(axis=2).max(axis=0)

    def chosen(self, H: Array, at: Array) -> Array:
        """See ``Follower``."""
        return H[at]

    def support(self, H: Array, q: Array, before: Array, D: Array) -> Array:
        """Largest d' r of the residual in modes q, (P, d)."""
        rows = D @ self.m.C[q]
        return (np.abs(rows @ H).sum(axis=2) + np.abs(D @ self.m.V[before, q]).sum(axis=2)) * OUTWARD
