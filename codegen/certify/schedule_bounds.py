"""Proof of a table of thresholds along a known schedule: outward rounding, and a norm that is checked exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..algebra.error_set import ErrorRecursion
from ..errors import CertificateError
from .exact import eye, product, rational, up, zeros
from .rows import TINY, UNIT, WIDER, Generators, Norm, Powers, start
from .set_bounds import Stay

Array = np.ndarray

#: Laps that are looked at one by one before what is left is bounded in a norm.
LAPS = 3


def prove_schedule(m: ErrorRecursion, H0: Array, lead: Sequence[int], cycle: Sequence[int], claim,
                   known: dict | None = None) -> float:
    """Prove a table, or say at which sample it does not hold.

    Parameters
    ----------
    m : ErrorRecursion
        With the constants that the firmware holds.
    H0 : ndarray (n, g)
        Generators of the first error.
    lead, cycle : sequence of int
        The schedule: ``lead``, then ``cycle`` for ever.
    claim : ScheduleTable
        Any object with its fields: directions, h and period.
    known : dict, optional
        What earlier calls with the same recursion and directions have computed of laps; filled.

    Returns
    -------
    room : float
        Least that a threshold has beyond what it must be.

    Raises
    ------
    CertificateError
        The table does not fit the schedule, or a threshold is too small.
    """
    P, path = len(cycle), [*lead, *cycle]
    while len(path) < len(claim.h) + P:
        path += cycle
    first = len(claim.h) - P
    if claim.period != P or (len(claim.h) - len(lead)) % P or first < len(lead) + P:
        raise CertificateError(f"tables: {len(claim.h)} rows with period {claim.period} (found), expected a lead of "
                               f"{len(lead)} and at least two laps of {P}.")
    D, A, C = rational(claim.directions), [rational(x) for x in m.A], [rational(x) for x in m.C]
    H, known = np.asarray(H0, dtype=float), {} if known is None else known
    room = np.inf
    n, box = len(H), np.zeros(len(H))  # H in doubles, and what their rounding has left out so far
    for k in range(len(claim.h)):
        before, q = (path[k - 1] if k else m.start), path[k]
        row = product(D, C[q])
        noise = np.array([up(x) for x in abs(product(D, rational(m.V[before, q]))).sum(axis=1)])
        near = np.array([[float(x) for x in line] for line in row])
        slip = (2 * n + 6) * UNIT * (np.abs(near) @ np.abs(H)).sum(axis=1) + H.shape[1] * TINY
        need = (np.abs(near @ H).sum(axis=1) + slip + np.abs(near) @ box) * WIDER
        if k >= first:
            modes = tuple(path[k - 1:k + P])
            if modes not in known:
                M, W = _lap(m, A, modes)
                near = np.array([[float(x) for x in line] for line in M])
                norm, added = Norm(near, M), Generators.of_exact(W)
                known[modes] = Stay(Powers(near, norm, *start(row, norm), LAPS), added), added
            stay, added = known[modes]
            need = np.maximum(need, stay.ever(Generators.of(np.concatenate([H, np.diag(box)], axis=1)), [added], 0))
        need = (need + noise) * WIDER
        if not np.all(need <= claim.h[k]):
            d = int(np.argmax(~(need <= claim.h[k])))
            raise CertificateError(f"tables: sample {k}, direction {d}: threshold {claim.h[k][d]:.9g} (found), "
                                   f"expected at least {need[d]:.9g}.")
        room = min(room, float(np.min(claim.h[k] - need)))
        slip = (n + 1) * UNIT * (np.abs(m.A[q]) @ np.abs(H)).sum(axis=1) * WIDER + H.shape[1] * TINY
        box = (np.abs(m.A[q]) @ box + slip) * WIDER
        H = np.concatenate([m.A[q] @ H, m.W[before, q]], axis=1)
    return room


def _lap(m: ErrorRecursion, A: list[Array], path: Sequence[int]) -> tuple[Array, Array]:
    """Exact matrix and generators of the samples of a path but the first, which is only the mode before."""
    M, W = eye(len(A[0])), zeros(len(A[0]), 0)
    for before, q in zip(path, path[1:]):
        W, M = np.concatenate([product(A[q], W), rational(m.W[before, q])], axis=1), product(A[q], M)
    return M, W
