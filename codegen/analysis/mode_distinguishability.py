"""Whether modes can be told apart at all with the declared bounds and inputs, and by when.

Before any design, and for every estimator: two modes look alike over p + 1 samples when some states in the declared
ranges, some disturbances and some noise within their bounds give both the same measurements. That is a linear program;
where it has no solution, a mode that stays that long cannot be taken for the other. The input is whatever the declared
range allows ("worst"), or the best constant corner of it ("best"): a plant at rest may hide its mode until it is moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.optimize import linprog

Array = np.ndarray
#: Samples that are looked at, where the dwell time is not shorter.
MOST = 40
#: Numbers in the matrices of all linear programs together, beyond which they are left out.
CHEAP = 2e7


@dataclass(frozen=True)
class Pair:
    """Two modes.

    Parameters
    ----------
    first, second : int
    rate : float
        Least difference of the outputs' rates (continuous) or next values (discrete) from the same state, over all
        states and inputs in range: above zero the old mode shows at once. Largest over the outputs.
    worst : int or None
        Samples after the first by which they are told apart whatever the input; None: not within the horizon.
    best : int or None
        The same with the best constant input.
    example : dict or None
        Where ``worst`` is None: "x" (2, n_x), the two first states, and "u" (K, n_u) that nobody can tell apart.
    """

    first: int
    second: int
    rate: float
    worst: int | None
    best: int | None
    example: dict | None


def inapplicable(plant) -> str | None:
    """Why the modes of a plant are not compared; None where they are."""
    if plant.polytope is not None or plant.theta:
        return "the plant has parameters."
    for vector in "xu":
        for s in getattr(plant, vector):
            if not (np.isfinite(s.lo) and np.isfinite(s.hi)):
                return f'signals.{vector} "{s.name}" has no range.'
    pairs, width = plant.n_modes * (plant.n_modes - 1) / 2, 2 * plant.n_x + plant.n_u
    if pairs * (1 + 2 ** plant.n_u) * (MOST * width) * (MOST * (2 * plant.n_x + plant.n_y)) > CHEAP * 10:
        return "too many modes, states or inputs for a quick answer."
    return None


def sampled(plant, q: int) -> tuple[Array, Array, Array, Array]:
    """Transition, input matrix, and bounds of what disturbances add in one period."""
    m = plant.modes[q]
    n, n_u = m.B.shape
    middle, radius = (m.w_hi + m.w_lo) / 2, (m.w_hi - m.w_lo) / 2
    if plant.kind == "discrete":
        return m.A, m.B, m.Bw @ middle, np.abs(m.Bw) @ radius
    M = np.zeros((n + n_u + 1, n + n_u + 1))
    M[:n] = np.hstack([m.A, m.B, (m.Bw @ middle)[:, None]])
    E = expm(M * plant.sample_period)[:n]
    times = (np.arange(64) + 0.5) / 64 * plant.sample_period
    reach = sum(np.abs(expm(m.A * s)) for s in times) * (plant.sample_period / 64) @ (np.abs(m.Bw) @ radius)
    return E[:, :n], E[:, n:n + n_u], E[:, -1], reach


def least_rate(plant, i: int, j: int) -> float:
    """Distance from zero of C ((A_i - A_j) x + (B_i - B_j) u) over the ranges, largest over the outputs."""
    a, b = plant.modes[i], plant.modes[j]
    if not np.array_equal(a.C, b.C):
        return 0.0
    M = a.C @ np.hstack([a.A - b.A, a.B - b.B])
    lo, hi = (np.concatenate(pair) for pair in zip(plant.limits("x"), plant.limits("u")))
    middle, radius = M @ ((lo + hi) / 2), np.abs(M) @ ((hi - lo) / 2)
    return float(np.max(np.maximum(np.abs(middle) - radius, 0.0)))


class Lookalikes:
    """The linear program of a pair of modes.

    Parameters
    ----------
    plant : Plant
        Without parameters.
    i, j : int
    """

    def __init__(self, plant, i: int, j: int):
        self.plant, self.n, self.n_u = plant, plant.n_x, plant.n_u
        self.pair = [sampled(plant, q) for q in (i, j)]
        self.modes = [plant.modes[q] for q in (i, j)]

    def solve(self, samples: int, u: tuple[Array, Array]) -> dict | None:
        """Two courses that look alike over samples 0 to ``samples``, or None.

        Parameters
        ----------
        samples : int
        u : (ndarray (n_u,), ndarray (n_u,))
            Range of the input.

        Returns
        -------
        dict or None
            "x" (2, n_x), "u" (samples + 1, n_u).
        """
        n, n_u = self.n, self.n_u
        width = 2 * n + n_u
        total = width * (samples + 1)
        lo, hi = self.plant.limits("x")
        bounds = ([*zip(lo, hi)] * 2 + [*zip(*u)]) * (samples + 1)
        a, b = self.modes
        noise = [m.Dv @ ((m.v_hi + m.v_lo) / 2) for m in self.modes]
        room = sum(np.abs(m.Dv) @ ((m.v_hi - m.v_lo) / 2) for m in self.modes)
        see = np.hstack([a.C, -b.C, a.D - b.D])
        move = np.hstack([block_diag(*(p[0] for p in self.pair)), np.vstack([p[1] for p in self.pair])])
        shift, reach = (np.concatenate([p[k] for p in self.pair]) for k in (2, 3))
        rows, right = [], []
        for k in range(samples + 1):
            here = slice(k * width, (k + 1) * width)
            line = np.zeros((len(see), total))
            line[:, here] = see
            rows += [line, -line]
            right += [room - noise[0] + noise[1], room + noise[0] - noise[1]]
            if k < samples:
                step = np.zeros((2 * n, total))
                step[:, here] = -move
                step[:, (k + 1) * width:(k + 1) * width + 2 * n] = np.eye(2 * n)
                rows += [step, -step]
                right += [reach + shift, reach - shift]
        found = linprog(np.zeros(total), A_ub=np.vstack(rows), b_ub=np.concatenate(right) + 1e-9, bounds=bounds,
                        method="highs")
        if found.status == 2:
            return None
        z = found.x.reshape(samples + 1, width)
        return {"x": z[0, :2 * n].reshape(2, n), "u": z[:, 2 * n:]}

    def first(self, u: tuple[Array, Array], horizon: int) -> tuple[int | None, dict | None]:
        """Least number of samples that tells them apart, else None and an example over the horizon."""
        example = self.solve(horizon, u)
        if example is not None:
            return None, example
        low, high = -1, horizon
        while high - low > 1:
            middle = (low + high) // 2
            if self.solve(middle, u) is None:
                high = middle
            else:
                low = middle
        return high, None


def distinguishability(plant, horizon: int = MOST) -> list[Pair]:
    """All pairs of modes.

    Parameters
    ----------
    plant : Plant
        Without parameters; ranges for every state and input.
    horizon : int
        Samples to try, e.g. the dwell time.

    Returns
    -------
    list of Pair
    """
    lo, hi = plant.limits("u")
    out = []
    for i in range(plant.n_modes):
        for j in range(i + 1, plant.n_modes):
            program = Lookalikes(plant, i, j)
            worst, example = program.first((lo, hi), horizon)
            best = worst
            for corner in product(*zip(lo, hi)) if np.any(lo < hi) else ():
                value = np.array(corner)
                samples, _ = program.first((value, value), horizon if best is None else best)
                if samples is not None:
                    best = samples if best is None else min(best, samples)
            out.append(Pair(i, j, least_rate(plant, i, j), worst, best, example))
    return out
