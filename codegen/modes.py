"""From a plant whose mode nobody tells to a certified mode estimator."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from .certify import mode_certificate
from .designs import Design, claims_of
from .errors import CertificateError, DesignError
from .observers import FAMILIES, ModeTables, Supervision
from .plant.model import Plant
from .synthesis import METHODS
from .synthesis.mode_set import HORIZON, OLDEST
from .synthesis.mode_tables import tables_of


def certified(plant: Plant, options: dict, real: str, ages: int | None, widths=None) -> tuple[ModeTables, dict]:
    """Tables of one number type and their certificate; ``ages`` None: the least oldest age that will do.

    Raises
    ------
    CertificateError
    """
    most = min(OLDEST, max(mode_certificate.dwell_samples(plant) - 1, 1))
    t = tables_of(ModeTables, plant, most if ages is None else ages, real)
    return mode_certificate.prove(plant, t, int(options.get("horizon", HORIZON)), most if ages is None else None,
                                  widths, options.get("restart") == "certified")


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
        The plant is not of this kind.
    CertificateError
        Modes cannot be told apart within the dwell time, or ages do not fit.
    """
    reason = METHODS[name].module.inapplicable(plant)
    if reason is not None:
        raise DesignError(f'{plant.name}: method "{name}" does not apply: {reason}')
    wanted = plant.target.real
    progress(f"{name}: delays of every pair of modes ({wanted})")
    try:
        t, cert = certified(plant, options, wanted, int(options["ages"]) if "ages" in options else None)
    except CertificateError as error:
        raise CertificateError(f"{plant.name}: {error}") from None
    tables, certs = {wanted: t}, {wanted: cert}
    other = "float64" if wanted == "float32" else "float32"
    progress(f"{name}: delays of every pair of modes ({other})")
    with suppress(CertificateError):  # the other number type may be too coarse; generate says so when asked for it
        tables[other], certs[other] = certified(plant, options, other, t.ages, cert["widths"])
    tables, certs = ({real: by[real] for real in ("float32", "float64") if real in by} for by in (tables, certs))
    target = plant.target
    supervision = Supervision(debounce=target.debounce, latch=target.latch, recover=target.recover, hold=target.hold)
    choice = [{"method": name, "design": f"hypotheses of {t.ages + 1} ages", "level": None, "relative_width": None,
               "surely_detected": [None] * plant.n_f, "chosen": True}]
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None]} for f in plant.f]  # none is promised to be found
    return Design(plant, name, FAMILIES[METHODS[name].family](tables, supervision), certs,
                  {real: claims_of(plant, tables[real], certs[real]) for real in tables},
                  {real: faults for real in tables}, choice, options)
