"""The claims of a filter that sliding modes guide: the estimator's, and what thresholds and starts hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..certify.exact import rational
from ..certify.loose_filter import rounded_start
from ..selection.trailing_claims import demands
from . import filter_claims, sliding_claims
from .driven_claims import shared
from .margins import Margin, tightest
from .trailing_claims import GAINS, RUN, STAYS, claimer, energy, level, settled

#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("estimate or output", (*sliding_claims.PAIRS, *GAINS, "told_h"))


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``selection.guided_filter_claims``."""
    decision, test, box, *others = sliding_claims.of_certificate(design, t, cert, build, plant, own)
    of_plant, run = (*plant, *sliding_claims.PLANT), (*own, *RUN)
    held, claim = filter_claims.held(demands(design.plant, t, cert), "in row"), claimer(build, of_plant)
    yield from (decision, test, box)
    yield energy(build, of_plant, own, level(design.plant, t, cert))
    yield "while no fault acts and out->mode has been the true mode", claim(
        "bound", "A filter starts as if it had followed the middle of the declared range, whenever the estimator's "
        "bounds are that range, or goes on from anywhere. From each such start on a set |r_i e| <= b_i of plant and "
        "filter holds both, a step of the mode after the other, and each threshold the estimate over all of it. "
        "Filters and estimator accept the same inputs; no filter reaches its limits without a fault.",
        f"{STAYS}; |r e| <= |r_x + r_s E| |c| + |r_x| |d| + |r_s| (begun - E c) at a start, d half of the declared "
        "range; b_i < limit_i of the rows of xi", "codegen.certify.loose_filter.demands",
        [*held["kept"], *held["threshold"], *held["start"], *begun(t), *shared(t, "filters"), *held["limit"]],
        (*GAINS, "told_h", "told_limit", "begun", "x", "u", "y"), (*run, "prove"))
    yield settled(claim, held["last"], run)
    yield from others


def begun(t) -> list[Margin]:
    """The states at a start, and the half widths, against what the proof takes them for."""
    told, c = t.told, rational(t.x_lo / 2 + t.x_hi / 2)
    _, lost = rounded_start(told)
    off = [abs(rational(state) - rational(E) @ c) for state, E in zip(t.begun, told.E)]
    slips = [(room - x, f"xi[{i}], mode {q}") for q, pair in enumerate(zip(lost, off))
             for i, (room, x) in enumerate(zip(*pair))]
    half = rational(told.sizes[0]) - np.maximum(rational(t.x_hi) - c, c - rational(t.x_lo))
    return [tightest("rounding of a start beyond what it is off", slips),
            tightest("half width of a start beyond the declared range", [
                (x, f"state {i}") for i, x in enumerate(half)])]


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the pairs start, and what the filters start from after every detection."""
    pairs = sliding_claims.ranges(design, t, cert, build, checks)
    return replace(pairs, words=f"{pairs.words} So is the range from the middle of which the filters start.",
                   constants=(*pairs.constants, "begun"))
