r"""Observer in descriptor form for a descriptor plant with unmeasured weights, exact in the polytope.

Plant: E x' = sum_i h_i(x) (A_i x + B_i u + Bd_i d), y = C x + Dd d, admissible. The observer

    E x_hat' = sum_j h_j(x_hat) [A_j x_hat + B_j u + L_j (y - C x_hat)]

solves its algebraic rows at every instant: no output has to see the algebraic states, rank [E; C] may be less than n.
With e = x_hat - x

    E e' = sum_ij h_i h_j { (A_j - L_j C) e + (A_j - A_i) x + (B_j - B_i) u + (L_j Dd - Bd_i) d },

one inequality per pair, linear in P = Y E + S X and P' L_j. The kernel-E part of it makes the algebraic rows solvable
for every weight. By default no algebraic row is injected (S' L_j = 0 where E' S = 0): else the noise of y goes straight
into the algebraic estimate.

A firmware takes Euler steps of it and solves the algebraic rows at every sample (family ``descriptor``). That is done
offline where they are d_j V on the algebraic states, one regular V and d_j > 0 for each vertex (`solved`): one
algebraic equation, or coefficients that no weight moves. Euler steps of length T contract for weights that move where,
with one R, for every vertex

    [ E' Y E - He(R S' A_j)   W_j' ]
    [ W_j                      Pi  ] > 0,     Pi = E1' Y E1,  W_j = Pi T1 (E + T A_j) - T (P' L_j)_1 C:

E1 are the columns of E that are not zero, T1 E1 = I, and S' A_j e is zero but for what drives the error.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem 3.2.1 and Corollary 3.2.1.
Differences from the print:

* A_i - A_j is exactly polytopic; the thesis bounds it in norm, for a level that is eighteen times as large on the
  thesis' example at equal gains.
* disturbance and noise; a decay rate e'E'Y E e and a bound of the gains, without which the infimum of gamma is zero.
* Phi_A in the row of x (printed in that of e), P' for P, L_i = P^-T Xi_i; the weight M of the residual is no variable
  (M = 0 would be best). The printed gains certify no printed level.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from . import descriptor_problem
from .descriptor_lmi import MARGIN, Bounds, DescriptorDesign, Storage, he, minus, negative, solve
from .descriptor_problem import DescriptorProblem, problem_of

Array = np.ndarray
#: Options of ``[observer]``: as of ``descriptor_uncertain``.
OPTIONS = {"decay": (0.0, 1e9), "gain": (1e-6, 1e9), "channel": ("state", "residual"), "set_rows": (4, 400),
           "within": (0, 50)}


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    reason = descriptor_problem.inapplicable(plant, seen=False)
    if reason is not None:
        return reason
    problem = problem_of(plant)
    names = [s.name for s, column in zip(plant.x, problem.E.T) if not np.any(column)]
    if len(names) != problem.S.shape[1]:
        return (f"E has {len(names)} columns of zeros and {problem.S.shape[1]} algebraic equations, expected as many: "
                "states of which no derivative occurs. Change the coordinates of x.")
    if solved(problem) is None:
        return (f"on the algebraic states ({', '.join(names)}) the algebraic equations of the vertices are no positive "
                "multiples of one regular matrix, expected that: the firmware solves them with factors that are made "
                "offline. Scale the equations, or measure the states and use descriptor-uncertain.")
    return None


def solved(problem: DescriptorProblem) -> tuple[Array, Array, Array] | None:
    """The algebraic equations of every vertex, solved for the algebraic states; None where that cannot be done offline.

    Parameters
    ----------
    problem : DescriptorProblem

    Returns
    -------
    pivot : ndarray (h,)
        The largest is 1.
    P : ndarray (h, a, n), Q : ndarray (h, a, m)
        x_a = sum_j g_j (P_j x + Q_j u), g_j = h_j pivot_j / sum.
    """
    algebraic = ~np.any(problem.E, axis=0)
    rows, into = problem.S.T @ problem.A, problem.S.T @ problem.B
    if np.count_nonzero(algebraic) != rows.shape[1]:
        return None
    if not rows.size:
        return np.ones(len(rows)), rows, into
    blocks = rows[:, :, algebraic]
    at = np.unravel_index(np.argmax(np.abs(blocks[0])), blocks[0].shape)
    entries = blocks[(slice(None), *at)]
    V = blocks[np.argmax(np.abs(entries))]
    if V[at] == 0 or np.linalg.matrix_rank(V) < len(V):
        return None
    pivot = entries / V[at]
    if np.any(pivot <= 0) or not np.allclose(blocks, pivot[:, None, None] * V, rtol=1e-14, atol=0):
        return None
    P, Q = (-np.linalg.solve(V, M) / pivot[:, None, None] for M in (rows, into))
    P[:, :, algebraic] = 0.0
    return pivot, P, Q


def design(problem: DescriptorProblem, bounds: Bounds, algebraic: bool = False) -> DescriptorDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
    bounds : Bounds
        The bound of the gains is one of Y^-1 P' L_j.
    algebraic : bool
        Outputs may be injected in the algebraic rows too.

    Returns
    -------
    DescriptorDesign
        K holds the L_j.

    Raises
    ------
    DesignError
        A period is given with outputs in the algebraic rows or another E than `inapplicable` asks for, or the solver
        finds none.
    """
    if bounds.period is not None and (algebraic or np.count_nonzero(~np.any(problem.E, axis=0)) != problem.S.shape[1]):
        raise DesignError("descriptor-direct: a period is asked for (found one), which is for algebraic states that no "
                          "derivative is of and no output is injected to. Use descriptor-uncertain.")
    _, n, p, _, _ = problem.sizes
    level, unit, own, plant = cp.Variable(), cp.Variable(), Storage(problem.E, problem.S), Storage(problem.E, problem.S)
    Xi = [cp.Variable((n, p)) for _ in problem.A]
    conditions = [own.Y >> unit * np.eye(n), plant.Y >> MARGIN * np.eye(n), unit >= MARGIN, level >= bounds.least**2]
    for A, xi in zip(problem.A, Xi):
        conditions += [cp.sigma_max(xi) <= bounds.gain * unit,
                       he(own.P.T @ A - xi @ problem.C)
                       + 2 * bounds.decay * problem.E.T @ own.Y @ problem.E << -MARGIN * np.eye(n)]
        if not algebraic and problem.S.size:
            # For E k = 0 it is k' P' L = (X k)' S' L, and X is regular on such k.
            conditions.append(_kernel(problem.E).T @ xi == 0)
    if bounds.period is not None:
        conditions += _euler(problem, own.Y, Xi, bounds.period)
    conditions += [negative(_pair(problem, i, j, own.P, plant.P, Xi[j], level)) for i, j in problem.pairs]
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError("descriptor-direct: no observer was found. Ask for a slower decay or larger gains; see "
                          "residua check on whether the plant is admissible for every weight.")
    P = own.P.value
    return DescriptorDesign(np.array([np.linalg.solve(P.T, xi.value) for xi in Xi]),
                            float(np.sqrt(max(level.value, 0.0))))


def _euler(problem: DescriptorProblem, Y, Xi: list, period: float) -> list:
    """Euler steps contract."""
    n, at = len(problem.E), np.any(problem.E, axis=0)
    E1, pick = problem.E[:, at], np.eye(n)[at]
    T1, Pi = np.linalg.pinv(E1), E1.T @ Y @ E1
    R = cp.Variable((n, problem.S.shape[1])) if problem.S.size else None
    out = []
    for A, xi in zip(problem.A, Xi):
        W = Pi @ (T1 @ (problem.E + period * A)) - period * (pick @ xi) @ problem.C
        before = pick.T @ Pi @ pick - (he(R @ (problem.S.T @ A)) if problem.S.size else 0)
        M = cp.bmat([[before, W.T], [W, Pi]])
        out.append((M + M.T) / 2 >> MARGIN * np.eye(M.shape[0]))
    return out


def _kernel(E: Array) -> Array:
    return np.linalg.svd(E)[2][np.linalg.matrix_rank(E):].T


def _pair(problem: DescriptorProblem, i: int, j: int, P, P2, Xi, level) -> list[list]:
    """The inequality of one pair: over (e, x, u, d, z)."""
    _, _, _, m, q = problem.sizes
    A, B, Bd = problem.A, problem.B, problem.Bd
    return [[he(P.T @ A[j] - Xi @ problem.C), P.T @ (A[j] - A[i]), P.T @ (B[j] - B[i]),
             Xi @ problem.Dd - P.T @ Bd[i], -problem.H.T],
            [he(A[i].T @ P2), P2.T @ B[i], P2.T @ Bd[i], None],
            [minus(level, m), None, None],
            [minus(level, q), problem.J.T],
            [-np.eye(len(problem.H))]]
