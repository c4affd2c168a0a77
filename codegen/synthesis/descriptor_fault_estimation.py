r"""Faults of sensors as part of the state: an observer of (x, f) in standard form, designed for its own period.

Plant and unknowns: ``fault_problem``. The observer of what is kept, with A for I + period A where the plant is
continuous and stepped by Euler's rule,

    x_hat = z + T2 y,   r = y - C x_hat,   z+ = sum_j h_j (T1 A_j x_hat + T1 B_j u - K_j r) + T1 g,    T1 E + T2 C = I,

has the error eb = T1 E x - z with eb+ = sum_j h_j (T1 A_j + K_j C) eb + .. d: f is in none of it, however it moves. So
the estimate of f is not biased, and f needs no model.

T1 of least norm throws the algebraic equations away, and with them what tells a state from the fault of its sensor.
All factors are [T1 T2] + Z N, N the left kernel of [E 0; C Dd]; P Z = W is a variable. No column of T1 belongs to the
rows f = f.

Where weights and g are functions of what is known exactly, plant and observer have the same: no plant in the
inequalities, it need not be stable. Elsewhere T1 (A_i - A_j) x drives the error, one inequality per pair with the
plant's own storage, as in ``descriptor_discrete``.

A direction whose mode no observer moves (``fault_problem.unmoved``) and that is slower than the decay asked for keeps
its own; the decay is then asked of the quotient by it, V2' (N' P N - c^2 P) V2 <= 0 with V2' P v = 0. Where the weights
are not the plant's, too, what they are wrong by is held along it by nothing but its own slow decay: a level would be as
large as that is slow, beyond what a solver tells from infeasible. There the level is one for weights that are known,
vertices with the same A on what is kept share their gain, and what comes out is for offline use.

The level is from d and from errors of the model, a hundredth of a step in every row, to the faults in units of their
ranges; with it gains stay as small as the decay allows.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem 3.7.1. Differences from the print: as
printed it is infeasible (in the example the mode of cod against its sensor is 0, and the printed P1 is singular); T1 is
free on the algebraic rows, weights and known terms may be those of exact outputs, decay is asked of what can be moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..algebra.pencil import rank
from ..errors import DesignError
from . import fault_problem
from .descriptor_gains import StandardGains, rounded
from .descriptor_lmi import MARGIN, Bounds, assembled, he, minus, solve
from .descriptor_problem import CALIBRATED, TOLERANCE, Scaling
from .fault_problem import FaultProblem, told, unmoved

Array = np.ndarray
#: Options of bounds where the weights are at the estimate: rows of the set, how far apart the weights may be,
#: thresholds from simulated runs.
AT_ESTIMATE = {"set_rows": (4, 400), "mismatch": ("bounded", "any"), **CALIBRATED}
#: Options of ``[observer]``: decay rate (1/s; per sample of a discrete plant), bound of the gains in the units of
#: the design, delay of sure alarms.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "within": (0, 50), **AT_ESTIMATE}
#: Entries below that, in the units of the design, are what a solver leaves of zeros.
NOTHING = 1e-9
#: Error of the model that the level counts beside d, as a share of a step.
SHARE = 0.01


@dataclass(frozen=True)
class FaultDesign:
    """A design in the units of its problem, rows and columns those of (x, f) and of all outputs.

    Parameters
    ----------
    T1 : ndarray (n, n), T2 : ndarray (n, p), K : ndarray (h, n, p)
    gamma : float
        What the solver claims; where there is something `slow` with weights that are known, whether they are or not.
    slow : list of (str, float)
        What moves together by a mode that is slower than the decay asked for, and that mode.
    """

    T1: Array
    T2: Array
    K: Array
    gamma: float
    slow: list[tuple[str, float]]


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return fault_problem.inapplicable(plant)


def design(problem: FaultProblem, bounds: Bounds) -> FaultDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : FaultProblem
    bounds : Bounds
        Gain of the recursion; decay in the plant's time, per sample where the plant is discrete; period of the Euler
        steps of a continuous plant.

    Returns
    -------
    FaultDesign

    Raises
    ------
    DesignError
        The solver finds none.
    """
    T1, T2, N = factors(problem)
    k, p, step = len(problem.kept), len(problem.outputs), bounds.period
    A, B, Bd = moves(problem, step)
    slow = [(v, s) for v, s in unmoved(problem) if slower(s, bounds)]
    first, pairs = list(range(len(A))), problem.whole.pairs  # the first vertex that shares the gain, of each
    known = problem.tied or bool(slow)
    if known and not problem.tied:
        first = [next(i for i in range(j + 1) if np.array_equal(A[i][:, problem.kept], A[j][:, problem.kept]))
                 for j in first]
        pairs = tuple((i, i) for i in sorted(set(first)))
    P, unit, level = cp.Variable((k, k), symmetric=True), cp.Variable(), cp.Variable()
    W = cp.Variable((k, len(N))) if len(N) else None
    PT = P @ T1 + (W @ N[:, :problem.n_x] if len(N) else 0)
    PT2 = P @ T2 + (W @ N[:, problem.n_x:] if len(N) else 0)
    Q = {j: cp.Variable((k, p)) for j in sorted(set(first))}
    conditions = [P >> unit * np.eye(k), unit >= MARGIN, level >= bounds.least**2]
    if len(N):
        conditions.append(cp.sigma_max(W) <= bounds.gain * unit)
    V = np.array([v for v, _ in slow]).T if slow else np.zeros((k, 0))
    V2 = np.linalg.svd(V.T)[2][V.shape[1]:].T if slow else np.eye(k)
    if slow:
        conditions.append(V2.T @ P @ V == 0)
    contraction = np.exp(-bounds.decay * (1.0 if step is None else step))
    for j, q in Q.items():
        PN = PT @ A[j][:, problem.kept] + q @ problem.C
        M = assembled([[contraction**2 * V2.T @ P @ V2, (V2.T @ PN @ V2).T], [V2.T @ P @ V2]])
        conditions += [cp.sigma_max(q) <= bounds.gain * unit, M >> 0]
    plant = None if known else Plant(problem, (A, B, Bd))
    for i, j in pairs:
        M = assembled(_pair(problem, (i, j), (A, B, Bd), (P, PT, T2, Q[j]), plant, level, step))
        conditions.append(M >> MARGIN * np.eye(M.shape[0]))
    if plant is not None:
        conditions.append(plant.P >> MARGIN * np.eye(problem.n_x))
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError(f"descriptor-fault-estimation: no observer was found. {hints(problem, bounds)}")
    back = np.linalg.inv(P.value)
    T1, T2 = back @ PT.value, back @ PT2.value
    return assembled_whole(problem, T1, T2, [back @ Q[j].value for j in first], float(np.sqrt(max(level.value, 0.0))),
                           [(told(problem, v), s) for v, s in slow])


def factors(problem: FaultProblem) -> tuple[Array, Array, Array]:
    """T1, T2 of least norm with T1 E + T2 C = I, T2 Dd = 0 where that is possible, and what may be added.

    Parameters
    ----------
    problem : FaultProblem

    Returns
    -------
    T1 : ndarray (k, n_x), T2 : ndarray (k, p)
    N : ndarray (l, n_x + p)
        Any Z N may be added to [T1 T2]; it does not change T2 Dd.
    """
    rows, k = problem.E.shape
    tall = np.vstack([problem.E, problem.C])
    noisy = np.hstack([tall, np.vstack([np.zeros((rows, problem.Dd.shape[1])), problem.Dd])])
    T = np.linalg.pinv(noisy if rank(noisy) == k + rank(problem.Dd) else tall, rcond=TOLERANCE)[:k]
    return T[:, :rows], T[:, rows:], np.linalg.svd(noisy.T)[2][rank(noisy):]


def moves(problem: FaultProblem, step: float | None) -> tuple[list[Array], list[Array], list[Array]]:
    """What a sample adds up: A, B and Bd of E x+ (n_x rows, all columns), by an Euler step where one is given.

    Parameters
    ----------
    problem : FaultProblem
    step : float or None
    """
    p, rows = problem.whole, problem.n_x
    if step is None:
        return tuple([M[:rows] for M in stack] for stack in (p.A, p.B, p.Bd))
    return [p.E[:rows] + step * M[:rows] for M in p.A], *([step * M[:rows] for M in stack] for stack in (p.B, p.Bd))


def slower(mode: float, bounds: Bounds) -> bool:
    """Whether a mode decays more slowly than asked.

    Parameters
    ----------
    mode : float
        Of E x' = A x, or of E x+ = A x where the bounds have no period.
    bounds : Bounds
    """
    if bounds.period is None:
        return abs(mode) > np.exp(-bounds.decay)
    return abs(1 + bounds.period * mode) > np.exp(-bounds.decay * bounds.period)


class Plant:
    """The plant's own storage, for weights that plant and observer do not share.

    Parameters
    ----------
    problem : FaultProblem
    parts : tuple
        From `moves`.
    """

    def __init__(self, problem: FaultProblem, parts):
        n, (_, B, Bd) = problem.n_x, parts
        self.S = problem.whole.S[:n][:, np.any(problem.whole.S[:n] != 0, axis=0)]
        self.P = cp.Variable((n, n), symmetric=True)
        free = len(problem.kept) + n + B[0].shape[1] + Bd[0].shape[1] + n
        self.R = cp.Variable((free, self.S.shape[1])) if self.S.size else None


def _pair(problem: FaultProblem, pair, parts, own, plant: Plant | None, level, step) -> list[list]:
    """The inequality of one pair: over (eb, [x, u,] d, error of the model) and, by Schur, (eb+, [x+,] z)."""
    (i, j), (A, B, Bd), (P, PT, T2, Q) = pair, parts, own
    n, Dd = problem.n_x, problem.Dd
    H = problem.whole.H[:, problem.kept]
    wrong = SHARE * (1.0 if step is None else step) * np.eye(n)
    N = PT @ A[j][:, problem.kept] + Q @ problem.C
    channel = PT @ (Bd[i] - A[j][:, problem.kept] @ T2 @ Dd) + Q @ (Dd - problem.C @ T2 @ Dd)
    out = problem.whole.J - H @ T2 @ Dd
    m, q = B[0].shape[1], Bd[0].shape[1]
    if plant is None:
        return [[P, None, None, N.T, H.T], [-minus(level, q), None, channel.T, out.T],
                [-minus(level, n), wrong @ PT.T, None], [P, None], [np.eye(len(H))]]
    E = problem.whole.E[:n, :n]
    flow = np.hstack([np.zeros((n, len(problem.kept))), A[i][:, :n], B[i], Bd[i], wrong])
    now = assembled([[P, None, None, None, None], [E.T @ plant.P @ E, None, None, None], [-minus(level, m), None, None],
                     [-minus(level, q), None], [-minus(level, n)]])
    if plant.R is not None:
        now = now - he(plant.R @ (plant.S.T @ flow))
    move = [N, PT @ (A[i] - A[j])[:, :n], PT @ (B[i] - B[j]), channel, PT @ wrong]
    z = np.hstack([H, np.zeros((len(H), n + m)), out, np.zeros((len(H), n))])
    return [[now, cp.hstack([b for b in move if b.shape[1]]).T, flow.T @ plant.P, z.T], [P, None, None],
            [plant.P, None], [np.eye(len(H))]]


def assembled_whole(problem: FaultProblem, T1: Array, T2: Array, K: list[Array], gamma: float, slow) -> FaultDesign:
    """The observer of all states and outputs: a state that is an output is read there.

    Parameters
    ----------
    problem : FaultProblem
    T1 : ndarray (k, n_x), T2 : ndarray (k, p'), K : list of ndarray (k, p')
        Of what is kept.
    gamma : float
    slow : list
    """
    whole, (kept, outputs) = problem.whole, (list(problem.kept), list(problem.outputs))
    _, n, p, _, _ = whole.sizes
    all1, all2, gains = np.zeros((n, n)), np.zeros((n, p)), np.zeros((len(K), n, p))
    all1[np.ix_(kept, range(problem.n_x))] = T1
    all2[np.ix_(kept, outputs)] = T2
    gains[np.ix_(range(len(K)), kept, outputs)] = K
    for state, output in problem.exact:
        scale = whole.C[output, state]
        all2[state, output] = 1 / scale
        all2[kept, output] = -(T1 @ whole.E[:problem.n_x, state] + T2 @ whole.C[outputs, state]) / scale
    return FaultDesign(*(np.where(np.abs(M) < NOTHING, 0.0, M) for M in (all1, all2, gains)), gamma, slow)


def gains_of(problem: FaultProblem, found: FaultDesign, s: Scaling, period: float | None, real: str) -> StandardGains:
    """Constants of the recursion as the firmware holds them, in the plant's units.

    Parameters
    ----------
    problem : FaultProblem
        In the plant's units.
    found : FaultDesign
        In those of the scaling.
    s : Scaling
    period : float or None
    real : {"float32", "float64"}

    Returns
    -------
    gains : StandardGains
        G acts on u and the known terms.
    """
    whole = problem.whole
    T1, T2 = s.factor1(found.T1), s.factor2(found.T2)
    K = s.columns[:, None] * found.K / s.outputs
    A, B = (whole.A, whole.B) if period is None else (whole.E + period * whole.A, period * whole.B)
    return StandardGains(*(rounded(M, real) for M in (T2, T1 @ A, T1 @ B, K, whole.C)))


def hints(problem: FaultProblem, bounds: Bounds) -> str:
    """What may stand in the way.

    Parameters
    ----------
    problem : FaultProblem
    bounds : Bounds
    """
    held = [(told(problem, v), s) for v, s in unmoved(problem)]
    words = "".join(f"No observer moves the mode {s:.4g} of {name} (in the scaled time of the design). "
                    for name, s in held)
    reads = "" if problem.tied else ("The weights read what is not measured exactly, so that the plant must be "
                                     "admissible for every weight; schedule on exact outputs where you can. ")
    return f"{words}{reads}Ask for a slower decay or larger gains."
