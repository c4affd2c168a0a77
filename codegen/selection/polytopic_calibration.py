"""Calibrated thresholds of a polytopic observer: lower than the guaranteed ones, or where there are none.

Only the last row of the table, which holds once settled, is calibrated. The rows of the starts stay guaranteed; where
no set of the error is kept nothing is judged until a start is forgotten (``certify.polytope_waiting``). The statistics
are the largest settled |M r| of each residual over a run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..analysis.calibration import Population, campaign, fault_free_runs, stated_runs
from ..analysis.validate import side_by_side
from ..certify import polytope_waiting
from ..certify.filter_bounds import raised
from ..errors import CertificateError, DesignError
from ..observers import PolytopicObserver, PolytopicTables, Supervision
from ..plant.model import Plant
from .filter_calibration import ROUNDING, asked
from .filter_tables import LENGTH, above
from .polytopic_tables import BEYOND, frozen, limited

Array = np.ndarray
#: Samples and runs that tell the size of residuals before there are thresholds.
PILOT, RUNS = 400, 3


class Designed:
    """What a campaign asks of a design."""

    def __init__(self, plant: Plant, t: PolytopicTables):
        self.plant, self.observer = plant, PolytopicObserver({t.real: t}, Supervision())


def settled(trace, q: Array) -> Array:
    """The statistic: per run the largest |M r| where the last row holds, (runs, p).

    Parameters
    ----------
    trace : PolytopicTrace
    q : ndarray (N, K)
        Not read.
    """
    size = np.where(trace.settled[..., None] != 0, np.nan_to_num(np.abs(trace.r)), 0)
    return size.astype(float).max(axis=1)


def with_thresholds(plant: Plant, whole: Plant, problem, t: PolytopicTables, proof: dict,
                    options: dict) -> tuple[PolytopicTables, dict]:
    """Tables with thresholds, guaranteed or, where that is asked for, calibrated.

    Parameters
    ----------
    plant : Plant
    whole : Plant
        Its x holds the faults too, where they are estimated.
    problem : DescriptorProblem
        Of these states.
    t : PolytopicTables
        Of ``polytopic_tables.tables_of``.
    proof : dict
        Of ``polytope_gain``.
    options : dict
        Of ``[observer]``.

    Returns
    -------
    tables : PolytopicTables
    cert : dict
        "thresholds", and "calibration" where they are calibrated.

    Raises
    ------
    DesignError
        No set of the error is kept and nothing is calibrated, or no run settles.
    """
    rows, asked_for = options.get("set_rows"), options.get("threshold") == "calibrated"
    try:
        t, held = frozen(whole, problem, t, np.array(proof["T1"]), proof.get("period"),
                         None if rows is None else int(rows), options.get("mismatch", "bounded") == "bounded")
    except DesignError as error:
        if not asked_for:
            raise DesignError(f'{error} Or take thresholds from simulated runs: observer.threshold = "calibrated".'
                              ) from None
        t = waiting(plant, whole, problem, t, proof)
        held = {"waits": t.last << t.shift}
    if not asked_for:
        return t, {"thresholds": held}
    t, said = calibrated(plant, t, held, options)
    if "waits" in held:
        polytope_waiting.check(whole, problem, t, proof)
    return t, {"thresholds": held, "calibration": said}


def waiting(plant: Plant, whole: Plant, problem, t: PolytopicTables, proof: dict) -> PolytopicTables:
    """Tables that judge nothing until a start is forgotten; their last row is no threshold yet.

    Parameters
    ----------
    plant, whole : Plant
        As in `with_thresholds`.
    problem : DescriptorProblem
    t : PolytopicTables
        Of ``polytopic_tables.tables_of``.
    proof : dict
        Of ``polytope_gain``.

    Raises
    ------
    CertificateError
        The error does not contract.
    """
    first = np.reshape(np.array(proof["T1"]), (-1, *problem.E.shape))[0] @ problem.E
    near = limited(whole, t, first, 0 * whole.x0_lo)
    gains, (_, start) = polytope_waiting.starting(whole, problem, near, proof)
    reach = np.sqrt(np.diag(np.linalg.inv(np.array(proof["P1"]))) * float(start))
    t = limited(whole, t, first, BEYOND * reach)
    gains, (begun, start) = polytope_waiting.starting(whole, problem, t, proof)
    most = above(raised(polytope_waiting.beyond_reach(t)), t.real)
    open_ = replace(t, h=np.array([most], t.real), start=0, shift=0)
    u, y, q, theta = side_by_side(fault_free_runs(plant, Population(PILOT), RUNS, 1))
    trace = Designed(plant, open_).observer.run_many(u, y, q, t.real, theta=theta)
    levels = np.abs(trace.r[:, PILOT // 2:]).astype(float).max(axis=(0, 1)) + 1e-30
    wait = polytope_waiting.samples_needed(gains, start, proof["contraction"], levels)
    at_once = polytope_waiting.samples_needed(gains, begun, proof["contraction"], levels) == 0
    shift = 0
    while wait > LENGTH << shift:
        shift += 1
    rows = -(-wait // (1 << shift))
    return replace(t, h=np.tile(most, (rows + 1, 1)), start=rows if at_once else 0, shift=shift)


def calibrated(plant: Plant, t: PolytopicTables, held: dict, options: dict) -> tuple[PolytopicTables, dict]:
    """Lower the last row of tables to what a campaign gives.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    held : dict
        Of these, as the certificate keeps it.
    options : dict
        ``false_alarm``, ``confidence``, ``campaign_steps`` and ``rank`` are read.

    Returns
    -------
    tables : PolytopicTables
    calibration : dict

    Raises
    ------
    DesignError
        An option is out of its range, or no run settles.
    PlantError
        No runs can be drawn.
    """
    population, chance, sure, rank = asked(options)
    if "campaign_steps" not in options:
        population = Population(population.steps + ((t.last - t.start) << t.shift))
    found = campaign(Designed(plant, t), settled, chance, sure, population, rank, real=t.real)
    if np.any(found.thresholds <= 0):
        raise DesignError(f"{plant.name}: no run of {population.steps} samples settles (found, residual "
                          f"{plant.y[int(np.argmin(found.thresholds))].name}), expected one to calibrate by. Raise "
                          "observer.campaign_steps.")
    last = np.minimum(above(found.thresholds, t.real), t.h[-1])
    said = {"probability": found.probability, "confidence": found.confidence, "runs": found.runs,
            "steps": found.steps, "rank": found.rank, "seed": found.seed, "conditions": list(found.conditions)}
    said["guaranteed"] = None if "waits" in held else t.h[-1].astype(float).tolist()
    return replace(t, h=np.concatenate([t.h[:-1], last[None]])), said


def uncalibrated(t: PolytopicTables, calibration: dict) -> PolytopicTables:
    """The tables before they were calibrated; where there was no threshold what no measurement exceeds.

    Parameters
    ----------
    t : PolytopicTables
    calibration : dict
    """
    last = calibration["guaranteed"]
    last = above(raised(polytope_waiting.beyond_reach(t)), t.real) if last is None else np.array(last).astype(t.dtype)
    return replace(t, h=np.concatenate([t.h[:-1], last.reshape(1, -1)]))


def check(plant: Plant, t: PolytopicTables, c: dict) -> list[str]:
    """Draw the runs of a calibration again; return what may be said of the thresholds.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    c : dict
        "calibration" of the certificate.

    Raises
    ------
    CertificateError
        A threshold is not what the runs give, or the confidence is more than they allow.
    """
    u, y, q, theta = stated_runs(plant, c, c["rank"] * t.h.shape[1])
    trace = Designed(plant, uncalibrated(t, c)).observer.run_many(u, y, q, t.real, theta=theta)
    beyond = np.sum(settled(trace, q) > t.h[-1].astype(float) * (1 + ROUNDING), axis=0)
    if np.any(beyond >= c["rank"]):
        i = int(np.argmax(beyond))
        raise CertificateError(f"certificate: {beyond[i]} runs of the campaign exceed the threshold of residual {i}, "
                               f"expected fewer than {c['rank']}.")
    return sentences(t, c)


def sentences(t: PolytopicTables, c: dict) -> list[str]:
    """What may be said of calibrated thresholds.

    Parameters
    ----------
    t : PolytopicTables
    c : dict
    """
    before = (f"; until {t.last << t.shift} samples after a start r_bound is what no measurement within its range "
              "exceeds, and the start is no more than a tenth of it then" if c["guaranteed"] is None else
              "; before that it is guaranteed")
    return [f"not proved but calibrated: once settled r_bound comes from {c['runs']} simulated runs without fault. In "
            f"a further run like these a false alarm has a probability of at most {c['probability']:g}, with "
            f"{100 * np.floor(c['confidence'] * 1e4) / 1e4:g} % confidence (exact binomial, rank {c['rank']}). Runs "
            f"like these: {'; '.join(c['conditions'])}{before}"]
