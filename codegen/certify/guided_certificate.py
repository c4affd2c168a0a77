"""Certificate of framers that sliding modes guide: both proofs, and what joins them; nothing of the decision.

The framers' certificate is that of an observer that is told its mode, the estimator's ``sliding_claims``. The framers
start from the declared range and are cut to the estimator's bounds, so they must accept what the estimator accepts, and
their margins must be for the whole range; why both together hold the state: ``observers.guided``.
"""

from __future__ import annotations

from . import sliding_claims
from .claims import check as check_framers
from .claims import check_ranges
from .driven_certificate import check_parameters, check_range, check_shared


def check(plant, modes, t, cert: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Parameters
    ----------
    plant : Plant
        Without parameters (``plant.bounded``): what the estimator sees.
    modes : sequence
        Modes that the framers see, with parameters.
    t : GuidedTables
    cert : dict
        That of the estimator, with that of the framers as "told".

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
    """
    check_joint(t)
    check_ranges({"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}, t.told)
    check_framers(modes, t.told, cert["told"])
    decision, test, held, alarm, width, theorem = sliding_claims.check(plant, t, cert)
    return [decision, test, held,
            "the framers of a mode hold the state while that mode is active, from any box that holds it: what rounded "
            "constants, inputs and sums may lose is in their offsets; they start from the declared range and are never "
            "wider than the bounds of the estimator, to which they are cut at every sample"
            + ("" if t.told.change is None else "; they are those of z = Z x, of which those of x are made"),
            f"{alarm}, as far as BIT_TWICE goes; the other bits say that y or the bounds contradict the mode of "
            "out->mode: a fault, or a decision that is not right",
            width.replace("are approached", "are the most that is approached"), theorem]


def check_joint(t) -> None:
    """Check what the framers and the estimator must share.

    Raises
    ------
    CertificateError
        Naming what differs.
    """
    check_shared(t)
    check_parameters(t.told)
    check_range(t, "framers")
