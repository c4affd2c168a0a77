"""The claims of a point observer that sliding modes guide: the estimator's, and what the set of its mode holds."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..certify import guided_point_certificate, set_claims
from ..certify.exact import rational
from . import point_claims, point_margins, sliding_claims
from .driven_claims import shared
from .follower_claims import held_by_set
from .margins import Margin

#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", (*sliding_claims.PAIRS, *(f"told_{name}" for name in point_claims.ESTIMATE)))


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``guided_point_certificate.check``."""
    guided_point_certificate.check_joint(t)
    kind = cert["told"]["set"]
    decision, test, box, *others = sliding_claims.of_certificate(design, t, cert, build, plant, own)
    held = held_by_set(design.plant, t, cert["told"])
    alarm, state = point_claims.WORDS[kind]
    code = f"{set_claims.CHECKS[kind].__module__}.{set_claims.CHECKS[kind].__qualname__}"
    every = tuple(sorted(f"told_{name}" for name in point_claims._names(t.told)))

    def claim(id, words, formula, found, constants=every, checks=(*own, "rounding", "validation", "target")):
        return lambda text: build(
            id, text, (*plant, *sliding_claims.PLANT), words, formula,
            f"own derivation: {(inspect.getdoc(guided_point_certificate) or '').splitlines()[0]}", code, constants,
            tuple(found), checks)

    yield from (decision, test, box)
    yield "the observer runs in the mode that is decided for", claim(
        "observer", "Whatever disturbance, noise, left over constants and rounding do in a step of the mode is inside "
        "what the set gets for it; the set begins at the declared range whenever the estimator's bounds do, and the "
        "bounds of x are cut to these, which hold the state under the same condition. Sets and estimate stay within "
        "the sizes that all rounding margins rest on.",
        f"{alarm}; {state}; |x_hat| <= box, box >= |x| + limit; a half width beyond its limit starts the set again "
        "from the declared range, which the limit holds; ranges of x, u and y within those of the observer",
        [*held["alarm"], *held["state"], *held["bounded"], *shared(t, "observer")],
        (*every, "told_x_hat", "told_x_set", "told_box", "x", "u", "y"))
    if t.by_table:
        yield "its set is a table", claim(
            "table", "A start takes the smallest listed size that holds the half widths of the declared range, the "
            "part for every error where none does, and counts samples while the mode stays.",
            f"{alarm}; half widths >= |x - centre|", [*held["alarm"], widest(t)], (*every, "widest"),
            (*own, "validation", "target"))
    yield from others


def widest(t) -> Margin:
    """The half widths with which a table starts against the range that they must hold."""
    centre, lo, hi = (rational(a) for a in (t.middle, t.x_lo, t.x_hi))
    return point_margins.entrywise("half widths of a start beyond the declared range", rational(t.widest),
                     np.maximum(hi - centre, centre - lo))


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the pairs start, and the set that the observer starts from after every detection."""
    pairs = sliding_claims.ranges(design, t, cert, build, checks)
    whole = point_margins.starts({"x": design.plant.limits("x")}, t.told, t.alone)
    return replace(pairs, words=f"{pairs.words} So is the set that the observer starts from.",
                   constants=(*pairs.constants, "told_x_hat", "told_x_set"), margins=(*pairs.margins, *whole))
