"""A fast floating-point estimate of the surely detected fault, for searches over gains.

Same recursion as ``detectability``, without rounding margins and over short mode histories. A search may
believe it; a design never does.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..algebra.interval import support
from .adjoint import ResidualModel
from .detectability import beginnings, sequences, thresholds

Array = np.ndarray


class QuickJudge:
    """Threshold of given gains, in units of each channel's size.

    Parameters
    ----------
    plant : Plant
    f_scale : ndarray (n_f,)
    within : int
        Longest delay in samples.
    """

    def __init__(self, plant, f_scale: Array, within: int):
        self.plant, self.f_scale, self.within = plant, f_scale, within
        while plant.n_modes ** (self.within + 2) > 300 and self.within > 0:
            self.within -= 1
        lo, hi = plant.limits("x")
        self.x_scale = np.maximum(hi - lo, 1e-300)
        self.before = 6 if plant.n_modes == 1 else 1
        self.heads = beginnings(sequences(plant.n_modes, self.before + self.within + 1, None), self.before)
        self.stack = {k: np.stack([getattr(m, k) for m in plant.modes])
                      for k in ("A", "C", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi")}

    def tables(self, L: Array, N: Array) -> SimpleNamespace:
        """Float stand-in of FramerTables with offsets that hold for real numbers."""
        s = self.stack
        T = np.eye(L.shape[1]) - N @ s["C"]
        out = {"M_hi": T @ s["A"] - L @ s["C"], "L_hi": L, "N_hi": N}
        out |= {"M_lo": out["M_hi"], "L_lo": L, "N_lo": N}
        for side, sign in (("hi", 1.0), ("lo", -1.0)):
            reach = support(sign * T @ s["Bw"], s["w_lo"], s["w_hi"])
            reach = reach + support(-sign * L @ s["Dv"], s["v_lo"], s["v_hi"])
            later = [support(-sign * N @ D, a, b) for D, a, b in zip(s["Dv"], s["v_lo"], s["v_hi"])]
            out["d_" + side] = sign * (reach + np.max(later, axis=0))
            out["c_" + side] = sign * support(sign * s["Dv"], s["v_lo"], s["v_hi"])
        return SimpleNamespace(**out)

    def settled(self, t: SimpleNamespace) -> Array | None:
        """Ultimate box of the framer error under arbitrary switching, None where it diverges."""
        push = t.d_hi - t.d_lo
        z = push.max(axis=0)
        for _ in range(3000):
            new = (t.M_hi @ z + push).max(axis=0)
            if np.any(new > 1e9 * (1.0 + push.max())):
                return None
            if np.all(new <= z * (1 + 1e-6)):
                return np.maximum(new, 1e-9 * self.x_scale)  # a box has an inside, also where nothing disturbs
            z = new
        return None

    def __call__(self, L: Array, N: Array) -> tuple[float, float, float]:
        """Threshold of given gains.

        Returns
        -------
        worst : float
            Largest threshold over channels and mode sequences, in channel sizes; inf: nothing is detected.
        typical : float
            Geometric mean over the sequences (a mode that is not the worst deserves good gains too).
        width : float
            Ultimate width summed over the states, in units of their ranges.
        """
        t = self.tables(L, N)
        z = self.settled(t)
        if z is None or np.min(t.M_hi) < -1e-6 * max(1.0, np.abs(t.M_hi).max()):
            return np.inf, np.inf, np.inf
        model = ResidualModel.of(self.plant.modes, t)
        last = thresholds(model, self.heads, range(len(self.f_scale)), self.before, (z, z))[:, -1]
        last = last / self.f_scale[:, None]
        last = np.maximum(last, 1e-9)  # without disturbance and noise every fault shows
        typical = np.exp(np.mean(np.log(last))) if np.all(np.isfinite(last)) else np.inf
        return float(last.max()), float(typical), float(np.sum(2 * z / self.x_scale))
