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
from ..certify.sampled_vertices import SampledVertices, sampled_vertices
from ..certify.tracking_loop import Loop, loop
from ..errors import CertificateError
from ..observers.feedback_law import FeedbackLaw
from ..observers.polytopic_tables import PolytopicTables
from ..plant.model import Plant
from ..synthesis import tracking, tracking_analysis
from ..synthesis.descriptor_gains import StandardGains, rounded
from ..synthesis.descriptor_problem import Scaling, problem_of, scaled
from .polytopic_tables import frozen, tables_of
from .tracking_claims import REACHED, check_storage, ranges, sampled_problem, tracked
from .tracking_task import Task, task_of

Array = np.ndarray
#: Entries of a gain below this share of the largest of their row are zero: the C has fewer terms.
DROP = 1e-3
#: The integral may go this much beyond what it reaches.
ROOM = 1.05
#: Share of the slowest decay asked for that is proved of the sampled loop.
PROVED = 0.8
MARGINS = (1e-8, 1e-6)


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
    reached = ranges(plant, found, t, vertices)
    law = replace(law, limit=rounded(ROOM * reached["s"], real))
    proof = _storage(found, plant, law, task, proposal.storage)
    proposal.storage.update(proof)
    rows = options.get("set_rows")
    t, held = frozen(plant, problem_of(plant), replace(t, law=_typed(law, real)), T1, plant.sample_period,
                     None if rows is None else int(rows), options.get("mismatch", "bounded") == "bounded")
    reached = ranges(plant, found, t, vertices)  # with the limit that it has now
    return t, {"kind": "polytopic", "level": proof["level"]["gamma"], "claimed": proof["level"]["gamma"],
               "loop": proof, "T1": T1.tolist(), "limit": None, "thresholds": held, "steady_box": None,
               "reached": {name: reached[name].tolist() for name in REACHED}, "missed": vertices.error.tolist()}


def _storage(found: Loop, plant: Plant, law: FeedbackLaw, task: Task, storage: dict) -> dict:
    """Storage matrices for decay and level; those of the other type where they do."""
    if storage:
        try:
            check_storage(found, plant, law, storage)
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
            check_storage(found, plant, law, proof)
        except CertificateError:
            continue
        return proof
    raise CertificateError(f"certificate: no common storage shows that the sampled loop shrinks by {factor:.6g} per "
                           "sample (found), expected one. Ask for a slower decay, or sample faster.")


def _typed(law: FeedbackLaw, real: str) -> FeedbackLaw:
    return replace(law, **{k: getattr(law, k).astype(real) for k in ("Kx", "Ki", "reference", "limit")})


def _sparse(M: Array) -> Array:
    """A matrix, or several, without what is small in its row."""
    return np.where(np.abs(M) < DROP * np.abs(M).max(axis=-1, keepdims=True), 0.0, M)


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))
