"""The claims of a point observer that follows a mode estimator: those of both, and what joins them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import replace

from ..certify import follower_certificate, set_claims
from . import mode_claims, point_claims, point_margins
from .driven_claims import joined
from .margins import Margin

#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", (*mode_claims.BOXES, "D", "v", *(f"told_{name}" for name in point_claims.ESTIMATE)))
START = {"grow": "factor of a half width beyond what three roundings take of it",
         "square": "factor of its square beyond the number of states and three roundings",
         "floor": "least half width beyond what numbers below the normal ones lose"}
#: What the bounds of every start are made of, and what they are compared with.
STARTS = ("grow", "square", "floor", "x", "widest", "turn", "told_x_hat", "told_x_set")
JOINT = ("forth", "xi_room", "told_box", "S_inverse", "x_room", "limit")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``follower_certificate.check``."""
    told, kind = t.told, cert["told"]["set"]
    first, *others = mode_claims.of_certificate(design, t, cert, build, plant, own)
    held = held_by_set(design.plant, t, cert["told"])
    every = tuple(sorted(f"told_{name}" for name in point_claims._names(told)))
    alarm, state = point_claims.WORDS[kind]

    def claim(id, words, formula, found, code, constants, checks):
        return lambda text: build(id, text, (*plant, *mode_claims.PLANT, *mode_claims.DWELL), words, formula,
                                  f"own derivation: {(inspect.getdoc(follower_certificate) or '').splitlines()[0]}",
                                  code, constants, tuple(found), checks)

    code = f"{set_claims.CHECKS[kind].__module__}.{set_claims.CHECKS[kind].__qualname__}"
    yield first
    yield "the observer runs in the mode that is decided for", claim(
        "followed", "Whatever disturbance, noise, left over constants and rounding do in a step of the mode is inside "
        "what the set gets for it. The set begins with no less than the box of the bounds over all hypotheses of the "
        "mode: half widths are computed from the centre as it was rounded, then made larger.",
        f"{alarm}; {state}; grow (1 - u)^3 >= 1, square (1 - u)^3 >= n_x, floor beyond subnormal numbers",
        [*held["alarm"], *held["state"], *starts(t)], code, (*every, *STARTS),
        (*own, "rounding", "validation", "target"))
    yield "a mode whose observer has its residual outside", claim(
        "ruled-out", "A residual outside what the set allows is no residual of a mode that was active all through the "
        "period. Boxes are cut to S x of the estimate's bounds, which holds S x with its rounding, and bounds of x to "
        "the boxes; sets and estimate stay within the sizes that all rounding margins rest on.",
        f"{alarm}; xi_room >= |S - S_rounded| box + gamma (|S_rounded| box + xi_room); |x_hat| <= box, box >= |x| + "
        "limit; a half width beyond its limit starts the set again from the declared range, which the limit holds",
        [*held["alarm"], *joined(t, "observer"), *held["bounded"]], code, (*every, *JOINT),
        (*own, "rounding", "prove", "validation"))
    if t.by_table:
        yield "its set is a table", claim(
            "table", "A start takes the smallest listed size that holds its half widths, the part for every error "
            "where none does, and counts samples while the mode stays.", alarm, held["alarm"], code, every,
            (*own, "validation", "target"))
    yield from others


def held_by_set(plant, t, cert: dict) -> dict[str, list[Margin]]:
    """By how much the conditions of the observer's set hold, where it is told its mode."""
    return point_margins.HELD[cert["set"]](plant.enclosed.modes, t.told, cert)


def starts(t) -> list[Margin]:
    """What a start that is computed has beyond its rounding."""
    return [Margin(START[name], room) for name, room in follower_certificate.start_rooms(t).items()]


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the boxes start, and the set that knows nothing but the declared range."""
    boxes = mode_claims.ranges(design, t, cert, build, checks)
    whole = point_margins.starts({"x": design.plant.limits("x")}, t.told, t.alone)
    return replace(boxes, words=f"{boxes.words} So is the set that a start has which is wider than the declared range.",
                   constants=(*boxes.constants, "told_x_hat", "told_x_set"), margins=(*boxes.margins, *whole))
