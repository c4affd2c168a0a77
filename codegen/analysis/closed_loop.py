"""The true nonlinear plant under a tracking unit: every sample a measurement, an answer, a held input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..plant.descriptor import PIECES, Implicit, truth
from ..plant.model import Plant

Array = np.ndarray
DRAWS = ("none", "uniform", "corner")


@dataclass(frozen=True)
class ClosedLoop:
    """What happened, (K, ..) each.

    Parameters
    ----------
    x : ndarray (K, n), u : ndarray (K, m), y : ndarray (K, p), r : ndarray (K, p), r_bound : ndarray (K, p)
    limited, raw, assured : ndarray (K,)
        As the unit answers.
    """

    x: Array
    u: Array
    y: Array
    r: Array
    r_bound: Array
    limited: Array
    raw: Array
    assured: Array


def closed_loop(plant: Plant, unit, ref: Array, seed: int = 0, draw: str = "uniform", fault: Array | None = None,
                missing: Array | None = None) -> ClosedLoop:
    """Simulate one run.

    Parameters
    ----------
    plant : Plant
        With a polytope and E = I; its equations are the truth where it has some.
    unit : object
        ``step(ref, y)`` as of ``observers.feedback.Tracker``.
    ref : ndarray (K, k)
    seed : int
    draw : {"none", "uniform", "corner"}
        Start, disturbances (new ones on each of the pieces of a sample) and noises: none, anywhere within their bounds,
        or always at one end of them.
    fault : ndarray (K, n_f), optional
    missing : ndarray (K,) of bool, optional
        Samples without a measurement.

    Returns
    -------
    ClosedLoop

    Raises
    ------
    ValueError
        Another draw.
    """
    if draw not in DRAWS:
        raise ValueError(f"draw is {draw!r}, expected one of {', '.join(DRAWS)}")
    p, steps, rng = plant.polytope, len(ref), np.random.default_rng(seed)
    true, solver, h = truth(plant), Implicit(p.E), plant.sample_period / PIECES
    fault = np.zeros((steps, plant.n_f)) if fault is None else fault
    missing = np.zeros(steps, bool) if missing is None else missing
    x = _drawn(rng, plant.x0_lo, plant.x0_hi, (), draw)
    w = _drawn(rng, *plant.limits("w"), (steps, PIECES), draw)
    v = _drawn(rng, *plant.limits("v"), (steps,), draw)
    states, outputs, rows = np.empty((steps, plant.n_x)), np.empty((steps, plant.n_y)), []
    none = np.zeros(0)
    for k in range(steps):
        states[k] = x
        outputs[k] = np.nan if missing[k] else p.C @ x + p.Dv @ v[k] + p.Df @ fault[k]
        command, answer = unit.step(ref[k][None], outputs[k][None])
        u = command.u[0].astype(float)
        rows.append((u, answer.r[0], answer.r_bound[0], command.limited[0], answer.raw_bits[0], answer.assured[0]))
        for piece in range(PIECES):
            def at(_, now=piece, u=u, k=k):
                return lambda z: true(z, u, none, w[k, now], fault[k])
            x = solver.advance(x, h, at)
    u, *answers = (np.array(column) for column in zip(*rows))
    return ClosedLoop(states, u, outputs, *answers)


def _drawn(rng, lo: Array, hi: Array, shape: tuple[int, ...], draw: str) -> Array:
    middle = np.broadcast_to((lo + hi) / 2, (*shape, len(lo)))
    if draw == "none":
        return middle.copy()
    if draw == "uniform":
        return rng.uniform(lo, hi, (*shape, len(lo)))
    return np.where(rng.random((*shape, len(lo))) < 0.5, lo, hi)
