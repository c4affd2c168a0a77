"""From a plant whose mode nobody tells to a bank of sliding modes: designed, certified, measured."""

from __future__ import annotations

from collections.abc import Callable

from ..analysis.sliding_measure import measured
from ..certify import sliding_claims
from ..designs import Design, claims_of
from ..errors import CertificateError, DesignError
from ..observers import FAMILIES, SlidingTables, Supervision
from ..plant.model import Plant
from ..synthesis import METHODS
from ..synthesis.mode_sliding import TARGET, settings, theorem12
from ..synthesis.sliding_tables import tables_of

REALS = ("float32", "float64")


def designed(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> Design:
    """Tables of both number types, certified, and what their decision was measured to do.

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
        No gains are found.
    CertificateError
        The gains do not have the levels that the solver states.
    """
    chosen = settings(plant, options)
    progress(f"{name}: gains of {plant.n_modes} modes")
    try:
        found = theorem12([m.A for m in plant.modes], plant.modes[0].C, chosen["limit"], chosen["weight"])
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from None
    progress(f"{name}: certificate")
    tables = {real: tables_of(SlidingTables, plant, found, chosen, real) for real in REALS}
    try:
        certs = {real: sliding_claims.prove(plant, t, found, chosen["limit"], TARGET) for real, t in tables.items()}
    except CertificateError as error:
        raise CertificateError(f"{plant.name}: {error}") from None
    target = plant.target
    family = FAMILIES[METHODS[name].family]
    supervision = Supervision.of(target, assures=False)
    progress(f"{name}: delays and wrong decisions, measured")
    cells = measured(plant, family, supervision, lambda p: tables_of(
        SlidingTables, p, found, settings(p, options | {"slope": chosen["slope"]}), target.real))
    certs = {real: cert | {"measured": cells} for real, cert in certs.items()}
    choice = [{"method": name, "design": f"gains within {chosen['limit']:g} 1/s", "level": None, "relative_width": None,
               "surely_detected": [None] * plant.n_f, "chosen": True}]
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None]} for f in plant.f]  # none is promised to be found
    return Design(plant, name, family(tables, supervision), certs,
                  {real: claims_of(plant, tables[real], certs[real]) for real in tables},
                  {real: faults for real in tables}, choice, options)
