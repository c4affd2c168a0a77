r"""Method "ellipsoid": Luenberger or TNL residual with an L-infinity level under average dwell time, in ellipsoids.

Plant ``x+ = A_q x + B_q u + Bw_q w``, ``y = C x + Dv_q v + Df_q f``; observer::

    xi = T_q A_q x_hat + T_q B_q u + L_q r,     x_hat+ = xi + N_q y+,     r = y - C x_hat,     T_q + N_q C = I

where q is the mode of the transition; a Luenberger observer is the case N = 0. The gains come from ``set_linf`` over
lines of lambda and beta. Of designs whose surely detected faults are within ten per cent of the best, the one with the
smallest error bound is kept: a residual is not better for being small, its fault may be smaller still. What a sensor
fault shows at its onset is (I - C N) Df f, and a design in which that nearly vanishes is refused.

Source: Zammali (2020), section 6.3, Theorem 21, (6.31)-(6.46). Differences from the print:

* Those of ``set_linf``: parametrisation, dropped conditions, the jump factor, the factor of switching in the bound.
* The printed design has no word on the fault; (I - C N) Df is checked here.
* Faults on the state, Dv and Df that switch, and for N = 0 a C that switches and a feedthrough D are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..algebra.dwell import admitted_jump, switching_factor
from ..errors import DesignError
from .detection import signature
from .point import PointGains, PointJudge, Units, check_open, common_reason, with_jump
from .problem import Problem
from .residual_judge import scorer
from .set_linf import SetLinfProblem

Array = np.ndarray
FAMILY = "ellipsoid"

#: Options of ``[observer]``, with what they may be.
OPTIONS = {"structure": ("luenberger", "tnl"), "lambda": (0.0, 1.0), "beta": (0.0, 1.0), "within": (0, 50)}
DECAYS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
WEIGHTS = (0.0, 0.01, 0.1)
#: Decays where none of these has gains: a sample may be short for the plant.
SLOW = (0.05, 0.02, 0.01, 0.005)
#: Average dwell times tried, in samples, where any switching is too much.
DWELLS = (1.0, 1.5, 2, 3, 5, 8, 12, 20, 40, 80)
#: Share of a fault's first effect that the residual must keep; below it what is left drowns in rounding.
SIGHT = 0.01
#: Samples after the onset, where the plant file does not say.
WITHIN = 3


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return common_reason(plant)


def no_tnl(plant) -> str | None:
    """Why the structure with N is not to be had; None if it is."""
    if any(np.any(m.D) for m in plant.modes):
        return "D is not zero; the new measurement would need the new input"
    if any(not np.array_equal(m.C, plant.modes[0].C) for m in plant.modes):
        return "C differs between modes, so T + N C = I would need one N per pair of modes"
    return None


def candidates(plant, options: dict, judge: PointJudge | None = None,
               progress: Callable[[str], None] = lambda text: None) -> Iterator[PointGains]:
    """The best gains of each structure.

    Parameters
    ----------
    plant : Plant
    options : dict
        See ``OPTIONS``; without ``structure`` both where the plant allows N.
    judge : callable, optional
        (L, N) -> threshold in channel sizes; default ``residual_judge``.
    progress : callable

    Raises
    ------
    DesignError
        N was asked for and cannot be, nothing is stable, or every design hides a fault; says which.
    """
    check_open(plant, options, "lambda")
    reason = no_tnl(plant)
    if reason is not None and options.get("structure") == "tnl":
        raise DesignError(f'{plant.name}: {reason}. Use structure = "luenberger".')
    wanted = [options["structure"]] if "structure" in options else ["luenberger"] + ["tnl"] * (reason is None)
    found, blind, units = False, None, Units.of(plant)
    for structure in wanted:
        problem = Problem.of(plant, structure == "tnl")
        score = scorer(problem, int(options.get("within", WITHIN)), judge)
        problem = units.problem(problem)
        made = []
        for gains in _searched(problem, units, options, score, progress):
            hidden = hides(problem, units.own_gains(gains.N))
            if hidden is None:
                made.append(gains)
            else:
                blind = hidden
        if made:
            found = True
            enough = 1.1 * min(gains.figures["threshold"] for gains in made)
            yield min((gains for gains in made if not gains.figures["threshold"] > enough),
                      key=lambda gains: gains.figures["error_bound"])
    if not found and blind is not None:
        channel, mode, share = blind
        raise DesignError(f'{plant.name}: every design hides fault "{plant.f[channel].name}" in mode "{mode}": '
                          f"|(I - C N) s| is {share:.2g} |s| (found), expected at least {SIGHT:g}, s its first effect "
                          'on the outputs. Use structure = "luenberger", or give beta.')
    if not found:
        raise DesignError(f'{plant.name}: no gains make {"T A - L C" if "tnl" in wanted else "A - L C"} stable under '
                          "the declared switching with the rates tried. Declare a longer switching.average_dwell, or "
                          "measure another state.")


def hides(problem: Problem, N: Array) -> tuple[int, str, float] | None:
    """Channel, mode and share of the first effect that is left, where N hides a fault; None where all are seen.

    Parameters
    ----------
    problem : Problem
    N : ndarray (N, n_x, n_y)
    """
    first = signature(problem)
    for q, name in enumerate(problem.names):
        left = (np.eye(problem.C.shape[1]) - problem.C[q] @ N[q]) @ first[q]
        for j in range(first.shape[2]):
            size = np.linalg.norm(first[q, :, j])
            if size > 0 and np.linalg.norm(left[:, j]) < SIGHT * size:
                return j, name, float(np.linalg.norm(left[:, j]) / size)
    return None


def _searched(problem: Problem, units: Units, options: dict, score, progress) -> Iterator[PointGains]:
    """All solutions over the lines of lambda and beta."""
    structure = "tnl" if problem.tnl else "luenberger"
    decays = (float(options["lambda"]),) if "lambda" in options else DECAYS
    weights = (float(options["beta"]),) if "beta" in options else WEIGHTS
    lmi = SetLinfProblem(problem)
    declared = problem.sizes[0] == 1 or problem.tau is not None
    for tau in (max(problem.tau or 1.0, 1.0),) if declared else DWELLS:
        tries = [(lam, beta) for lam in decays for beta in weights]
        found = False
        for n, (lam, beta) in enumerate(tries, 1):
            progress(f"{structure}, dwell time {tau:g}, {n} of {len(tries)}: lambda {lam:g}, beta {beta:g}")
            solved = lmi.solve(lam, beta, admitted_jump(lam, 0.98 * tau))
            if solved is not None:
                found = True
                yield _package(problem, units, structure, solved, lam, beta, score)
        if found:  # a longer dwell time is a weaker promise
            return
    for lam in SLOW if declared and "lambda" not in options else ():
        progress(f"{structure}, slow: lambda {lam:g}")
        solved = lmi.solve(lam, weights[0], admitted_jump(lam, 0.98 * tau))
        if solved is not None:
            yield _package(problem, units, structure, solved, lam, weights[0], score)


def _package(problem: Problem, units: Units, structure: str, solved: dict, lam: float, beta: float,
             score) -> PointGains:
    proof = with_jump({"kind": "linf", "lam": lam, "chatter": problem.chatter, **units.proof(solved["P"])}, problem.tau)
    rho, tau = proof["rho"], proof["dwell_add"] / proof["dwell_drain"]
    factor = 1 / lam if rho == 1 else switching_factor(rho, lam, tau, problem.chatter)
    size = problem.Bw.shape[2] + (1 + problem.tnl) * problem.Dv.shape[2]
    L, N = units.stated_gains(solved["L"]), units.stated_gains(solved["N"])
    threshold = score(L, N, proof)
    return PointGains(f"linf {structure}, lambda {lam:g}, beta {beta:g}", L, N, structure, proof,
                      {"mu": float(solved["mu"]), "error_bound": float(np.sqrt(solved["mu"] * factor * size)),
                       "threshold": threshold})
