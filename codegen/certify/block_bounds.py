"""What a table of blocks lacks on the numbers of the C, exactly: its scalars, its noise, and a box beside its columns.

With rows D_j, powers P_j and columns G_j as rounded, and any H whose row sums are at most a limit, the truth obeys

    |d' C A^j H + d' C G*|_1 <= |D_j H|_1 + need,    need = |d' C A^j - D_j| limit + |d' C G*|_1
    A^j H + G* z  in  P_j H + G_j z + box,           box = |A^j - P_j| limit + what G_j lacks of G*

with G* the exact columns of j samples. The rounding of the sums on the target comes on top.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra.error_set import ErrorRecursion
from .exact import eye, product, rational, up, zeros

Array = np.ndarray


@dataclass(frozen=True)
class BlockNeeds:
    """Least values with which a table of blocks holds; laid out like the fields of ``analysis.set_blocks.BlockTable``.

    Parameters
    ----------
    scalars : ndarray (B, Q, J + 1, d)
    noise : ndarray (B, Q, d)
    boxes : ndarray (B, Q, J, n)
        Half widths of a box beside the columns after j = 1..J samples; zero where they hold by themselves.
    """

    scalars: Array
    noise: Array
    boxes: Array


def block_needs(m: ErrorRecursion, table, limit: Array) -> BlockNeeds:
    """Compute what a table needs, in exact rationals rounded up.

    Parameters
    ----------
    m : ErrorRecursion
        With the constants that the firmware holds.
    table : BlockTable
        Its directions, rows, powers and pushed columns are read, as rounded.
    limit : ndarray (n,)
        Largest row sums of |H|.

    Returns
    -------
    needs : BlockNeeds
    """
    B, Q, J, n, _ = table.pushed.shape
    D, most = rational(table.directions), rational(limit)
    scalars, boxes = np.zeros(table.scalars.shape), np.zeros((B, Q, J, n))
    noise = np.zeros(table.noise.shape)
    for q in range(Q):
        A, C = rational(m.A[q]), rational(m.C[q])
        DC, rows, powers = product(D, C), rational(table.rows[q]), rational(table.powers[q])
        for b in range(B):
            before = b if B > 1 else m.start
            noise[b, q] = _up(abs(product(D, rational(m.V[before, q]))).sum(axis=1))
            power, G = eye(n), zeros(n, 0)
            scalars[b, q, 0] = _up(abs(DC - rows[0]) @ most)
            for j in range(J):
                W = rational(m.W[before if j == 0 else q, q])
                G, power = np.concatenate([product(A, G), W], axis=1), product(A, power)
                off = abs(product(DC, power) - rows[j + 1]) @ most
                scalars[b, q, j + 1] = _up(off + abs(product(DC, G)).sum(axis=1))
                boxes[b, q, j] = _up(abs(power - powers[j]) @ most + _lack(G, table.pushed[b, q, j]))
    return BlockNeeds(scalars, noise, boxes)


def _lack(exact: Array, near: Array) -> Array:
    """Half widths of a box that the columns ``near`` lack to hold the exact ones.

    A column of ``near`` that is almost an exact one stands for it, and the difference is boxed; one with a single entry
    that stands for none is a side of a box and counts against what is left.
    """
    floats = np.array([[float(x) for x in row] for row in exact])
    left, rest = list(range(exact.shape[1])), zeros(len(exact))
    for column in near.T:
        if not np.any(column):
            continue
        distance = np.abs(floats[:, left] - column[:, None]).max(axis=0) if left else np.array([np.inf])
        best = int(np.argmin(distance))
        if distance[best] <= 1e-5 * np.max(np.abs(column)):
            rest = rest + abs(exact[:, left.pop(best)] - rational(column))
        elif np.count_nonzero(column) == 1:
            rest = rest - abs(rational(column))
    rest = rest + abs(exact[:, left]).sum(axis=1)
    return np.maximum(rest, zeros(len(exact)))


def _up(values: Array) -> list[float]:
    return [up(x) for x in values]
