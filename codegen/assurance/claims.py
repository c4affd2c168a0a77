"""Every claim of a design: what of the plant it comes from, its condition, by how much it holds, what it rests on.

The sentences of the certificate (``certify.claims.check``) come first, in its order: a sentence without a
condition here is an error, so that no claim can be left out. Those that are checked but not counted among the
sentences follow: ranges, dwell monitor, detected faults, arithmetic, execution.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, zip_longest
from typing import Protocol

from flint import fmpq

from ..analysis.detectability import surely_detected
from ..certify import claims as certificate
from ..certify import containment, criteria, freeze
from ..certify.exact import Q
from ..errors import CertificateError
from . import (
    bank_claims,
    driven_claims,
    filter_claims,
    follower_claims,
    guided_claims,
    guided_filter_claims,
    guided_point_claims,
    margins,
    mode_claims,
    point_claims,
    polytopic_claims,
    sampling_claims,
    sliding_claims,
    trailing_claims,
)
from .margins import Margin

GAINS = ("M", "G", "L", "N", "d")
SLOPES = ("M_theta", "G_theta", "L_theta", "theta_weight")
RADII = ("R", "S", "E")
THETA = ("signals.theta", "mode.bounds")
EXACT = ("exact", "independent", "read-back")
MATRICES = ("A", "B", "C", "D", "Bw", "Dv")
PLANT = (*MATRICES, "signals.x", "signals.u", "signals.y", "signals.w", "signals.v", "mode.bounds", "constants")


@dataclass(frozen=True)
class Box:
    """What measured parameters may read, error included, of a plant that has no modes."""

    name: str
    theta_lo: tuple[fmpq, ...]
    theta_hi: tuple[fmpq, ...]

    @classmethod
    def of(cls, plant) -> Box:
        """The box of a polytopic plant."""
        read = [s for s in plant.theta if s.measured]
        return cls("the plant", *(tuple(Q(getattr(s, end)) + sign * Q(s.error) for s in read)
                                  for end, sign in (("lo", -1), ("hi", 1))))


@dataclass(frozen=True)
class Claim:
    """One claim.

    Parameters
    ----------
    id : str
    text : str
        As the header and ``residua certify`` print it.
    plant : tuple of str
        Entries of the plant file, matrices by their name alone.
    words, formula, source, code : str
        The condition: in words, as a formula, where it is published, which function decides it.
    constants : tuple of str
        Of the tables, without the side.
    margins : tuple of Margin
        Empty where the condition is no inequality.
    checks : tuple of str
        What speaks for it (``checks.CHECKS``).
    """

    id: str
    text: str
    plant: tuple[str, ...]
    words: str
    formula: str
    source: str
    code: str
    constants: tuple[str, ...]
    margins: tuple[Margin, ...]
    checks: tuple[str, ...]


class OwnClaims(Protocol):
    """What the module of a family has whose certificate has claims of its own."""

    def of_certificate(self, design, t, cert: dict, build: type, plant: tuple,
                       own: tuple) -> Iterator[tuple[str, Callable]]:
        """Yield (beginning of the sentence, what makes its claim), in the order in which the certificate states them.

        Parameters
        ----------
        design : Design
        t : Tables
            Of the family, for one number type.
        cert : dict
        build : type
            ``Claim``.
        plant : tuple of str
            Entries of the plant file that all conditions come from.
        own : tuple of str
            Checks by exact arithmetic.
        """

    def ranges(self, design, t, cert: dict, build: type, checks: tuple) -> Claim:
        """State where observer and bounds start."""


#: Families whose certificate has claims of its own.
OWN: dict[str, OwnClaims] = {
    "filter": filter_claims, "mode": mode_claims, "driven": driven_claims, "polytopic": polytopic_claims,
    "descriptor": polytopic_claims, "sliding": sliding_claims, "bank": bank_claims, "follower": follower_claims,
    "guided": guided_claims, "guided_point": guided_point_claims, "guided_filter": guided_filter_claims,
    "trailing": trailing_claims}


def claims(design, real: str) -> list[Claim]:
    """State all claims of a design for one number type.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    list of Claim

    Raises
    ------
    CertificateError
        A sentence of the certificate has no condition here, or a condition does not hold.
    """
    t, cert, plant = design.observer.tables[real], design.certificate[real], design.plant
    out, point = [], hasattr(t, "shape")
    own, modes = OWN.get(design.observer.family), (plant.enclosed if point else plant.observed).modes
    of = tuple(dict.fromkeys((*PLANT, *sampling_claims.entries(design))))
    made = point_claims.of_certificate(design, t, cert, modes, Claim, of, EXACT) if point else (
        own.of_certificate(design, t, cert, Claim, of, EXACT) if own else _of_certificate(design, t, cert, modes))
    made = chain(made, sampling_claims.of_certificate(design, t, Claim, of, EXACT))  # after the check of all
    for (begins, make), sentence in zip_longest(made, design.claims(real), fillvalue=("no other", None)):
        if make is None or not isinstance(sentence, str) or not sentence.startswith(begins):
            raise CertificateError(f"assurance: no condition is known for the claim {sentence!r} (expected one that "
                                   f"begins with {begins!r}). Add it to codegen/assurance/claims.py.")
        out.append(_held(make(sentence)))
    start = point_claims.ranges(design, t, Claim, EXACT) if point else (
        own.ranges(design, t, cert, Claim, EXACT) if own else _ranges(design, t))
    others = [start, *_parameters(t, modes or [Box.of(design.plant)]), *_monitor(design, cert)]
    return [*out, *map(_held, others), *_detection(design, t, cert, real), *_of_the_c()]


def _held(claim: Claim) -> Claim:
    """Refuse a claim whose condition does not hold."""
    for margin in claim.margins:
        if not margin.holds:
            raise CertificateError(f"assurance: {claim.id}: {margin.what} is {float(margin.left):.3g} at "
                                   f"{margin.where} (expected {'> 0' if margin.strict else '>= 0'}). Design again.")
    return claim


def _of_certificate(design, t, cert, modes):
    """Yield (beginning of the sentence, what makes its claim), in the order of ``certify.claims.check``."""
    family, timed = _source(inspect.getmodule(type(design.observer))), _timed(design)
    varying, late = (*SLOPES, *RADII) * (t.vary is not None), t.vary is not None and t.vary.late
    z = t.change is not None
    maps = ("Z", "X", "e", "b") * z
    about = " Of z = Z x in place of x, with x = X z; T stands for Z." * z

    def claim(id, words, formula, source, code, found, plant=PLANT, constants=GAINS, checks=EXACT):
        return lambda text: Claim(id, text, (*plant, *timed), words, formula, source, code if isinstance(code, str)
                                  else _code(code), (*constants, *varying), tuple(found), checks)

    gain = "T A - L C" if design.observer.family == "tnl" else "Z (A - L C) Z^-1" if z else "A - L C"
    if t.signed:
        yield f"each entry of {gain if z else 'T A - L C'} takes the bound", claim(
            "signs", "Each product with a state is taken at the end of its interval that bounds it.",
            f"lo: M_ij x_lo_j where M_ij >= 0, M_ij x_hi_j where M_ij < 0; hi mirrored; M = {gain} up to rounding",
            family, certificate._nonnegative, margins.nonnegative(modes, t), plant=("A", "C", "constants"),
            constants=("M", "L", "N"))
    else:
        yield f"{gain if z else 'T A - L C'} >= 0", claim(
            "nonnegative", "Errors of the framers keep their sign: the matrix that carries them on has no negative "
            "entry" + (" at any corner of the box of theta." if varying else "."),
            f"M >= 0 elementwise, M = {gain} up to rounding, T = I - N C" + ("; M, A, L affine in theta" if varying
                                                                           else ""),
            family, certificate._nonnegative, margins.nonnegative(modes, t), plant=("A", "C", "constants"),
            constants=("M", "L", "N"))
    yield "x_lo <= x <= x_hi", claim(
        "containment", "Each offset reaches beyond the worst disturbance, noise and rounding, so no step loses the "
        "state." + about + (" What the parameters do that nobody measures is covered by the radii." if varying else "")
        + (" Where the mode that is told has changed, the bounds of both modes are joined." if late else ""),
        ("sum |T A_unc| + |T| A_rad <= R up to what the offset takes, S alike of B, |Dv (v - middle)| <= E where L "
         "depends on theta; for every theta in its box: " if varying else "")
        + f"d_hi >= max[T Bw w - L Dv v - N Dv v+ + (T A - L C - M{' Z' * z}) x + (T B - L D - G) u] + rounding of "
        "inputs and sums; mirrored for d_lo; a and c alike for x+ = A x + B u + Bw w and y = C x + D u + Dv v"
        + "; e for z = Z x and b >= |I - X Z| box for x = X z" * z,
        family, containment.Containment, margins.contained(modes, t),
        constants=("M", "G", "L", "N", "d", "A", "B", "a", "C", "D", "c", *("Ra", "Sa") * bool(varying), *maps),
        checks=(*EXACT, "rounding", "validation", "target"))
    yield "the framers ", claim(
        "bounded", "The framers stay in the box on which the rounding margins rest.",
        "|x_lo|, |x_hi| <= box: both are cut to the declared ranges"
        + "; z_lo <= min Z x, z_hi >= max Z x over the range of x" * z if t.clamp else
        "|M| box + |G| u_max + (|L| + |N|) y_max + |d| + rounding <= box", _own(freeze.box_holds),
        certificate._bounded if t.clamp else freeze.box_holds, margins.bounded(modes, t),
        constants=(*GAINS, "x", "x0", "u", "y") if not t.clamp else ("x", "x0", *("z",) * z), checks=(*EXACT, "prove"))
    if cert["kind"] == "linf":
        yield "L-infinity: ", claim(
            "linf", "A Lyapunov function of the framers' errors decreases in every mode, grows by at most rho at a "
            "switch, and switches are rare enough.", "[[(1 - lambda) P, 0, (P M)'], [0, mu I, (P H)'], [P M, P H, P]] "
            "> 0, H = [I, L, N]; P_q <= rho P_l; (1 - lambda)^add rho^drain < 1; level^2 >= factor mu theta^2",
            f"{_first(criteria.check_linf)} {_first(criteria.lyapunov_block)}", criteria.check_linf,
            margins.linf(modes, t, cert), plant=(*PLANT, "switching.average_dwell", "switching.minimum_dwell",
                                                 "switching.chatter"))
    if cert["kind"] == "width":
        yield "Width: ", claim(
            "width", "A positive weighted sum of the widths shrinks in every mode.",
            "p' M_q <= (1 - a) p', p > 0, 0 < a < 1; level >= p' push / a", _own(criteria.check_width),
            criteria.check_width, margins.width(modes, t, cert))
    if cert.get("steady_box"):
        yield "Ultimate width ", claim(
            "ultimate-width", "A box of errors that no mode lets them leave, and into which every error shrinks.",
            "M_q z + push_q <= z and M_q z < z in every mode" + "; |X| z + 2 (b_hi - b_lo) <= width of x" * z,
            _own(criteria.check_box), criteria.check_box, margins.box(modes, t, cert))
    if design.plant.kind == "continuous":
        yield "between samples, ", claim(
            "sampling", "The tables are proved for a discrete plant with bounded unknowns that encloses the continuous "
            "one over every sampling period.", "x(h) = Phi x + integral of Phi Bw w; Phi in A + sum theta_j A_theta_j "
            "+ sum s_l A_unc_l + [-A_rad, A_rad], |s_l| <= 1 (Peano and Baker, order by order, with the tail)",
            "own derivation: the discrete plant of a continuous one at its sampling period",
            "codegen.plant.sampling.sampled", (), constants=(*GAINS, "A", "B", "a", "Ra", "Sa"),
            checks=(*EXACT, "validation"))


def _timed(design) -> tuple[str, ...]:
    """Entries of the plant file that the tables of parameters and of a sampled plant come from."""
    sampled = ("time.kind", "time.sample_period", "observer.sampling") if design.plant.kind == "continuous" else ()
    late = ("switching.late",) * design.plant.switching.late
    return (*sampled, *THETA, *late) if sampled or design.plant.theta else late


def _parameters(t, modes) -> list[Claim]:
    if t.vary is None or not t.vary.parameters:
        return []
    return [Claim("parameters", "every measured parameter within its bounds in the mode is accepted, any other refused",
                  THETA, "What the check accepts is rounded outward; the conditions hold for all of it.",
                  "theta_lo <= lower bound - error, theta_hi >= upper bound + error, in each mode",
                  _own(margins.parameters), _code(margins.parameters), ("theta",),
                  tuple(margins.parameters(modes, t)), ("exact", "independent", "read-back", "validation"))]


def _ranges(design, t) -> Claim:
    limits = {"x": design.plant.limits("x"), "x0": (design.plant.x0_lo, design.plant.x0_hi)}
    return Claim("ranges", "the framers start from, and restart to, boxes that hold what the plant file declares",
                 ("signals.x", "initial.x_lo", "initial.x_hi"), "The boxes of init and reset are rounded outward.",
                 "x0_lo <= initial x_lo, x0_hi >= initial x_hi; x_lo, x_hi alike", _own(certificate.check_ranges),
                 _code(certificate.check_ranges), ("x", "x0"), tuple(margins.ranges(limits, t)), EXACT)


def _monitor(design, cert) -> list[Claim]:
    s = design.observer.supervision
    if not s.monitors_dwell:
        return []
    tau, chatter = s.dwell_add / s.dwell_drain, s.dwell_limit / s.dwell_add
    return [Claim("monitor", f"assured is withdrawn where switching breaks an average dwell time of {tau:.6g} samples "
                  f"with chatter bound {chatter:.6g}", ("switching.average_dwell", "switching.minimum_dwell",
                                                        "switching.chatter", "time.sample_period"),
                  "The leaky bucket overflows before the switching is faster than the proof allows.",
                  "add / drain >= average dwell time of the certificate, limit <= chatter bound * add",
                  _own(certificate.check_monitor), _code(certificate.check_monitor),
                  ("dwell_add", "dwell_drain", "dwell_limit"), tuple(margins.monitor(s, cert)),
                  ("exact", "read-back", "validation", "target"))]


def _detection(design, t, cert, real) -> list[Claim]:
    """One claim per fault channel: the size from which a step is found, last delay."""
    seen, constants = getattr(OWN.get(design.observer.family), "SEEN", ("output", (*GAINS, "C", "D", "c")))
    stored = design.detection[real]
    within, out = max((len(f["by_delay"]) - 1 for f in stored), default=0), []
    promised = any(size is not None for f in stored for size in f["by_delay"])
    found = surely_detected(design.plant, t, cert, within) if promised else [None] * len(stored)
    for fault, old in zip(found, stored, strict=True):
        channel = old["channel"]
        for claimed, fresh in zip(old["by_delay"], fault.by_delay if fault else old["by_delay"], strict=True):
            if claimed is not None and claimed < fresh * (1 - 1e-9):
                raise CertificateError(f"assurance: fault {channel} is claimed to be found from {claimed:.6g} on, only "
                                       f"{fresh:.6g} is sure. Design again.")
        size, unit = old["by_delay"][-1], old["unit"]
        settled = any(f["channel"] == channel for f in cert.get("faults", ()))
        none = f"no size of the fault {channel} is claimed to be found" + ", whatever the modes do" * settled
        text = none if size is None else (
            f"a step of the fault {channel} of {size:.6g}{' ' + unit if unit else ''} or more raises an alarm "
            f"{_when(old['by_delay'].index(size))}")
        conditional = t.vary is not None and design.plant.acts_on_state(channel)
        courses = "admissible mode sequence" if design.plant.polytope is None else "course of the weights"
        out.append(Claim(f"detection-{channel}", text, (*PLANT, "Bf", "Df", "signals.f", *_timed(design)),
                         f"For every {courses}, disturbance and noise, some {seen} leaves its bounds"
                         + (", as long as no state bound is on the far end of its declared range (x_hi on the least, "
                            "x_lo on the largest value)." if conditional else "."),
                         f"size > sup r_i / |response_i| for an {seen} i, worst over sequences (double precision, a "
                         "part in a million added)", _own(inspect.getmodule(surely_detected)),
                         _code(surely_detected), constants, (),
                         ("detection", "read-back", "validation")))
    return out


def _when(delay: int) -> str:
    return f"within {delay} sample{'s' * (delay > 1)}" if delay else "at its first sample"


def _of_the_c() -> list[Claim]:
    """What is claimed of the C itself."""
    contract = "contract of the generated C (templates/README.md)"
    return [Claim("arithmetic", "the C computes the same numbers as the numpy reference, bit for bit", (),
                  "IEEE 754 arithmetic, operation by operation, in the order that is written.",
                  "C == reference for every sample of every scenario and of the golden vectors", contract,
                  "codegen.analysis.validate.validate", (), (), ("compile", "validation", "target")),
            Claim("execution", "no call of the C does anything undefined, every number stays finite, and a refused "
                  "call changes nothing", (), "Every state in the box, every input and every mode is covered by "
                  "intervals; random ones are tried.",
                  "no alarm of the analyser; no report of a sanitizer", contract, "codegen.target.prove.prove", (), (),
                  ("prove", "fuzz"))]


def _source(module) -> str:
    """The first sentence after "Source:" in a docstring."""
    _, mark, found = (inspect.getdoc(module) or "").partition("Source:")
    return " ".join(found.replace("``", "").split()).split(". ")[0].rstrip(".") if mark else module.__name__


def _first(thing) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(thing) or "").splitlines()[0].replace("``", "")


def _own(thing) -> str:
    """A condition that no publication states, in the words of the code."""
    return f"own derivation: {_first(thing)}"


def _code(thing) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"
