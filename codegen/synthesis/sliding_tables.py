"""Tables of ``mode-sliding``: gains brought to the period, offsets that hold the plant, constants of the loops.

The held gain is ``int_0^T e^{(A - L C) s} ds L``, the matrix of the bounds ``M = e^{A T} - (held gain) C`` of its
rounding; entries below zero become zero. What is lost by that and by every rounding goes into the offsets, over the
declared ranges. ``certify.sliding_claims`` demands all of it again.
"""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

from ..algebra.interval import hull, support
from .mode_tables import Period, directed, exact, parts, top

Array = np.ndarray
#: Room of offsets for double precision here.
SLACK = 1e-9


def held(A: Array, C: Array, L: Array, T: float) -> Array:
    """The gain of a period, (n_x, n_y).

    Parameters
    ----------
    A : ndarray (n_x, n_x), C : ndarray (n_y, n_x), L : ndarray (n_x, n_y)
        Continuous time.
    T : float
        Seconds.
    """
    (n, p), before = L.shape, ctx.prec
    ctx.prec = 160
    try:
        whole = exact(np.zeros((n + p, n + p)))
        closed = exact(A) - exact(L) * exact(C)
        for i in range(n):
            for j in range(n):
                whole[i, j] = closed[i, j]
            for j in range(p):
                whole[i, n + j] = arb(float(L[i, j]))
        return parts((whole * arb(float(T))).exp()).value[:n, n:]
    finally:
        ctx.prec = before


def tables_of(tables_class, plant, gains: dict, chosen: dict, real: str = "float64"):
    """Build the tables.

    Parameters
    ----------
    tables_class : type
        ``SlidingTables``.
    plant : Plant
        Continuous, without parameters (``plant.bounded``), C, D and the bounds of v common to all modes.
    gains : dict
        "L_hi", "L_lo" of ``mode_sliding.theorem12``.
    chosen : dict
        Of ``mode_sliding.settings``.
    real : {"float32", "float64"}

    Returns
    -------
    SlidingTables
    """
    before, ctx.prec = ctx.prec, 160
    try:
        half = [((m.w_hi - m.w_lo) / 2)[:, None] for m in plant.modes]
        middle = [((m.w_hi + m.w_lo) / 2)[:, None] for m in plant.modes]
        period = Period([m.A for m in plant.modes], [m.B for m in plant.modes],
                        [m.Bw @ c for m, c in zip(plant.modes, middle)],
                        [np.abs(m.Bw) @ (h * (1 + 1e-14)) for m, h in zip(plant.modes, half)], np.eye(plant.n_x),
                        plant.sample_period)
        moves = [(parts(period.transition(q)), top(period.reached(q, period.w[q]))[:, 0])
                 for q in range(plant.n_modes)]
    finally:
        ctx.prec = before
    return _frozen(tables_class, plant, gains, chosen, real, moves)


def _frozen(tables_class, plant, gains: dict, chosen: dict, real: str, moves: list):
    """Round to the type and make the offsets sound."""
    first, n, n_u, p = plant.modes[0], plant.n_x, plant.n_u, plant.n_y
    eps, smallest = float(np.finfo(real).eps), float(np.finfo(real).smallest_subnormal)
    ranges = {f"{name}_{side}": directed(value, real, sign, exact_stays=True)
              for name, pair in (*((v, plant.limits(v)) for v in "xuy"), ("x0", (plant.x0_lo, plant.x0_hi)))
              for side, value, sign in zip(("lo", "hi"), pair, (-1, 1))}
    H, D = first.C.astype(real), first.D.astype(real)
    (x_lo, x_hi), (u_lo, u_hi) = plant.limits("x"), plant.limits("u")
    sizes = {k: np.max(np.abs([ranges[f"{k}_lo"], ranges[f"{k}_hi"]]).astype(float), axis=0) for k in ("x", "u", "y")}
    reach = np.maximum(sizes["x"], np.max(np.abs([plant.x0_lo, plant.x0_hi]), axis=0))
    limit = directed(1.5 * reach + 1.5 * (x_hi - x_lo), real, 1)
    far, u = limit.astype(float), sizes["u"]
    noise = hull(first.Dv, first.v_lo, first.v_hi)
    s = sizes["y"] + np.abs(first.D) @ u  # magnitude of y - D u
    lost = (n_u + 4) * eps * s + np.abs(first.D - D) @ u + 4 * smallest  # error of it as read and computed
    terms = np.abs(first.C) @ far + s + np.max(np.abs(noise), axis=0)
    room = lost + np.abs(first.C - H) @ sizes["x"] + (n + 6) * eps * terms
    out: dict[str, list] = {}
    for q, (move, reached) in enumerate(moves):
        A, G = move.value[:, :n], move.value[:, n:n + n_u].astype(real)
        out.setdefault("G", []).append(G)
        for side, sign in (("hi", 1.0), ("lo", -1.0)):
            L = held(plant.modes[q].A, first.C, gains[f"L_{side}"][q], plant.sample_period).astype(real).astype(float)
            M = A - L @ first.C
            least = 4 * eps * (np.abs(A) + np.abs(L) @ np.abs(first.C))
            M = np.where(least < M, M, 0.0).astype(real).astype(float)
            left = [(A - M - L @ first.C, x_lo, x_hi), (move.value[:, n:n + n_u] - G.astype(float), u_lo, u_hi),
                    (-L, *noise)]
            need = sum((support(sign * E, lo, hi) for E, lo, hi in left), reached + sign * move.value[:, -1])
            need = need + move.error @ np.concatenate([sizes["x"], u, [1.0]]) + np.abs(L) @ lost
            terms = np.abs(M) @ far + np.abs(G.astype(float)) @ u + np.abs(L) @ s + np.abs(need)
            need = need + (n + n_u + p + 8) * eps * terms + SLACK * np.abs(need) + 64 * smallest
            for name, value in (("M", M), ("L", L), ("K", H.astype(float) @ L),
                                ("d", directed(sign * need, real, int(sign)))):
                out.setdefault(f"{name}_{side}", []).append(value)
    made = {k: np.array(v).astype(real) for k, v in out.items()}
    fixed = {"H": H, "D": D, "limit": limit, "v_lo": directed(noise[0] - room, real, -1),
             "v_hi": directed(noise[1] + room, real, 1)}
    return tables_class(**made, **fixed, **_loops(plant, made, far, s, chosen, real), **ranges, blank=chosen["blank"],
                        dwell=chosen["dwell"], real=real)


def _loops(plant, made: dict, far: Array, s: Array, chosen: dict, real: str) -> dict:
    """Constants of the super-twisting loops and of the decision."""
    T, slope, C = plant.sample_period, chosen["slope"], np.abs(plant.modes[0].C)
    u = np.max(np.abs(plant.limits("u")), axis=0)
    steps = [C @ (np.abs(M - np.eye(plant.n_x)) @ far + np.abs(G) @ u + np.abs(L) @ s + np.abs(d))
             for k in ("hi", "lo") for M, G, L, d in zip(made[f"M_{k}"], made["G"], made[f"L_{k}"], made[f"d_{k}"])]
    rate, z = 2 * np.max(steps, axis=0) / T, 2 * (s + C @ far)
    ground = T * T * slope
    largest = float(np.max(z + s + C @ far + T * rate))
    points = np.geomspace(ground, max(largest, 4 * ground), max(2, round(np.log10(largest / ground)) + 1))
    numbers = {"z_limit": z, "rate_limit": rate, "period": T, "turn": T * slope, "pull": 2 * T * np.sqrt(slope),
               "ground": ground, "inverse": 1 / ground, "foot": T * np.sqrt(slope), "a": 0.5 / np.sqrt(points),
               "b": 0.5 * np.sqrt(points), "smooth": min(1.0, T / chosen["window"]), "share": chosen["share"]}
    return {k: np.asarray(v, dtype=float).astype(real) for k, v in numbers.items()}
