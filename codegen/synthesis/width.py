"""Width design of an interval observer: a linear program with a copositive function.

The errors are nonnegative, so the linear function V = p' e replaces the quadratic one and everything is
an LP, the injection of noise through the gains included (which the L-infinity LMI does not see)::

    M~ = diag(p) A - X C A - W C >= 0,   1' M~ <= (1 - a) p',                      W = diag(p) L, X = diag(p) N
    1'|diag(p) Bw - X C Bw| wbar + 1'|W Dv| vbar + 1'|X Dv| vbar <= t,             p >= |C|' 1,   minimise t

With half widths wbar, vbar the width obeys ``p' (x_hi - x_lo) <= 2 t / a`` ultimately, for any switching.
With measured parameters the gains are affine in theta, and the conditions are asked for at the corners of its box;
with unknowns the width also grows by |T A_unc| |x| and |T| A_rad |x|, taken over the declared range of x. With
``split`` the magnitudes of M take the place of M >= 0. ``a`` multiplies p and is searched. Source: own, after the
copositive designs of positive switched systems.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import cvxpy as cp
import numpy as np

from .problem import Candidate, Problem, slopes, smaller, tidy

Array = np.ndarray
#: Contraction rates tried.
RATES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97)


class WidthProblem:
    """The LP with the contraction rate as a parameter.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem):
        modes, n, m = problem.sizes
        self.problem = problem
        self.keep = cp.Parameter(nonneg=True)  # 1 - a
        self.p, self.t = cp.Variable(n), cp.Variable()
        self.W = [cp.Variable((n, m)) for _ in range(modes)]
        self.slopes = [[cp.Variable((n, m)) for _ in range(problem.parameters)] for _ in range(modes)]
        self.X = [cp.Variable((n, m)) if problem.tnl else None for _ in range(modes)]
        floor = np.abs(problem.C).sum(axis=1).max(axis=0)
        # A state that no output sees still needs a positive weight: a thousandth of the largest.
        constraints = [self.p >= np.maximum(floor, 1e-3 * floor.max())]
        for q in range(modes):
            drive = self._drive(q)
            for corner, A in problem.at(q):
                constraints += self._corner(q, corner, A, drive)
        self.cvx = cp.Problem(cp.Minimize(self.t), constraints)

    def _drive(self, q: int):
        """Weighted half width that disturbance, noise at k+1 and unknowns add; the same at every corner."""
        s, X, D = self.problem, self.X[q], cp.diag(self.p)
        C, Bw = s.C[q], s.Bw[q]
        T = D if X is None else D - X @ C
        total = cp.sum(cp.abs(T @ Bw) @ s.w_half[q]) if s.w_half.shape[1] else 0
        if X is not None and s.v_half.size:
            # v+ belongs to the next mode: the worst Dv of all.
            later = max(range(len(s.names)), key=lambda r: np.abs(s.Dv[r]).sum())
            total = total + cp.sum(cp.abs(X @ s.Dv[later]) @ s.v_half)
        if s.x_max is not None:
            reach = np.diag(s.A_rad[q] @ s.x_max) + s.u_push[q][len(s.A_unc[q]):]
            total = total + cp.sum(cp.abs(T) @ reach.sum(axis=0))
            for F, pushed in zip(s.A_unc[q], s.u_push[q]):
                total = total + cp.sum(cp.abs(T @ F) @ s.x_max) + cp.sum(cp.abs(T) @ pushed)
        return total

    def _corner(self, q: int, corner: Array, A: Array, drive) -> list:
        s, X, D = self.problem, self.X[q], cp.diag(self.p)
        W = self.W[q]
        for value, slope in zip(corner, self.slopes[q]):
            W = W + value * slope
        M = D @ A - W @ s.C[q]
        if X is not None:
            M = M - X @ (s.C[q] @ A)
        noise = cp.sum(cp.abs(W @ s.Dv[q]) @ s.v_half) if s.v_half.size else 0
        return [*self._decay(M), noise + drive <= self.t]

    def _decay(self, M) -> list:
        """Sign and contraction of diag(p) M."""
        size = cp.abs(M) if self.problem.split else M
        shrinks = cp.sum(size, axis=0) <= self.keep * self.p
        return [shrinks] if self.problem.split else [M >= 0, shrinks]

    @staticmethod
    def kept(a: float) -> float:
        """What of p' e is left after a sample."""
        return 1.0 - a

    def solve(self, a: float) -> dict | None:
        """Minimise t at a contraction rate; None where there is no solution.

        Returns
        -------
        dict or None
            "L", "N" (N, n_x, n_y), "p" (n_x,), "t".
        """
        self.keep.value = self.kept(a)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # cvxpy's own bound propagation multiplies 0 by infinity
                self.cvx.solve(solver=cp.SCIPY, scipy_options={"method": "highs"})
        except cp.error.SolverError:
            return None
        if self.t.value is None:
            return None
        p = self.p.value
        steps = np.array([[W.value / p[:, None] for W in row] for row in self.slopes])
        steps = steps.reshape(len(self.W), -1, *self.W[0].shape)
        L = np.array([tidy(W.value / p[:, None]) for W in self.W])
        N = np.array([tidy(X.value / p[:, None]) for X in self.X]) if self.problem.tnl else np.zeros_like(L)
        return {"L": L, "N": N, "p": p, "t": float(self.t.value), "L_theta": steps}


def candidates(problem: Problem, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Designs over the contraction rates; the caller certifies them and keeps the best.

    Parameters
    ----------
    problem : Problem
    options : dict
        ``contraction`` fixes the rate.
    progress : callable
    """
    lp = WidthProblem(problem)
    rates, found = (float(options["contraction"]),) if "contraction" in options else RATES, False
    while rates:
        for n, a in enumerate(rates, 1):
            progress(f"width, {n} of {len(rates)}: contraction {a:.4g}")
            solved = lp.solve(a)
            if solved is not None:
                found = True
                # Rounding may eat a little of the contraction: claim slightly less than was asked for.
                proof = {"kind": "width", "p": solved["p"].tolist(), "a": a * (1 - 1e-4)}
                yield Candidate(f"width, contraction {a:.4g}", solved["L"], solved["N"], proof, slopes(problem, solved))
        again = not found and rates is RATES
        rates = smaller(lp.solve, RATES[0]) if again else ()
