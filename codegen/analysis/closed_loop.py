"""The true nonlinear plant under a tracking unit: every sample a measurement, an answer, a held input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..observers import PolytopicTrace
from ..plant.descriptor import PIECES, Implicit, truth
from ..plant.model import Plant

Array = np.ndarray
DRAWS = ("none", "uniform", "corner")


@dataclass(frozen=True)
class Signals:
    """What acts on a loop from outside, besides the reference.

    Parameters
    ----------
    x0 : ndarray (n,)
    w : ndarray (K, PIECES, n_w)
        Constant on each piece of a sample.
    v : ndarray (K, n_v), f : ndarray (K, n_f)
    missing : ndarray (K,) of bool
        Samples without a measurement.
    """

    x0: Array
    w: Array
    v: Array
    f: Array
    missing: Array


@dataclass(frozen=True)
class ClosedLoop:
    """What happened, (K, ..) each.

    Parameters
    ----------
    x : ndarray (K, n), u : ndarray (K, m), y : ndarray (K, p), r : ndarray (K, p), r_bound : ndarray (K, p)
    limited, raw, assured : ndarray (K,)
        As the unit answers.
    trace : PolytopicTrace
        All that its observer answers.
    signals : Signals
    """

    x: Array
    u: Array
    y: Array
    r: Array
    r_bound: Array
    limited: Array
    raw: Array
    assured: Array
    trace: PolytopicTrace
    signals: Signals


def drawn(plant: Plant, steps: int, seed: int = 0, draw: str = "uniform", fault: Array | None = None,
          missing: Array | None = None) -> Signals:
    """Draw what acts on a loop.

    Parameters
    ----------
    plant : Plant
    steps : int
    seed : int
    draw : {"none", "uniform", "corner"}
        Start, disturbances (new ones on each of the pieces of a sample) and noises: none, anywhere within their bounds,
        or always at one end of them.
    fault : ndarray (K, n_f), optional
    missing : ndarray (K,) of bool, optional

    Returns
    -------
    Signals

    Raises
    ------
    ValueError
        Another draw.
    """
    if draw not in DRAWS:
        raise ValueError(f"draw is {draw!r}, expected one of {', '.join(DRAWS)}")
    rng = np.random.default_rng(seed)
    fault = np.zeros((steps, plant.n_f)) if fault is None else fault
    missing = np.zeros(steps, bool) if missing is None else missing
    x = _drawn(rng, plant.x0_lo, plant.x0_hi, (), draw)
    w = _drawn(rng, *plant.limits("w"), (steps, PIECES), draw)
    return Signals(x, w, _drawn(rng, *plant.limits("v"), (steps,), draw), fault, missing)


def closed_loop(plant: Plant, unit, ref: Array, signals: Signals) -> ClosedLoop:
    """Simulate one run.

    Parameters
    ----------
    plant : Plant
        With a polytope and E = I; its equations are the truth where it has some.
    unit : object
        ``step(ref, y)`` as of ``observers.feedback.Tracker``.
    ref : ndarray (K, k)
    signals : Signals

    Returns
    -------
    ClosedLoop
    """
    p, steps, x = plant.polytope, len(ref), signals.x0
    true, solver, h = truth(plant), Implicit(p.E), plant.sample_period / PIECES
    states, outputs, commands, answers = np.empty((steps, plant.n_x)), np.empty((steps, plant.n_y)), [], []
    none = np.zeros(0)
    for k in range(steps):
        states[k] = x
        outputs[k] = np.nan if signals.missing[k] else p.C @ x + p.Dv @ signals.v[k] + p.Df @ signals.f[k]
        command, answer = unit.step(ref[k][None], outputs[k][None])
        u = command.u[0].astype(float)
        commands.append((u, command.limited[0]))
        answers.append(answer)
        for piece in range(PIECES):
            def at(_, now=piece, u=u, k=k):
                return lambda z: true(z, u, none, signals.w[k, now], signals.f[k])
            x = solver.advance(x, h, at)
    u, limited = (np.array(column) for column in zip(*commands))
    trace = PolytopicTrace(*(np.concatenate([getattr(a, name) for a in answers])
                             for name in PolytopicTrace.__dataclass_fields__))
    return ClosedLoop(states, u, outputs, trace.r, trace.r_bound, limited, trace.raw_bits, trace.assured, trace,
                      signals)


def _drawn(rng, lo: Array, hi: Array, shape: tuple[int, ...], draw: str) -> Array:
    middle = np.broadcast_to((lo + hi) / 2, (*shape, len(lo)))
    if draw == "none":
        return middle.copy()
    if draw == "uniform":
        return rng.uniform(lo, hi, (*shape, len(lo)))
    return np.where(rng.random((*shape, len(lo))) < 0.5, lo, hi)
