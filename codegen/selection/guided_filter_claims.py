"""What is proved of a filter that sliding modes guide: level and thresholds in modes that stay, nothing of the mode."""

from __future__ import annotations

from ..certify import sliding_claims
from ..certify.claims import check_ranges
from ..certify.driven_certificate import check_accepted, check_range
from ..observers import GuidedFilterTables
from ..plant.bounded import bounded
from ..plant.model import Plant
from .filter_designs import check_level, problem_for
from .trailing_claims import demands, energy, staying


def check(plant: Plant, t: GuidedFilterTables, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    The filters must accept what the estimator accepts, and start from its range of x; why both together hold the
    estimate while the decision is right: ``observers.guided_filter``.

    Raises
    ------
    CertificateError
        Naming mode, start and fault that fail.
    """
    told, stays = staying(plant)
    check_accepted(t, "filters")
    check_ranges({"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}, t)
    check_range(t, "filters")
    check_level(problem_for(told, t.told, stays), cert["told"])
    for demand in demands(plant, t, cert):
        demand.require()
    return sentences(plant, t, sliding_claims.check(bounded(plant), t, cert), cert)


def sentences(plant: Plant, t: GuidedFilterTables, own: list[str], cert: dict) -> list[str]:
    """What is proved; ``own`` of the estimator."""
    decision, test, held, alarm, width, theorem = own
    unsure = ", whatever the parameters do within their bounds" * bool(plant.theta)
    last = "; ".join(f"{m.name}: " + ", ".join(f"{float(h):.4g}" for h in row)
                     for m, row in zip(plant.modes, t.told.h[:, -1].max(axis=0)))
    return [decision, test, held, energy(plant, cert),
            "while no fault acts and out->mode has been the true mode since it was taken up, no |f_hat| exceeds its "
            f"f_bound{unsure}, rounding included ({t.real}, with or without fused multiply-add)",
            f"in a mode that lasts f_bound comes down to, by mode, {last}, within {t.told.last} samples",
            f"{alarm}, as far as BIT_TWICE goes; the other bits say that an estimate is more than is possible in "
            "out->mode without a fault: a fault, or a decision that is not right", width, theorem]
