"""Method "hinf-filter" where nobody tells the mode: a filter per mode, beside the set of modes that are possible.

Each filter runs in its own mode alone, and starts anew where that may not be so. So the design is that of modes that
stay: its level is that of the worst of them, whatever the switching.
"""

from __future__ import annotations

from collections.abc import Callable

from ..designs import Design
from ..errors import CertificateError, DesignError
from ..observers import TrailingTables
from ..plant.model import Plant
from . import filter_calibration
from .filter_designs import leveled, proposed
from .loose_filters import frozen
from .modes import assembled, both
from .trailing_claims import staying


def designed(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> Design:
    """Mode estimator and filters of both number types, certified.

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
        No filter exists, or an option is wrong.
    CertificateError
        None survives rounding, or modes cannot be told apart within the dwell time.
    """
    gains = gains_of(plant, options, lambda text: progress(f"{name}: {text}"))
    tables, certs = both(plant, options, lambda text: progress(f"{name}: {text}"))
    progress(f"{name}: thresholds of every mode that stays")
    own, proofs = filters(plant, options, gains, tables)
    made = {real: TrailingTables(**vars(tables[real]), told=told) for real, told in own.items()}
    certs = {real: certs[real] | {"told": proofs[real]} for real in own}
    return assembled(plant, name, "trailing", made, certs, choice_of(plant, name, proofs), options)


def gains_of(plant: Plant, options: dict, progress: Callable[[str], None]) -> dict:
    """A filter per mode that stays, as proposed.

    Raises
    ------
    DesignError
        No filter exists, or an option is wrong.
    """
    if options.get("threshold") == "calibrated":
        raise DesignError(f'{plant.name}: observer.threshold is "calibrated" where the mode is not known, expected '
                          '"guaranteed": what rules modes out has to be proved. Leave it out.')
    filter_calibration.asked(options)
    told, stays = staying(plant)
    return proposed(told, options, progress, stays)


def filters(plant: Plant, options: dict, gains: dict, tables: dict) -> tuple[dict, dict]:
    """Proposed filters with their thresholds, and what proves them, by number type.

    Parameters
    ----------
    plant : Plant
    options : dict
    gains : dict
        Of ``gains_of``.
    tables : dict
        real -> ModeTables or SlidingTables of the estimator.

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    (told, stays), most = staying(plant), options.get("set_rows")
    made, proofs, post = {}, {}, [x.tolist() for x in gains["proposal"].xi]
    for real, mode in tables.items():
        try:
            constants, cert = leveled(told, gains, options, real, stays)
            made[real], sets = frozen(told, constants, mode, real, None if most is None else int(most))
        except CertificateError:
            if real == plant.target.real:
                raise
            continue  # the other number type may be too coarse; generate says so when asked for it
        proofs[real] = cert | {"sets": sets, "post": post}
    return made, proofs


def choice_of(plant: Plant, name: str, proofs: dict) -> list[dict]:
    """What was tried: one design."""
    return [{"method": name, "design": "a filter per mode that stays", "level": proofs[plant.target.real]["level"],
             "relative_width": None, "surely_detected": [None] * plant.n_f, "chosen": True}]
