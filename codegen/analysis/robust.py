"""Surely detected sensor faults where parameters and unknowns move the error recursion itself.

The adjoint of ``adjoint`` follows one recursion; here M(theta) may be another one at every sample and the radii react
to the fault as well. So both are bounded: without a fault the errors stay in their ultimate box, and the shift of both
framers by a unit step fault stays in an interval that is carried forward over all modes and corners of theta::

    shift+  in  M(theta) shift + L(theta) Df + N Df + [-1, 1] R |shift|,      residual shift = C shift - Df

A cut to the declared range can only shorten a shift, so zero joins each interval. With a change of coordinates the
shift is that of z, and ``of_x`` makes that of x of it, from which radii and residual follow. Thresholds are never too
small; a fault on the state (Bf) is not covered and has none.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..algebra.interval import neg, pos, support

Array = np.ndarray


def fault_free(modes, t, tails) -> tuple[Array, Array]:
    """Largest r_hi and -r_lo of each output without a fault, over all modes; ``tails`` bounds both errors."""
    above, below = [], []
    for q, m in enumerate(modes):
        C, (z_hi, z_lo) = m.C, of_x_errors(t, tails)
        most, least = support(m.Dv, m.v_lo, m.v_hi), -support(-m.Dv, m.v_lo, m.v_hi)
        c_hi, c_lo = np.asarray(t.c_hi[q], float), np.asarray(t.c_lo[q], float)
        margin = np.maximum(c_hi - most, least - c_lo)
        above.append(pos(C) @ z_hi + neg(C) @ z_lo + c_hi - least + margin)
        below.append(pos(C) @ z_lo + neg(C) @ z_hi - c_lo + most + margin)
    return np.max(above, axis=0), np.max(below, axis=0)


def of_x(t, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Interval of the shift of x for that of the state of the recursion."""
    if t.change is None:
        return lo, hi
    X = t.change.X.astype(float)
    return pos(X) @ lo - neg(X) @ hi, pos(X) @ hi - neg(X) @ lo


def of_x_errors(t, tails) -> tuple[Array, Array]:
    """Bounds on both errors of x for those of the state; the offsets b count twice, as they cover their rounding."""
    if t.change is None:
        return tails
    X, (z_hi, z_lo) = t.change.X.astype(float), tails
    return (pos(X) @ z_hi + neg(X) @ z_lo + 2 * abs(t.change.b_hi.astype(float)),
            pos(X) @ z_lo + neg(X) @ z_hi + 2 * abs(t.change.b_lo.astype(float)))


def steps_of(t) -> list[tuple[int, Array, Array, Array, Array]]:
    """(mode, M, L, N, R) for every mode and corner of theta, float64."""
    out = []
    for q in range(len(t.M_hi)):
        M, L, N = (np.asarray(getattr(t, f"{k}_hi")[q], float) for k in "MLN")
        vary = t.vary
        for corner in product(*zip(vary.theta_lo[q].astype(float), vary.theta_hi[q].astype(float))):
            at = np.array(corner).reshape(-1, 1, 1)
            M_at, L_at = (base + np.sum(at * slopes[q].astype(float), axis=0)
                          for base, slopes in ((M, vary.M), (L, vary.L)))
            out.append((q, M_at, L_at, N, vary.R[q].astype(float)))
    return out


def thresholds(modes, t, tails, channel: int, within: int) -> tuple[float, ...]:
    """Smallest surely detected step of one channel for delays 0..within; inf where there is none.

    Parameters
    ----------
    modes : sequence
        Of the plant as the firmware sees it.
    t : FramerTables
    tails : (ndarray (n_x,), ndarray (n_x,))
        Ultimate bounds of both errors.
    channel : int
    within : int

    Returns
    -------
    tuple of float
    """
    if any(np.any(m.Bf[:, channel]) for m in modes):
        return (np.inf,) * (within + 1)
    above, below = fault_free(modes, t, tails)
    steps = steps_of(t)
    Df = [m.Df[:, channel] for m in modes]
    onset = [np.zeros(len(t.box))] + [N @ d for _, _, _, N, _ in steps for d in Df]
    lo, hi = np.min(onset, axis=0), np.max(onset, axis=0)
    best, out = {1: np.inf, -1: np.inf}, []
    for _ in range(within + 1):
        found = {1: np.inf, -1: np.inf}
        x_lo, x_hi = of_x(t, lo, hi)
        g_hi = np.max([pos(m.C) @ x_hi - neg(m.C) @ x_lo - d for m, d in zip(modes, Df)], axis=0)
        g_lo = np.min([pos(m.C) @ x_lo - neg(m.C) @ x_hi - d for m, d in zip(modes, Df)], axis=0)
        with np.errstate(divide="ignore"):
            down = np.where(g_hi < 0, 1.0 / np.maximum(-g_hi, 1e-300), np.inf)
            rise = np.where(g_lo > 0, 1.0 / np.maximum(g_lo, 1e-300), np.inf)
        found[1] = np.min(np.minimum(above * down, below * rise))
        found[-1] = np.min(np.minimum(above * rise, below * down))
        best = {s: min(best[s], found[s]) for s in best}
        out.append(float(max(best.values())) * (1 + 1e-6))
        new_lo, new_hi = [np.zeros(len(lo))], [np.zeros(len(lo))]
        for q, M, L, N, R in steps:
            for later in Df:
                push, apart = L @ Df[q] + N @ later, R @ np.maximum(-x_lo, x_hi)
                new_lo.append(pos(M) @ lo - neg(M) @ hi + push - apart)
                new_hi.append(pos(M) @ hi - neg(M) @ lo + push + apart)
        lo, hi = np.min(new_lo, axis=0), np.max(new_hi, axis=0)
    return tuple(out)
