"""From designed gains to the numbers that the C will hold: round, then make the offsets sound.

Order matters. L and N are rounded first; M and G are then computed from the *rounded* L and N in exact
arithmetic and rounded themselves; the offsets come last, from the exact demands of ``containment``, rounded
outward. Nothing is certified before it has its final value.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq
from scipy.optimize import linprog

from .containment import Containment, offset, sup
from .exact import Q, down, eye, inverse, product, rational, up
from .rounding import UNIT
from .variation import Affine, computed_box, exact_mode, noise_size, pace_needed

Array = np.ndarray
SIDES = ("hi", "lo")


def nearest(array: Array, real: str) -> Array:
    """Round to the nearest float of the type (ties to even); accepts rational object arrays."""
    array = np.asarray(array)
    if array.dtype != object:
        return array.astype(real)
    flat = [np.float64(float(x)) for x in array.ravel()]
    return np.array(flat, dtype=np.float64).reshape(array.shape).astype(real)


def limits(plant) -> dict:
    """Declared ranges and initial box of a plant: "x", "u", "y", "x0", each (lo, hi)."""
    return {k: plant.limits(k) for k in ("x", "u", "y")} | {"x0": (plant.x0_lo, plant.x0_hi)}


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
        "L_hi", "L_lo", "N_hi", "N_lo" -> ndarray (n_modes, n_x, n_y), float64; for a plant with parameters or unknowns
        also "L_theta" (n_modes, J, n_x, n_y), "columns", "late", "midpoint" of ``Variation``, "split" (negative
        entries of M are wanted), and for a change of coordinates "R" (n_x, n_x) of z = R x.
    real : {"float32", "float64"}

    Returns
    -------
    FramerTables
    """
    if "L_theta" in gains:
        return freeze_varying(tables_class, modes, limits, gains, real)
    n = {k: nearest(v, real) for k, v in gains.items()}
    for side in SIDES:
        pairs = [_closed_loop(m, n["L_" + side][q], n["N_" + side][q]) for q, m in enumerate(modes)]
        n["M_" + side] = np.stack([nearest(M, real) for M, _ in pairs])
        n["G_" + side] = np.stack([nearest(G, real) for _, G in pairs])
    n |= plain_tables(modes, limits, real)
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


def plain_tables(modes, limits: dict, real: str) -> dict[str, Array]:
    """Open-loop matrices and ranges, rounded, and offsets still zero."""
    n = {name: nearest(np.stack([getattr(m, name) for m in modes]), real) for name in ("A", "B", "C", "D")}
    n["x_lo"], n["x_hi"] = _outward(limits["x"], real)
    n["x0_lo"], n["x0_hi"] = _outward(limits["x0"], real)
    for name in ("u", "y"):
        n[name + "_lo"], n[name + "_hi"] = (nearest(b, real) for b in limits[name])
    shape = n["A"].shape[:2]
    for name, size in (("d", shape), ("a", shape), ("c", n["C"].shape[:2])):
        n[name + "_hi"], n[name + "_lo"] = np.zeros(size, real), np.zeros(size, real)
    return n


def freeze_varying(tables_class, modes, limits: dict, gains: dict, real: str):
    """As ``freeze`` for a plant with measured parameters or bounded unknowns: both framers have the same gains."""
    L, N, slopes = (nearest(gains[k], real) for k in ("L_hi", "N_hi", "L_theta"))
    n = {"L_hi": L, "L_lo": L, "N_hi": N, "N_lo": N} | plain_tables(modes, limits, real)
    Z = None if gains.get("R") is None else nearest(gains["R"], real)
    if Z is not None:  # the gains of z = Z x
        L = np.stack([nearest(product(rational(Z), rational(x)), real) for x in gains["L_hi"]])
        n["L_hi"] = n["L_lo"] = L
    parts = [vary_mode(m, L[q], N[q], slopes[q], n, gains["split"], real, Z) for q, m in enumerate(modes)]
    for name in ("M", "G"):
        n[name + "_hi"] = n[name + "_lo"] = np.stack([p[name] for p in parts])
    n["A"], n["B"] = (np.stack([p["blind_" + name] for p in parts]) for name in "AB")
    variation = tables_class.__dataclass_fields__["vary"].metadata["type"]
    known = {"midpoint": bool(gains["midpoint"]), "late": bool(gains["late"]), "columns": tuple(gains["columns"]),
             "products": getattr(modes[0], "products", ()), **pacing(modes, real)}
    for name in ("R_pace", "S_pace") if known.get("paced") else ():
        known[name] = np.stack([p[name] for p in parts])
    vary = variation(**known, L=slopes, **{
        key: np.stack([p[key] for p in parts]) for key in ("theta_lo", "theta_hi", "R", "S", "E", "Ra", "Sa")},
        M=np.stack([p["M_theta"] for p in parts]), G=np.stack([p["G_theta"] for p in parts]))
    reach = np.maximum(np.maximum(np.abs(n["x_lo"]), np.abs(n["x_hi"])),
                       np.maximum(np.abs(n["x0_lo"]), np.abs(n["x0_hi"])))
    changed = tables_class.__dataclass_fields__["change"].metadata["type"]
    change = None if Z is None else coordinates(changed, Z, n, real)
    return with_offsets(modes, tables_class(real=real, clamp=True, box=reach, vary=vary, change=change, **n))


def coordinates(change_class, Z: Array, n: dict, real: str):
    """Tables of z = Z x, offsets still zero: the rounded inverse, and what Z makes of the range of x."""
    lo, hi = rational(n["x_lo"]), rational(n["x_hi"])
    z_lo = np.array([down(-x, real) for x in sup(-rational(Z), lo, hi)], dtype=real)
    z_hi = np.array([up(x, real) for x in sup(rational(Z), lo, hi)], dtype=real)
    none = np.zeros(len(Z), real)
    return change_class(Z=Z, X=nearest(inverse(rational(Z)), real), e_lo=none, e_hi=none, b_lo=none, b_hi=none,
                        z_lo=z_lo, z_hi=z_hi, box=np.maximum(abs(z_lo), abs(z_hi)))


def vary_mode(mode, L: Array, N: Array, slopes: Array, n: dict, split: bool, real: str,
              Z: Array | None = None) -> dict[str, Array]:
    """Tables of one mode: closed loop, radii, box of theta, prediction at the middle of the box."""
    p = exact_mode(mode, mode.B.shape)
    L0, N, Lj = rational(L), rational(N), [rational(x) for x in slopes]
    T = eye(len(p["A"])) - product(N, p["C"])
    back = eye(len(T))
    if Z is not None:
        T, back, split = product(rational(Z), T), inverse(rational(Z)), False
    lo = [down(x, real) for x in p["theta_lo"]]
    hi = [up(x, real) for x in p["theta_hi"]]
    box = computed_box(*(rational(np.array(b)) for b in (lo, hi)), p["products"], real)
    Lj += [abs(L0) * 0] * (len(box[0]) - len(Lj))
    size = abs(p["A"]) + product(abs(product(N, p["C"])), abs(p["A"])) + product(abs(L0), abs(p["C"]))
    if Z is not None:  # a search leaves more than rounding of what ought to be zero
        size = product(product(abs(T), abs(p["A"])) + product(abs(L0), abs(p["C"])), abs(back))
        size = size * max(fmpq(1), fmpq(1, 2**32) / UNIT[real])
    reach = [max(abs(a), abs(b)) for a, b in zip(*box)]
    for r, a, g in zip(reach, p["A_theta"], Lj):
        size = size + r * (abs(a) + product(abs(product(N, p["C"])), abs(a)) + product(abs(g), abs(p["C"])))
    M = Affine(product(product(T, p["A"]) - product(L0, p["C"]), back),
               [product(T, a) - product(g, p["C"]) for a, g in zip(p["A_theta"], Lj)], *box)
    out = closed_entries(M, size, split, real)
    out["G"] = nearest(product(T, p["B"]) - product(L0, p["D"]), real)
    out["G_theta"] = stacked([product(T, b) - product(g, p["D"]) for b, g in zip(p["B_theta"], Lj)], mode.B.shape, real)
    out["theta_lo"], out["theta_hi"] = np.array(lo, dtype=real), np.array(hi, dtype=real)
    weight_x = rational(np.maximum(np.abs(n["x_lo"]), np.abs(n["x_hi"])))
    weight_u = rational(np.maximum(np.abs(n["u_lo"]), np.abs(n["u_hi"])))
    A_mid = Affine(p["A"], p["A_theta"], p["box_lo"], p["box_hi"])
    B_mid = Affine(p["B"], p["B_theta"], p["box_lo"], p["box_hi"])
    paced = pacing([mode], real).get("paced", ())
    out["blind_A"], out["blind_B"] = nearest(A_mid.middle, real), nearest(B_mid.middle, real)
    for names, T_of, extra in ((("R", "S"), T, (0, 0)), (("Ra", "Sa"), eye(len(T)), (A_mid.radius, B_mid.radius))):
        for name, key, weight, more in zip(names, "AB", (weight_x, weight_u), extra):
            total = product(abs(T_of), p[f"{key}_rad"]) + more
            apart = {j: abs(total) * 0 for j in paced}
            for of, F in zip(p["paced"], p[f"{key}_unc"]):
                if of in paced and name in "RS":
                    apart[of] = apart[of] + abs(product(T_of, F))
                else:
                    total = total + abs(product(T_of, F))
            rows = abs(T_of) @ weight_x if Z is not None else weight_x
            out[name] = worthwhile(total, weight, rows, real)
            if paced and name in "RS":
                out[f"{name}_pace"] = np.stack([worthwhile(apart[j], weight, rows, real) for j in paced])
    noise = noise_size(p)
    moved = np.any(np.asarray(slopes) != 0, axis=0) if len(slopes) else np.zeros(L.shape, dtype=bool)
    out["E"] = np.array([[up(noise[j], real) if moved[i, j] else 0.0 for j in range(L.shape[1])]
                         for i in range(len(L))], dtype=real)
    return out


def pacing(modes, real: str) -> dict:
    """Which parameters are paced, and the constants of it ("paced", "pace", "top"); empty where none is.

    ``top`` is searched with ``pace_needed``: a parameter whose rounding is not small against its reach is left out.
    """
    reach = getattr(modes[0], "reach", None)
    found = sorted({int(j) for m in modes for j in (() if reach is None else m.paced) if j >= 0})
    paced, pace, top = [], [], []
    for j in found:
        inverse = down(1 / Q(reach[j]), real)
        most = max(max(abs(Q(m.theta_lo[j])), abs(Q(m.theta_hi[j]))) for m in modes)
        need = pace_needed(inverse, Q(reach[j]), Q(up(most, real)), real)
        if need < fmpq(3, 2):
            paced.append(j)
            pace.append(inverse)
            top.append(up(need, real))
    return {"paced": tuple(paced), "pace": np.array(pace, real), "top": np.array(top, real)} if paced else {}


def closed_entries(M: Affine, size: Array, split: bool, real: str) -> dict[str, Array]:
    """Round M(theta); what is only rounding, or below zero by rounding, becomes zero and goes into the margin."""
    base, slopes = M.base.copy(), [F.copy() for F in M.slopes]
    most, least = M.most(), M.least()
    for index in np.ndindex(base.shape):
        noise = 4 * UNIT[real] * size[index]
        if most[index] <= noise or (not split and M.largest()[index] <= noise):
            base[index] = fmpq(0)
            for F in slopes:
                F[index] = fmpq(0)
    rounded = nearest(base, real)
    steps = stacked(slopes, base.shape, real)
    if not split:  # rounding must not push an entry below zero at a corner of the box
        again = Affine(rational(rounded), [rational(F) for F in steps], M.lo, M.hi)
        for index in np.ndindex(base.shape):
            lack = -again.least()[index]
            if lack > 0 and least[index] > -64 * UNIT[real] * size[index]:
                rounded[index] = up(Q(rounded[index]) + lack, real)
    return {"M": rounded, "M_theta": steps}


def stacked(matrices: list, shape: tuple[int, int], real: str) -> Array:
    """Round a list of rational matrices to one array, empty lists included."""
    return nearest(np.array(matrices, dtype=object).reshape(len(matrices), *shape), real)


def worthwhile(total: Array, weight: Array, rows: Array, real: str) -> Array:
    """Round radii up; those of the size of rounding go into the offsets instead and cost no code.

    ``weight`` bounds the magnitude of the columns' signals, ``rows`` that of the result.
    """
    out = np.zeros(total.shape, dtype=real)
    for i, row in enumerate(total):
        least = max([8 * UNIT[real] * rows[i], *(x * w / 10**6 for x, w in zip(row, weight))])
        for j, (x, w) in enumerate(zip(row, weight)):
            if x * w > least:
                out[i, j] = up(x, real)
    return out


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
    new = {}
    for name, q, side, demands in exact.offsets():
        values = new.setdefault(f"{name}_{side}", np.array(offset(t, name, side)))
        values[q] = [sound_offset(d, t.real) * (1 if side == "hi" else -1) for d in demands]
    moved = {key: new.pop(key)[0] for key in list(new) if key[0] in "eb"}
    return _replace(t, **new, **({"change": _replace(t.change, **moved)} if moved else {}))


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
