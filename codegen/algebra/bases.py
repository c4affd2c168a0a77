"""Coordinates in which boxes of errors may fit better than in those of the state."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import schur

Array = np.ndarray

#: Worst basis that is looked at, by its condition number.
WORST_BASIS = 1e4


def bases(Ac: Array) -> Iterator[tuple[str, Array | None]]:
    """Give the coordinates worth trying, those of x first.

    Parameters
    ----------
    Ac : ndarray (Q, n, n)

    Yields
    ------
    name : str
    T : ndarray (Q, n, n) or None
    """
    yield "x", None
    modal = [_modal(A) for A in Ac]
    if all(T is not None for T in modal):
        yield "modal", np.array(modal)
    for q, T in enumerate(modal):
        if T is not None and len(Ac) > 1:
            yield f"modal of mode {q}", np.broadcast_to(T, Ac.shape).copy()
    for q, A in enumerate(Ac):
        yield f"Schur of mode {q}", np.broadcast_to(_schur(A), Ac.shape).copy()


def _modal(A: Array) -> Array | None:
    """Real basis of eigenvectors, or None where it is badly conditioned."""
    values, vectors = np.linalg.eig(A)
    columns = []
    for value, vector in zip(values, vectors.T):
        if value.imag > 0:
            columns += [vector.real, vector.imag]
        elif value.imag == 0:
            columns.append(vector.real)
    T = np.array(columns).T
    return T if np.linalg.cond(T) < WORST_BASIS else None


def _schur(A: Array) -> Array:
    return schur(A)[1]
