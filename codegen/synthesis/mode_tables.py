"""Tables of the mode estimator ``mode-set``: sampled matrices, and what a switch within a period can add.

Coordinates S x are chosen here, and what ``mode_period`` encloses is rounded to the type of the C.
"""

from __future__ import annotations

import numpy as np
from flint import ctx
from scipy.optimize import linprog

from ..algebra.interval import hull
from ..errors import DesignError
from .mode_period import Parts, Period, Step, exact, magnitude, parts, top

Array = np.ndarray
#: Largest |A| T: what a switch adds is bounded by e^(|A| T).
FASTEST = 40.0


def coordinates(C: Array, A) -> Array:
    """S with C as its first rows, the rest such that it contracts by itself in every mode, where that can be.

    Parameters
    ----------
    C : ndarray (n_y, n_x)
    A : sequence of ndarray (n_x, n_x)
        Continuous time, one per mode; of a discrete plant A - I.

    Returns
    -------
    ndarray (n_x, n_x)

    Raises
    ------
    DesignError
        C has dependent rows.
    """
    p, n = C.shape
    if np.linalg.matrix_rank(C) < p:
        raise DesignError(f"mode-set: C has dependent rows (rank {np.linalg.matrix_rank(C)}, expected {p}). Leave the "
                          "redundant outputs out.")
    if p == n:
        return C.copy()
    # Unit rows where that is regular: they keep the states readable.
    rows: list[Array] = []
    for e in np.eye(n)[::-1]:
        if len(rows) < n - p and np.linalg.matrix_rank(np.vstack([C, e, *rows])) == p + 1 + len(rows):
            rows.insert(0, e)
    N0 = np.array(rows)
    R = np.linalg.inv(np.vstack([C, N0]))[:, p:]
    K = slow_gain([N0 @ M @ R for M in A], [C @ M @ R for M in A])
    return np.vstack([C, N0 - K @ C])


def slow_gain(own: list[Array], seen: list[Array]) -> Array:
    """K with the smallest row measure of own - K seen over all modes; zero where zero contracts already."""
    m, p = own[0].shape[0], seen[0].shape[0]

    def measure(K: Array) -> float:
        parts = [a - K @ c for a, c in zip(own, seen)]
        return max(float(np.max(np.diag(M) + np.abs(M).sum(axis=1) - np.abs(np.diag(M)))) for M in parts)

    zero = np.zeros((m, p))
    if measure(zero) < 0:
        return zero
    out = zero.copy()
    for row in range(m):  # min t: (a - k c)_rr + sum |off-diagonal| <= t in every mode, variables [k, s, t]
        A, b = [], []
        for a, c in zip(own, seen):
            total = np.zeros(p + m + 1)
            total[:p], total[-1] = -c[:, row], -1.0
            total[p:p + m] = [float(j != row) for j in range(m)]
            A.append(total)
            b.append(-a[row, row])
            for j in range(m):
                for sign in (1.0, -1.0):
                    line = np.zeros(p + m + 1)
                    line[:p], line[p + j] = -sign * c[:, j], -1.0
                    A.append(line)
                    b.append(-sign * a[row, j])
        cost = np.zeros(p + m + 1)
        cost[-1] = 1.0
        # Sizes of the slacks are per mode; one set for all modes is enough for a bound.
        found = linprog(cost, A_ub=np.array(A), b_ub=np.array(b),
                        bounds=[(-1e3, 1e3)] * p + [(0, None)] * m + [(None, None)])
        if found.success:
            out[row] = found.x[:p]
    return out if measure(out) < measure(zero) else zero


def tables_of(tables_class, plant, ages: int, real: str = "float64", S: Array | None = None):
    """Build the tables of a plant.

    Parameters
    ----------
    tables_class : type
        ``ModeTables``.
    plant : Plant
        Without parameters, C, D and the bounds of v common to all modes.
    ages : int
        Oldest age M.
    real : {"float32", "float64"}
    S : ndarray (n_x, n_x) or None
        Coordinates, C first; None: ``coordinates``.

    Returns
    -------
    ModeTables

    Raises
    ------
    DesignError
        The plant is not of this kind.
    """
    check(plant)
    first = plant.modes[0]
    if plant.theta:
        raise DesignError(f"{plant.name}: mode-set reads no parameters (found {len(plant.theta)}). Bound them first.")
    drift = [m.A - (plant.kind == "discrete") * np.eye(plant.n_x) for m in plant.modes]
    S = coordinates(first.C, drift) if S is None else np.asarray(S, dtype=float)
    before, ctx.prec = ctx.prec, 160
    try:
        half = [((m.w_hi - m.w_lo) / 2)[:, None] for m in plant.modes]
        middle = [((m.w_hi + m.w_lo) / 2)[:, None] for m in plant.modes]
        kind = Period if plant.kind == "continuous" else Step
        period = kind([m.A for m in plant.modes], [m.B for m in plant.modes],
                      [m.Bw @ c for m, c in zip(plant.modes, middle)],
                      [np.abs(m.Bw) @ (h * (1 + 1e-14)) for m, h in zip(plant.modes, half)], S, plant.sample_period)
        return _rounded(tables_class, plant, period, ages, real, S)
    finally:
        ctx.prec = before


def check(plant, method: str = "mode-set") -> None:
    """Refuse a plant that the estimator does not take, saying why.

    Raises
    ------
    DesignError
    """
    first = plant.modes[0]
    if method == "mode-sliding" and plant.kind != "continuous":
        raise DesignError(f"{plant.name}: {method} needs a continuous plant (found {plant.kind}): the switch falls "
                          "inside a period. State the plant in continuous time.")
    for m in plant.modes:
        moves = float(np.max(np.abs(m.A).sum(axis=1))) * plant.sample_period
        if plant.kind == "continuous" and not moves <= FASTEST:
            raise DesignError(f'{plant.name}: {method} needs a sampling period that the modes do not outrun (mode '
                              f'"{m.name}" has |A| T = {moves:.3g}, expected at most {FASTEST:g}). Sample faster.')
        if set(m.theta_terms) - {"A", "B"}:
            raise DesignError(f'{plant.name}: {method} needs parameters in A and B alone (mode "{m.name}" has one in '
                              f"{sorted(set(m.theta_terms) - {'A', 'B'})[0]}). Bound it by w or v.")
    if any(np.any(m.Dw) for m in plant.modes):
        raise DesignError(f"{plant.name}: {method} needs disturbances that are not in y (found Dw that is not zero). "
                          "Bound that part by v.")
    for m in plant.modes[1:]:
        for name in ("C", "D", "Dv", "v_lo", "v_hi"):
            if not np.array_equal(getattr(m, name), getattr(first, name)):
                raise DesignError(f'{plant.name}: {method} needs {name} common to all modes (mode "{m.name}" has '
                                  "its own). Widen the noise to cover both.")
    for vector in "xuy":
        for s in getattr(plant, vector):
            if not np.isfinite(s.lo) or not np.isfinite(s.hi):
                raise DesignError(f'{plant.name}: {method} needs a range of "{s.name}" in signals.{vector}. Add it.')
    if any(np.isfinite(s.rate) and s.rate > 0 for s in plant.u):
        raise DesignError(f"{plant.name}: {method} needs inputs held between samples (found a rate).")


def _rounded(tables_class, plant, period: Period, ages: int, real: str, S: Array):
    """Round to the type; every rounding, of constants and of the step itself, goes into the reaches."""
    n, n_u, N = plant.n_x, plant.n_u, plant.n_modes
    eps = float(np.finfo(real).eps)
    first = plant.modes[0]
    (lo, hi), start = hull(S, *plant.limits("x")), hull(S, plant.x0_lo, plant.x0_hi)
    reach = np.max(np.abs([lo, hi, *start]), axis=0)
    limit = directed(1.5 * reach + 1.5 * (hi - lo), real, 1)  # boxes may be wider than the ranges
    ranges = {f"{name}_{side}": directed(value, real, sign, exact_stays=True)
              for name, pair in (*((v, plant.limits(v)) for v in "xuy"), ("x0", (plant.x0_lo, plant.x0_hi)))
              for side, value, sign in zip(("lo", "hi"), pair, (-1, 1))}
    x, u = limit.astype(float), np.max(np.abs([ranges["u_lo"], ranges["u_hi"]]), axis=0).astype(float)
    size = np.concatenate([x, u, [1.0]])
    terms = 2 * (n + n_u) + 12
    # Of what a switch within a period adds: another proof encloses the period less closely.
    least = eps**2 * limit.astype(float) * (plant.kind == "continuous")
    tiny = 4 * terms * float(np.finfo(real).smallest_subnormal)  # products may be too small for their last digits
    out = {"Phi": np.zeros((N, n, n)), "Gamma": np.zeros((N, n, n_u)), "shift": np.zeros((N, n)),
           "reach": np.zeros((N, n)), "birth": np.zeros((N, N, n)), "J": np.zeros((N, N, n, n)),
           "J_u": np.zeros((N, N, n, n_u)), "J_shift": np.zeros((N, N, n)), "J_radius": np.zeros((N, N, n, n)),
           "J_u_radius": np.zeros((N, N, n, n_u)), "J_reach": np.zeros((N, N, n))}

    def kept(found: Parts) -> tuple[Array, Array]:
        value = found.value.astype(real).astype(float)
        return value, found.error + np.abs(found.value - value) + terms * eps * np.abs(value)

    for q in range(N):
        value, error = kept(parts(period.transition(q)))
        out["Phi"][q], out["Gamma"][q], out["shift"][q] = value[:, :n], value[:, n:n + n_u], value[:, -1]
        lost = error @ size
        out["reach"][q] = (top(period.reached(q, period.w[q]))[:, 0] + lost) * (1 + 8 * eps) + tiny
        for i in range(N):
            if i != q:
                out["birth"][i, q] = (top(period.reached(q, period.largest(i, q)))[:, 0] + lost) * (1 + 8 * eps) + tiny
    for i in range(N):
        for j in range(N):
            if i == j:
                continue
            found, later = period.jump(i, j)
            value, error = kept(found)
            out["J"][i, j], out["J_u"][i, j], out["J_shift"][i, j] = value[:, :n], value[:, n:n + n_u], value[:, -1]
            room = 1 + terms * eps
            out["J_radius"][i, j], out["J_u_radius"][i, j] = error[:, :n] * room, error[:, n:n + n_u] * room
            out["J_reach"][i, j] = np.maximum((later + error[:, -1]) * room + tiny, least)
            # Sums of a jump round too; what is kept for those of the mode alone has room for as much as is in them.
            jump = np.abs(out["J"][i, j]) @ x + np.abs(out["J_u"][i, j]) @ u + np.abs(out["J_shift"][i, j])
            jump += out["J_radius"][i, j] @ x + out["J_u_radius"][i, j] @ u + out["J_reach"][i, j]
            base = np.abs(np.column_stack([out[name][j] for name in ("Phi", "Gamma", "shift")])) @ size
            out["birth"][i, j] += terms * eps * np.maximum(0.3 * jump - 0.7 * base, 0)
    noise = hull(first.Dv, first.v_lo, first.v_hi)
    y = np.abs(S[:plant.n_y]) @ np.max(np.abs(plant.limits("x")), axis=0) + np.max(np.abs(noise), axis=0)
    slack = (n_u + 6) * eps * (y + 3 * np.abs(first.D) @ u) + np.abs(first.D - first.D.astype(real)) @ u + tiny
    slack = slack * (1 + 2 * (n_u + 6) * eps)  # no noise leaves room for higher orders, or for these roundings
    share = (n + n_u + 8) * eps  # of C x and faults: what cuts may be off by is less than the noise
    f = np.max(np.abs(plant.limits("f")), axis=0)
    seen = np.max(np.abs([lo, hi]), axis=0)[:plant.n_y] + np.abs(first.Df) @ np.where(np.isfinite(f), f, 0.0)
    slack = np.maximum(slack, share * (1 + 10 * share) * seen - np.max(np.abs(noise), axis=0))
    outward = {"v_lo": noise[0] - slack, "v_hi": noise[1] + slack}
    outward |= {"start_lo": start[0], "start_hi": start[1], "wide_lo": lo, "wide_hi": hi}
    for name, value in outward.items():
        outward[name] = directed(value, real, -1 if name.endswith("lo") else 1)
    for name in ("reach", "birth", "J_reach", "J_radius", "J_u_radius"):
        out[name] = directed(out[name], real, 1)
    inverse = np.linalg.inv(S).astype(real).astype(float)
    lost = top(magnitude(exact(inverse) * period.S - exact(np.eye(n)))) @ np.max(np.abs(plant.limits("x")), axis=0)
    room = directed(lost + tiny + terms * eps * (np.abs(inverse) @ x), real, 1)
    fixed = {"S": S, "S_inverse": inverse.astype(real), "x_room": room, "D": first.D.astype(real), "limit": limit}
    return tables_class(**fixed, **ranges, ages=ages, real=real,
                        **{k: v.astype(real) for k, v in (out | outward).items()})


def directed(value: Array, real: str, sign: int, exact_stays: bool = False) -> Array:
    """Round to the type, away in the given direction; zeros stay, and so do numbers of the type where told."""
    rounded = np.asarray(value).astype(real)
    beyond = np.nextafter(rounded, np.array(sign * np.inf, dtype=real))
    stays = (rounded == value) if exact_stays else (rounded == 0)
    good = (sign * rounded.astype(float) >= sign * np.asarray(value)) & exact_stays
    return np.where(stays | good, rounded, beyond)
