"""The projection route to the H-infinity filter: ``synthesis = "projection"``.

The filter is eliminated from the inequality of each edge (projection lemma, Farhat and Koenig (2016), (13) and (24)):
what remains speaks of R = (P^-1)_11 and S = P_11 only. Differences from the print:

* the coupling ``[R I; I S] >= 0`` is added; without it the pairs belong to no P > 0;
* P is rebuilt in the plant's own coordinates, M = R: ``P = [S, R^-1 - S; ., S - R^-1]``. (19c) lost the minus of
  U = -N' R M^-T, and coordinates by singular values differ from mode to mode;
* the lemma, applied edge by edge, gives one filter per *pair* of modes, (A, B) of which could be applied once the next
  mode is known: N^2 tables, and the last measurement kept. One filter per mode is looked for with P from the interior,
  at levels a little above the bound, and what that costs is returned. No tables by pairs are made: the bound holds for
  them too, and on the example measured (farhat, nominal and uncertain, the multipliers varied) it is that of the slack
  variables with one filter per mode to six digits; without uncertainty the best gains
  depend on P of the present mode alone;
* alpha_q of (24) enters together with its inverse: its value is that of the slack-variable design, tau_q = 1/alpha_q.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
from scipy.linalg import block_diag, null_space, sqrtm

from ..errors import DesignError
from .hinf_filter import MARGIN, FilterDesign, solve
from .hinf_problem import FilterMode, FilterProblem, in_coordinates

Array = np.ndarray
#: Levels at which P is taken, relative to the bound.
ABOVE = (1.001, 1.01, 1.05)


@dataclass(frozen=True)
class Projection:
    """What the projection route finds.

    Parameters
    ----------
    bound : float
        gamma of the eliminated inequalities: no filter of this kind is better at these multipliers.
    design : FilterDesign
        One filter per mode.
    pairs : dict
        (mode, next mode) -> gamma of a filter for this pair alone, at the same P.
    """

    bound: float
    design: FilterDesign
    pairs: dict


class Extended:
    """One mode with its uncertainty as a second pair of signals, weighted by tau.

    Parameters
    ----------
    m : FilterMode
    multipliers : list of dict
        "tau" of each block.
    """

    def __init__(self, m: FilterMode, multipliers: list[dict]):
        if any("tau" not in given for given in multipliers):
            raise DesignError('hinf-filter: synthesis "projection" takes uncertainties of rank one and full blocks '
                              '(found a repeated number of higher rank). Use synthesis "slack".')
        tau = [given["tau"] for given in multipliers]
        n = len(m.A)
        H = np.hstack([b.H for b in m.blocks]) if m.blocks else np.zeros((n + len(m.C), 0))
        S = np.vstack([b.S for b in m.blocks]) if m.blocks else np.zeros((0, n + m.E.shape[1]))
        self.m, self.H, self.S = m, H, S
        self.t_p = np.concatenate([np.full(b.H.shape[1], t) for b, t in zip(m.blocks, tau)] + [np.zeros(0)])
        self.t_s = np.concatenate([np.full(len(b.S), t) for b, t in zip(m.blocks, tau)] + [np.zeros(0)])

    def state_side(self, R_now, R_next, level):
        """(13a), (24a), sign reversed."""
        m, n, n_d = self.m, len(self.m.A), self.m.E.shape[1]
        Sx, Sd = self.S[:, :n], self.S[:, n:]
        inputs = np.hstack([m.E, self.H[:n]])
        weights = cp.bmat([[level * np.eye(n_d), np.zeros((n_d, len(self.t_p)))],
                           [np.zeros((len(self.t_p), n_d)), np.diag(self.t_p)]]) if len(self.t_p) else \
            level * np.eye(n_d)
        first = R_next - m.A @ R_now @ m.A.T
        if not len(self.t_s):
            return cp.bmat([[first, inputs], [inputs.T, weights]])
        feed = np.vstack([Sd.T, np.zeros((len(self.t_p), len(Sd)))])
        cross = -m.A @ R_now @ Sx.T
        return cp.bmat([[first, inputs, cross], [inputs.T, weights, feed],
                        [cross.T, feed.T, np.diag(1 / self.t_s) - Sx @ R_now @ Sx.T]])

    def output_side(self, S_now, S_next, level):
        """(13b), (24b), sign reversed, on the kernel of what is measured."""
        m, n, n_d = self.m, len(self.m.A), self.m.E.shape[1]
        n_p = len(self.t_p)
        W = null_space(np.hstack([m.C, m.F, self.H[n:]]))
        move = np.hstack([m.A, m.E, self.H[:n]]) @ W
        out = np.hstack([m.Cz, m.Fz, np.zeros((len(m.Cz), n_p))]) @ W
        s = np.sqrt(self.t_s)[:, None] * np.hstack([self.S, np.zeros((len(self.S), n_p))]) @ W
        Wx, Wd, Wp = W[:n], W[n:n + n_d], W[n + n_d:]
        return (Wx.T @ S_now @ Wx + level * (Wd.T @ Wd) + Wp.T @ np.diag(self.t_p) @ Wp - move.T @ S_next @ move
                - out.T @ out - s.T @ s)

    def closed(self, K: dict, P_now: Array, P_next: Array, level):
        """The whole inequality with P given, linear in the filter; positive definite when it holds."""
        m, n, n_d = self.m, len(self.m.A), self.m.E.shape[1]
        n_s, n_p, n_f = len(P_now) - n, len(self.t_p), len(m.Cz)
        y = np.hstack([m.C, np.zeros((len(m.C), n_s)), m.F, self.H[n:]])
        state = np.hstack([np.zeros((n_s, n)), np.eye(n_s), np.zeros((n_s, n_d + n_p))])
        above = np.hstack([m.A, np.zeros((n, n_s)), m.E, self.H[:n]])
        target = np.hstack([m.Cz, np.zeros((n_f, n_s)), m.Fz, np.zeros((n_f, n_p))])
        move = cp.vstack([above, K["A"] @ state + K["B"] @ y])
        out = K["C"] @ state + K["D"] @ y + target
        s = np.hstack([self.S[:, :n], np.zeros((len(self.S), n_s)), self.S[:, n:], np.zeros((len(self.S), n_p))])
        fixed = block_diag(P_now, np.zeros((n_d, n_d)), np.diag(self.t_p)) - s.T @ (self.t_s[:, None] * s)
        select = block_diag(np.zeros((n + n_s, n + n_s)), np.eye(n_d), np.zeros((n_p, n_p)))
        k = n + n_s
        # Rows times the root of P_next, columns of [x; s] over that of P_now: everything is then near the identity.
        root = np.linalg.cholesky(P_next).T
        scale = block_diag(np.linalg.inv(np.linalg.cholesky(P_now).T), np.eye(n_d + n_p))
        move, out = root @ move @ scale, out @ scale
        return cp.bmat([[np.eye(k), np.zeros((k, n_f)), move], [np.zeros((n_f, k)), np.eye(n_f), out],
                        [move.T, out.T, scale.T @ fixed @ scale + level * select]])


def eliminated(problem: FilterProblem, extended: list[Extended], level=None):
    """Minimise the level, or with a level given go to the interior; returns (level, R, S) per node.

    Raises
    ------
    DesignError
        The solver finds none.
    """
    n = problem.sizes[0]
    nodes = problem.switching.mode
    R, S = ([cp.Variable((n, n), symmetric=True) for _ in nodes] for _ in range(2))
    g = cp.Variable(nonneg=True) if level is None else level
    room = MARGIN if level is None else cp.Variable()
    constraints = []
    for a, b in problem.switching.edges:
        x = extended[nodes[a]]
        for M in (x.state_side(R[a], R[b], g), x.output_side(S[a], S[b], g)):
            constraints.append((M + M.T) / 2 >> room * np.eye(M.shape[0]))
    for r, s in zip(R, S):
        constraints += [cp.bmat([[r, np.eye(n)], [np.eye(n), s]]) >> room * np.eye(2 * n)]
        if level is not None:
            constraints += [r << 100 * np.eye(n), s << 100 * np.eye(n)]  # R may grow without bound
    if not solve(cp.Problem(cp.Minimize(g) if level is None else cp.Maximize(room), constraints)):
        raise DesignError("hinf-filter: the projected inequalities have no solution: the plant must be stable under "
                          "this switching and uncertainty. State a dwell time or narrower bounds.")
    return float(g.value) if level is None else level, [r.value for r in R], [s.value for s in S]


def rebuilt(R: Array, S: Array) -> Array:
    """P with (P^-1)_11 = R and P_11 = S, the filter's states being estimates of the plant's.

    Parameters
    ----------
    R, S : ndarray (n, n)

    Returns
    -------
    ndarray (2n, 2n)
    """
    corner = S - np.linalg.inv(R)
    P = np.block([[S, -corner], [-corner.T, corner]])
    return (P + P.T) / 2


def filter_at(problem: FilterProblem, extended: list[Extended], P: list[Array], edges) -> tuple | None:
    """One filter for all the given edges of one mode, at given P: (gamma^2, A, B, C, D) or None."""
    n, _, n_y, n_f = problem.sizes
    nodes, level = problem.switching.mode, cp.Variable(nonneg=True)
    K = {"A": cp.Variable((n, n)), "B": cp.Variable((n, n_y)), "C": cp.Variable((n_f, n)), "D": cp.Variable((n_f, n_y))}
    constraints = []
    for a, b in edges:
        M = extended[nodes[a]].closed(K, P[a], P[b], level)
        constraints.append((M + M.T) / 2 >> 0)
    if not solve(cp.Problem(cp.Minimize(level), constraints)):
        return None
    return float(level.value), *(K[name].value for name in "ABCD")


def even_states(P: list[Array], n: int) -> Array:
    """Coordinates T x in which S and R, of opposite size before, are equally far from the identity.

    The root of their geometric mean: T' T = R^-1 # S.
    """
    P = np.mean([np.asarray(p) for p in P], axis=0)
    low = np.linalg.inv(np.linalg.inv(P)[:n, :n]) + 1e-8 * P[:n, :n]
    half = np.real(sqrtm(low))
    inverse = np.linalg.inv(half)
    mean = half @ np.real(sqrtm(inverse @ P[:n, :n] @ inverse)) @ half
    return np.linalg.cholesky((mean + mean.T) / 2).T


def design(problem: FilterProblem, start: FilterDesign) -> Projection:
    """Design by projection, with one filter per mode.

    Parameters
    ----------
    problem : FilterProblem
        With its weights.
    start : FilterDesign
        Of ``hinf_filter.design``: its multipliers are taken over, and its P for the scaling of the states.

    Returns
    -------
    Projection

    Raises
    ------
    DesignError
        No solution, or an uncertainty that this route does not take.
    """
    n, multipliers = problem.sizes[0], start.proof["multipliers"]
    T = even_states(start.proof["P"], n)
    problem = in_coordinates(problem, T)
    extended = [Extended(m, given) for m, given in zip(problem.modes, multipliers)]
    least, _, _ = eliminated(problem, extended)
    best = None
    nodes = problem.switching.mode
    groups = [[e for e in problem.switching.edges if nodes[e[0]] == q] for q in range(len(problem.modes))]
    for above in ABOVE:
        _, R, S = eliminated(problem, extended, least * above)
        P = [rebuilt(r, s) for r, s in zip(R, S)]
        if min(np.linalg.eigvalsh(p)[0] for p in P) <= 0:
            continue
        found = [filter_at(problem, extended, P, group) for group in groups]
        if any(f is None for f in found):
            continue
        gamma = float(np.sqrt(max(f[0] for f in found)))
        if best is None or gamma < best[0]:
            best = gamma, [f[1:] for f in found], P
    if best is None:
        raise DesignError("hinf-filter: the projected inequalities hold, but no single filter per mode was found at "
                          'their Lyapunov matrices. Use synthesis "slack".')
    gamma, gains, P = best
    both = block_diag(T, np.eye(n))
    proof = {"P": [both.T @ p @ both for p in P], "multipliers": multipliers}
    return Projection(float(np.sqrt(least)), FilterDesign(tuple(gains), gamma, proof),
                      pair_levels(problem, extended, P))


def pair_levels(problem: FilterProblem, extended: list[Extended], P: list[Array]) -> dict:
    """Level of a filter for each pair of modes alone, at given P; inf where the solver finds none."""
    nodes, pairs = problem.switching.mode, {}
    for edge in problem.switching.edges:
        alone = filter_at(problem, extended, P, [edge])
        pair = nodes[edge[0]], nodes[edge[1]]
        pairs[pair] = max(pairs.get(pair, 0.0), np.inf if alone is None else float(np.sqrt(alone[0])))
    return pairs
