"""Calibrated thresholds of a fault estimation filter: lower than the guaranteed ones, with a stated chance of a false
alarm in place of none.

Only the last row of the table, which holds once settled, is calibrated; the rows of the starts stay guaranteed. The
statistics are the largest settled |f_hat| of each fault in each mode over a run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..analysis.calibration import Population, campaign, stated_runs
from ..analysis.order_statistics import Calibration
from ..errors import CertificateError, DesignError
from ..observers import FilterObserver, FilterTables, Supervision
from ..plant.model import Plant
from .filter_tables import above

Array = np.ndarray
#: Where the plant file says nothing: chance of a false alarm in a run, confidence, samples of a run, rank.
ALARM, CONFIDENCE, STEPS, RANK = 0.01, 0.95, 200, 1
#: A run is beyond a threshold where it exceeds it by more than simulations of one run may differ between machines.
ROUNDING = 1e-6


def bucket(cert: dict) -> Supervision:
    """The dwell monitor of a certificate, alarms at once."""
    return Supervision(**{k: cert[k] for k in ("dwell_add", "dwell_drain", "dwell_limit")})


def settled(t: FilterTables):
    """The statistic: per run, mode and fault the largest |f_hat| where the last row holds, (runs, N, n_f)."""
    def largest(trace, q: Array) -> Array:
        last = np.all(trace.f_bound == t.h[-1][q], axis=-1)
        size = np.where(last[..., None], np.abs(trace.f_hat), 0).astype(float)
        return np.stack([np.max(np.where((q == i)[..., None], size, 0), axis=1) for i in range(len(t.M))], axis=1)

    return largest


def asked(options: dict) -> tuple[Population, float, float, int]:
    """Population, chance of a false alarm, confidence and rank of ``[observer]``.

    Raises
    ------
    DesignError
        A chance of none or of one.
    """
    chance, sure = (float(options.get(k, d)) for k, d in (("false_alarm", ALARM), ("confidence", CONFIDENCE)))
    for name, value in (("false_alarm", chance), ("confidence", sure)):
        if not 1e-5 <= value <= 1 - 1e-5:
            raise DesignError(f"observer.{name} is {value:g}, expected 0.00001 to 0.99999: a campaign cannot say more. "
                              'For no false alarm at all use threshold = "guaranteed".')
    steps, rank = (int(options.get(k, d)) for k, d in (("campaign_steps", STEPS), ("rank", RANK)))
    return Population(steps=steps), chance, sure, rank


def calibrated(plant: Plant, t: FilterTables, cert: dict, options: dict) -> tuple[FilterTables, dict]:
    """Lower the last row of certified tables to what a campaign gives.

    Parameters
    ----------
    plant : Plant
    t : FilterTables
        With guaranteed thresholds.
    cert : dict
        Of these.
    options : dict
        ``false_alarm``, ``confidence``, ``campaign_steps`` and ``rank`` are read.

    Returns
    -------
    tables : FilterTables
    cert : dict
        With "calibration".

    Raises
    ------
    DesignError
        An option is out of its range.
    PlantError
        No runs can be drawn.
    """
    population, chance, sure, rank = asked(options)
    found = campaign(Designed(plant, t, cert), settled(t), chance, sure, population, rank, real=t.real)
    if np.any(found.thresholds <= 0):
        q, j = np.argwhere(found.thresholds <= 0)[0]
        raise DesignError(f'{plant.name}: no run of {population.steps} samples settles in mode "{plant.modes[q].name}" '
                          f'(found, fault {plant.f[j].name}), expected one to calibrate by. Raise '
                          "observer.campaign_steps.")
    h = np.concatenate([t.h[:-1], np.minimum(above(found.thresholds, t.real), t.h[-1])[None]])
    return replace(t, h=h), cert | {"calibration": said(found, t)}


class Designed:
    """What a campaign asks of a design."""

    def __init__(self, plant: Plant, t: FilterTables, cert: dict):
        self.plant, self.observer = plant, FilterObserver({t.real: t}, bucket(cert))


def said(found: Calibration, t: FilterTables) -> dict:
    """A calibration as design.json keeps it, with the thresholds that are guaranteed."""
    return {"probability": found.probability, "confidence": found.confidence, "runs": found.runs,
            "steps": found.steps, "rank": found.rank, "seed": found.seed, "conditions": list(found.conditions),
            "guaranteed": t.h[-1].astype(float).tolist()}


def guaranteed(t: FilterTables, cert: dict) -> FilterTables:
    """The tables with guaranteed thresholds throughout."""
    if "calibration" not in cert:
        return t
    last = np.array(cert["calibration"]["guaranteed"], dtype=float).reshape(t.h.shape[1:])
    return replace(t, h=np.concatenate([t.h[:-1], last.astype(t.dtype)[None]]))


def check(plant: Plant, t: FilterTables, cert: dict) -> list[str]:
    """Draw the runs of a calibration again; return what may be said of the thresholds.

    Parameters
    ----------
    plant : Plant
    t : FilterTables
        With calibrated thresholds.
    cert : dict

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
        A threshold is not what the runs give, or the confidence is more than they allow.
    """
    c, whole = cert["calibration"], guaranteed(t, cert)
    blocks = c["rank"] * int(np.prod(t.h.shape[1:]))
    u, y, q, theta = stated_runs(plant, c, blocks)
    trace = Designed(plant, whole, cert).observer.run_many(u, y, q, t.real, theta=theta)
    beyond = np.sum(settled(whole)(trace, q) > t.h[-1].astype(float) * (1 + ROUNDING), axis=0)
    if np.any(beyond >= c["rank"]):
        i, j = np.argwhere(beyond >= c["rank"])[0]
        raise CertificateError(f"certificate: {beyond[i, j]} runs of the campaign exceed the threshold of fault {j} in "
                               f"mode {i}, expected fewer than {c['rank']}.")
    return sentences(c)


def sentences(c: dict) -> list[str]:
    """What may be said of calibrated thresholds."""
    return [f"not proved but calibrated: once settled f_bound comes from {c['runs']} simulated runs without fault. In "
            f"a further run like these a false alarm has a probability of at most {c['probability']:g}, with "
            f"{100 * np.floor(c['confidence'] * 1e4) / 1e4:g} % confidence (exact binomial, rank {c['rank']}). Runs "
            f"like these: {'; '.join(c['conditions'])}"]
