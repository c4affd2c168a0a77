"""From a polytopic plant with sensor faults to a certified bank: one detector per fault, thresholds from a campaign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..analysis.calibration import Population, fault_free_runs, losses
from ..analysis.order_statistics import Calibration, calibrate, runs_needed
from ..analysis.validate import side_by_side
from ..certify import bank as settling
from ..certify import bank_limits
from ..certify.exact import rational
from ..designs import Design
from ..errors import CertificateError, DesignError
from ..observers import FAMILIES, Supervision
from ..observers.bank_tables import BankTables, Member
from ..observers.runner import outward
from ..plant.model import Plant
from ..plant.weight_program import weight_program
from ..synthesis.bank import AVERAGE, BRIDGE, CONFIDENCE, GAIN, GAP, KEEP, MARGIN, PROBABILITY, decay_of, member
from ..synthesis.descriptor_lmi import Bounds
from .bank_claims import check
from .descriptors import problem_and_scaling
from .detectors import CertifiedDetector, faults_of, sampled_detector
from .polytopic_tables import read_parameters

Array = np.ndarray
#: Samples of a fault-free run that are judged.
JUDGED = 600


@dataclass(frozen=True)
class Draft:
    """A bank without thresholds, on one number type.

    Parameters
    ----------
    tables : BankTables
        Its bounds are infinite, its settling time zero.
    detectors : list of CertifiedDetector
    reach, close : list of float
        g E0 of each member, from the declared range and from the initial box: see ``certify.bank``.
    starts : list of dict
        For ``certify.bank``.
    """

    tables: BankTables
    detectors: list[CertifiedDetector]
    reach: list[float]
    close: list[float]
    starts: list[dict]


def drafted(plant: Plant, options: dict, real: str, progress: Callable[[str], None]) -> Draft:
    """Design and certify the members, and put their tables together.

    Parameters
    ----------
    plant : Plant
    options : dict
    real : {"float32", "float64"}
    progress : callable

    Raises
    ------
    DesignError
        A member has no design.
    CertificateError
        The exact check refuses one.
    """
    problem, s = problem_and_scaling(plant)
    faults, period = faults_of(plant), plant.sample_period
    bounds = Bounds(float(options.get("gain", GAIN)), float(options.get("decay", decay_of(problem))))
    free = len(problem.pairs) == len(problem.A) ** 2
    weights, x0 = weight_program(plant.polytope, real), (plant.x0_lo + plant.x0_hi) / 2
    members, detectors = [], []
    for k, fault in enumerate(plant.f):
        progress(f"observer without the sensors of {fault.name} ({real})")
        seen, own, others, units = member(plant, problem, faults, s, k)
        try:
            found = sampled_detector(own, others, bounds, period, real, units, free)
        except (DesignError, CertificateError) as error:
            raise type(error)(f'{plant.name}: observer without the sensors of "{fault.name}": {error}') from None
        g, start = found.gains, x0 - found.gains.T2 @ (found.gains.C @ x0)
        members.append(Member(seen, *(near(M, real) for M in (g.T2, g.C, g.F, g.G, g.K, found.M, start)), weights))
        detectors.append(found)
    boxes, ends = {"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}, ("lo", "hi")
    ranges = {f"{v}_{end}": outward(limit, real, side) for v, box in boxes.items()
              for end, limit, side in zip(ends, box, (-np.inf, np.inf))}
    ranges |= {f"{v}_{end}": near(np.clip(limit, -np.finfo(real).max, np.finfo(real).max), real)
               for v in "uy" for end, limit in zip(ends, plant.limits(v))}
    rate = float(near(np.array(min(1.0, period / float(options.get("average", AVERAGE * period)))), real))
    keep = max(1, round(float(options.get("keep", KEEP * period)) / period))
    t = BankTables(real, tuple(members), np.full(len(members), np.inf, real), rate, 0, 0, keep, GAP,
                   int(options.get("bridge", BRIDGE)), *_unlimited(members), weights, **ranges,
                   **read_parameters(plant, real))
    found = [bank_limits.reach(m, rational(np.array(d.proof["level"]["P1"])), d.proof["level"]["contraction"], t)
             for m, d in zip(members, detectors)]
    t = replace(t, limit=np.concatenate([a for a, _ in found]), most=np.concatenate([b for _, b in found]))
    starts, reach, close = [], [], []
    for k, d in enumerate(detectors):
        own = member(plant, problem, faults, s, k)[1]
        starts.append(gain_of(own, d, k))
        for box, found in ((("x_lo", "x_hi"), reach), (("x0_lo", "x0_hi"), close)):
            begun = settling.start_square(own, d.gains, rational(np.array(d.proof["level"]["P1"])),
                                          members[k].z0.astype(float), *(getattr(t, v).astype(float) for v in box))
            found.append(float(np.sqrt(starts[k]["gain2"] * float(begun))) * (1 + 1e-9))
    return Draft(t, detectors, reach, close, starts)


def _unlimited(members: list[Member]) -> tuple[Array, Array]:
    """Limits of tables that have none yet."""
    return (np.full(sum(len(v) for v in part), np.inf) for part in ([m.z0 for m in members], [m.M for m in members]))


def near(values: Array, real: str) -> Array:
    """An array of the type, without negative zeros.

    Parameters
    ----------
    values : ndarray (any shape)
    real : {"float32", "float64"}
    """
    return np.asarray(values, dtype=float).astype(real) + np.dtype(real).type(0)


def gain_of(problem, d: CertifiedDetector, k: int) -> dict:
    """How large the residual of an error can be in the norm of the member's P1, for ``certify.bank``.

    Parameters
    ----------
    problem : DescriptorProblem
    d : CertifiedDetector
    k : int
        Number of the member.
    """
    P1, T1 = np.array(d.proof["level"]["P1"]), np.array(d.proof["T1"])
    out = settling.output_gain(problem, d.gains, d.M, T1, rational(P1), d.proof.get("period")).astype(float)
    root = np.linalg.cholesky(P1)
    return {"member": k, "gain2": float(np.linalg.norm(np.linalg.solve(root, out.T), 2) ** 2 * (1 + 1e-9))}


def levels(t: BankTables, truths: list, observer=None, lost: Array | None = None) -> Array:
    """Levels of every member in given runs (N, K, P), NaN at samples that are lost.

    Parameters
    ----------
    t : BankTables
    truths : list of PlantTrace
    observer : BankObserver, optional
    lost : ndarray (N, K) bool, optional
    """
    observer = observer or FAMILIES["bank"]({t.real: t}, Supervision())
    u, y, q, theta = side_by_side(truths)
    y = y if lost is None else np.where(lost[:, :y.shape[1], None], np.nan, y)
    return observer.run_many(u, y, np.zeros_like(q), t.real, theta=theta).r


def calibrated(plant: Plant, draft: Draft, options: dict, truths: list | None) -> tuple[BankTables, Calibration, list]:
    """Settling time and thresholds: the largest levels of fault-free runs once they have settled, times the margin.

    Parameters
    ----------
    plant : Plant
    draft : Draft
    options : dict
    truths : list of PlantTrace or None
        Runs of the campaign where they are at hand.

    Returns
    -------
    tables : BankTables
    calibration : Calibration
        Of the levels, without the margin.
    truths : list of PlantTrace
    """
    t, seed = draft.tables, int(options.get("seed", 0))
    pilot = levels(t, fault_free_runs(plant, Population(2 * JUDGED), 1, seed + 1))[0, JUDGED:].max(axis=0)
    wait = max(settling.samples_needed(t.rate, d.proof["level"]["contraction"], reach, float(top))
               for d, reach, top in zip(draft.detectors, draft.reach, pilot))
    probability = float(options.get("probability", PROBABILITY))
    runs = runs_needed(probability, float(options.get("confidence", CONFIDENCE)), len(t.members))
    at_once = all(c <= float(settling.SHARE) * np.sqrt(top) for c, top in zip(draft.close, pilot))
    begin = 0 if at_once else wait
    population = Population(begin + JUDGED, gap=t.gap, bridge=t.bridge)
    if truths is None or len(truths[0].y) < begin + JUDGED:
        truths = fault_free_runs(plant, population, runs, seed)
    lost = losses(replace(population, steps=len(truths[0].y)), runs, seed + 2)
    found = calibrate(np.nanmax(levels(t, truths, lost=lost)[:, begin:], axis=1), probability, len(truths[0].y))
    found = replace(found, seed=seed, conditions=population.words(plant))
    bound = near(float(options.get("margin", MARGIN)) ** 2 * found.thresholds, t.real)
    return replace(t, bound=bound, settle=wait, begin=begin), found, truths


def designed(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> Design:
    """Tables of both number types, certified and calibrated.

    Parameters
    ----------
    plant : Plant
    name : str
        Key of METHODS.
    options : dict
        Of ``[observer]``.
    progress : callable

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        A member has no design.
    CertificateError
        The exact check refuses one.
    """
    tables, certs, truths = {}, {}, None
    for real in sorted(("float32", "float64"), key=lambda r: r != plant.target.real):
        draft = drafted(plant, options, real, lambda text: progress(f"{name}: {text}"))
        progress(f"{name}: fault-free runs ({real})")
        tables[real], found, truths = calibrated(plant, draft, options, truths)
        certs[real] = {"kind": "bank", "members": [
            {"gamma": d.gamma, "beta": d.beta, "designed": d.designed, "proof": d.proof, "start": start}
            for d, start in zip(draft.detectors, draft.starts)], "calibration": {
                "levels": found.thresholds.astype(float).tolist(), "runs": found.runs, "steps": found.steps,
                "probability": found.probability, "confidence": found.confidence, "seed": found.seed,
                "conditions": list(found.conditions)}}
    tables, certs = ({real: by[real] for real in ("float32", "float64")} for by in (tables, certs))
    target = plant.target
    supervision = Supervision.of(target, assures=False)  # thresholds are calibrated
    choice = [{"method": name, "design": f"{plant.n_f} observers", "level": max(m["gamma"] for m in certs[target.real][
        "members"]), "relative_width": None, "surely_detected": [None] * plant.n_f, "chosen": True}]
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None]} for f in plant.f]  # none is promised to be found
    return Design(plant, name, FAMILIES["bank"](tables, supervision), certs,
                  {real: check(plant, tables[real], certs[real]) for real in tables}, {real: faults for real in tables},
                  choice, options)
