"""Tracking of a quasi-LPV plant: design, constants of the firmware, their proof as a sampled closed loop.

The way of ``descriptors``: what the solver finds in continuous time is a proposal. The plant is sampled soundly, the
gains become those of a recursion at its period, all constants are rounded, and the closed loop of these is proved:
decay and level for any weights, states and inputs within their ranges for every reference, residuals without a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from .certify.exact import product, rational
from .certify.sampled_vertices import SampledVertices, sampled_vertices
from .certify.tracking_bounds import Sizes, check_envelope, envelope, quiet, start_error
from .certify.tracking_loop import Loop, check_decay, check_level, loop
from .errors import CertificateError, DesignError
from .observers.polytopic import PolytopicTables
from .observers.tracking import FeedbackLaw, TrackingTables
from .plant.model import Plant
from .plant.weight_program import weight_program
from .synthesis import tracking, tracking_analysis
from .synthesis.descriptor_gains import StandardGains, rounded
from .synthesis.descriptor_problem import DescriptorProblem, Scaling, problem_of, scaled, sizes
from .synthesis.tracking import Speed

Array = np.ndarray
#: Entries of a gain below this share of the largest of their row are zero: the C has fewer terms.
DROP = 1e-3
#: The integral may go this much beyond what it reaches.
ROOM = 1.05
MARGINS = (1e-8, 1e-6)


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
    decay : float
        Share of the slowest decay asked for that is proved of the sampled loop.
    """

    rows: tuple[int, ...]
    reference: tuple[float, ...]
    observer: Speed
    feedback: Speed
    effort: float = 0.3
    decay: float = 0.8


@dataclass(frozen=True)
class CertifiedTracker:
    """A unit of observer and law with its constants rounded, and what is proved of them.

    Parameters
    ----------
    tables : TrackingTables
    gains : StandardGains
    proof : dict
        "decay", "level" (for ``certify.tracking_loop``), "envelope" and "quiet" (bounds that ``certify.tracking_bounds``
        finds again).
    claims : list of str
    """

    tables: TrackingTables
    gains: StandardGains
    proof: dict
    claims: list[str]


def task_of(plant: Plant, track: Sequence[str], reference: Sequence[float], **options) -> Task:
    """A task in names of outputs; speeds that suit the period where none are given.

    Parameters
    ----------
    plant : Plant
    track : sequence of str
        Names of outputs.
    reference : sequence of float
    options
        ``effort``, ``observer``, ``feedback``.

    Returns
    -------
    Task

    Raises
    ------
    DesignError
        A name is no output, a reference is not above 0, or there are more references than inputs.
    """
    names = [s.name for s in plant.y]
    for name in track:
        if name not in names:
            raise DesignError(f"{plant.name}: tracking of {name!r} (found), expected one of {', '.join(names)}.")
    if len(reference) != len(track) or not track or not all(0 < r < np.inf for r in reference):
        raise DesignError(f"{plant.name}: references {list(reference)} (found), expected one number above 0 for each of "
                          f"{len(track)} outputs.")
    rows = tuple(names.index(name) for name in track)
    if len(rows) > plant.n_u or len(set(rows)) < len(rows):
        raise DesignError(f"{plant.name}: {len(rows)} outputs are to be tracked (found), expected at most {plant.n_u}, as "
                          "many as there are inputs, each once.")
    fast = 1 / plant.sample_period
    options = {"observer": Speed(0.03 * fast, 0.2 * fast), "feedback": Speed(0.01 * fast, 0.05 * fast)} | options
    return Task(rows, tuple(map(float, reference)), **options)


@dataclass(frozen=True)
class Proposal:
    """Gains before they are rounded, of the recursion at the period.

    Parameters
    ----------
    T2 : ndarray (n, p), K : ndarray (h, n, p)
    Kx : ndarray (h, m, n), Ki : ndarray (h, m, k)
        With the signs of the law.
    """

    T2: Array
    K: Array
    Kx: Array
    Ki: Array


def propose(plant: Plant, task: Task) -> Proposal:
    """Design in continuous time, in units in which all is about one, and take the gains to the period.

    Parameters
    ----------
    plant : Plant
        One that ``certify.sampled_vertices.unsuited`` does not refuse.
    task : Task

    Returns
    -------
    Proposal

    Raises
    ------
    DesignError
        No gains were found.
    """
    problem, unit = problem_of(plant), {v: sizes(*plant.limits(v)) for v in "xyu"}
    s, reference = Scaling(unit["x"], unit["y"], 1 / unit["x"], 1.0), np.array(task.reference)
    inside = scaled(problem, s)
    Cc = plant.polytope.C[list(task.rows)] * unit["x"] / reference[:, None]
    seen = tracking.observer(inside, np.eye(plant.n_y), task.observer)
    feedback = tracking.feedback(inside, Cc, np.full(plant.n_u, task.effort), task.feedback)
    T2, gains = s.factor2(seen.T2), np.array([s.gain(k) for k in seen.K])
    # Small entries are judged in the units of the solver: u in its range, s in seconds of the largest reference.
    both = _sparse(np.concatenate([feedback.Kx, feedback.Ki], axis=2))
    both = -unit["u"][:, None] * both / np.concatenate([unit["x"], reference])
    return Proposal(_sparse(T2), _sparse(T2 + plant.sample_period * gains), both[:, :, :plant.n_x],
                    both[:, :, plant.n_x:])


def design_tracker(plant: Plant, task: Task, real: str = "float32", proposal: Proposal | None = None,
                   storage: dict | None = None) -> CertifiedTracker:
    """Design, round and certify.

    Parameters
    ----------
    plant : Plant
    task : Task
    real : {"float32", "float64"}
    proposal : Proposal, optional
        Without, one is made.
    storage : dict, optional
        Proof of the other number type, to be tried first.

    Returns
    -------
    CertifiedTracker

    Raises
    ------
    DesignError
        The plant is unsuited, or no gains were found.
    CertificateError
        Something may leave its range, or an inequality fails on the rounded constants.
    """
    vertices = sampled_vertices(plant)
    proposal = propose(plant, task) if proposal is None else proposal
    T2 = rounded(proposal.T2, real)
    T1 = np.eye(plant.n_x) - T2 @ plant.polytope.C
    gains = StandardGains(T2, *(rounded(M, real) for M in (T1 @ vertices.A, T1 @ vertices.B, proposal.K,
                                                            plant.polytope.C)))
    law = FeedbackLaw(rounded(proposal.Kx, real), rounded(proposal.Ki, real), task.rows,
                      float(rounded(np.array(plant.sample_period), real)), _below(np.array(task.reference), real),
                      10 * np.array(task.reference))
    problem, T1 = sampled_problem(plant, vertices), np.eye(plant.n_x) - gains.T2 @ gains.C
    x0 = (plant.x0_lo + plant.x0_hi) / 2
    z0 = rounded(x0 - gains.T2 @ (gains.C @ x0), real)
    tables = TrackingTables(_observer_tables(plant, gains, z0, x0, real), law, np.zeros(plant.n_y))
    found = loop(problem, gains, T1, law)
    # The limit of s counts in its own rounding alone: what it reaches with a generous one is its limit.
    reached = _ranges(plant, found, tables, gains, vertices)
    law = replace(law, limit=rounded(ROOM * reached["s"], real))
    r_bound = quiet(found, problem, gains, law, _sizes(plant, gains, law, z0, real), vertices.slope)
    tables = replace(tables, law=law, r_bound=_above(r_bound, real))
    proof = _proposal(found, plant, law, task, storage)
    return CertifiedTracker(tables, gains, proof, check(plant, tables, gains, proof))


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


def _proposal(found: Loop, plant: Plant, law: FeedbackLaw, task: Task, storage: dict | None) -> dict:
    """Storage matrices for decay and level; those of the other type where they do."""
    if storage is not None:
        try:
            _check_storage(found, plant, law, storage)
            return storage
        except CertificateError:
            pass
    floats = [(_floats(A), _floats(B)) for A, B in found.vertices.values()]
    unit = sizes(*plant.limits("x"))
    units = np.concatenate([unit, unit, law.limit])
    factor = float(np.exp(-task.decay * min(task.feedback.decay, task.observer.decay) * plant.sample_period))
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


def check(plant: Plant, tables: TrackingTables, gains: StandardGains, proof: dict) -> list[str]:
    """Prove everything again from the plant and the constants of the firmware; return it in sentences.

    Parameters
    ----------
    plant : Plant
    tables : TrackingTables
    gains : StandardGains
        Those of the tables.
    proof : dict

    Returns
    -------
    claims : list of str

    Raises
    ------
    CertificateError
    """
    o, law = tables.observer, tables.law
    for name in ("T2", "C", "F", "G", "K"):
        if not np.array_equal(getattr(o, name), getattr(gains, name)):
            raise CertificateError(f"certificate: {name} of the tables is not that of the proof. Design again.")
    vertices = sampled_vertices(plant)
    problem = sampled_problem(plant, vertices)
    found = loop(problem, gains, np.eye(plant.n_x) - gains.T2 @ gains.C, law)
    _check_storage(found, plant, law, proof)
    if proof["level"]["inputs"] != plant.n_w + plant.n_v:
        raise CertificateError("certificate: the level counts other inputs than disturbances and noises. Design again.")
    reached = _ranges(plant, found, tables, gains, vertices)
    bound = quiet(found, problem, gains, law, _sizes(plant, gains, law, o.z0, tables.real), vertices.slope)
    for i, s in enumerate(plant.y):
        if not float(tables.r_bound[i]) >= bound[i]:
            raise CertificateError(f'certificate: the residual of "{s.name}" may reach {bound[i]:.6g} without a fault '
                                   f"(found), beyond its bound {float(tables.r_bound[i]):.6g}. Design again.")
    return _sentences(plant, tables, proof, reached, vertices)


def _ranges(plant, found, tables, gains, vertices) -> dict[str, Array]:
    """Bounds of the closed loop, refused where they leave a range."""
    law = tables.law
    size = _sizes(plant, gains, law, tables.observer.z0, tables.real)
    reached = envelope(found, gains, law, size)
    names = {"x": [s.name for s in plant.x], "u": [s.name for s in plant.u],
             "s": [f"integral of {plant.y[i].name}" for i in law.rows]}
    check_envelope(reached, size, vertices.speed, plant.sample_period, names)
    return reached


def _sentences(plant, tables, proof, reached, vertices) -> list[str]:
    law, T = tables.law, plant.sample_period

    def listed(values, names):
        return ", ".join(f"{s.name} {float(v):.4g} {s.unit}".strip() for v, s in zip(values, names))

    refs = [plant.y[i] for i in law.rows]
    missed = listed(vertices.error, plant.x)
    return [
        f"decay: plant, observer and law together shrink by {proof['decay']['factor']:.6g} per sample of {T:g} s in one "
        "norm, whatever weights plant, observer and law have, also those that a faulty sensor makes",
        f"H-infinity: from rest at reference 0 the energy of the tracking error, in units of the largest reference, "
        f"stays below {proof['level']['gamma']:.6g}^2 times that of disturbances and noises in units of their bounds "
        "(the sampled model; rounding of sums apart)",
        f"no saturation: for every reference within {listed(law.reference, refs)}, every start in the initial box, all "
        "disturbances and noises within their bounds and no fault, states stay within their declared ranges, between "
        f"samples too, and inputs within {listed(reached['u'], plant.u)}: nothing is ever cut, rounding included",
        f"residuals without a fault stay within {listed(tables.r_bound, plant.y)}, for any input and state in its range: "
        "no false alarm, rounding included",
        f"sampling: the second-order vertices miss the continuous plant by at most {missed} per sample; bounds and "
        "residuals include it"]


def _sizes(plant, gains, law, z0, real) -> Sizes:
    x, u, y = (np.maximum(*np.abs(plant.limits(v))) for v in "xuy")
    exact = rational(np.eye(plant.n_x)) - product(rational(gains.T2), rational(plant.polytope.C))
    eb = start_error(exact, plant.x0_lo, plant.x0_hi, z0)
    # Measurements without a fault: C x and the noise. The accepted range is wider.
    seen = np.abs(plant.polytope.C) @ x + np.abs(plant.polytope.Dv) @ np.maximum(*np.abs(plant.limits("v")))
    return Sizes(x, u, np.minimum(seen * (1 + 1e-12), np.maximum(y, seen)), np.asarray(law.reference, float),
                 np.asarray(law.limit, float), np.maximum(np.abs(plant.x0_lo), np.abs(plant.x0_hi)), eb,
                 float(np.finfo(real).eps))


def _observer_tables(plant: Plant, gains: StandardGains, z0: Array, x0: Array, real: str) -> PolytopicTables:
    ranges = {}
    for vector in ("u", "y"):
        lo, hi = plant.limits(vector)
        lo, hi = (-_below(-lo, real), _below(hi, real)) if vector == "u" else (rounded(lo, real), rounded(hi, real))
        ranges |= {f"{vector}_lo": lo, f"{vector}_hi": hi}
    none = np.zeros(0)
    return PolytopicTables(real, gains.T2, gains.C, gains.F, gains.G, gains.K, z0, rounded(gains.C @ x0, real),
                           **ranges, theta_lo=none, theta_hi=none, weights=weight_program(plant.polytope, real))


def _sparse(M: Array) -> Array:
    """A matrix, or several, without what is small in its row."""
    return np.where(np.abs(M) < DROP * np.abs(M).max(axis=-1, keepdims=True), 0.0, M)


def _below(values: Array, real: str) -> Array:
    """Numbers of the type that are not above the given ones."""
    near = values.astype(real)
    return np.where(near.astype(float) > values, np.nextafter(near, np.array(-np.inf, real)), near).astype(float) + 0.0


def _above(values: Array, real: str) -> Array:
    return -_below(-values, real)


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))

