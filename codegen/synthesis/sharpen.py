"""What a pole leaves free of the gains, used for detection: a search from H-infinity gains for a smaller sure fault.

The H-infinity optimum is flat: many S have nearly the same level, and their surely detected faults differ by a fifth.
Each mode alone is a search (Nelder-Mead) over the n_x (n_y - k) entries that k poles leave. Whether all modes together
still have a Lyapunov function, and a smaller threshold under switching, is asked at the end: if not, part of the way
is taken back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from ..algebra.dwell import admitted_jump
from .point import PointGains, Units, dwell_of
from .problem import Problem
from .refit import refit
from .residual_judge import Path, ResidualJudge

Array = np.ndarray
#: What is given up of the threshold (in logarithm) for a smaller hull of the error: bounds of x, and switching, profit.
WIDTH_WEIGHT = 0.05
#: Shares of the way that are tried, the farthest first.
SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)


def sharpened(plant, start: PointGains, rest: Array, within: int, evaluations: int, score: Callable,
              progress: Callable[[str], None]) -> PointGains | None:
    """Gains with the same poles, certifiable in the same way, and a smaller threshold.

    Parameters
    ----------
    plant : Plant
    start : PointGains
        Of a Luenberger observer.
    rest : ndarray (N, n_y, n_y)
        What is free, in the units of ``Units.of``: ``FaultDirections.rest``, or identities where no pole is given.
    within : int
        Samples after the onset.
    evaluations : int
        Of the threshold, per mode.
    score : callable
        (L, N, proof) -> threshold that the caller goes by; it is put into the figures.
    progress : callable

    Returns
    -------
    PointGains or None
        None where nothing better was found.
    """
    units = Units.of(plant)
    problem, L0 = units.problem(Problem.of(plant, False)), units.own_gains(start.L)
    judge = ResidualJudge(problem, within, dwell_of(start.proof, problem.tau))
    before, L = judge(L0, start.N), np.array(L0)
    for q, name in enumerate(problem.names):
        progress(f'detection, {q + 1} of {len(L)}: mode "{name}"')
        L[q] = best_gain(problem, q, L0, rest[q], within, evaluations)
    for share in SHARES:
        gains = units.stated_gains(L0 + share * (L - L0))
        proof = refit(plant, gains, start.N, start.proof | {"rho": _most(start.proof)})
        if proof is not None and judge(units.own_gains(gains), start.N) < before * (1 - 1e-6):
            return PointGains(f"detection, {start.label}", gains, start.N, start.kind, proof,
                              {"threshold": score(gains, start.N, proof)})
    return None


def best_gain(problem: Problem, q: int, L: Array, rest: Array, within: int, evaluations: int,
              width: float = WIDTH_WEIGHT) -> Array:
    """The gain of one mode with the smallest threshold in it, near L_q + X rest.

    Parameters
    ----------
    problem : Problem
    q : int
    L : ndarray (N, n_x, n_y)
    rest : ndarray (n_y, n_y)
        A projection.
    within : int
    evaluations : int
    width : float
        Weight of the logarithm of the error's hull.

    Returns
    -------
    ndarray (n_x, n_y)
    """
    U, s, _ = np.linalg.svd(rest)
    basis = U[:, s > 0.5]  # of a projection: its singular values are 0 and 1
    if basis.shape[1] == 0:
        return L[q]
    step = 0.3 * max(float(np.max(np.abs(L[q] @ basis), initial=0.0)), 1e-3)
    none, tried = np.zeros_like(L), np.array(L)

    def cost(x):
        tried[q] = L[q] + x.reshape(L.shape[1], -1) @ basis.T
        alone = Path(problem, (q,), tried, none)
        found = np.max(alone.thresholds(list(range(within + 1))).min(axis=1) / problem.f_scale)
        if not (np.isfinite(found) and found > 0):
            return 1e3
        return np.log(found) + width * np.log(max(np.sum(np.abs(alone.errors[0])), 1e-300))

    size = L.shape[1] * basis.shape[1]
    solved = minimize(cost, np.zeros(size), method="Nelder-Mead", options={
        "maxfev": evaluations, "initial_simplex": np.vstack([np.zeros(size), step * np.eye(size)]), "xatol": 1e-5,
        "fatol": 1e-6})
    return L[q] + solved.x.reshape(L.shape[1], -1) @ basis.T


def _most(proof: dict) -> float:
    """Largest jump factor that decay and dwell time of a proof admit."""
    if proof["lam"] == 0:
        return 1.0
    return admitted_jump(proof["lam"], 0.98 * proof["dwell_add"] / proof["dwell_drain"])
