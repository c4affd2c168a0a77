"""The claims of a bank: what each rests on, by how much it holds; its thresholds rest on a campaign."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

import numpy as np
from flint import fmpq

from ..analysis import order_statistics
from ..certify import bank, bank_limits
from ..certify.exact import Q, product, rational
from ..selection import bank_claims
from . import margins
from .margins import Margin, _pivots, tightest

PARTS = ("T2", "C", "F", "G", "K", "M", "z0")
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("level", ("bound", "rate"))
PLANT = ("time.kind", "time.sample_period", "nonlinear.E", "nonlinear.f", "nonlinear.premise", "nonlinear.A",
         "nonlinear.B", "E", "vertex.A", "vertex.B", "vertex.weight", "signals.theta")
FAULTS = ("Df", "signals.f")
OPTIONS = ("observer.probability", "observer.confidence", "observer.margin", "observer.seed", "scenario.u",
           "initial.x_lo", "initial.x_hi")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``selection.bank_claims.check``."""
    p = design.plant
    found = bank_claims.rooms(p, t, cert)
    every = tuple(f"{name}_{k}" for name in PARTS for k in range(len(t.members)))
    first = inspect.getdoc(bank).splitlines()[0]

    def claim(id, words, formula, source, code, about, constants, plant=(*plant, *PLANT, *FAULTS),
              checks=(*own, "validation")):
        return lambda text: build(id, text, plant, words, formula, source, code, constants, tuple(about), checks)

    for k, fault in enumerate(p.f):
        yield f"observer without the sensors of {fault.name}: ", claim(
            f"observer-{k}", "The observer reads no output that its fault moves. A quadratic function of error and "
            "plant pays for the energy of the weighted residual, one of the error for what other faults leave in it, "
            "and the error alone shrinks, for every pair of vertices.",
            "gamma^2 |d|^2 - |M r|^2 + V - V+ > 0; |M r|^2 - beta^2 |f|^2 - dV > 0; c^2 P1 - N_j' P1 N_j > 0",
            "F. R. Lopez-Estrada, PhD thesis, 2014, section 3.6 and Theorem 4.3.3, corrected",
            "codegen.certify.polytope_detection.check", member(p, t, cert, k),
            tuple(f"{name}_{k}" for name in PARTS))
    yield "while no fault but one acts", claim(
        "isolation", "Member p cannot be moved by fault p; a fault is named where all members but its own are raised, "
        "so another one's name asks for an alarm of the member that this fault leaves alone.",
        "Df[seen by p, p] = 0; pattern of fault i: all members but i",
        "F. R. Lopez-Estrada, PhD thesis, 2014, section 3.6 (generalised scheme), incidence corrected",
        "codegen.observers.bank.blamed", [blind(p, t)], every)
    yield f"{t.settle} samples after a start", claim(
        "settled", "What is left of a start shrinks by the contraction and is averaged.",
        "g^2 E0^2 (rate sum_k (1 - rate)^(N-1-k) c^k)^2 <= share^2 bound; g^2 P1 - C' M' M C > 0",
        f"own derivation: {first}", "codegen.certify.bank.check", settled(found), (*every, "bound", "rate"))
    yield "no input and no measurement that is accepted", claim(
        "limits", "In the norm of P1 a step of each member maps a size into itself, for every measurement and input "
        "that is accepted, rounding included; averages lie between what they average.",
        "(1 + d)(c R + b) <= R; |z| <= sqrt(P1^-1_ii) R <= limit_i; |M r| <= most - rounding / rate",
        f"own derivation: {inspect.getdoc(bank_limits).splitlines()[0]}", "codegen.certify.bank_limits.check",
        limits(found), (*every, "limit", "most", "rate"), checks=(*own, "prove"))
    yield "constant faults of at least this size", claim(
        "isolable", "Settled, every other member's residual is at least beta |f|, twice its threshold.",
        "beta_p |f| / range >= 2 sqrt(bound_p) for every p but the fault's own", f"own derivation: {first}",
        "codegen.certify.bank.isolable", [heard(p, t, cert)], (*every, "bound"))
    yield "CALIBRATED, not proved", claim(
        "calibrated", "Thresholds are no lower than the largest level of each member in the runs drawn; order "
        "statistics say how often another run of that kind exceeds one of them. Of other runs nothing is said.",
        "bound >= largest level; confidence <= 1 - P(Bin(runs, probability) < members)",
        " ".join(inspect.getdoc(order_statistics).partition("Source: ")[2].split()),
        "codegen.analysis.order_statistics.confidence", calibrated(t, cert), ("bound",), (*plant, *PLANT, *OPTIONS),
        ("independent", "read-back", "validation", "target"))


def member(plant, t, cert: dict, k: int) -> list[Margin]:
    """Levels of one member beyond what is proved, and how its error shrinks."""
    own, proof = cert["members"][k], cert["members"][k]["proof"]
    c, P1 = Q(proof["level"]["contraction"]), rational(np.array(proof["level"]["P1"]))
    pivots = []
    for j, (F, K) in enumerate(zip(t.members[k].F, t.members[k].K)):
        N = rational(F.astype(float)) + product(rational(K.astype(float)), rational(t.members[k].C.astype(float)))
        S = c * c * P1 - product(product(N.T, P1), N)
        pivots += [(x, f"vertex {j}, row {i}") for i, x in enumerate(_pivots(S))]
    return [blind(plant, t, k),
            Margin("square of the claimed gain beyond the proved one",
                   Q(own["gamma"]) ** 2 - Q(proof["level"]["level2"])),
            Margin("square of the proved sensitivity beyond the claimed one",
                   Q(proof["fault"]["level2"]) - Q(own["beta"]) ** 2),
            tightest("smallest pivot of c^2 P1 - N' P1 N", pivots, strict=True)]


def blind(plant, t, only: int | None = None) -> Margin:
    """What a fault does to the outputs that its own member reads: nothing."""
    return tightest("largest entry of Df that a member reads of its own fault, less than nothing", [
        (-abs(Q(plant.polytope.Df[i, k])), f'"{plant.f[k].name}", output {i}')
        for k, own in enumerate(t.members) if only in (None, k) for i in own.seen])


def settled(found: list[dict]) -> list[Margin]:
    """What a start may still be in the averages, against its share of the thresholds."""
    return [tightest("square of the share of a threshold beyond what is left of a start",
                     [(left["settled"], f"member {k}") for k, left in enumerate(found)])]


def limits(found: list[dict]) -> list[Margin]:
    """Size, start and averages within the limits."""
    words = {"step": "size in the norm of P1 beyond what a step makes of it", "start": "size beyond that of the start",
             "average": "limit of an average beyond what a sample makes of it"}
    return [tightest(text, [(left[name], f"member {k}") for k, left in enumerate(found)])
            for name, text in words.items()]


def heard(plant, t, cert: dict) -> Margin:
    """Square of what the smallest faults make of every other member, less that of twice its threshold."""
    sizes, unit = bank.isolable(plant, t, cert), bank.units(plant)
    return tightest("square of a residual beyond that of twice the threshold", [
        ((Q(size) / Q(one) * Q(m["beta"])) ** 2 - 4 * Q(b), f'"{plant.f[k].name}", member {p}')
        for k, (size, one) in enumerate(zip(sizes, unit))
        for p, (b, m) in enumerate(zip(t.bound, cert["members"])) if p != k])


def calibrated(t, cert: dict) -> list[Margin]:
    """Thresholds against the levels of the campaign; its confidence, summed exactly."""
    c = cert["calibration"]
    exact = order_statistics.exact_confidence(c["runs"], c["probability"], len(t.members))
    return [tightest("threshold beyond the largest level", [(Q(b) - Q(a), f"member {k}") for k, (a, b) in enumerate(
        zip(c["levels"], t.bound))]),
            Margin("confidence of the order statistics beyond the claimed one",
                   fmpq(exact.numerator, exact.denominator) - Q(c["confidence"]))]


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the members start."""
    box = {"x": design.plant.limits("x"), "x0": (design.plant.x0_lo, design.plant.x0_hi)}
    return build("ranges", "the boxes from which starts are said to settle hold what the plant file declares",
                 ("signals.x", "initial.x_lo", "initial.x_hi"), "Both boxes are rounded outward.",
                 "x0_lo <= initial x_lo, x0_hi >= initial x_hi; x_lo, x_hi alike",
                 f"own derivation: {inspect.getdoc(bank).splitlines()[0]}", "codegen.certify.claims.check_ranges",
                 tuple(f"z0_{k}" for k in range(len(t.members))), tuple(margins.ranges(box, t)), checks)
