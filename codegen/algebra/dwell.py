"""Average dwell time: how slow switching must be, in numbers an integer monitor can hold.

A mode signal has average dwell time tau with chatter bound N0 when every stretch of s samples holds at
most N0 + s/tau switches (Zammali (2020), Definition 9). If V shrinks by (1 - lam) per sample and grows by rho
at a switch, any tau with ``(1 - lam) rho^(1/tau) < 1`` keeps it bounded (Lemma 8); one switch per
sample, tau = 1, is arbitrary switching.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np


def shortest(rho: float, lam: float) -> float:
    """Infimum of the certified average dwell times, -ln(rho)/ln(1 - lam), in samples.

    Parameters
    ----------
    rho : float
        Jump factor, >= 1.
    lam : float
        Decay, 0 < lam < 1.
    """
    return -math.log(rho) / math.log1p(-lam) if rho > 1.0 else 0.0


def ratio(tau: float, limit: int = 64) -> tuple[int, int]:
    """Smallest convenient fraction add/drain >= tau for the leaky bucket.

    Returns
    -------
    add, drain : int
    """
    best = Fraction(math.ceil(tau))
    for drain in range(1, limit + 1):
        candidate = Fraction(math.ceil(tau * drain - 1e-12), drain)
        if candidate < best:
            best = candidate
    return best.numerator, best.denominator


def admitted_jump(lam: float, tau: float) -> float:
    """Largest jump factor that a decay and a dwell time admit, ``(1 - lam)^-tau``, or 1e9: no solver gains from more.

    Parameters
    ----------
    lam : float
        Decay, 0 <= lam <= 1.
    tau : float
        Samples.
    """
    return 1e9 if lam >= 1.0 else math.exp(min(-math.log1p(-lam) * tau, math.log(1e9)))


def switching_factor(rho: float, lam: float, tau: float, chatter: float) -> float:
    """Factor on c^2 in ``V <= factor * c^2`` for V+ <= (1 - lam) V + c^2 under dwell time tau.

    ``rho^(N0 + 1/tau) / (1 - (1 - lam) rho^(1/tau))``; the one-mode value of Zammali (2020) is 1/lam. Derived by
    counting jumps (see certify.dwell for the exact check).
    """
    s = (1.0 - lam) * rho ** (1.0 / tau)
    return math.inf if s >= 1.0 else rho ** (chatter + 1.0 / tau) / (1.0 - s)


def admissible(modes: tuple[int, ...], tau: float, chatter: float) -> bool:
    """Whether a finite mode sequence respects average dwell time tau with chatter bound N0."""
    bucket = 0.0
    for before, after in zip(modes, modes[1:]):
        bucket = max(0.0, bucket - 1.0 / tau) + (before != after)
        if bucket > chatter + 1e-12:
            return False
    return True


def fewest_samples(switching, period: float, proof: dict) -> int:
    """Samples that every mode lasts at least, where the plant file or a proof says so.

    Parameters
    ----------
    switching : Switching
        Of the plant; an average dwell time with a chatter bound of 1 is the shortest time as well.
    period : float
        Sample period, s.
    proof : dict
        Of gains, or a certificate.

    Returns
    -------
    samples : int
        1: any sequence.
    """
    found = 1
    if switching.average_dwell is not None and switching.chatter == 1:
        found = max(1, int(switching.average_dwell / period + 1e-9))
    if proof.get("rho", 1.0) > 1 and proof.get("chatter", 1) == 1:
        found = max(found, math.ceil(proof["dwell_add"] / proof["dwell_drain"]))
    return found


def patterns(modes: int, dwell: int, steps: int) -> list[tuple[int, ...]]:
    """List mode sequences that a dwell time admits: modes that stay, pairs and rounds at several paces, random ones.

    Parameters
    ----------
    modes, dwell, steps : int

    Returns
    -------
    paths : list of tuple of int
    """
    cycles = [[q] for q in range(modes)]
    for pace in sorted({dwell, dwell + 1, 2 * dwell, 3 * dwell}):
        for a in range(modes):
            cycles += [[a] * dwell + [b] * pace for b in range(modes) if b != a]
        cycles.append([q for q in range(modes) for _ in range(pace)])
    paths = {tuple((cycle * (-(-steps // len(cycle))))[:steps]) for cycle in cycles}
    rng = np.random.default_rng(0)
    for _ in range(4 if modes > 1 else 0):
        path: list[int] = []
        while len(path) < steps:
            q = int(rng.integers(modes - 1))
            q += bool(path and q >= path[-1])  # another one than before
            path += [q] * int(dwell + rng.integers(2 * dwell + 1))
        paths.add(tuple(path[:steps]))
    return sorted(paths)
