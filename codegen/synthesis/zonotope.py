r"""Method "zonotope": Luenberger residual with a pole in the direction of an actuator fault, evaluated by zonotopes.

Plant ``x+ = A_q x + B_q u + Bw_q w + Bf_q f``, ``y = C_q x + D_q u + Dv_q v``; observer::

    r = y - C x_hat - D u,      x_hat+ = A_q x_hat + B_q u + L_q r,      (A_q - L_q C_q) Bf_q = pole Bf_q

with the smallest H-infinity level from w and v to r among such gains (``set_hinf``). Without a fault r lies in a
zonotope that depends on the mode sequence only. The pole is searched for the smallest surely detected fault: the
response to a constant fault grows as 1/(1 - pole), but so does what the disturbance leaves along the same direction,
and detection within a few samples is best near 0.5. What the pole leaves free of the gains is then searched for
the smallest surely detected fault as well (``sharpen``).

Source: Zammali (2020), section 6.2, Theorems 19 and 20, (6.3)-(6.21). Differences from the print:

* Those of ``set_hinf``: sizes and signs in (6.13), (6.19), S per mode, "switched" and "multiple".
* "lambda closer to 1 is better" is not so, see above; lambda = 0.7 of the example has no design with one P.
* (6.8)-(6.10), the response to a fault, hold while the mode does not change, or with ``subspace = "common"``.
* Several channels, their own poles, sensor faults beside them (which get no pole), and a feedthrough D are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..algebra.dwell import admitted_jump
from ..errors import DesignError
from .fault_direction import FaultDirections, assignable, directions, zeros
from .point import PointGains, PointJudge, Units, check_open, common_reason, with_jump
from .problem import Problem
from .residual_judge import scorer
from .set_hinf import KINDS, HinfProblem, largest_pole
from .sharpen import sharpened

Array = np.ndarray
FAMILY = "zonotope"

#: Options of ``[observer]``, with what they may be.
OPTIONS = {"criterion": ("hinf", "pole", "detection"), "lyapunov": KINDS, "lambda": (0.0, 1.0), "poles": dict,
           "subspace": ("own", "common"), "alpha": (0.0, 1.0), "within": (0, 50), "evaluations": (1, 100000)}
#: Poles tried; between them the best is refined by halving. Above 0.95 a fault is seen too late to be of use.
POLES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
REFINEMENTS = 6
#: Thresholds over the smallest one up to which a faster pole is kept as well.
NEAR = 1.3
#: Decays per sample tried where the Lyapunov function may jump.
DECAYS = (0.1, 0.2, 0.3, 0.4)
#: Samples after the onset, where the plant file does not say.
WITHIN = 3


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this observer, with what to change; None if it can."""
    return common_reason(plant)


def candidates(plant, options: dict, judge: PointJudge | None = None,
               progress: Callable[[str], None] = lambda text: None) -> Iterator[PointGains]:
    """The best gains of each criterion and kind of switching.

    Parameters
    ----------
    plant : Plant
    options : dict
        See ``OPTIONS``; without ``criterion`` all, without ``lyapunov`` one P and P per mode for any switching, and
        P with jumps where the plant declares a dwell time.
    judge : callable, optional
        (L, N) -> threshold in channel sizes, by which the pole is searched; default ``residual_judge``.
    progress : callable

    Raises
    ------
    DesignError
        No pole, or not the asked one, has a design; says which has.
    """
    check_open(plant, options, "alpha")
    score = scorer(Problem.of(plant, False), int(options.get("within", WITHIN)), judge)
    units = Units.of(plant)
    problem = units.problem(Problem.of(plant, False))
    channels = [s.name for s in plant.f]
    placed = _placed(plant, problem, options)
    asked = options.get("criterion") == "pole" or "lambda" in options or "poles" in options
    wanted = [options["criterion"]] if "criterion" in options else ["hinf", "pole", "detection"]
    made, rest = [], {}  # the detection search starts from the others, asked for or not
    if "hinf" in wanted or ("detection" in wanted and not asked):
        for kind in kinds(problem, options):
            gains = _free(problem, units, options, kind, score, progress)
            if gains is not None:
                made.append(gains)
                rest[gains.label] = np.stack([np.eye(problem.sizes[2])] * problem.sizes[0])
    if placed and ("pole" in wanted or "detection" in wanted):
        try:
            split = directions(problem, list(placed), channels, options.get("subspace", "own"))
        except DesignError as error:
            if asked:
                raise DesignError(f"{plant.name}: {error}") from None
        else:
            best = [b for kind in kinds(problem, options)
                    for b in _searched(problem, units, options, kind, split, placed, score, progress)]
            if not best and asked:
                raise DesignError(f"{plant.name}: {no_pole(problem, options, split, placed)}")
            made += best
            rest |= {b.label: split.rest for b in best}
    if not made:
        raise DesignError(f"{plant.name}: no gains make A - L C stable under the declared switching. Declare "
                          'switching.average_dwell with lyapunov = "multiple", or measure another state.')
    if wanted != ["detection"]:
        yield from made
    if "detection" in wanted and plant.f:
        start = min(made, key=lambda c: c.figures["threshold"])
        sharp = sharpened(plant, start, rest[start.label], int(options.get("within", WITHIN)),
                          int(options.get("evaluations", 100)), score, progress)
        if sharp is not None or wanted == ["detection"]:
            yield sharp or start


def kinds(problem: Problem, options: dict) -> list[str]:
    """Kinds of switching to try, in this order."""
    if "lyapunov" in options:
        return [options["lyapunov"]]
    if problem.sizes[0] == 1:
        return ["common"]
    return ["common", "switched"] + ["multiple"] * (problem.tau is not None)


def _placed(plant, problem: Problem, options: dict) -> dict[int, float | None]:
    """Channel -> its own pole (None: that of the search) of all channels that get one."""
    able, names = assignable(problem), [s.name for s in plant.f]
    own = options.get("poles", {})
    for name, value in own.items():
        if name not in names:
            raise DesignError(f'{plant.name}: observer.poles names "{name}", expected a fault channel '
                              f"({', '.join(names) or 'there is none'}).")
        if names.index(name) not in able:
            raise DesignError(f'{plant.name}: observer.poles gives "{name}" a pole, expected a channel that acts on '
                              "the state in every mode (Bf) and on no output (Df).")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1:
            raise DesignError(f'{plant.name}: observer.poles."{name}" is {value!r}, expected a number from 0 to '
                              "below 1.")
    if options.get("criterion") == "pole" and not able:
        raise DesignError(f"{plant.name}: no fault channel acts on the state in every mode (Bf) and on no output (Df), "
                          'expected one for criterion "pole". Use criterion = "hinf".')
    if own and options.get("subspace") == "common":
        raise DesignError(f'{plant.name}: observer.poles with subspace = "common", expected one pole for the whole '
                          "subspace. Give observer.lambda.")
    return {j: float(own[names[j]]) for j in able if names[j] in own} if own else dict.fromkeys(able)


def _rates(lmi: HinfProblem, options: dict, pole) -> list[tuple[float, float]]:
    """(decay, jump factor) to try.

    Of a declared dwell time every jump factor below (1 - decay)^-tau is admissible; where none is declared the shortest
    is looked for at which there is a design.
    """
    if lmi.kind != "multiple":
        return [(0.0, 1.0)]
    decays = (float(options["alpha"]),) if "alpha" in options else DECAYS
    tau, out = lmi.problem.tau, []
    for alpha in decays:
        for samples in (1.0, 1.5, 2, 3, 4, 5, 6, 8, 12, 20) if tau is None else (max(tau, 1.0),):
            rho = admitted_jump(alpha, 0.98 * samples)
            if tau is not None or lmi.stabilisable(pole, alpha, rho):
                out.append((alpha, rho))
                break
    return out


def _free(problem: Problem, units: Units, options: dict, kind: str, score, progress) -> PointGains | None:
    """Theorem 19 in its kinds of switching: gains free; of several decays that with the smallest threshold."""
    lmi, best = HinfProblem(problem, kind), None
    rates = _rates(lmi, options, None)
    for n, (alpha, rho) in enumerate(rates, 1):
        progress(f"hinf {kind}, {n} of {len(rates)}: " + _rate_words(alpha))
        solved = lmi.solve(None, alpha, rho)
        made = None if solved is None else _package(problem, units, kind, solved, alpha, None, score)
        if made is not None and (best is None or made.figures["threshold"] < best.figures["threshold"]):
            best = made
    return best


def _searched(problem: Problem, units: Units, options: dict, kind: str, split: FaultDirections, placed: dict, score,
              progress) -> list[PointGains]:
    """Theorem 20 with the pole of the smallest threshold, and the fastest pole whose threshold is not much larger.

    The threshold is that of exact sets along some sequences. The sets that the firmware carries are larger, the more so
    the slower the errors decay: which of the two promises more is told by the tables that are emitted.
    """
    lmi, best, count, every = HinfProblem(problem, kind, split), None, 0, []
    own = None not in placed.values()  # every channel has its own pole: nothing to search
    first = (0.0,) if own else (float(options["lambda"]),) if "lambda" in options else POLES
    refinements = REFINEMENTS if first is POLES else 0
    rates = _rates(lmi, options, _poles(first[0], split, placed))
    for alpha, rho in rates:
        scores: dict[float, float] = {}
        for step in range(len(first) + refinements):
            pole, count = first[step] if step < len(first) else _between(scores), count + 1
            words = "poles as given" if own else f"lambda {pole:.4g}"
            progress(f"pole {kind}, {count} of {len(rates) * (len(first) + refinements)}: {words}"
                     + (", " + _rate_words(alpha)) * (alpha > 0))
            solved = lmi.solve(_poles(pole, split, placed), alpha, rho)
            made = None if solved is None else _package(problem, units, kind, solved, alpha, words, score)
            scores[pole] = np.inf if made is None else made.figures["threshold"]
            every += [] if made is None else [(pole, scores[pole], made)]
            if made is not None and (best is None or scores[pole] < best.figures["threshold"]):
                best = made
    near = [(pole, k) for k, (pole, found, _) in enumerate(every) if found <= NEAR * best.figures["threshold"]]
    fastest = every[min(near)[1]][2] if near else best
    return [] if best is None else [best] if fastest is best else [best, fastest]


def _between(scores: dict[float, float]) -> float:
    """Middle of the wider gap beside the best pole so far."""
    poles = sorted(scores)
    i = min(range(len(poles)), key=lambda k: scores[poles[k]])
    gaps = [(poles[k + 1] - poles[k], (poles[k + 1] + poles[k]) / 2) for k in (i - 1, i) if 0 <= k < len(poles) - 1]
    return max(gaps)[1]


def _poles(pole: float, split: FaultDirections, placed: dict) -> Array:
    own = list(placed.values())
    if len(own) != split.F.shape[2]:  # a common subspace has one pole
        return np.full(split.F.shape[2], pole)
    return np.array([pole if p is None else p for p in own])


def _package(problem: Problem, units: Units, kind: str, solved: dict, alpha: float, poles: str | None,
             score) -> PointGains:
    proof = with_jump({"kind": "hinf", "lyapunov": kind, "lam": alpha, "chatter": problem.chatter,
                       **units.proof(solved["P"])}, problem.tau)
    L = units.stated_gains(solved["L"])
    threshold = score(L, np.zeros_like(L), proof)
    label = ", ".join(["hinf" if poles is None else poles, f"{kind} Lyapunov"] + [_rate_words(alpha)] * (alpha > 0))
    return PointGains(label, L, np.zeros_like(L), "luenberger", proof,
                      {"gamma": solved["gamma"], "threshold": threshold})


def _rate_words(alpha: float) -> str:
    return f"decay {alpha:g}"


def no_pole(problem: Problem, options: dict, split: FaultDirections, placed: dict) -> str:
    """Say which poles have a design: the largest for any switching, or what stands in the way of all."""
    fixed = [p for p in placed.values() if p is not None]
    asked = f"lambda = {options['lambda']:g}" if "lambda" in options else (
        "observer.poles" if fixed else "every pole tried")
    head = (f"{asked} (found) puts the fault on a pole at which no gains are stable "
            + (f'with lyapunov = "{options["lyapunov"]}"' if "lyapunov" in options else "for arbitrary switching"))
    left = zeros(problem, split)
    if left is not None and np.max(np.abs(left), initial=0.0) >= 1.0:
        worst = ", ".join(f'{max(z, key=abs):.4g} in mode "{name}"' for name, z in zip(problem.names, left))
        return (f"{head}: as many directions as outputs get a pole, which leaves A - L C the eigenvalues {worst} "
                "whatever the gains (zeros of the plant from fault to output). "
                + ('Leave subspace = "common" out.' if options.get("subspace") == "common" else
                   'Use criterion = "hinf", or name fewer channels in observer.poles.'))
    limits = {} if fixed else {kind: largest_pole(HinfProblem(problem, kind, split))
                               for kind in (KINDS[:2] if problem.sizes[0] > 1 else KINDS[:1])}
    feasible = {kind: pole for kind, pole in limits.items() if pole is not None}
    if feasible:
        which = " and ".join(f'{np.floor(1000 * pole) / 1000:g} with lyapunov = "{kind}"'
                             for kind, pole in feasible.items())
        return (f"{head}, expected lambda at most {which}. Choose it smaller, leave it out, or declare "
                'switching.average_dwell with lyapunov = "multiple".')
    return (f'{head}, and none smaller was found. Use criterion = "hinf", or declare switching.average_dwell with '
            'lyapunov = "multiple".')
