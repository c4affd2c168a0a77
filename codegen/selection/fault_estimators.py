"""From a polytopic plant with sensor faults to tables that estimate them: design, rounding, thresholds, proof."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..certify import fault_sets
from ..errors import DesignError, PlantError
from ..observers import PolytopicTables
from ..plant.bend import bend as bend_of
from ..plant.model import Plant
from ..synthesis.descriptor_fault_estimation import AT_ESTIMATE, FaultDesign, design, gains_of
from ..synthesis.descriptor_lmi import Bounds
from ..synthesis.descriptor_problem import Scaling
from ..synthesis.fault_problem import FaultProblem, fault_problem, in_units, told, unmoved
from .descriptors import certified as certified_energy
from .fault_tables import frozen
from .polytopic_calibration import with_thresholds
from .polytopic_tables import tables_of, without_dust

Array = np.ndarray
#: Where the plant file says nothing: largest gain, in the units of the design; decay as a share of what no observer
#: moves, and in steps of the period where there is nothing such.
GAIN, SHARE, STEPS = 10.0, 0.5, 100.0


@dataclass(frozen=True)
class FaultProposal:
    """A design before its constants are rounded.

    Parameters
    ----------
    problem : FaultProblem
        In the plant's units.
    s : Scaling
    found : FaultDesign
    period : float or None
        Of a continuous plant.
    """

    problem: FaultProblem
    s: Scaling
    found: FaultDesign
    period: float | None


def with_faults(plant: Plant) -> Plant:
    """The plant with its faults behind the states, zero at the start.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    """
    import sympy
    p, none = plant.polytope, np.zeros(plant.n_f)
    symbols = (*p.symbols[:plant.n_x], *(sympy.Dummy(s.name) for s in plant.f), *p.symbols[plant.n_x:])
    return replace(plant, x=plant.estimated(plant.n_x + plant.n_f), x0_lo=np.concatenate([plant.x0_lo, none]),
                   x0_hi=np.concatenate([plant.x0_hi, none]),
                   polytope=replace(p, symbols=symbols, E=np.pad(p.E, (0, plant.n_f))))


def propose(plant: Plant, method: str, options: dict) -> FaultProposal:
    """Design.

    Parameters
    ----------
    plant : Plant
        One that ``fault_problem.inapplicable`` does not refuse.
    method : str
        There is one.
    options : dict
        Of ``[observer]``: decay, gain.

    Returns
    -------
    FaultProposal

    Raises
    ------
    DesignError
        No observer exists within the bounds, or none with a bound: something is slower than the decay asked for, and
        the weights are not the plant's.
    """
    problem, s = fault_problem(plant)
    unread = [key for key in AT_ESTIMATE if key in options]
    if problem.tied and unread:
        raise DesignError(f"{plant.name}: observer.{unread[0]} is of bounds with weights at the estimate (found), "
                          "expected none: the weights of this plant are known. Remove it.")
    period = plant.sample_period if plant.kind == "continuous" else None
    step = None if period is None else period * s.time
    decay = float(options["decay"]) / s.time if "decay" in options else default_decay(in_units(problem, s), step)
    found = design(in_units(problem, s), Bounds(float(options.get("gain", GAIN)), decay, step))
    if found.slow and not problem.tied:
        name, mode = found.slow[0]
        rate = "/s" if period is not None else " per sample"
        raise DesignError(f"{plant.name}: {name} move together by a mode of {mode * s.time:.4g}{rate} that no observer "
                          "changes (found), slower than the decay asked for, and the weights are not the plant's: what "
                          "they are wrong by adds up along it, so that there is no bound worth the name. Schedule on "
                          "exact outputs, measure more or take a fault out; codegen.synthesis has the observer for use "
                          "without bounds.")
    return FaultProposal(problem, s, found, period)


def default_decay(problem: FaultProblem, step: float | None) -> float:
    """Half the rate of the slowest mode that no observer moves; one in a hundred samples where there is none.

    Parameters
    ----------
    problem : FaultProblem
        In the units of the design.
    step : float or None
        Of a continuous plant.
    """
    held = [mode for _, mode in unmoved(problem)]
    slow = [-np.log(max(abs(m), 1e-3)) for m in held] if step is None else [-m for m in held]
    return SHARE * min(slow) if slow else 1 / STEPS / (1.0 if step is None else step)


def certified(plant: Plant, proposal: FaultProposal, options: dict, real: str) -> tuple[PolytopicTables, dict]:
    """Freeze a proposal on one number type and certify contraction and bounds.

    Parameters
    ----------
    plant : Plant
    proposal : FaultProposal
    options : dict
    real : {"float32", "float64"}

    Returns
    -------
    tables : PolytopicTables
    cert : dict

    Raises
    ------
    CertificateError
        The bounds are refused.
    DesignError
        No set is kept, or what the plant does between samples has no bound.
    """
    problem, s, whole = proposal.problem, proposal.s, with_faults(plant)
    gains = gains_of(problem, proposal.found, s, proposal.period, real)
    n, n_u = problem.n_x, problem.n_u
    T1 = s.factor1(proposal.found.T1)
    # The residual is y - C x_hat of the plant alone: it is what the faults do to y. The gains act on the innovation
    # y - C x_hat - Df f_hat, so that what they take back goes to the columns of f_hat.
    C = gains.C.copy()
    C[:, n:] = 0
    F = gains.F.copy()
    F[:, :, n:] += gains.K @ gains.C[:, n:]
    F = F.astype(real).astype(float)
    own = replace(gains, C=C, F=F, G=gains.G[:, :, :n_u])
    own = own if problem.tied else without_dust(own, s, problem.whole.u_unit, real)
    t = tables_of(whole, own, np.eye(len(C)), real)
    t = replace(t, known=gains.G[0, :, n_u:].astype(real), faults=plant.n_f)
    claimed, slow = proposal.found.gamma, [[name, mode * s.time] for name, mode in proposal.found.slow]
    if problem.tied:
        t, held = frozen(whole, problem.whole, t, T1, proposal.period, bend_of_steps(plant))
        return t, {"kind": "polytopic", "level": float(np.max(t.h[-1])), "claimed": claimed, "T1": T1.tolist(),
                   "slow": slow, "limit": None, "thresholds": held, "steady_box": None}
    start = {"form": "standard", "time": "discrete", "contraction": 1.0, "T1": T1.tolist()}
    start |= {} if proposal.period is None else {"period": proposal.period}
    level, proof, _ = certified_energy(problem.whole, t, start, s)
    t, held = with_thresholds(plant, whole, problem.whole, t, proof, options)
    return t, {"kind": "polytopic", "level": level, "claimed": claimed, "energy": proof, "slow": slow, "limit": None,
               "steady_box": None, **held}


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
        Naming what fails.
    """
    for condition in conditions(plant, t, cert):
        condition.require()
    return promises(plant, t, cert)


def promises(plant: Plant, t: PolytopicTables, cert: dict, weights: str = "") -> list[str]:
    """What is proved of bounds that hold with and without faults.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    weights : str
        What is said of the weights, where they are not those of the plant.
    """
    last = ", ".join(f"{s.name}: {float(h):.4g}" for s, h in zip(plant.y, t.h[-1]))
    between = ", and what the plant does between samples" if plant.kind == "continuous" else ""
    return ["r is what the faults do to y, and no further from it than r_bound at any sample, fault or not, however "
            "the faults move within their ranges: so there is no false alarm, and r - r_bound to r + r_bound holds "
            f"Df f{weights}. Rounding is included ({t.real}, with or without fused multiply-add){between}",
            f"once settled r_bound is {last}; it comes down to that within {t.last << t.shift} samples from anywhere "
            "in the declared range of x and f", *slow_words(plant, cert)]


def slow_words(plant: Plant, cert: dict) -> list[str]:
    """What is said of modes that are slower than the decay asked for.

    Parameters
    ----------
    plant : Plant
    cert : dict
    """
    rate = "/s" if plant.kind == "continuous" else " per sample"
    return [f"{name} move together by a mode of {mode:.4g}{rate} that no observer changes: so slowly does the estimate "
            "tell them apart" for name, mode in cert["slow"]]


def conditions(plant: Plant, t: PolytopicTables, cert: dict) -> Iterator[fault_sets.Condition]:
    """The conditions of the bounds.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    cert : dict
    """
    problem, _ = fault_problem(plant)
    period = plant.sample_period if plant.kind == "continuous" else None
    return fault_sets.conditions(with_faults(plant), problem.whole, t, cert["thresholds"], np.array(cert["T1"]), period,
                                 bend_of_steps(plant))


def slow_modes(plant: Plant) -> dict[str, float]:
    """Modes that no observer changes, per second or per sample, by what moves together.

    Parameters
    ----------
    plant : Plant
    """
    problem, s = fault_problem(plant)
    return {told(problem, v): mode * s.time for v, mode in unmoved(in_units(problem, s))}


def bend_of_steps(plant: Plant) -> Array:
    """What Euler steps leave out; zero for a discrete plant.

    Parameters
    ----------
    plant : Plant

    Raises
    ------
    DesignError
        It has no bound.
    """
    if plant.kind == "discrete":
        return np.zeros(plant.n_x)
    try:
        return bend_of(plant)
    except PlantError as error:
        raise DesignError(f"{error} Without it the estimate has no bound.") from None
