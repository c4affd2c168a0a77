"""Method "hinf-filter" as the plant file asks for it: options, the problem with its weights, units of solver and C.

Plant ``x+ = A_q x + B_q u + Bw w + Bf f``, ``y = C_q x + D_q u + Dw w + Dv v + Df f``, A and B with bounded
unknowns (of a continuous plant: what encloses it at its samples, ``plant.enclosed``); the observer is a filter that
estimates f (or W_f f)::

    f_hat = Du u + Dy y + K xi,     xi+ = G u + L y + M xi                 one set of constants per mode

The design itself is ``hinf_filter``, the projections ``hinf_projection``. The solver wants states, outputs and faults
of about one; the C has the units of the plant file. So the problem is stated in units of powers of two for x and y (no
rounding), of the ranges for u and f, and the constants of the C are those of the filter in the plant's units, rounded:
what is certified is these, taken back exactly.

Source: A. Farhat, D. Koenig, switched uncertain H-infinity fault detection filter (slides), 2016.
Differences from the print: those named in ``hinf_filter``; inputs u are known; a threshold for the estimate
(``certify.filter_bounds``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from flint import fmpq

from ..errors import DesignError
from . import mode_set, mode_sliding
from .framers import POLYTOPIC, basic_reason, enclosed_reason
from .hinf_problem import Block, FilterProblem, in_coordinates, problem_of, unmeasured
from .hinf_weights import Weight, weight, weighted

Array = np.ndarray
#: Eigenvalues are stable below this: a double one at 1 comes out up to 1e-8 off.
STABLE = 1 - 1e-7
#: Options of ``[observer]``, with what they may be.
OPTIONS = {"synthesis": ("slack", "projection"), "target": dict, "colour": dict, "order_loss": (0.0, 1.0),
           "post_scaling": ("none", "steady"), "inputs": ("copy", "filtered"), "set_rows": (4, 400), "within": (0, 50),
           "threshold": ("guaranteed", "calibrated"), "false_alarm": (0.0, 1.0), "confidence": (0.0, 1.0),
           "campaign_steps": (10, 100000), "rank": (1, 100)}


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this filter, with what to change; None if it can."""
    if plant.polytope is not None:
        return POLYTOPIC
    finding = mode_sliding if plant.options.get("modes") == "sliding" else mode_set
    if not plant.switching.known and (reason := finding.inapplicable(plant)) is not None:
        return f"the mode is not known at run time, and it cannot be found there: {reason}"
    if (reason := basic_reason(plant)) is not None:
        return reason
    if not plant.f:
        return "no fault is declared, expected one to estimate. Declare it in signals.f."
    for s in plant.f:
        if not (np.isfinite(s.lo) and np.isfinite(s.hi)):
            return f'signals.f "{s.name}" has no range, expected range = [lo, hi]: the size of the fault. Add one.'
    if plant.switching.late:
        return "the mode is told late, expected at its own sample. Use method \"tnl-interval-lpv\"."
    if (reason := enclosed_reason(plant)) is not None:
        return reason
    for mode in plant.modes:
        for name in () if unmeasured(plant) else set(mode.theta_terms) - {"A", "B"}:
            return (f'{name} of mode "{mode.name}" depends on a parameter, expected only A and B to where one is '
                    "measured. Take the middle and widen the bounds of w or v by the rest.")
        if set(mode.theta_terms) - {"A", "B"} and any(np.any(b != s) for b, s in zip(plant.theta_box(mode), (-1, 1))):
            return (f'a matrix of mode "{mode.name}" other than A and B depends on a parameter whose bounds are not '
                    "[-1, 1] (found), expected these: then nothing is rounded. Scale its factors.")
    return unstable_reason(plant)


def unstable_reason(plant) -> str | None:
    """Which mode is not stable by itself, whatever the parameters; None if there is none."""
    for mode in plant.modes:
        if "A" in mode.theta_terms:
            continue
        values = np.linalg.eigvals(mode.A)
        size = np.max(np.abs(np.exp(values * plant.sample_period) if plant.kind == "continuous" else values))
        if size >= STABLE:
            return (f'mode "{mode.name}" has an eigenvalue of size {size:.9g} a sample (found), expected less than 1: '
                    "a filter of a plant that is not stable by itself has no level. Stabilise it, or use an observer "
                    'such as "tnl-interval".')
    return None


def stated_weight(where: str, key: str, value) -> Weight | None:
    """A weight of the plant file, ``{ num = [...], den = [...] }``.

    Raises
    ------
    DesignError
        It is not that, not proper or not stable.
    """
    if value is None:
        return None
    for name in ("num", "den"):
        numbers = value.get(name)
        if not (isinstance(numbers, list) and numbers and all(
                isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) for x in numbers)):
            raise DesignError(f"{where}: observer.{key}.{name} is {numbers!r}, expected a list of numbers: "
                              "coefficients of falling powers of the shift.")
    if unknown := set(value) - {"num", "den"}:
        raise DesignError(f"{where}: observer.{key}.{min(unknown)} is unknown, expected num and den.")
    if value["den"][0] == 0:
        raise DesignError(f"{where}: observer.{key}.den starts with 0, expected the highest power first. Remove it.")
    try:
        return weight(value["num"], value["den"])
    except DesignError as error:
        raise DesignError(f"{where}: observer.{key}: {error}") from None


def copies(plant, options: dict) -> bool:
    """Whether the filter reads y less what a copy of the plant makes of u.

    Of a plant without uncertainty nothing of u is left in that, and the thresholds need not hold it; else the filter
    reads u as a measurement.

    Raises
    ------
    DesignError
        A copy is asked for and the plant is uncertain.
    """
    varies = bool(plant.enclosed.theta)
    if varies and options.get("inputs") == "copy":
        raise DesignError(f'{plant.name}: observer.inputs is "copy", expected "filtered": a copy of a plant with '
                          "unknown parameters leaves a part of u in. Use filtered.")
    return bool(plant.u) and not varies and options.get("inputs", "copy") == "copy"


def without_inputs(problem: FilterProblem, n_u: int) -> FilterProblem:
    """A problem without weights less its inputs: neither unknown nor measured."""
    def less(m):
        n_d, n_f = m.E.shape[1], len(m.Cz)
        keep = [j for j in range(n_d) if not n_d - n_f - n_u <= j < n_d - n_f]
        rows = slice(0, len(m.C) - n_u)
        return replace(m, E=m.E[:, keep], C=m.C[rows], F=m.F[rows][:, keep], Fz=m.Fz[:, keep])

    return replace(problem, modes=tuple(less(m) for m in problem.modes))


def with_copy(constants: dict[str, Array], modes, real: str) -> dict[str, Array]:
    """Constants of a filter of y alone, for y less what a copy of the plant makes of u: xi = [filter; copy].

    Parameters
    ----------
    constants : dict
        M, L, K, Dy, rounded; G and Du without columns.
    modes : sequence of Mode
    real : {"float32", "float64"}

    Returns
    -------
    dict
    """
    parts: dict[str, list] = {k: [] for k in constants}
    for q, m in enumerate(modes):
        M, L, K, Dy = (constants[k][q].astype(float) for k in ("M", "L", "K", "Dy"))
        n_s, n_x = len(M), len(m.A)
        parts["M"].append(np.block([[M, -L @ m.C], [np.zeros((n_x, n_s)), m.A]]))
        parts["G"].append(np.vstack([-L @ m.D, m.B]))
        parts["L"].append(np.vstack([L, np.zeros((n_x, L.shape[1]))]))
        parts["K"].append(np.hstack([K, -Dy @ m.C]))
        parts["Du"].append(-Dy @ m.D)
        parts["Dy"].append(Dy)
    return {k: np.stack(v).astype(real) for k, v in parts.items()}


def power(size: Array) -> Array:
    """Powers of two near sizes."""
    return 2.0 ** np.round(np.log2(size))


@dataclass(frozen=True)
class Units:
    """Sizes of [y; u] and of f, by which the problem is scaled, and how many of the former are outputs.

    Parameters
    ----------
    seen : ndarray (n_y + n_u,)
    fault : ndarray (n_f,)
    n_y : int
    """

    seen: Array
    fault: Array
    n_y: int

    def emitted(self, gains, real: str) -> dict[str, Array]:
        """Constants of the C of gains of the problem: M, L, G, K, Dy, Du, stacked over the modes and rounded."""
        parts: dict[str, list] = {k: [] for k in ("M", "L", "G", "K", "Dy", "Du")}
        for A, B, C, D in gains:
            B, C, D = B / self.seen, C * self.fault[:, None], D * self.fault[:, None] / self.seen
            for key, value in zip(parts, (A, B[:, :self.n_y], B[:, self.n_y:], C, D[:, :self.n_y], D[:, self.n_y:])):
                parts[key].append(value)
        return {k: np.stack(v).astype(real) for k, v in parts.items()}

    def gains(self, t: dict[str, Array]) -> list:
        """Gains of the problem for constants of the C, as exact rationals."""
        seen, fault = (np.array([exact(v) for v in values], dtype=object) for values in (self.seen, self.fault))
        out = []
        for M, L, G, K, Dy, Du in zip(*(t[k] for k in ("M", "L", "G", "K", "Dy", "Du"))):
            B = rationals(np.concatenate([L, G], axis=1)) * seen
            D = rationals(np.concatenate([Dy, Du], axis=1)) * seen / fault[:, None]
            out.append((rationals(M), B, rationals(K) / fault[:, None], D))
        return out


def exact(x: float) -> fmpq:
    """The rational value of a float."""
    return fmpq(*float(x).as_integer_ratio())


def rationals(values: Array) -> Array:
    """Object array of exact values."""
    out = np.empty(values.shape, dtype=object)
    for index in np.ndindex(values.shape):
        out[index] = exact(values[index])
    return out


def stated(plant, options: dict, inputs: bool = True) -> tuple[FilterProblem, Units]:
    """The problem that a plant file states, with its weights, and its units.

    Parameters
    ----------
    plant : Plant
    options : dict
        ``target`` and ``colour`` are read.
    inputs : bool
        Without them the filter is one of y alone.

    Returns
    -------
    problem : FilterProblem
    units : Units

    Raises
    ------
    DesignError
        A weight is wrong, or the plant is none for this method.
    """
    plant = plant.enclosed
    plain = problem_of(plant)
    size = {v: np.maximum(*(np.abs(side) for side in plant.limits(v))) for v in "xyuf"}
    size = {v: np.where(s > 0, s, 1.0) for v, s in size.items()}
    units = Units(np.concatenate([power(size["y"]), size["u"]]), size["f"], plant.n_y)
    problem = in_coordinates(plain, np.diag(1 / power(size["x"])))
    n = plant.n_x

    def seen(m):
        rows = units.seen[:, None]
        blocks = tuple(Block(np.vstack([b.H[:n], b.H[n:] / rows]), b.S, b.repeated) for b in m.blocks)
        return replace(m, C=m.C / rows, F=m.F / rows, blocks=blocks)

    problem = replace(problem, modes=tuple(seen(m) for m in problem.modes))
    if not inputs:
        problem, units = without_inputs(problem, plant.n_u), replace(units, seen=units.seen[:plant.n_y])
    weights = [stated_weight(plant.name, key, options.get(key)) for key in ("target", "colour")]
    return (problem if weights == [None, None] else weighted(problem, *weights)), units
