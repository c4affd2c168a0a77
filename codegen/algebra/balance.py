"""Rows, columns and time of a pencil brought to a common size, before any rank of it is told.

Equations in hours beside algebraic ones would otherwise lose their rank to the tolerance: physical units differ by
many powers of ten, and nothing of what a pencil is depends on them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Balance:
    """E scaled is ``rows E columns * time``, A scaled ``rows A columns``.

    Parameters
    ----------
    rows, columns : ndarray (n,)
    time : float
        The scale of the finite eigenvalues: those of the scaled pencil times this are those of the given one.
    """

    rows: Array
    columns: Array
    time: float

    def apply(self, E: Array, A: Array) -> tuple[Array, Array]:
        """Return E and A scaled.

        Parameters
        ----------
        E, A : ndarray (n, n)
        """
        return tuple(self.rows[:, None] * M * self.columns for M in (self.time * E, A))


def balanced(E: Array, A: Array) -> Balance:
    """Return scales that bring the pencil's rows and columns near norm 1.

    Parameters
    ----------
    E, A : ndarray (n, n)
    """
    size_e, size_a = (np.linalg.norm(M, axis=1) for M in (E, A))
    both = (size_e > 0) & (size_a > 0)
    time = float(np.exp(np.mean(np.log(size_a[both] / size_e[both])))) if both.any() else 1.0
    rows, columns = np.ones(len(E)), np.ones(len(E))
    for _ in range(3):
        whole = Balance(rows, columns, time).apply(E, A)
        size = np.sqrt(sum(np.sum(M**2, axis=1) for M in whole))
        rows = rows / np.where(size > 0, size, 1.0)
        whole = Balance(rows, columns, time).apply(E, A)
        size = np.sqrt(sum(np.sum(M**2, axis=0) for M in whole))
        columns = columns / np.where(size > 0, size, 1.0)
    return Balance(rows, columns, time)
