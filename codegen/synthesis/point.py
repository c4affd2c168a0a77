"""What a design of a point observer hands over: one gain per mode, instead of one per framer."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cvxpy as cp
import numpy as np
from scipy.linalg import eigh

from ..algebra.dwell import ratio, shortest
from ..errors import DesignError
from .framers import POLYTOPIC, enclosed_reason, through_reason, untold_reason
from .problem import Problem

Array = np.ndarray
#: (L, N) -> smallest surely detected fault, in channel sizes; inf where none is sure.
PointJudge = Callable[[Array, Array], float]


@dataclass(frozen=True)
class PointGains:
    """Gains of ``xi = T A x_hat + T B u + L r, x_hat+ = xi + N y+``, T = I - N C, with the data of their proof.

    Parameters
    ----------
    label : str
        Criterion and free scalars, for the report.
    L, N : ndarray (N, n_x, n_y)
        N is zero for a Luenberger observer.
    kind : {"luenberger", "tnl"}
    proof : dict
        As ``certify.residual_gain.prove`` expects it: "kind" ("hinf" or "linf"), "P" (N, n_x, n_x), "lam" (decay of
        the Lyapunov function per sample), "rho" (jump at a switch), "dwell_add", "dwell_drain", "chatter", and the
        units of ``Units``, in which the level is.
    figures : dict
        What the search found, for the report: pole, level of the solver, threshold.
    """

    label: str
    L: Array
    N: Array
    kind: str
    proof: dict
    figures: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Units:
    """Half widths of the declared ranges: what a state or an output is measured in while gains are sought.

    Without them the norms of the matrix inequalities add metres to volts, and a solver sees entries that differ by many
    orders of magnitude.

    Parameters
    ----------
    x : ndarray (n_x,), y : ndarray (n_y,)
    """

    x: Array
    y: Array

    @classmethod
    def of(cls, plant) -> Units:
        """Those of a plant."""
        halves = ((hi - lo) / 2 for lo, hi in (plant.limits("x"), plant.limits("y")))
        return cls(*(np.where(np.isfinite(h) & (h > 0), h, 1.0) for h in halves))

    @classmethod
    def stated(cls, proof: dict, n_x: int, n_y: int) -> Units:
        """Those of a proof; 1 where it states none."""
        return cls(np.array(proof.get("x_unit", np.ones(n_x))), np.array(proof.get("y_unit", np.ones(n_y))))

    def problem(self, problem: Problem) -> Problem:
        """The same plant in these units."""
        to_x, to_y = 1.0 / self.x[:, None], 1.0 / self.y[:, None]
        return replace(problem, A=to_x * problem.A * self.x, C=to_y * problem.C * self.x, Bw=to_x * problem.Bw,
                       Dv=to_y * problem.Dv, Bf=to_x * problem.Bf, Df=to_y * problem.Df)

    def stated_gains(self, gains: Array) -> Array:
        """Gains of the plant itself from those in these units.

        Parameters
        ----------
        gains : ndarray (N, n_x, n_y)
        """
        return self.x[:, None] * gains / self.y

    def own_gains(self, gains: Array) -> Array:
        """Gains in these units from those of the plant itself.

        Parameters
        ----------
        gains : ndarray (N, n_x, n_y)
        """
        return gains * self.y / self.x[:, None]

    def proof(self, P: Array) -> dict:
        """Entries of a proof: "P" for the plant itself from P in these units, and the units.

        Parameters
        ----------
        P : ndarray (N, n_x, n_x)
        """
        stated = P / self.x[:, None] / self.x
        return {"P": ((stated + stated.transpose(0, 2, 1)) / 2).tolist(), "x_unit": self.x.tolist(),
                "y_unit": self.y.tolist()}


def noise_scale(*parts: Array) -> float:
    """Largest magnitude in the disturbance and noise matrices (1 where all are zero): the unit of an LMI's noise."""
    return max((float(np.max(np.abs(part), initial=0.0)) for part in parts), default=0.0) or 1.0


def solved_to_numbers(problem: cp.Problem) -> bool:
    """Solve; whether there are numbers to look at, which the certificate will judge."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "may be inaccurate" is for the certificate to decide
            problem.solve(solver=cp.CLARABEL)
    except (cp.error.SolverError, ArithmeticError):
        return False
    return problem.value is not None and bool(np.isfinite(problem.value)) and problem.status in (
        "optimal", "optimal_inaccurate")


def jump_factor(P: Array) -> float:
    """Smallest rho with P_q <= rho P_l for all modes: the largest eigenvalue of all P_l^-1 P_q, at least 1.

    Parameters
    ----------
    P : ndarray (N, n_x, n_x)
        Positive definite.
    """
    rho = 1.0
    for q, a in enumerate(P):
        for r, b in enumerate(P):
            if q != r and not np.array_equal(a, b):
                d = np.sqrt(np.diag(b))  # states of other units spoil no digits
                rho = max(rho, float(eigh(a / d / d[:, None], b / d / d[:, None], eigvals_only=True)[-1]))
    return rho


def with_jump(proof: dict, tau: float | None) -> dict:
    """Complete a proof by the jump factor of its P, and by the dwell time that follows where none is declared.

    Parameters
    ----------
    proof : dict
    tau : float or None
        Declared average dwell time in samples.
    """
    if proof["lam"] == 0:
        return proof | {"rho": 1.0, "dwell_add": 1, "dwell_drain": 1}
    rho = jump_factor(np.array(proof["P"]))
    rho = rho * (1 + 1e-9) if rho > 1 else 1.0
    add, drain = ratio(max(1.0, tau * (1 - 1e-9) if tau else 1.001 * shortest(rho, proof["lam"])))
    return proof | {"rho": rho, "dwell_add": add, "dwell_drain": drain}


def dwell_of(proof: dict, tau: float | None) -> int:
    """Samples in a mode, on average, that the plant declares (tau) or a proof rests on; 1 for any switching."""
    needed = -(-proof["dwell_add"] // proof["dwell_drain"]) if proof["rho"] > 1 else 1
    return max(1, needed, int(tau or 1))


def check_open(plant, options: dict, name: str) -> None:
    """Refuse a rate at either end of its interval, where a Lyapunov function says nothing.

    Raises
    ------
    DesignError
    """
    if name in options and not 0.0 < float(options[name]) < 1.0:
        raise DesignError(f"{plant.name}: observer.{name} is {options[name]:g} (found), expected more than 0 and less "
                          "than 1.")


def common_reason(plant) -> str | None:
    """Why a plant cannot have a point observer with a set of residuals, with what to change; None if it can."""
    if plant.polytope is not None:
        return POLYTOPIC
    if (reason := through_reason(plant)) is not None:
        return reason
    if (reason := enclosed_reason(plant)) is not None:
        return reason
    measured = [s.name for s in plant.theta if s.measured]
    if measured and plant.kind == "continuous":
        return (f'the parameter "{measured[0]}" is measured, expected none to be: matrices that are constant in a mode '
                'do not follow it. Use method "lpv-interval" or "tnl-interval-lpv", or set measured = false.')
    if plant.theta and plant.kind == "discrete":
        return ('the plant has scheduling parameters, expected constant matrices per mode. Use method "lpv-interval" '
                'or "tnl-interval-lpv".')
    if (reason := untold_reason(plant)) is not None:
        return reason
    if plant.switching.late:
        return 'the mode is told late, expected at its own sample. Use method "tnl-interval-lpv".'
    if plant.n_y == 0:
        return "the plant has no output, expected at least one measured signal in signals.y."
    if plant.kind == "discrete" and "gains" not in plant.options and not any(
            np.any(m.Bw * (m.w_hi - m.w_lo)) or np.any(m.Dv * (m.v_hi - m.v_lo)) for m in plant.modes):
        return ("nothing disturbs the plant (all bounds of w and v are single points), expected an interval for one: "
                "the gains weigh noise against disturbance. State one, however small, or give gains of your own.")
    for vector in ("x", "u", "y"):
        for signal in getattr(plant, vector):
            if not (np.isfinite(signal.lo) and np.isfinite(signal.hi)):
                return (f'signals.{vector} "{signal.name}" has no range, expected range = [lo, hi]: rounding margins, '
                        "input checks and recovery need it. Add one.")
    return None
