r"""Observer in descriptor form for a descriptor plant with unmeasured weights, exact in the polytope.

Plant: E x' = sum_i h_i(x) (A_i x + B_i u + Bd_i d), y = C x + Dd d, admissible. The observer

    E x_hat' = sum_j h_j(x_hat) [A_j x_hat + B_j u + L_j (y - C x_hat)]

solves its algebraic rows at every instant. With e = x_hat - x

    E e' = sum_ij h_i h_j { (A_j - L_j C) e + (A_j - A_i) x + (B_j - B_i) u + (L_j Dd - Bd_i) d },

one inequality per pair, linear in P = Y E + S X and P' L_j. The kernel-E part of it makes the algebraic rows solvable
for every weight. By default no algebraic row is injected (S' L_j = 0 where E' S = 0): else the noise of y goes straight
into the algebraic estimate.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorem 3.2.1 and Corollary 3.2.1. Differences
from the print:

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
from .descriptor_lmi import MARGIN, Bounds, DescriptorDesign, Storage, he, minus, negative, solve
from .descriptor_problem import DescriptorProblem

Array = np.ndarray


def design(problem: DescriptorProblem, bounds: Bounds, algebraic: bool = False) -> DescriptorDesign:
    """Design for the least level that the bounds allow.

    Parameters
    ----------
    problem : DescriptorProblem
    bounds : Bounds
        Without a period: this observer is no ordinary differential equation. The bound of the gains is one of
        Y^-1 P' L_j.
    algebraic : bool
        Outputs may be injected in the algebraic rows too.

    Returns
    -------
    DescriptorDesign
        K holds the L_j.

    Raises
    ------
    DesignError
        A period is given, or the solver finds none.
    """
    if bounds.period is not None:
        raise DesignError("descriptor-direct: a period is asked for (found one), which is for observers in standard "
                          "form. Use descriptor-uncertain.")
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
    conditions += [negative(_pair(problem, i, j, own.P, plant.P, Xi[j], level)) for i, j in problem.pairs]
    if not solve(cp.Problem(cp.Minimize(level), conditions)):
        raise DesignError("descriptor-direct: no observer was found. Ask for a slower decay or larger gains; see "
                          "residua check on whether the plant is admissible for every weight.")
    P = own.P.value
    return DescriptorDesign(np.array([np.linalg.solve(P.T, xi.value) for xi in Xi]),
                            float(np.sqrt(max(level.value, 0.0))))


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
