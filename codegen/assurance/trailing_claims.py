"""The claims of filters beside a mode estimator: those of both, and of the starts that join them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

from ..certify import loose_filter, switched_gain
from ..selection.filter_designs import problem_for
from ..selection.trailing_claims import demands, staying
from . import filter_claims, mode_claims
from .driven_claims import shared
from .margins import Margin

RUN = ("rounding", "validation", "target")
GAINS = tuple(f"told_{name}" for name in filter_claims.GAINS)
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("estimate or output", (*mode_claims.BOXES, "D", "v", *GAINS, "told_h"))
#: What the state and the thresholds of a start are made of.
STARTS = ("told_E", "told_sizes", "told_grow", "told_floor", "x", "S_inverse", "x_room")
STAYS = ("|r_i J - sum lambda_j r_j| |e| + sum |lambda_j| b_j + |r_i W| 1 + sum |r_i h_l| (|S_l e| + weight_l |e| + "
         "room_l) <= b_i of every mode alone; h >= the same of f_hat = O e + V d")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``selection.trailing_claims.check``."""
    of_plant = (*plant, *mode_claims.PLANT, "signals.theta")
    held = filter_claims.held(demands(design.plant, t, cert), "in row")
    run, claim = (*own, *RUN), claimer(build, (*of_plant, *mode_claims.DWELL))
    yield energy(build, of_plant, own, level(design.plant, t, cert))
    yield "while no fault acts and out->mode is the true mode", claim(
        "bound", "A filter starts as if it had followed the centre of the bounds over all hypotheses of its mode, or "
        "goes on from anywhere. From each such start on a set |r_i e| <= b_i of plant and filter holds both, a step of "
        "the mode after the other, and each threshold the estimate over all of it.", f"{STAYS}; |r e| <= |r_x + r_s E| "
        "|c| + |r_x| |d| + |r_s| (rounding of E c) at a start, d below one of the sizes",
        "codegen.certify.loose_filter.demands", [*held["kept"], *held["threshold"]], (*GAINS, "told_h", *STARTS), run)
    yield "a mode whose filter estimates more", claim(
        "ruled-out", "An estimate beyond its threshold is none of a mode that was active all through the period: only "
        "(q, 0), from which a filter starts anew or goes on from anywhere, is left. Half widths hold those of the "
        "bounds with their rounding, the largest size all of the declared range; filters and estimator accept the same "
        "inputs; a filter beyond its limits, which none reaches without a fault, is read no more.",
        "grow (1 - u)^3 >= 1, floor beyond subnormal numbers, sizes[0] >= half of the declared range; b_i < limit_i of "
        "the rows of xi", "codegen.certify.loose_filter.start_rooms", [
            *held["start"], *shared(t, "filters"), *held["limit"]], (*STARTS, "told_h", "told_limit"),
        (*run, "prove"))
    yield settled(claim, held["last"], run)
    yield from mode_claims.of_certificate(design, t, cert, build, of_plant, own)


def claimer(build: type, plant: tuple) -> Callable:
    """What makes the claims of filters that start at run time, from these entries of the plant file."""
    derived = f"own derivation: {(inspect.getdoc(loose_filter) or '').splitlines()[0]}"

    def claim(id, words, formula, code, found, constants, checks, source=derived):
        return lambda text: build(id, text, plant, words, formula, source, code, constants, tuple(found), checks)

    return claim


def energy(build: type, plant: tuple, own: tuple, found: list[Margin]) -> tuple[str, Callable]:
    """The claim of the level in modes that stay; ``found`` of ``level``."""
    return "energy: ", claimer(build, (*plant, *filter_claims.FAULTS))(
        "energy", "For each mode a quadratic function of plant, weights and filter pays for the error of the estimate, "
        "at every step in that mode and for every value of what is uncertain.",
        "g |d|^2 - |z|^2 + V_q(x) - V_q(x+) > sum of s' T s - p' T p + 2 s' G p of what is uncertain, T >= 0, G skew; "
        "level^2 >= g", "codegen.certify.switched_gain.check_gain", found, GAINS, own,
        "Farhat and Koenig (2016), bounded real inequality, of modes that stay")


def settled(claim: Callable, found: list[Margin], checks: tuple) -> tuple[str, Callable]:
    """The claim of the thresholds in a mode that lasts; ``claim`` of ``claimer``."""
    return "in a mode that lasts f_bound", claim(
        "settled", "The last row of each start holds for ever: its set is not left.",
        "h[last] >= the bound of the estimate over the set", "codegen.certify.loose_filter.tabled", found,
        ("told_h",), checks)


def level(plant, t, cert: dict) -> list[Margin]:
    """By how much the energy inequality of every mode that stays holds."""
    told, stays = staying(plant)
    return filter_claims.energy(switched_gain.inequalities(*problem_for(told, t.told, stays), cert["told"]["energy"]),
                                cert["told"])


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the boxes start; filters start from them."""
    return mode_claims.ranges(design, t, cert, build, checks)
