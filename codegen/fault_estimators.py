"""From a polytopic plant with sensor faults to tables that estimate them: design, rounding, thresholds, proof."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .certify import polytope_thresholds
from .certify.exact import Q, product, rational, up
from .certify.exact import leading_failure as failure
from .errors import CertificateError, DesignError, PlantError
from .observers import PolytopicTables
from .plant.bend import bend as bend_of
from .plant.model import Plant, Signal
from .polytopic_tables import frozen, tables_of
from .synthesis.descriptor_fault_estimation import FaultDesign, design, gains_of
from .synthesis.descriptor_lmi import Bounds
from .synthesis.descriptor_problem import Scaling
from .synthesis.fault_problem import FaultProblem, fault_problem, in_units, unmoved

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
    """The plant with its faults behind the states: zero at the start, within their ranges later.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    """
    import sympy
    p, none = plant.polytope, np.zeros(plant.n_f)
    symbols = (*p.symbols[:plant.n_x], *(sympy.Dummy(s.name) for s in plant.f), *p.symbols[plant.n_x:])
    taken = {s.name for s in plant.x}
    faults = tuple(Signal(f"{s.name} fault" if s.name in taken else s.name, s.unit, s.lo, s.hi) for s in plant.f)
    return replace(plant, x=plant.x + faults, x0_lo=np.concatenate([plant.x0_lo, none]),
                   x0_hi=np.concatenate([plant.x0_hi, none]), polytope=replace(p, symbols=symbols))


def propose(plant: Plant, options: dict) -> FaultProposal:
    """Design.

    Parameters
    ----------
    plant : Plant
        One that ``fault_problem.inapplicable`` does not refuse.
    options : dict
        Of ``[observer]``: decay, gain.

    Returns
    -------
    FaultProposal

    Raises
    ------
    DesignError
        No observer exists within the bounds.
    """
    problem, s = fault_problem(plant)
    period = plant.sample_period if plant.kind == "continuous" else None
    step = None if period is None else period * s.time
    decay = float(options["decay"]) / s.time if "decay" in options else default_decay(in_units(problem, s), step)
    found = design(in_units(problem, s), Bounds(float(options.get("gain", GAIN)), decay, step))
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
    t = tables_of(whole, own, np.eye(len(C)), real)
    t = replace(t, known=gains.G[0, :, n_u:].astype(real))
    bend = bend_of_steps(plant)
    rows = options.get("set_rows")
    t, held = frozen(whole, problem.whole, t, T1, proposal.period, None if rows is None else int(rows), bend)
    return t, {"kind": "polytopic", "level": float(np.max(t.h[-1])), "claimed": proposal.found.gamma,
               "T1": T1.tolist(), "slow": [[name, mode * s.time] for name, mode in proposal.found.slow],
               "thresholds": held, "steady_box": None}


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
