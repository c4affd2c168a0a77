r"""H-infinity gains of a Luenberger residual: Theorems 19 (gains free) and 20 (with a pole in the fault direction).

Plant ``x+ = A_q x + Bw w, y = C x + Dv v``, error ``e+ = (A_q - L_q C) e + [Bw, -L_q Dv] d`` with ``d = [w; v]``,
residual ``r = C e + [0, Dv] d``. With V = e' P_q e and g = gamma^2, for every mode q and the mode l that follows,

    [ (1-a) P_q - C'C      -C' Z       (A_q - L_q C)' P_l ]
    [ *               g I - Z'Z            H_q' P_l       ]  > 0,      Z = [0, Dv],  H_q = [Bw, -L_q Dv],
    [ *                    *                P_l           ]

so ``V+ < (1-a) V - |r|^2 + g |d|^2``. Three kinds of switching:

* "common": one P, a = 0: any switching, |r|_2 < gamma |d|_2 from e_0 = 0.
* "switched": P_q and a slack G_q (last block G_q + G_q' - P_l, products G_q L_q), a = 0: any switching as well.
* "multiple": l = q, 0 < a < 1, P_l <= rho P_q: average dwell time; the level then has a factor (certify.dwell).

Where a pole is assigned, L_q = K_q + S_q rest_q (``fault_direction``) and the variable is P_q S_q. Source: Zammali
(2020), Theorems 19, 20, (6.13), (6.19). Differences from the print: identities have the sizes of w and v; entry (4, 3)
of (6.19) has a stray C and the wrong sign; a gain S per mode (the print has one for all, which is ``shared``) and the
kinds "switched" and "multiple" are ours, because (6.19) has no solution for the printed example at its pole.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from .fault_direction import FaultDirections
from .point import noise_scale, solved_to_numbers
from .problem import Problem, tidy

Array = np.ndarray
KINDS = ("common", "switched", "multiple")
MARGIN = 1e-7


class HinfProblem:
    """The matrix inequalities of one kind of switching, compiled once; poles, decay and jump are parameters.

    Parameters
    ----------
    problem : Problem
    kind : {"common", "switched", "multiple"}
    design : None, FaultDirections or ndarray (N, n_x, n_y)
        None: gains free (Theorem 19). Directions: poles assigned (Theorem 20). An array: these gains, only P is
        sought.
    shared : bool
        One S for all modes, as printed (kind "common" only).
    margin : float
        Distance from the boundary of the matrix inequality, in units in which the noise has size 1.
    """

    def __init__(self, problem: Problem, kind: str, design: FaultDirections | Array | None = None,
                 shared: bool = False, margin: float = MARGIN):
        self.problem, self.kind, self.design = problem, kind if problem.sizes[0] > 1 else "common", design
        modes, n, p = problem.sizes
        noise = problem.Bw * problem.w_half[:, None, :], problem.Dv * problem.v_half
        self.scale = noise_scale(*noise)
        self.Bw, self.Dv = (part / self.scale for part in noise)
        self.keep = cp.Parameter(nonneg=True, value=1.0)  # 1 - a
        self.rho = cp.Parameter(nonneg=True, value=1.0)
        self.g, self.slack = cp.Variable(), cp.Variable()
        one = self.kind == "common"
        P = [cp.Variable((n, n), symmetric=True) for _ in range(1 if one else modes)]
        self.P = P * modes if one else P
        self.G = self.P if self.kind != "switched" else [cp.Variable((n, n)) for _ in range(modes)]
        self.Y = [cp.Variable((n, p)) for _ in range(1 if shared else modes)] * (modes if shared else 1)
        self.poles = cp.Parameter(design.F.shape[2]) if isinstance(design, FaultDirections) else None
        pairs = [(q, r) for q in range(modes) for r in (range(modes) if self.kind == "switched" else (q,))]
        performance = [self._block(q, r, True, margin) for q, r in pairs]
        stability = [self._block(q, r, False, self.slack) for q, r in pairs]
        shape = []  # of P
        if self.kind == "multiple":
            shape = [self.rho * a - b >> 0 for a in P for b in P if a is not b]
        self.cvx = cp.Problem(cp.Minimize(self.g), [self.g >= 0, *performance, *shape])
        # Only whether it is stable: P of bounded size, as far inside as possible.
        self.inside = cp.Problem(cp.Maximize(self.slack), [*stability, *shape, *(a << np.eye(n) for a in P),
                                                           self.slack <= 1.0])

    def _product(self, q: int):
        """G_q L_q."""
        G, Y = self.G[q], self.Y[q]
        if self.design is None:
            return Y
        if isinstance(self.design, FaultDirections):
            d = self.design
            moved = sum(self.poles[j] * (G @ d.per_pole[q, j]) for j in range(d.F.shape[2]))
            return G @ d.fixed[q] - moved + Y @ d.rest[q]
        return G @ self.design[q]

    def _block(self, q: int, r: int, performance: bool, margin):
        problem, GL = self.problem, self._product(q)
        C, G, P = problem.C[q], self.G[q], self.P[q]
        GA = G @ problem.A[q] - GL @ C
        last = G + G.T - self.P[r] if self.kind == "switched" else P
        drive = [(self.Bw[q], None), (None, self.Dv[q])]
        drive = [(B, D) for B, D in drive if (B if D is None else D).shape[1]]
        if not performance or not drive:
            first = self.keep * P - (C.T @ C if performance else 0)
            block = cp.bmat([[first, GA.T], [GA, last]])
            return (block + block.T) / 2 >> margin * np.eye(block.shape[0])
        GH = cp.hstack([G @ B if D is None else -GL @ D for B, D in drive])
        Z = np.hstack([np.zeros((len(C), B.shape[1])) if D is None else D for B, D in drive])
        k = Z.shape[1]
        block = cp.bmat([[self.keep * P - C.T @ C, -C.T @ Z, GA.T],
                         [-Z.T @ C, self.g * np.eye(k) - Z.T @ Z, GH.T], [GA, GH, last]])
        return (block + block.T) / 2 >> margin * np.eye(block.shape[0])

    def _set(self, poles, alpha: float, rho: float) -> None:
        self.keep.value, self.rho.value = 1.0 - alpha, rho
        if self.poles is not None:
            self.poles.value = np.broadcast_to(np.asarray(poles, float), self.poles.shape).copy()

    def solve(self, poles=None, alpha: float = 0.0, rho: float = 1.0) -> dict | None:
        """Minimise the level.

        Parameters
        ----------
        poles : float or array_like (k,), optional
            Where the design assigns some.
        alpha, rho : float
            Decay and jump factor of kind "multiple".

        Returns
        -------
        dict or None
            "L" (N, n_x, n_y), "P" (N, n_x, n_x), "gamma" in units of the declared bounds of w and v. None where the
            solver found nothing; its status is not believed either way.
        """
        self._set(poles, alpha, rho)
        if not solved_to_numbers(self.cvx):
            return None
        modes = self.problem.sizes[0]
        P = np.array([(p.value + p.value.T) / 2 for p in self.P])
        G = np.array([a.value for a in self.G])
        if min(np.linalg.eigvalsh(p)[0] for p in P) <= 0:
            return None
        L = np.array([np.linalg.solve(G[q], _value(self._product(q))) for q in range(modes)])
        L = L if isinstance(self.design, np.ndarray) else np.array([tidy(a) for a in L])
        return {"L": L, "P": P, "gamma": self.scale * float(np.sqrt(max(self.g.value, 0.0)))}

    def stabilisable(self, poles=None, alpha: float = 0.0, rho: float = 1.0) -> bool:
        """Whether any gains of the kind are stable under the switching; no level is asked for."""
        self._set(poles, alpha, rho)
        return solved_to_numbers(self.inside) and float(self.slack.value) > 1e-7


def _value(expression) -> Array:
    return np.asarray(expression.value if hasattr(expression, "value") else expression, float)


def largest_pole(lmi: HinfProblem, alpha: float = 0.0, rho: float = 1.0, digits: float = 5e-4) -> float | None:
    """Largest pole in (0, 1) for which stable gains exist, by bisection.

    Returns
    -------
    float or None
        None where there is none for 0.05, 0.15, ... 0.95 either.
    """
    found = [pole for pole in np.linspace(0.05, 0.95, 10) if lmi.stabilisable(pole, alpha, rho)]
    if not found:
        return None
    lo, hi = found[-1], min(found[-1] + 0.1, 1.0)
    while hi - lo > digits:
        middle = (lo + hi) / 2
        lo, hi = (middle, hi) if lmi.stabilisable(middle, alpha, rho) else (lo, middle)
    return float(lo)
