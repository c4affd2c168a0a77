"""Gains that the plant file gives (``[observer] gains``): nothing is searched, all is certified."""

from __future__ import annotations

import numpy as np

from ..algebra.dwell import ratio, shortest
from ..analysis.detectability import surely_detected
from ..errors import DesignError
from ..plant.model import Plant
from ..plant.uncertain import is_uncertain
from ..synthesis import METHODS
from ..synthesis.linf import pairwise
from ..synthesis.problem import Candidate
from .trials import Trial, both_sides, certified

Array = np.ndarray


def fixed_gains(plant: Plant, name: str, options: dict, within: int) -> Trial:
    """Certify gains that the plant file gives (``[observer] gains``): containment, and P where it gives one.

    Raises
    ------
    DesignError
        Wrong shapes.
    """
    given = options["gains"]
    shape = (plant.n_modes, plant.n_x, plant.n_y)
    varying = is_uncertain(plant)
    slopes = (plant.n_modes, len(plant.observed.theta), *shape[1:])
    known = ("L", "N", *(("L_theta",) if varying else ("L_hi", "L_lo", "N_hi", "N_lo", "P", "P_hi", "P_lo")))
    known = (*known, *["R"] * (options.get("coordinates") == "change"))
    for key in given:
        if key not in known:
            raise DesignError(f"{plant.name}: observer.gains.{key} is unknown, expected one of {', '.join(known)}.")
    gains = {}
    for key in ("L_hi", "L_lo", "N_hi", "N_lo"):
        value = given.get(key, given.get(key[0]))
        if value is None and key[0] == "N":
            value = np.zeros(shape)
        gains[key] = array(plant, key, value, shape)
    reads_next = METHODS[name].family_for(plant) == "tnl" or not plant.switching.known
    if np.any([gains["N_hi"], gains["N_lo"]]) and (not reads_next or "R" in known):
        raise DesignError(f'{plant.name}: observer.gains.N is not zero, but the step of '
                          + ("framers in other coordinates" if "R" in known else f'method "{name}"')
                          + ' does not read the measurement of the next sample. Leave N out, or use method '
                          '"tnl-interval" or "tnl-interval-lpv".')
    proof = {"kind": "none"}
    if "lambda" in options and ("P" in given or "P_hi" in given):
        proof = given_proof(plant, given, options)
    steps = array(plant, "L_theta", given.get("L_theta", np.zeros(slopes)), slopes) if varying else None
    R = array(plant, "R", given.get("R"), shape[1:2] * 2) if "R" in known else None
    c = Candidate("gains of the plant file", gains["L_hi"], gains["N_hi"], proof, steps, R)
    if R is not None:
        METHODS[name].module.check_gains(plant, R, c.L)
    if varying:
        gains = both_sides(c, plant, METHODS[name].module)
    tables, cert = certified(plant, gains, proof, plant.target.real)
    return Trial(name, c, gains, tables, cert, surely_detected(plant, tables, cert, within))


def given_proof(plant: Plant, given: dict, options: dict) -> dict:
    """Proof data from Lyapunov matrices of the plant file, normalised to P >= I."""
    shape = (plant.n_modes, plant.n_x)
    P = {s: array(plant, "P_" + s, given.get("P_" + s, given.get("P")), shape) for s in ("hi", "lo")}
    P = {s: p / min(1.0, p.min()) for s, p in P.items()}
    rho = max(pairwise(p) for p in P.values())
    rho = float(np.nextafter(rho, np.inf)) if rho > 1 else 1.0
    add, drain = ratio(max(1.0, 1.001 * shortest(rho, options["lambda"])))
    return {"kind": "linf", "lam": options["lambda"], "rho": rho, "P_hi": P["hi"].tolist(), "P_lo": P["lo"].tolist(),
            "dwell_add": add, "dwell_drain": drain, "chatter": plant.switching.chatter}


def array(plant: Plant, key: str, value, shape: tuple[int, ...]) -> Array:
    """Check and convert gains given by the user."""
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        out = np.empty(0)
    if out.shape != shape or not np.all(np.isfinite(out)):
        raise DesignError(f"{plant.name}: observer.gains.{key} has shape {out.shape}, expected {shape} finite numbers "
                          "(one matrix per mode).")
    return out
