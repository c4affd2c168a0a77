"""The plant of Zammali (2020), section 6.2.4, its matrix inequalities compiled once, and proofs without a P."""

import numpy as np

from codegen.plant.load import load
from codegen.synthesis.fault_direction import directions
from codegen.synthesis.problem import Problem
from codegen.synthesis.refit import refit
from codegen.synthesis.set_hinf import HinfProblem

PLANT = load("zammali_zonotope")
PROBLEM = Problem.of(PLANT, False)
SPLIT = directions(PROBLEM, [0], ["actuator"])
UNIT = 0.1  # every |w_i|, |v_i| <= 0.1
C, F, NONE = PROBLEM.C[0], PROBLEM.Bf, np.zeros((3, 3, 2))
_LMI = {}


def lmi(kind, assigned=True, shared=False):
    """The inequalities of one kind, compiled once."""
    key = kind, assigned, shared
    if key not in _LMI:
        _LMI[key] = HinfProblem(PROBLEM, kind, SPLIT if assigned else None, shared)
    return _LMI[key]


def hinf(plant, kind="common", lam=0.0, rho=1.0):
    """Proof data without a P yet, and how to find one."""
    n = plant.n_modes
    proof = {"kind": "hinf", "lyapunov": kind, "P": [np.eye(3).tolist()] * n, "lam": lam, "rho": rho, "dwell_add": 1,
             "dwell_drain": 1, "chatter": 1.0}
    return proof, lambda L, N: refit(plant, L, N, proof)
