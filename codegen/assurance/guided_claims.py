"""The claims of framers that sliding modes guide: the estimator's, and what the framers of its mode hold."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

from ..certify import guided_certificate
from . import margins, sliding_claims
from .driven_claims import BLIND, CHANGED, GAINS, shared

#: Constants of the framers: "told_" keeps them apart from those of the pairs, which have some names in common.
TOLD = tuple(f"told_{name}" for name in (*GAINS, *BLIND, "x"))
TURNED = tuple(f"told_{name}" for name in CHANGED)
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", (*sliding_claims.PAIRS, *TOLD, *(f"told_{name}" for name in "CDc")))


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``guided_certificate.check``."""
    modes, told = design.plant.observed.modes, t.told
    z = told.change is not None
    guided_certificate.check_joint(t)
    decision, test, held, *others = sliding_claims.of_certificate(design, t, cert, build, plant, own)
    yield from (decision, test, held)
    yield "the framers of a mode hold the state", lambda text: build(
        "framers", text, (*plant, *sliding_claims.PLANT),
        "A step of the mode that is decided for carries every state between its framers: entries of M are nonnegative "
        "or take the opposite bound, each offset and radius reaches beyond disturbance, noise and rounding; c alike, "
        "so that y is within its bounds. The framers begin at the declared range whenever the estimator's bounds do, "
        "and are cut to these, which hold the state under the same condition."
        + " The step is that of z = Z x, with x = X z; z begins with what Z makes of x and is cut to it." * z,
        "M >= 0 elementwise, or the bound that its sign asks for; d_hi >= max[T Bw w - L Dv v - N Dv v+ + (T A - L C - "
        f"M{' Z' * z}) x + (T B - L D - G) u] + rounding of inputs and sums; mirrored for d_lo; a alike for x+ = A x + "
        "B u + Bw w, c for y = C x + D u + Dv v; ranges of x, u and y within those of the framers"
        + "; T = Z; e alike for z = Z x, b >= |I - X Z| box for x = X z; z_lo <= min Z x, z_hi >= max Z x" * z,
        f"own derivation: {(inspect.getdoc(guided_certificate) or '').splitlines()[0]}", "codegen.certify.claims.check",
        (*TOLD, *TURNED * z, *(f"told_{name}" for name in "CDc"), "x", "u", "y"),
        (*margins.nonnegative(modes, told), *margins.contained(modes, told), *margins.bounded(modes, told), *shared(t)),
        (*own, "rounding", "validation", "target"))
    yield from others


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the pairs start; framers start from the declared range, as these do after a detection."""
    return sliding_claims.ranges(design, t, cert, build, checks)
