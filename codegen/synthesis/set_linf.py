r"""L-infinity gains of a point observer: Theorem 21 with P per mode and average dwell time, Luenberger or TNL.

Error ``e+ = M_q e + H_q d`` with ``d = [w; v; v+]``, M = T A - L C, ``H = [T Bw, -L Dv, -N Dv]``, T = I - N C. With
V = e' P_q e, Q = P L and X = P N,

    [ (1-lam) P_q   0      (P_q M_q)' ]
    [ 0             mu I   (P_q H_q)' ]  > 0,      I <= P_q <= a2 I,      minimise  beta a2 + (1 - beta) mu
    [ P_q M_q       P_q H_q    P_q    ]

gives ``V+ <= (1-lam) V + mu |d|^2``, so ``|e|^2 <= mu |d|^2 / lam`` ultimately, times the factor of ``certify.dwell``
where P jumps by rho at a switch. mu is in units in which the bounds of w and v are 1 and the largest entry of noise
matrices is 1, so beta means the same for every plant.

Source: Zammali (2020), Theorem 21, (6.41)-(6.46). Differences from the print:

* X = P N and T = I - N C replace the pseudo-inverse parametrisation with Y: same optimum, fewer unknowns.
* (6.44), (6.45) rescale the bound; the direct one is the sharpest of them. (6.46) with a free matrix constrains
  nothing. Dropped.
* rho = a2/a1 only bounds the jump; what counts is the largest eigenvalue of P_l^-1 P_q (``point.jump_factor``).
* (6.49) bounds |e|^2, not |e|, and under switching lacks the factor.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from .point import noise_scale, solved_to_numbers
from .problem import Problem, tidy

Array = np.ndarray
MARGIN = 1e-7


class SetLinfProblem:
    """The matrix inequalities with lam and beta as parameters, compiled once.

    Parameters
    ----------
    problem : Problem
        Its ``tnl`` says whether N is free.
    gains : (ndarray (N, n_x, n_y), ndarray (N, n_x, n_y)), optional
        Given L and N: only P is sought.
    margin : float
        Distance from the boundary of the matrix inequality, in units in which the noise has size 1.
    """

    def __init__(self, problem: Problem, gains: tuple[Array, Array] | None = None, margin: float = MARGIN):
        self.problem, self.gains, self.margin = problem, gains, margin
        modes, n, p = problem.sizes
        noise = problem.Bw * problem.w_half[:, None, :], problem.Dv * problem.v_half
        self.scale = noise_scale(*noise)
        self.Bw, self.Dv = (part / self.scale for part in noise)
        self.shrink, self.beta = cp.Parameter(nonneg=True), cp.Parameter(nonneg=True)
        self.rho = cp.Parameter(nonneg=True, value=1e6)
        self.mu, self.a2 = cp.Variable(), cp.Variable()
        self.P = [cp.Variable((n, n), symmetric=True) for _ in range(modes)]
        self.Q = [cp.Variable((n, p)) if gains is None else P @ gains[0][q] for q, P in enumerate(self.P)]
        if gains is not None:
            self.X = [P @ gains[1][q] for q, P in enumerate(self.P)]
        else:
            self.X = [cp.Variable((n, p)) if problem.tnl else None for _ in range(modes)]
        constraints = [self.mu >= 0]
        constraints += [c for P in self.P for c in (P >> np.eye(n), P << self.a2 * np.eye(n))]
        constraints += [self.rho * a - b >> 0 for a in self.P for b in self.P if a is not b]
        for q in range(modes):
            constraints += [self._block(q, Dv) for Dv in self._later()]
        self.cvx = cp.Problem(cp.Minimize(self.beta * self.a2 + (1 - self.beta) * self.mu), constraints)

    def _later(self) -> list[Array]:
        """Noise matrices that the next sample may have; N acts on their noise."""
        if not self.problem.tnl:
            return [self.Dv[0]]
        return [D for i, D in enumerate(self.Dv) if not any(np.array_equal(D, E) for E in self.Dv[:i])]

    def _block(self, q: int, later: Array):
        P, Q, X = self.P[q], self.Q[q], self.X[q]
        A, C = self.problem.A[q], self.problem.C[q]
        PT = P if X is None else P - X @ C
        PM = PT @ A - Q @ C
        parts = [PT @ self.Bw[q], -Q @ self.Dv[q]] + ([] if X is None else [-X @ later])
        parts = [part for part in parts if part.shape[1]]
        n = len(A)
        if not parts:
            block = cp.bmat([[self.shrink * P, PM.T], [PM, P]])
        else:
            PH = cp.hstack(parts)
            k = PH.shape[1]
            block = cp.bmat([[self.shrink * P, np.zeros((n, k)), PM.T],
                             [np.zeros((k, n)), self.mu * np.eye(k), PH.T], [PM, PH, P]])
        return (block + block.T) / 2 >> self.margin * np.eye(block.shape[0])

    def solve(self, lam: float, beta: float = 0.0, rho: float = 1e6) -> dict | None:
        """Minimise beta a2 + (1 - beta) mu.

        Parameters
        ----------
        lam : float
            Decay.
        beta : float
            Weight of the largest eigenvalue of P, 0 to 1.
        rho : float
            Largest jump of P that is admitted.

        Returns
        -------
        dict or None
            "L", "N" (N, n_x, n_y), "P" (N, n_x, n_x) with P >= I, "mu" (noise bounds 1). None where the solver found
            nothing; its status is not believed either way.
        """
        self.shrink.value, self.beta.value, self.rho.value = 1.0 - lam, beta, rho
        if not solved_to_numbers(self.cvx):
            return None
        P = np.array([(p.value + p.value.T) / 2 for p in self.P])
        least = min(np.linalg.eigvalsh(p)[0] for p in P)
        if least <= 0:
            return None
        if self.gains is not None:
            L, N = self.gains
        else:
            L = np.array([tidy(np.linalg.solve(p, q.value)) for p, q in zip(P, self.Q)])
            N = np.array([tidy(np.linalg.solve(p, x.value)) for p, x in zip(P, self.X)]) \
                if self.problem.tnl else np.zeros_like(L)
        size = max(1.0, 1.0 / least) * (1 + 1e-9)  # back to P >= I to the last digit
        return {"L": L, "N": N, "P": P * size, "mu": float(self.mu.value) * size * self.scale**2}
