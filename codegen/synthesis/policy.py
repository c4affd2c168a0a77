"""Smallest steady width by policy iteration: every row of the gains is a small linear program.

For a width vector W the best gains of a row are found without looking at the other rows::

    W_i <- max over modes of min over (L_i, N_i) of max over corners of theta of
           |M_i(theta)| W + |T_i Bw| 2 wbar + |L_i(theta) Dv| 2 vbar + |N_i Dv| 2 vbar + 2 (unknowns over range of x)

with M = T A - L C, and M >= 0 unless ``split``. The map is monotone and, where a design exists, contracts to one
fixed point: no constant gains have a smaller steady width, in any state, for arbitrary switching. (Where the mode is
told late and the bounds of two modes are joined, their difference counts as a mean over the other modes.) It is
piecewise linear, so each round solves the linear system of the gains and corners that are active (Newton), which a
short sampling period with its slow contraction needs. A cap on |N| keeps a sensor fault visible: with C N = I the
correction swallows it.

Source: own, after section 2.5 of the dossier on Lamouchi (2016); the same idea serves Chevet (2021).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import linprog

from .problem import Candidate, Problem, slopes, tidy

Array = np.ndarray
#: Largest |N| tried, relative to the gain that reproduces the measurement.
CAPS = (np.inf, 0.9, 0.6, 0.3, 0.1)


class Row:
    """The linear program of row i in mode q: variables [L_i, its slopes, N_i, magnitudes], all corners at once."""

    def __init__(self, problem: Problem, q: int, i: int, cap: Array | None):
        self.problem, self.q, self.i, self.cap = problem, q, i, cap
        _, self.n, self.p = problem.sizes
        self.free = self.p * (1 + problem.parameters) + (self.p if problem.tnl else 0)
        self.fixed, self.at_corner = self._fixed(), [self._corner(c, A) for c, A in problem.at(q)]

    def _fixed(self) -> list[tuple[Array, Array, Array]]:
        """Terms (matrix, constant, weight) of |constant - matrix g| weight that are the same at every corner."""
        s, q, i = self.problem, self.q, self.i
        T0, TN = np.eye(self.n)[i], np.zeros((self.n, self.free))
        if s.tnl:
            TN[:, -self.p:] = s.C[q].T
        def through(F: Array, weight: Array):  # |T_i F| weight
            return F.T @ TN, F.T @ T0, weight
        terms = [through(s.Bw[q], 2 * s.w_half[q])]
        if s.tnl:
            later = max(range(len(s.names)), key=lambda r: np.abs(s.Dv[r]).sum())
            pick = np.zeros((s.Dv.shape[2], self.free))
            pick[:, -self.p:] = s.Dv[later].T
            terms.append((pick, np.zeros(len(pick)), 2 * s.v_half))
        if s.x_max is not None:
            count = len(s.A_unc[q])
            terms.append(through(np.eye(self.n), 2 * (s.A_rad[q] @ s.x_max + s.u_push[q][count:].sum(axis=0)
                                                      + s.u_push[q][:count].sum(axis=0))))
            terms += [through(F, 2 * s.x_max) for F in s.A_unc[q]]
        for F, push in s.apart[q] if s.apart else ():  # a step of another mode in place of this one, one switch each
            terms += [through(F, 2 * s.x_max / len(s.apart[q])), through(np.eye(self.n), 2 * push / len(s.apart[q]))]
        return terms

    def _corner(self, corner: Array, A: Array):
        """M_i = constant - matrix g at a corner, and the noise term through L."""
        s, q = self.problem, self.q
        L = np.hstack([np.eye(self.p), *(v * np.eye(self.p) for v in corner[:s.parameters])])
        L = np.hstack([L, np.zeros((self.p, self.free - L.shape[1]))])
        matrix = s.C[q].T @ L
        if s.tnl:
            matrix[:, -self.p:] += (s.C[q] @ A).T
        return A[self.i], matrix, (s.Dv[q].T @ L, np.zeros(s.Dv.shape[2]), 2 * s.v_half)

    def active(self, W: Array, g: Array) -> tuple[float, Array]:
        """Value and slope in W of this row for given gains, at the corner where it is largest."""
        best = (-np.inf, np.zeros(len(W)))
        for constant, matrix, (noise, _, weight) in self.at_corner:
            M = constant - matrix @ g[:self.free]
            M = np.abs(M) if self.problem.split else M
            value = M @ W + np.abs(noise @ g[:self.free]) @ weight
            best = max(best, (value, M), key=lambda pair: pair[0])
        rest = sum(np.abs(constant - matrix @ g[:self.free]) @ weight for matrix, constant, weight in self.fixed)
        return best[0] + rest, best[1]

    def solve(self, W: Array) -> tuple[float, Array] | None:
        """Smallest width of this row for the widths W of all, with its gains; None where no gains are allowed."""
        split = self.problem.split
        terms = [*self.fixed, *(noise for *_, noise in self.at_corner)]
        # The solver's tolerances are absolute: widths are counted in what one sample adds without gains.
        unit = max(sum(np.abs(constant) @ weight for _, constant, weight in self.fixed), 1e-3 * W.max())
        unit = unit if unit > 0 else max((w.max() for *_, w in terms if w.size), default=0.0) or 1.0
        W, terms = W / unit, [(matrix, constant, weight / unit) for matrix, constant, weight in terms]
        count = sum(len(weight) for *_, weight in terms)
        extra = len(W) * len(self.at_corner) if split else 0
        size = self.free + count + extra + 1  # g, magnitudes of the terms, of M, the width
        rows, rhs = [], []

        def magnitude(matrix, constant, start):
            for sign in (1.0, -1.0):
                block = np.zeros((len(constant), size))
                block[:, :self.free] = -sign * matrix
                block[:, start:start + len(constant)] = -np.eye(len(constant))
                rows.append(block)
                rhs.append(-sign * constant)

        start, shared = self.free, np.zeros(size)
        for number, (matrix, constant, weight) in enumerate(terms):
            magnitude(matrix, constant, start)
            if number < len(self.fixed):
                shared[start:start + len(weight)] = weight
            start += len(weight)
        at = self.free + sum(len(weight) for *_, weight in self.fixed)
        for constant, matrix, (_, _, weight) in self.at_corner:
            total, right = shared.copy(), 0.0
            total[at:at + len(weight)] = weight / unit
            at += len(weight)
            if split:
                magnitude(matrix, constant, start)
                total[start:start + len(W)] = W
                start += len(W)
            else:
                rows.append(np.hstack([matrix, np.zeros((len(W), size - self.free))]))
                rhs.append(constant)
                total[:self.free] -= W @ matrix
                right = -W @ constant
            total[-1] = -1.0
            rows.append(total[None])
            rhs.append(np.array([right]))
        cost = np.zeros(size)
        cost[-1] = 1.0
        bounds = [(None, None)] * self.free + [(0, None)] * (count + extra + 1)
        if self.cap is not None and self.problem.tnl:
            bounds[self.free - self.p:self.free] = [(-c, c) for c in self.cap[self.i]]
        solved = linprog(cost, A_ub=np.vstack(rows), b_ub=np.concatenate(rhs), bounds=bounds)
        return (float(solved.fun) * unit, solved.x[:self.free]) if solved.status == 0 else None


def iterate(problem: Problem, cap: Array | None = None, rounds: int = 60) -> dict | None:
    """Climb to the least fixed point.

    Returns
    -------
    dict or None
        "L", "L_theta", "N" and "width" (n_x,); None where a row has no gains or the width grows beyond bounds.
    """
    modes, n, p = problem.sizes
    rows = [[Row(problem, q, i, cap) for i in range(n)] for q in range(modes)]
    W = np.zeros(n)
    best = (np.inf, 0, None, W)
    for round_ in range(rounds):
        solved = [[row.solve(W) for row in mode] for mode in rows]
        if any(s is None for mode in solved for s in mode):
            return None
        values = np.array([[value for value, _ in mode] for mode in solved])
        new = values.max(axis=0)
        if np.all(np.abs(new - W) <= 1e-6 * new + 1e-12 * max(1e-300, new.max())):
            break
        if not np.all(np.isfinite(new)) or np.max(new) > 1e9:
            return None
        jump = newton(rows, solved, values.argmax(axis=0), W)
        W = new if jump is None or np.any(jump < 0) or np.max(jump) > 1e9 or round_ % 8 == 7 else jump
        distance = float(np.max(np.abs(new - W) / (new + 1e-300)))
        best = min(best, (distance, round_, solved, W), key=lambda item: item[:2])
    else:  # the corners that are active may alternate close to the fixed point: the certificate judges what was best
        distance, _, solved, W = best
        if distance > 0.05:
            return None
    g = np.array([[x for _, x in mode] for mode in solved])
    J = problem.parameters
    L = g[:, :, :p]
    steps = g[:, :, p:p * (1 + J)].reshape(modes, n, J, p).transpose(0, 2, 1, 3)
    N = g[:, :, p * (1 + J):] if problem.tnl else np.zeros_like(L)
    return {"L": np.array([tidy(x) for x in L]), "L_theta": steps, "N": np.array([tidy(x) for x in N]), "width": W}


def newton(rows: list, solved: list, modes: Array, W: Array) -> Array | None:
    """Fixed point of the active linear pieces; None where they do not contract."""
    M, b = np.empty((len(W), len(W))), np.empty(len(W))
    for i, q in enumerate(modes):
        value, M[i] = rows[q][i].active(W, solved[q][i][1])
        b[i] = value - M[i] @ W
    if np.max(np.abs(np.linalg.eigvals(M))) >= 1.0:
        return None
    return np.linalg.solve(np.eye(len(W)) - M, b)


def capped(problem: Problem, share: float) -> Array | None:
    """Elementwise cap on |N|: a share of the gain that reproduces the measurement; None where it is infinite."""
    reach = np.abs(np.linalg.pinv(problem.C[0]))
    return np.where(reach > 1e-9, share * reach, 1e6) if np.isfinite(share) else None


def share_of(C: Array, N: Array) -> float:
    """Smallest share that gains N (modes, n_x, n_y) keep to, see ``capped``."""
    reach = np.abs(np.linalg.pinv(C))
    size = np.max(np.abs(N), axis=0)
    return float(np.max(size[reach > 1e-9] / reach[reach > 1e-9], initial=0.0))


def candidates(problem: Problem, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Narrowest design, and, where there is a fault to be seen, the same under caps on N."""
    caps = CAPS if problem.tnl and len(problem.f_scale) and options.get("criterion") != "width" else (np.inf,)
    for n, share in enumerate(caps, 1):
        progress(f"width by policy iteration, {n} of {len(caps)}: "
                 + (f"|N| at most {share:g} of C^-1" if np.isfinite(share) else "any gains"))
        solved = iterate(problem, capped(problem, share))
        if solved is not None:
            label = "width, policy iteration" + (f", N at most {share:g}" if np.isfinite(share) else "")
            yield Candidate(label, solved["L"], solved["N"], {"kind": "box"}, slopes(problem, solved))
