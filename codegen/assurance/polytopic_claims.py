"""The claims of a polytopic observer: what each rests on, by how much it holds; those of a law beside it elsewhere."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

import numpy as np
from flint import fmpq

from ..certify import (
    descriptor_bounds,
    descriptor_error,
    fault_sets,
    finite_frequency,
    polytope_bounds,
    polytope_near,
    polytope_thresholds,
)
from ..certify.exact import Q, pivots
from ..errors import CertificateError
from ..selection import fault_estimators, polytopic_designs
from . import tracking_claims
from .margins import Margin, tightest

GAINS = ("T2", "P", "Q", "pivot", "least_pivot", "C", "F", "G", "K")
#: What leaves its bounds where a fault is found, and the constants behind that.
SEEN = ("residual", (*GAINS, "M", "h"))
#: Entries of the plant file beside those of every design.
PLANT = ("time.kind", "time.sample_period", "nonlinear.E", "nonlinear.f", "nonlinear.A", "nonlinear.B",
         "nonlinear.premise", "nonlinear.known", "nonlinear.point", "E", "offset", "weight", "signals.theta")
FAULTS = ("Bf", "Df", "signals.f")


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order in which the certificate states them."""
    own = seen_apart(design.plant, t, cert, own)

    def claim(id, words, formula, source, code, margins, constants=(*GAINS, "h"), checks=own,
              of_plant=(*PLANT, *FAULTS) if t.faults else PLANT):
        return lambda text: build(id, text, (*plant, *of_plant), words, formula, source, code, constants,
                                  tuple(margins), checks)

    run = *own, "rounding", "validation", "target"
    if by_ellipsoid(t, cert):
        yield from _estimated(design.plant, t, cert, claim, run)
    elif t.law is None:
        yield from _energy(design.plant, t, cert, claim, own)
    else:
        yield from tracking_claims.of_loop(design.plant, t, cert, claim, own)
    if not by_ellipsoid(t, cert):
        yield from _thresholds(design.plant, t, cert, claim, run)
    if t.faults:
        yield from _slow(design.plant, cert, claim)


def by_ellipsoid(t, cert: dict) -> bool:
    """Whether the bounds are those of an observer of states and faults whose weights are the plant's.

    Parameters
    ----------
    t : PolytopicTables
    cert : dict
    """
    return bool(t.faults) and "share" in cert["thresholds"]


def seen_apart(plant, t, cert: dict, checks: tuple) -> tuple:
    """Checks by exact arithmetic: without the independent one where that does not know such an observer.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    checks : tuple of str
    """
    held, T1 = cert["thresholds"], cert.get("energy", cert).get("T1")
    known = (hasattr(t, "algebraic") or np.ndim(T1) == 2) and "waits" not in held and "calibration" not in cert
    known = known and read_apart(plant, "near" in held, by_ellipsoid(t, cert))
    return checks if known else tuple(name for name in checks if name != "independent")


def read_apart(plant, near: bool = False, told: bool = False) -> bool:
    """Whether the independent checker reads the equations of a plant: polynomials, whose premises are single products.

    Parameters
    ----------
    plant : Plant
    near : bool
        And knows slopes of its weights: of a sector model whose premises are powers of one variable each.
    told : bool
        The observer takes known terms: quotients, and the rest of its equations polynomials.
    """
    import sympy
    p = plant.polytope
    if plant.theta or (p.known and not told) or np.any(p.D) or any(np.any(v.offset) for v in p.vertices):
        return False
    if not p.equations:  # vertices: no slopes, which algebraic equations between samples would ask for
        still = plant.kind == "discrete" or np.linalg.matrix_rank(p.E) == len(p.E) or len(p.vertices) == 1
        return still and not near and not told
    terms, left = [q.term for q in p.premises], list(p.equations)
    for g in p.known:
        left[g.row] = sympy.simplify(left[g.row] - g.term)
    return not p.raw and all(f.is_polynomial(*p.symbols) for f in (*left, *terms)) and all(
        g.term.is_rational_function(*p.symbols) for g in p.known) and all(
        len(sympy.Add.make_args(sympy.expand(z))) == 1 and (not near or len(z.free_symbols) == 1) for z in terms)


def _energy(plant, t, cert: dict, claim, own: tuple):
    """Level and contraction of a plain observer."""
    proof = cert["energy"]
    found: dict[str, list] = {"level": [], "contraction": []}
    for kind, where, S in polytopic_designs.inequalities(plant, t, cert):
        found[kind].append((min(pivots(-S)), where))
    source = "Lopez-Estrada (2014), Theorems 3.3.1 and C.2.1, corrected, on the recursion of the firmware"
    level, shrinks, V = "2 c' R S' (A_i x + B_i u + Bd_i d)", "N_j' P1 N_j < f^2 P1", "P1"
    if hasattr(t, "algebraic"):
        source, V = f"own derivation: {_first(descriptor_error)}", "Ee' P1 Ee"
        level += " + 2 c' Re (algebraic equations of the observer less those of the plant)"
        shrinks = "N_j' P1 N_j + 2 Rc (algebraic equations of the error) < f^2 Ee' P1 Ee"
    yield "H-infinity: from rest the energy of z", claim(
        "energy", "A quadratic function of plant and error pays for z at every step, for every pair of vertices of "
        "plant and observer.", f"V+ - V + |z|^2 - g |(u, d)|^2 + {level} < 0 for every pair (i, j), "
        f"V = e' {V} e + x' E' P2 E x; level^2 >= g", source, "codegen.certify.polytope_gain.check",
        [tightest("smallest pivot of minus the matrix of a pair", found["level"], strict=True),
         Margin("square of the claimed level beyond the proved one", Q(cert["level"]) ** 2 - Q(proof["level2"]))],
        GAINS, own)
    yield "the error of the estimate shrinks", claim(
        "decay", "The same quadratic function of the error alone shrinks, at every vertex of the observer.",
        f"{shrinks} for every j", source, "codegen.certify.polytope_gain.check",
        [tightest("smallest pivot of the difference", found["contraction"], strict=True)], GAINS, own)
    if "band" in cert:
        matrices = polytopic_designs.band_inequalities(plant, t, cert)
        yield "H- up to", claim(
            "band", "A quadratic function of the error, its change and the fault is positive at every vertex of the "
            "observer, with one multiplier of the recursion for all of them.",
            "|M r|^2 - b |f|^2 + d'Q d - w^2 e'Q e - 2 e'P d - T d'P d + 2 (Y (d, e, f))'(d - N_j e - B_j f) > 0; "
            "beta^2 <= b", f"Iwasaki and Hara (2005), rederived: {_first(finite_frequency)}",
            "codegen.certify.finite_frequency.check",
            [tightest("smallest pivot at a vertex", [(min(pivots(S)), where) for where, S in matrices], strict=True),
             Margin("proved level beyond the square of the claimed one",
                    Q(cert["band"]["level2"]) - Q(cert["band"]["beta"]) ** 2)], (*GAINS, "M"),
            tuple(name for name in own if name != "independent"), of_plant=(*PLANT, *FAULTS))
    if cert["limit"] is not None:
        yield "Euler steps of", claim(
            "steps", "The sampling period is below the one at which Euler steps of a frozen observer diverge (double "
            "precision); what is proved of the firmware does not rest on it.", "period < least period at which an "
            "eigenvalue of I + T N_j leaves the unit circle", "own derivation: the stability limit of explicit Euler",
            "codegen.selection.descriptors.euler_limit",
            [Margin("limit of the period beyond it", Q(cert["limit"]) - Q(plant.sample_period), strict=True)], ("F",),
            ("exact",))


def _thresholds(plant, t, cert: dict, claim, checks: tuple):
    """No false alarm, and the last row, of an observer whose error a set of rows holds."""
    found: dict[str, list] = {"kept": [], "threshold": [], "last": []}
    for demand in polytopic_designs.demands(plant, t, cert):
        demand.require()
        left = [(Q(a) - Q(b), f"{list(map(int, i))}, {demand.when}") for (i, a), b in zip(
            np.ndenumerate(demand.given), demand.needed.ravel())]
        found.setdefault(demand.what, []).extend(left)
        if demand.when == "in the end":
            found["last"] += left
    rests = f"own derivation: {_first(descriptor_bounds if hasattr(t, 'algebraic') else polytope_bounds)}"
    kept = [tightest("bound of the set beyond what a step makes of it", found["kept"]),
            tightest("threshold beyond the residual", found["threshold"])]
    if "calibration" in cert:
        yield "not proved but calibrated", claim(
            "calibrated", "The last row is what simulated runs without fault give; the rows of the starts are proved.",
            "thresholds of the rows before the last >= the residual, or where no set is kept whatever a measurement "
            "makes of it until a start is forgotten; chance and confidence by order statistics", rests,
            "codegen.selection.polytopic_calibration.check", kept, (*GAINS, "M", "h"),
            ("read-back", "validation", "target"))
        yield "once settled r_bound is", claim(
            "settled", "The last row of the table holds for ever.", "h[last], from the campaign", rests,
            "codegen.selection.polytopic_calibration.check", kept[:1], ("h",), ("read-back", "validation", "target"))
        return
    near = "near" in cert["thresholds"]
    pairs = ("plant and observer at every vertex, its weights as far from the plant's as the error allows"
             if near else "every pair of vertices of plant and observer")
    if hasattr(t, "algebraic"):
        pairs += ", the algebraic equations solved with weights of their own"
    apart = (" + min(spread_i, sum_l |r_i sum_v D_lv q_v| (|S_l eb| + room_l) + off spread_i), or of every pair "
             "(i, j) without that, whichever is smaller") if near else ""
    constants = (*GAINS, "M", "h", *(("weights",) if near else ()))
    about = "M r = O eb + V d"
    if t.faults:
        about += ", less what the faults do to y"
    yield "r is what the faults do to y" if t.faults else "while no fault acts no |r| exceeds", claim(
        "estimate" if t.faults else "no-alarm",
        f"A set |r_i eb| <= b_i of the error is kept for {pairs}, whatever disturbance, noise, inputs, the "
        "plant between samples and rounding do; each threshold holds the residual over all of it.",
        f"|r_i N_j - sum lambda_k r_k| |eb| + sum |lambda_k| b_k + |r_i W_ij| 1{apart} <= b_i; "
        f"h >= the same of {about}, from anywhere on, and for ever",
        f"{rests} {_first(polytope_near)}" if near else rests, "codegen.certify.polytope_thresholds.check", kept,
        constants, checks)
    yield "once settled r_bound is", claim(
        "settled", "The last row of the table holds for ever: the set is not left. The rows before it are as many as "
        "the bounds take to come down to those of the set.", "h[last] >= the bound of the residual over the set", rests,
        "codegen.certify.polytope_thresholds.check", [tightest("last threshold beyond the residual", found["last"])],
        ("h",), checks)


def _estimated(plant, t, cert: dict, claim, checks: tuple):
    """What is proved of an observer of states and faults."""
    found: dict[str, list] = {}
    for c in fault_estimators.conditions(plant, t, cert):
        c.require()
        found.setdefault(c.what, []).append((c.left, c.where))
        if c.what == "threshold" and c.where.endswith("in the end"):
            found["last"].append((c.left, c.where))
    rests, code = f"own derivation: {_first(fault_sets)}", "codegen.certify.fault_sets.check"
    constants = (*GAINS, "known", "h", "weights")
    yield "r is what the faults do to y", claim(
        "estimate", "An ellipsoid of the error is kept at every vertex, whatever disturbance, noise, the plant between "
        "samples, the rounding of weights, known terms and sums do; each bound holds the residual over it, around what "
        "the faults do to y.", "[share P - N_j' P N_j, -N_j' P W_j; *, D_j - W_j' P W_j] > 0 at every vertex; (h - "
        "room)^2 >= V c' P^-1 c of every row c, V from anywhere on, and for ever", rests, code,
        [tightest("smallest pivot of a vertex", found["kept"], strict=True),
         tightest("square of what a threshold leaves", found["threshold"])], constants, checks)
    yield "once settled r_bound is", claim(
        "settled", "The last level holds for ever, and the level from anywhere comes down to it.",
        "share V + tau <= V; h[last] as above", rests, code, [tightest("what the last level leaves", found["last"])],
        ("h",), checks)


def _slow(plant, cert: dict, claim):
    """Modes that are slower than the decay asked for."""
    known = fault_estimators.slow_modes(plant)
    for name, mode in cert["slow"]:
        if name not in known:
            raise CertificateError(f"assurance: {name} do not move together (found), expected a mode of {mode:.4g}.")
        yield f"{name} move together", claim(
            "slow-" + name.replace(" ", "-"), "A direction of states and faults that no output sees (double "
            "precision).",
            "A_i c = mode E c at every vertex, C c = 0", "own derivation: what no gain moves",
            "codegen.synthesis.fault_problem.unmoved",
            [Margin("tolerance beyond the difference to the mode found again",
                    Q(1e-6 * abs(mode)) - abs(Q(known[name]) - Q(mode)))],
            ("C",), ("exact",))


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where plant and observer start."""
    plant = fault_estimators.with_faults(design.plant) if t.faults else design.plant
    checks, module = seen_apart(design.plant, t, cert, checks), polytope_thresholds
    if by_ellipsoid(t, cert):
        module = fault_sets
        started = [(c.left, c.where) for c in fault_estimators.conditions(design.plant, t, cert) if c.what == "start"]
    else:
        started = [(Q(a) - Q(b), d.when) for d in polytopic_designs.demands(design.plant, t, cert) if d.what == "start"
                   for a, b in zip(d.given.ravel(), d.needed.ravel())]
    inside = [(x, f"{name}[{i}]") for name in ("z0", "z_mid") for i, z in enumerate(getattr(t, name))
              for x in (Q(z) - Q(t.z_lo[i]), Q(t.z_hi[i]) - Q(z))]
    boxes: list[tuple[fmpq, str]] = []
    lo, hi = plant.limits("x")
    for i in range(len(lo)):
        boxes += [(Q(plant.x0_lo[i]) - Q(lo[i]), f"state {i}"), (Q(hi[i]) - Q(plant.x0_hi[i]), f"state {i}")]
    return build("ranges", "the rows of thresholds that init and reset begin with hold for the boxes that the plant "
                 "file declares", ("signals.x", "initial.x_lo", "initial.x_hi"),
                 "Init takes a row whose bounds hold its box, reset the first one; z starts within its limits.",
                 "|r_i| |T1 E x0 - z0| <= bounds of the row of init; z_lo <= z0, z_mid <= z_hi",
                 f"own derivation: {_first(module)}", f"{module.__name__}.check",
                 ("z0", "z_mid", "z", "h"), (
                     tightest("bounds that init takes beyond those of the initial box", started),
                     tightest("room of the start of z within its limits", inside),
                     tightest("declared range beyond the initial box", boxes)), checks)


def _first(module) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(module) or "").splitlines()[0]
