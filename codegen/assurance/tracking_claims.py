"""The claims of a tracking law beside a polytopic observer: what each rests on, by how much it holds."""

from __future__ import annotations

import inspect

import numpy as np

from ..certify import sampled_vertices, tracking_bounds, tracking_loop
from ..certify.exact import Q, pivots
from ..selection import tracking_claims
from .margins import Margin, tightest

LAW = ("Kx", "Ki", "period", "reference", "limit")
GAINS = ("T2", "C", "F", "G", "K", *LAW)


def of_loop(plant, t, cert: dict, claim, own: tuple):
    """Yield (beginning of the sentence, what makes its claim) of the closed loop.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
        With a law.
    cert : dict
    claim : callable
        Of ``polytopic_claims``.
    own : tuple of str
        Checks by exact arithmetic.
    """
    vertices, proof = sampled_vertices.sampled_vertices(plant), cert["loop"]
    loop = tracking_loop.loop(tracking_claims.sampled_problem(plant, vertices), t, np.array(cert["T1"]), t.law)
    names, source = [v.name for v in plant.polytope.vertices], f"own derivation: {_first(tracking_loop)}"
    entries = ("time.kind", "time.sample_period", "nonlinear.E", "nonlinear.f", "nonlinear.A", "nonlinear.B",
               "nonlinear.premise", "observer.track")
    exact = tuple(name for name in own if name != "independent")  # which looks at the thresholds alone

    def least(what: str, found) -> Margin:
        return tightest(what, [(min(pivots(S)), "vertices " + ", ".join(f'"{names[k]}"' for k in where))
                               for where, S in found], strict=True)

    yield "decay: plant, observer and law together", claim(
        "loop-decay", "A quadratic function of plant, observer and integrals shrinks at every step, at every vertex of "
        "plant, observer and law.", "f^2 P - M' P M > 0 for every (i, j, l)", source,
        "codegen.certify.tracking_loop.check_decay",
        [least("smallest pivot of f^2 P - M' P M", tracking_loop.decays(loop, proof["decay"]))], GAINS,
        (*exact, "validation"), entries)
    out = tracking_claims.tracked(plant, t.law)
    yield "H-infinity: from rest at reference 0", claim(
        "loop-energy", "Another one pays for the tracking error at every step, at every vertex.",
        "P - e' e - M' P M, with g for the disturbances, > 0 for every (i, j, l); level^2 >= g", source,
        "codegen.certify.tracking_loop.check_level",
        [least("smallest pivot of the matrix of a vertex", tracking_loop.levels(loop, out, proof["level"])),
         Margin("square of the claimed level beyond the proved one",
                Q(proof["level"]["gamma"]) ** 2 - Q(proof["level"]["level2"]))], GAINS, (*exact, "validation"), entries)
    reached = tracking_bounds.envelope(loop, t, t.law, tracking_claims.sizes_of(plant, t))
    held = tracking_bounds.limits(*tracking_claims.bounded(plant, t, vertices, reached))
    yield "no saturation:", claim(
        "no-saturation", "What disturbances, references and the start can do to states, inputs and integrals stays "
        "within their ranges, the rounding of every sum and the motion between samples included (double precision, "
        "raised by more than it rounds).", "sum over past samples of |C M^k B| 1 + what weights that move add <= range",
        f"own derivation: {_first(tracking_bounds)}", "codegen.certify.tracking_bounds.check_envelope",
        [tightest("range beyond what is reached", [(Q(limit) - Q(value), f"{name}: {words}")
                                                   for name, words, value, limit in held]),
         tightest("what is said to be reached, beyond what is", [
             (Q(said) - Q(value), f"{name}[{i}]") for name in tracking_claims.REACHED
             for i, (said, value) in enumerate(zip(cert["reached"][name], reached[name]))])],
        (*GAINS, "u"), (*exact, "validation"), entries)
    yield "sampling: the second-order vertices", claim(
        "sampling", "The plant over a period is a mean of second-order vertices and an error whose bound is added to "
        "the disturbances.", "x+ = sum h_i (A_i x + B_i u + T Bw_i w) + e, |e| <= error",
        f"own derivation: {_first(sampled_vertices)}", "codegen.certify.sampled_vertices.sampled_vertices", (),
        GAINS, (*exact, "validation"), entries)


def _first(module) -> str:
    return (inspect.getdoc(module) or "").splitlines()[0]
