"""From gains to a certified point observer: its set is sized (``point_sets``), both are frozen and certified."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace

import numpy as np

from ..algebra.dwell import fewest_samples
from ..certify import set_claims
from ..errors import CertificateError, DesignError
from ..observers import PointTables
from ..plant.model import Plant
from ..synthesis.ellipsoid import no_tnl
from ..synthesis.point import PointGains
from ..synthesis.refit import refit
from ..synthesis.set_options import check_set_options
from .box_sets import with_box
from .point_sets import draft, with_ellipsoid
from .table_sets import CHOICES, TABLES
from .trace_sets import with_trace

Array = np.ndarray


def certified(plant: Plant, gains: dict, proof: dict, real: str) -> tuple[PointTables, dict]:
    """Freeze gains and set on one number type and certify them.

    Raises
    ------
    CertificateError
    """
    resolve = None if proof["kind"] == "none" else partial(refit, plant, proof=proof)
    if gains["set"] in ("box", "ellipsoid_trace"):
        t = (with_box if gains["set"] == "box" else with_trace)(plant, gains, real)
        return t, set_claims.prove(plant.observed.modes, t, proof, resolve)
    if gains["set"] == "ellipsoid":
        t = with_ellipsoid(plant, gains, real)
        return t, set_claims.prove(plant.observed.modes, t, proof, resolve)
    if gains["set"] in TABLES:
        t, sources = TABLES[gains["set"]](plant, gains, real)
        return t, set_claims.prove(plant.observed.modes, t, proof, resolve, sources, gains["set"])
    t = draft(plant, gains, gains["order"], gains["limit"], real, gains["directions"], **gains["reduction"])
    return t, set_claims.prove(plant.observed.modes, t, proof, resolve, dwell=gains["dwell"])


def choice_of(options: dict, family: str) -> Callable[[Plant, dict, dict, int], dict]:
    """How the set is sized: what ``tables`` says, else ``set``, else the family's."""
    tables = options.get("tables", "none")
    return CHOICES[options.get("set", family) if tables == "none" else tables]


def dwell_of(plant: Plant, proof: dict) -> int:
    """Samples that every mode lasts at least, where the plant file or the proof says so."""
    return fewest_samples(plant.switching, plant.sample_period, proof)


def candidates(plant: Plant, module, options: dict, progress: Callable[[str], None]) -> Iterator[PointGains]:
    """Gains of the plant file, else those of the method.

    Raises
    ------
    DesignError
        Wrong shapes, or the method has none.
    """
    if "gains" not in options:
        yield from module.candidates(plant, options=options, progress=progress)
        return
    given, shape = options["gains"], (plant.n_modes, plant.n_x, plant.n_y)
    for key in given:
        if key not in ("L", "N"):
            raise DesignError(f"{plant.name}: observer.gains.{key} is unknown, expected L or N.")
    values = {}
    for key in ("L", "N"):
        try:
            values[key] = np.array(given.get(key, np.zeros(shape)), dtype=float)
        except (TypeError, ValueError):
            values[key] = np.empty(0)
        if values[key].shape != shape or not np.all(np.isfinite(values[key])):
            raise DesignError(f"{plant.name}: observer.gains.{key} has shape {values[key].shape}, expected {shape} "
                              "finite numbers (one matrix per mode).")
    kind = "tnl" if np.any(values["N"]) else "luenberger"
    if kind == "tnl" and no_tnl(plant) is not None:
        raise DesignError(f"{plant.name}: observer.gains.N: {no_tnl(plant)}. Leave N out.")
    yield PointGains("gains of the plant file", values["L"], values["N"], kind, {"kind": "none"})


def explore(plant: Plant, module, family: str, options: dict,
            progress: Callable[[str], None]) -> Iterator[SimpleNamespace]:
    """Certified candidates, ``candidate``, ``gains``, ``tables``, ``cert`` of each; without ``set`` the family's.

    Raises
    ------
    DesignError
        There are no gains, or no order settles; a set that cannot start from a box where the mode is not known.
    CertificateError
        Gains were found, none survives rounding.
    """
    check_set_options(plant.name, options, family, plant.n_y)
    if not plant.switching.known and options.get("tables", "none") not in ("none", "dwell"):
        raise DesignError(f'{plant.name}: observer.tables is "{options["tables"]}" where the mode is not known, '
                          'expected "none" or "dwell": between its starts the observer that follows sees one mode '
                          f'alone, so "dwell" is never worse than "{options["tables"]}". Take "dwell".')
    failure, made = None, []
    for c in candidates(plant, module, options, lambda text: progress(f"{text} ({len(made)} certified)")):
        gains = {"L": c.L, "N": c.N, "kind": c.kind}
        try:
            gains |= choice_of(options, family)(plant, gains, options, dwell_of(plant, c.proof))
            tables, cert = certified(plant, gains, c.proof, plant.target.real)
        except (DesignError, CertificateError) as error:
            failure = error
            continue
        made.append(c.label)
        yield SimpleNamespace(candidate=c, gains=gains, tables=tables, cert=cert)
    if not made and failure is not None:
        raise failure
