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
    return np.round(out, DIGITS - np.floor(np.log10(np.maximum(np.abs(out), 1e-300))).astype(int).clip(-12, 12).max())


def largest(steps: Sequence[Array], pushes: Sequence[Array], rows: Array, length: int = 120, runs: int = 60,
            seed: int = 0) -> Array:
    """Largest |r_i e| over random and constant mode sequences from e = 0, every input at its worst: a lower bound.

    Parameters
    ----------
    steps : sequence of ndarray (n, n)
    pushes : sequence of ndarray (n, g)
    rows : ndarray (m, n)
    length, runs, seed : int

    Returns
    -------
    ndarray (m,)
    """
    rng, n = np.random.default_rng(seed), rows.shape[1]
    best = np.zeros(len(rows))
    for run in range(runs):
        hold = rng.uniform(0, 1)
        q = run % len(steps)
        back, total = np.eye(n), np.zeros(len(rows))
        for _ in range(length):
            total += np.abs(rows @ back @ pushes[q]).sum(axis=1)
            back = back @ steps[q]
            if run >= len(steps) and rng.random() > hold:
                q = int(rng.integers(len(steps)))
        best = np.maximum(best, total)
    return best
