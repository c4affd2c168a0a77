"""From a polytopic plant to a certified design."""

from __future__ import annotations

from collections.abc import Callable

from ..analysis.detectability import surely_detected
from ..designs import Design, claims_of
from ..errors import CertificateError, DesignError
from ..observers import FAMILIES, Supervision
from ..plant.model import Plant
from ..synthesis import METHODS
from . import descriptor_designs, fault_estimators, polytopic_designs, tracking_designs

#: What proposes and certifies, for methods that have their own.
MAKERS = {"descriptor-direct": descriptor_designs, "descriptor-fault-estimation": fault_estimators,
          "tracking": tracking_designs}
#: Delay of a sure alarm that is looked at, where the plant file says nothing.
WITHIN = 3


def in_turn(plant: Plant) -> list[str]:
    """The methods for a polytopic plant that names none, the first that certifies is taken.

    Euler steps of an observer in continuous time come before a recursion that is designed at the period itself: where
    the period is too long for the former, the latter may still do.

    Parameters
    ----------
    plant : Plant
    """
    if plant.kind == "discrete":
        return ["descriptor-discrete"]
    unseen = METHODS["descriptor-uncertain"].module.inapplicable(plant)
    if unseen is not None and METHODS["descriptor-direct"].module.inapplicable(plant) is None:
        return ["descriptor-direct"]
    return ["descriptor-uncertain", "descriptor-discrete"]


def designed(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> Design:
    """Tables of both number types, certified.

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
        No observer or no threshold exists.
    CertificateError
        None survives rounding.
    """
    progress(f"{name}: {len(plant.polytope.vertices)} vertices, {plant.n_x} states")
    maker = MAKERS.get(name, polytopic_designs)
    proposal, wanted = maker.propose(plant, name, options), plant.target.real
    tables, certs, failure = {}, {}, None
    for real in (wanted, "float64" if wanted == "float32" else "float32"):
        progress(f"{name}: level and thresholds ({real})")
        try:
            tables[real], certs[real] = maker.certified(plant, proposal, options, real)
        except (CertificateError, DesignError) as error:
            if real == wanted:  # the other number type may be too coarse; generate says so when asked for it
                raise type(error)(f"{plant.name}: {str(error).removeprefix(f'{plant.name}: ')}") from None
            failure = error
    progress(f"{name}: certified" + (f", but for one number type: {failure}" if failure else ""))
    tables, certs = ({real: by[real] for real in ("float32", "float64") if real in by} for by in (tables, certs))
    within, supervision = int(options.get("within", WITHIN)), Supervision.of(
        plant.target, assures="calibration" not in certs[wanted])
    faults = {real: [{"channel": f.channel, "unit": f.unit, "by_delay": [None if x == float("inf") else x
                                                                         for x in f.by_delay]}
                     for f in surely_detected(plant, tables[real], certs[real], within)] for real in tables}
    choice = [{"method": name, "design": f"observer of {len(plant.polytope.vertices)} vertices",
               "level": certs[wanted]["level"], "relative_width": None,
               "surely_detected": [f["by_delay"][-1] for f in faults[wanted]], "chosen": True}]
    return Design(plant, name, FAMILIES[METHODS[name].family](tables, supervision), certs,
                  {real: claims_of(plant, tables[real], certs[real]) for real in tables}, faults, choice, options)
