"""Pencils with known structure, and the published ones of Lopez-Estrada (2014)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

A26 = (np.diag([1.0, 1, 1, 0]), np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 1, 0]]))
#: The circuit of examples A.3.2 and A.4.3.
A43 = (np.diag([1, 0.05, 0]), np.array([[0.0, 0, 1], [100, -50, 0], [100, 20, 20]]))
#: E, the vertices and C of chapter 4; chapter 3 has the same with C of its own.
CHAPTER_4 = (
    np.diag([1.0, 1, 0]),
    [np.array(A, dtype=float) for A in ([[-10, 5, 6.5], [2, -5.5, -1.25], [-9, 4, 8.5]],
                                        [[-10, 5, 6.5], [5, -4, -1.25], [-2, 4, 7]],
                                        [[-8, 5, 6.5], [5, -4, -1.25], [-5, 4, 6]])],
    np.array([[1.0, 1, 1], [1, 0, 1]]),
)
CHAPTER_3_C = np.array([[1.0, 0, 0], [0, 1, 1], [0, 0, 1]])


@dataclass(frozen=True)
class Made:
    """E = P^-1 diag(I, N) Q^-1, A = P^-1 diag(A1, I) Q^-1, and some C."""

    E: np.ndarray
    A: np.ndarray
    C: np.ndarray
    A1: np.ndarray
    n1: int
    index: int


def random_pencil(seed: int) -> Made:
    """A pencil of at most six states whose slow and fast parts are small integers, in random coordinates."""
    rng = np.random.default_rng(seed)
    n1, n2 = (2, 3) if seed == 3 else rng.integers(0, 4, 2) if seed else (2, 1)
    n2 = max(n2, 1 - n1)
    A1 = rng.integers(-2, 2, (n1, n1)).astype(float)
    N = np.triu(rng.integers(0, 2, (n2, n2)), 1).astype(float)
    index = next(k for k in range(n2 + 1) if not np.linalg.matrix_power(N, k).any()) if n2 else 0
    if seed == 3:
        N, index = np.eye(3, k=1), 3
    P, Q = (np.linalg.qr(rng.normal(size=(n1 + n2, n1 + n2)))[0] * rng.uniform(0.5, 2, n1 + n2) for _ in range(2))
    C = np.round(rng.normal(size=(rng.integers(1, 3), n1 + n2))) * rng.integers(0, 2, (1, n1 + n2))
    left, right = np.eye(n1 + n2), np.eye(n1 + n2)
    left[n1:, n1:], right[:n1, :n1] = N, A1
    return Made(P @ left @ Q, P @ right @ Q, C @ Q, A1, n1, index)
