r"""Method "hinf-filter": a switched filter that estimates faults with a certified energy gain.

Plant ``x+ = A_q x + E_q d``, ``y = C_q x + F_q d``, d = [disturbances; faults], with norm-bounded uncertainty
(``hinf_problem``); the mode q is known. The observer is a filter with one set of gains per mode,

    ``s+ = A_q s + B_q y``, ``f_hat = C_q s + D_q y``,

and the design minimises gamma in ``sum |f_hat - W f|^2 <= gamma^2 sum |d|^2`` over all admitted switching. One convex
step, in the gains, the Lyapunov matrices and the multipliers of the uncertainty at once, by slack variables
G' = [X Y; Z Y] per mode: ``G' A_closed`` is linear in ``Y A_q`` and ``Y B_q``. One inequality per edge of the switching
graph (``algebra.automaton``), so a dwell time needs nothing else.

Source: A. Farhat, D. Koenig, switched uncertain H-infinity fault detection filter (slides), 2016. Differences from the
print:

* the conditions there are projections, without the coupling inequality and with a sign lost in (19c); they are
  ``synthesis = "projection"`` (``hinf_projection``). They promise gains per pair of modes, not one K_q per mode.
* alpha_q there enters with its inverse and has to be searched; here its inverse is a variable.
* uncertainty also in E, C and F, and repeated real numbers with their skew multiplier.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..errors import DesignError
from .hinf_problem import FilterMode, FilterProblem

Array = np.ndarray
Gains = tuple[Array, Array, Array, Array]
#: Every inequality holds with this much to spare, else Y comes out nearly singular.
MARGIN = 1e-9
REMEDY = "State a dwell time or narrower bounds, or stabilise the plant."


@dataclass(frozen=True)
class FilterDesign:
    """A designed filter.

    Parameters
    ----------
    gains : tuple of (A, B, C, D), one per mode
        ndarrays (n_s, n_s), (n_s, n_y), (n_f, n_s), (n_f, n_y).
    gamma : float
        What the solver claims. Nothing is proved before ``certify.switched_gain``.
    proof : dict
        "P" per node and "multipliers" per mode and block: a starting point for the certificate.
    """

    gains: tuple[Gains, ...]
    gamma: float
    proof: dict


class Multipliers:
    """Variables of the uncertainties of one mode: T > 0 and skew for a repeated number, tau for a full block.

    Parameters
    ----------
    m : FilterMode
    before : int
        Filter states that stand between x and d in [x; s; d].
    """

    def __init__(self, m: FilterMode, before: int):
        self.blocks, self.constraints = m.blocks, []
        n = len(m.A)
        self.S = [np.hstack([b.S[:, :n], np.zeros((len(b.S), before)), b.S[:, n:]]) for b in m.blocks]
        self.H = np.hstack([b.H for b in m.blocks]) if m.blocks else None
        self.T, self.skew = [], []
        for b in m.blocks:
            k = b.H.shape[1]
            square = b.repeated and k > 1
            self.T.append(cp.Variable((k, k), symmetric=True) if square else cp.Variable(nonneg=True))
            free = cp.Variable((k, k)) if square else None
            self.skew.append(None if free is None else free - free.T)
            if square:
                self.constraints.append(self.T[-1] >> MARGIN * np.eye(k))

    def of(self, i: int, size: int):
        """T of a block, as a matrix."""
        return self.T[i] if self.skew[i] is not None else self.T[i] * np.eye(size)

    def terms(self):
        """The parts in the square of [x; s; d], in its product with p, and in the square of p."""
        square = sum(S.T @ self.of(i, len(S)) @ S for i, S in enumerate(self.S))
        sizes = [b.H.shape[1] for b in self.blocks]
        cross = [S.T @ g if g is not None else np.zeros((S.shape[1], k)) for S, g, k in zip(self.S, self.skew, sizes)]
        inner = [[self.of(i, a) if i == j else np.zeros((a, b)) for j, b in enumerate(sizes)]
                 for i, a in enumerate(sizes)]
        return square, cp.hstack(cross), cp.bmat(inner)

    def values(self) -> list[dict]:
        """Numbers for the certificate: "T" and "skew", or "tau"."""
        out = []
        for T, g in zip(self.T, self.skew):
            out.append({"tau": float(T.value)} if g is None else {"T": T.value.tolist(), "skew": g.value.tolist()})
        return out


def solve(problem: cp.Problem) -> bool:
    """Run the solver; whether it brought something, believed or not."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "may be inaccurate" is for the certificate to decide
            problem.solve(solver=cp.CLARABEL)
    except (cp.error.SolverError, ArithmeticError):
        return False
    return problem.status in ("optimal", "optimal_inaccurate") and problem.value is not None


def design(problem: FilterProblem, common: bool = False) -> FilterDesign:
    """Design by the slack-variable inequality.

    Parameters
    ----------
    problem : FilterProblem
        With its weights.
    common : bool
        One Lyapunov matrix for all nodes.

    Returns
    -------
    FilterDesign

    Raises
    ------
    DesignError
        The solver finds none: the plant is not robustly stable under this switching.
    """
    n, n_d, n_y, n_f = problem.sizes
    nodes, level = problem.switching.mode, cp.Variable(nonneg=True)
    P = [cp.Variable((2 * n, 2 * n), symmetric=True) for _ in (nodes[:1] if common else nodes)]
    P = P * len(nodes) if common else P
    shapes = {"X": (n, n), "Y": (n, n), "Z": (n, n), "A": (n, n), "B": (n, n_y), "C": (n_f, n), "D": (n_f, n_y)}
    free = [{name: cp.Variable(shape) for name, shape in shapes.items()} for _ in problem.modes]
    bounds = [Multipliers(m, n) for m in problem.modes]
    constraints = [c for b in bounds for c in b.constraints]
    for a, b in problem.switching.edges:
        q = nodes[a]
        S = slack_block(problem.modes[q], free[q], bounds[q], P[a], P[b], level)
        constraints.append((S + S.T) / 2 >> MARGIN * np.eye(S.shape[0]))
    lmi = cp.Problem(cp.Minimize(level), constraints)
    if not solve(lmi):
        raise DesignError("hinf-filter: no filter exists for this switching and uncertainty (the solver says "
                          f"{lmi.status}): the plant must be stable under both. {REMEDY}")
    gains = []
    for f in free:
        Y = f["Y"].value
        if np.linalg.cond(Y) > 1e12:
            raise DesignError(f"hinf-filter: the slack matrix is singular to {np.linalg.cond(Y):.1e}. Scale states and "
                              "signals to about 1.")
        gains.append((np.linalg.solve(Y, f["A"].value), np.linalg.solve(Y, f["B"].value), f["C"].value, f["D"].value))
    proof = {"P": [p.value for p in P], "multipliers": [b.values() for b in bounds]}
    return FilterDesign(tuple(gains), float(np.sqrt(max(level.value, 0.0))), proof)


def slack_block(m: FilterMode, f: dict, bounds: Multipliers, P_now, P_next, level):
    """The inequality of one edge, sign reversed: it must be positive definite."""
    n, n_d = len(m.A), m.E.shape[1]
    n_f, k = len(m.Cz), 2 * n
    X, Y, Z, Ab, Bb, Ck, Dk = (f[name] for name in ("X", "Y", "Z", "A", "B", "C", "D"))
    G = cp.bmat([[X, Y], [Z, Y]])
    move = -cp.bmat([[X @ m.A + Bb @ m.C, Ab, X @ m.E + Bb @ m.F], [Z @ m.A + Bb @ m.C, Ab, Z @ m.E + Bb @ m.F]])
    out = -cp.hstack([Dk @ m.C + m.Cz, Ck, Dk @ m.F + m.Fz])
    now = cp.bmat([[P_now, np.zeros((k, n_d))], [np.zeros((n_d, k)), level * np.eye(n_d)]])
    if not m.blocks:
        return cp.bmat([[G + G.T - P_next, move, np.zeros((k, n_f))],
                        [move.T, now, out.T],
                        [np.zeros((n_f, k)), out, np.eye(n_f)]])
    square, cross, inner = bounds.terms()
    Hx, Hy = bounds.H[:n], bounds.H[n:]
    GH, DH = -cp.vstack([X @ Hx + Bb @ Hy, Z @ Hx + Bb @ Hy]), -Dk @ Hy
    return cp.bmat([[G + G.T - P_next, move, np.zeros((k, n_f)), GH],
                    [move.T, now - square, out.T, -cross],
                    [np.zeros((n_f, k)), out, np.eye(n_f), DH],
                    [GH.T, -cross.T, DH.T, inner]])
