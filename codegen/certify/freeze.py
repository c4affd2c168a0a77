"""From designed gains to the numbers that the C will hold: round, then make the offsets sound.

Order matters. L and N are rounded first; M and G are then computed from the *rounded* L and N in exact
arithmetic and rounded themselves; the offsets come last, from the exact demands of ``containment``, rounded
outward. Nothing is certified before it has its final value.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq
from scipy.optimize import linprog

from .containment import Containment
from .exact import Q, down, eye, product, rational, up
from .rounding import UNIT

Array = np.ndarray
SIDES = ("hi", "lo")


def nearest(array: Array, real: str) -> Array:
    """Round to the nearest float of the type (ties to even); accepts rational object arrays."""
    array = np.asarray(array)
    if array.dtype != object:
        return array.astype(real)
    flat = [np.float64(float(x)) for x in array.ravel()]
    return np.array(flat, dtype=np.float64).reshape(array.shape).astype(real)


def freeze(tables_class, modes, limits: dict, gains: dict, real: str):
    """Build the tables of an interval observer.

    Parameters
    ----------
    tables_class : type
        ``FramerTables``.
    modes : sequence
        The plant's modes.
    limits : dict
        "x", "x0", "u", "y" -> (lo, hi) arrays.
    gains : dict
        "L_hi", "L_lo", "N_hi", "N_lo" -> ndarray (n_modes, n_x, n_y), float64.
    real : {"float32", "float64"}

    Returns
    -------
    FramerTables
    """
    n = {k: nearest(v, real) for k, v in gains.items()}
    for side in SIDES:
        pairs = [_closed_loop(m, n["L_" + side][q], n["N_" + side][q]) for q, m in enumerate(modes)]
        n["M_" + side] = np.stack([nearest(M, real) for M, _ in pairs])
        n["G_" + side] = np.stack([nearest(G, real) for _, G in pairs])
    for name in ("A", "B", "C", "D"):
        n[name] = nearest(np.stack([getattr(m, name) for m in modes]), real)
    n["x_lo"], n["x_hi"] = _outward(limits["x"], real)
    n["x0_lo"], n["x0_hi"] = _outward(limits["x0"], real)
    for name in ("u", "y"):
        n[name + "_lo"], n[name + "_hi"] = (nearest(b, real) for b in limits[name])
    shape = n["M_hi"].shape[:2]
    for name, size in (("d", shape), ("a", shape), ("c", n["C"].shape[:2])):
        n[name + "_hi"], n[name + "_lo"] = np.zeros(size, real), np.zeros(size, real)
    reach = np.maximum(np.abs(n["x_lo"]), np.abs(n["x_hi"]))
    reach = np.maximum(reach, np.maximum(np.abs(n["x0_lo"]), np.abs(n["x0_hi"])))
    draft = tables_class(real=real, clamp=True, box=reach, **n)
    draft = with_offsets(modes, draft)
    box = invariant_box(draft, reach)
    if box is not None:
        free = _replace(draft, clamp=False, box=box)
        exact = Containment(modes, free)
        free = with_offsets(modes, free, exact)
        if box_holds(free, exact):
            return free
    return draft


def _closed_loop(mode, L: Array, N: Array):
    """Exact T A - L C and T B - L D on rounded gains; entries of M below zero, or of rounding size, become zero.

    What is set to zero goes into the margin, and costs no multiplication.
    """
    real = L.dtype.name
    C, L, N = rational(mode.C), rational(L), rational(N)
    A, NC = rational(mode.A), product(N, C)
    M = product(eye(C.shape[1]) - NC, A) - product(L, C)
    # Where large terms cancel, what is left of size 4 u |terms| is only their rounding.
    size = abs(A) + product(abs(NC), abs(A)) + product(abs(L), abs(C))
    keep = np.vectorize(lambda m, s: m if m > 4 * UNIT[real] * s else fmpq(0), otypes=[object])
    return keep(M, size), product(eye(C.shape[1]) - NC, rational(mode.B)) - product(L, rational(mode.D))


def _outward(pair, real):
    lo, hi = pair
    return (np.array([down(Q(x), real) for x in lo], dtype=real),
            np.array([up(Q(x), real) for x in hi], dtype=real))


def _replace(t, **changes):
    return type(t)(**{**{name: getattr(t, name) for name in t.__dataclass_fields__}, **changes})


def with_offsets(modes, t, exact: Containment | None = None):
    """Return the tables with the smallest sound offsets for their constants and box."""
    exact = exact or Containment(modes, t)
    new = {name + "_" + side: np.array(getattr(t, name + "_" + side)) for name in "dac" for side in SIDES}
    for name, q, side, demands in exact.offsets():
        new[f"{name}_{side}"][q] = [sound_offset(d, t.real) * (1 if side == "hi" else -1) for d in demands]
    return _replace(t, **new)


def sound_offset(demand, real: str) -> float:
    """Smallest outward offset (to a few units in the last place) that meets the demand with its own rounding."""
    offset = up(demand.need, real)
    while (lack := demand.shortfall(Q(offset), real)) > 0:
        # Ask for a little more than is lacking: the offset's own size adds rounding error too.
        offset = up(Q(offset) + lack * fmpq(1025, 1024), real)
    return offset


def invariant_box(t, reach: Array) -> Array | None:
    """Smallest box, at least ``reach``, that no mode lets the framers leave; None if none was found.

    The linear program M_q z + |inputs| + |offset| <= z for all modes and both framers, with room for
    rounding; ``box_holds`` decides exactly afterwards.
    """
    n = len(reach)
    u = np.maximum(np.abs(t.u_lo), np.abs(t.u_hi)).astype(float)
    y = np.maximum(np.abs(t.y_lo), np.abs(t.y_hi)).astype(float)
    rows, rhs = [], []
    for side in SIDES:
        M, G, L, N, d = (np.asarray(getattr(t, k + "_" + side), dtype=float) for k in "MGLNd")
        push = np.abs(G) @ u + (np.abs(L) + np.abs(N)) @ y + np.abs(d)
        for q in range(len(M)):
            rows.append(M[q] * (1 + 1e-5) - np.eye(n))
            rhs.append(-push[q] * (1 + 1e-4))
    floor = reach.astype(float)
    scale = np.maximum(floor, 1e-300)
    A = np.vstack(rows) * scale
    # Rows are scaled too: states may differ by many orders of magnitude.
    weight = np.tile(1.0 / scale, len(A) // n)
    solved = linprog(np.ones(n), A_ub=A * weight[:, None], b_ub=np.concatenate(rhs) * weight, bounds=[(1.0, 1e3)] * n)
    if solved.status != 0:
        return None
    return np.array([up(Q(x), t.real) for x in solved.x * scale * (1 + 1e-6)], dtype=t.real)


def box_holds(t, exact: Containment) -> bool:
    """Exact check that no framer can leave the box: |computed sum| <= box for every mode, row and side.

    ``exact`` may be that of tables with other offsets: these are read from ``t``.
    """
    for q in range(len(exact.modes)):
        for side in SIDES:
            offsets = getattr(t, "d_" + side)[q]
            for i, demand in enumerate(exact.update(q, side)):
                if demand.magnitude(Q(offsets[i]), t.real) > exact.box[i]:
                    return False
    return True
