"""What is proved of filters beside a mode estimator: level and thresholds in modes that stay, the set of modes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ..algebra.automaton import Automaton
from ..certify import loose_filter, mode_certificate
from ..certify.filter_bounds import Demand
from ..errors import CertificateError
from ..observers import GuidedFilterTables, TrailingTables
from ..plant.bounded import bounded
from ..plant.model import Plant
from .filter_designs import check_level, problem_for


def staying(plant: Plant) -> tuple[Plant, Automaton]:
    """The plant as each filter sees it, and modes that stay for ever."""
    told = replace(plant, switching=replace(plant.switching, known=True, average_dwell=None))
    return told, Automaton(tuple(range(plant.n_modes)), tuple((q, q) for q in range(plant.n_modes)))


def demands(plant: Plant, t: TrailingTables | GuidedFilterTables, cert: dict) -> Iterator[Demand]:
    """The conditions of the thresholds (``loose_filter.demands``)."""
    return loose_filter.demands(plant.enclosed.observed.modes, t.told, cert["told"]["sets"])


def check(plant: Plant, t: TrailingTables, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    The filters must accept what the estimator accepts, and start from its range of x; why both together hold the truth:
    ``observers.trailing``.

    Raises
    ------
    CertificateError
        Naming mode, size of the start and fault that fail.
    """
    told, stays = staying(plant)
    for name in ("x_lo", "x_hi", "u_lo", "u_hi", "y_lo", "y_hi"):
        if (getattr(t, name) != getattr(t.told, name)).any():
            raise CertificateError(f"certificate: {name} of the filters is not that of the mode estimator.")
    check_level(problem_for(told, t.told, stays), cert["told"])
    for demand in demands(plant, t, cert):
        demand.require()
    return [*sentences(plant, t, cert), *mode_certificate.check(bounded(plant), t, cert)]


def sentences(plant: Plant, t: TrailingTables, cert: dict) -> list[str]:
    """What is proved of the filters."""
    own, unsure = t.told, ", whatever the parameters do within their bounds" * bool(plant.theta)
    last = "; ".join(f"{m.name}: " + ", ".join(f"{float(h):.4g}" for h in row)
                     for m, row in zip(plant.modes, own.h[:, -1].max(axis=0)))
    return [energy(plant, cert),
            "while no fault acts and out->mode is the true mode, no |f_hat| exceeds its f_bound, whatever the "
            f"switching{unsure}, rounding included ({own.real}, with or without fused multiply-add)",
            "a mode whose filter estimates more than is possible without a fault is ruled out, but for having begun "
            "within the last period: the true mode is not, while no fault acts",
            f"in a mode that lasts f_bound comes down to, by mode, {last}, within {own.last} samples"]


def energy(plant: Plant, cert: dict) -> str:
    """What is proved of the energy gain of filters in modes that stay; ``cert`` has that of the filters as "told"."""
    target, unsure = "W_f f" if "target" in plant.options else "f", (
        ", whatever the parameters do within their bounds" * bool(plant.theta))
    weighted = " (disturbances, noises and inputs before their weight W_d)" if "colour" in plant.options else ""
    left = " (with what constant matrices leave out of a period)" * (plant.kind == "continuous")
    return (f"energy: in a mode that stays, the decision right, from rest sum |f_hat - {target}|^2 <= "
            f"{cert['told']['level']:.6g}^2 sum |d|^2, d all disturbances{left}, noises, inputs and faults{weighted} "
            f"in units of their largest sizes, f in units of its range{unsure} (rounding of sums apart)")
