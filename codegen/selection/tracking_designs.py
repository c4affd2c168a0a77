"""Method "tracking" from plant to certified tables: design once, freeze and certify per number type.

What the solver finds in continuous time is a proposal. The plant is sampled soundly, the gains become those of a
recursion at its period, all constants are rounded, and the closed loop of these is proved: decay and level for any
weights; states, inputs and integrals within their ranges for every reference. The thresholds of the residual are those
of every polytopic observer, for any input in its range: what drives the plant does not matter to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ..algebra.interval import sizes
from ..certify import polytope_thresholds
from ..certify.exact import product, rational
from ..certify.sampled_vertices import SampledVertices, sampled_vertices
from ..certify.tracking_bounds import Sizes, check_envelope, envelope, start_error
from ..certify.tracking_loop import Loop, check_decay, check_level, loop
from ..errors import CertificateError, DesignError
from ..observers.feedback_law import FeedbackLaw
from ..observers.polytopic_tables import PolytopicTables
from ..plant.model import Plant
from ..synthesis import tracking, tracking_analysis
from ..synthesis.descriptor_gains import StandardGains, rounded
from ..synthesis.descriptor_problem import DescriptorProblem, Scaling, problem_of, scaled
from ..synthesis.tracking import Speed
from .polytopic_tables import frozen, tables_of

Array = np.ndarray
#: Entries of a gain below this share of the largest of their row are zero: the C has fewer terms.
DROP = 1e-3
#: The integral may go this much beyond what it reaches.
ROOM = 1.05
#: Share of the slowest decay asked for that is proved of the sampled loop.
PROVED = 0.8
MARGINS = (1e-8, 1e-6)
#: What is kept of how far the loop gets: states, inputs, integrals.
REACHED = ("x", "u", "s")


@dataclass(frozen=True)
class Task:
    """What is to be tracked, and how fast.

    Parameters
    ----------
    rows : tuple of int
        Outputs that follow the reference.
    reference : tuple of float
        Largest magnitude of each reference.
    observer, feedback : Speed
        Of the modes, in 1/s.
    effort : float
        Price of an input at the end of its range against a tracking error as large as the reference.
    """

    rows: tuple[int, ...]
    reference: tuple[float, ...]
    observer: Speed
    feedback: Speed
    effort: float


@dataclass(frozen=True)
class Proposal:
    """Gains before they are rounded, of the recursion at the period.

    Parameters
    ----------
    task : Task
    vertices : SampledVertices
    T2 : ndarray (n, p), K : ndarray (h, n, p)
    Kx : ndarray (h, m, n), Ki : ndarray (h, m, k)
        With the signs of the law.
    storage : dict
        Proofs that were found, to be tried first for another number type.
    """

    task: Task
    vertices: SampledVertices
    T2: Array
    K: Array
    Kx: Array
    Ki: Array
    storage: dict


def task_of(plant: Plant, options: dict) -> Task:
    """The task of a plant file; speeds that suit the period where none are given.

    Parameters
    ----------
    plant : Plant
    options : dict
        Of ``[observer]``.

    Raises
    ------
    DesignError
        A name is no output, a reference is not above 0, or there are more references than inputs.
    """
    names, track = [s.name for s in plant.y], options.get("track", {})
    for name, most in track.items():
        if name not in names:
            raise DesignError(f'{plant.name}: observer.track.{name} is no output (found), expected one of '
                              f"{', '.join(names)}.")
        if isinstance(most, bool) or not isinstance(most, int | float) or not 0 < most < np.inf:
            raise DesignError(f"{plant.name}: observer.track.{name} is {most!r} (found), expected a number above 0: "
                              "the largest magnitude of its reference.")
    if not 0 < len(track) <= plant.n_u:
        raise DesignError(f"{plant.name}: observer.track names {len(track)} outputs (found), expected 1 to "
                          f"{plant.n_u}, as many as there are inputs at most: {{ output = largest reference }}.")
    fast = 1 / plant.sample_period
    seen = Speed(float(options.get("observer_decay", 0.03 * fast)), float(options.get("observer_fastest", 0.2 * fast)))
    feedback = Speed(float(options.get("decay", 0.01 * fast)), float(options.get("fastest", 0.05 * fast)))
    for speed, prefix in ((seen, "observer_"), (feedback, "")):
        if not speed.decay < speed.fastest:
            raise DesignError(f"{plant.name}: observer.{prefix}decay is {speed.decay:.4g} 1/s (found), expected less "
                              f"than observer.{prefix}fastest, {speed.fastest:.4g} 1/s.")
    return Task(tuple(names.index(name) for name in track), tuple(map(float, track.values())), seen, feedback,
                float(options.get("effort", 0.3)))


def propose(plant: Plant, method: str, options: dict) -> Proposal:
    """Design in continuous time, in units in which all is about one, and take the gains to the period.

    Parameters
    ----------
    plant : Plant
    method : str
        "tracking".
    options : dict

    Returns
    -------
    Proposal

    Raises
    ------
    DesignError
        An option is wrong, or no gains were found.
    """
    task = task_of(plant, options)
    problem, unit = problem_of(plant), {v: sizes(*plant.limits(v)) for v in "xuv"}
    y = np.abs(problem.C) @ unit["x"]
    s, reference = Scaling(unit["x"], y, 1 / unit["x"], 1.0), np.array(task.reference)
    inside = scaled(problem, s)
    noise = np.abs(plant.polytope.Dv) @ unit["v"]
    weight = np.diag(y / np.where(noise > 0, noise, y))  # residuals in units of the noise
    Cc = plant.polytope.C[list(task.rows)] * unit["x"] / reference[:, None]
    seen = tracking.observer(inside, weight, task.observer)
    feedback = tracking.feedback(inside, Cc, np.full(plant.n_u, task.effort), task.feedback)
    T2, gains = s.factor2(seen.T2), np.array([s.gain(k) for k in seen.K])
    # Small entries are judged in the units of the solver: u in its range, s in seconds of the largest reference.
    both = _sparse(np.concatenate([feedback.Kx, feedback.Ki], axis=2))
    both = -unit["u"][:, None] * both / np.concatenate([unit["x"], reference])
    return Proposal(task, sampled_vertices(plant), _sparse(T2), _sparse(T2 + plant.sample_period * gains),
                    both[:, :, :plant.n_x], both[:, :, plant.n_x:], {})


def certified(plant: Plant, proposal: Proposal, options: dict, real: str) -> tuple[PolytopicTables, dict]:
    """Freeze a proposal on one number type and certify loop, ranges and thresholds.

    Parameters
    ----------
    plant : Plant
    proposal : Proposal
    options : dict
    real : {"float32", "float64"}

    Returns
    -------
    tables : PolytopicTables
    cert : dict

    Raises
    ------
    CertificateError
        Something may leave its range, or an inequality fails on the rounded constants.
    DesignError
        No set is kept.
    """
    task, vertices, C = proposal.task, proposal.vertices, plant.polytope.C
    T2 = rounded(proposal.T2, real)
    T1 = np.eye(plant.n_x) - T2 @ C
    gains = StandardGains(T2, *(rounded(M, real) for M in (T1 @ vertices.A, T1 @ vertices.B, proposal.K, C)))
    law = FeedbackLaw(rounded(proposal.Kx, real), rounded(proposal.Ki, real), task.rows,
                      float(rounded(np.array(plant.sample_period), real)), rounded(np.array(task.reference), real),
                      10 * np.array(task.reference))
    t = tables_of(plant, gains, np.eye(plant.n_y), real)
    t = replace(t, law=law)
    found = loop(sampled_problem(plant, vertices), gains, T1, law)
    # The limit of s counts in its own rounding alone: what it reaches with a generous one is its limit.
    reached = _ranges(plant, found, t, vertices)
    law = replace(law, limit=rounded(ROOM * reached["s"], real))
    proof = _storage(found, plant, law, task, proposal.storage)
    proposal.storage.update(proof)
    rows = options.get("set_rows")
    t, held = frozen(plant, problem_of(plant), replace(t, law=_typed(law, real)), T1, plant.sample_period,
                     None if rows is None else int(rows), options.get("mismatch", "bounded") == "bounded")
    reached = _ranges(plant, found, t, vertices)  # with the limit that it has now
    return t, {"kind": "polytopic", "level": proof["level"]["gamma"], "claimed": proof["level"]["gamma"],
               "loop": proof, "T1": T1.tolist(), "limit": None, "thresholds": held, "steady_box": None,
               "reached": {name: reached[name].tolist() for name in REACHED}, "missed": vertices.error.tolist()}


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


def _storage(found: Loop, plant: Plant, law: FeedbackLaw, task: Task, storage: dict) -> dict:
    """Storage matrices for decay and level; those of the other type where they do."""
    if storage:
        try:
            _check_storage(found, plant, law, storage)
            return dict(storage)
        except CertificateError:
            pass
    floats = [(_floats(A), _floats(B)) for A, B in found.vertices.values()]
    unit = sizes(*plant.limits("x"))
    units = np.concatenate([unit, unit, law.limit])
    factor = float(np.exp(-PROVED * min(task.feedback.decay, task.observer.decay) * plant.sample_period))
    out, count = _floats(tracked(plant, law)), plant.n_w + plant.n_v
    for margin in MARGINS:
        P = tracking_analysis.decaying([A for A, _ in floats], units, factor, margin)
        level = tracking_analysis.level([A for A, _ in floats], [B[:, :count] for _, B in floats], out, units, margin)
        if P is None or level is None:
            continue
        level["level2"] *= 1 + 1e-5
        gamma = float(np.nextafter(sqrt(level["level2"]), np.inf))
        proof = {"decay": {"P": P, "factor": factor}, "level": level | {"gamma": gamma, "inputs": count}}
        try:
            _check_storage(found, plant, law, proof)
        except CertificateError:
            continue
        return proof
    raise CertificateError(f"certificate: no common storage shows that the sampled loop shrinks by {factor:.6g} per "
                           "sample (found), expected one. Ask for a slower decay, or sample faster.")


def _check_storage(found: Loop, plant: Plant, law: FeedbackLaw, proof: dict) -> None:
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
    _check_storage(found, plant, law, proof)
    if proof["level"]["inputs"] != plant.n_w + plant.n_v or proof["level"]["gamma"] != cert["level"]:
        raise CertificateError("certificate: the level is not one from disturbances and noises. Design again.")
    reached = _ranges(plant, found, t, vertices)
    said = [(reached[name], cert["reached"][name], f"{name} reaches") for name in REACHED]
    for values, claimed, words in (*said, (vertices.error, cert["missed"], "sampling misses")):
        if not np.all(values <= np.array(claimed)):
            raise CertificateError(f"certificate: {words} more than is claimed (found), expected at most that. Design "
                                   "again.")
    polytope_thresholds.check(plant, problem_of(plant), t, cert["thresholds"], np.array(cert["T1"]),
                              plant.sample_period)
    return _sentences(plant, t, proof, reached, vertices, cert["thresholds"])


def _ranges(plant, found, t, vertices) -> dict[str, Array]:
    """Bounds of the closed loop, refused where they leave a range."""
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


def _typed(law: FeedbackLaw, real: str) -> FeedbackLaw:
    return replace(law, **{k: getattr(law, k).astype(real) for k in ("Kx", "Ki", "reference", "limit")})


def _sparse(M: Array) -> Array:
    """A matrix, or several, without what is small in its row."""
    return np.where(np.abs(M) < DROP * np.abs(M).max(axis=-1, keepdims=True), 0.0, M)


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))
