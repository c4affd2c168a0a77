"""A plant whose parameters are bounded by disturbances: what an estimator sees that is given none of them.

``(A0 + sum_j theta_j A_j) x = Am x + d`` with Am at the middle of the bounds of theta and, for every x in its declared
range and every u in its own, ``|d| <= sum_j r_j (|A_j| |x| + |B_j| |u|)``, r_j half the width of the bounds. The middle
is rounded to float64; what that moves is in the bound too. One more disturbance per state then has all of it.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from .model import Mode, Plant, Signal

Array = np.ndarray


#: Inputs that the firmware reads may be off by a rounding to float32.
READ = 1 + 2.0 ** -22


def above(x: Fraction) -> float:
    """The least float64 that is not below a rational number."""
    near = float(x)
    return near if Fraction(near) >= x else float(np.nextafter(near, np.inf))


def bounded(plant: Plant) -> Plant:
    """Return the plant without parameters; the plant itself where it has none.

    Parameters
    ----------
    plant : Plant
        Parameters in A and B alone; x and u with ranges.

    Returns
    -------
    Plant
        Of the same kind, with one disturbance more per state.
    """
    if not plant.theta:
        return plant
    rests = tuple(Signal(f"parameters_{s.name}") for s in plant.x)
    return replace(plant, theta=(), w=(*plant.w, *rests), modes=tuple(_mode(plant, m) for m in plant.modes))


def _mode(plant: Plant, mode: Mode) -> Mode:
    """Middle matrices of a mode, and the bound of the rest."""
    n = plant.n_x
    lo, hi = plant.theta_box(mode)
    most = {"A": np.max(np.abs(plant.limits("x")), axis=0), "B": np.max(np.abs(plant.limits("u")), axis=0) * READ}
    middle, rest = {}, [Fraction(0)] * n
    for name, size in most.items():
        base = getattr(mode, name)
        slopes = mode.theta_terms.get(name, [np.zeros_like(base)] * len(plant.theta))
        middle[name] = base.copy()
        for i in range(n):
            for k in range(base.shape[1]):
                ends = [sum((Fraction(b if (S[i, k] > 0) == up else a) * Fraction(S[i, k]) for a, b, S in
                             zip(lo, hi, slopes)), Fraction(base[i, k])) for up in (True, False)]
                middle[name][i, k] = float(sum(ends) / 2)
                off = max(abs(end - Fraction(middle[name][i, k])) for end in ends)
                rest[i] += off * Fraction(size[k])
    radius = np.array([above(r) for r in rest])
    return replace(mode, A=middle["A"], B=middle["B"], Bw=np.hstack([mode.Bw, np.eye(n)]), theta_terms={},
                   Dw=np.hstack([mode.Dw, np.zeros((plant.n_y, n))]), theta_bounds=None,
                   w_lo=np.concatenate([mode.w_lo, -radius]), w_hi=np.concatenate([mode.w_hi, radius]))
