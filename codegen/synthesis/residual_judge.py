"""How small a fault is surely seen by a point observer along periodic mode sequences: exact sets, nothing reduced.

With e' = e + N- Dv v, N- the gain of the mode before (so that both copies of a noise sample stay one),

    e'+ = M e' - (M N- + L) (Dv v + Df f) + T (Bw w + Bf f),    r = C e' + (I - C N-) (Dv v + Df f),

so without a fault r lies in the zonotope R of all C M ... M [T Bw wbar, -(M N- + L) Dv vbar] and (I - C N-) Dv vbar. A
step fault of size f is found for every disturbance where its response leaves 2 R: f > 2 / gauge_R(response to 1), which
is also necessary because R is the set itself. The sequences are each mode alone, every pair in turn, and all modes in
turn both ways, at the shortest dwell: a sample of what switching may do. This compares gains, it promises nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from itertools import combinations

import numpy as np

from ..algebra import zonotope
from .point import PointJudge, dwell_of
from .problem import Problem

Array = np.ndarray
#: Generators smaller than this share of the largest are left out, and there are no more after so many samples.
SMALL, LONGEST = 1e-5, 1000


def gauge(G: Array, point: Array) -> float:
    """Smallest t with point in t times the zonotope of generators G.

    Parameters
    ----------
    G : ndarray (m, k), point : ndarray (m,)

    Returns
    -------
    float
        Exact for m <= 2; a lower bound beyond, by the coordinates and the direction (G G')^-1 point. inf where no
        multiple of the zonotope holds the point.
    """
    size, reach = np.max(np.abs(G), initial=0.0), np.max(np.abs(point), initial=0.0)
    if reach == 0.0 or size == 0.0:
        return np.inf if reach > 0.0 else 0.0
    G, point, directions = G / size, point / reach, None
    if len(G) > 2:
        directions = np.vstack([np.eye(len(G)), np.linalg.pinv(G @ G.T) @ point])
    return zonotope.gauge(G, point, directions) * reach / size


def paths(n_modes: int, dwell: int = 1) -> list[tuple[int, ...]]:
    """Periods of the mode sequences looked at, every mode for ``dwell`` samples."""
    orders = list(combinations(range(n_modes), 2))
    if n_modes > 2:
        orders += [tuple(range(n_modes)), tuple(reversed(range(n_modes)))]
    return [(q,) for q in range(n_modes)] + [tuple(q for q in order for _ in range(dwell)) for order in orders]


class Path:
    """A periodic mode sequence that has been running for ever, with given gains.

    Parameters
    ----------
    problem : Problem
    period : tuple of int
        Modes.
    L, N : ndarray (N, n_x, n_y)
    """

    def __init__(self, problem: Problem, period: tuple[int, ...], L: Array, N: Array):
        self.problem, self.period = problem, period
        n = problem.A.shape[1]
        self.M, self.push, self.direct, self.fault, self.C = [], [], [], [], []
        for k, q in enumerate(period):
            C, before = problem.C[q], N[period[k - 1]]
            T = np.eye(n) - N[q] @ C
            M, noise = T @ problem.A[q] - L[q] @ C, problem.Dv[q] * problem.v_half
            read, kept = M @ before + L[q], np.eye(len(C)) - C @ before
            self.C.append(C)
            self.M.append(M)
            self.push.append(np.hstack([T @ (problem.Bw[q] * problem.w_half[q]), -read @ noise]))
            self.direct.append(kept @ noise)
            self.fault.append((T @ problem.Bf[q] - read @ problem.Df[q], kept @ problem.Df[q]))

    @cached_property
    def errors(self) -> list[Array] | None:
        """Generators of e' at each sample of the period, a list of (n_x, k); None where it is unbounded."""
        product = np.eye(len(self.M[0]))
        for M in self.M:
            product = M @ product
        if np.max(np.abs(np.linalg.eigvals(product))) >= 1.0:
            return None
        E, least, samples = np.zeros((len(product), 0)), 0.0, 0
        while samples < LONGEST:
            before = E.shape[1]
            for M, push in zip(self.M, self.push):
                E = np.hstack([M @ E, push])
            size = np.max(np.abs(E), axis=0)
            least = max(least, SMALL * np.max(size, initial=0.0))
            E, samples = E[:, size > least], samples + len(self.period)
            if E.shape[1] <= before:
                break
        out = []
        for M, push in zip(self.M, self.push):
            out.append(E)
            E = np.hstack([M @ E, push])
        return out

    def residuals(self, sample: int) -> Array:
        """Generators of r at a sample of the period, (n_y, k)."""
        i = sample % len(self.period)
        return np.hstack([self.C[i] @ self.errors[i], self.direct[i]])

    def response(self, onset: int, longest: int) -> Array:
        """Residuals 0..longest samples after the onset of a unit step, per channel.

        Returns
        -------
        ndarray (longest + 1, n_y, n_f)
        """
        e, out = np.zeros_like(self.fault[0][0]), []
        for k in range(onset, onset + longest + 1):
            i = k % len(self.period)
            push, direct = self.fault[i]
            out.append(self.C[i] @ e + direct)
            e = self.M[i] @ e + push
        return np.array(out)

    def onsets(self, longest: int) -> list[int]:
        """Samples of the period at which the fault may begin: around every switch, and long before it."""
        starts = [k for k in range(len(self.period)) if self.period[k] != self.period[k - 1]] or [0]
        return sorted({(k - back) % len(self.period) for k in starts for back in (0, 1, longest)})

    def thresholds(self, delays: list[int]) -> Array:
        """Smallest surely detected step by what the one sample shows that long after the onset.

        Returns
        -------
        ndarray (onsets, len(delays), n_f)
            inf where it shows nothing, or where the sets do not settle.
        """
        onsets = self.onsets(max(delays))
        out = np.full((len(onsets), len(delays), self.problem.Df.shape[2]), np.inf)
        for o, onset in enumerate(onsets if self.errors is not None else ()):
            effect = self.response(onset, max(delays))
            for i, d in enumerate(delays):
                for j in range(out.shape[2]):
                    size = gauge(self.residuals(onset + d), effect[d, :, j])
                    out[o, i, j] = 2.0 / size if size > 0 else np.inf
        return out


def thresholds(problem: Problem, L: Array, N: Array, delays: Iterable[int]) -> Array:
    """Smallest surely detected step in each mode alone, per delay after the onset and channel.

    Parameters
    ----------
    problem : Problem
    L, N : ndarray (N, n_x, n_y)
    delays : iterable of int

    Returns
    -------
    ndarray (N, len(delays), n_f)
    """
    delays = list(delays)
    return np.array([Path(problem, (q,), L, N).thresholds(delays)[0] for q in range(len(L))])


class ResidualJudge:
    """Largest threshold over sequences, onsets and channels, in channel sizes, when so many samples may pass.

    Parameters
    ----------
    problem : Problem
    within : int
        Samples after the onset.
    dwell : int
        Shortest time in a mode.
    """

    def __init__(self, problem: Problem, within: int = 3, dwell: int = 1):
        self.problem, self.within, self.paths = problem, within, paths(problem.sizes[0], dwell)

    def __call__(self, L: Array, N: Array) -> float:
        """Threshold of the given gains; inf where some sequence or channel has none."""
        delays, worst = list(range(self.within + 1)), 0.0
        for period in self.paths:
            found = Path(self.problem, period, L, N).thresholds(delays).min(axis=1)
            worst = max(worst, float(np.max(found / self.problem.f_scale, initial=0.0)))
        return worst


def scorer(problem: Problem, within: int, judge: PointJudge | None) -> Callable[[Array, Array, dict], float]:
    """What gains are compared by: (L, N, proof) -> threshold.

    Parameters
    ----------
    problem : Problem
    within : int
    judge : callable or None
        The caller's, else ``ResidualJudge`` at the dwell time of the plant or the proof.
    """

    def score(L: Array, N: Array, proof: dict) -> float:
        if judge is not None:
            return float(judge(L, N))
        if problem.Df.shape[2] == 0:
            return np.inf
        return ResidualJudge(problem, within, dwell_of(proof, problem.tau))(L, N)

    return score
