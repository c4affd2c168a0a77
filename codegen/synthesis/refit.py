"""P found anew for gains that are given: after rounding, or for the gains of a plant file."""

from __future__ import annotations

import numpy as np

from .point import Units, with_jump
from .problem import Problem
from .set_hinf import HinfProblem
from .set_linf import SetLinfProblem

Array = np.ndarray
#: Distance from the boundary, ten times that of the design: the gains have moved by their rounding.
MARGIN = 1e-6


def refit(plant, L: Array, N: Array, proof: dict) -> dict | None:
    """Solve the matrix inequalities of a proof for P alone.

    Parameters
    ----------
    plant : Plant
    L, N : ndarray (N, n_x, n_y)
    proof : dict
        Its kind, decay, jump factor and dwell time are kept (a jump factor of 1 stays 1).

    Returns
    -------
    dict or None
        The proof with another P, None where the solver finds none.
    """
    problem = Problem.of(plant, bool(np.any(N)))
    units = Units.stated(proof, plant.n_x, plant.n_y)
    own, L, N = units.problem(problem), *(units.own_gains(np.asarray(g, float)) for g in (L, N))
    if proof["kind"] == "hinf":
        solved = HinfProblem(own, proof["lyapunov"], L, margin=MARGIN).solve(None, proof["lam"], proof["rho"])
    else:
        solved = SetLinfProblem(own, (L, N), margin=MARGIN).solve(proof["lam"], 0.0, proof["rho"])
    return None if solved is None else with_jump(proof | units.proof(solved["P"]), problem.tau)
