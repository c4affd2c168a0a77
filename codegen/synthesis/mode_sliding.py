"""Which mode is active when nobody tells: a bank of interval observers and super-twisting differentiators.

Plant: switched, in continuous time, sampled; y = C x + D u + v with C, D and v common to the modes; the mode changes at
any instant, with a dwell time. Parameters are no inputs of the estimator: what they do is bounded with the disturbance
(``plant.bounded``).

The observer (``observers.sliding``) has per mode a pair of bounds with gains L_hi, L_lo. With the errors zeta of both,
their sources W >= 0 and chi = (A_i - A_q) x + (B_i - B_q) u of a wrong mode, ``zeta' = Acl zeta + W + F chi`` and
``r = CC zeta``, F = [I; -I], CC = [C+ C-; -C- -C+]. One diagonal P = diag(P1, P2) >= I for all modes, X = P1 L_hi,
Y = P2 L_lo; minimise weight gamma + (1 - weight) beta subject to

    ``A_i' P1 - C' X_i' + limit P1 >= 0``, ``A_i' P2 - C' Y_i' + limit P2 >= 0``   (entrywise: Metzler, gains limited)
    ``[S, P; P, -gamma I] < 0``,   ``S = Acl' P + P Acl + CC' CC``                 (|r| <= sqrt(gamma) |W|)
    ``[S, P F - CC' J; *, J' J - beta I] < 0``                                    (|r - J chi| <= sqrt(beta) |chi|)

Source: C. Zammali (2020), chapter 4, Theorem 12 and (4.3) to (4.37).

Differences from the printed design:

* J2 has the wrong sign in Theta13 and Theta23: the blocks of P F - CC' J are ``P1 - C+' J1 + C-' J2`` and
  ``-P2 - C-' J1 + C+' J2``;
* P >= I, which the reported numbers rest on and no line states, is a condition here;
* the levels are sqrt(gamma) and sqrt(beta), and beta > max eig J' J whatever the gains: it says nothing of how well
  modes are told apart. Gamma and beta of modes that do not bind are made least in a second pass, so that gains are
  unique;
* sampled: L is held for a period, and the pair moves with the exact transition, so that noise and what y does between
  samples are covered by the offsets;
* that modes can be told apart is assumed in the thesis (Assumption 17), and not true of its example. Nothing is
  claimed of the decision here; it is measured.
"""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np

from ..algebra.interval import neg, pos
from ..errors import DesignError
from .mode_tables import check

Array = np.ndarray
#: Options of ``[observer]``: see README.md.
OPTIONS = {"gain_limit": (1e-6, 1e9), "weight": (0.0, 1.0), "slope": (1e-9, 1e15), "blank": (0.0, 1e6),
           "window": (0.0, 1e6), "share": (0.01, 1.0)}
#: Every entry of J; the thesis's.
TARGET = 0.5
#: What strict inequalities are away from equality.
MARGIN = 1e-6


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this estimator, with what to change; None if it can."""
    if plant.polytope is not None:
        return "the plant is polytopic (vertices and weights), expected [[mode]] tables."
    if plant.switching.known:
        return "the mode is known at run time, expected switching.known = false."
    if not 2 <= plant.n_modes <= 32:
        return f"the plant has {plant.n_modes} modes, expected 2 to 32."
    s = plant.switching
    if s.average_dwell is None or s.chatter != 1:
        return "no dwell time is declared, expected switching.minimum_dwell."
    if s.average_dwell < 8 * plant.sample_period:
        return (f"the dwell time of {s.average_dwell:g} s is less than eight samples of {plant.sample_period:g} s. "
                "Sample faster.")
    try:
        check(plant, "mode-sliding")
    except DesignError as error:
        return str(error).removeprefix(f"{plant.name}: mode-sliding ")
    return None


def theorem12(A, C: Array, limit: float, weight: float = 0.5, corrected: bool = True, second: bool = True) -> dict:
    """Solve the conditions of Theorem 12.

    Parameters
    ----------
    A : sequence of ndarray (n_x, n_x)
        Continuous time, one per mode.
    C : ndarray (n_y, n_x)
    limit : float
        No diagonal entry of A_i - L C is below minus this, 1/s.
    weight : float
        Of gamma in the objective.
    corrected : bool
        J2 with its right sign; False: as printed, to meet the thesis's numbers.
    second : bool
        Least gamma and beta of every mode by itself, the largest being kept.

    Returns
    -------
    dict
        "L_hi", "L_lo" (N, n_x, n_y), "P" (2, n_x), "gamma", "beta" (N,).

    Raises
    ------
    DesignError
        There is none.
    """
    (p, n), N = C.shape, len(A)
    J = np.full((2 * p, n), TARGET)
    J1, J2, sign = J[:p], J[p:], 1.0 if corrected else -1.0
    P1, P2, gamma, beta = cp.Variable(n), cp.Variable(n), cp.Variable(N), cp.Variable(N)
    X, Y = ([cp.Variable((n, p)) for _ in range(N)] for _ in range(2))
    D1, D2, zero = cp.diag(P1), cp.diag(P2), np.zeros((n, n))
    seen = np.block([[pos(C), neg(C)], [-neg(C), -pos(C)]])
    P = cp.bmat([[D1, zero], [zero, D2]])
    told = cp.vstack([D1 - pos(C).T @ J1 + sign * neg(C).T @ J2, -D2 - neg(C).T @ J1 + sign * pos(C).T @ J2])
    conditions = [P1 >= 1, P2 >= 1]
    # Entries that no gain moves are what they are.
    least = MARGIN * np.tile(np.any(C != 0, axis=0)[:, None], (1, n))
    for i in range(N):
        a, b = A[i].T @ D1 - C.T @ X[i].T, A[i].T @ D2 - C.T @ Y[i].T
        conditions += [a + limit * D1 >= least, b + limit * D2 >= least]
        S = cp.bmat([[a + a.T, zero], [zero, b + b.T]]) + seen.T @ seen
        narrow = cp.bmat([[S, P], [P, -gamma[i] * np.eye(2 * n)]])
        apart = cp.bmat([[S, told], [told.T, J.T @ J - beta[i] * np.eye(n)]])
        conditions += [M << -MARGIN * np.eye(M.shape[0]) for M in (narrow, apart)]
    worst = weight * cp.max(gamma) + (1 - weight) * cp.max(beta)
    problem = cp.Problem(cp.Minimize(worst), conditions)
    if not _solved(problem):
        raise DesignError("no gains meet the conditions of Theorem 12: A_i - L C cannot be made Metzler and stable by "
                          f"gains within the limit of {limit:g} 1/s in every mode. Raise observer.gain_limit, or use "
                          'method "mode-set", which needs neither.')
    if second:
        room = [level <= np.max(level.value) * (1 + 1e-4) + 1e-9 for level in (gamma, beta)]
        _solved(cp.Problem(cp.Minimize(weight * cp.sum(gamma) + (1 - weight) * cp.sum(beta)), conditions + room))
    return {"L_hi": np.array([x.value / P1.value[:, None] for x in X]),
            "L_lo": np.array([y.value / P2.value[:, None] for y in Y]),
            "P": np.array([P1.value, P2.value]), "gamma": gamma.value.copy(), "beta": beta.value.copy()}


def _solved(problem: cp.Problem) -> bool:
    """Whether the solver came back with numbers; they are judged exactly afterwards."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return False
    return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)


def settings(plant, options: dict) -> dict:
    """Numbers of the decision and of the loops: the options, or what the plant suggests.

    Parameters
    ----------
    plant : Plant
    options : dict
        Of ``[observer]``.

    Returns
    -------
    dict
        "limit" in 1/s, "weight", "slope" k2 in units of y per square second, "blank" and "dwell" in samples, "window"
        in s, "share".

    Raises
    ------
    DesignError
        The blanking time is no shorter than the dwell time.
    """
    T, dwell = plant.sample_period, plant.switching.average_dwell
    blank = max(1, round(float(options.get("blank", dwell / 8)) / T))
    least = int(dwell / T + 1e-9)
    if blank + 2 > least:
        raise DesignError(f"{plant.name}: observer.blank is {blank} samples, the dwell time {least}: no decision would "
                          "be made between two switches. Shorten it.")
    # A rate has to get to what another mode makes of it within the blanking time.
    slope = float(options.get("slope", np.max(rates_apart(plant)) / (2 * blank * T)))
    return {"limit": float(options.get("gain_limit", 0.5 / T)), "weight": float(options.get("weight", 0.5)),
            "slope": slope, "blank": blank, "dwell": least,
            "window": max(float(options.get("window", dwell / 15)), 2 * T), "share": float(options.get("share", 0.8))}


def rates_apart(plant) -> Array:
    """Largest difference of the outputs' rates between two modes over the declared ranges, (n_y,); none is 1."""
    (x_lo, x_hi), (u_lo, u_hi) = plant.limits("x"), plant.limits("u")
    worst = np.zeros(plant.n_y)
    for one in plant.modes:
        for other in plant.modes:
            F, G = one.C @ (one.A - other.A), one.C @ (one.B - other.B)
            ends = pos(F) @ x_hi - neg(F) @ x_lo + pos(G) @ u_hi - neg(G) @ u_lo
            worst = np.maximum(worst, ends)
    return np.where(worst > 0, worst, 1.0)
