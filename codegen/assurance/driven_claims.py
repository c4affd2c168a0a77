"""The claims of framers that a mode estimator drives: those of both, and what joins them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

from ..certify import driven_certificate
from ..certify.exact import Q
from . import margins, mode_claims
from .margins import Margin, tightest

GAINS = ("M", "G", "L", "N", "d", "M_theta", "G_theta", "L_theta", "theta_weight", "R", "S", "E")
BLIND = ("A", "B", "a", "Ra", "Sa")
JOINT = ("forth", "xi_room", "frame_limit", "x")
CHANGED = ("Z", "X", "e", "b", "z")
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", (*mode_claims.BOXES, *GAINS, "D", "v"))
THETA = ("signals.theta", "mode.bounds")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``driven_certificate.check``."""
    modes, told = design.plant.observed.modes, t.told
    z = told.change is not None
    of_plant = (*plant, *mode_claims.PLANT, *THETA)
    first, *others = mode_claims.of_certificate(design, t, cert, build, of_plant, own)

    def claim(id, words, formula, found, code, constants, checks):
        return lambda text: build(id, text, (*of_plant, *mode_claims.DWELL), words, formula,
                                  f"own derivation: {(inspect.getdoc(driven_certificate) or '').splitlines()[0]}", code,
                                  constants, tuple(found), checks)

    yield first
    yield "framers are kept for every mode", claim(
        "framers", "A step of mode q carries every state between its framers: entries of M are nonnegative or take the "
        "opposite bound, each offset and radius reaches beyond disturbance, noise, rounding and what parameters do "
        "that nobody measures. A mode that was active for less than a period starts from the boxes, which know of it."
        + " The step is that of z = Z x, with x = X z; where x starts or is widened, z starts from what Z makes of it."
        * z,
        "M >= 0 elementwise, or the bound that its sign asks for; d_hi >= max[T Bw w - L Dv v - N Dv v+ + (T A - L C - "
        f"M{' Z' * z}) x + (T B - L D - G) u] + rounding of inputs and sums; mirrored for d_lo; a alike for x+ = A x + "
        "B u + Bw w" + "; T = Z; e alike for z = Z x, b >= |I - X Z| box for x = X z; z_lo <= min Z x, z_hi >= max Z x"
        * z,
        [*margins.nonnegative(modes, told), *margins.contained(modes, told), *margins.bounded(modes, told)],
        "codegen.certify.claims.check", (*GAINS, *BLIND, "x", *CHANGED * z), (*own, "rounding", "validation", "target"))
    yield "no switching makes the bounds grow", claim(
        "joined", "Boxes and framers cut each other: S x of the framers holds S x with its rounding, and the framers "
        "are cut to what is answered of the boxes, which are cut to their limits.",
        "xi_room >= |S - S_rounded| box + gamma (|S_rounded| box + xi_room); ranges of x within those of the framers",
        joined(t), "codegen.certify.driven_certificate.check_joint", (*JOINT, "S_inverse", "x_room", "limit"),
        (*own, "rounding", "prove"))
    yield from others


def joined(t, whose: str = "framers") -> list[Margin]:
    """What framers (or the observer) and estimator share: the room for S x, the ranges of x, what both accept."""
    driven_certificate.check_joint(t)
    room = [(Q(given) - needed, f"xi[{i}]") for i, (given, needed) in enumerate(driven_certificate.rooms(t))]
    return [tightest("room for S x beyond rounding", room), *shared(t, whose)]


def shared(t, whose: str = "framers") -> list[Margin]:
    """The ranges of x, and what both accept."""
    told = t.told
    x = [(sign * (Q(a) - Q(b)), f"state {i}, {side}") for side, sign in (("lo", 1), ("hi", -1))
         for i, (a, b) in enumerate(zip(getattr(t, f"x_{side}"), getattr(told, f"x_{side}")))]
    accepted = [(sign * (Q(a) - Q(b)), f"{v}[{i}], {side}") for v in "uy" for side, sign in (("lo", 1), ("hi", -1))
                for i, (a, b) in enumerate(zip(getattr(t, f"{v}_{side}"), getattr(told, f"{v}_{side}")))]
    return [tightest(f"ranges of the {whose} beyond those of x", x),
            tightest(f"ranges of inputs and measurements of the {whose} beyond what is accepted", accepted)]


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the boxes start; framers start from them."""
    return mode_claims.ranges(design, t, cert, build, checks)
