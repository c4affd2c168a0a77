"""The claims of a point observer's certificate: what each rests on, by how much it holds (``point_margins``)."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

from ..certify import set_claims, set_freeze, sets
from ..certify.residual_gain import check as check_gains
from ..errors import CertificateError
from . import point_margins

ESTIMATE = ("M", "G", "L", "N", "d", "A", "B", "a", "C", "D", "c")
#: Constants of a table that are no part of a set; all the others are.
OTHERS = {*ESTIMATE, "x0_hat", "x_hat", "u_lo", "u_hi", "y_lo", "y_hi"}
#: Formula of each kind of set: what the alarm rests on, and what the bounds of x rest on besides.
WORDS = {
    "zonotope": ("H+ = [M red(H), F], red keeps the row sums of |H|; e >= rest of the step + rounding of M H and of "
                 "the reduction; rho >= rest of the residual + |C| e + rounding of C H; |d' r| <= h(d) with slack and "
                 "floor for the rounding of the test", "spread >= |N_o Dv| v_half + e + rounding of x_hat -+ radius"),
    "ellipsoid": ("(1 + alpha) M X M' + H with H > (1 + 1/alpha) Q, Q = sum t sum f f'/t over disturbance, noise and "
                  "the box of rounding; k trace(X) I covers the rounding of M X M'; (r' R^-1 r <= 1) with slack and "
                  "floor for the rounding of the test", "sqrt(z) (1 + 4u) <= a z + b: 4 a b >= (1 + 4u)^2; spread >= "
                  "|N_o Dv| v_half + rounding of x_hat -+ radius"),
    "thresholds": ("h[stage, q, j, i] >= support in direction d_i of every residual that the error recursion with "
                   "rounding allows j samples after mode q was entered, from the box of the stage; boxes hold what may "
                   "leave the stage before", "the same with the unit vectors of x for d_i, rounding of x_hat -+ width "
                   "included"),
    "schedule": ("h[row, i] >= support in direction d_i of every residual that the error recursion with rounding "
                 "allows at the sample that reads the row: from the initial box, and from every error at every phase "
                 "of the schedule", "the same with the unit vectors of x for d_i, rounding of x_hat -+ width included"),
    "blocks": ("|D_j H|_1 + scalars + noise >= support of every residual j samples after the block's start; [P_j H, "
               "G_j] and the box e hold the error at its end; e and scalars hold what rounded tables and sums lack "
               "where the row sums of |H| are below the limit", "the same with the unit vectors of x; first errors "
               "<= box <= limit"),
    "box": ("b+ = P b + g with P >= |M| / (1 - (n + 1) u), g >= |F| 1 + rest; |r| <= S b + rho, S and rho alike of C",
            "spread >= |N_o Dv| v_half + rounding of x_hat -+ b; Pb and gb as P and g, of A"),
}
WORDS["ellipsoid_trace"] = (
    "(1 + 1/a) (M X M' + k trace(X) I) + (1 + a) H with H > Q, Q = sum t sum f f'/t over disturbance, noise and the "
    "box of rounding, for every a > 0; (r' R^-1 r <= 1) with slack and floor for the rounding of the test",
    "(z / c + c) / 2 >= sqrt(z) for every c > 0, scale >= (1 + 8u) / sqrt(W); spread >= |N_o Dv| v_half + rounding of "
    "x_hat -+ radius")
WORDS["starts"] = (
    "h[size, q, j, i] >= support in direction d_i of every residual that the error recursion with rounding allows in "
    "mode q, j samples after a start of that size; the last size is every error that is possible",
    "the same with the unit vectors of x for d_i, rounding of x_hat -+ width included")
#: Beginning of the sentence on what cannot grow, of the kinds where it is not the half widths.
BOUNDED = {"thresholds": "the thresholds are a table", "schedule": "the thresholds are a table",
           "blocks": "the row sums", "starts": "the set is a table"}
#: Words and formula of the ultimate width, of the kinds where no box of the hull is kept by M at every sample.
ULTIMATE = {"ellipsoid_trace": ("The weighted trace shrinks in every mode and comes below a bound.",
                                "M' W M < theta W, ((1 + 1/60) (theta + 3 sum W k) T)^1/2 + ((1 + 1/60) tr W H)^1/2 "
                                "<= T^1/2, width >= 2 (T / W_i)^1/2 and spread"),
            "thresholds": ("The last stages of the table hold for ever.",
                           "width >= 2 max of the last stages' half widths"),
            "starts": ("The last rows of the table hold for ever.", "width >= 2 max of the last rows' half widths"),
            "schedule": ("The rows of the schedule hold for ever.", "width >= 2 max of their half widths"),
            "blocks": ("A box that the hull of the set enters and does not leave at the end of a block.",
                       "|P_j| b + |G_j| 1 + e + rounding <= b, |P_j| b < b for every block")}


def of_certificate(design, t, cert: dict, modes, build: type, plant: tuple,
                   own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield (beginning of the sentence, what makes its claim), in the order of ``certify.set_claims.check``.

    Parameters
    ----------
    design : Design
    t : PointTables
    cert : dict
    modes : sequence
    build : type
        ``claims.Claim``.
    plant : tuple of str
        Entries of the plant file that all conditions come from.
    own : tuple of str
        Checks by exact arithmetic.

    Raises
    ------
    CertificateError
        A kind of set that ``point_margins`` does not know.
    """
    kind = cert["set"]
    if kind not in point_margins.HELD or kind not in WORDS:
        raise CertificateError(f"assurance: no condition is known for the set {kind!r} (expected one of "
                               f"{', '.join(WORDS)}). Add it to codegen/assurance/point_claims.py and margins.")
    held = point_margins.HELD[kind](modes, t, cert)
    alarm, state = WORDS[kind]
    source = (inspect.getdoc(inspect.getmodule(type(design.observer))) or "").partition("Source: ")[2]
    source = " ".join(source.replace("``", "").split()).split(". ")[0].rstrip(".") or (
        f"own derivation: {(inspect.getdoc(sets) or '').splitlines()[0]}")
    code = _code(set_claims.CHECKS[kind])
    every = tuple(sorted(_names(t)))

    def claim(id, words, formula, margins, constants=every, source=source, code=code, checks=own):
        return lambda text: build(id, text, plant, words, formula, source, code, constants, tuple(margins), checks)

    run = (*own, "rounding", "validation", "target")
    yield ("the residual lies", "each residual is within"), claim(
        "no-alarm", "Whatever disturbance, noise, left over constants and rounding do in a step is inside what the set "
        "gets for it, in every mode and for every noise that the estimate may hold.", alarm, held["alarm"], checks=run)
    yield "x_lo <= x <= x_hi", claim(
        "containment", "The bounds of x are the estimate and the hull of its error's set, rounding of both included.",
        state, [*held["alarm"], *held["state"]], checks=run)
    yield BOUNDED.get(kind, "the half widths"), claim(
        "bounded", "Sets and estimate stay within the sizes that all rounding margins rest on.",
        "|x_hat| <= box (it is cut there), box >= |x| + limit; a half width beyond its limit, or an estimate beyond "
        "the box, starts the set again from the declared range, which the limit holds", held["bounded"],
        code=_code(set_freeze._check_reach), checks=(*own, "prove"))
    if cert.get("steady_box"):
        yield "Ultimate width", claim("ultimate-width", *ULTIMATE.get(kind, (
            "A box that the hull of the error's set enters and does not leave.",
            "|M_q| b + |F_q| 1 + |M_q| e + rounding <= b, |M_q| b < b in every mode")), held["ultimate"])
    if cert["kind"] != "none":
        margins, gains = point_margins.level(modes, t, cert), _code(check_gains)
        published = "Zammali (2020), (6.19), (6.43), bounds corrected"
        formula = ("[[(1 - lambda) P - C'C, -C'Z, M'P+], [*, g I - Z'Z, H'P+], [*, *, P+]] > 0 (L-infinity: without C "
                   "and Z), P <= rho P_l at a jump, level^2 >= factor g")
        words = "A Lyapunov function of the estimate's error decreases in every mode and pays for all noise."
        if cert["kind"] == "hinf":
            yield "H-infinity: ", claim("hinf", words, formula, margins, ESTIMATE, published, gains)
            yield "the error of the estimate", claim("decay", words, formula, margins[:-1], ESTIMATE, published, gains)
        else:
            yield "L-infinity: ", claim("linf", words, formula, margins, ESTIMATE, published, gains)


def ranges(design, t, build: type, checks: tuple):
    """State where estimate and set start."""
    limits = {"x": design.plant.limits("x"), "x0": (design.plant.x0_lo, design.plant.x0_hi)}
    runner = type(design.observer)({t.real: t}, design.observer.supervision)
    return build("ranges", "the sets that init and reset start from hold what the plant file declares",
                 ("signals.x", "initial.x_lo", "initial.x_hi"), "Centre and set of each box are rounded outward.",
                 "x_hat + set holds [x0_lo, x0_hi] after init, [x_lo, x_hi] after reset",
                 f"own derivation: {(inspect.getdoc(point_margins.starts) or '').splitlines()[0]}",
                 _code(point_margins.starts), ("x0_hat", "x0_set", "x_hat", "x_set"),
                 tuple(point_margins.starts(limits, t, runner)), checks)


def _names(t) -> set[str]:
    """Names of all constants of estimate and set, as ``point_places`` gives them."""
    own = set(vars(t))
    return (own | {k + " of the set" * (k in own) for k in vars(t.shape)}) - (OTHERS - set(ESTIMATE))


def _code(thing) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"
