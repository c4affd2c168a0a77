"""From the gains of a point observer to the numbers that the C will hold, and the certificate of these numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.optimize import linprog

from ..errors import CertificateError
from .exact import Q, down, eye, product, rational, up
from .freeze import nearest
from .rounding import UNIT
from .sets import SetDemands, ZonotopeDemands, column
from .settled import Boxes

Array = np.ndarray
#: Conditions "stored >= needed" of a zonotope's tables: name, and what it is.
BOXES = (("inside", "inside", "the box of rounding in the coordinates of boxes"),
         ("e", "error_box", "the box of rounding beside the error set"), ("spread", "spread", "the bounds of x"),
         ("rho", "residual_box", "the box of rounding beside the residual set"))


def freeze_estimate(modes, limits: dict, gains: dict, limit: Array, real: str) -> dict:
    """Round gains, then what follows from the rounded ones; everything of ``PointTables`` but the set.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    limits : dict
        "x", "x0", "u", "y" -> (lo, hi) arrays.
    gains : dict
        "L", "N" -> ndarray (n_modes, n_x, n_y); "kind" -> "luenberger" or "tnl".
    limit : ndarray (n_x,)
        Half widths that start the set again; raised to hold the declared range and the initial box.
    real : {"float32", "float64"}

    Returns
    -------
    dict
    """
    out = {"real": real, "kind": gains["kind"], "L": nearest(gains["L"], real), "N": nearest(gains["N"], real)}
    closed = [_closed(m, L, N, real) for m, L, N in zip(modes, out["L"], out["N"])]
    out["M"], out["G"] = (np.stack([nearest(pair[i], real) for pair in closed]) for i in (0, 1))
    out |= {k: nearest(np.stack([getattr(m, k) for m in modes]), real) for k in "ABCD"}
    for name in ("x", "x0"):
        lo, hi = limits[name]
        out[f"{name}_lo"] = np.array([down(Q(x), real) for x in lo], dtype=real)
        out[f"{name}_hi"] = np.array([up(Q(x), real) for x in hi], dtype=real)
    for name in ("u", "y"):
        out[f"{name}_lo"], out[f"{name}_hi"] = (nearest(b, real) for b in limits[name])
    wide = np.max([(out[f"{n}_hi"].astype(float) - out[f"{n}_lo"]) / 2 for n in ("x", "x0")], axis=0)
    out["limit"] = np.array([up(Q(v), real) for v in np.maximum(limit, 1.01 * wide)], dtype=real)
    reach = np.max(np.abs([out["x_lo"], out["x_hi"], out["x0_lo"], out["x0_hi"]]), axis=0)
    out["box"] = np.array([up(Q(r) + Q(v), real) for r, v in zip(reach, out["limit"])], dtype=real)
    n, n_x, n_y = *out["A"].shape[:2], out["C"].shape[1]
    zero = {"d": np.zeros((n, n_x), real), "a": np.zeros((n, n_x), real), "c": np.zeros((n, n_y), real)}
    draft = SimpleNamespace(**out, **zero)
    return out | {k: nearest(x, real) for k, x in SetDemands(modes, draft).centres().items()}


def _closed(mode, L: Array, N: Array, real: str) -> tuple[Array, Array]:
    """Exact T A - L C and T B - L D on rounded gains; what is only rounding becomes zero and costs no product."""
    A, C, L, N = rational(mode.A), rational(mode.C), rational(L), rational(N)
    NC = product(N, C)
    T = eye(C.shape[1]) - NC
    M = product(T, A) - product(L, C)
    size = abs(A) + product(abs(NC), abs(A)) + product(abs(L), abs(C))
    keep = np.vectorize(lambda m, s: m if abs(m) > 4 * UNIT[real] * s else Q(0), otypes=[object])
    return keep(M, size), product(T, rational(mode.B)) - product(L, rational(mode.D))


def freeze_zonotope(shape_class, modes, estimate: dict, order: int, directions: Array, pairs: bool = False,
                    key: str = "squared", coordinates: Array | None = None):
    """Build the tables of a zonotope for an estimate.

    Parameters
    ----------
    shape_class : type
        ``ZonotopeTables``.
    modes : sequence
    estimate : dict
        Of ``freeze_estimate``.
    order : int
        l, columns after a reduction.
    directions : ndarray (m, n_y)
        Of the membership test; read for more than two outputs.
    pairs : bool
        Membership by the normals of all pairs of generators.
    key : {"squared", "girard"}
    coordinates : ndarray (N, n_x, n_x) or None
        T_q in which boxes are. None: those of x.

    Returns
    -------
    ZonotopeTables
    """
    real, t = estimate["real"], SimpleNamespace(**estimate)
    demands = SetDemands(modes, t)
    columns = {k: nearest(x, real) for k, x in demands.columns().items()}
    n_x, n_y = len(t.box), t.C.shape[1]
    turned = turn(t, coordinates)
    power = 2 if key == "squared" else 1
    scale = np.ones(n_x)  # other coordinates are made alike themselves
    if coordinates is None:
        scale = 2.0 ** -np.round(power * np.log2(np.maximum(t.limit.astype(float), 1e-30)))  # exact in the keys
        scale = scale / scale.max()
    given = {"order": order, "pairs": pairs, "key": key, **turned, "weight": scale.astype(real),
             "directions": nearest(directions, real).reshape(-1, n_y), "e": np.zeros(n_x, real), "spread": None,
             "rho": None, "slack": None, "floor": None, **columns}
    for _ in range(4):  # e enters its own rounding, by parts in a million
        needed = ZonotopeDemands(demands, SimpleNamespace(**given, columns=order + columns["F"].shape[3]))
        given |= {"e": raised(needed.error_box(), real), "inside": raised(needed.inside(), real).reshape(-1, n_x)}
    last = ZonotopeDemands(demands, SimpleNamespace(**given, columns=order + columns["F"].shape[3]))
    given |= {"spread": raised(last.spread(), real), "rho": raised(last.residual_box(), real),
              "slack": raised(np.array(last.slack(), dtype=object), real),
              "floor": raised(np.array(last.floor(), dtype=object), real)}
    return shape_class(**given)


def turn(t, coordinates: Array | None) -> dict:
    """Round coordinates of boxes, each scaled to sets of size about 1, and the ways back: B, S, Sb, inside.

    Parameters
    ----------
    t : PointTables
        Of the estimate, ``M``, ``A`` and ``limit`` are read.
    coordinates : ndarray (N, n_x, n_x) or None

    Returns
    -------
    dict
    """
    n = len(t.box)
    none = np.zeros((0, n, n), t.real)
    if coordinates is None:
        return {"B": none, "S": none, "Sb": none, "inside": none[:, 0]}
    back = np.linalg.inv(coordinates)
    size = np.abs(back) @ t.limit.astype(float)
    B = nearest(back * 2.0 ** -np.round(np.log2(size))[:, :, None], t.real)
    T = np.linalg.inv(B.astype(float))
    return {"B": B, "S": nearest(t.M.astype(float) @ T, t.real), "Sb": nearest(t.A.astype(float) @ T, t.real),
            "inside": np.zeros((len(B), n), t.real)}


def raised(needed: Array, real: str) -> Array:
    """Round exact demands up, with a thousandth of room."""
    flat = [up(x * Q(1.0009765625), real) for x in np.asarray(needed, dtype=object).ravel()]
    return np.array(flat, dtype=real).reshape(np.shape(needed))


def prove_zonotope(modes, t, proof: dict, dwell: int = 1) -> dict:
    """Make the certificate of the tables of a zonotope.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
    proof : dict
        Of the gains; kept beside what is proved of the set.
    dwell : int
        Samples that every mode lasts at least.

    Returns
    -------
    dict
        ``check_zonotope`` accepts it.

    Raises
    ------
    CertificateError
    """
    demands = ZonotopeDemands(SetDemands(modes, t), t.shape)
    half, boxes = None if t.shape.oblique else steady_hull(t, demands), None
    if half is None and (dwell > 1 or t.shape.oblique):
        every = Boxes(t, demands, dwell)
        boxes = every.found()
        half = None if boxes is None or every.broken(boxes) else every.in_x(boxes)
    cert = {**proof, "set": "zonotope", "order": t.shape.order, "steady_box": None}
    if half is not None:
        cert |= {"boxes": {"dwell": dwell, "half": boxes.tolist()}} if boxes is not None else {}
        width = 2 * (half + np.max(t.shape.spread.astype(float), axis=0)) * (1 + 1e-9)
        cert["steady_box"] = {"half": half.tolist(), "hi": (width / 2).tolist(), "lo": (width / 2).tolist(),
                              "width": width.tolist()}
    check_zonotope(modes, t, cert)
    return cert


def steady_hull(t, demands: ZonotopeDemands) -> Array | None:
    """Half widths that the hull of the error set enters and keeps in every mode; None where no box does it."""
    M, n = np.abs(t.M.astype(float)), len(t.box)
    push = np.array([np.max(np.abs(t.shape.F[q].astype(float)).sum(axis=2), axis=0) + m @ t.shape.e.astype(float)
                     for q, m in enumerate(M)])
    push += np.array([[float(x) for x in demands.carry(m)] for m in demands.of.M])
    scale = np.maximum(t.limit.astype(float), 1e-300)
    for room in (1e-7, 1e-7 + 2 * (t.shape.columns + n + 3) * float(UNIT[t.real])):  # sums near the limit
        rows = np.concatenate([(m * (1 + room) - np.eye(n)) * scale / scale[:, None] for m in M])
        found = linprog(np.ones(n), A_ub=rows, b_ub=np.concatenate([-p * (1 + room) / scale for p in push]),
                        bounds=[(1e-9, None)] * n)
        if found.status != 0:
            return None
        half = found.x * scale * (1 + 1e-6)
        if not demands.steady(half):
            return half
    return None


def check_zonotope(modes, t, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition and by how much it fails.
    """
    demands = SetDemands(modes, t)
    exact = ZonotopeDemands(demands, t.shape)
    if not len(t.box) <= t.shape.order == cert["order"]:
        raise CertificateError(f"certificate: order {t.shape.order} (found), expected {cert['order']}, at least the "
                               f"{len(t.box)} states.")
    if t.shape.pairs:
        _check_cubes(t, exact)
    if t.shape.oblique and not len(t.shape.B) == len(t.shape.S) == len(t.shape.Sb) == len(t.A):
        raise CertificateError("certificate: coordinates of boxes are not given for every mode.")
    for name, found in demands.columns().items():
        if found.shape != getattr(t.shape, name).shape:
            raise CertificateError(f"certificate: {name} has shape {getattr(t.shape, name).shape} (found), expected "
                                   f"{found.shape}: one column per disturbance and noise.")
    for name, needed, what in BOXES:
        stored, least = rational(getattr(t.shape, name)), getattr(exact, needed)()
        lack = least - stored
        if np.any(lack > 0):
            where = np.unravel_index(np.argmax([float(x) for x in lack.ravel()]), lack.shape)
            raise CertificateError(f"certificate: {name}{[int(i) for i in where]}, {what}, is too small by "
                                   f"{float(lack[where]):.3g}: the set could lose a residual without fault.")
    for name, least in (("slack", exact.slack()), ("floor", exact.floor())):
        if Q(getattr(t.shape, name)) < least:
            raise CertificateError(f"certificate: {name} of the membership test is {float(getattr(t.shape, name)):.3g} "
                                   f"(found), expected at least {float(least):.3g}.")
    _check_reach(t)
    claims = ["the residual lies in its set at every sample while no fault acts, so there is no false alarm, for any "
              f"switching, rounding included ({t.real}, with or without fused multiply-add)",
              "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
              "the half widths of the error set stay below "
              f"[{', '.join(f'{x:.4g}' for x in t.limit)}]: a set that would grow beyond starts again from the "
              f"declared ranges; the estimate stays in a box; the order of the zonotope is {t.shape.order}"]
    if cert.get("steady_box"):
        half = np.array(cert["steady_box"]["half"])
        bad, slow = (_bad_boxes(modes, t, exact, cert, half) if "boxes" in cert
                     else (exact.steady(half), "for arbitrary switching"))
        width = np.array(cert["steady_box"]["width"])
        if bad or np.any(rational(width) < 2 * (rational(half) + np.max(rational(t.shape.spread), axis=0))):
            raise CertificateError("certificate: the hull of the error set leaves its box in "
                                   f"{bad or 'the bounds of x'}.")
        claims.append(f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], {slow}")
    return claims


def _bad_boxes(modes, t, exact: ZonotopeDemands, cert: dict, half: Array) -> tuple[str, str]:
    """Where the boxes of a certificate do not hold, or nothing, and for which switching they do."""
    every, stored = Boxes(t, exact, cert["boxes"]["dwell"]), np.array(cert["boxes"]["half"])
    broken = every.broken(stored)
    if broken is None and np.any(every.in_x(stored) > half):
        broken = 0, int(np.argmax(every.in_x(stored) - half))
    slow = ("for arbitrary switching" if every.dwell == 1
            else f"while every mode lasts at least {every.dwell} samples")
    return "" if broken is None else f'mode "{modes[broken[0]].name}", coordinate {broken[1]}', slow


def _check_cubes(t, exact: ZonotopeDemands) -> None:
    """Check that products of three residuals, and sums of them, cannot overflow: infinity would be a false alarm."""
    if t.C.shape[1] != 3:
        raise CertificateError(f"certificate: pairs of generators with {t.C.shape[1]} residuals (found), expected 3.")
    most = max(Q(1), *(x for q, C in enumerate(exact.of.C) for x in
                       product(abs(C), column(exact.reach)).ravel() + np.max(abs(rational(t.shape.V[q])).sum(axis=2),
                                                                            axis=0) + rational(t.shape.rho[q])),
               *(abs(Q(x)) for x in np.concatenate([t.y_lo, t.y_hi])))
    if 64 * most**3 >= Q(np.finfo(t.real).max) / 2:
        raise CertificateError("certificate: products of three residuals may overflow "
                               f"(residuals up to {float(most):.3g}).")


def _check_reach(t, share: float = 1.0) -> None:
    """Check that limit and box hold what the induction needs; the set of a box has ``share`` times its half widths."""
    wide = np.max([np.abs(rational(t.x_hi) - rational(t.x_lo)), np.abs(rational(t.x0_hi) - rational(t.x0_lo))], axis=0)
    reach = np.max(np.abs([t.x_lo, t.x_hi, t.x0_lo, t.x0_hi]), axis=0)
    spread = rational(t.shape.spread)[-1]  # of an estimate that holds no noise of its own sample
    for i in range(len(t.box)):
        if Q(t.box[i]) < Q(reach[i]) + Q(t.limit[i]):
            raise CertificateError(f"certificate: box[{i}] is {float(t.box[i]):.6g} (found), expected at least range "
                                   f"plus limit, {float(reach[i]) + float(t.limit[i]):.6g}.")
        if Q(t.limit[i]) < Q(share) * wide[i] / 2 + spread[i]:
            raise CertificateError(f"certificate: limit[{i}] does not hold the declared range.")
