"""Growing products of switched matrices: a cycle of modes that no proof for arbitrary switching can survive."""

from __future__ import annotations

from itertools import product

import numpy as np

Array = np.ndarray


def growing_cycle(M: Array, longest: int = 4, most: int = 5000) -> tuple[tuple[int, ...], float] | None:
    """Shortest cycle of modes whose product has a spectral radius of at least 1; of equally short ones the worst.

    Parameters
    ----------
    M : ndarray (N, n, n)
    longest : int
        Longest cycle looked at.
    most : int
        Products looked at in all; longer cycles are left out where there would be more.

    Returns
    -------
    (modes, radius) or None
        Modes in the order in which they act.
    """
    for length in range(1, longest + 1):
        if len(M) ** length > most:
            break
        worst, radius = None, 0.0
        for modes in product(range(len(M)), repeat=length):
            P = np.eye(M.shape[1])
            for q in modes:
                P = M[q] @ P
            size = float(np.max(np.abs(np.linalg.eigvals(P))))
            if size > radius:
                worst, radius = modes, size
        if radius >= 1.0:
            return worst, radius
    return None
