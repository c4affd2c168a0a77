"""Certificate of a point observer that sliding modes guide: both proofs, and what joins them; nothing of the decision.

The observer's certificate is that of one that is told its mode: from a set that holds the error, a step of mode q leads
to one that holds it. The estimator's is ``sliding_claims``. The observer starts from the declared range, so it must be
for the range of the estimator, and accept what that accepts; why both together hold the state:
``observers.guided_point``.
"""

from __future__ import annotations

from ..errors import CertificateError
from . import set_claims, sliding_claims, starts
from .claims import check_ranges
from .driven_certificate import check_accepted, check_range


def check(seen, modes, t, cert: dict, limits: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Parameters
    ----------
    seen : Plant
        Without parameters (``plant.bounded``): what the estimator sees.
    modes : sequence
        Modes that the observer sees, with constant matrices (``plant.enclosed``).
    t : GuidedPointTables
    cert : dict
        That of the estimator, with that of the observer as "told".
    limits : dict
        "x", "x0" -> what the plant declares.

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
    """
    check_joint(t)
    check_ranges(limits, t.told)
    if cert["told"]["set"] != t.set:
        raise CertificateError(f'certificate: of a set "{cert["told"]["set"]}", the tables have a set "{t.set}". '
                               "Design again.")
    set_claims.check(modes, t.told, cert["told"])
    decision, test, held, alarm, width, theorem = sliding_claims.check(seen, t, cert)
    table = [f"its set is {starts.words(t.told.shape)}"] if t.by_table else []
    return [decision, test, held,
            "the observer runs in the mode that is decided for, and its error is in its set for as long as that is the "
            "true one: it starts from the declared range whenever the bounds of the estimator do; what rounded "
            "constants, inputs and sums may lose is in the set; its bounds are never wider than those of the "
            "estimator, to which they are cut at every sample", *table,
            f"{alarm}, as far as BIT_TWICE goes; the other bits say that y or the bounds contradict the mode of "
            "out->mode: a fault, or a decision that is not right",
            width.replace("are approached", "are the most that is approached"), theorem]


def check_joint(t) -> None:
    """Check what the observer and the estimator must share.

    Raises
    ------
    CertificateError
        Naming what differs.
    """
    check_accepted(t, "observer")
    check_range(t, "observer")
