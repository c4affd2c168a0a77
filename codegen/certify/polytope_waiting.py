r"""A polytopic observer without guaranteed thresholds: how long after a start nothing is judged, checked exactly.

Where no set of the error is kept the thresholds come from simulated runs. Of a start from anywhere eb' P1 eb is at most
V0, and shrinks by the square of the certified contraction c at every sample; a row of M r holds at most a g-th of its
root. So after N samples a start has no more than `SHARE` of a threshold H left where

    g^2 V0 c^(2N) <= (SHARE H)^2.

Until then a threshold holds that no measurement within its range can exceed: no alarm says more than nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, inverse, product, rational
from .filter_bounds import Demand, raised
from .polytope_error import standard_errors
from .polytope_thresholds import starts

Array = np.ndarray
#: Share of a threshold that a start may still have when judging begins.
SHARE = fmpq(1, 10)


def beyond_reach(t) -> Array:
    """|M r| of any measurement in its range and any z within its limits, at most; rational (p,).

    Parameters
    ----------
    t : PolytopicTables
    """
    T2, C, M = (rational(getattr(t, k)) for k in ("T2", "C", "M"))
    y = np.array([max(abs(Q(a)), abs(Q(b))) for a, b in zip(t.y_lo, t.y_hi)], dtype=object)
    z = np.array([max(abs(Q(a)), abs(Q(b))) for a, b in zip(t.z_lo, t.z_hi)], dtype=object)
    x_hat = z + abs(T2) @ y
    return abs(M) @ (y + abs(C) @ x_hat) * fmpq(1001, 1000)  # more than what is rounded


def starting(plant, problem, t, proof: dict) -> tuple[list[fmpq], tuple[fmpq, fmpq]]:
    """g^2 of every residual, and V0 at a start from the initial box and at one from anywhere.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    proof : dict
        Of ``polytope_gain``, discrete.
    """
    errors = standard_errors(problem, t, np.array(proof["T1"]), proof.get("period"))
    P1, n = rational(np.array(proof["P1"])), len(problem.E)
    seen, back = product(rational(t.M), errors.residual[:, :n]), inverse(P1)
    gains = [(row[None] @ back @ row[:, None])[0, 0] for row in seen]
    T1E = product(errors.T1[0], rational(problem.E))
    first, whole = (product(product(most[None], abs(P1)), most[:, None])[0, 0] for most in starts(plant, t, T1E))
    return gains, (first, whole)


def samples_needed(gains: list[fmpq], start: fmpq, contraction: float, levels: Array) -> int:
    """Fewest samples after which no start has more than half of the share of any level left.

    Parameters
    ----------
    gains : list of fmpq
    start : fmpq
    contraction : float
    levels : ndarray (p,)

    Raises
    ------
    CertificateError
        The error does not contract.
    """
    if not 0 < contraction < 1:
        raise CertificateError(f"certificate: the error does not contract (factor {contraction:.6g} found, expected "
                               "below 1). Ask for a faster decay.")
    worst = max(float(g * start) / (float(SHARE) / 2 * h) ** 2 for g, h in zip(gains, levels))
    return 0 if worst <= 1 else int(np.ceil(np.log(worst) / (-2 * np.log(contraction))))


def demands(plant, problem, t, proof: dict) -> Iterator[Demand]:
    """What the table of thresholds says of starts: "kept" and "start" in squares, "threshold".

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    proof : dict
        Of ``polytope_gain``.

    Yields
    ------
    Demand

    Raises
    ------
    CertificateError
        The table starts at no row of it.
    """
    gains, (first, whole) = starting(plant, problem, t, proof)
    wait, shrunk = t.last << t.shift, Q(proof["contraction"]) ** 2
    if not 0 <= t.shift < 16 or t.start not in (0, t.last):
        raise CertificateError(f"certificate: the table of {t.last + 1} rows starts at {t.start}.")
    allowed = np.array([float(SHARE) ** 2 * float(h) ** 2 * (1 - 1e-12) for h in t.h[-1]])
    left = raised(np.array([g * whole * shrunk**wait for g in gains], dtype=object))
    yield Demand("kept", f"{wait} samples after a start", left, allowed, lambda at, needed: _seen(at, wait))
    begun = raised(np.array([g * first for g in gains], dtype=object)) if t.start == t.last else 0 * left
    yield Demand("start", "initial box", begun, allowed, lambda at, needed: _seen(at, 0))
    most = raised(beyond_reach(t))
    for k, row in enumerate(t.h[:-1].astype(float)):
        yield Demand("threshold", f"row {k}", most, row, lambda at, needed: (
            f"residual {at[0]} is judged before {wait} samples after a start."))


def _seen(at: tuple, wait: int) -> str:
    return (f"a start may still be seen in residual {at[0]} when it is judged, after {wait} samples (found), expected "
            f"at most {float(SHARE):g} of its threshold.")


def check(plant, problem, t, proof: dict) -> None:
    """Check what the table says of starts; arguments as `demands`.

    Raises
    ------
    CertificateError
        A start may still be seen where judging begins, or is judged before.
    """
    for demand in demands(plant, problem, t, proof):
        demand.require()
