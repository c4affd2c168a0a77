"""From a polytopic descriptor plant to a certified observer: design, round, find the level again, check it exactly.

Offline: what comes out are gains and their proof. A firmware steps at a fixed period. `design_observer` of
``descriptor-discrete`` gives its recursion for a discrete plant; for a continuous plant `sampled_observer` designs in
continuous time, takes Euler steps, and certifies the recursion that comes out again, with the plant by Euler steps:
nothing of the continuous certificate is carried over. Explicit Euler is enough because the design is asked to keep its
eigenvalues where these steps contract.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ..certify.exact import Q
from ..certify.polytope_gain import check, errors_of
from ..errors import CertificateError, DesignError
from ..synthesis import descriptor_direct, descriptor_discrete, descriptor_error, descriptor_uncertain
from ..synthesis.descriptor_analysis import continuous_level, discrete_level, tied_contraction
from ..synthesis.descriptor_gains import DirectGains, StandardGains, direct_gains, euler_gains, standard_gains
from ..synthesis.descriptor_lmi import Bounds, DescriptorDesign
from ..synthesis.descriptor_problem import (
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
           "descriptor-error": descriptor_error, "descriptor-discrete": descriptor_discrete}
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
        if model.ties:
            proof |= tied_contraction(model, np.array(found["P1"]), s, margin) or {"Rc": []}
        elif start["time"] == "discrete":
            proof["contraction"] = shrinking(model, np.array(found["P1"]))
        gamma = sqrt(proof["level2"])
        while Q(gamma) * Q(gamma) < Q(proof["level2"]):
            gamma = float(np.nextafter(gamma, np.inf))
        try:
            return gamma, proof | {"gamma": gamma}, check(problem, gains, proof | {"gamma": gamma})
        except CertificateError as error:
            reason = str(error).removeprefix("certificate: ")
    raise CertificateError(f"certificate: {reason}")


def shrinking(model, P1: Array) -> float:
    """Factor by which every sample shrinks the error in the norm of P1, with room for its exact check.

    Parameters
    ----------
    model : ErrorModel
    P1 : ndarray (n, n)
    """
    n, root = len(P1), np.linalg.cholesky(P1).T
    return max(float(np.linalg.norm(root @ np.linalg.solve(root.T, np.array(A[:n, :n], dtype=float).T).T, 2))
               for A, _ in model.pairs.values()) * (1 + 1e-9)


def design_observer(problem: DescriptorProblem, method: str, bounds: Bounds, real: str = "float32",
                    s: Scaling | None = None, **options) -> CertifiedObserver:
    """Design by one of the methods and certify, in the method's own time.

    Parameters
    ----------
    problem : DescriptorProblem
        In the plant's units.
    method : {"descriptor-direct", "descriptor-uncertain", "descriptor-error", "descriptor-discrete"}
        The first three for a continuous plant, the last for a discrete one.
    bounds : Bounds
        Gain in the units of the scaling, decay and period in the plant's time (decay per sample if that is discrete).
    real : {"float32", "float64"}
    s : Scaling, optional
        Without: the plant's units.
    options
        Of the method: ``algebraic``, ``free``, ``form``, ``mismatch``, ``reject``.

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
    s = plain(problem) if s is None else s
    found = designed(problem, method, bounds, s, options)
    direct, discrete = found.T1 is None, method == "descriptor-discrete"
    gains = direct_gains(problem, found, s, real) if direct else standard_gains(problem, found, s, real)
    start = {"form": "direct" if direct else "standard", "time": "discrete" if discrete else "continuous"}
    start |= {"contraction": 1.0} if discrete else {"decay": bounds.decay, "euler": bounds.period}
    if not direct:
        start["T1"] = s.factor1(found.T1).tolist()
    gamma, proof, claims = certified(problem, gains, start, s)
    return CertifiedObserver(gains, gamma, found.gamma, proof, claims)


def designed(problem: DescriptorProblem, method: str, bounds: Bounds, s: Scaling, options: dict) -> DescriptorDesign:
    """Design in the units of a scaling, with some room for rounding.

    Parameters
    ----------
    problem : DescriptorProblem
    method : str
    bounds : Bounds
    s : Scaling
    options : dict

    Raises
    ------
    DesignError
        The method is unknown or of the other time, or no observer exists within the bounds.
    """
    if method not in DESIGNS:
        raise DesignError(f"method is {method!r}, expected one of {', '.join(DESIGNS)}.")
    needed = "discrete" if method == "descriptor-discrete" else "continuous"
    if problem.kind not in ("", needed):
        raise DesignError(f"{method}: the plant is {problem.kind} (found), expected {needed}. Take "
                          f"{'descriptor-discrete' if problem.kind == 'discrete' else 'another method'}.")
    if method == "descriptor-direct" and bounds.period is not None:
        raise DesignError("descriptor-direct: a period is asked for (found one), whose Euler steps have no proof in "
                          "continuous time. The method of that name certifies them (residua design).")
    asked = replace(bounds, decay=(1 + SPARE) * bounds.decay / s.time,
                    period=None if bounds.period is None else (1 + SPARE) * bounds.period * s.time)
    return DESIGNS[method].design(scaled(problem, s), asked, **options)


def euler_limit(problem: DescriptorProblem, found: DescriptorDesign, s: Scaling) -> float:
    """Longest period at which Euler steps decay while the weights stand at one vertex: min -2 Re s / |s|^2.

    Parameters
    ----------
    problem : DescriptorProblem
    found : DescriptorDesign or DetectionDesign
        In standard form, in the units of the scaling.
    s : Scaling
    """
    p = scaled(problem, s)
    modes = np.linalg.eigvals(found.T1 @ p.A + found.K @ p.C).ravel()
    return float(min(-2 * modes.real / np.abs(modes) ** 2)) / s.time


def sampled_observer(problem: DescriptorProblem, method: str, bounds: Bounds, period: float, real: str = "float32",
                     s: Scaling | None = None, **options) -> tuple[CertifiedObserver, float]:
    """Design for a continuous plant, take Euler steps, certify the recursion with the plant by the same steps.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a continuous plant, in its units.
    method : {"descriptor-uncertain", "descriptor-error"}
    bounds : Bounds
        With a period the gains are chosen so that its Euler steps contract.
    period : float
        Of the firmware.
    real : {"float32", "float64"}
    s : Scaling, optional
    options
        Of the method.

    Returns
    -------
    observer : CertifiedObserver
        Its gains are those of x_hat = z + T2 y, z+ = sum_j h_j (F_j x_hat + G_j u - K_j r).
    limit : float
        `euler_limit` of the design.

    Raises
    ------
    DesignError
        The method has another form, no observer exists within the bounds, or the period is beyond the limit.
    CertificateError
        The exact check refuses every level.
    """
    if method not in ("descriptor-uncertain", "descriptor-error"):
        raise DesignError(f"method is {method!r}, expected descriptor-uncertain or descriptor-error: only their "
                          "observers are ordinary differential equations that Euler steps can follow.")
    s = plain(problem) if s is None else s
    found = designed(problem, method, bounds, s, options)
    limit = euler_limit(problem, found, s)
    if period >= limit:
        raise DesignError(f"{method}: Euler steps of {period:.4g} s diverge (found), expected less than {limit:.4g} s "
                          "for these gains. Sample faster, or ask for gains that suit the period.")
    gains = euler_gains(problem, found, s, period, real)
    start = {"form": "standard", "time": "discrete", "contraction": 1.0, "period": period,
             "T1": s.factor1(found.T1).tolist()}
    gamma, proof, claims = certified(problem, gains, start, s)
    return CertifiedObserver(gains, gamma, found.gamma, proof, claims), limit


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
    units = sizes(*plant.limits("x")), sizes(*plant.limits("y"))
    return problem, scaling_of(problem, *units, plant.kind == "discrete")
