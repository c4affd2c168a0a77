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
    if options.get("threshold") == "calibrated":
        raise DesignError(f'{plant.name}: observer.threshold is "calibrated" where the mode is not known, expected '
                          '"guaranteed": what rules modes out has to be proved. Leave it out.')
    filter_calibration.asked(options)
    told, stays = staying(plant)
    gains = proposed(told, options, lambda text: progress(f"{name}: {text}"), stays)
    tables, certs = both(plant, options, lambda text: progress(f"{name}: {text}"))
    progress(f"{name}: thresholds of every mode that stays")
    made, proofs, most = {}, {}, options.get("set_rows")
    for real, mode in tables.items():
        try:
            constants, cert = leveled(told, gains, options, real, stays)
            own, sets = frozen(told, constants, mode, real, None if most is None else int(most))
        except CertificateError:
            if real == plant.target.real:
                raise
            continue  # the other number type may be too coarse; generate says so when asked for it
        made[real] = TrailingTables(**vars(mode), told=own)
        post = [x.tolist() for x in gains["proposal"].xi]
        proofs[real] = certs[real] | {"told": cert | {"sets": sets, "post": post}}
    level = proofs[plant.target.real]["told"]["level"]
    choice = [{"method": name, "design": "a filter per mode that stays", "level": level, "relative_width": None,
               "surely_detected": [None] * plant.n_f, "chosen": True}]
    return assembled(plant, name, "trailing", made, proofs, choice, options)
