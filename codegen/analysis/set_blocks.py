"""T3: thresholds for any mode sequence from one small generator matrix that is carried online.

A mode that stays is cut into blocks of at most J samples. H holds the error at the start of the block; j samples later

    h(d) = |d' C Ac_q^j H|_1 + c_{q,j}(d) + |d' V|_1,    j = 1..J

with rows and scalars from a table: exact from the block's start on, the sample that ends it included. There, at a
switch or after J samples, H becomes the reduction of ``[Ac_q^j H, G_{q,j}]``, after the decision; G_{q,j} holds what
the j samples added, reduced offline to a few columns. Reduction thus happens once per block instead of at every
sample, which is also what makes it contract (``certify.reduction``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.error_set import ErrorRecursion

Array = np.ndarray

#: What the tables' own rounding is covered with; that of the recursion on the target is left to its margins.
ROUNDING = 1e-9


@dataclass(frozen=True)
class BlockTable:
    """Tables of T3. B is 1, or Q + 1 where the mode before the block matters (the last is none: sample 0).

    Parameters
    ----------
    directions : ndarray (d, m)
    rows : ndarray (Q, J + 1, d, n)
        ``d' C Ac_q^j``, j = 0..J (0 is needed at sample 0 only).
    scalars : ndarray (B, Q, J + 1, d)
        c_{q,j}(d): what the j samples have added to the error.
    noise : ndarray (B, Q, d)
        |d' V|_1, by the mode before the sample.
    powers : ndarray (Q, J, n, n)
        ``Ac_q^j``, j = 1..J at index j - 1.
    pushed : ndarray (B, Q, J, n, g)
        G_{q,j}, likewise; columns of zeros where fewer are needed.
    order : int
        Columns of H after a reduction.
    key : {"squared", "girard"}
    """

    directions: Array
    rows: Array
    scalars: Array
    noise: Array
    powers: Array
    pushed: Array
    order: int
    key: str

    @property
    def words(self) -> int:
        """Numbers in the tables."""
        return sum(x.size for x in (self.rows, self.scalars, self.noise, self.powers, self.pushed))

    @property
    def ram(self) -> int:
        """Numbers in the state and scratch: H with room for what a block adds."""
        return self.powers.shape[2] * (self.order + self.pushed.shape[-1])

    def along(self, path: Sequence[int], H0: Array) -> Array:
        """Return the thresholds of a path from sample 0 on, as the firmware computes them.

        Parameters
        ----------
        path : sequence of int
        H0 : ndarray (n, g)
            Generators of the first error.

        Returns
        -------
        h : ndarray (K, d)
        """
        none, longest = len(self.scalars) - 1, self.rows.shape[1] - 1
        H = zonotope.reduce(np.asarray(H0, dtype=float), max(self.order, len(H0)), self.key)
        block, before, j, out = path[0], none, 0, []  # mode of the block, the one before it, samples since its start
        for k, q in enumerate(path):
            last = min(path[k - 1], none) if k else none
            out.append(np.abs(self.rows[block, j] @ H).sum(axis=1) + self.scalars[before, block, j]
                       + self.noise[last, q])
            if j and (q != block or j == longest):
                spread = np.concatenate([self.powers[block, j - 1] @ H, self.pushed[before, block, j - 1]], axis=1)
                H = zonotope.reduce(spread, self.order, self.key)
                block, before, j = q, last, 0
            j += 1
        return np.array(out)


def block_table(m: ErrorRecursion, directions: Array, longest: int, order: int, columns: int | None = None,
                key: str = "squared") -> BlockTable:
    """Tabulate thresholds within blocks (T3).

    Parameters
    ----------
    m : ErrorRecursion
        With the same C in all modes.
    directions : ndarray (d, m)
    longest : int
        J >= 1, samples in a block at most.
    order : int
        Columns of H after a reduction, at least n.
    columns : int or None
        Columns of G_{q,j} at most, at least n; None: n + 2.
    key : {"squared", "girard"}

    Returns
    -------
    table : BlockTable

    Raises
    ------
    ValueError
        C differs between modes: the sample that ends a block is read with C of the mode that follows.
    """
    if np.any(np.ptp(m.C, axis=0)):
        raise ValueError("blocks: C differs between modes (found), expected the same in all.")
    Q, n = m.modes, m.A.shape[1]
    B, g, J = (Q + 1 if m.pairwise else 1), columns or n + 2, longest
    D = np.asarray(directions, dtype=float)
    rows, powers = np.zeros((Q, J + 1, len(D), n)), np.zeros((Q, J, n, n))
    scalars, pushed = np.zeros((B, Q, J + 1, len(D))), np.zeros((B, Q, J, n, g))
    noise = np.array([[zonotope.support(V, D) for V in row] for row in m.V[-B:]])
    for q in range(Q):
        power = np.eye(n)
        for j in range(J + 1):
            rows[q, j] = D @ m.C[q] @ power
            power = m.A[q] @ power
            powers[q, j:j + 1] = power  # nothing for j = J
        for b in range(B):
            G = np.zeros((n, 0))
            for j in range(J):
                i = q if j else (b if B > 1 else m.start)
                G = np.concatenate([m.A[q] @ G, m.W[i, q]], axis=1)
                scalars[b, q, j + 1] = zonotope.support(m.C[q] @ G, D)
                small = zonotope.reduce(np.concatenate([G, ROUNDING * np.diag(zonotope.hull(G))], axis=1), g, key)
                pushed[b, q, j, :, :small.shape[1]] = small
    more = 1.0 + ROUNDING
    return BlockTable(D, rows, scalars * more, noise * more, powers, pushed, order, key)
