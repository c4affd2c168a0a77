"""Detection design of an interval observer: the box that makes the surely detected fault smallest.

A narrow residual is not a sensitive one: a gain N near C^-1 makes the interval thin and swallows the sensor
fault with it. This design looks at the ratio. For a box z > 0 that holds both framer errors for every mode,

    M_q z + 2 (|T Bw| wbar + |L Dv| vbar + |N Dv| vbar) <= z,      M_q = T A - L C >= 0,

output i is fault free below ``R_i = |C_i| z + 2 (|Dv| vbar)_i``, and the first effect of a fault with Markov
parameter s (Df for a sensor, C Bf for an actuator, C A Bf where that vanishes) is ``(I - C N) s``. For fixed z
everything is linear in (L, N), and modes are independent: an LP per mode maximises the smallest
|effect| / R over the channels. z is searched (Nelder-Mead on its logarithm) from the ultimate boxes of the other
designs. Gains are capped, or the ratio improves for ever with diverging gains. Valid for any switching.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from scipy.optimize import linprog, minimize

from .problem import Candidate, Judge, Problem, tidy

Array = np.ndarray


#: What is given up of the worst threshold (in logarithm) for the mean over mode sequences, and for width.
TYPICAL_WEIGHT, WIDTH_WEIGHT = 0.1, 0.01


def signature(problem: Problem) -> Array:
    """First nonvanishing Markov parameter from each fault channel to the outputs, per mode.

    Returns
    -------
    ndarray (N, n_y, n_f)
    """
    out = np.array(problem.Df, dtype=float)
    for j in range(out.shape[2]):
        push = problem.Bf[:, :, j:j + 1]
        for _ in range(problem.A.shape[1]):
            if np.any(out[:, :, j]):
                break
            out[:, :, j] = (problem.C @ push)[:, :, 0]
            push = problem.A @ push
    return out


class BoxProgram:
    """The LP of one mode for fixed z; unknowns (rows of) N, L, the absolute values, and the ratio t.

    Parameters
    ----------
    problem : Problem
    q : int
        Mode.
    cap : float
        Bound on every |N|, and on every |L|, entry (L in units of its own scale, see ``gain_caps``).
    """

    def __init__(self, problem: Problem, q: int, cap: float):
        self.problem, self.q = problem, q
        _, n, m = problem.sizes
        self.n, self.m = n, m
        self.A, self.C, self.Bw = problem.A[q], problem.C[q], problem.Bw[q]
        noise = problem.Dv * problem.v_half
        self.noise, self.next_noise = noise[q], np.abs(noise).max(axis=0)
        # Per row i the unknowns are g = (N_i, L_i); every absolute value gets its own variable.
        self.free = np.vstack([self.C @ self.A, self.C]) if problem.tnl else self.C
        self.k = self.free.shape[0]
        self.drive = self.Bw * problem.w_half[q]
        gain = gain_caps(problem, q, cap)
        self.bounds = [gain[i, c] for i in range(n) for c in range(self.k)]
        self._absolute_rows()

    def _absolute_rows(self):
        """Rows |expr| <= variable for T Bw wbar, L Dv vbar, N Dv vbar, for all n state rows."""
        n, k, m = self.n, self.k, self.m
        per_row = []  # (coefficients on g, constant part as function of i)
        for c in range(self.drive.shape[1]):
            coefficient = np.zeros(k)
            if self.problem.tnl:
                coefficient[:m] = -(self.C @ self.drive)[:, c]
            per_row.append((coefficient, self.drive[:, c]))
        for c in range(self.noise.shape[1]):
            coefficient = np.zeros(k)
            coefficient[k - m:] = self.noise[:, c]
            per_row.append((coefficient, np.zeros(n)))
            if self.problem.tnl:
                coefficient = np.zeros(k)
                coefficient[:m] = self.next_noise[:, c]
                per_row.append((coefficient, np.zeros(n)))
        self.extra = len(per_row)
        size = n * k + n * self.extra + 1
        rows, rhs = [], []
        for i in range(n):
            for e, (coefficient, constant) in enumerate(per_row):
                for sign in (1.0, -1.0):
                    row = np.zeros(size)
                    row[i * k:(i + 1) * k] = sign * coefficient
                    row[n * k + i * self.extra + e] = -1.0
                    rows.append(row)
                    rhs.append(-sign * constant[i])
            for j in range(n):  # M_ij = A_ij - g free_j >= 0
                row = np.zeros(size)
                row[i * k:(i + 1) * k] = self.free[:, j]
                rows.append(row)
                rhs.append(self.A[i, j])
        self.rows, self.rhs, self.size = np.array(rows).reshape(-1, size), np.array(rhs), size

    def solve(self, z: Array, targets: list[tuple[int, float, Array, float]]):
        """Maximise the smallest effect / R over the targets, keeping z a box of this mode.

        Parameters
        ----------
        z : ndarray (n_x,)
        targets : list of (output, sign, s, R)
            Channel signature s (n_y,) scaled by the channel's size, seen at that output with that sign.

        Returns
        -------
        (t, N, L) or None
            t >= 0 is the smallest ratio: the threshold is 1/t channel sizes.
        """
        n, k, m = self.n, self.k, self.m
        box, limit = np.zeros((n, self.size)), np.zeros(n)
        for i in range(n):
            box[i, i * k:(i + 1) * k] = -(self.free @ z)
            box[i, n * k + i * self.extra:n * k + (i + 1) * self.extra] = 2.0
            limit[i] = z[i] - self.A[i] @ z
        aim = np.zeros((len(targets), self.size))
        reach = np.zeros(len(targets))
        for r, (output, sign, s, R) in enumerate(targets):
            if self.problem.tnl:  # sign (s_o - C_o N s) >= t R
                for i in range(n):
                    aim[r, i * k:i * k + m] += sign * self.C[output, i] * s / R
            aim[r, -1] = 1.0
            reach[r] = sign * s[output] / R
        scale = 1.0 / z
        # Among equal ratios take the gains with the smallest errors after this step: the ratio leaves the
        # rows open that the output does not see at once, and all of them for the classical observer.
        cost = 1e-3 / n * (scale @ box)
        cost[-1] = -1.0
        bounds = [(-b, b) for b in self.bounds] + [(0, None)] * (n * self.extra) + [(None, None)]
        solved = linprog(cost, A_ub=np.vstack([self.rows, box * scale[:, None], aim]),
                         b_ub=np.concatenate([self.rhs, limit * scale, reach]), bounds=bounds, method="highs")
        if solved.status != 0:
            return None
        g = solved.x[:n * k].reshape(n, k)
        N = g[:, :m] if self.problem.tnl else np.zeros((n, m))
        return float(solved.x[-1]), N, g[:, k - m:]


def gain_caps(problem: Problem, q: int, cap: float) -> Array:
    """Bounds per gain entry: ``cap`` in units in which C A and C have entries of order one, row by row."""
    _, n, m = problem.sizes
    C, A = problem.C[q], problem.A[q]
    out = np.abs(C).max(axis=1, initial=0.0)
    reach = np.maximum(np.abs(A).max(axis=1), 1.0)
    L = cap * reach[:, None] / np.where(out > 0, out, 1.0)
    # A state driven by small entries of A (a position by a speed) may need the inverse of such an entry.
    smallest = np.min(np.where(np.abs(A) > 1e-12, np.abs(A), np.inf))
    L = np.maximum(L, cap / max(min(smallest, 1.0), 1e-4) / np.where(out > 0, out, 1.0) * (smallest < 0.05))
    return np.hstack([L, L]) if problem.tnl else L


def search(problem: Problem, start: Array, seen: tuple[int, ...], cap: float, evaluations: int,
           judge: Judge, progress: Callable[[str], None]):
    """Nelder-Mead over log z from a valid box; each z gives gains by LP, and ``judge`` their threshold.

    Parameters
    ----------
    seen : tuple of int
        For each channel the output at which the LP aims.
    judge : callable
        Thresholds and width of given gains.
    progress : callable
        Told now and then how many boxes were tried, and the best threshold so far.

    Returns
    -------
    (L, N) or None
    """
    programs = [BoxProgram(problem, q, cap) for q in range(problem.sizes[0])]
    s = signature(problem) * problem.f_scale
    noise2 = 2.0 * np.einsum("qyv,v->qy", np.abs(problem.Dv), problem.v_half)
    best = [np.inf, None, None, start]
    tried, reached = 0, np.inf

    def cost(log_z):
        nonlocal tried, reached
        tried += 1
        if tried % 10 == 0:
            progress(f"{tried} of {evaluations} boxes"
                     + (f", threshold {reached:.3g}" if np.isfinite(reached) else ""))
        z = np.exp(log_z)
        gains = []
        for q, program in enumerate(programs):
            R = np.abs(problem.C[q]) @ z + noise2[q]
            solved = program.solve(z, [(o, np.sign(s[q, o, j]) or 1.0, s[q, :, j], R[o]) for j, o in enumerate(seen)])
            if solved is None:
                return 1e3
            gains.append(solved[1:])
        N, L = (np.array([tidy(g[i]) for g in gains]) for i in (0, 1))
        worst, typical, width = judge(L, N)
        if not np.isfinite(typical):
            return 1e3
        # Scaling I - C N scales effect and residual alike: among equal thresholds the narrow one is wanted.
        value = np.log(worst) + TYPICAL_WEIGHT * np.log(typical) + WIDTH_WEIGHT * np.log(width)
        if value < best[0]:
            best[:] = value, L, N, z
            reached = worst
        return value

    for _ in range(2):  # one restart: Nelder-Mead on a piecewise function may collapse early
        x = np.log(best[3])
        spread = np.vstack([x, x + 0.4 * np.eye(len(x))])
        minimize(cost, x, method="Nelder-Mead", options={"maxfev": evaluations // 2, "initial_simplex": spread,
                                                         "xatol": 1e-3, "fatol": 1e-4})
    return None if best[1] is None else (best[1], best[2])


def aims(problem: Problem, most: int = 3) -> list[tuple[int, ...]]:
    """Assignments channel -> output whose signature does not vanish in any mode; the strongest first."""
    s = np.min(np.abs(signature(problem)), axis=0)  # (n_y, n_f)
    strength = s / np.maximum(s.max(axis=0), 1e-300)
    each = [[o for o in np.argsort(-strength[:, j]) if strength[o, j] > 1e-6] or [0] for j in range(s.shape[1])]
    picks = [tuple(int(o) for o in pick) for pick in product(*each)]
    return sorted(picks, key=lambda pick: -min(strength[o, j] for j, o in enumerate(pick)))[:most]


def candidates(problem: Problem, options: dict, starts: list[Array], judge: Judge,
               progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Designs from several starting boxes, aims and gain caps; the caller certifies them and keeps the best.

    Parameters
    ----------
    problem : Problem
    options : dict
        ``gain_cap`` (default 2), ``evaluations`` of each box search (default 100).
    starts : list of ndarray (n_x,)
        Ultimate error boxes of other designs.
    judge : callable
        Thresholds and width of given gains.
    progress : callable
    """
    if problem.Df.shape[2] == 0:
        return
    cap, evaluations = float(options.get("gain_cap", 2.0)), int(options.get("evaluations", 100))
    # Every start for the strongest aim, the first start for the others.
    tries = [(seen, start) for n, seen in enumerate(aims(problem)) for start in (starts if n == 0 else starts[:1])]
    for n, (seen, start) in enumerate(tries, 1):
        outputs = ", ".join(str(o) for o in seen)
        where = f"detection, {n} of {len(tries)}: aim at output {outputs}"
        progress(where)
        found = search(problem, start * 1.02, seen, cap, evaluations, judge,
                       lambda text, where=where: progress(f"{where}, {text}"))
        if found is not None:
            L, N = found
            yield Candidate(f"detection, gain cap {cap:g}, aim at output {outputs}", L, N, {"kind": "box"})
