"""Runs that try what is promised of faults beside a mode estimator, with what hides them as well as constants can.

Every promise is tried in every mode and either way, at both ends of its sizes: noise is held against the fault, inputs
and disturbances are at an end of their bounds.
"""

from __future__ import annotations

from itertools import product

from ..plant.model import Fault, Plant, Scenario

PROMISED = "as promised: "
#: Sizes just within what is promised.
INSIDE = 1e-6


def name_of(promise: dict) -> str:
    """What the runs of a promise are called.

    Parameters
    ----------
    promise : dict
        Of ``certificate[real]["faults"]``.
    """
    return f'{PROMISED}"{promise["channel"]}" within {promise["within"]}'


def names(design) -> list[str]:
    """Names of the runs of a design, whichever number type runs.

    Parameters
    ----------
    design : Design
    """
    certs = [c for c in design.certificate.values() if c.get("kind") == "mode"]
    return list(dict.fromkeys(name_of(f) for cert in certs for f in cert.get("faults", ())))


def of(cert: dict, name: str) -> dict | None:
    """The promise of this name in a certificate, if any.

    Parameters
    ----------
    cert : dict
    name : str
    """
    return next((f for f in cert.get("faults", ()) if name_of(f) == name), None)


def trials(plant: Plant, promise: dict) -> list[Scenario]:
    """Runs of one promise.

    Parameters
    ----------
    plant : Plant
    promise : dict

    Returns
    -------
    list of Scenario
        The fault begins as soon as the promise is in force, and stays.
    """
    j = [f.name for f in plant.f].index(promise["channel"])
    start = promise["after"] + 2
    steps, (u_lo, u_hi), f = start + promise["within"] + 3, plant.limits("u"), plant.f[j]
    sizes = [promise["size"] * (1 + INSIDE)] + ([promise["upto"] * (1 - INSIDE)] if "upto" in promise else [])
    out = []
    for (q, mode), sign, size in product(enumerate(plant.modes), (1, -1), sizes):
        if f.lo <= sign * size <= f.hi:
            against = mode.v_lo if sign > 0 else mode.v_hi
            ends = (mode.w_lo, u_lo) if len(out) % 2 else (mode.w_hi, u_hi)
            w, u, v = (tuple(repr(float(x)) for x in end) for end in (*ends, against))
            out.append(Scenario(name_of(promise), steps, ((0, q),), u, w, v,
                                (Fault(j, start, steps, repr(float(sign * size))),), theta="corner"))
    return out
