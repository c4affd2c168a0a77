"""Tables of thresholds on the numbers of the C: their errors' recursion with rounding, freeze, proof.

The recursion is that of ``sets`` on the emitted constants: generators of disturbance and noise, and a box ``e`` (left
over constants, rounded inputs and sums) in every step, ``rho`` in the residual. Stage 1 starts from every error that is
possible at all while |x_hat| <= box and x is in its range: no assumption about what came before is needed. What the
firmware's own test rounds is a margin of each threshold.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..algebra.error_set import ErrorRecursion
from ..errors import CertificateError
from .exact import Q, down, rational, up
from .freeze import nearest
from .rounding import TINY, UNIT
from .set_bounds import Room, prove_dwell
from .sets import SetDemands

Array = np.ndarray


def recursion(modes, t) -> ErrorRecursion:
    """Error and residual with the bounds of x as further residuals, on the numbers of the C.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
        Its estimate is read, not its ``shape``.

    Returns
    -------
    ErrorRecursion
    """
    demands, n_modes, n_x = SetDemands(modes, t), len(modes), len(t.box)
    exact, n_y = demands.columns(), t.C.shape[1]
    last = len(demands.gain) - 1

    def origin(i: int) -> int:
        return min(i, last)

    W, V = [], []
    rest = [demands.rest(q, True) for q in range(n_modes)]
    outputs = [demands.residual_rest(q) for q in range(n_modes)]
    width = 2 * UNIT[t.real] * (3 * rational(t.box)) + 2 * TINY[t.real]  # x_hat plus and minus a half width
    for i in range(n_modes + 1):
        rows_w, rows_v = [], []
        for q in range(n_modes):
            F = exact["F"][q, origin(i)]
            near = nearest(F, "float64")
            lack = rest[q] + abs(rational(near) - F).sum(axis=1)
            rows_w.append(np.concatenate([near, np.diag([up(x) for x in lack])], axis=1))
            held = demands.gain[origin(i)] @ (demands.exact[q]["Dv"] * demands.v[q][1])
            noise = np.concatenate([_direct(demands, q, origin(i)), -held], axis=0)
            near = nearest(noise, "float64")
            lack = np.concatenate([outputs[q], width]) + abs(rational(near) - noise).sum(axis=1)
            rows_v.append(np.concatenate([near, np.diag([up(x) for x in lack])], axis=1))
        W.append(rows_w)
        V.append(rows_v)
    C = np.concatenate([t.C.astype(float), np.broadcast_to(np.eye(n_x), (n_modes, n_x, n_x))], axis=1)
    W, V = np.array(W), np.array(V)
    del n_y
    return ErrorRecursion(t.M.astype(float), C, W, V, (W.shape[3],))


def _direct(demands: SetDemands, q: int, o: int) -> Array:
    """Exact columns of the residual, those of zeros too."""
    Dv = demands.exact[q]["Dv"] * demands.v[q][1]
    return Dv - demands.C[q] @ (demands.gain[o] @ Dv)


def starts(t) -> tuple[Array, Array]:
    """Generators of the first errors: of the initial box, and of every error that is possible."""
    reach = np.max(np.abs([t.x_lo, t.x_hi]), axis=0)
    anywhere = np.diag([up(Q(a) + Q(b)) for a, b in zip(reach, t.box)])
    lo, hi = rational(t.x0_lo), rational(t.x0_hi)
    centre = [Q(float(a)) for a in (t.x0_lo.astype(float) / 2 + t.x0_hi.astype(float) / 2).astype(t.real)]
    return np.diag([up(max(b - c, c - a)) for a, b, c in zip(lo, hi, centre)]), anywhere


def directions_of(t, directions: Array) -> Array:
    """Directions in residual and state together, for the two parts of the table."""
    n_x, n_y = len(t.box), t.C.shape[1]
    out = np.zeros((len(directions) + n_x, n_y + n_x))
    out[:len(directions), :n_y] = directions
    out[len(directions):, n_y:] = np.eye(n_x)
    return out


def margin(directions: Array, bounds: Array, real: str) -> Array:
    """What rounding can add to |d' r| in the firmware, where every |r_i| is within its bound: (..., m)."""
    n_y, size = directions.shape[1], np.abs(directions.astype(float))
    count = np.where((size > 0).sum(axis=1) > 1, n_y + 2, 0)  # a coordinate is compared as it is
    slip = float(UNIT[real]) * 1.01 * count * (bounds.astype(float) @ size.T)
    return slip + np.where(count > 0, 4 * n_y * float(TINY[real]), 0.0)


def freeze_thresholds(shape_class, t, main, first, directions: Array):
    """Round tables of thresholds outward.

    Parameters
    ----------
    shape_class : type
        ``ThresholdTables``.
    t : PointTables
    main, first : DwellTable
        From every error that is possible, and from the initial box.
    directions : ndarray (m, n_y)
        As emitted.

    Returns
    -------
    ThresholdTables
    """
    h, hx = emitted_rows(t, np.concatenate([first.h, main.h]), directions)
    return shape_class(dwell=main.dwell, anew=len(first.h), directions=directions, h=h, hx=hx)


def emitted_rows(t, h: Array, directions: Array) -> tuple[Array, Array]:
    """Round supports up, with what the firmware's own test of them rounds.

    Parameters
    ----------
    t : PointTables
    h : ndarray (..., m + n_x)
        Along ``directions_of(t, directions)``.
    directions : ndarray (m, n_y)
        As emitted.

    Returns
    -------
    h : ndarray (..., m), hx : ndarray (..., n_x)
    """
    m, n_y = len(directions), t.C.shape[1]
    bounds = _above(h[..., :n_y] * (1 + 1e-9), t.real)
    rest = _above((h[..., n_y:m] + margin(directions, bounds, t.real)[..., n_y:]) * (1 + 1e-9), t.real)
    return np.concatenate([bounds, rest], axis=-1), _above(h[..., m:] * (1 + 1e-9), t.real)


def _above(x: Array, real: str) -> Array:
    """Round doubles up."""
    y = x.astype(real)
    return np.where(y.astype(np.float64) < x, np.nextafter(y, np.array(np.inf, real)), y).astype(real)


def certificate(main, first, t, proof: dict) -> dict:
    """What ``check`` needs beside the tables: boxes of the stages, in which coordinates, how far was looked back."""
    last = 2 * (1 + 1e-9) * t.shape.hx[[t.shape.anew - 1, -1]].astype(float).max(axis=(0, 1, 2))
    parts = {name: {"boxes": table.boxes.tolist(), "coordinates": table.coordinates.tolist(), "back": int(table.back)}
             for name, table in (("main", main), ("first", first))}
    return {**proof, "set": "thresholds", **parts, "steady_box": {"width": last.tolist(), "hi": (last / 2).tolist(),
                                                                  "lo": (last / 2).tolist()}}


def proved(modes, t, cert: dict) -> dict[str, Room]:
    """Prove both parts of a table; return by how much each holds.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
    cert : dict

    Returns
    -------
    dict
        "first" and "main" -> Room.

    Raises
    ------
    CertificateError
        Naming stage, mode, row and direction.
    """
    z, m, h = t.shape, recursion(modes, t), claimed_rows(t)
    directions = directions_of(t, z.directions.astype(float))
    first, anywhere = starts(t)
    out = {}
    for name, H0, rows in (("first", first, h[:z.anew]), ("main", anywhere, h[z.anew:])):
        part = cert[name]
        boxes = np.array(part["boxes"])
        if boxes.shape[:1] != rows.shape[:1]:
            raise CertificateError(f"certificate: {len(boxes)} boxes (found) for {len(rows)} stages of the table.")
        claim = SimpleNamespace(directions=directions, h=rows, boxes=boxes, dwell=z.dwell, back=part["back"],
                                coordinates=np.array(part["coordinates"]))
        out[name] = prove_dwell(m, H0, claim)
    return out


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the certificate of a table of thresholds; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming stage, mode, row and direction.
    """
    z = t.shape
    proved(modes, t, cert)
    check_middle(t)
    width = np.array(cert["steady_box"]["width"])
    if np.any(rational(width) < 2 * np.max(rational(z.hx[[z.anew - 1, -1]]).reshape(-1, len(t.box)), axis=0)):
        raise CertificateError("certificate: the ultimate width is less than in the table's last stages.")
    slow = "" if z.dwell == 1 else f"; a mode that lasts less than {z.dwell} samples makes the thresholds start anew"
    return ["the residual lies within its thresholds at every sample while no fault acts, so there is no false alarm, "
            f"for any switching, rounding included ({t.real}, with or without fused multiply-add){slow}",
            "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
            table_words(z),
            f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], "
            + ("for arbitrary switching" if z.dwell == 1 else f"while every mode lasts at least {z.dwell} samples")]


def claimed_rows(t) -> Array:
    """What the emitted thresholds and half widths claim of the residual and of x: (..., m + n_x), rounding taken off.

    Raises
    ------
    CertificateError
        The first directions are not the coordinates.
    """
    z, n_y = t.shape, t.C.shape[1]
    if not np.array_equal(z.directions[:n_y], np.eye(n_y)):
        raise CertificateError("certificate: the first directions are not the coordinates of the residual.")
    room = margin(z.directions, z.h[..., :n_y], t.real)
    return np.concatenate([np.vectorize(lambda a, b: down(Q(a) - Q(b)))(z.h, room), z.hx.astype(float)], axis=-1)


def table_words(z) -> str:
    """Claim of a table, with what it takes of the flash."""
    count = z.directions.size + z.h.size + z.hx.size
    return (f"the thresholds are a table of {count} numbers ({count * z.h.itemsize} bytes of flash) and the estimate "
            "stays in a box: nothing can grow")


def check_middle(t) -> None:
    """Check that an estimate in the middle of the declared range is within the box that the margins rest on.

    Raises
    ------
    CertificateError
    """
    for i, (box, lo, hi) in enumerate(zip(t.box, t.x_lo, t.x_hi)):
        if not abs(float(lo) / 2 + float(hi) / 2) < float(box):
            raise CertificateError(f"certificate: box[{i}] does not hold the middle of the declared range.")
