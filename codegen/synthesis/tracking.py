r"""Tracking with measured scheduling: detection observer, and state feedback with integral action, for E = I.

Plant: x' = sum_i h_i (A_i x + B_i u + Bd_i d), y = C x + Dd d, h taken as known. observer and law, with T1 + T2 C = I:

    x_hat = z + T2 y,   r = y - C x_hat,   z' = sum_j h_j (T1 A_j x_hat + T1 B_j u - K_j r),
    u = -sum_j h_j (Kx_j x_hat + Ki_j s),  s' = ref - Cc x,

where Cc are the rows of C that are to follow the reference. eb = T1 x - z obeys eb' = sum_j h_j (N_j eb + M_j d) with
N_j = T1 A_j + K_j C, M_j = T1 Bd_j - T1 A_j T2 Dd + K_j Dt, Dt = (I - C T2) Dd, r = C eb + Dt d. Bounded real lemma,
Q > 0, Phi_j = Q K_j:

    [ He(A_j' T1' Q + C' Phi_j')  Q M_j   C'W'  ]
    [          *                  -g I    Dt'W' ]  < 0          |W r| <= sqrt(g) |d|
    [          *                    *     -I    ]

Feedback: xc = [x; s], Ac = [A 0; -Cc 0], Bc = [B; 0], X > 0 and Xi_j = [Kx_j Ki_j] X; the inequality of the inverse
storage X^-1, multiplied by X from both sides:

    [ He(Ac_i X - Bc_i Xi_j) + R R'   X H' - Xi_j' J' ]
    [              *                      -g I        ]  < 0    |H xc - J u'| <= sqrt(g) |d|,    u' = -u

for all pairs (i, j), or for i = j where B is the same at all vertices. Both also keep a decay rate and a disc in which
the modes stay, |s| <= fastest, so that the sampling period can follow them.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorems C.1.1 and C.1.2, printed without proof.
Differences from the print:

* C.1.1: T1' and Q stand where the derivation puts them (printed He(A'Q - C'Phi'), T1 R); Phi = Q K has the sign of
  r = y - C x_hat; the disturbance also acts on y, with its exact channel.
* C.1.2: K = Xi X^-1 (printed X^-1 Xi has the wrong sizes); the level is of the tracking error and the effort, not of
  the state, so that effort has a price.
* decay rates and discs. All of it is in continuous time: what the firmware runs is certified at its period, for every
  weights of plant, observer and law, since those of the firmware are taken at its estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, assembled, he, minus, negative, solve
from .descriptor_problem import DescriptorProblem, factors

Array = np.ndarray
#: Options of ``[observer]``: largest references by output, where modes may lie in 1/s, price of the inputs.
OPTIONS = {"track": dict, "decay": (1e-9, 1e9), "fastest": (1e-9, 1e9), "observer_decay": (1e-9, 1e9),
           "observer_fastest": (1e-9, 1e9), "effort": (1e-6, 1e6), "set_rows": (4, 400), "within": (0, 50),
           "mismatch": ("bounded", "any")}


def inapplicable(plant) -> str | None:
    """Why a plant cannot be tracked this way, with what to change; None if it can."""
    reason = descriptor_problem.inapplicable(plant)
    if reason is not None:
        return reason
    p, states = plant.polytope, plant.polytope.symbols[:plant.n_x]
    if np.any(np.eye(plant.n_x) != p.E):
        return "E is not the identity, expected x' itself: what is algebraic cannot be steered. Solve for it."
    if not p.premises:
        return "its weights are normalised, expected a sector model: there their rates are known. Give [nonlinear]."
    if not plant.u:
        return "there is no input, expected one to steer with. Declare it in signals.u."
    for z in p.premises:
        if z.term.free_symbols - set(states) or any(not z.term.diff(s).is_number for s in states):
            return f'premise "{z.name}" is not affine in the states, expected that: so its rate is known. Name others.'
    for s in plant.u:
        if s.rate:
            return f'input "{s.name}" moves between samples (rate), expected a held one. Remove its rate.'
    return None


@dataclass(frozen=True)
class Speed:
    """Where modes may lie, in 1/s: real part at most -decay, magnitude at most fastest.

    Parameters
    ----------
    decay, fastest : float
    """

    decay: float
    fastest: float


@dataclass(frozen=True)
class DetectionGains:
    """An observer in continuous time.

    Parameters
    ----------
    T1 : ndarray (n, n), T2 : ndarray (n, p)
    K : ndarray (h, n, p)
    gamma : float
        What the solver claims.
    """

    T1: Array
    T2: Array
    K: Array
    gamma: float


@dataclass(frozen=True)
class FeedbackGains:
    """u = -sum_j h_j (Kx_j x_hat + Ki_j s).

    Parameters
    ----------
    Kx : ndarray (h, m, n), Ki : ndarray (h, m, k)
    gamma : float
        What the solver claims.
    """

    Kx: Array
    Ki: Array
    gamma: float


def observer(problem: DescriptorProblem, weight: Array, speed: Speed) -> DetectionGains:
    """Design the detection observer for the least level.

    Parameters
    ----------
    problem : DescriptorProblem
        E = I; in units in which states and outputs are about one.
    weight : ndarray (p, p)
        W of the residual.
    speed : Speed

    Returns
    -------
    DetectionGains

    Raises
    ------
    DesignError
        The solver finds none.
    """
    _, n, p, _, q = problem.sizes
    T1, T2, _ = factors(problem, False)
    C, Dt = problem.C, problem.Dd - problem.C @ T2 @ problem.Dd
    Q, level = cp.Variable((n, n), symmetric=True), cp.Variable()
    Phi = [cp.Variable((n, p)) for _ in problem.A]
    conditions = [Q >> np.eye(n)]
    for A, Bd, phi in zip(problem.A, problem.Bd, Phi):
        QN = Q @ T1 @ A + phi @ C
        M = Q @ T1 @ (Bd - A @ T2 @ problem.Dd) + phi @ Dt
        conditions += [negative([[he(QN), M, (weight @ C).T], [minus(level, q), (weight @ Dt).T], [-np.eye(p)]]),
                       *_placed(Q, QN, speed)]
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError(f"tracking: no detection observer with modes between {speed.decay:.4g} and "
                          f"{speed.fastest:.4g} 1/s was found. Ask for a slower decay, or sample faster.")
    return DetectionGains(T1, T2, np.array([np.linalg.solve(Q.value, phi.value) for phi in Phi]), _root(level))


def feedback(problem: DescriptorProblem, Cc: Array, effort: Array, speed: Speed) -> FeedbackGains:
    """Design the feedback with integral action for the least level.

    Parameters
    ----------
    problem : DescriptorProblem
        As for `observer`.
    Cc : ndarray (k, n)
        What follows the reference, in units of its range.
    effort : ndarray (m,)
        Price of the inputs.
    speed : Speed

    Returns
    -------
    FeedbackGains

    Raises
    ------
    DesignError
        The solver finds none: not stabilisable, or a reference for what u cannot hold.
    """
    h, n, _, m, _ = problem.sizes
    k = len(Cc)
    Ac = [np.block([[A, np.zeros((n, k))], [-Cc, np.zeros((k, k))]]) for A in problem.A]
    Bc = [np.vstack([B, np.zeros((k, m))]) for B in problem.B]
    R = [np.vstack([Bd, np.zeros((k, Bd.shape[1]))]) for Bd in problem.Bd]
    H = np.vstack([np.hstack([Cc, np.zeros((k, k))]), np.zeros((m, n + k))])
    J = np.vstack([np.zeros((k, m)), np.diag(effort)])
    X, level = cp.Variable((n + k, n + k), symmetric=True), cp.Variable()
    Xi = [cp.Variable((m, n + k)) for _ in range(h)]
    same = np.all(problem.B[0] == problem.B)
    conditions = [X >> MARGIN * np.eye(n + k)]
    for i in range(h):
        for j in [i] if same else range(h):
            AX = Ac[i] @ X - Bc[i] @ Xi[j]
            conditions += [negative([[he(AX) + R[i] @ R[i].T, X @ H.T - Xi[j].T @ J.T], [minus(level, k + m)]]),
                           *_placed(X, AX, speed)]
    K = None
    if solve(cp.Problem(cp.Minimize(level), conditions)):
        K = [np.linalg.solve(X.value, xi.value.T).T for xi in Xi]
    # Where there are none a solver may yet answer, with numbers that say nothing.
    if K is None or any(np.linalg.eigvals(A - B @ g).real.max() > -0.9 * speed.decay for A, B, g in zip(Ac, Bc, K)):
        raise DesignError(f"tracking: no feedback with modes between {speed.decay:.4g} and {speed.fastest:.4g} 1/s was "
                          "found. Track at most as many outputs as there are inputs, outputs that the inputs can hold "
                          "anywhere in their range; ask for a slower decay, or sample faster.")
    return FeedbackGains(np.array([g[:, :n] for g in K]), np.array([g[:, n:] for g in K]), _root(level))


def _placed(P, PN, speed: Speed) -> list:
    """Decay, and the disc of the modes; PN is P N or N P."""
    disc = assembled([[speed.fastest * P, PN], [speed.fastest * P]])
    return [he(PN) + 2 * speed.decay * P << 0, disc >> 0]


def _root(level) -> float:
    return float(np.sqrt(max(level.value, 0.0)))
