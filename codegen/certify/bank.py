r"""When a bank may judge: how long the start of its members can still be seen in their levels, checked exactly.

A member starts at z0 and the plant anywhere in its declared range: eb = T1 E x - z is at most E0 in the norm of P1
then, and what is left of it shrinks by the certified contraction c per sample, whatever the weights do and whatever
drives the rest. With |M C eb| <= g |eb| the moving average of it, by `rate`, is after N samples at most

    g E0 rate sum_k (1 - rate)^(N-1-k) c^k   <=   g E0 rate N max(c, 1 - rate)^(N-1),

and with c > 1 - rate at most g E0 rate c^N / (c - 1 + rate). At the settling time this is at most `SHARE` of the
threshold: of what a campaign has seen, starts are no part that matters. From the initial box E0 may be so small that
g E0 is no more than that share at once.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, eye, leading_failure, product, rational, up, zeros
from .polytope_detection import level_model
from .polytope_error import factors

Array = np.ndarray
#: Share of the threshold (not of its square) that a start may still have when judging begins.
SHARE = fmpq(1, 20)


def start_square(problem, gains, P1: Array, z0: Array, x_lo: Array, x_hi: Array) -> fmpq:
    """Bound of eb' P1 eb at the start, exact.

    Parameters
    ----------
    problem : DescriptorProblem
    gains : StandardGains
    P1 : object array (n, n)
    z0 : ndarray (n,)
    x_lo, x_hi : ndarray (n,)
        Declared range.
    """
    E, C, n = rational(problem.E), rational(problem.C), len(problem.E)
    _, T2 = factors(E, C, zeros(n, 0), zeros(n, n), rational(gains.T2))
    seen = eye(n) - product(T2, C)  # T1 E, of every vertex
    lo, hi = rational(np.reshape(x_lo, (-1, 1))), rational(np.reshape(x_hi, (-1, 1)))
    middle = product(seen, (lo + hi) / 2) - rational(np.reshape(z0, (-1, 1)))
    radius = product(abs(seen), (hi - lo) / 2)
    most = abs(middle) + radius
    return product(product(most.T, abs(P1)), most)[0, 0]


def left_square(rate: float, contraction: float, samples: int, gain2: fmpq, start2: fmpq) -> fmpq:
    """Square of what a start can still be in the average, at its sample number ``samples``.

    Parameters
    ----------
    rate, contraction : float
    samples : int
        At least 1.
    gain2, start2 : fmpq
        Squares of g and E0.
    """
    a, c = Q(rate), Q(contraction)
    if c > 1 - a:
        factor = a / (c - 1 + a) * c**samples
    else:
        factor = a * samples * max(c, 1 - a)**(samples - 1)
    return gain2 * start2 * factor * factor


def samples_needed(rate: float, contraction: float, reach: float, bound: float) -> int:
    """Fewest samples for the share, found in floating point; `check` decides.

    Parameters
    ----------
    rate, contraction : float
    reach : float
        g E0.
    bound : float
        Threshold of the level, a square.

    Raises
    ------
    CertificateError
        It does not contract.
    """
    if not 0 <= contraction < 1:
        raise CertificateError(f"certificate: a member's error does not contract (factor {contraction:.6g} found, "
                               "expected below 1).")
    high = 1
    reach2 = Q(reach) * Q(reach)

    def enough(n: int) -> bool:
        return left_square(rate, contraction, n, reach2, Q(1)) <= SHARE * SHARE * Q(bound)

    while not enough(high):
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def output_gain(problem, gains, M: Array, T1: Array, P1: Array, period: float | None) -> Array:
    """M C as it acts on eb, exact (k, n).

    Parameters
    ----------
    problem : DescriptorProblem
    gains : StandardGains
    M : ndarray (k, p)
    T1 : ndarray (h, n, n)
    P1 : object array (n, n)
    period : float or None
        Of Euler steps.
    """
    return level_model(problem, gains, M, T1, period).C[:, :len(P1)]


def check(problem, gains, M: Array, proof: dict, start: dict, t) -> dict[str, fmpq]:
    """Check the settling time of one member, that of the bank is the longest; return the square that is left.

    Parameters
    ----------
    problem : DescriptorProblem
    gains : StandardGains
    M : ndarray (k, p)
    proof : dict
        Of `polytope_detection.check`, where steps are taken: "T1", "level", "period" of Euler's.
    start : dict
        "gain2": square of g, "member": its number.
    t : BankTables

    Raises
    ------
    CertificateError
    """
    P1, T1, p = rational(np.array(proof["level"]["P1"])), np.array(proof["T1"]), start["member"]
    out = output_gain(problem, gains, M, T1, P1, proof.get("period"))
    if leading_failure(Q(start["gain2"]) * P1 - product(out.T, out)) is not None:
        raise CertificateError(f"certificate: the residual of member {p} may be larger than {start['gain2']:.6g} "
                               "claims.")
    own = t.members[p]
    begun = start_square(problem, gains, P1, own.z0.astype(float), t.x_lo.astype(float), t.x_hi.astype(float))
    left = left_square(t.rate, proof["level"]["contraction"], t.settle, Q(start["gain2"]), begun)
    near = start_square(problem, gains, P1, own.z0.astype(float), t.x0_lo.astype(float), t.x0_hi.astype(float))
    if t.begin < t.settle and Q(start["gain2"]) * near > SHARE * SHARE * Q(float(t.bound[p])):
        raise CertificateError(f"certificate: the initial box may still be seen in the average of member {p} when it "
                               f"is judged after {t.begin} samples (found), expected to wait for {t.settle}.")
    if left > SHARE * SHARE * Q(float(t.bound[p])):
        raise CertificateError(f"certificate: after {t.settle} samples the start of member {p} may still be "
                               f"{float(left) ** 0.5:.3g} in its average (found), expected at most "
                               f"{float(SHARE):g} of its threshold {float(t.bound[p]) ** 0.5:.3g}.")
    return {"settled": SHARE * SHARE * Q(float(t.bound[p])) - left}


def isolable(plant, t, cert: dict) -> list[float]:
    """Smallest constant fault of each channel that every other member hears above twice its threshold.

    Parameters
    ----------
    plant : Plant
    t : BankTables
    cert : dict

    Returns
    -------
    sizes : list of float
        In the units of the faults.
    """
    heard = [2 * np.sqrt(float(b)) / m["beta"] * (1 + 1e-14) for b, m in zip(t.bound, cert["members"])]
    return [up(Q(max(h for p, h in enumerate(heard) if p != k) * size)) for k, size in enumerate(units(plant))]


def units(plant) -> Array:
    """The largest size of each fault in its range, or 1 where it has none, (n_f,).

    Parameters
    ----------
    plant : Plant
    """
    size = np.maximum(*np.abs(plant.limits("f")))
    return np.where(np.isfinite(size) & (size > 0), size, 1.0)
