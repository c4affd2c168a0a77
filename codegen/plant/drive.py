"""What acts on a continuous plant over one sampling period: disturbances, held faults, inputs that move."""

from __future__ import annotations

import numpy as np
from flint import arb

from .period import TERMS, Period, balls, ceiling, middles, mul, size, upper

Array = np.ndarray


def integral(period: Period, n: int) -> Array:
    """int_0^h e^{Ac s} ds, a ball matrix."""
    return sum((period.weight[k + 1] * period.powers[k][:n, :n] for k in range(period.order + 1)),
               0 * period.Fc[:n, :n])


def held_fault(period: Period, Bf: Array) -> tuple[Array, Array]:
    """Effect of a fault that is held over the period, ``int Phi ds Bf``: float64 matrix, bound on the rest."""
    n = len(Bf)
    whole, plain, Bb = (period.Fb + period.Tb + period.Db)[:n, :n], period.Fb[:n, :n], size(Bf)
    middle, spread = middles(mul(integral(period, n), Bf))
    rest = balls(spread) + period.h * mul(period.tail(period.Fb + period.Tb + period.Db, TERMS - 1)[:n, :n], Bb)
    p_whole, p_plain = Bb, Bb
    for k in range(1, TERMS + 1):
        p_whole, p_plain = mul(whole, p_whole), mul(plain, p_plain)
        rest = rest + period.weight[k + 1] * (p_whole - (p_plain if k <= period.order else 0 * p_plain))
    return middle, ceiling(rest)


def disturbance(plant, mode, period: Period) -> tuple[Array, Array, Array]:
    """[mean; rest] of the disturbance: its matrix and bounds."""
    n, h, weight = plant.n_x, period.h, period.weight
    w_lo, w_hi = balls(mode.w_lo), balls(mode.w_hi)
    half, most = (w_hi - w_lo) / 2, np.array([max(abs(a), abs(b), key=upper) for a, b in zip(w_lo, w_hi)], dtype=object)
    Bw, Ab = balls(mode.Bw), period.Fb[:n, :n]
    whole = (period.Fb + period.Tb + period.Db)[:n, :n]
    gain, spread = middles(mul(integral(period, n), Bw))
    Bb = size(Bw)

    def apply(A: Array, x: Array) -> Array:
        return mul(A, x.reshape(-1, 1)).ravel() if len(x) else np.array([arb(0)] * n, dtype=object)

    rest = apply(balls(spread), most)
    # The mean weighs every instant alike, e^{Ac s} does not: |f - mean f| integrated, f' <= |Ac| e^{|Ac| h} |Bw|.
    term, growth = mul(Ab, Bb), mul(Ab, Bb)
    for k in range(1, TERMS):
        term = mul(Ab, term) * h / k
        growth = growth + term
    tail = period.tail(period.Fb + period.Tb + period.Db, TERMS - 1)[:n, :n]
    growth = growth + mul(tail, mul(Ab, Bb))
    rest = rest + h * h / 4 * apply(growth, half)
    # Parameters away from the middle, and what the truncated integral leaves out.
    p_whole, p_plain, beyond = Bb, Bb, 0 * Bb
    for k in range(1, TERMS + 1):
        p_whole, p_plain = mul(whole, p_whole), mul(Ab, p_plain)
        beyond = beyond + weight[k + 1] * (p_whole - p_plain)
        if k > period.order:
            beyond = beyond + weight[k + 1] * p_plain
    rest = rest + apply(beyond, most) + apply(mul(tail, Bb) * h, most)
    # Inputs that move between samples.
    rates = np.array([arb(float(s.rate)) for s in plant.u], dtype=object)
    if len(rates):
        B_most = (period.Fb + period.Tb + period.Db)[:n, n:]
        term, moved = B_most, 0 * B_most
        for k in range(TERMS):
            moved = moved + weight[k + 2] * term
            term = mul(whole, term)
        moved = moved + mul(tail, B_most) * h * h
        rest = rest + apply(moved, rates)
    box = ceiling(rest)
    Bw_d = np.hstack([gain, np.eye(n)])
    return Bw_d, np.concatenate([mode.w_lo, -box]), np.concatenate([mode.w_hi, box])
