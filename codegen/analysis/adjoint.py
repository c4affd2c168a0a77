"""Worst-case residual along a mode sequence, by the adjoint recursion.

The residual bounds are affine in initial error, disturbance, noise and fault, so their extremes are found
by carrying the row of C backwards through the modes: at every step each disturbance and noise component
takes the corner that its weight asks for. One noise sample v_k acts twice in a TNL observer (through L at
k, through N at k-1) and once more in the residual; its weights are added *before* the corner is chosen,
so the result is exact, not a sum of separate worst cases.

Everything is vectorised over sequences: arrays carry a leading axis of S mode sequences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra.interval import neg, pos, support

Array = np.ndarray


@dataclass(frozen=True)
class ResidualModel:
    """Float copies of one table and its plant, stacked over modes, ready for the recursion.

    Attributes
    ----------
    M, L, N, T : dict
        Side -> (n_modes, ...) float64.
    TBw, LDv : dict
        Side -> (n_modes, n_x, n_w) and (n_modes, n_x, n_v).
    NDv : dict
        Side -> (n_modes, n_modes, n_x, n_v): N of the first mode, Dv of the one after.
    top : dict
        Side -> (n_modes, n_x): offset, plus what rounding may add to the framer, outward positive.
    """

    M: dict
    L: dict
    N: dict
    T: dict
    TBw: dict
    LDv: dict
    NDv: dict
    top: dict
    C: Array
    c_hi: Array
    c_lo: Array
    c_margin: Array
    Dv: Array
    w_lo: Array
    w_hi: Array
    v_lo: Array
    v_hi: Array
    Bf: Array
    Df: Array

    @classmethod
    def of(cls, modes, t) -> ResidualModel:
        """Build from the plant's modes and a FramerTables."""
        stack = {k: np.stack([getattr(m, k) for m in modes]) for k in
                 ("A", "C", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi", "Bf", "Df")}
        data = {k: {} for k in ("M", "L", "N", "T", "TBw", "LDv", "NDv", "top")}
        for side, sign in (("hi", 1.0), ("lo", -1.0)):
            for k in "MLN":
                data[k][side] = np.asarray(getattr(t, f"{k}_{side}"), dtype=float)
            L, N = data["L"][side], data["N"][side]
            T = np.eye(L.shape[1]) - N @ stack["C"]
            data["T"][side], data["TBw"][side], data["LDv"][side] = T, T @ stack["Bw"], L @ stack["Dv"]
            worst = support(sign * T @ stack["Bw"], stack["w_lo"], stack["w_hi"])
            worst += support(-sign * data["LDv"][side], stack["v_lo"], stack["v_hi"])
            later = [support(-sign * N @ s[0], s[1], s[2]) for s in zip(stack["Dv"], stack["v_lo"], stack["v_hi"])]
            offset = sign * np.asarray(getattr(t, "d_" + side), dtype=float)
            data["top"][side] = 2.0 * offset - worst - np.max(later, axis=0)
            data["NDv"][side] = N[:, None] @ stack["Dv"][None]
        c_hi, c_lo = np.asarray(t.c_hi, float), np.asarray(t.c_lo, float)
        c_margin = np.maximum(c_hi - support(stack["Dv"], stack["v_lo"], stack["v_hi"]),
                              -c_lo - support(-stack["Dv"], stack["v_lo"], stack["v_hi"]))
        return cls(**data, C=stack["C"], c_hi=c_hi, c_lo=c_lo, c_margin=c_margin,
                   **{k: stack[k] for k in ("Dv", "w_lo", "w_hi", "v_lo", "v_hi", "Bf", "Df")})


def corner(weight: Array, lo: Array, hi: Array) -> Array:
    """Maximum of weight @ x over a box, per sequence and row: weight (S, r, c), lo, hi (S, c)."""
    return np.sum(np.where(weight > 0, weight * hi[:, None], weight * lo[:, None]), axis=2)


def extremes(m: ResidualModel, modes: Array, tail_hi: Array, tail_lo: Array) -> tuple[Array, Array]:
    """Suprema of r_hi and of -r_lo at the last sample of each sequence, fault free, for every output.

    Parameters
    ----------
    modes : ndarray (S, K) int
        Mode of each sample; the residual is taken at the last one.
    tail_hi, tail_lo : ndarray (n_x,)
        Bounds on the framer errors at the first sample.

    Returns
    -------
    above, below : ndarray (S, n_y)
    """
    last = modes[:, -1]
    C, Dv = m.C[last], m.Dv[last]
    p = C.shape[1]
    # r_hi = pos(C) e_hi + neg(C) e_lo + c_hi - Dv v ;  -r_lo = neg(C) e_hi + pos(C) e_lo - c_lo + Dv v.
    # Both sides of all outputs are rows of one problem: (S, 2 p, ...).
    up = np.concatenate([pos(C), neg(C)], axis=1)
    low = np.concatenate([neg(C), pos(C)], axis=1)
    v_weight = np.concatenate([-Dv, Dv], axis=1)
    margin = m.c_margin[last]
    total = np.concatenate([m.c_hi[last] + margin, -m.c_lo[last] + margin], axis=1)
    for k in range(modes.shape[1] - 2, -1, -1):
        q, after = modes[:, k], modes[:, k + 1]
        v_weight = v_weight + up @ m.NDv["hi"][q, after] - low @ m.NDv["lo"][q, after]
        total = total + corner(v_weight, m.v_lo[after], m.v_hi[after])
        total = total + act(up, m.top["hi"][q]) + act(low, m.top["lo"][q])
        w_weight = low @ m.TBw["lo"][q] - up @ m.TBw["hi"][q]
        total = total + corner(w_weight, m.w_lo[q], m.w_hi[q])
        v_weight = up @ m.LDv["hi"][q] - low @ m.LDv["lo"][q]
        up, low = up @ m.M["hi"][q], low @ m.M["lo"][q]
    total = total + corner(v_weight, m.v_lo[modes[:, 0]], m.v_hi[modes[:, 0]]) + up @ tail_hi + low @ tail_lo
    return total[:, :p], total[:, p:]


def fault_response(m: ResidualModel, modes: Array, channel: int, onset: int) -> tuple[Array, Array]:
    """Response of r_hi and r_lo at the last sample to a unit step of a fault from sample ``onset`` on.

    Returns
    -------
    g_hi, g_lo : ndarray (S, n_y)
    """
    S, K = modes.shape
    n = m.C.shape[2]
    hi, lo = np.zeros((S, n)), np.zeros((S, n))
    for k in range(max(onset - 1, 0), K - 1):
        q, after = modes[:, k], modes[:, k + 1]
        now, then = float(k >= onset), float(k + 1 >= onset)
        Df, Df_after, Bf = m.Df[q][:, :, channel], m.Df[after][:, :, channel], m.Bf[q][:, :, channel]
        push = {s: now * (act(m.L[s][q], Df) - act(m.T[s][q], Bf)) + then * act(m.N[s][q], Df_after)
                for s in ("hi", "lo")}
        hi = act(m.M["hi"][q], hi) + push["hi"]
        lo = act(m.M["lo"][q], lo) - push["lo"]
    C, Df = m.C[modes[:, -1]], m.Df[modes[:, -1]][:, :, channel] * float(onset < K)
    return act(pos(C), hi) + act(neg(C), lo) - Df, -act(pos(C), lo) - act(neg(C), hi) - Df


def act(A: Array, x: Array) -> Array:
    """Matrix times vector per sequence: (S, r, c) and (S, c) -> (S, r)."""
    return np.einsum("src,sc->sr", A, x)
