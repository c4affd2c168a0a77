"""From a polytopic descriptor plant with faults to a certified detection observer (H- and H-infinity). Offline."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ..algebra.interval import sizes
from ..certify import finite_frequency
from ..certify.exact import Q
from ..certify.polytope_detection import check, fault_model, level_model
from ..errors import CertificateError, DesignError
from ..synthesis import hminus_hinf, hminus_hinf_discrete
from ..synthesis.descriptor_analysis import continuous_level, discrete_level, sensitivity_level
from ..synthesis.descriptor_gains import StandardGains, euler_gains, rounded, standard_gains
from ..synthesis.descriptor_lmi import Bounds
from ..synthesis.descriptor_problem import DescriptorProblem, Scaling, plain, scaled
from ..synthesis.finite_frequency import band_level
from ..synthesis.hminus_hinf import Faults
from .descriptors import MARGINS, SPARE, shrinking

Array = np.ndarray
#: Share of the decay that steps are asked to keep, in the norm in which the level is proved.
KEPT = 0.75


@dataclass(frozen=True)
class CertifiedDetector:
    """A detection observer with its constants rounded, and what is proved of them.

    Parameters
    ----------
    gains : StandardGains
    M : ndarray (p, p)
        Weight of the residual.
    gamma, beta : float
        |M r| is at most gamma |(u, d)|, and at least beta |f| in the sense of the criterion.
    designed : float
        Ratio that the solver claimed.
    proof : dict
        For ``certify.polytope_detection``.
    claims : list of str
    """

    gains: StandardGains
    M: Array
    gamma: float
    beta: float
    designed: float
    proof: dict
    claims: list[str]

    @property
    def ratio(self) -> float:
        """Ratio gamma over beta: disturbances of this energy may look like a fault of energy 1."""
        return self.gamma / self.beta


def faults_of(plant) -> Faults:
    """Where the faults of a polytopic plant act, in units of their ranges.

    Parameters
    ----------
    plant : Plant

    Raises
    ------
    DesignError
        It has none.
    """
    if not plant.f:
        raise DesignError(f"{plant.name}: hminus-hinf detects faults (signals.f is empty). Declare one.")
    size = sizes(*plant.limits("f"))
    return Faults(np.array([v.Bf * size for v in plant.polytope.vertices]), plant.polytope.Df * size)


def design_detector(problem: DescriptorProblem, faults: Faults, bounds: Bounds, criterion: str = "all",
                    real: str = "float32", s: Scaling | None = None, free: bool = True) -> CertifiedDetector:
    """Design and certify.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a continuous plant, in its units.
    faults : Faults
    bounds : Bounds
        Gain in the units of the scaling, decay in the plant's time.
    criterion : {"all", "slow"}
    real : {"float32", "float64"}
    s : Scaling, optional
    free : bool
        See ``synthesis.hminus_hinf``.

    Returns
    -------
    CertifiedDetector

    Raises
    ------
    DesignError
        No observer exists within the bounds.
    CertificateError
        The exact check refuses every level.
    """
    s = plain(problem) if s is None else s
    found = _found(problem, faults, bounds, criterion, s, free)
    T1, T2 = np.array([s.factor1(T) for T in found.T1]), s.factor2(found.T2)
    gains = StandardGains(*(rounded(M, real) for M in (
        T2, T1 @ problem.A, T1 @ problem.B, np.array([s.gain(k) for k in found.K]), problem.C)))
    M = rounded(found.M / s.outputs, real)
    T1 = T1 if free else T1[:1].reshape(T1.shape[1:])
    return _certified(problem, faults, gains, M, T1, (criterion, bounds.decay, found.gamma, None), s)


def sampled_detector(problem: DescriptorProblem, faults: Faults, bounds: Bounds, period: float,
                     real: str = "float32", s: Scaling | None = None, free: bool = True) -> CertifiedDetector:
    """Design a recursion for slow faults and certify it: of a continuous plant Euler steps, with the plant by the same.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant.
    faults : Faults
        Of sensors where the plant is discrete.
    bounds : Bounds
        Gain in the units of the scaling, decay in the plant's time; its period is not read.
    period : float
        Of the firmware; not read where the plant is discrete.
    real : {"float32", "float64"}
    s : Scaling, optional
    free : bool
        See ``synthesis.hminus_hinf``.

    Returns
    -------
    CertifiedDetector
        Its gains are those of x_hat = z + T2 y, z+ = sum_j h_j (F_j x_hat + G_j u - K_j r).

    Raises
    ------
    DesignError
        No observer exists within the bounds whose steps contract.
    CertificateError
        The exact check refuses every level.
    """
    s = plain(problem) if s is None else s
    if problem.kind == "discrete":
        found = hminus_hinf_discrete.design(scaled(problem, s), _scaled(faults, s),
                                            replace(bounds, decay=(1 + SPARE) * bounds.decay), free)
        gains, M = standard_gains(problem, found, s, real), rounded(found.M / s.outputs, real)
        T1 = s.factor1(found.T1)
        about = "slow", bounds.decay, found.gamma, None
        return _certified(problem, faults, gains, M, T1 if free else T1[0], about, s)
    found = _found(problem, faults, replace(bounds, period=period), "slow", s, free)
    gains = euler_gains(problem, found, s, period, real)
    M, T1 = rounded(found.M / s.outputs, real), np.array([s.factor1(T) for T in found.T1])
    T1 = T1 if free else T1[:1].reshape(T1.shape[1:])
    return _certified(problem, faults, gains, M, T1, ("slow", bounds.decay, found.gamma, period), s)


def _found(problem, faults, bounds, criterion, s, free) -> hminus_hinf.DetectionDesign:
    """A design in the units of a scaling, with some room for rounding."""
    if problem.kind == "discrete":
        raise DesignError("hminus-hinf: the plant is discrete (found), expected continuous.")
    period = None if bounds.period is None else (1 + SPARE) * bounds.period * s.time
    asked = replace(bounds, decay=(1 + SPARE) * bounds.decay / s.time, period=period)
    return hminus_hinf.design(scaled(problem, s), _scaled(faults, s), asked, criterion, free)


def _scaled(faults: Faults, s: Scaling) -> Faults:
    """Where the faults act, in the units of a scaling."""
    return Faults(s.rows[:, None] * faults.Bf, faults.Df / s.outputs[:, None])


def _certified(problem, faults, gains, M, T1, about, s) -> CertifiedDetector:
    """Levels of the rounded constants, checked exactly; the smallest margin that passes is kept."""
    criterion, decay, designed, period = about
    steps = period is not None or problem.kind == "discrete"
    kept = np.exp(-KEPT * decay) if period is None else 1 - KEPT * decay * period
    models = (level_model(problem, gains, M, T1, period), fault_model(problem, faults, gains, T1, criterion, period))
    reason = "the solver finds no level for the rounded gains. Try float64, a slower decay or larger gains."
    for margin in MARGINS:
        if steps:
            level = discrete_level(models[0], s, problem.S, kept, margin) or discrete_level(
                models[0], s, problem.S, 1.0, margin)
        else:
            level = continuous_level(models[0], s, problem.S, False, decay, None, margin)
        fault = sensitivity_level(models[1], M, s, problem.S, margin)
        if level is None or fault is None or fault["level2"] <= 0:
            continue
        level["level2"] *= 1 + 1e-9
        fault["level2"] *= 1 - 1e-9
        gamma, beta = sqrt(level["level2"]), sqrt(fault["level2"])
        while Q(gamma) * Q(gamma) < Q(level["level2"]):
            gamma = float(np.nextafter(gamma, np.inf))
        while Q(beta) * Q(beta) > Q(fault["level2"]):
            beta = float(np.nextafter(beta, 0.0))
        rate = {"contraction": shrinking(models[0], np.array(level["P1"]))} if steps else {"decay": decay}
        proof = {"T1": T1.tolist(), "criterion": criterion, "level": level | {"gamma": gamma} | rate,
                 "fault": fault | {"beta": beta}} | ({} if period is None else {"period": period})
        try:
            claims = check(problem, faults, gains, M, proof)
        except CertificateError as error:
            reason = str(error).removeprefix("certificate: ")
            continue
        return CertifiedDetector(gains, M, gamma, beta, designed, proof, claims)
    raise CertificateError(f"certificate: {reason}")


def certified_band(problem: DescriptorProblem, faults: Faults, gains: StandardGains, M: Array, about: dict,
                   band: float, s: Scaling) -> dict:
    """Sensitivity of rounded constants to faults below the end of a band, checked exactly.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant.
    faults : Faults
    gains : StandardGains
    M : ndarray (p, p)
    about : dict
        "T1" and, where steps are taken, "period".
    band : float
        rad/s.
    s : Scaling

    Returns
    -------
    proof : dict
        For ``certify.finite_frequency``.

    Raises
    ------
    CertificateError
        No sensitivity is proved.
    """
    period = about.get("period")
    reason = 'no sensitivity is found over this band. Narrow it, or use criterion = "slow".'
    errors = finite_frequency.errors_of(problem, faults, gains, np.array(about["T1"]), period)
    for margin in MARGINS:
        proof = band_level(errors, M, s, band, period, margin)
        if proof is None:
            continue
        proof["T1"] = about["T1"]
        try:
            finite_frequency.check(problem, faults, gains, M, proof)
        except CertificateError as error:
            reason = str(error).removeprefix("certificate: ")
            continue
        return proof
    raise CertificateError(f"certificate: {reason}")
