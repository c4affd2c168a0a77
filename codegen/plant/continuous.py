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


def fine(plant: Plant, scenario: Scenario) -> tuple[Plant, Scenario]:
    """Return plant and scenario on the grid of pieces, one point more than pieces."""
    return (replace(plant, sample_period=plant.sample_period / PIECES),
            replace(scenario, steps=scenario.steps * PIECES + 1))


def slopes(mode: Mode, name: str, count: int) -> Array:
    """Slopes of a matrix in all parameters (count, rows, columns)."""
    base = getattr(mode, name)
    return np.array(mode.theta_terms.get(name, np.zeros((count, *base.shape)))).reshape(count, *base.shape)


def advance(mode: Mode, x: Array, h: float, theta: tuple[Array, Array], u: tuple[Array, Array], w: Array,
            f: Array) -> Array:
    """Solve ``x' = A(theta) x + B(theta) u + Bw w + Bf f`` over h, theta and u linear between their two values.

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
    count = len(theta[0])
    A0, A1, B0, B1 = (np.tensordot(v, slopes(mode, n, count), 1) for n in "AB" for v in (theta[0], theta[1] - theta[0]))
    A0, B0 = A0 + mode.A, B0 + mode.B
    parts = max(1, int(np.ceil(2 * h * np.max(np.abs(A0).sum(axis=1) + np.abs(A1).sum(axis=1)))))
    step, push = h / parts, mode.Bw @ w + mode.Bf @ f
    for part in range(parts):
        # s in [0, 1] over the part; A(s) = Aa + s Ab, and the same of B and u.
        Aa, Ab = A0 + part / parts * A1, A1 / parts
        Ba, Bb = B0 + part / parts * B1, B1 / parts
        ua, ub = u[0] + part / parts * (u[1] - u[0]), (u[1] - u[0]) / parts
        drive = [Ba @ ua + push, Ba @ ub + Bb @ ua, Bb @ ub]
        before, term, total = np.zeros_like(x), x, x
        for k in range(TERMS):
            new = Aa @ term + Ab @ before + (drive[k] if k < 3 else 0.0)
            before, term = term, step * new / (k + 1)
            total = total + term
        x = total
    return x
