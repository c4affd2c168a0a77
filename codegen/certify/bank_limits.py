r"""How far states and averages of a bank can go, whatever is measured: the limits beyond which the C starts anew.

With x_hat = z + T2 y and r = y - C x_hat a member's z+ = sum_j h_j (F_j x_hat + G_j u - K_j r) is

    z+ = sum_j h_j (N_j z + B_j [y; u]) + rounding,    N_j = F_j + K_j C,   B_j = [F_j T2 - K_j (I - C T2), G_j],

and N_j' P1 N_j < c^2 P1 is certified, so that in the norm of P1 a z of size R becomes one of (1 + d)(c R + b) at most:
b is the largest |B_j [y; u]| over all that the input check accepts, and what rounding may add within the limits; d is
what the sum of the weights may be beyond 1. Where that is no more than R, z never leaves, and an average never exceeds
the largest weighted residual there.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, down, eye, inverse, leading_failure, product, rational, up
from .rounding import TINY, UNIT

Array = np.ndarray
#: Room of limits above what is found for them.
ROOM = 1.125


def reach(member, P1: Array, contraction: float, t) -> tuple[Array, Array]:
    """Limits of z and of the averages of one member, of the tables' type; `check` decides.

    Parameters
    ----------
    member : Member
    P1 : object array (n, n)
    contraction : float
        Below 1.
    t : BankTables

    Returns
    -------
    limit : ndarray (n,), most : ndarray (k,)
    """
    spread = np.sqrt([float(x) for x in np.diagonal(inverse(P1))])
    start = float(_norm(P1, abs(rational(member.z0.astype(float)))))
    limit = spread * max(start, float(_pushed(member, P1, t)) / (1 - contraction)) * ROOM
    for _ in range(3):  # what rounding adds depends on the limits
        lost = _norm(P1, _rounding(member, limit, t)[0])
        size = float(_pushed(member, P1, t) + lost) / (1 - contraction)
        limit = (spread * max(start, size) * ROOM).astype(member.real).astype(float)
    return limit.astype(member.real), 2 * np.array([float(x) for x in _rounding(member, limit, t)[1]]).astype(
        member.real)


def check(member, P1: Array, contraction: float, t, limit: Array, most: Array) -> dict[str, fmpq]:
    """Check that no accepted input or measurement takes a member to its limits; return what is left of each condition.

    Parameters
    ----------
    member : Member
    P1 : object array (n, n)
    contraction : float
    t : BankTables
    limit : ndarray (n,), most : ndarray (k,)

    Raises
    ------
    CertificateError
        Naming the condition.
    """
    c = Q(contraction)
    for j, (F, K) in enumerate(zip(member.F, member.K)):
        N = rational(F.astype(float)) + product(rational(K.astype(float)), rational(member.C.astype(float)))
        if leading_failure(c * c * P1 - product(product(N.T, P1), N)) is not None:
            raise CertificateError(f"certificate: the state of vertex {j} does not shrink by {contraction:.6g}.")
    room = min(Q(x) * Q(x) / p for x, p in zip(limit, np.diagonal(inverse(P1))))
    size = Q(down(room) ** 0.5 * (1 - 1e-14))
    lost, heard = _rounding(member, limit.astype(float), t)
    grown = (1 + _excess(member)) * (c * size + _pushed(member, P1, t) + _norm(P1, lost))
    rate = Q(t.rate)
    left = {"step": size - grown, "start": size - _norm(P1, abs(rational(member.z0.astype(float)))),
            "average": min(rate * (Q(a) - e) - 4 * UNIT[t.real] * (2 * Q(a) + e) - 4 * TINY[t.real]
                           for a, e in zip(most, heard))}
    if size * size > room or min(left.values()) < 0:
        name = min(left, key=left.get)
        raise CertificateError(f"certificate: a measurement that is accepted may take a member to its limits ({name}: "
                               f"{float(left[name]):.3g} is left, expected at least 0). Design again.")
    return left


def _excess(member) -> fmpq:
    """What the sum of the computed weights may be beyond 1: each operation adds a few roundings."""
    return 16 * (len(member.weights.operations) + len(member.F)) * UNIT[member.real]


def _sizes(t, member) -> tuple[Array, Array]:
    """Largest magnitudes of what a member reads of y, and of u."""
    y, u = (np.maximum(np.abs(getattr(t, f"{v}_lo")), np.abs(getattr(t, f"{v}_hi"))).astype(float) for v in "yu")
    return rational(y[member.seen]), rational(u)


def _norm(P1: Array, bounds: Array) -> fmpq:
    """Bound of the norm of a vector by those of its entries."""
    square = product(product(bounds[None, :], abs(P1)), bounds[:, None])[0, 0]
    return Q(up(square) ** 0.5 * (1 + 1e-14))


def _pushed(member, P1: Array, t) -> fmpq:
    """b, but for rounding."""
    y, u = _sizes(t, member)
    T2, C = (rational(m.astype(float)) for m in (member.T2, member.C))
    seen, found = eye(len(C)) - product(C, T2), []
    for F, G, K in zip(*(m.astype(float) for m in (member.F, member.G, member.K))):
        by_y = abs(product(rational(F), T2) - product(rational(K), seen))
        found.append(_norm(P1, by_y @ y + (abs(rational(G)) @ u if len(u) else 0)))
    return max(found)


def _rounding(member, limit: Array, t) -> tuple[Array, Array]:
    """What z+ may be off by within the limits, (n,); the largest weighted residual, (k,)."""
    y, u = _sizes(t, member)
    (h, n, m), p, unit = member.G.shape, len(y), UNIT[member.real]
    count = n + m + p + h + 4
    g, tiny = count * unit / (1 - count * unit), 4 * count * TINY[member.real]
    T2, C = (abs(rational(a.astype(float))) for a in (member.T2, member.C))
    x = (rational(limit) + T2 @ y) * (1 + g) + tiny
    off_x = g * x + tiny
    r = (y + C @ x) * (1 + g) + tiny
    off_r, worst, size = g * r + C @ off_x + tiny, [], []
    for F, G, K in zip(*(abs(rational(a.astype(float)).reshape(a.shape)) for a in (member.F, member.G, member.K))):
        worst.append(F @ off_x + K @ off_r)
        size.append(F @ x + K @ r + (G @ u if m else 0))
    off = np.maximum.reduce(worst) + (3 * g + 2 * _excess(member)) * np.maximum.reduce(size) * (1 + g) + tiny
    return off, (abs(rational(member.M.astype(float))) @ r) * (1 + g) + tiny
