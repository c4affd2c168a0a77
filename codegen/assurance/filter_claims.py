"""The claims of a fault estimation filter: what each rests on, by how much it holds."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

import numpy as np

from ..certify import filter_bounds, filter_model
from ..certify.exact import Q
from ..selection import filter_designs
from .margins import Margin, _pivots, tightest

GAINS = ("M", "G", "L", "K", "Du", "Dy")
#: What leaves its bounds where a fault is found, and the constants behind that.
SEEN = ("estimate", (*GAINS, "h"))
#: Entries of the plant file beside those of every design.
PLANT = ("Dw", "signals.theta", "switching.average_dwell", "switching.minimum_dwell", "switching.chatter")
FAULTS = ("Bf", "Df", "signals.f", "observer.target", "observer.colour")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``filter_designs.sentences``."""
    rests = f"own derivation: {(inspect.getdoc(filter_model) or '').splitlines()[0]}"
    found = thresholds(design.plant, t, cert)
    run = (*own, "rounding", "validation", "target")

    def claim(id, words, formula, source, code, margins, plant=(*plant, *PLANT), constants=(*GAINS, "h"),
              checks=run):
        return lambda text: build(id, text, plant, words, formula, source, code, constants, tuple(margins), checks)

    yield "energy: ", claim(
        "energy", "A quadratic function of plant, weights and filter pays for the error of the estimate, at every step "
        "of every mode sequence that is admitted and for every value of what is uncertain.",
        "g |d|^2 - |z|^2 + V_a(x) - V_b(x+) > sum of s' T s - p' T p + 2 s' G p of what is uncertain, T >= 0, G skew, "
        "on every edge a -> b; level^2 >= g", "Farhat and Koenig (2016), bounded real inequality per edge, corrected",
        "codegen.certify.switched_gain.check_gain", energy(filter_designs.inequalities(design.plant, t, cert), cert),
        (*plant, *PLANT, *FAULTS), GAINS, own)
    if "calibration" in cert:
        yield "not proved but calibrated", claim(
            "calibrated", "The last row is what simulated runs without fault give; the rows of the starts are proved.",
            "thresholds of the rows before the last >= the estimate; chance and confidence by order statistics",
            rests, "codegen.selection.filter_calibration.check", [*found["kept"], *found["threshold"]],
            checks=("read-back", "validation", "target"))
    else:
        yield "while no fault acts no |f_hat| exceeds", claim(
            "no-alarm", "A set |r_i e| <= b_i of plant and filter together is kept by every step, whatever "
            "disturbance, noise, inputs, unknown parameters and rounding do; each threshold holds the estimate over "
            "all of the set.",
            "|r_i J - sum lambda_j r_j| |e| + sum |lambda_j| b_j + |r_i W| 1 + sum |r_i h_l| (|S_l e| + weight_l |e| + "
            "room_l) <= b_i; h >= the same of f_hat = O e + V d, from anywhere, after a lost sample, and for ever",
            rests, "codegen.certify.filter_bounds.check", [*found["kept"], *found["threshold"]])
    yield "once settled f_bound is", claim(
        "settled", "The last row of the table holds for ever: the set is not left. The rows before it are as many as "
        "the bounds take to come down to those of the set.",
        "h[last] >= the bound of the estimate over the set", rests, "codegen.certify.filter_bounds.table",
        found["kept" if "calibration" in cert else "last"], constants=("h",))
    yield "the state of the filter stays within limits", claim(
        "bounded", "A state of the filter beyond its limits starts again at zero; without a fault none gets there.",
        "b_i < limit_i of the rows of xi", rests, "codegen.certify.filter_bounds.check", found["limit"],
        constants=("limit",), checks=(*own, "prove"))


def energy(inequalities, cert: dict) -> list[Margin]:
    """The matrix inequality of every edge, its Lyapunov matrices, and the level."""
    pivots: dict[str, list] = {"Lyapunov matrix": [], "edge": []}
    for kind, where, S in inequalities:
        pivots[kind] += [(pivot, f"{where}, row {i}") for i, pivot in enumerate(_pivots(S))]
    return [tightest("smallest pivot of a Lyapunov matrix", pivots["Lyapunov matrix"], strict=True),
            tightest("smallest pivot of the matrix inequality", pivots["edge"], strict=True),
            Margin("square of the claimed level beyond the proved one",
                   Q(cert["level"]) ** 2 - Q(cert["energy"]["level2"]))]


def thresholds(plant, t, cert: dict) -> dict[str, list[Margin]]:
    """What the set keeps, the thresholds, the last of them, the limits, and where init starts."""
    return held(filter_designs.demands(plant, t, cert), "in the end")


def held(demands, last: str) -> dict[str, list[Margin]]:
    """The same of any demands; ``last`` is how those of the last thresholds say when they are."""
    cases: dict[str, list] = {"kept": [], "threshold": [], "last": [], "limit": [], "start": []}
    for demand in demands:
        demand.require()
        left = [(Q(a) - Q(b), f"{list(map(int, i))}, {demand.when}") for (i, a), b in zip(
            np.ndenumerate(demand.given), demand.needed.ravel())]
        cases[demand.what] += left
        if demand.what == "threshold" and demand.when.startswith(last):
            cases["last"] += left
    what = {"kept": "bound of the set beyond what a step makes of it", "threshold": "threshold beyond the estimate",
            "last": "last threshold beyond the estimate", "limit": "limit beyond the bound of xi",
            "start": "what a start takes beyond what it needs"}
    return {k: [tightest(what[k], v, strict=k == "limit")] for k, v in cases.items()}


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where plant and filter start."""
    limits = {"x": design.plant.limits("x"), "x0": (design.plant.x0_lo, design.plant.x0_hi)}
    boxes = [tightest(f"{name} box of the proof beyond the declared one", [
        (Q(a) - Q(b), f"state {i}") for i in range(len(t.x_lo)) for a, b in (
            (lo[i], getattr(t, name + "_lo")[i]), (getattr(t, name + "_hi")[i], hi[i]))])
             for name, (lo, hi) in limits.items()]
    return build("ranges", "the rows of thresholds that init and reset begin with hold for the boxes that the plant "
                 "file declares", ("signals.x", "initial.x_lo", "initial.x_hi"),
                 "Both boxes are rounded outward; init takes a row whose bounds hold its box, reset the first one.",
                 "|r_i| x0 <= bounds of the row of init; |r_i| [x; limit] <= those of row 0",
                 f"own derivation: {(inspect.getdoc(filter_bounds) or '').splitlines()[0]}",
                 "codegen.certify.filter_bounds.check", ("h",), (*boxes, *thresholds(design.plant, t, cert)["start"]),
                 checks)
