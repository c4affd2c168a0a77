"""The claims of a mode estimator by sliding modes: what each rests on, by how much it holds; none of the decision."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..certify import sliding_claims
from ..certify.exact import Q
from ..plant.bounded import bounded
from . import margins
from .margins import Margin, _pivots, tightest

PAIRS = ("M", "L", "G", "d", "H", "D", "v", "limit")
LOOPS = ("period", "turn", "pull", "ground", "inverse", "foot", "a", "b", "K", "z_limit", "rate_limit", "smooth",
         "share")
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", PAIRS)
PLANT = ("time.kind", "time.sample_period", "signals.theta", "mode.bounds")
DWELL = ("switching.minimum_dwell", "switching.average_dwell")
SOURCE = "own derivation: the scheme of this family (codegen.observers.sliding)"
#: What every entry of J is to be: the thesis takes ones of a half.
TARGET = Q(0.5)
#: Conditions of ``certify.sliding_claims.rooms`` in words.
WORDS = {"test": "bound of the noise beyond noise, rounded C and rounding", "limit": "limit beyond the range of x",
         "offset": "offset beyond disturbance, noise, rounded constants and rounding",
         "dwell": "declared dwell time beyond that of the monitor, s",
         "error": "stored error of a bound beyond what a step makes of it",
         "gain": "what a gain may be off by its rounding, beyond what it is off"}


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``certify.sliding_claims.sentences``."""
    found: dict[str, list] = {}
    seen = bounded(design.plant)
    for kind, left, where in sliding_claims.rooms(seen, t, cert):
        found.setdefault(kind, []).append((left, where))
    of = {kind: tightest(WORDS[kind], cases) for kind, cases in found.items()}

    def claim(id, words, formula, about, code="codegen.certify.sliding_claims.demands", constants=PAIRS, plant=plant,
              source=SOURCE, checks=(*own, "rounding", "validation", "target")):
        return lambda text: build(id, text, (*plant, *PLANT, *DWELL), words, formula, source, code, constants,
                                  tuple(about), checks)

    yield "nothing is proved of the decision", claim(
        "decision", "The loops follow rates, and whose rate is least decides: no bound of what that answers is known.",
        "assured = 0 at every sample", (), "codegen.observers.sliding.SlidingObserver", LOOPS,
        ("switching.known",), checks=("read-back", "validation", "target"))
    yield "a mode's test fails only where", claim(
        "test", "While its mode is active and no fault acts, the pair of bounds holds x, and y - D u is where the pair "
        "and the noise let it be; so a test that fails refutes the mode.",
        "v_hi >= max Dv v + |C - H| x + what y - D u and the sum are rounded; v_lo mirrored; offsets as below",
        (of["test"], of["offset"], of["limit"]))
    yield "x_lo <= x <= x_hi", claim(
        "containment", "A step of the bounds of the active mode holds x wherever inputs, noise, disturbance between "
        "samples and rounding may take it; M >= 0, so that the errors of the bounds keep their sign.",
        "d_hi >= max[(e^(A T) - M - L C) x + (int e^(A s) B - G) u + int e^(A s) w - L Dv v] + gamma_k (terms); "
        "mirrored for d_lo; limit >= |x|", (of["offset"], of["limit"]))
    yield "no alarm is false", claim(
        "no-alarm", "A span in which every mode was refuted after its pair began within it has a switch in it; two "
        "such spans within a dwell time have two.", "DWELL * T <= declared dwell time",
        (of["dwell"], of["test"], of["offset"]), "codegen.certify.sliding_claims.rooms")
    yield "widths of x_hi - x_lo", claim(
        "widths", "The errors of both bounds have a level that a step maps into itself.",
        "M e + (d - min[...] + rounding) <= e for x_hi, mirrored for x_lo; width = e_hi + e_lo", (of["error"],),
        "codegen.certify.sliding_claims.rooms", ("M", "L", "G", "d"))
    yield "Theorem 12", claim(
        "theorem-12", "The gains of continuous time meet the matrix inequalities; the tables hold them for a period.",
        "P >= 1; A - L C + limit I >= 0 entrywise; -[S, P; P, -gamma I] > 0; -[S, P F - CC' J; *, J' J - beta I] > 0; "
        "L of the tables = int e^((A - L C) s) ds L", (*theorem(seen, cert), of["gain"]),
        "codegen.certify.sliding_claims.check_theorem", ("L",),
        source="C. Zammali (2020), chapter 4, Theorem 12, corrected", checks=own)


def theorem(plant, cert: dict) -> list[Margin]:
    """P, the entries off the diagonal, and the pivots of both inequalities in every mode.

    Parameters
    ----------
    plant : Plant
    cert : dict
    """
    sliding_claims.check_theorem(plant, cert)
    pivots: dict[str, list] = {"gamma": [], "beta": []}
    for q, mode in enumerate(plant.modes):
        for name, matrix in sliding_claims.conditions(mode, cert, q, {k: cert[k][q] for k in pivots}).items():
            pivots[name] += [(x, f'mode "{mode.name}", row {i}') for i, x in enumerate(_pivots(-matrix))]
    metzler = [(x, where) for q, mode in enumerate(plant.modes)
               for x, where in sliding_claims.off_diagonal(mode, cert, q)]
    return [tightest("P - 1", [(Q(x) - 1, f"state {i}") for p in cert["P"] for i, x in enumerate(p)]),
            tightest("entry of A - L C + limit I", metzler),
            *(tightest(f"smallest pivot of the matrix inequality of {name}", found, strict=True)
              for name, found in pivots.items()),
            Margin("entries of J as the method has them", -abs(Q(cert["target"]) - TARGET))]


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the pairs start."""
    limits = {"x": design.plant.limits("x"), "x0": (design.plant.x0_lo, design.plant.x0_hi)}
    return build("ranges", "the pairs start from, and restart to, boxes that hold what the plant file declares",
                 ("signals.x", "initial.x_lo", "initial.x_hi"), "The boxes of init and of every restart are rounded "
                 "outward.", "x0_lo <= initial x_lo, x0_hi >= initial x_hi; x_lo, x_hi alike",
                 "own derivation: Start and restart hold what is declared.", "codegen.certify.claims.check_ranges",
                 ("x", "x0"), tuple(margins.ranges(limits, t)), checks)
