"""The arrays a synthesis works on, and what it hands over; shared by all designs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..algebra.interval import half

Array = np.ndarray
#: (L, N) -> worst threshold, typical threshold (both in channel sizes), relative width.
Judge = Callable[[Array, Array], tuple[float, float, float]]


@dataclass(frozen=True)
class Problem:
    """A discrete-time switched plant, stacked over its N modes.

    Parameters
    ----------
    names : tuple of str
        Mode names, for messages.
    states : tuple of str
    A : ndarray (N, n_x, n_x), C : ndarray (N, n_y, n_x), Bw : ndarray (N, n_x, n_w), Dv : ndarray (N, n_y, n_v)
    Bf : ndarray (N, n_x, n_f), Df : ndarray (N, n_y, n_f)
    w_half : ndarray (N, n_w), v_half : ndarray (n_v,)
        Half widths of the bounds (v: largest over the modes).
    f_scale : ndarray (n_f,)
        Size against which thresholds of different channels are compared (largest of the declared range).
    tnl : bool
        Whether N is free (TNL structure) or zero (classical).
    tau : float or None
        Declared average dwell time in samples; None for arbitrary switching.
    chatter : float
    """

    names: tuple[str, ...]
    states: tuple[str, ...]
    A: Array
    C: Array
    Bw: Array
    Dv: Array
    Bf: Array
    Df: Array
    w_half: Array
    v_half: Array
    f_scale: Array
    tnl: bool
    tau: float | None
    chatter: float

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of modes, states and outputs."""
        return self.A.shape[0], self.A.shape[1], self.C.shape[1]

    @classmethod
    def of(cls, plant, tnl: bool) -> Problem:
        """Collect from a Plant."""
        stack = {k: np.stack([getattr(m, k) for m in plant.modes]) for k in ("A", "C", "Bw", "Dv", "Bf", "Df")}
        w = np.stack([half(m.w_lo, m.w_hi) for m in plant.modes])
        v = np.max(np.stack([half(m.v_lo, m.v_hi) for m in plant.modes]), axis=0)
        scale = np.array([s if np.isfinite(s := max(abs(f.lo), abs(f.hi))) and s > 0 else 1.0 for f in plant.f])
        dwell = plant.switching.average_dwell
        return cls(tuple(m.name for m in plant.modes), tuple(s.name for s in plant.x), **stack, w_half=w, v_half=v,
                   f_scale=scale, tnl=tnl, tau=None if dwell is None else dwell / plant.sample_period,
                   chatter=plant.switching.chatter)

    def closed_loop(self, L: Array, N: Array) -> tuple[Array, Array]:
        """Return T = I - N C and M = T A - L C, stacked over modes."""
        T = np.eye(self.A.shape[1]) - N @ self.C
        return T, T @ self.A - L @ self.C


@dataclass(frozen=True)
class Candidate:
    """One set of gains with the data of its proof.

    Parameters
    ----------
    label : str
        Criterion and free scalars, for the report.
    L, N : ndarray (N, n_x, n_y)
        Gains of both framers (they are equal at the optimum, see ``linf``).
    proof : dict
        As ``certify.claims.prove`` expects it.
    """

    label: str
    L: Array
    N: Array
    proof: dict


def tidy(gain: Array) -> Array:
    """Set entries that are solver noise (a millionth of the largest) to zero, so that no code is spent on them."""
    size = np.max(np.abs(gain), initial=0.0)
    return np.where(np.abs(gain) < 1e-6 * size, 0.0, gain)
