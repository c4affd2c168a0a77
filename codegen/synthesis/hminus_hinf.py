r"""Fault detection observer in standard form: sensitive to faults (H-) and not to inputs and disturbance (H-infinity).

Plant: E x' = sum_i h_i(x) (A_i x + B_i u + Bd_i d + Bf_i f), y = C x + Dd d + Df f, admissible, rank [E; C] = n. The
observer is that of ``descriptor_uncertain``, with a weight M of its residual r = y - C x_hat. Asked for are

    |M r| >= |f|   for u = d = 0,        |M r| <= gamma |(u, d)|   for f = 0,        from rest.

gamma is the ratio of both and does not change with the size of M; with V = M'M as a variable one convex step gives it.
For every vertex j of the observer T1 + Z_j S', E' S = 0, may stand for T1 in F_j and G_j: the algebraic equations
S' (A_i x + ..) = 0 hold for the plant's weights as a whole, so that this needs *all* pairs of vertices.

``criterion``:

* "all": every fault of finite energy. What a fault does through T2 at once is lost to r, R Df = (I - C T2) Df: a
  weight can amplify only what is left, and R has p - (n - rank E) rows at most; so many faults at most.
* "slow": faults that are constant but for changes much slower than the error. Then e = x - x_hat itself obeys
  e' = N_j e + (T1 Bf + K_j Df) f, r = C e + Df f, and the bound is on the settled residual.
* "band": faults of sensors without frequencies above the end w of a band. With e' = d one more unknown, Q > 0 and any
  P, |M r|^2 - |f|^2 + d'Q d - w^2 e'Q e - 2 e'P d > 0 along the error is enough (``certify.finite_frequency``). What
  multiplies d - N_j e - B_j f is P1 (a d + e - T2 Df f), for a few numbers a: linear in P1 N_j, and "slow" at w = 0.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem 4.3.3. Differences from the print:

* the print takes d' = f' = 0 for all signals: its level and its beta = .995 over all frequencies do not hold (its
  gains have .458). Here the channel of d is exact, that of f as the criterion says.
* P2' for P2, -I for -gamma^2 I in the last block; V in place of a search over beta; free algebraic weights.
* a decay rate and a bound of the gains.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, Bounds, Storage, assembled, euler, he, minus, negative, solve
from .descriptor_problem import CALIBRATED, DescriptorProblem, factors, visible
from .descriptor_uncertain import INVISIBLE, hints

Array = np.ndarray
#: Options of ``[observer]``: as those of ``descriptor_uncertain``, and the faults that are asked for.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "criterion": ("all", "slow", "band"), "band": (1e-9, 1e9),
           "factors": ("free", "least"),
           "set_rows": (4, 400), "within": (0, 50), "mismatch": ("bounded", "any"), **CALIBRATED}
CRITERIA = ("all", "slow", "band")
#: How far the derivative of the error may count beside the error itself, in periods of the end of the band.
SHARES = (0.03, 0.3, 1.0)


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    reason = descriptor_problem.inapplicable(plant)
    if reason is None and not plant.f:
        return "no fault is declared, expected one to detect. Declare it in signals.f."
    return reason


@dataclass(frozen=True)
class Faults:
    """Where the faults act.

    Parameters
    ----------
    Bf : ndarray (h, n, n_f), Df : ndarray (p, n_f)
    """

    Bf: Array
    Df: Array


@dataclass(frozen=True)
class DetectionDesign:
    """A design in the units of its problem.

    Parameters
    ----------
    T1 : ndarray (h, n, n), T2 : ndarray (n, p)
        T1 of every vertex.
    K : ndarray (h, n, p)
    M : ndarray (p, p)
        Weight of the residual: |M r| >= |f|.
    gamma : float
        What the solver claims.
    """

    T1: Array
    T2: Array
    K: Array
    M: Array
    gamma: float


def design(problem: DescriptorProblem, faults: Faults, bounds: Bounds, criterion: str = "all", free: bool = True,
           weight: Array | None = None, band: float | None = None) -> DetectionDesign:
    """Design for the least ratio that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
        Its z is not read: the residual is what counts.
    faults : Faults
    bounds : Bounds
    criterion : {"all", "slow", "band"}
    free : bool
        The Z_j are variables.
    weight : ndarray (p, p), optional
        V = M'M; without it is a variable.
    band : float, optional
        Its end, rad per unit of the problem's time; of "band".

    Returns
    -------
    DetectionDesign

    Raises
    ------
    DesignError
        rank [E; C] < n, an unknown criterion, Z_j where the vertices are tied, a band for faults that move the state,
        or the solver finds none.
    """
    if criterion == "band":
        if np.any(faults.Bf) or band is None:
            raise DesignError("hminus-hinf: criterion = \"band\" with " + (
                "a fault that moves the state (found), expected faults of sensors. Use criterion = \"slow\"."
                if np.any(faults.Bf) else "no band (found), expected its end in rad/s. State observer.band."))
        found, failure = [], None
        for share in SHARES:
            try:
                found.append(_designed(problem, faults, bounds, criterion, free, weight, (band, share / band)))
            except DesignError as error:
                failure = error
        if not found:
            raise failure
        return min(found, key=lambda d: d.gamma)
    return _designed(problem, faults, bounds, criterion, free, weight, None)


def _designed(problem: DescriptorProblem, faults: Faults, bounds: Bounds, criterion: str, free: bool,
              weight: Array | None, band: tuple[float, float] | None) -> DetectionDesign:
    """One convex step; of a band its end and the number a."""
    if criterion not in CRITERIA:
        raise DesignError(f"hminus-hinf: criterion is {criterion!r}, expected one of {', '.join(CRITERIA)}.")
    if not visible(problem):
        raise DesignError(f"hminus-hinf: {INVISIBLE}")
    h, n, p, _, _ = problem.sizes
    if free and len(problem.pairs) < h * h:
        raise DesignError(f"hminus-hinf: {len(problem.pairs)} of {h * h} pairs of vertices (found), expected all: with "
                          "weights that are known T1 cannot differ between vertices. Use free = False.")
    T1, T2, _ = factors(problem, False)
    level, unit, P1 = cp.Variable(), cp.Variable(), cp.Variable((n, n), symmetric=True)
    V = cp.Variable((p, p), symmetric=True) if weight is None else weight
    Q, plant = [cp.Variable((n, p)) for _ in range(h)], Storage(problem.E, problem.S)
    conditions = [P1 >> unit * np.eye(n), plant.Y >> MARGIN * np.eye(n), unit >= MARGIN, level >= bounds.least**2]
    conditions += [V >> 0] if weight is None else []
    W = [cp.Variable((n, problem.S.shape[1])) for _ in range(h)] if free and problem.S.size else []
    S = problem.S / np.linalg.norm(problem.S, axis=0)
    PT = [P1 @ T1 + (W[j] @ S.T if W else 0) for j in range(h)]
    conditions += [cp.sigma_max(w) <= bounds.gain * unit for w in W]
    for A, q, T in zip(problem.A, Q, PT):
        PN = T @ A + q @ problem.C
        conditions += [cp.sigma_max(q) <= bounds.gain * unit, he(PN) + 2 * bounds.decay * P1 << 0]
        if bounds.period is not None:
            conditions.append(euler(P1, PN, bounds.period))
    moving = [cp.Variable((n, n), symmetric=True) for _ in range(2)] if band else []
    conditions += [moving[1] >> MARGIN * np.eye(n)] if band else []
    for i, j in problem.pairs:
        conditions.append(negative(_level(problem, i, j, (PT[j], T2), Q[j], plant.P, V, level)))
        if band is None:
            M = assembled(sensitivity(problem, faults, i, j, (PT[j], T2), Q[j], plant.P, V, criterion))
        else:
            M = assembled(_in_band(problem, faults, j, (PT[j], T2), Q[j], V, (P1, *moving, *band)))
        if i == j or np.any(faults.Bf):
            conditions.append(M >> MARGIN * np.eye(M.shape[0]))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError("hminus-hinf: no observer was found. " + _hint(problem, faults, bounds, T1, T2, criterion))
    value = V.value if weight is None else weight
    sizes, vectors = np.linalg.eigh((value + value.T) / 2)
    Z = [np.linalg.solve(P1.value, w.value) @ S.T for w in W] or [np.zeros((n, n))] * h
    return DetectionDesign(np.array([T1 + z for z in Z]), T2, np.array([np.linalg.solve(P1.value, q.value) for q in Q]),
                           np.sqrt(np.maximum(sizes, 0.0))[:, None] * vectors.T, float(np.sqrt(max(level.value, 0.0))))


def _level(problem: DescriptorProblem, i: int, j: int, T, Q, P2, V, level) -> list[list]:
    """Make V' + r'V r - g |(u, d)|^2 < 0 over (eb, x, u, d)."""
    (PT, T2), (_, _, _, m, q) = T, problem.sizes
    A, B, Bd, C, Dd = problem.A, problem.B, problem.Bd, problem.C, problem.Dd
    Dt = Dd - C @ T2 @ Dd
    return [[he(PT @ A[j] + Q @ C) + C.T @ V @ C, PT @ (A[i] - A[j]), PT @ (B[i] - B[j]),
             PT @ (Bd[i] - A[j] @ T2 @ Dd) + Q @ Dt + C.T @ V @ Dt],
            [he(A[i].T @ P2), P2.T @ B[i], P2.T @ Bd[i]],
            [minus(level, m), None],
            [minus(level, q) + Dt.T @ V @ Dt if q else minus(level, q)]]


def sensitivity(problem: DescriptorProblem, faults: Faults, i: int, j: int, T, Q, P2, V, criterion: str) -> list[list]:
    """Blocks of r'V r - |f|^2 - V' over (e, x, f), to be positive, without x where no fault moves it.

    Parameters
    ----------
    problem : DescriptorProblem
    faults : Faults
    i, j : int
        Vertices of plant and observer.
    T : tuple
        P1 T1 and T2.
    Q : cvxpy expression (n, p)
        P1 K_j.
    P2 : cvxpy expression (n, n) or None
        Not read where no fault moves the state.
    V : cvxpy expression (p, p)
    criterion : {"all", "slow"}
    """
    (PT, T2), C, Df, A = T, problem.C, faults.Df, problem.A
    own, R = PT @ A[j] + Q @ C, np.eye(len(C)) - C @ T2
    into = PT @ faults.Bf[i] + (Q @ Df if criterion == "slow" else Q @ R @ Df - PT @ A[j] @ T2 @ Df)
    through = Df if criterion == "slow" else R @ Df
    corner = through.T @ V @ through - np.eye(Df.shape[1])
    e = C.T @ V @ C - he(own), C.T @ V @ through - into
    if not np.any(faults.Bf):
        return [[*e], [corner]]
    return [[e[0], -PT @ (A[i] - A[j]), e[1]], [-he(A[i].T @ P2), -P2.T @ faults.Bf[i]], [corner]]


def _in_band(problem: DescriptorProblem, faults: Faults, j: int, T, Q, V, moving) -> list[list]:
    """Make r'V r - |f|^2 + d'R d - w^2 e'R e - 2 e'P d + 2 (a d + e - T2 Df f)'P1 (d - N_j e - B_j f) > 0."""
    (PT, T2), C, Df, A, (P1, P, R, w, a) = T, problem.C, faults.Df, problem.A, moving
    own, free, G = PT @ A[j] + Q @ C, np.eye(len(C)) - C @ T2, T2 @ Df
    into, through = Q @ free @ Df - PT @ A[j] @ G, free @ Df
    return [[R + 2 * a * P1, P1 - P - a * own, -a * into - P1 @ G],
            [C.T @ V @ C - w**2 * R - he(own), C.T @ V @ through - into + own.T @ G],
            [through.T @ V @ through - np.eye(Df.shape[1]) + he(G.T @ into)]]


def _hint(problem: DescriptorProblem, faults: Faults, bounds: Bounds, T1: Array, T2: Array, criterion: str) -> str:
    left = faults.Df - problem.C @ T2 @ faults.Df if criterion == "all" else faults.Df
    if criterion == "all" and np.linalg.matrix_rank(left, 1e-9) < left.shape[1]:
        return ("At high frequency the residual has rank less than the number of faults, so that no weight makes it "
                'sensitive to all of them at every frequency. Use criterion = "slow", or one observer per fault.')
    return hints(problem, bounds, T1)
