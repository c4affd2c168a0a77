"""From a plant whose mode nobody tells to a bank of sliding modes, alone or with what it guides."""

from __future__ import annotations

from collections.abc import Callable

from ..analysis.sliding_measure import measured, paced
from ..certify import sliding_claims
from ..designs import Design
from ..errors import CertificateError, DesignError
from ..observers import (
    GuidedFilterObserver,
    GuidedObserver,
    GuidedPointObserver,
    SlidingObserver,
    SlidingTables,
    Supervision,
)
from ..plant.bounded import bounded
from ..plant.model import Plant
from ..synthesis.guided_tables import guided as joined
from ..synthesis.mode_sliding import TARGET, settings, theorem12
from ..synthesis.sliding_tables import tables_of
from . import trailing
from .modes import assembled

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
    tables, certs, label = both(plant, options, lambda text: progress(f"{name}: {text}"))
    choice = [{"method": name, "design": label, "level": None, "relative_width": None, "surely_detected": [],
               "chosen": True}]
    return assembled(plant, name, SlidingObserver.family, tables, certs, choice, options, assures=False)


def guided(plant: Plant, name: str, told: dict, proofs: dict, choice: list, options: dict,
           progress: Callable[[str], None]) -> Design:
    """Framers that are told their mode, in the mode that the sliding modes decide for.

    Parameters
    ----------
    plant : Plant
    name : str
        Method of the framers.
    told, proofs : dict
        real -> tables of the framers, and their certificate.
    choice : list of dict
        What was tried.
    options : dict
    progress : callable

    Returns
    -------
    Design

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    return joint(GuidedObserver, {}, plant, name, told, proofs, choice, options, progress)


def guided_point(plant: Plant, name: str, told: dict, proofs: dict, choice: list, options: dict,
                 progress: Callable[[str], None]) -> Design:
    """A point observer that is told its mode, in the mode that the sliding modes decide for; as ``guided``.

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    family = {"set": next(iter(proofs.values()))["set"]}
    return joint(GuidedPointObserver, family, plant, name, told, proofs, choice, options, progress)


def guided_filter(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> Design:
    """A filter per mode that stays, in the mode that the sliding modes decide for; parameters as of ``designed``.

    Raises
    ------
    DesignError
        No gains or no filters are found, or an option is wrong.
    CertificateError
        They do not survive rounding.
    """
    gains = trailing.gains_of(plant, options, lambda text: progress(f"{name}: {text}"))
    tables, certs, _ = both(plant, options, lambda text: progress(f"{name}: {text}"))
    progress(f"{name}: thresholds of every mode that stays")
    told, proofs = trailing.filters(plant, options, gains, tables)
    return together(GuidedFilterObserver, {}, plant, name, (tables, certs), told, proofs,
                    trailing.choice_of(plant, name, proofs), options, progress)


def joint(observer: type, more: dict, plant: Plant, name: str, told: dict, proofs: dict, choice: list, options: dict,
          progress: Callable[[str], None]) -> Design:
    """The estimator with what it guides: in one table, certified, measured.

    Parameters
    ----------
    observer : type
        Of ``observers``.
    more : dict
        Fields of its tables beside "told".
    plant, name, told, proofs, choice, options, progress
        As of ``guided``.

    Returns
    -------
    Design

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    own = both(plant, options, lambda text: progress(f"{name}: {text}"))[:2]
    return together(observer, more, plant, name, own, told, proofs, choice, options, progress)


def together(observer: type, more: dict, plant: Plant, name: str, own: tuple[dict, dict], told: dict, proofs: dict,
             choice: list, options: dict, progress: Callable[[str], None]) -> Design:
    """As ``joint``, with tables and certificates of the estimator in ``own``."""
    tables, certs = own
    shared = [real for real in tables if real in told]
    tables = {r: joined(observer.tables_class, tables[r], told[r], **more) for r in shared}
    progress(f"{name}: false alarms, measured")
    real = plant.target.real
    cells = paced(plant, observer({real: tables[real]}, supervision_of(plant)), real)
    certs = {r: certs[r] | {"told": proofs[r], "paced": cells} for r in shared}
    return assembled(plant, name, observer.family, tables, certs, choice, options, assures=False)


def supervision_of(plant: Plant) -> Supervision:
    """Alarms of the plant file, nothing assured."""
    return Supervision.of(plant.target, assures=False)


def both(plant: Plant, options: dict, progress: Callable[[str], None]) -> tuple[dict, dict, str]:
    """Tables of the estimator, their certificates with what was measured, by number type, and what they are.

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    seen = bounded(plant)  # no parameter is an input of the estimator
    chosen = settings(seen, options)
    progress(f"gains of {plant.n_modes} modes")
    try:
        found = theorem12([m.A for m in seen.modes], seen.modes[0].C, chosen["limit"], chosen["weight"])
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from None
    progress("certificate")
    tables = {real: tables_of(SlidingTables, seen, found, chosen, real) for real in REALS}
    try:
        certs = {real: sliding_claims.prove(seen, t, found, chosen["limit"], TARGET) for real, t in tables.items()}
    except CertificateError as error:
        raise CertificateError(f"{plant.name}: {error}") from None
    progress("delays and wrong decisions, measured")
    cells = measured(plant, SlidingObserver, supervision_of(plant), lambda p: tables_of(
        SlidingTables, bounded(p), found, settings(p, options | {"slope": chosen["slope"]}), plant.target.real))
    return (tables, {real: cert | {"measured": cells} for real, cert in certs.items()},
            f"gains within {chosen['limit']:g} 1/s")
