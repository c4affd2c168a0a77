r"""L-infinity design of an interval observer: Theorems 14, 16 (common P) and 17, 18 (P per mode).

Plant ``x+ = A_q x + B_q u + Bw_q w, y = C x + Dv v``; framer error ``e+ = M_q e + [I L N] d`` with
``d = [offset slack; Dv v; Dv v+]`` and M = T A - L C >= 0. With diagonal P >= I, W = P L, X = P N::

    P A - X C A - W C >= 0
    [ (1-lam) P   0      (P M)' ]
    [ 0           mu I   (P H)' ]  > 0,      P_q <= rho P_l  for q != l,      minimise mu
    [ P M         P H    P      ]

gives ``|e|^2 <= mu |d|^2 / lam`` ultimately (times the switching factor where rho > 1).

Differences from the printed text (Zammali (2020), section 5.3-5.4):

* Upper and lower framer are the same problem, so one half is solved (measured difference 2e-6).
* (5.12) only rescales: normalised to P >= I the printed gamma is sqrt(mu/lam); it and the given scalar
  gamma are dropped. (5.13) holds no variable at all; dropped.
* T = I - N C and X = P N replace the pseudo-inverse parametrisation with Y: same optimum, fewer unknowns.
* ``[M_l P_q; P_q P_q] >= 0`` with free M_l is vacuous; the pairwise P_q <= rho P_l takes its place, never
  worse than rho = a2/a1.
* The bound of Theorems 17, 18 lacks a square root and the switching factor; see ``certify.dwell``.
* ``lam`` (and rho) multiply P and are searched outside. cvxpy keeps one canonicalisation per problem.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import cvxpy as cp
import numpy as np

from ..algebra.dwell import admitted_jump, ratio, shortest, switching_factor
from .problem import Candidate, Problem, slopes, smaller, tidy

Array = np.ndarray

#: Decay rates tried; the criterion is smooth in between, and near 1 a TNL observer is almost deadbeat.
DECAYS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)


class LinfProblem:
    """The LMI with lam and rho as parameters.

    Parameters
    ----------
    problem : Problem
    multiple : bool
        One P per mode instead of a common one.
    """

    def __init__(self, problem: Problem, multiple: bool):
        modes, n, p = problem.sizes
        self.problem, self.multiple = problem, multiple and modes > 1
        self.shrink = cp.Parameter(nonneg=True)  # 1 - lam
        self.rho = cp.Parameter(nonneg=True)
        self.mu = cp.Variable()
        self.P = [cp.Variable(n) for _ in range(modes if self.multiple else 1)]
        self.W = [cp.Variable((n, p)) for _ in range(modes)]
        self.slopes = [[cp.Variable((n, p)) for _ in range(problem.parameters)] for _ in range(modes)]
        self.X = [cp.Variable((n, p)) if problem.tnl else None for _ in range(modes)]
        constraints = [P >= 1 for P in self.P]
        for q in range(modes):
            for corner, A in problem.at(q):
                constraints += self._corner(q, corner, A)
        if self.multiple:
            constraints += [a <= self.rho * b for a in self.P for b in self.P if a is not b]
        self.cvx = cp.Problem(cp.Minimize(self.mu), constraints)

    def _corner(self, q: int, corner: Array, A: Array) -> list:
        C = self.problem.C[q]
        W, X = self.W[q], self.X[q]
        for value, slope in zip(corner, self.slopes[q]):
            W = W + value * slope
        P = cp.diag(self.P[q if self.multiple else 0])
        PM = P @ A - W @ C - (X @ (C @ A) if X is not None else 0)
        return self._decay(P, PM, cp.hstack([P, W] + ([X] if X is not None else [])))

    def _decay(self, P, PM, PH) -> list:
        """Sign and decay of P M, with the disturbances through P H."""
        n = P.shape[0]
        k = PH.shape[1]
        block = cp.bmat([[self.shrink * P, np.zeros((n, k)), PM.T],
                         [np.zeros((k, n)), self.mu * np.eye(k), PH.T],
                         [PM, PH, P]])
        return [PM >= 0, (block + block.T) / 2 >> 1e-7 * np.eye(2 * n + k)]

    @staticmethod
    def kept(lam: float) -> float:
        """What of V is left after a sample."""
        return 1.0 - lam

    def solve(self, lam: float, rho: float = 1.0) -> dict | None:
        """Minimise mu at a decay rate and jump factor.

        Returns
        -------
        dict or None
            "L", "N" (N, n_x, n_y), "P" (N, n_x), "mu"; None where the solver found nothing. Its status is
            not believed either way: what it returns is certified on the rounded constants afterwards.
        """
        self.shrink.value, self.rho.value = self.kept(lam), rho
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # "may be inaccurate" is for the certificate to decide
                self.cvx.solve(solver=cp.CLARABEL)
        except (cp.error.SolverError, ArithmeticError):
            return None
        if self.mu.value is None or self.cvx.status in ("infeasible", "unbounded", "infeasible_inaccurate"):
            return None
        modes = self.problem.sizes[0]
        P = np.array([self.P[q if self.multiple else 0].value for q in range(modes)])
        P = P / min(1.0, P.min())  # back to P >= I to the last digit
        L = np.array([W.value for W in self.W]) / P[:, :, None]
        N = np.array([X.value for X in self.X]) / P[:, :, None] if self.problem.tnl else np.zeros_like(L)
        steps = np.array([[W.value / p[:, None] for W in row] for row, p in zip(self.slopes, P)])
        return {"L": np.array([tidy(g) for g in L]), "N": np.array([tidy(g) for g in N]), "P": P,
                "L_theta": steps.reshape(modes, -1, *L.shape[1:]), "mu": float(self.mu.value)}


def jump_factors(problem: Problem, lam: float) -> list[tuple[float, tuple[int, int]]]:
    """Jump factors worth trying with their dwell time (add, drain) in samples, smallest first.

    With a declared dwell time tau every rho < (1-lam)^-tau is admissible; without one, rho < 1/(1-lam)
    still allows a switch at every sample.
    """
    tau = problem.tau if problem.tau is not None else 1.0
    out = []
    for share in (0.1, 0.3, 0.6, 0.9):
        rho = admitted_jump(lam, share * max(tau, 1.0))
        dwell = (1, 1) if problem.tau is None else ratio(max(problem.tau * (1 - 1e-9), 1.0))
        out.append((rho, dwell))
    return out


def candidates(problem: Problem, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Designs over the line search; the caller certifies them and keeps the best.

    Parameters
    ----------
    problem : Problem
    options : dict
        ``lyapunov`` "common" | "multiple" (default: both where there is more than one mode and a declared
        dwell time, else common), ``lambda`` to fix the decay rate.
    progress : callable
        Called with one line per step.
    """
    decays = (float(options["lambda"]),) if "lambda" in options else DECAYS
    kinds = [options["lyapunov"]] if "lyapunov" in options else ["common"] + ["multiple"] * (problem.tau is not None)
    for kind in kinds:
        lmi = LinfProblem(problem, kind == "multiple")
        found, rates = False, decays
        while rates:
            tries = [(lam, rho, dwell) for lam in rates
                     for rho, dwell in (jump_factors(problem, lam) if lmi.multiple else [(1.0, (1, 1))])]
            for n, (lam, rho, dwell) in enumerate(tries, 1):
                progress(f"linf {kind}, {n} of {len(tries)}: lambda {lam:.4g}"
                         + (f", jump factor {rho:.3g}" if lmi.multiple else ""))
                solved = lmi.solve(lam, rho)
                if solved is not None:
                    found = True
                    yield candidate(problem, kind, lam, solved, dwell)
            again = not found and rates is DECAYS and not lmi.multiple
            rates = smaller(lmi.solve, DECAYS[0]) if again else ()
        if not found and lmi.multiple and problem.tau is None:
            yield from slower(problem, lmi, decays, progress)


def slower(problem: Problem, lmi: LinfProblem, decays, progress) -> Iterator[Candidate]:
    """Nothing holds for arbitrary switching: look for the shortest dwell time at which a design exists."""
    for n, lam in enumerate(decays, 1):
        for tau in (1.5, 2, 3, 5, 8, 12, 20, 40, 80):
            rho = admitted_jump(lam, 0.98 * tau)
            progress(f"linf multiple, shortest dwell time, {n} of {len(decays)}: lambda {lam:g}, {tau:g} samples")
            solved = lmi.solve(lam, rho)
            if solved is not None:
                used = pairwise(solved["P"])
                yield candidate(problem, "multiple", lam, solved, ratio(max(1.02 * shortest(used, lam), 1.0)))
                break


def pairwise(P: Array) -> float:
    """Smallest jump factor of diagonal P_q: max over q != l and i of P_q,i / P_l,i (at least 1)."""
    return float(max(1.0, np.max(P[:, None, :] / P[None, :, :])))


def candidate(problem: Problem, kind: str, lam: float, solved: dict, dwell: tuple[int, int]) -> Candidate:
    """Package a solution with its proof data; the jump factor is the one the P really have."""
    rho = pairwise(solved["P"])
    rho = float(np.nextafter(rho, np.inf)) if rho > 1 else 1.0
    proof = {"kind": "linf", "lam": lam, "rho": rho, "P_hi": solved["P"].tolist(), "P_lo": solved["P"].tolist(),
             "dwell_add": dwell[0], "dwell_drain": dwell[1], "chatter": problem.chatter}
    return Candidate(f"linf, {kind} Lyapunov, lambda {lam:g}", solved["L"], solved["N"], proof, slopes(problem, solved))


def gamma(lam: float, mu: float, rho: float = 1.0, tau: float = 1.0, chatter: float = 1.0) -> float:
    """L-infinity gain sqrt(factor * mu); with rho = 1 the sqrt(mu/lam) of the printed theorems."""
    return float(np.sqrt(mu * (1.0 / lam if rho == 1.0 else switching_factor(rho, lam, tau, chatter))))
