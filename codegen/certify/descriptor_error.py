r"""Exact error of an observer that solves the algebraic equations itself, from the constants that the firmware holds.

The states without a derivative are algebraic, x_a; the others x_m. S' E = 0, and S' A_i is d_i V on x_a with one
regular V and d_i > 0. The plant's algebraic equations sum_i h_i S' (A_i x + B_i u + Bd_i d) = 0, times V inverse:

    sum_i h_i d_i (x_a - P_i x_m - Q_i u - D_i d) = 0,      so      x_a = sum_i g_i (P_i x_m + Q_i u + D_i d)

with weights g_i = h_i d_i / sum h d; the C solves the same with held d_j, P_j, Q_j and its own weights, without D. With
T1 E x = x_m and e = (e_m, e_a), e_m = x_m - z_m, e_a the rest of x - x_hat, plant at i and observer at j,

    e_m+ = T1 ((E + T A_i) x + T B_i u + T Bd_i d) - F_j x_hat - G_j u + K_j r,   r = y - C_j x_hat,   x_hat = x - e,
    d_j (x_a - e_a - P_j (x_m - e_m) - Q_j u) - d_i (x_a - P_i x_m - Q_i u - D_i d) = 0.

T is the period of a continuous plant by Euler steps; of a discrete plant A_i, T B_i, .. are its own A_i, B_i, ..
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, eye, inverse, product, rational, zeros
from .polytope_error import ErrorModel

Array = np.ndarray


@dataclass(frozen=True)
class Solved:
    """The plant with its algebraic equations solved, exactly; u and d in their units.

    Parameters
    ----------
    moving : ndarray (r,) int, algebraic : ndarray (a,) int
    T1 : object array (r, n)
        T1 E x = x_m.
    pivot : tuple of fmpq
        d_i, the largest 1.
    P : list of object array (a, r), Q : list of object array (a, m), D : list of object array (a, q)
    """

    moving: Array
    algebraic: Array
    T1: Array
    pivot: tuple[fmpq, ...]
    P: list[Array]
    Q: list[Array]
    D: list[Array]


def solved(problem) -> Solved:
    """Solve the algebraic equations of every vertex.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant.

    Raises
    ------
    CertificateError
        E has other columns than it should, or the vertices' algebraic equations are no multiples of one another on x_a.
    """
    E, S = rational(problem.E), rational(problem.S)
    algebraic = np.flatnonzero(np.all(problem.E == 0, axis=0))
    moving = np.flatnonzero(np.any(problem.E != 0, axis=0))
    if len(algebraic) != S.shape[1]:
        raise CertificateError(f"certificate: E has {len(algebraic)} columns of zeros and rank {len(E) - S.shape[1]} "
                               "(found), expected one such column for every algebraic equation.")
    tall = E[:, moving]
    T1 = product(inverse(product(tall.T, tall)), tall.T)
    A, B, Bd = ([product(S.T, rational(M) * unit) for M in some] for some, unit in (
        (problem.A, fmpq(1)), (problem.B, rational(problem.u_unit)), (problem.Bd, rational(problem.d_unit))))
    blocks = [M[:, algebraic] for M in A]
    pivot, V = multiples(blocks)
    back = inverse(V) if len(algebraic) else V
    P, own, D = ([product(-back / d, M) for d, M in zip(pivot, some)] for some in ([M[:, moving] for M in A], B, Bd))
    return Solved(moving, algebraic, T1, pivot, P, own, D)


def multiples(blocks: list[Array]) -> tuple[tuple[fmpq, ...], Array]:
    """Factors d and V with d_i V = block i, the largest d 1.

    Parameters
    ----------
    blocks : list of object array (a, a)

    Raises
    ------
    CertificateError
        They are no positive multiples of one regular matrix.
    """
    if not blocks[0].size:
        return (fmpq(1),) * len(blocks), blocks[0]
    at = max(np.ndindex(blocks[0].shape), key=lambda k: abs(blocks[0][k]))
    V = max(blocks, key=lambda M: abs(M[at]))
    factors = tuple(M[at] / V[at] if V[at] != 0 else fmpq(0) for M in blocks)
    if any(d <= 0 or np.any(d * V != M) for d, M in zip(factors, blocks)):
        raise CertificateError("certificate: on the algebraic states the algebraic equations of the vertices are no "
                               "positive multiples of one matrix (found), expected that: their mean is solved by it.")
    return factors, V


@dataclass(frozen=True)
class Step:
    """One vertex of the observer on e and what else enters, for the plant at one vertex; rows x_m.

    Parameters
    ----------
    e : object array (r, n), x : object array (r, n), u : object array (r, m), d : object array (r, q)
    """

    e: Array
    x: Array
    u: Array
    d: Array


def step(problem, t, known: Solved, i: int, j: int, period: float | None) -> Step:
    """Error a sample later, without rounding.

    Parameters
    ----------
    problem : DescriptorProblem
    t : DescriptorTables
    known : Solved
    i, j : int
        Vertices of plant and observer.
    period : float or None
    """
    E, A, B, Bd, C, Dd = (rational(M) for M in (problem.E, problem.A[i], problem.B[i], problem.Bd[i], problem.C,
                                                problem.Dd))
    u, d = rational(problem.u_unit), rational(problem.d_unit)
    if period is not None:
        A, B, Bd = E + Q(period) * A, Q(period) * B, Q(period) * Bd
    F, G, K = (rational(M)[known.moving] for M in (t.F[j], t.G[j], t.K[j]))
    held = rational(t.C)
    return Step(F + product(K, held), product(known.T1, A) - F + product(K, C - held),
                (product(known.T1, B) - G) * u, (product(known.T1, Bd) + product(K, Dd)) * d)


def descriptor_errors(problem, t, period: float | None) -> ErrorModel:
    """The error model of a proof of the energy gain; entries x_a of its e+ are zero.

    Parameters
    ----------
    problem : DescriptorProblem
    t : DescriptorTables
    period : float or None

    Returns
    -------
    ErrorModel
    """
    known, n = solved(problem), len(problem.E)
    m, q = problem.B.shape[2], problem.Bd.shape[2]
    a, at = known.algebraic, known.moving
    Ee, pairs, ties = zeros(n, n), {}, {}
    Ee[at, at] = fmpq(1)
    d, own = rational(t.pivot), [(rational(P)[:, at], rational(G) * rational(problem.u_unit)) for P, G in zip(t.P, t.Q)]
    plant = {k: rational(getattr(problem, k)) for k in ("E", "A", "B", "Bd")}
    plant |= {"B": plant["B"] * rational(problem.u_unit), "Bd": plant["Bd"] * rational(problem.d_unit)}
    if period is not None:
        plant |= {"A": plant["E"] + Q(period) * plant["A"], "B": Q(period) * plant["B"], "Bd": Q(period) * plant["Bd"]}
    pick = eye(n)[a]
    for i, j in problem.pairs:
        s = step(problem, t, known, i, j, period)
        top = zeros(n, 2 * n + m + q)
        top[at] = np.concatenate([s.e, s.x, s.u, s.d], axis=1)
        low = np.concatenate([zeros(n, n), plant["A"][i], plant["B"][i], plant["Bd"][i]], axis=1)
        both = np.concatenate([top, low], axis=0)
        pairs[i, j] = both[:, :2 * n], both[:, 2 * n:]
        P, G = own[j]
        tie = zeros(len(a), 2 * n + m + q)
        tie[:, :n] = -d[j] * pick
        tie[:, at] += d[j] * P
        tie[:, n:2 * n] = (d[j] - known.pivot[i]) * pick
        tie[:, n + at] += known.pivot[i] * known.P[i] - d[j] * P
        tie[:, 2 * n:2 * n + m] = known.pivot[i] * known.Q[i] - d[j] * G
        tie[:, 2 * n + m:] = known.pivot[i] * known.D[i]
        ties[i, j] = tie
    H, J = rational(problem.H), rational(problem.J) * rational(problem.d_unit)
    z = np.concatenate([H, zeros(*H.shape)], axis=1), np.concatenate([zeros(len(H), m), J], axis=1)
    return ErrorModel(Ee, plant["E"], rational(problem.S), pairs, *z, ties=ties)
