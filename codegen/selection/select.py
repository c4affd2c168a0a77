"""From candidates to one design: freeze each on the target's numbers, certify it, measure it, keep the best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from ..analysis.detectability import surely_detected
from ..analysis.quick import QuickJudge
from ..designs import Design, claims_of
from ..errors import CertificateError, DesignError
from ..observers import FAMILIES, Supervision
from ..periods import longest
from ..plant.model import Plant
from ..plant.uncertain import is_uncertain
from ..synthesis import METHODS, check_modes, check_options, known_options
from ..synthesis.problem import Candidate, Problem
from . import banks, filter_designs, modes, points, polytopes, sliding, trailing
from .given_gains import fixed_gains
from .trials import Trial, both_sides, certified, finite

Array = np.ndarray
WITHIN = 3  # samples after the onset, where the plant file does not say


def first_certified(plant: Plant, names: list[str], options: dict, progress: Callable[[str], None]) -> Design:
    """The first of some methods that certifies thresholds within the ranges.

    A certificate may be about thresholds that no residual within the ranges passes: then the next methods are tried,
    and the first one that certified is taken where these do no better.

    Parameters
    ----------
    plant : Plant
    names : list of str
    options : dict
    progress : callable

    Returns
    -------
    Design

    Raises
    ------
    DesignError, CertificateError
        None certifies; says what was wrong with the first.
    """
    failures, spare = [], None
    lo, hi = plant.limits("y")
    for name in names:
        try:
            design = choose(plant, name, options, progress)
        except (DesignError, CertificateError) as error:
            progress(f"{name}: {error}")
            failures.append(error)
            continue
        h = design.observer.tables[plant.target.real].h[-1]
        if np.any(h < hi - lo):
            return design
        progress(f"{name}: certified, but no residual within the ranges of y passes its thresholds")
        spare = spare or design
    if spare is not None:
        return spare
    first = failures[0]
    others = [name for name, m in METHODS.items() if name not in names and m.module.inapplicable(plant) is None]
    advice = f" Or name another method that applies: {', '.join(others)}." if others else ""
    raise type(first)(f"{first} (Tried: {', '.join(names)}.){advice}")


def choose(plant: Plant, method: str | None, options: dict, progress: Callable[[str], None]) -> Design:
    """Try what the options ask for and keep the best certified design.

    Parameters
    ----------
    plant : Plant
    method : str or None
        None: every method that applies to the plant.
    options : dict
        Of ``[observer]``.
    progress : callable
        One line per step.

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        Nothing applies, or nothing is feasible; says why.
    CertificateError
        Designs were found, but none survives rounding.
    """
    if options != plant.options:  # how it is sampled is one of them; the plant keeps its sampled form where it can
        plant = replace(plant, options=dict(options))
    if plant.polytope is not None and method is None:
        return first_certified(plant, polytopes.in_turn(plant), options, progress)
    methods = [method] if method else [name for name, m in METHODS.items() if m.automatic]
    for name in methods:
        if name not in METHODS:
            raise DesignError(f"{plant.name}: observer.method is \"{name}\", expected one of {', '.join(METHODS)}."
                              + "".join(f' Did you mean "{near}"?' for near in get_close_matches(name, METHODS, n=1)))
    if method and (reason := METHODS[method].module.inapplicable(plant)) is not None:
        raise DesignError(f'{plant.name}: method "{method}" does not apply: {reason}')
    check_options(plant.name, options, known_options(methods))
    if "modes" in options and plant.switching.known:
        raise DesignError(f"{plant.name}: observer.modes says how the mode is found, but it is told (switching.known "
                          "is true). Leave one of them out.")
    check_modes(plant.name, options, method)
    if method and METHODS[method].estimates_mode:
        make = sliding.designed if METHODS[method].family == "sliding" else modes.designed
        return make(plant, method, options, progress)
    if method and METHODS[method].family == "filter" and not plant.switching.known:
        make = sliding.guided_filter if options.get("modes") == "sliding" else trailing.designed
        return make(plant, method, options, progress)
    if method and METHODS[method].family == "bank":
        return banks.designed(plant, method, options, progress)
    if method and METHODS[method].family in ("polytopic", "descriptor"):
        return polytopes.designed(plant, method, options, progress)
    trials, reasons = [], []
    for name in methods:
        reason = METHODS[name].module.inapplicable(plant)
        if reason is not None:
            reasons.append(f"{plant.name}: method \"{name}\" does not apply: {reason}")
            continue
        try:
            trials += explore(plant, name, options, progress)
        except DesignError as error:
            reasons.append(str(error))
    if not trials:
        raise DesignError(reasons[0] if reasons else f"{plant.name}: no design was found.")
    scale = Problem.of(plant, False).f_scale
    return finish(plant, ranked(trials, options.get("criterion"), plant, scale), options, progress)


def ranked(trials: list[Trial], criterion: str | None, plant: Plant, scale: Array) -> list[Trial]:
    """Sort candidates, the best first.

    By level ("linf"), width ("width"), else by the surely detected fault. Thresholds within ten per cent of
    the best count as equal: among them a proof for any switching goes before one that needs a dwell time, and
    then the narrower interval.
    """
    faults = [t.threshold(scale) for t in trials]
    if not np.all(np.isfinite(faults)) and np.all(np.isfinite([t.searched for t in trials])):
        faults = [t.searched for t in trials]  # of one kind: a promise is larger than what the search finds
    enough = 1.1 * min(faults)

    def key(item):
        t, fault = item
        width, level = t.width(plant), t.cert["level"] if t.cert["kind"] == "linf" else np.inf
        if criterion == "linf":
            return level, t.needs_dwell, fault
        if criterion == "width":
            return width, t.needs_dwell, fault
        return (0.0, t.needs_dwell, width) if fault <= enough else (fault, t.needs_dwell, width)

    return [t for t, _ in sorted(zip(trials, faults), key=key)]


def explore(plant: Plant, name: str, options: dict, progress: Callable[[str], None]) -> list[Trial]:
    """Certified candidates of one method.

    Raises
    ------
    DesignError, CertificateError
    """
    real, within = plant.target.real, int(options.get("within", WITHIN))
    if not METHODS[name].framers:
        def tell(text: str):
            progress(f"{name}: {text}")

        found = filter_designs.explore(plant, options, tell) if METHODS[name].family == "filter" else points.explore(
            plant.enclosed, METHODS[name].module, METHODS[name].family, options, tell)
        return [Trial(name, e.candidate, e.gains, e.tables, e.cert, surely_detected(plant, e.tables, e.cert, within))
                for e in found]
    if plant.kind == "continuous" and not can_be_sampled(plant):
        raise DesignError(period_words(plant, name))
    if options.get("coordinates") == "change" and not hasattr(METHODS[name].module, "check_gains"):
        raise DesignError(f'{plant.name}: coordinates = "change" is not to be had with method "{name}", expected '
                          '"component-interval".')
    if options.get("coordinates") == "change" and plant.switching.late:
        raise DesignError(f'{plant.name}: coordinates = "change" is not to be had where the mode is told late, whose '
                          'framers are joined in x; expected switching.late = false. Use coordinates = "none".')
    if "gains" in options:
        return [fixed_gains(plant, name, options, within)]
    scale = Problem.of(plant, False).f_scale
    quick = None if is_uncertain(plant) else QuickJudge(plant, scale, within)
    trials, failure, count = [], None, 0

    def settled(c: Candidate):
        return quick.settled(quick.tables(c.L, c.N))

    def told(text: str):
        best = min((t.threshold(scale) for t in trials), default=np.inf)
        so_far = f", best threshold {best:.3g}" if np.isfinite(best) else ""
        progress(f"{name}: {text} ({len(trials)} certified{so_far})")

    for c in METHODS[name].module.candidates(plant, options=options, judge=quick if plant.f and quick else None,
                                             settled=settled, progress=told):
        count += 1
        try:
            gains = both_sides(c, plant, METHODS[name].module)
            tables, cert = certified(plant, gains, c.proof, real)
        except CertificateError as error:
            failure = error
            continue
        trials.append(Trial(name, c, gains, tables, cert, surely_detected(plant, tables, cert, within)))
    if trials:
        return trials
    if failure is not None:
        raise CertificateError(f"{plant.name}: {count} designs found, none survives rounding to {real}: {failure}")
    if plant.kind == "continuous":
        raise DesignError(period_words(plant, name))
    raise DesignError(f"{plant.name}: T A - L C can be made nonnegative in every mode, but no gains make all modes "
                      f'decay together ("{name}", {options.get("criterion", "all criteria")}). '
                      'Declare switching.average_dwell with lyapunov = "multiple", or measure another state.')


def can_be_sampled(plant: Plant) -> bool:
    """Whether the plant has a discrete form at its period at all: not where it moves by more than its own size."""
    try:
        return bool(plant.observed.modes)
    except DesignError:
        return False


def period_words(plant: Plant, name: str) -> str:
    """Say that no design holds at the sampling period, and the longest at which one does."""
    module = METHODS[name].module
    found = longest(plant, METHODS[name].tnl, getattr(module, "SPLIT", False))
    return (f'{plant.name}: time.sample_period is {plant.sample_period:g} s: method "{name}" has no design at it. '
            + (f"The longest period at which one was found is {found:.3g} s: sample at least as fast." if found else
               "None was found at shorter periods either (down to a 65000th): measure another state, or try another "
               "method."))


def supervision(plant: Plant, cert: dict) -> Supervision:
    """Alarm handling of the plant file, and the dwell monitor where the claim rests on a dwell time."""
    dwell = {}
    if cert["kind"] == "filter":
        dwell = {k: cert[k] for k in ("dwell_add", "dwell_drain", "dwell_limit")}
        dwell |= {"assures": "calibration" not in cert}
    elif cert["kind"] in ("linf", "hinf") and cert["dwell_add"] > cert["dwell_drain"] and cert["rho"] > 1:
        dwell = {"dwell_add": cert["dwell_add"], "dwell_drain": cert["dwell_drain"],
                 "dwell_limit": int(cert["chatter"] * cert["dwell_add"])}
    return Supervision.of(plant.target, **dwell)


def finish(plant: Plant, trials: list[Trial], options: dict, progress: Callable[[str], None]) -> Design:
    """Freeze the winner on both number types and collect everything for design.json."""
    best = trials[0]
    tables, certs, proved, faults = {}, {}, {}, {}
    for real in ("float32", "float64"):
        try:
            t, cert = (best.tables, best.cert) if real == plant.target.real else certified(
                plant, best.gains, best.candidate.proof, real)
        except CertificateError:
            continue  # the other number type may be too coarse; generate says so when asked for it
        tables[real], certs[real] = t, cert
        if not plant.switching.known:
            continue
        proved[real] = claims_of(plant, t, cert)
        within = int(options.get("within", WITHIN))
        faults[real] = [{"channel": f.channel, "unit": f.unit, "by_delay": [finite(x) for x in f.by_delay]}
                        for f in surely_detected(plant, t, cert, within)]
    choice = [t.summary(plant) for t in trials]
    choice[0]["chosen"] = True
    if not plant.switching.known:
        ways = ((modes.driven, modes.followed), (sliding.guided, sliding.guided_point))
        make = ways[options.get("modes") == "sliding"][METHODS[best.method].sets]
        return make(plant, best.method, tables, certs, choice, options, progress)
    family = best.cert.get("set") or METHODS[best.method].family_for(plant)
    observer = FAMILIES[family](tables, supervision(plant, certs[plant.target.real]))
    return Design(plant, best.method, observer, certs, proved, faults, choice, options)
