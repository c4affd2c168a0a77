"""Certificate of framers that are driven by a mode estimator: both proofs, and what joins them.

The framers' certificate is that of an observer that is told its mode: a step of mode q carries every state of a box.
The estimator's is ``mode_certificate``. Beside them the framers must accept what
the estimator accepts, and bounds of S x hold with all rounding; why all together hold the state: ``observers.driven``.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from . import mode_certificate
from .claims import check as check_framers
from .claims import check_ranges
from .exact import Q

Array = np.ndarray


def check(plant, modes, t, cert: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Parameters
    ----------
    plant : Plant
        Without parameters (``plant.bounded``): what the estimator sees.
    modes : sequence
        Modes that the framers see, with parameters.
    t : DrivenTables
    cert : dict
        That of the estimator, with that of the framers as "told".

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
    """
    told = t.told
    check_joint(t)
    check_ranges({"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}, told)
    check_framers(modes, told, cert["told"])
    first, *others = mode_certificate.check(plant, t, cert)
    turned = ("" if told.change is None else "; they are those of z = Z x, of which those of x are made, and begin "
              "with what Z makes of x where a switch within a period is possible")
    return [first,
            "framers are kept for every mode that is possible, with nonnegative step matrices or opposite bounds where "
            "they are negative; the framers of a mode hold the state for as long as it is the true one: what rounded "
            "constants, inputs and sums may lose is in their offsets, and a switch within a period is in the boxes "
            f"from which they start{turned}" if plant.kind == "continuous" else
            "framers are kept for every mode that is possible; the framers of a mode hold the state for as long as it "
            f"is the true one: what rounded constants, inputs and sums may lose is in their offsets{turned}",
            "no switching makes the bounds grow without end: they are cut to the boxes of the mode estimator at every "
            "sample",
            *others]


def check_joint(t) -> None:
    """Check what the framers and the estimator must share.

    Raises
    ------
    CertificateError
        Naming what differs.
    """
    check_shared(t)
    check_coordinates(t)
    check_parameters(t.told)


def check_parameters(told) -> None:
    """Check that bounds of parameters are the same in all modes: the C does not know which of them is active.

    Raises
    ------
    CertificateError
    """
    if told.vary is not None and any(np.any(b != b[:1]) for b in (told.vary.theta_lo, told.vary.theta_hi)):
        raise CertificateError("certificate: bounds of parameters differ between modes, expected one for all.")


def check_shared(t) -> None:
    """Check that the framers are of a kind that can be driven, and accept what the estimator accepts.

    Raises
    ------
    CertificateError
        Naming what differs.
    """
    told = t.told
    if told.vary is not None and told.vary.late:
        raise CertificateError("certificate: framers for modes told late, expected others.")
    if told.change is not None and any(np.any(N) for N in (told.N_lo, told.N_hi)):
        raise CertificateError("certificate: framers in other coordinates read the measurement of the next sample, "
                               "expected N = 0.")
    check_accepted(t, "framers")
    if np.any(t.x_lo < told.x_lo) or np.any(t.x_hi > told.x_hi) or np.any(np.abs([t.x_lo, t.x_hi]) > told.box):
        raise CertificateError("certificate: the ranges of x are wider than those of the framers.")


def check_accepted(t, inner: str) -> None:
    """Check that what is driven accepts the inputs and measurements that the estimator accepts; ``inner``: its name.

    Raises
    ------
    CertificateError
        Naming what is beyond.
    """
    for name, sign in (("u_lo", 1), ("u_hi", -1), ("y_lo", 1), ("y_hi", -1)):
        if np.any(sign * getattr(t, name) < sign * getattr(t.told, name)):
            raise CertificateError(f"certificate: {name} is beyond the range of the {inner}.")


def check_range(t, inner: str) -> None:
    """Check that what is driven has the estimator's range of x, from which it starts; ``inner``: its name.

    Raises
    ------
    CertificateError
        It has another.
    """
    if np.any(t.x_lo != t.told.x_lo) or np.any(t.x_hi != t.told.x_hi):
        raise CertificateError(f"certificate: the ranges of x are not those of the {inner}.")


def rooms(t) -> list[tuple]:
    """Room for S x of the framers' bounds in each row, and what rounding needs of it: (float, fmpq)."""
    unit, n = Q(np.finfo(t.real).eps) / 2, len(t.S)
    gamma = (n + 2) * unit / (1 - (n + 2) * unit)
    tiny = 4 * (n + 2) * Q(np.finfo(t.real).smallest_subnormal)
    out = []
    for row, rounded, room in zip(t.S, t.S_rounded, t.xi_room):
        need = tiny + gamma * Q(room)
        for a, b, x in zip(row, rounded, t.told.box):
            need += (abs(Q(a) - Q(b)) + gamma * abs(Q(b))) * Q(x)
        out.append((room, need))
    return out


def check_coordinates(t) -> None:
    """Check that the bounds of S x, computed from those of x, hold it with all rounding.

    Raises
    ------
    CertificateError
        Naming the row.
    """
    for i, (room, need) in enumerate(rooms(t)):
        if not need <= Q(room):
            raise CertificateError(f"certificate: xi_room[{i}] is {float(room):.9g}, at least "
                                   f"{float(fmpq(need)):.9g} expected. Design again.")
