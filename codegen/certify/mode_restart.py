"""How soon ``mode-set`` is right again after an alarm or a reset, when every mode starts anew in its widest box.

Nothing is known then but the declared range of x: wrong modes live longer than after power-up, and so do children born
of such wide boxes. What is certified is that none of them comes of age, after which sample the decision is right, and
from which sample on everything that is certified of switches holds again. The mode stays meanwhile, and no fault acts.
"""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError
from .mode_delay import Story
from .mode_widths import AgesError, contracted

Array = np.ndarray
#: Periods within which a box has to be narrow again.
LONGEST = 10000


def restarted(claims, widths: Array) -> tuple[int, int]:
    """Samples after a restart until the decision is right, and until switches are identified in time again.

    Parameters
    ----------
    claims : Claims
    widths : ndarray (n_x,)
        Of the box of the true mode at a switch, certified.

    Returns
    -------
    right, calm : int

    Raises
    ------
    AgesError
        A wrong child may come of age.
    CertificateError
        A wrong mode lives on beyond the horizon.
    """
    t, course, calm = claims.t, claims.course(widths, "restart"), 0
    widest = np.zeros(len(widths))
    for true in claims.modes:
        hull, at = _hull(claims, course, true)
        if t.ages < at:
            raise AgesError(f"certificate: after an alarm a wrong mode may live {at} samples, the oldest age is "
                            f"{t.ages}. Use at least {at} ages.", at)
        for box, samples in ((t.wide_hi - t.wide_lo, 0), (hull, t.ages - at)):
            widest = np.maximum(widest, contracted(t, box, true, samples))
        calm = max(calm, at + _narrow(t, hull, true, widths))
    young = max(claims.survivals(claims.course(widest, "calm"), switched=False)[1].values())
    right = claims.first("wide", course)
    if right is None:
        raise CertificateError(f"certificate: after an alarm some modes are not told apart within {claims.horizon} "
                               'samples. Raise observer.horizon, or leave observer.restart "open".')
    least = max(young, claims.oldest) + 1
    if t.ages < least:
        raise AgesError(f"certificate: after an alarm a wrong child may reach age {least - 1}, the oldest age is "
                        f"{t.ages}. Use at least {least} ages.", least)
    return right, max(right, calm + young + 1)


def _hull(claims, course, true: int) -> tuple[Array, int]:
    """Widths of the hull of the true mode's box and of children of that mode, and at which sample."""
    alive = {m: claims._begin(course, true, m, "wide") for m in claims.modes if m != true}
    claims._finite({(true, m): k for m, k in alive.items()}, "a wrong mode after an alarm")
    stories = [Story(true, true, true, None, true, "wide")]
    stories += [Story(true, true, true, born, m, "wide") for m, k in alive.items() for born in range(k + 1)]
    at = max(alive.values()) + 1
    return claims.together(course, stories, 0, at), at


def _narrow(t, box: Array, q: int, widths: Array) -> int:
    """Periods after which a box of a mode that stays is within widths for good.

    Raises
    ------
    CertificateError
        Not within ``LONGEST``.
    """
    low, high = -1, 1
    while not np.all(contracted(t, box, q, high) <= widths):
        if high >= LONGEST:
            raise CertificateError(f"certificate: after an alarm the box of mode {q} is not narrow again within {high} "
                                   'samples. Measure another state, or leave observer.restart "open".')
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if np.all(contracted(t, box, q, middle) <= widths) else (middle, high)
    return high
