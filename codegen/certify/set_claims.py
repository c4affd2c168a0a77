"""The certificate of a point observer with an error set: the set's own conditions, and the level of the gains."""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError
from . import blocks, boxes, ellipsoids, residual_gain, schedules, set_freeze, starts, thresholds, trace_ellipsoids
from .exact import rational, up
from .sets import SetDemands

#: What is checked of each kind of set.
CHECKS = {"zonotope": set_freeze.check_zonotope, "thresholds": thresholds.check, "schedule": schedules.check,
          "blocks": blocks.check, "ellipsoid": ellipsoids.check, "box": boxes.check,
          "ellipsoid_trace": trace_ellipsoids.check, "starts": starts.check}
#: How the certificate of a table is made.
TABLES = {"thresholds": thresholds.certificate, "schedule": schedules.certificate, "blocks": blocks.certificate}


def prove(modes, t, proof: dict, resolve=None, tables: tuple = (), kind: str = "", dwell: int = 1) -> dict:
    """Make the certificate of the tables of a point observer.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
    proof : dict
        Of the gains; kind "none": containment only.
    resolve : callable, optional
        See ``residual_gain.prove``.
    tables : (DwellTable, DwellTable)
        Of ``thresholds.freeze_thresholds``: where the set is a table by dwell time.
    kind : str
        A key of ``TABLES``, where the set is a table.
    dwell : int
        Samples that every mode lasts at least: read for a zonotope.

    Returns
    -------
    dict
        ``check`` accepts it.

    Raises
    ------
    CertificateError
        A condition fails on the emitted constants.
    """
    level = dict(proof) if proof["kind"] == "none" else residual_gain.prove(modes, t.L, t.N, proof, resolve)
    level["rest"] = rounding(modes, t)
    if kind == "starts":
        cert = starts.certificate(t, level)
        starts.check(modes, t, cert)
        return cert
    if hasattr(t.shape, "Pb"):
        return boxes.prove(modes, t, level)
    if hasattr(t.shape, "weight_y"):
        return trace_ellipsoids.prove(modes, t, level)
    if hasattr(t.shape, "kb"):
        cert = {**level, "set": "ellipsoid", "steady_box": None}
        ellipsoids.check(modes, t, cert)
        return cert
    if kind not in TABLES:
        return set_freeze.prove_zonotope(modes, t, level, dwell)
    cert = TABLES[kind](*tables, t, level)
    CHECKS[kind](modes, t, cert)
    return cert


def rounding(modes, t) -> dict:
    """Boxes of what rounding, of constants too, adds to a step of the error and to the residual, rounded up.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables

    Returns
    -------
    dict
        "error" (N, n_x), "residual" (N, n_y), nested lists.
    """
    demands, count = SetDemands(modes, t), range(len(modes))
    return {name: [[up(x) for x in row(q)] for q in count]
            for name, row in (("error", lambda q: demands.rest(q, True)), ("residual", demands.residual_rest))}


def check(modes, t, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition, the mode and by how much it fails.
    """
    claims, least = CHECKS[cert["set"]](modes, t, cert), rounding(modes, t)
    for name, box in cert["rest"].items():
        if np.any(rational(np.array(box)) < rational(np.array(least[name]))):
            raise CertificateError(f"certificate: what rounding adds to the {name} is more than its box in the "
                                   "certificate: faults would be promised to be found that need not be.")
    return claims if cert["kind"] == "none" else claims + residual_gain.check(modes, t.L, t.N, cert)
