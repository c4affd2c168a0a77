"""From a polytopic descriptor plant to a certified observer: design, round, find the level again, check it exactly.

Offline: what comes out are gains and their proof.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from .certify.exact import Q
from .certify.polytope_gain import check, errors_of
from .errors import CertificateError, DesignError
from .synthesis import descriptor_direct, descriptor_error, descriptor_uncertain
from .synthesis.descriptor_analysis import continuous_level, discrete_level
from .synthesis.descriptor_gains import DirectGains, StandardGains, direct_gains, standard_gains
from .synthesis.descriptor_lmi import Bounds
from .synthesis.descriptor_problem import (
    DescriptorProblem,
    Scaling,
    plain,
    problem_of,
    refusal,
    scaled,
    scaling_of,
    sizes,
)

Array = np.ndarray
DESIGNS = {"descriptor-direct": descriptor_direct, "descriptor-uncertain": descriptor_uncertain,
           "descriptor-error": descriptor_error}
#: Room given to the exact check, in scaled coordinates; the smallest that passes is kept.
MARGINS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
#: Share by which a design is better than it has to be, in decay and Euler period, for the rounding of its gains.
SPARE = 1e-3


@dataclass(frozen=True)
class CertifiedObserver:
    """An observer with its constants rounded, and what is proved of them.

    Parameters
    ----------
    gains : StandardGains or DirectGains
    gamma : float
        Proved energy gain from (u, d) to z.
    designed : float
        What the solver claimed of the gains before they were rounded; of ``descriptor-error`` by its own condition.
    proof : dict
        For ``certify.polytope_gain``.
    claims : list of str
    """

    gains: StandardGains | DirectGains
    gamma: float
    designed: float
    proof: dict
    claims: list[str]


def certified(problem: DescriptorProblem, gains, start: dict, s: Scaling) -> tuple[float, dict, list[str]]:
    """Level of given constants, its proof and its claims, checked in exact arithmetic.

    Parameters
    ----------
    problem : DescriptorProblem
        In the plant's units.
    gains : StandardGains or DirectGains
    start : dict
        "form", "time", "T1", "period", and "decay" or "contraction", "euler".
    s : Scaling

    Returns
    -------
    gamma : float
    proof : dict
    claims : list of str

    Raises
    ------
    CertificateError
        No level is proved.
    """
    model = errors_of(problem, gains, start)
    reason = "the solver finds no level for the rounded gains. Try float64, a slower decay or larger gains."
    for margin in MARGINS:
        if start["time"] == "continuous":
            found = continuous_level(model, s, problem.S, start["form"] == "direct", start["decay"],
                                     start.get("euler"), margin)
        else:
            found = discrete_level(model, s, problem.S, start["contraction"], margin)
        if found is None:
            continue
        proof = start | found | {"level2": max(found["level2"], 0.0) * (1 + 1e-9)}
        gamma = sqrt(proof["level2"])
        while Q(gamma) * Q(gamma) < Q(proof["level2"]):
            gamma = float(np.nextafter(gamma, np.inf))
        try:
            return gamma, proof | {"gamma": gamma}, check(problem, gains, proof | {"gamma": gamma})
        except CertificateError as error:
            reason = str(error).removeprefix("certificate: ")
    raise CertificateError(f"certificate: {reason}")


def design_observer(problem: DescriptorProblem, method: str, bounds: Bounds, real: str = "float32",
                    s: Scaling | None = None, **options) -> CertifiedObserver:
    """Design by one of the three approaches and certify.

    Parameters
    ----------
    problem : DescriptorProblem
        In the plant's units.
    method : {"descriptor-direct", "descriptor-uncertain", "descriptor-error"}
    bounds : Bounds
        Gain in the units of the scaling, decay and period in the plant's time.
    real : {"float32", "float64"}
    s : Scaling, optional
        Without: the plant's units.
    options
        Of the method: ``algebraic``, ``free``, ``form``.

    Returns
    -------
    CertifiedObserver

    Raises
    ------
    DesignError
        The method is unknown, or no observer exists within the bounds.
    CertificateError
        The exact check refuses every level.
    """
    if method not in DESIGNS:
        raise DesignError(f"method is {method!r}, expected one of {', '.join(DESIGNS)}.")
    s = plain(problem) if s is None else s
    asked = replace(bounds, decay=(1 + SPARE) * bounds.decay / s.time,
                    period=None if bounds.period is None else (1 + SPARE) * bounds.period * s.time)
    found = DESIGNS[method].design(scaled(problem, s), asked, **options)
    direct = found.T1 is None
    gains = direct_gains(problem, found, s, real) if direct else standard_gains(problem, found, s, real)
    start = {"form": "direct" if direct else "standard", "time": "continuous", "decay": bounds.decay,
             "euler": bounds.period}
    if not direct:
        start["T1"] = s.factor1(found.T1).tolist()
    gamma, proof, claims = certified(problem, gains, start, s)
    return CertifiedObserver(gains, gamma, found.gamma, proof, claims)


def problem_and_scaling(plant, channel: str = "state") -> tuple[DescriptorProblem, Scaling]:
    """The problem of a plant and the units in which a solver should meet it.

    Parameters
    ----------
    plant : Plant
    channel : {"state", "residual"}

    Returns
    -------
    problem : DescriptorProblem
    s : Scaling

    Raises
    ------
    DesignError
        The plant is none for these designs.
    """
    reason = refusal(plant)
    if reason is not None:
        raise DesignError(f"{plant.name}: the descriptor observers do not apply: {reason}.")
    problem = problem_of(plant, channel)
    return problem, scaling_of(problem, sizes(*plant.limits("x")), sizes(*plant.limits("y")))
