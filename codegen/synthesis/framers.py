"""The designs of an interval observer, classical or TNL: which criteria apply, in which order they are tried."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator

import numpy as np

from ..errors import DesignError
from . import continuous, detection, linf, lipschitz, mode_set, mode_sliding, policy, width
from .problem import Candidate, Judge, Problem
from .structure import obstruction, slow_reason

Array = np.ndarray
POLYTOPIC = ("the plant is polytopic (vertices and weights), expected modes. Where its E is the identity, give it as "
             "[[mode]] tables with what varies as theta.")

#: Options of ``[observer]`` that the interval family reads, with what they may be.
OPTIONS = {
    "criterion": ("linf", "width", "detection"), "lyapunov": ("common", "multiple"), "lambda": (0.0, 1.0),
    "contraction": (0.0, 1.0), "sampling": ("euler", "second-order", "exponential"),
    "interpolation": ("linear", "quadratic"), "design": ("sampled", "continuous"), "decay": (0.0, 1e9),
    "metzler": (0.0, 1e12), "coordinates": ("none", "change"), "gain_cap": (0.0, 1e6), "evaluations": (1, 100000),
    "within": (0, 50), "gains": dict, "modes": ("set", "sliding"), **mode_set.OPTIONS,
    **mode_sliding.OPTIONS,
}


#: What calibrated thresholds alone read.
CAMPAIGN = ("false_alarm", "confidence", "campaign_steps", "rank")


def check_options(where: str, options: dict, known: dict | None = None) -> None:
    """Refuse unknown or impossible options; ``known`` is as ``OPTIONS``, which is the default.

    Raises
    ------
    DesignError
    """
    known = OPTIONS if known is None else known
    for key, value in options.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            advice = f'Did you mean "{near[0]}"?' if near else "Remove it or correct its name."
            raise DesignError(f"{where}: observer.{key} is no option of this method (expected one of "
                              f"{', '.join(known)}). {advice}")
        if key in CAMPAIGN and "threshold" in known and options.get("threshold") != "calibrated":
            raise DesignError(f'{where}: observer.{key} is given, which threshold = "calibrated" alone reads. '
                              "Remove it, or let the thresholds be calibrated.")
        allowed = known[key]
        whole = allowed is not dict and all(type(a) is int for a in allowed)
        if allowed is dict:
            good = isinstance(value, dict) and (len(value) > 0 or key != "gains")
        elif isinstance(allowed[0], str):
            good = value in allowed
        else:
            good = isinstance(value, int | float) and not isinstance(value, bool) and allowed[0] <= value <= allowed[1]
            good = good and (not whole or value == int(value))
        if not good:
            table = "a table with L, one matrix per mode, at least" if key == "gains" else "a table"
            words = table if allowed is dict else (
                " or ".join(f'"{a}"' for a in allowed) if isinstance(allowed[0], str)
                else f"a {'whole ' * whole}number from {allowed[0]:g} to {allowed[1]:g}")
            raise DesignError(f"{where}: observer.{key} is {value!r}, expected {words}.")


def inapplicable(plant, tnl: bool) -> str | None:
    """Why a plant cannot have an interval observer of this form, with what to change; None if it can."""
    if plant.polytope is not None:
        return POLYTOPIC
    if plant.switching.late:
        return 'the mode is told late, expected at its own sample. Use method "tnl-interval-lpv" or "lpv-interval".'
    if plant.kind != "discrete":
        return 'the plant is continuous, expected discrete. Use method "tnl-interval-lpv" or "lpv-interval".'
    if plant.theta:
        return ('the plant has scheduling parameters, expected constant matrices per mode. Use method "lpv-interval" '
                'or "tnl-interval-lpv".')
    return common_reason(plant, tnl, "interval")


def inapplicable_varying(plant, tnl: bool, split: bool = False) -> str | None:
    """As ``inapplicable`` for the methods that take parameters and continuous plants."""
    if plant.polytope is not None:
        return POLYTOPIC
    if plant.switching.late:
        first = plant.modes[0]
        for mode in plant.modes:
            for name in ("C", "D", "Dv", "v_lo", "v_hi"):
                if not np.array_equal(getattr(mode, name), getattr(first, name)):
                    return (f'{name} of mode "{mode.name}" differs from that of "{first.name}", expected the same in '
                            "all modes where the mode is told late. Take what covers both.")
            if mode.theta_bounds is not None:
                return (f'the bounds of a parameter in mode "{mode.name}" are its own, expected the same in all modes '
                        "where the mode is told late. Leave them out of bounds.")
    elif plant.kind == "discrete" and not plant.theta:
        return 'the plant has constant matrices in discrete time. Use method "tnl-interval" or "interval".'
    for mode in plant.modes:
        for name in set(mode.theta_terms) - {"A", "B"}:
            return (f'{name} of mode "{mode.name}" depends on a parameter, expected only A and B to. Take the middle '
                    "and widen the bounds of w or v by the rest.")
    measured = [s.name for s in plant.theta if s.measured]
    if split and measured:
        return (f'the parameter "{measured[0]}" is measured, expected none to be. Use method "lpv-interval" or '
                '"tnl-interval-lpv", or set measured = false.')
    return common_reason(plant, tnl, "lpv-interval")


def through_reason(plant) -> str | None:
    """What stands in the way where the disturbance is in the outputs as well; None if nothing does."""
    if any(np.any(m.Dw) for m in plant.modes):
        return ('Dw is not zero: a disturbance is in y too, expected noise v alone there. Use method "hinf-filter", or '
                "bound that part by v.")
    return None


def common_reason(plant, tnl: bool, classical: str) -> str | None:
    """What stands in the way of any interval observer; ``classical``: the method without N. None if nothing does."""
    if (reason := through_reason(plant) or untold_reason(plant) or basic_reason(plant)) is not None:
        return reason
    if tnl and any(np.any(m.D) for m in plant.modes):
        return f'D is not zero; the new measurement would need the new input. Use method "{classical}".'
    if tnl and any(not np.array_equal(m.C, plant.modes[0].C) for m in plant.modes):
        return ('C differs between modes, so T + N C = I would need one N per pair of modes. Use method '
                f'"{classical}", or a common C.')
    return None


def untold_reason(plant) -> str | None:
    """Where nobody tells the mode: what stands in the way of finding it beside framers; None if nothing does."""
    if plant.switching.known:
        return None
    sliding = plant.options.get("modes") == "sliding"
    if (reason := (mode_sliding if sliding else mode_set).inapplicable(plant)) is not None:
        return f"the mode is not known at run time, and it cannot be found there: {reason}"
    own = next((m for m in plant.modes if m.theta_bounds is not None), None)
    if own is not None:
        return (f'the bounds of a parameter in mode "{own.name}" are its own, expected the same in all modes where the '
                "mode is not known. Leave them out of bounds.")
    return None


def enclosed_reason(plant) -> str | None:
    """Why a continuous plant has no discrete one with constant matrices (``plant.enclosed``); None if it has."""
    if plant.kind != "continuous":
        return None
    for mode in plant.modes:
        for name in sorted(set(mode.theta_terms) - {"A", "B"}):
            return (f'{name} of mode "{mode.name}" depends on a parameter, expected only A and B to. Take the middle '
                    "and widen the bounds of w or v by the rest.")
    for j, s in enumerate(plant.f):
        if not (np.isfinite(s.lo) and np.isfinite(s.hi)) and any(np.any(m.Bf[:, j]) for m in plant.modes):
            return (f'signals.f "{s.name}" has no range, expected range = [lo, hi]: what it does to a continuous plant '
                    "over a period is known up to a share of its size. Add one.")
    return None


def basic_reason(plant) -> str | None:
    """What stands in the way of any observer with checks of its inputs; None if nothing does."""
    if plant.n_y == 0:
        return "the plant has no output, expected at least one measured signal in signals.y."
    for vector in ("x", "u", "y"):
        for signal in getattr(plant, vector):
            if not (np.isfinite(signal.lo) and np.isfinite(signal.hi)):
                return (f'signals.{vector} "{signal.name}" has no range, expected range = [lo, hi]: rounding margins, '
                        "input checks and recovery need it. Add one.")
    return None


def candidates(plant, tnl: bool, options: dict, judge: Judge | None,
               settled: Callable[[Candidate], Array | None], progress: Callable[[str], None]) -> Iterator[Candidate]:
    """All designs that the options ask for.

    Parameters
    ----------
    plant : Plant
    tnl : bool
    options : dict
        See ``OPTIONS``; without ``criterion`` every criterion is tried.
    judge : callable or None
        Thresholds and width of given gains, for the detection design; None where the plant has no fault channel.
    settled : callable
        Candidate -> ultimate error box (start of the detection search) or None.
    progress : callable

    Raises
    ------
    DesignError
        The structure forbids any design.
    """
    problem = Problem.of(plant, tnl)
    reason = obstruction(problem)
    if reason is not None:
        raise DesignError(f"{plant.name}: {reason}")
    wanted = [options["criterion"]] if "criterion" in options else ["linf", "width", "detection"]
    boxes = []
    for name, module in (("linf", linf), ("width", width)):
        # The detection search starts from the boxes of the others, asked for or not.
        if name in wanted or "detection" in wanted:
            for c in module.candidates(problem, options if name in wanted else {}, progress):
                box = settled(c) if "detection" in wanted and judge is not None else None
                if box is not None:
                    boxes.append((judge(c.L, c.N), box))
                if name in wanted:
                    yield c
    if "detection" in wanted and judge is not None and boxes:
        starts = [min(boxes, key=lambda pair: pair[0])[1], min(boxes, key=lambda pair: pair[0][::-1])[1]]
        yield from detection.candidates(problem, options, starts[:1 + (starts[0] is not starts[1])], judge, progress)


def candidates_varying(plant, tnl: bool, options: dict, judge, settled, progress: Callable[[str], None],
                       split: bool = False) -> Iterator[Candidate]:
    """Designs of the methods that take parameters and continuous plants; arguments as ``candidates``.

    Raises
    ------
    DesignError
        The structure forbids any design.
    """
    if options.get("criterion") == "detection":
        raise DesignError(f'{plant.name}: criterion "detection" is for constant matrices per mode, expected "width" or '
                          '"linf". Without a criterion the design with the smallest surely detected fault is kept.')
    if split and options.get("criterion") == "linf":
        raise DesignError(f'{plant.name}: criterion "linf" is not to be had where entries of A - L C may have either '
                          'sign, expected "width": they carry the error of one framer to the other.')
    if plant.switching.late and options.get("criterion") == "linf":
        raise DesignError(f'{plant.name}: criterion "linf" is not to be had where the mode is told late, expected '
                          '"width": the union of two framers may be larger than either in the norm of a quadratic '
                          "function.")
    if options.get("design") == "continuous":
        yield from in_continuous_time(plant, tnl, options, progress, split)
        return
    problem = Problem.of(plant, tnl, split)
    # Of a continuous plant with measured parameters the caller tells the longest period that has a design.
    reason = None if problem.parameters and plant.kind == "continuous" else obstruction(problem)
    if reason is not None:
        raise DesignError(f"{plant.name}: {reason}")
    wanted = [options["criterion"]] if "criterion" in options else ["width", "linf"]
    if "width" in wanted:
        yield from policy.candidates(problem, options, progress)
    if plant.switching.late:
        return  # the other two criteria bound a sum of errors, which a union of two framers does not keep
    if "width" in wanted:
        yield from width.candidates(problem, options, progress)
    if "linf" in wanted and not split:
        found = False
        for c in linf.candidates(problem, options, progress):
            found = True
            yield c
        slow = None if found or "lambda" not in options or split else slow_reason(problem, float(options["lambda"]))
        if slow is not None:
            raise DesignError(f"{plant.name}: {slow}")


def in_continuous_time(plant, tnl: bool, options: dict, progress, split: bool) -> Iterator[Candidate]:
    """Designs of ``continuous``, where the plant and the method have any.

    Raises
    ------
    DesignError
    """
    if plant.kind != "continuous" or split or plant.switching.late:
        late = "a mode that is told late" if plant.switching.late else 'method "component-interval"'
        found = "a discrete plant" if plant.kind != "continuous" else late
        raise DesignError(f'{plant.name}: observer.design = "continuous" is not to be had for {found}, expected a '
                          'continuous plant and method "lpv-interval" or "tnl-interval-lpv". Use design = "sampled".')
    yield from continuous.candidates(plant, tnl, options, progress)
    if tnl and options.get("criterion") != "width" and not any(s.measured for s in plant.theta):
        yield from lipschitz.candidates(plant, options, progress)
