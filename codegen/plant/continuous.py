"""The true continuous plant between samples, integrated to the last digits.

Each sampling period is cut into ``PIECES``; on a piece the disturbance is constant, the parameters and those inputs
that may move are linear in time, and the Taylor series of the solution is summed until its terms vanish: with
|A| times the piece below one half, 24 terms leave less than 2^-24/24! of the state, far below float64's rounding.
Disturbances and parameters therefore move *between* samples, which is what a sampled observer has to survive.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .model import Array, Mode, Plant, Scenario

PIECES = 8
TERMS = 24
#: Samples whose transitions are worked out at once.
BLOCK = 1024


def fine(plant: Plant, scenario: Scenario) -> tuple[Plant, Scenario]:
    """Return plant and scenario on the grid of pieces, one point more than pieces."""
    return (replace(plant, sample_period=plant.sample_period / PIECES),
            replace(scenario, steps=scenario.steps * PIECES + 1))


def slopes(modes: tuple[Mode, ...], name: str, count: int) -> Array:
    """Slopes of a matrix in all parameters, by mode (modes, count, rows, columns)."""
    shape = (count, *getattr(modes[0], name).shape)
    return np.array([m.theta_terms.get(name, np.zeros(shape)) for m in modes]).reshape(len(modes), *shape)


def transitions(modes: tuple[Mode, ...], q: Array, h: float, theta: tuple[Array, Array], u: tuple[Array, Array],
                w: Array, f: Array) -> tuple[Array, Array]:
    """Solve ``x' = A(theta) x + B(theta) u + Bw w + Bf f`` over pieces of h, theta and u linear between their ends.

    Parameters
    ----------
    modes : tuple of Mode
    q : ndarray (K,) int
        Mode of each piece.
    h : float
        Seconds.
    theta : (ndarray (K, n_theta), ndarray (K, n_theta)), u : (ndarray (K, n_u), ndarray (K, n_u))
        At start and end of each piece.
    w : ndarray (K, n_w), f : ndarray (K, n_f)

    Returns
    -------
    Phi : ndarray (K, n_x, n_x), c : ndarray (K, n_x)
        x at the end of a piece is Phi x + c.
    """
    count, n = theta[0].shape[1], len(modes[0].A)
    A0, A1, B0, B1 = (np.einsum("kj,kjab->kab", v, slopes(modes, name, count)[q])
                      for name in "AB" for v in (theta[0], theta[1] - theta[0]))
    A, B, Bw, Bf = (np.array([getattr(m, name) for m in modes])[q] for name in ("A", "B", "Bw", "Bf"))
    A0, B0, ramp = A0 + A, B0 + B, u[1] - u[0]
    parts = max(1, int(np.ceil(2 * h * np.max(np.abs(A0).sum(axis=2) + np.abs(A1).sum(axis=2), initial=0.0))))
    step, push = h / parts, times(Bw, w) + times(Bf, f)
    whole = np.zeros((len(q), n, n + 1))  # Phi, and c as its last column
    whole[:, :, :n] = np.eye(n)
    for part in range(parts):
        # s in [0, 1] over the part; A(s) = Aa + s Ab, and the same of B and u.
        Aa, Ab = A0 + part / parts * A1, A1 / parts
        Ba, Bb = B0 + part / parts * B1, B1 / parts
        ua, ub = u[0] + part / parts * ramp, ramp / parts
        drive = [times(Ba, ua) + push, times(Ba, ub) + times(Bb, ua), times(Bb, ub)]
        before, term, total = np.zeros_like(whole), whole, whole
        for k in range(TERMS):
            new = Aa @ term + Ab @ before
            if k < 3:
                new[:, :, n] += drive[k]
            before, term = term, step * new / (k + 1)
            total = total + term
        whole = total
    return whole[:, :, :n], whole[:, :, n]


def times(M: Array, v: Array) -> Array:
    """Matrices times vectors, row by row (K, rows)."""
    return np.einsum("kab,kb->ka", M, v)


def advance(mode: Mode, x: Array, h: float, theta: tuple[Array, Array], u: tuple[Array, Array], w: Array,
            f: Array) -> Array:
    """Solve the same over one piece, from a state.

    Parameters
    ----------
    mode : Mode
    x : ndarray (n_x,)
    h : float
        Seconds.
    theta, u : (ndarray, ndarray)
        At start and end.
    w : ndarray (n_w,), f : ndarray (n_f,)

    Returns
    -------
    x : ndarray (n_x,)
        At the end.
    """
    ends = [tuple(np.asarray(v, dtype=float)[None] for v in pair) for pair in (theta, u)]
    (Phi,), (c,) = transitions((mode,), np.zeros(1, dtype=int), h, *ends, np.asarray(w)[None], np.asarray(f)[None])
    return Phi @ x + c
