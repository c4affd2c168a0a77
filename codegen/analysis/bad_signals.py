"""Signals that are bad for a tracked plant: found on its loop at the middle of all weights, to be run on the true one.

Nothing is claimed of them but that they are within their bounds: they show how near runs come to what is certified.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from ..algebra.interval import sizes
from ..plant.descriptor import PIECES
from .closed_loop import Signals

Array = np.ndarray


@dataclass(frozen=True)
class MeanLoop:
    """[x; z; s]+ = A [x; z; s] + B d, u = U [x; z; s] + V d, with d = [w; v; ref] in units of their largest sizes.

    Parameters
    ----------
    A : ndarray (N, N), B : ndarray (N, q)
    U : ndarray (m, N), V : ndarray (m, q)
    error : ndarray (k, N)
        Tracking error at reference 0, in units of the references.
    counts : (int, int, int)
        Numbers of w, v and ref.
    """

    A: Array
    B: Array
    U: Array
    V: Array
    error: Array
    counts: tuple[int, int, int]


def mean_loop(plant, t) -> MeanLoop:
    """The loop at the mean of all vertices.

    Parameters
    ----------
    plant : Plant
        Continuous, polytopic, E = I.
    t : PolytopicTables
        With a law.

    Returns
    -------
    MeanLoop
    """
    p, law, n, m = plant.polytope, t.law, plant.n_x, plant.n_u
    A, B, Bw = (np.mean([getattr(v, name) for v in p.vertices], axis=0) for name in ("A", "B", "Bw"))
    (w, v), ref = (sizes(*plant.limits(name)) for name in "wv"), law.reference.astype(float)
    wide = np.zeros((n + m + len(w),) * 2)
    wide[:n] = np.hstack([A, B, Bw])
    A, B, Bw = np.split(expm(wide * plant.sample_period)[:n], [n, n + m], axis=1)
    F, G, K, T2, C = (np.asarray(M, dtype=float) for M in (*(M.mean(axis=0) for M in (t.F, t.G, t.K)), t.T2, t.C))
    Kx, Ki = (M.astype(float).mean(axis=0) for M in (law.Kx, law.Ki))
    k = len(ref)
    x, z, s = np.split(np.eye(2 * n + k), [n, 2 * n])
    Dv, rows = p.Dv * v, list(law.rows)
    hat, noise = T2 @ p.C @ x + z, T2 @ Dv
    U, V = Kx @ hat + Ki @ s, Kx @ noise
    r, r_v = p.C @ x - C @ hat, Dv - C @ noise
    none_v, none_w = np.zeros((n, k)), np.zeros((n + k, len(w)))
    state = np.vstack([A @ x + B @ U, F @ hat + G @ U - K @ r, s - law.period * p.C[rows] @ x])
    into_v = np.vstack([B @ V, F @ noise + G @ V - K @ r_v, -law.period * Dv[rows]])
    into_w = np.vstack([Bw * w, none_w])
    into_ref = np.vstack([none_v, none_v, law.period * np.diag(ref)])
    return MeanLoop(state, np.hstack([into_w, into_v, into_ref]), U,
                    np.hstack([np.zeros((m, len(w))), V, np.zeros((m, k))]), p.C[rows] @ x / ref[:, None],
                    (len(w), len(v), k))


def towards(plant, t, loop: MeanLoop, i: int, steps: int) -> tuple[Array, Signals]:
    """References and signals, always at an end of their bounds, that drive input i up at the last sample.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    loop : MeanLoop
    i : int
    steps : int

    Returns
    -------
    ref : ndarray (K, k)
    signals : Signals
    """
    row, sign = loop.U[i], np.empty((steps, loop.B.shape[1]))
    sign[-1] = loop.V[i]
    for k in range(steps - 2, -1, -1):
        sign[k], row = row @ loop.B, row @ loop.A
    x0 = np.where(row[:plant.n_x] >= 0, plant.x0_hi, plant.x0_lo)
    up = sign >= 0
    n_w, n_v, _ = loop.counts
    w, v = (np.where(chosen, hi, lo) for chosen, (lo, hi) in ((up[:, :n_w], plant.limits("w")),
                                                              (up[:, n_w:n_w + n_v], plant.limits("v"))))
    ref = np.where(up[:, n_w + n_v:], t.law.reference, -t.law.reference)
    return ref, _signals(plant, x0, w, v)


def resonant(plant, t, loop: MeanLoop, steps: int) -> tuple[Array, Signals]:
    """From rest at reference 0: disturbances and noises that swing as the tracking error answers most.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    loop : MeanLoop
    steps : int

    Returns
    -------
    ref : ndarray (K, k)
    signals : Signals
    """
    n_w, n_v, k = loop.counts
    B, best = loop.B[:, :n_w + n_v], (-1.0, 0.0, None)
    for at in np.geomspace(4 * np.pi / steps, np.pi, 80):
        gain = loop.error @ np.linalg.solve(np.exp(1j * at) * np.eye(len(loop.A)) - loop.A, B)
        _, levels, right = np.linalg.svd(gain)
        best = max(best, (levels[0], at, right[0].conj()), key=lambda found: found[0])
    _, at, direction = best
    d = np.real(np.exp(1j * at * np.arange(steps))[:, None] * direction / np.abs(direction).max())
    w, v = (np.clip(d[:, part] * sizes(lo, hi), lo, hi) for part, (lo, hi) in (
        (slice(n_w), plant.limits("w")), (slice(n_w, None), plant.limits("v"))))
    return np.zeros((steps, k), t.law.reference.dtype), _signals(plant, np.clip(0, plant.x0_lo, plant.x0_hi), w, v)


def _signals(plant, x0: Array, w: Array, v: Array) -> Signals:
    return Signals(x0, np.repeat(w[:, None], PIECES, axis=1), v, np.zeros((len(v), plant.n_f)),
                   np.zeros(len(v), dtype=bool))
