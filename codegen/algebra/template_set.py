"""Sets ``|r_i e| <= b_i`` that hold a switched recursion for ever: which rows r_i, and how they carry each other.

``e+ = A_p e + W_p d + ...`` with |d| <= 1 and p switching. The rows are functionals of interest followed back through
words of modes; what a further step makes of a row is written as a combination of the rows,
``r_i A_p = sum_j lambda_j r_j``, so that ``|r_i A_p e| <= sum_j |lambda_j| b_j``: the one with the smallest sum, by a
linear program. Rows are added where that loses most. All of it is a proposal in double precision;
``certify.filter_bounds`` decides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

Array = np.ndarray
#: Digits of a combination that are kept: what they lose is bounded with the coordinates.
DIGITS = 9
#: Unknowns that are solved for at once.
LARGEST = 2500


def independent(rows: Sequence[Array], fresh: Array) -> list[Array]:
    """Those of the fresh rows that are no multiple of a row, nor of one another, nor nearly zero.

    Parameters
    ----------
    rows : sequence of ndarray (n,)
    fresh : ndarray (k, n)

    Returns
    -------
    list of ndarray (n,)
    """
    known = [np.asarray(r) / np.linalg.norm(r) for r in rows]
    out = []
    for row in fresh:
        size = np.linalg.norm(row)
        if size > 1e-9 and all(abs(row @ r) < (1 - 1e-9) * size for r in known):
            known.append(row / size)
            out.append(row)
    return out


def combinations(rows: Array, bounds: Array, wanted: Array) -> Array:
    """Write functionals as combinations of rows with the least ``sum |lambda_j| b_j``.

    Parameters
    ----------
    rows : ndarray (m, n)
        The first n are the unit rows.
    bounds : ndarray (m,)
        Positive.
    wanted : ndarray (k, n)

    Returns
    -------
    ndarray (k, m)
    """
    n, out = rows.shape[1], np.zeros((len(wanted), len(rows)))
    scale = bounds[:n]
    equations = np.concatenate([rows, -rows]).T * scale[:, None]
    cost = np.concatenate([bounds, bounds])
    for k, row in enumerate(wanted):
        target = row * scale
        size = np.abs(target).max()
        if size == 0:
            continue
        found = linprog(cost / cost.max(), A_eq=equations / scale.max(), b_eq=target / size, method="highs")
        if found.status != 0:
            out[k, :n] = row
            continue
        both = found.x * size / scale.max()
        out[k] = both[:len(rows)] - both[len(rows):]
    most = np.max(np.abs(out), axis=1, initial=1e-12)
    return np.array([np.round(row, int(DIGITS - np.clip(np.floor(np.log10(size)), -12, 12)))
                     for row, size in zip(out, most)]).reshape(out.shape)


def walks(mode: Sequence[int], before: Sequence[Sequence[int]], length: int, runs: int, seed: int = 0) -> Array:
    """Random paths of a switching graph, backwards in time; some stay in a mode for long, some leave when they can.

    Parameters
    ----------
    mode : sequence of int
        Of each node.
    before : sequence of sequence of int
        Nodes that may precede each node.
    length, runs, seed : int

    Returns
    -------
    ndarray (length + 1, runs) int
        Modes; the last sample first.
    """
    rng, hold = np.random.default_rng(seed), np.random.default_rng(seed + 1).uniform(0, 1, runs)
    hold[:len(mode)] = 1.0  # each mode alone, where it may stay
    node, out = np.arange(runs) % len(mode), []
    for _ in range(length + 1):
        out.append(np.asarray(mode)[node])
        stay = rng.random(runs) <= hold
        for r, a in enumerate(node):
            same = [b for b in before[a] if mode[b] == mode[a]] if stay[r] else []
            options = same or before[a]
            node[r] = options[int(rng.integers(len(options)))]
    return np.array(out)


def largest(steps: Sequence[Array], pushes: Sequence[Array], rows: Array, paths: Array) -> Array:
    """Largest |r_i e| along mode sequences from e = 0, every input at its worst: a lower bound of what is possible.

    Parameters
    ----------
    steps : sequence of ndarray (n, n)
    pushes : sequence of ndarray (n, g)
    rows : ndarray (m, n)
    paths : ndarray (length, runs) int
        Step of each sample, the last one first.

    Returns
    -------
    ndarray (runs, m)
    """
    wide, runs = max(W.shape[1] for W in pushes), paths.shape[1]
    A, W = np.array(steps), np.array([np.pad(push, ((0, 0), (0, wide - push.shape[1]))) for push in pushes])
    back, total = np.broadcast_to(rows, (runs, *rows.shape)), np.zeros((runs, len(rows)))
    for q in paths:
        total += np.abs(back @ W[q]).sum(axis=2)
        back = back @ A[q]
    return total


def least_kept(G: Array, omega: Array, edges: Sequence[tuple[int, int, int]], first: Array) -> Array | None:
    """Solve for the least bounds ``b >= first`` with ``G_p b_a + omega_p <= b_c`` along every edge (a, p, c).

    Which edge decides a bound is guessed, the bounds of the guess are solved for, and the guess is renewed.

    Parameters
    ----------
    G : ndarray (N, m, m), omega : ndarray (N, m)
        Not negative.
    edges : sequence of (int, int, int)
    first : ndarray (nodes, m)

    Returns
    -------
    ndarray (nodes, m) or None
        None where there are none, or where they are too many for a guess.
    """
    (nodes, m), b = first.shape, first
    for _ in range(60 if nodes * m <= LARGEST else 0):
        value, A, rest = first.copy(), np.zeros((nodes, m, nodes, m)), first.copy()
        for a, p, c in edges:
            new = G[p] @ b[a] + omega[p]
            more = new > value[c]
            value[c][more], rest[c][more] = new[more], omega[p][more]
            A[c, more] = 0
            A[c, more, a] = G[p][more]
        if np.all(value <= b):
            return b
        try:
            solved = np.linalg.solve(np.eye(nodes * m) - A.reshape(nodes * m, -1), rest.ravel()).reshape(nodes, m)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(solved) & (solved >= first * (1 - 1e-9))):
            return None
        b = np.maximum(solved, first) * (1 + 1e-13)
    return None
