"""The methods of polytopic plants from plant to certified tables: design once, freeze and certify per number type.

A firmware steps at a fixed period: what is certified is the recursion that it runs. Of a continuous plant that is
either the Euler steps of an observer designed in continuous time, or what ``descriptor-discrete`` designs for the
plant's Euler steps; its energy level is one for the plant by these steps, its thresholds hold for the plant itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..algebra.interval import sizes
from ..certify import finite_frequency, polytope_thresholds, polytope_waiting
from ..certify.exact import Q
from ..certify.filter_bounds import Demand
from ..certify.polytope_gain import check as check_energy
from ..certify.polytope_gain import discrete_inequalities, errors_of
from ..errors import CertificateError, DesignError
from ..observers import PolytopicTables
from ..plant.model import Plant
from ..synthesis import hminus_hinf
from ..synthesis.descriptor_gains import StandardGains, euler_gains, rounded, standard_gains
from ..synthesis.descriptor_lmi import Bounds
from ..synthesis.descriptor_problem import DescriptorProblem, Scaling, problem_of, scaled, scaling_of
from ..synthesis.fault_problem import fault_problem
from ..synthesis.hminus_hinf import Faults
from . import fault_estimators, polytopic_calibration
from .descriptors import DESIGNS, SPARE, euler_limit, problem_and_scaling
from .descriptors import certified as certified_energy
from .detectors import certified_band, faults_of
from .polytopic_tables import tables_of, without_dust

Array = np.ndarray
#: Where the plant file says nothing: largest gain, in the units of the design; decay as a share of the slowest mode's.
GAIN, SHARE = 10.0, 0.5
#: Decay per sample where the plant itself has none.
LEAST_DECAY = 1e-3
#: End of the band of slow faults, as a share of the decay.
SLOW = 0.01


@dataclass(frozen=True)
class Proposal:
    """A design before its constants are rounded.

    Parameters
    ----------
    method : str
    problem : DescriptorProblem
        In the plant's units.
    s : Scaling
    found : DescriptorDesign or DetectionDesign
    period : float or None
        Of a continuous plant.
    limit : float or None
        Longest period at which Euler steps of it decay.
    """

    method: str
    problem: DescriptorProblem
    s: Scaling
    found: object
    period: float | None
    limit: float | None


def decay_of(problem: DescriptorProblem, period: float | None) -> float:
    """A decay rate that suits a plant, per second, or per sample where it is discrete: half that of its slowest mode.

    Parameters
    ----------
    problem : DescriptorProblem
    period : float or None
    """
    if problem.kind == "discrete":
        slow = problem.slowest_step()
        return max(-np.log(slow) * SHARE, LEAST_DECAY) if slow > 0 else 1.0
    return max(problem.slowest() * SHARE, LEAST_DECAY / period)


def by_steps(problem: DescriptorProblem, period: float) -> DescriptorProblem:
    """The plant by Euler steps, for a design in discrete time.

    Parameters
    ----------
    problem : DescriptorProblem
        Of a continuous plant.
    period : float
    """
    return replace(problem, A=problem.E + period * problem.A, B=period * problem.B, Bd=period * problem.Bd,
                   kind="discrete")


def propose(plant: Plant, method: str, options: dict) -> Proposal:
    """Design by one of the methods.

    Parameters
    ----------
    plant : Plant
    method : str
    options : dict
        Of ``[observer]``.

    Returns
    -------
    Proposal

    Raises
    ------
    DesignError
        No observer exists within the bounds, or Euler steps of it diverge at the plant's period.
    """
    problem, s = problem_and_scaling(plant, options.get("channel", "state"))
    period = plant.sample_period if plant.kind == "continuous" else None
    decay, gain = float(options.get("decay", decay_of(problem, period))), float(options.get("gain", GAIN))
    free = options.get("factors", "free") == "free"
    if method == "descriptor-discrete":
        model = problem if period is None else by_steps(problem, period)
        s = scaling_of(model, sizes(*plant.limits("x")), sizes(*plant.limits("y")), True)
        bounds = Bounds(gain, decay if period is None else decay * period)
        found = DESIGNS[method].design(scaled(model, s), bounds, free=free)
        return Proposal(method, problem, s, found, period, None)
    bounds = Bounds(gain, (1 + SPARE) * decay / s.time, (1 + SPARE) * period * s.time)
    if method == "hminus-hinf":
        faults = faults_of(plant)
        inside = Faults(s.rows[:, None] * faults.Bf, faults.Df / s.outputs[:, None])
        band = float(options["band"]) / s.time if "band" in options else None
        found = hminus_hinf.design(scaled(problem, s), inside, bounds, options.get("criterion", "all"), free, band=band)
    else:
        own = {"form": options.get("form", "centred")} if method == "descriptor-error" else {"free": free}
        found = DESIGNS[method].design(scaled(problem, s), bounds, **own)
    limit = euler_limit(problem, found, s)
    if period >= limit:
        raise DesignError(f"{plant.name}: {method}: Euler steps of {period:.4g} s diverge (found), expected less than "
                          f'{limit:.4g} s for these gains. Sample faster, lower observer.gain, or use method '
                          '"descriptor-discrete".')
    return Proposal(method, problem, s, found, period, limit)


def constants(proposal: Proposal, real: str) -> tuple[StandardGains, Array, Array]:
    """Gains of the recursion and weight of the residual, rounded; T1.

    Parameters
    ----------
    proposal : Proposal
    real : {"float32", "float64"}

    Returns
    -------
    gains : StandardGains
    M : ndarray (n_y, n_y)
    T1 : ndarray (n, n) or (h, n, n)
    """
    problem, s, found, period = proposal.problem, proposal.s, proposal.found, proposal.period
    if proposal.limit is not None:
        gains = euler_gains(problem, found, s, period, real)
    else:
        gains = standard_gains(problem if period is None else by_steps(problem, period), found, s, real)
    gains = without_dust(gains, s, problem.u_unit, real)
    weight = getattr(found, "M", None)
    M = np.eye(len(problem.C)) if weight is None else rounded(weight / s.outputs, real)
    T1 = s.factor1(found.T1)
    return gains, M, T1[0] if T1.ndim == 3 and np.all(T1[0] == T1) else T1


def certified(plant: Plant, proposal: Proposal, options: dict, real: str) -> tuple[PolytopicTables, dict]:
    """Freeze a proposal on one number type and certify level and thresholds.

    Parameters
    ----------
    plant : Plant
    proposal : Proposal
    options : dict
    real : {"float32", "float64"}

    Returns
    -------
    tables : PolytopicTables
    cert : dict

    Raises
    ------
    CertificateError
        No level is proved, or the thresholds are refused.
    DesignError
        No set is kept.
    """
    gains, M, T1 = constants(proposal, real)
    start = {"form": "standard", "time": "discrete", "contraction": 1.0, "T1": T1.tolist()}
    start |= {} if proposal.period is None else {"period": proposal.period}
    start |= {"M": M.tolist()} if proposal.method == "hminus-hinf" else {}
    gamma, proof, _ = certified_energy(proposal.problem, gains, start, proposal.s)
    t, held = polytopic_calibration.with_thresholds(plant, plant, proposal.problem, tables_of(plant, gains, M, real),
                                                    proof, options)
    cert = {"kind": "polytopic", "level": gamma, "claimed": proposal.found.gamma, "energy": proof,
            "limit": proposal.limit, "thresholds": held["thresholds"], "steady_box": None}
    if proposal.method == "hminus-hinf":
        cert |= sensitivity(plant, proposal, options, gains, M, start)
    return t, cert | held


def about(plant: Plant, t: PolytopicTables) -> tuple[Plant, DescriptorProblem]:
    """Plant and problem that a certificate is about: with the faults among the states where they are estimated.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    """
    if t.faults:
        return fault_estimators.with_faults(plant), fault_problem(plant)[0].whole
    return plant, problem_of(plant, plant.options.get("channel", "state") if t.law is None else "state")


def sensitivity(plant: Plant, proposal: Proposal, options: dict, gains: StandardGains, M: Array, about: dict) -> dict:
    """Certify how much of a fault the recursion shows, over the frequencies that the criterion is about.

    Steps know no more than 2 / period: |e+ - e| <= 2 max |e|. What stands still by the criterion "slow" may move by a
    hundredth of the decay.

    Parameters
    ----------
    plant : Plant
    proposal : Proposal
    options : dict
    gains : StandardGains
    M : ndarray (n_y, n_y)
    about : dict
        "T1", "period".

    Returns
    -------
    dict
        "band": proof of ``finite_frequency``; nothing where a criterion other than "band" has none, or a fault moves
        the state.

    Raises
    ------
    CertificateError
        A band was asked for, and none is proved.
    """
    criterion, faults, problem = options.get("criterion", "all"), faults_of(plant), proposal.problem
    if criterion == "band":
        return {"band": certified_band(problem, faults, gains, M, about, float(options["band"]), proposal.s)}
    decay = float(options.get("decay", decay_of(problem, proposal.period)))
    band = SLOW * decay if criterion == "slow" else 2 / proposal.period
    with suppress(CertificateError):
        return {"band": certified_band(problem, faults, gains, M, about, band, proposal.s)}
    return {}


def check(plant: Plant, t: PolytopicTables, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict

    Raises
    ------
    CertificateError
        Naming the pair or row that fails.
    """
    if "share" in cert["thresholds"]:
        return fault_estimators.check(plant, t, cert)
    (own, problem), proof = about(plant, t), cert["energy"]
    expected = plant.sample_period if plant.kind == "continuous" else None
    if proof.get("period") != expected or proof["gamma"] != cert["level"]:
        raise CertificateError(f"certificate: period {proof.get('period')} and level {cert['level']} (found), expected "
                               f"{expected} and {proof['gamma']}. Design again.")
    if not np.array_equal(proof.get("M", t.M), t.M):
        raise CertificateError("certificate: the level is one of another weight of the residual. Design again.")
    driven = "inputs, disturbances and faults, z being the error of the faults in units of their ranges"
    claims = check_energy(problem, t, proof, driven) if t.faults else check_energy(problem, t, proof)
    c = cert.get("calibration")
    if "band" in cert:
        if cert["band"]["period"] != expected:
            raise CertificateError(f"certificate: the band is one by steps of {cert['band']['period']} (found), "
                                   f"expected {expected}. Design again.")
        claims += finite_frequency.check(problem, faults_of(plant), t, t.M, cert["band"])
    if "waits" in cert["thresholds"]:
        if c is None or c["guaranteed"] is not None:
            raise CertificateError("certificate: the thresholds rest on nothing. Design again.")
        polytope_waiting.check(own, problem, t, proof)
    else:
        guaranteed = t if c is None else polytopic_calibration.uncalibrated(t, c)
        if np.any(t.h[-1] > guaranteed.h[-1]):
            raise CertificateError("certificate: a calibrated threshold is above the guaranteed one.")
        T1 = np.array(proof.get("T1", []))
        polytope_thresholds.check(own, problem, guaranteed, cert["thresholds"], T1, expected)
    return sentences(plant, t, cert, claims, None if c is None else polytopic_calibration.check(plant, t, c))


def inequalities(plant: Plant, t: PolytopicTables, cert: dict) -> Iterator[tuple[str, str, Array]]:
    """Yield what must be negative definite: "level" or "contraction", at which vertices, the exact matrix.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    """
    (_, problem), proof = about(plant, t), cert["energy"]
    for kind, i, j, S in discrete_inequalities(errors_of(problem, t, proof), proof, Q(proof["level2"])):
        yield kind, f'observer at "{problem.names[j]}"' + (f', plant at "{problem.names[i]}"' if i is not None else
                                                          ""), S


def demands(plant: Plant, t: PolytopicTables, cert: dict) -> Iterator[Demand]:
    """The conditions of the thresholds, of an observer alone or beside a law.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    """
    own, problem = about(plant, t)
    T1 = np.array((cert if t.law is not None else cert["energy"]).get("T1", []))
    period = plant.sample_period if plant.kind == "continuous" else None
    if "waits" in cert["thresholds"]:
        return polytope_waiting.demands(own, problem, t, cert["energy"])
    guaranteed = polytopic_calibration.uncalibrated(t, cert["calibration"]) if "calibration" in cert else t
    return polytope_thresholds.demands(own, problem, guaranteed, cert["thresholds"], T1, period)


def band_inequalities(plant: Plant, t: PolytopicTables, cert: dict) -> list[tuple[str, Array]]:
    """What must be positive definite for the sensitivity over a band: at which vertex, the exact matrix.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    """
    problem = problem_of(plant, plant.options.get("channel", "state"))
    return [(f'observer at "{problem.names[j]}"', S) for j, S in finite_frequency.inequalities(
        problem, faults_of(plant), t, t.M, cert["band"])]


def sentences(plant: Plant, t: PolytopicTables, cert: dict, energy: list[str],
              instead: list[str] | None = None) -> list[str]:
    """What is proved.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    energy : list of str
        Claims of ``polytope_gain``.
    instead : list of str, optional
        What is said of thresholds that are calibrated.
    """
    last = ", ".join(f"{s.name}: {float(h):.4g}" for s, h in zip(plant.y, t.h[-1]))
    between = ("; between samples the plant moves as it likes within its ranges, which the thresholds hold"
               if plant.kind == "continuous" else "")
    steps = [] if cert["limit"] is None else [
        f"Euler steps of {plant.sample_period:g} s: those of this observer decay below {cert['limit']:.4g} s with "
        "weights that stand still; at this period the recursion itself is certified, for weights that move"]
    if instead is not None:
        slow = fault_estimators.slow_words(plant, cert) if t.faults else []
        return [*energy, *steps, *instead, f"once settled r_bound is {last}", *slow]
    if t.faults:
        weights = polytope_thresholds.weights_words(plant.polytope, cert["thresholds"])
        return [*energy, *fault_estimators.promises(plant, t, cert, f", {weights}")]
    return [*energy, *steps,
            "while no fault acts no |r| exceeds its r_bound at any sample, so there is no false alarm, "
            f"{polytope_thresholds.weights_words(plant.polytope, cert['thresholds'])}, rounding included ({t.real}, "
            "with or without fused multiply-add)" + between,
            f"once settled r_bound is {last}; it comes down to that within {t.last << t.shift} samples from anywhere "
            "in the declared range of x"]
