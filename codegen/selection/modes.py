"""From a plant whose mode nobody tells to a certified mode estimator."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from ..certify import mode_certificate
from ..designs import Design, claims_of
from ..errors import CertificateError
from ..observers import FAMILIES, DrivenTables, FollowerTables, ModeTables, Supervision
from ..plant.bounded import bounded
from ..plant.model import Plant
from ..synthesis import METHODS
from ..synthesis.driven_tables import joined
from ..synthesis.follower_tables import following
from ..synthesis.mode_set import FOUND_WITHIN, HORIZON, OLDEST
from ..synthesis.mode_tables import tables_of


def certified(plant: Plant, options: dict, real: str, ages: int | None, widths=None,
              faults: list[dict] | None = None) -> tuple[ModeTables, dict]:
    """Tables of one number type and their certificate; ``ages`` None: the least oldest age that will do.

    ``faults`` are the promises to look for where they are known of the other number type.

    Raises
    ------
    CertificateError
    """
    plant = bounded(plant)
    most = min(OLDEST, max(mode_certificate.dwell_samples(plant) - 1, 1))
    t = tables_of(ModeTables, plant, most if ages is None else ages, real)
    return mode_certificate.prove(plant, t, int(options.get("horizon", HORIZON)), most if ages is None else None,
                                  widths, options.get("restart") == "certified",
                                  int(options.get("found_within", FOUND_WITHIN)) if faults is None else faults)


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
        The tables of this plant cannot be made.
    CertificateError
        Modes cannot be told apart within the dwell time, or ages do not fit.
    """
    tables, certs = both(plant, options, lambda text: progress(f"{name}: {text}"))
    t = tables[plant.target.real]
    choice = [{"method": name, "design": f"hypotheses of {t.ages + 1} ages", "level": None, "relative_width": None,
               "surely_detected": [None] * plant.n_f, "chosen": True}]
    return assembled(plant, name, METHODS[name].family, tables, certs, choice, options)


def both(plant: Plant, options: dict, progress: Callable[[str], None]) -> tuple[dict, dict]:
    """Tables of the estimator and certificates, by number type, that of the plant file first.

    Raises
    ------
    CertificateError
        As ``designed``.
    """
    wanted = plant.target.real
    progress(f"delays of every pair of modes ({wanted})")
    try:
        t, cert = certified(plant, options, wanted, int(options["ages"]) if "ages" in options else None)
    except CertificateError as error:
        raise CertificateError(f"{plant.name}: {error}") from None
    tables, certs = {wanted: t}, {wanted: cert}
    other = "float64" if wanted == "float32" else "float32"
    progress(f"delays of every pair of modes ({other})")
    with suppress(CertificateError):  # the other number type may be too coarse; generate says so when asked for it
        tables[other], certs[other] = certified(plant, options, other, t.ages, cert["widths"], cert.get("faults", []))
    return tables, certs


def driven(plant: Plant, name: str, told: dict, proofs: dict, choice: list, options: dict,
           progress: Callable[[str], None]) -> Design:
    """Framers that are told their mode, driven by the set of modes that are possible.

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
    tables, certs = both(plant, options, lambda text: progress(f"{name}: {text}"))
    shared = [real for real in tables if real in told]
    return assembled(plant, name, "driven", {r: joined(DrivenTables, tables[r], told[r]) for r in shared},
                     {r: certs[r] | {"told": proofs[r]} for r in shared}, choice, options)


def followed(plant: Plant, name: str, told: dict, proofs: dict, choice: list, options: dict,
             progress: Callable[[str], None]) -> Design:
    """A point observer that is told its mode, in the mode that is decided for; parameters and errors as ``driven``.

    Raises
    ------
    DesignError, CertificateError
        As ``designed``.
    """
    family = next(iter(proofs.values()))["set"]
    tables, certs = both(plant, options, lambda text: progress(f"{name}: {text}"))
    shared = [real for real in tables if real in told]
    return assembled(plant, name, "follower",
                     {r: following(FollowerTables, tables[r], told[r], family) for r in shared},
                     {r: certs[r] | {"told": proofs[r]} for r in shared}, choice, options)


def assembled(plant: Plant, name: str, family: str, tables: dict, certs: dict, choice: list, options: dict,
              assures: bool = True) -> Design:
    """A design of tables and certificates; no fault is promised to be found."""
    supervision = Supervision.of(plant.target, assures=assures)
    tables, certs = ({real: by[real] for real in ("float32", "float64") if real in by} for by in (tables, certs))
    choice = [row | {"surely_detected": [None] * plant.n_f} for row in choice]
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None]} for f in plant.f]
    return Design(plant, name, FAMILIES[family](tables, supervision), certs,
                  {real: claims_of(plant, tables[real], certs[real]) for real in tables},
                  {real: faults for real in tables}, choice, options)
