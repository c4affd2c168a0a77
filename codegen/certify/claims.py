"""The certificate of one table: what is proved, and the numbers that prove it.

``prove`` takes what synthesis hands over (a Lyapunov matrix, a copositive vector, or a box) and finds the
sharpest level that holds on the emitted constants; ``check`` repeats every condition from the stored
numbers alone. Nothing is believed that is not recomputed here.
"""

from __future__ import annotations

import hashlib
import json
from fractions import Fraction

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from . import filter_bounds
from .containment import Containment, offset, sup
from .criteria import check_box, check_linf, check_width, smallest_mu
from .error_model import ErrorModel
from .exact import Q, rational, up
from .freeze import box_holds

SIDES = ("hi", "lo")


def prove(modes, t, proof: dict) -> dict:
    """Complete the proof data of synthesis into a certificate of these tables.

    Parameters
    ----------
    modes : sequence
        The plant's modes (``name A B C D Bw Dv ...``).
    t : FramerTables
    proof : dict
        ``kind`` "linf" (lam, rho, P_hi, P_lo, dwell_add, dwell_drain, chatter), "width" (p, a), "box",
        or "none" (fixed gains: containment only).

    Returns
    -------
    dict
        The certificate; ``check`` accepts it.

    Raises
    ------
    CertificateError
        A condition fails on the emitted constants.
    """
    exact = Containment(modes, t)
    model = ErrorModel(modes, t, exact)
    names = [m.name for m in modes]
    cert = {k: v for k, v in proof.items() if k != "mu"}
    if proof["kind"] == "linf":
        mu = max(smallest_mu(floats(model.M[s][k]), floats(model.L[s][k]), getattr(t, "N_" + s)[q],
                             proof["P_" + s][q], proof["lam"]) for s in SIDES for k, q in enumerate(model.mode))
        if not np.isfinite(mu):
            raise CertificateError("certificate: no level mu satisfies the Lyapunov inequality on the rounded "
                                   f"constants at lambda = {proof['lam']:.6g}. Try a smaller lambda or float64.")
        for extra in (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2):
            cert["mu"] = float(mu * (1 + extra))
            try:
                level = check_linf(model, t, cert, names)
                break
            except CertificateError as error:
                failure = error
        else:
            raise failure
        cert["level"] = up(_root(level["error_bound2"]))
    elif proof["kind"] == "width":
        cert["level"] = up(check_width(model, cert, names)["width_bound"])
    boxes = {s: model.steady_box(s) for s in model.push}
    cert["steady_box"] = None if any(b is None for b in boxes.values()) else {s: b.tolist() for s, b in boxes.items()}
    if t.change is not None and cert["steady_box"] is not None:
        cert["x_width"] = [up(x) for x in model.x_width(cert["steady_box"])]
    if proof["kind"] == "box" and cert["steady_box"] is None:
        raise CertificateError("certificate: no box holds the framer errors of all modes on the rounded constants. "
                               'Try criterion = "linf" with lyapunov = "multiple" and a dwell time.')
    _check(modes, t, cert, exact, model)
    return cert


def check(modes, t, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition, the mode and by how much it fails.
    """
    exact = Containment(modes, t)
    return _check(modes, t, cert, exact, ErrorModel(modes, t, exact))


def _check(modes, t, cert: dict, exact: Containment, model: ErrorModel) -> list[str]:
    """``check`` with the exact data of these tables, which is dear: one for all conditions."""
    names = [m.name for m in modes]
    claims = [_nonnegative(t, exact, names), _contained(t, exact, names), _bounded(t, exact)]
    if cert["kind"] == "linf":
        level2 = check_linf(model, t, cert, names)["error_bound2"]
        if Q(cert["level"]) ** 2 < level2:
            raise CertificateError(f"certificate: level {cert['level']:.9g} claimed, only {float(level2) ** 0.5:.9g} "
                                   "is proved.")
        claims.append(f"L-infinity: |x_hi - x| and |x - x_lo| (2-norm) stay ultimately below {cert['level']:.6g} "
                      f"(mu = {cert['mu']:.6g}, lambda = {cert['lam']:.6g}), {switching_words(cert)}")
    elif cert["kind"] == "width":
        level = check_width(model, cert, names)["width_bound"]
        if Q(cert["level"]) < level:
            raise CertificateError(f"certificate: width {cert['level']:.9g} claimed, only {float(level):.9g} is "
                                   "proved.")
        claims.append(f"Width: p'(x_hi - x_lo) stays ultimately below {cert['level']:.6g}, shrinking by "
                      f"{cert['a']:.6g} per sample, for arbitrary switching")
    elif cert["kind"] == "box" and not cert.get("steady_box"):
        raise CertificateError("certificate: a box design without its box.")
    elif cert["kind"] not in ("box", "none"):
        raise CertificateError(f"certificate: kind {cert['kind']!r} (found), expected linf, width, box or none.")
    if cert.get("steady_box"):
        check_box(model, cert["steady_box"], names)
        if t.change is not None and any(Q(a) < b for a, b in zip(cert["x_width"], model.x_width(cert["steady_box"]))):
            raise CertificateError("certificate: the widths of x are less than what the box of z = Z x leads to.")
        width = ", ".join(f"{x:.4g}" for x in ultimate_width(cert))
        claims.append(f"Ultimate width of each state at most [{width}], for arbitrary switching")
    return claims


def ultimate_width(cert: dict) -> list[float] | None:
    """Proved bound on the width of each state once settled, for arbitrary switching; None where there is none."""
    z = cert.get("steady_box")
    return cert["x_width"] if "x_width" in cert else z and z.get("width", [a + b for a, b in zip(z["hi"], z["lo"])])


def check_ranges(limits: dict, t) -> None:
    """Check that the table starts from, and restarts to, boxes that hold what the plant declares.

    Parameters
    ----------
    limits : dict
        "x", "x0" -> (lo, hi) arrays of the plant.
    t : FramerTables

    Raises
    ------
    CertificateError
    """
    for name in ("x", "x0"):
        lo, hi = limits[name]
        table_lo, table_hi = getattr(t, name + "_lo"), getattr(t, name + "_hi")
        for i in range(len(lo)):
            if Q(table_lo[i]) > Q(lo[i]) or Q(table_hi[i]) < Q(hi[i]):
                raise CertificateError(
                    f"certificate: the table's {name} box [{float(table_lo[i]):.9g}, {float(table_hi[i]):.9g}] of "
                    f"state {i} does not contain the declared [{float(lo[i]):.9g}, {float(hi[i]):.9g}].")


def check_monitor(supervision, cert: dict) -> None:
    """Check that the firmware watches at least the dwell time on which the certificate rests.

    Parameters
    ----------
    supervision : Supervision
    cert : dict

    Raises
    ------
    CertificateError
    """
    if cert["kind"] == "filter":
        filter_bounds.check_monitor(supervision, cert)
        return
    if cert["kind"] not in ("linf", "hinf") or cert["rho"] <= 1 or cert["dwell_add"] <= cert["dwell_drain"]:
        return
    add, drain, limit = supervision.dwell_add, supervision.dwell_drain, supervision.dwell_limit
    if add * cert["dwell_drain"] < cert["dwell_add"] * drain or not 0 < limit <= Fraction(cert["chatter"]) * add:
        raise CertificateError(
            f"certificate: the dwell monitor (switch +{add}, sample -{drain}, limit {limit}) admits faster switching "
            f"than the proof: {switching_words(cert)}.")


def switching_words(cert: dict) -> str:
    """Say for which switching the level is proved."""
    if Q(cert["rho"]) == 1 or cert["dwell_add"] <= cert["dwell_drain"]:
        return "for arbitrary switching"
    tau = Fraction(cert["dwell_add"], cert["dwell_drain"])
    return (f"for average dwell time at least {float(tau):.6g} samples with chatter bound {cert['chatter']:g} "
            f"(jump factor {cert['rho']:.6g})")


def digest(*parts) -> str:
    """Hash (sha256) of the JSON of the parts: any change of a stored number shows."""
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def floats(A) -> np.ndarray:
    """Nearest float64 of rational entries."""
    return np.array([float(x) for x in A.ravel()]).reshape(A.shape)


def _nonnegative(t, exact: Containment, names) -> str:
    worst = fmpq(0)
    for side in SIDES:
        for q, name in enumerate(names):
            M = exact.scheduled(q, side).M
            least = floats(M.least())
            least = np.where(t.flipped[q], 0.0, least)
            if np.min(least) < 0:
                i, j = np.unravel_index(np.argmin(least), least.shape)
                raise CertificateError(f'certificate: T A - L C has the negative entry {least[i, j]:.6g} at ({i}, {j}) '
                                       f'in mode "{name}" ({side} framer), expected >= 0.')
            worst = max([worst, *exact.leftover(q, side)[1].most().ravel()])
    gain = "T A - L C" if t.change is None else "Z (A - L C) Z^-1"
    rest = f"the rounded table differs from it by at most {float(worst):.2g}, which the offsets cover"
    if t.signed:
        return f"each entry of {gain} takes the bound that its sign asks for; {rest}"
    where = "in every mode" + (" and for every theta in its box" if t.vary is not None and t.vary.parameters else "")
    return f"{gain} >= 0 {where}; {rest}"


def _contained(t, exact: Containment, names) -> str:
    for name, q, side, demands in exact.offsets():
        values = offset(t, name, side)[q]
        for i, demand in enumerate(demands):
            lack = demand.shortfall(Q(values[i]) * (1 if side == "hi" else -1), t.real)
            if lack > 0:
                raise CertificateError(f'certificate: offset {name}_{side}[{i}] in mode "{names[q]}" is too small by '
                                       f"{float(lack):.3g}: the framer could lose the state.")
    return ("x_lo <= x <= x_hi at every sample while no fault acts, for any switching, rounding included "
            f"({t.real}, with or without fused multiply-add)")


def _bounded(t, exact: Containment) -> str:
    reach = np.max(np.abs([t.x_lo, t.x_hi, t.x0_lo, t.x0_hi]), axis=0)
    if np.any(reach > t.box):
        raise CertificateError("certificate: the state box does not contain the declared ranges.")
    if t.change is not None:
        image = image_of(t)
        if any(a < 0 for a in image) or not t.clamp or np.any(np.maximum(-t.change.z_lo, t.change.z_hi) > t.change.box):
            raise CertificateError("certificate: the range of z does not contain what Z makes of the range of x.")
        return ("the framers are cut to the declared ranges, those of z = Z x to what Z makes of them, so they are "
                "bounded")
    if t.clamp:
        return "the framers are cut to the declared ranges, so they are bounded"
    if not box_holds(t, exact):
        raise CertificateError("certificate: the framers can leave the state box behind the rounding margins.")
    return "the framers cannot leave the state box, whatever the inputs within their ranges"


def image_of(t) -> list:
    """What the range of z has beyond the image of the range of x under Z, at every end; exact."""
    Z, (lo, hi) = rational(t.change.Z), (rational(t.x_lo), rational(t.x_hi))
    return [*(Q(z) - x for z, x in zip(t.change.z_hi, sup(Z, lo, hi))),
            *(-Q(z) - x for z, x in zip(t.change.z_lo, sup(-Z, lo, hi)))]


def _root(value: fmpq) -> fmpq:
    """A rational not below the square root."""
    guess = Q(float(value) ** 0.5)
    while guess * guess < value:
        guess *= fmpq(2**50 + 1, 2**50)
    return guess
