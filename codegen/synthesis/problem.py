"""The arrays a synthesis works on, and what it hands over; shared by all designs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

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
    A_theta : tuple over modes of ndarray (J + products, n_x, n_x)
        Slopes in the measured parameters and their products; empty without them, as are the following.
    products : int
        How many of them are products; gains do not depend on these.
    A_unc : tuple over modes of ndarray (S, n_x, n_x), A_rad : ndarray (N, n_x, n_x)
        Unknowns: x+ gains sum_l s_l A_unc[l] x with |s_l| <= 1, and anything within A_rad |x|.
    corners : tuple over modes of ndarray (2^(J + products), J + products)
        Corners of the box of the measured parameters and products.
    u_push : tuple over modes of ndarray (S + n_x, n_x)
        Largest effect of each unknown through B, and of the box of B, over the range of u.
    x_max : ndarray (n_x,)
        Largest magnitude of the declared range of x.
    apart : tuple over modes of tuple of (ndarray (n_x, n_x), ndarray (n_x,))
        Where the mode is told late: for each other mode the difference of A (at the middle of theta), and the largest
        difference of B u. Empty otherwise.
    split : bool
        Entries of T A - L C may be negative; they then take the opposite bound.
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
    A_theta: tuple[Array, ...] = ()
    products: int = 0
    A_unc: tuple[Array, ...] = ()
    A_rad: Array | None = None
    corners: tuple[Array, ...] = ()
    u_push: tuple[Array, ...] = ()
    x_max: Array | None = None
    apart: tuple[tuple[tuple[Array, Array], ...], ...] = ()
    split: bool = False

    @property
    def parameters(self) -> int:
        """Number of measured parameters, on which gains may depend."""
        return self.A_theta[0].shape[0] - self.products if self.A_theta else 0

    def at(self, q: int):
        """Yield (corner of theta, A at the corner) of a mode; the one empty corner where nothing is measured."""
        for corner in self.corners[q] if self.parameters else np.zeros((1, 0)):
            yield corner, self.A[q] + np.einsum("j,jab->ab", corner, self.A_theta[q]) if len(corner) else self.A[q]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of modes, states and outputs."""
        return self.A.shape[0], self.A.shape[1], self.C.shape[1]

    @classmethod
    def of(cls, plant, tnl: bool, split: bool = False) -> Problem:
        """Collect from a Plant (as the firmware sees it)."""
        plant = plant.observed
        stack = {k: np.stack([getattr(m, k) for m in plant.modes]) for k in ("A", "C", "Bw", "Dv", "Bf", "Df")}
        w = np.stack([half(m.w_lo, m.w_hi) for m in plant.modes])
        v = np.max(np.stack([half(m.v_lo, m.v_hi) for m in plant.modes]), axis=0)
        scale = np.array([s if np.isfinite(s := max(abs(f.lo), abs(f.hi))) and s > 0 else 1.0 for f in plant.f])
        dwell = plant.switching.average_dwell
        vary = _vary(plant) if hasattr(plant.modes[0], "A_unc") else {}
        return cls(tuple(m.name for m in plant.modes), tuple(s.name for s in plant.x), **stack, w_half=w, v_half=v,
                   f_scale=scale, tnl=tnl, tau=None if dwell is None else dwell / plant.sample_period,
                   chatter=plant.switching.chatter, split=split, **vary)

    def closed_loop(self, L: Array, N: Array) -> tuple[Array, Array]:
        """Return T = I - N C and M = T A - L C, stacked over modes."""
        T = np.eye(self.A.shape[1]) - N @ self.C
        return T, T @ self.A - L @ self.C


def _vary(plant) -> dict:
    """What parameters and unknowns add to the arrays."""
    x_max, u_max = (np.max(np.abs(plant.limits(v)), axis=0) for v in "xu")
    push = tuple(np.vstack([np.abs(F) @ u_max for F in m.B_unc] + [np.diag(m.B_rad @ u_max)]) for m in plant.modes)
    middles = []
    for m in plant.modes:
        at = np.sum(m.box, axis=0) / 2
        middles.append((m.A + np.tensordot(at, m.A_theta, 1), m.B + np.tensordot(at, m.B_theta, 1)))
    apart = tuple(tuple((A - a, np.abs(B - b) @ u_max) for r, (a, b) in enumerate(middles) if r != q)
                  for q, (A, B) in enumerate(middles)) if plant.switching.late else ()
    corners = tuple(np.array(list(product(*zip(*m.box)))) for m in plant.modes)
    return {"A_theta": tuple(m.A_theta for m in plant.modes), "products": len(plant.modes[0].products),
            "A_unc": tuple(m.A_unc for m in plant.modes),
            "A_rad": np.stack([m.A_rad for m in plant.modes]), "corners": corners, "u_push": push, "x_max": x_max,
            "apart": apart}


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
    L_theta : ndarray (N, J, n_x, n_y) or None
        Slopes of L in the measured parameters; None for a plant with constant matrices.
    R : ndarray (n_x, n_x) or None
        Change of coordinates z = R x; None without.
    """

    label: str
    L: Array
    N: Array
    proof: dict
    L_theta: Array | None = None
    R: Array | None = None


def tidy(gain: Array) -> Array:
    """Set entries that are solver noise (a millionth of the largest) to zero, so that no code is spent on them."""
    size = np.max(np.abs(gain), initial=0.0)
    return np.where(np.abs(gain) < 1e-6 * size, 0.0, gain)


def slopes(problem: Problem, solved: dict) -> Array | None:
    """Slopes of L for a Candidate: None for a plant with constant matrices."""
    if problem.x_max is None:
        return None
    modes, n, p = problem.sizes
    steps = solved.get("L_theta")
    steps = np.zeros((modes, 0, n, p)) if steps is None else steps
    return np.array([[tidy(g) for g in row] for row in steps]).reshape(modes, problem.parameters, n, p)


def smaller(solve: Callable[[float], dict | None], least: float) -> tuple[float, ...]:
    """Rates below ``least`` at which a design exists: a plant that is sampled fast decays little per sample.

    Parameters
    ----------
    solve : callable
        Design at a rate, None where there is none.
    least : float
        Smallest rate that was tried without success.

    Returns
    -------
    tuple of float
        Empty where nothing was found down to a 16000th of it.
    """
    rate = least
    for _ in range(14):
        rate /= 2
        if solve(rate) is not None:
            return tuple(rate * share for share in (1.8, 1.5, 1.25, 1.0, 0.7, 0.4, 0.2))
    return ()
