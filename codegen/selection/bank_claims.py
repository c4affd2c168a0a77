"""What is proved of a bank, and what is only calibrated: its certificate, checked again in exact arithmetic."""

from __future__ import annotations

from decimal import ROUND_CEILING, Decimal

import numpy as np

from ..analysis.calibration import Population
from ..certify import bank as settling
from ..certify import bank_limits
from ..certify.exact import Q, rational
from ..certify.polytope_detection import check as check_detector
from ..errors import CertificateError
from ..observers.bank_tables import BankTables
from ..plant.model import Plant
from ..synthesis.bank import member
from ..synthesis.descriptor_gains import StandardGains
from ..synthesis.descriptor_problem import pairs_of
from .descriptors import problem_and_scaling
from .detectors import faults_of


def check(plant: Plant, t: BankTables, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Parameters
    ----------
    plant : Plant
    t : BankTables
    cert : dict

    Raises
    ------
    CertificateError
        Naming the member.
    """
    rooms(plant, t, cert)
    return [*(member_words(plant, t, cert, k) for k in range(plant.n_f)), *words(plant, t, cert)]


def rooms(plant: Plant, t: BankTables, cert: dict) -> list[dict]:
    """Check every condition; of each member what is left of its settling time and of its limits.

    Parameters
    ----------
    plant : Plant
    t : BankTables
    cert : dict

    Raises
    ------
    CertificateError
        Naming the member.
    """
    problem, s = problem_and_scaling(plant)
    faults, left = faults_of(plant), []
    if len(t.members) != plant.n_f or len(cert["members"]) != plant.n_f:
        raise CertificateError(f"certificate: {len(t.members)} members (found), expected {plant.n_f}, one per fault.")
    if not np.all(np.isfinite(t.bound)) or cert["calibration"]["runs"] < 1:
        raise CertificateError("certificate: the thresholds rest on no campaign.")
    told = Population(gap=t.gap, bridge=t.bridge).words(plant)[-1]
    if (of := cert["calibration"]["conditions"][-1]) != told:
        raise CertificateError(f'certificate: the thresholds rest on runs with "{of}" (found), expected those with as '
                               f'many lost samples as the tables bridge: "{told}".')
    for k, (own, stored, fault) in enumerate(zip(t.members, cert["members"], plant.f)):
        seen, task, others, _ = member(plant, problem, faults, s, k)
        if own.seen.tolist() != seen.tolist():
            raise CertificateError(f'certificate: the observer of "{fault.name}" reads outputs {own.seen.tolist()} '
                                   f"(found), expected {seen.tolist()}: those that this fault leaves alone.")
        gains = StandardGains(*(getattr(own, key).astype(float) for key in ("T2", "F", "G", "K", "C")))
        proof, M = stored["proof"], own.M.astype(float)
        if proof.get("period") != euler_period(plant) or Q(proof["level"]["gamma"]) > Q(stored["gamma"]) or Q(
                proof["fault"]["beta"]) < Q(stored["beta"]):
            raise CertificateError(f'certificate: period or levels of the observer of "{fault.name}" are not those '
                                   "that are proved.")
        try:
            check_detector(task, others, gains, M, proof)
            if stored["start"]["member"] != k:
                raise CertificateError("certificate: the start is another member's.")
            left.append(settling.check(task, gains, M, proof, stored["start"], t) | check_limits(t, proof, k))
        except CertificateError as error:
            raise CertificateError(f'{error} (observer without the sensors of "{fault.name}")') from None
    return left


def euler_period(plant: Plant) -> float | None:
    """Period of the Euler steps in which a plant is judged; None where it is discrete itself.

    Parameters
    ----------
    plant : Plant
    """
    return plant.sample_period if plant.kind == "continuous" else None


def check_limits(t: BankTables, proof: dict, k: int) -> dict:
    """Check the limits of one member; see ``certify.bank_limits.check``.

    Parameters
    ----------
    t : BankTables
    proof : dict
        Of its detector.
    k : int
    """
    own, n = t.members[k], len(t.x_lo)
    begin = sum(len(m.M) for m in t.members[:k])
    return bank_limits.check(own, rational(np.array(proof["level"]["P1"])), proof["level"]["contraction"], t,
                             t.limit[k * n:(k + 1) * n], t.most[begin:begin + len(own.M)])


def member_words(plant: Plant, t: BankTables, cert: dict, k: int) -> str:
    """What is proved of one member.

    Parameters
    ----------
    plant : Plant
    t : BankTables
    cert : dict
    k : int
    """
    own = cert["members"][k]
    read = ", ".join(plant.y[i].name for i in t.members[k].seen)
    name, shrinks, h = plant.f[k].name, own["proof"]["level"]["contraction"], euler_period(plant)
    tied = len(pairs_of(plant)) < len(plant.polytope.vertices) ** 2
    about = ["what inputs and exact parameters alone weigh is weighed alike in plant and observer"] * tied
    about += [f"the plant by Euler steps of {h:g} s"] if h is not None else []
    return (f"observer without the sensors of {name}: reads {read} alone, so that {name} cannot move it; the energy of "
            f"its weighted residual stays below {own['gamma']:.5g}^2 times that of inputs and disturbances in units of "
            f"their bounds (from rest, no fault); constant other faults f, in units of their ranges, settle to a "
            f"residual of at least {own['beta']:.5g} |f| while the weights stand still; "
            + "; ".join([f"its error shrinks by {shrinks:.6g} per sample", *about]))


def words(plant: Plant, t: BankTables, cert: dict) -> list[str]:
    """What is said of the bank: proved of its logic, and calibrated.

    Parameters
    ----------
    plant : Plant
    t : BankTables
    cert : dict
    """
    c = cert["calibration"]
    sizes = ", ".join(f"{plant.f[k].name} {_no_less(size):f} {plant.f[k].unit}".rstrip()
                      for k, size in enumerate(settling.isolable(plant, t, cert)))
    return ["while no fault but one acts, and its own observer raises no alarm, no other fault is named",
            f"{t.settle} samples after a start, from anywhere in the range of x, what is left of it in any averaged "
            f"residual is at most {float(settling.SHARE):g} of the threshold",
            "no input and no measurement that is accepted takes a state or an average to the limits beyond which all "
            f"observers start anew; all rounding is included ({t.real}, with or without fused multiply-add)",
            f"constant faults of at least this size are named once settled, while the weights stand still and "
            f"disturbances add no more than a threshold: {sizes}",
            f"CALIBRATED, not proved: thresholds above the largest level of {c['runs']} fault-free runs, seed "
            f"{c['seed']} ({'; '.join(c['conditions'])}): a further run of this kind raises an alarm with probability "
            f"{c['probability']:g} at most, confidence {c['confidence']:.4g}"]


def _no_less(size: float) -> Decimal:
    """Three digits, rounded up."""
    exact = Decimal(size)
    return exact.quantize(Decimal(1).scaleb(exact.adjusted() - 2), rounding=ROUND_CEILING).normalize()
