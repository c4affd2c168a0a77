"""Certificate of a point observer that follows a mode estimator: both proofs, and what joins them.

The observer's certificate is that of one that is told its mode: from a set that holds the error, a step of mode q leads
to one that holds it. The estimator's is ``mode_certificate``. Beside them the observer must accept what the estimator
accepts, bounds of S x hold with all rounding, and a set begins with no less than the box of the bounds; why all
together hold the state: ``observers.follower``.
"""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError
from . import mode_certificate, set_claims, starts
from .claims import check_ranges
from .driven_certificate import check_joint
from .exact import Q
from .rounding import TINY, UNIT


def check(plant, t, cert: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Parameters
    ----------
    plant : Plant
    t : FollowerTables
    cert : dict
        That of the estimator, with that of the observer as "told".

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
    """
    check_joint(t)
    check_start(t)
    check_ranges({"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}, t.told)
    if cert["told"]["set"] != t.set:
        raise CertificateError(f'certificate: of a set "{cert["told"]["set"]}", the tables have a set "{t.set}". '
                               "Design again.")
    set_claims.check(plant.enclosed.modes, t.told, cert["told"])
    first, *others = mode_certificate.check(plant, t, cert)
    table = [f"its set is {starts.words(t.told.shape)}"] if t.by_table else []
    return [first,
            "the observer runs in the mode that is decided for, and its error is in its set for as long as that is the "
            "true one: it starts from the bounds over all hypotheses of that mode, and starts again where one of them "
            "began within the last period; what rounded constants, inputs and sums may lose is in the set",
            "a mode whose observer has its residual outside the set is ruled out, but for having begun within the last "
            "period; no switching makes the bounds grow without end: they are cut to the boxes of the mode estimator "
            "at every sample",
            *table, *others]


def check_start(t) -> None:
    """Check that a set that starts from computed half widths holds the box of these bounds, whatever they are.

    The half widths are of the centre as it was rounded. They lose one rounding in the difference, one in the product
    with ``grow``, one in the sum with ``floor``; numbers below the normal ones may be read or written as zero.

    Raises
    ------
    CertificateError
        Naming the constant.
    """
    for name, room in start_rooms(t).items():
        if room < 0:
            raise CertificateError(f"certificate: {name} is {float(getattr(t, name)):.9g}, less than what the rounding "
                                   "of a start asks for. Design again.")
    if np.any(t.x_lo < t.told.x_lo) or np.any(t.x_hi > t.told.x_hi):
        raise CertificateError("certificate: the ranges of x are wider than those of the observer's sets.")


def start_rooms(t) -> dict:
    """What the constants of a start have beyond the rounding that they are for: name -> exact number.

    Parameters
    ----------
    t : FollowerTables

    Returns
    -------
    dict
    """
    unit, tiny, n = Q(UNIT[t.real]), Q(TINY[t.real]), len(t.S)
    keep = 1 - unit
    return {"grow": Q(t.grow) * keep * keep * keep - 1, "square": Q(t.square) * keep * keep * keep - n,
            "floor": min((Q(t.floor) - tiny) * keep - 3 * tiny, Q(t.floor) - tiny * (Q(t.square) + 1))}
