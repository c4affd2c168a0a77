"""The true nonlinear plant under a tracking unit: every sample a measurement, an answer, a held input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers.tracking import TrackingAnswer
from ..plant.descriptor import PIECES, Implicit, truth
from ..plant.model import Plant

Array = np.ndarray
DRAWS = ("none", "uniform", "corner")


@dataclass(frozen=True)
class ClosedLoop:
    """What happened, (K, ..) each.

    Parameters
    ----------
    x : ndarray (K, n)
    y : ndarray (K, p)
    ref : ndarray (K, k)
    answers : TrackingAnswer
        Of the unit, (K, ..).
    """

    x: Array
    y: Array
    ref: Array
    answers: TrackingAnswer


def closed_loop(plant: Plant, unit, ref: Array, seed: int = 0, draw: str = "uniform", fault: Array | None = None,
                missing: Array | None = None) -> ClosedLoop:
    """Simulate one run.

    Parameters
    ----------
    plant : Plant
        With a polytope and E = I; its equations are the truth where it has some.
    unit : object
        ``step(ref, y)`` as of ``TrackingObserver``: the reference, or the compiled C.
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
    states, outputs, answers = np.empty((steps, plant.n_x)), np.empty((steps, plant.n_y)), []
    none = np.zeros(0)
    for k in range(steps):
        states[k] = x
        outputs[k] = np.nan if missing[k] else p.C @ x + p.Dv @ v[k] + p.Df @ fault[k]
        answers.append(unit.step(ref[k][None], outputs[k][None]))
        u = answers[-1].u[0].astype(float)
        for piece in range(PIECES):
            def at(_, now=piece, u=u, k=k):
                return lambda z: true(z, u, none, w[k, now], fault[k])
            x = solver.advance(x, h, at)
    found = {name: np.concatenate([getattr(a, name) for a in answers]) for name in vars(answers[0])}
    return ClosedLoop(states, outputs, ref, TrackingAnswer(**found))


def _drawn(rng, lo: Array, hi: Array, shape: tuple[int, ...], draw: str) -> Array:
    middle = np.broadcast_to((lo + hi) / 2, (*shape, len(lo)))
    if draw == "none":
        return middle.copy()
    if draw == "uniform":
        return rng.uniform(lo, hi, (*shape, len(lo)))
    return np.where(rng.random((*shape, len(lo))) < 0.5, lo, hi)
