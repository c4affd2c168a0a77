"""What is proved of the loop that a tracking law closes, from the plant and the constants of the firmware."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..certify import polytope_thresholds
from ..certify.exact import product, rational
from ..certify.sampled_vertices import SampledVertices, sampled_vertices
from ..certify.tracking_bounds import Sizes, check_envelope, envelope, start_error
from ..certify.tracking_loop import Loop, check_decay, check_level, loop
from ..errors import CertificateError
from ..observers.feedback_law import FeedbackLaw
from ..observers.polytopic_tables import PolytopicTables
from ..plant.model import Plant
from ..synthesis.descriptor_problem import DescriptorProblem, problem_of
from .tracking_task import task_of

Array = np.ndarray
#: What is kept of how far the loop gets: states, inputs, integrals.
REACHED = ("x", "u", "s")


def check(plant: Plant, t: PolytopicTables, cert: dict) -> list[str]:
    """Prove everything again from the plant and the constants of the firmware; return it in sentences.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
        With a law.
    cert : dict

    Raises
    ------
    CertificateError
    """
    law, proof = t.law, cert["loop"]
    vertices, task = sampled_vertices(plant), task_of(plant, plant.options)
    if law.rows != task.rows or np.any(law.reference != np.array(task.reference).astype(t.real)):
        raise CertificateError("certificate: the law tracks other outputs or references than those of the plant file. "
                               "Design again.")
    if law.period != float(np.dtype(t.real).type(plant.sample_period)):
        raise CertificateError("certificate: the law has another period than the plant. Design again.")
    found = loop(sampled_problem(plant, vertices), t, np.array(cert["T1"]), law)
    check_storage(found, plant, law, proof)
    if proof["level"]["inputs"] != plant.n_w + plant.n_v or proof["level"]["gamma"] != cert["level"]:
        raise CertificateError("certificate: the level is not one from disturbances and noises. Design again.")
    reached = ranges(plant, found, t, vertices)
    said = [(reached[name], cert["reached"][name], f"{name} reaches") for name in REACHED]
    for values, claimed, words in (*said, (vertices.error, cert["missed"], "sampling misses")):
        if not np.all(values <= np.array(claimed)):
            raise CertificateError(f"certificate: {words} more than is claimed (found), expected at most that. Design "
                                   "again.")
    polytope_thresholds.check(plant, problem_of(plant), t, cert["thresholds"], np.array(cert["T1"]),
                              plant.sample_period)
    return _sentences(plant, t, proof, reached, vertices, cert["thresholds"])


def sampled_problem(plant: Plant, vertices: SampledVertices) -> DescriptorProblem:
    """The discrete problem of a sampled plant; d holds w, v and what sampling leaves.

    Parameters
    ----------
    plant : Plant
    vertices : SampledVertices
    """
    p, n = problem_of(plant), plant.n_x
    h = range(len(p.A))
    Bd = np.array([np.hstack([Bw, np.zeros((n, plant.n_v)), np.diag(vertices.error)]) for Bw in vertices.Bw])
    Dd = np.hstack([p.Dd, np.zeros((plant.n_y, n))])
    unit = np.concatenate([p.d_unit, np.ones(n)])
    return replace(p, A=vertices.A, B=vertices.B, Bd=Bd, Dd=Dd, H=np.eye(n), J=np.zeros((n, Bd.shape[2])),
                   u_unit=np.ones(plant.n_u), d_unit=unit, pairs=tuple((i, j) for i in h for j in h), kind="discrete")


def check_storage(found: Loop, plant: Plant, law: FeedbackLaw, proof: dict) -> None:
    """Decay and level of the loop.

    Parameters
    ----------
    found : Loop
    plant : Plant
    law : FeedbackLaw
    proof : dict
        "decay" and "level", each with its storage matrix.

    Raises
    ------
    CertificateError
    """
    names = [v.name for v in plant.polytope.vertices]
    check_decay(found, names, proof["decay"])
    check_level(found, names, tracked(plant, law), proof["level"])


def tracked(plant: Plant, law: FeedbackLaw) -> Array:
    """The tracking error Y C x over the loop's state, exact, in units of the reference; reference 0.

    Parameters
    ----------
    plant : Plant
    law : FeedbackLaw
    """
    n, k = plant.n_x, len(law.rows)
    size = rational(np.array([[1.0 / float(r)] for r in law.reference]))
    C = rational(plant.polytope.C[list(law.rows)]) * size
    none = rational(np.zeros((k, n))), rational(np.zeros((k, k)))
    return np.concatenate([none[0], C, none[1]], axis=1)


def ranges(plant: Plant, found: Loop, t: PolytopicTables, vertices: SampledVertices) -> dict[str, Array]:
    """Bounds of the closed loop, refused where they leave a range.

    Parameters
    ----------
    plant : Plant
    found : Loop
    t : PolytopicTables
    vertices : SampledVertices

    Raises
    ------
    CertificateError
    """
    reached = envelope(found, t, t.law, sizes_of(plant, t))
    check_envelope(*bounded(plant, t, vertices, reached))
    return reached


def bounded(plant: Plant, t: PolytopicTables, vertices: SampledVertices, reached: dict[str, Array]) -> tuple:
    """What ``tracking_bounds.limits`` takes.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    vertices : SampledVertices
    reached : dict
        From ``tracking_bounds.envelope``.
    """
    names = {"x": [s.name for s in plant.x], "u": [s.name for s in plant.u],
             "s": [f"integral of {plant.y[i].name}" for i in t.law.rows]}
    inner = {"x": _inner(plant.limits("x")), "u": np.minimum(_inner(plant.limits("u")), _inner((t.u_lo, t.u_hi)))}
    return reached, sizes_of(plant, t), inner, vertices.speed, plant.sample_period, names


def _sentences(plant, t, proof, reached, vertices, held) -> list[str]:
    law, T = t.law, plant.sample_period

    def listed(values, names):
        return ", ".join(f"{s.name} {float(v):.4g} {s.unit}".strip() for v, s in zip(values, names))

    refs, missed = [plant.y[i] for i in law.rows], listed(vertices.error, plant.x)
    return [
        f"decay: plant, observer and law together shrink by {proof['decay']['factor']:.6g} per sample of {T:g} s in "
        "one norm, whatever weights plant, observer and law have, also those that a faulty sensor makes",
        "H-infinity: from rest at reference 0 the energy of the tracking error, in units of the largest reference, "
        f"stays below {proof['level']['gamma']:.6g}^2 times that of disturbances and noises in units of their bounds "
        "(the sampled model; rounding of sums apart)",
        f"no saturation: for every reference within {listed(law.reference, refs)}, every start in the initial box, all "
        "disturbances and noises within their bounds and no fault, with u as commanded and no sample missing, states "
        "stay within their declared ranges, between samples too, and inputs within "
        f"{listed(reached['u'], plant.u)}: nothing is ever cut, rounding included ({t.real}, with or without fused "
        "multiply-add)",
        f"sampling: the second-order vertices miss the continuous plant by at most {missed} per sample, which these "
        "ranges include",
        "while no fault acts no |r| exceeds its r_bound at any sample, so there is no false alarm, for any input in "
        f"its range, {polytope_thresholds.weights_words(plant.polytope, held)}, rounding included ({t.real}); between "
        "samples the plant moves as it likes within its ranges",
        f"once settled r_bound is {listed(t.h[-1], plant.y)}; it comes down to that within {t.last << t.shift} samples "
        "from anywhere in the declared range of x"]


def sizes_of(plant: Plant, t: PolytopicTables) -> Sizes:
    """What the signals of a closed loop without fault are at most.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
        With a law.
    """
    x, u, v = (np.maximum(*np.abs(plant.limits(name))) for name in "xuv")
    exact = rational(np.eye(plant.n_x)) - product(rational(t.T2), rational(plant.polytope.C))
    eb = start_error(exact, plant.x0_lo, plant.x0_hi, t.z0)
    # Measurements without a fault: C x and the noise. The accepted range is wider.
    seen = (np.abs(plant.polytope.C) @ x + np.abs(plant.polytope.Dv) @ v) * (1 + 1e-12)
    return Sizes(x, u, seen, t.law.reference.astype(float), t.law.limit.astype(float),
                 np.maximum(np.abs(plant.x0_lo), np.abs(plant.x0_hi)), eb, float(np.finfo(t.real).eps))


def _inner(limits) -> Array:
    """How far 0 is from the nearer end of each range."""
    lo, hi = (np.asarray(side, dtype=float) for side in limits)
    return np.minimum(-lo, hi)
