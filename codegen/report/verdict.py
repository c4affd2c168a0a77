"""The headline: what the firmware does and whether it passed, for someone who reads nothing else."""

from __future__ import annotations

from dataclasses import dataclass

from ..analysis.validate import Outcome
from . import firmware_words, outcome_words, words
from .design_words import (
    bounds_states,
    finds_mode,
    is_bank,
    is_filter,
    is_guided_filter,
    is_polytopic,
    is_trailing,
    is_unproved,
    sure_faults,
)
from .little_words import warnings
from .table import Fact


@dataclass(frozen=True)
class Verdict:
    """The headline's parts; ``kind`` is a CSS class ("ok", "bad" or "warn"), ``figures`` the tiles below it.

    ``warnings`` name the guarantees that say little.
    """

    kind: str
    word: str
    purpose: str
    result: str
    figures: tuple[Fact, ...]
    warnings: tuple[str, ...]


def verdict(design, real: str, record: dict, outcomes: list[Outcome]) -> Verdict:
    """Sum everything up.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    record : dict
        Contents of resources.json; may be empty.
    outcomes : list of Outcome

    Returns
    -------
    Verdict
    """
    complaints = [text for o in outcomes for text in _complaints(design, real, o)]
    figures = _figures(design, real, record, outcomes)
    little = tuple(text[0].upper() + text[1:] for text in warnings(design, real))
    if not outcomes:
        text = "The plant file has no scenario that could be run."
        return Verdict("warn", "Not validated", purpose(design), text, figures, little)
    if complaints:
        text = f"{'; '.join(complaints)}. Do not use this firmware."
        return Verdict("bad", "Validation failed", purpose(design), text[0].upper() + text[1:], figures, little)
    samples = sum(len(o.trace.status) for o in outcomes)
    found = [e for o in outcomes for e in o.episodes if e.delay is not None]
    injected = sum(len(o.episodes) for o in outcomes)
    simulated = [o for o in outcomes if not outcome_words.is_record(o)]
    chance = sum(o.chance for o in outcomes)
    allowed = "decisions that are not right" if is_unproved(design, real) else "calibrated thresholds"
    parts = ["the compiled C agrees with the reference in every bit",
             f"{words.count(chance, 'sample')} with an alarm without a fault, as {allowed} allow"
             if chance else "no false alarm"]
    if simulated and bounds_states(design, real):
        right = " while the decision was right" if is_unproved(design, real) else ""
        parts.insert(1, f"no true state outside its bounds{right} "
                     f"({words.count(len(simulated), 'simulated scenario')})")
    steered = sum(o.steering is not None for o in outcomes)
    if steered:
        parts.append(f"{words.count(steered, 'run')} in the loop with the true plant kept to the certificate")
    text = f"In {words.count(len(outcomes), 'scenario')} with {words.count(samples, 'sample')}: {words.listed(parts)}."
    if injected:
        promised = any(outcome_words.promise(design, real, o, e)[0] is not None for o in outcomes for e in o.episodes)
        text += f" {len(found)} of {words.count(injected, 'fault')} found; " + (
            "none was later than promised." if promised else "of none was it promised.")
    return Verdict("ok", "Validation passed", purpose(design), text, figures, little)


def purpose(design) -> str:
    """Say in a sentence what the firmware does.

    Parameters
    ----------
    design : Design

    Returns
    -------
    text : str
    """
    plant = design.plant
    read = plant.theta if design.observer.tables[plant.target.real].vary is not None else ()
    outputs = words.listed(dict.fromkeys(s.name for s in (*plant.y, *read) if s.measured))
    if is_filter(design, plant.target.real):
        faults = words.listed(s.name for s in plant.f)
        assures = design.observer.supervision.assures
        when = ("only where the estimate cannot be explained without a fault" if assures else
                "where the estimate exceeds thresholds that were calibrated by simulation")
        return (f"This firmware watches “{plant.title or plant.name}”. Every {words.seconds(plant.sample_period)} it "
                f"reads {outputs}, answers with an estimate of {faults}, and raises an alarm {when}.")
    if is_unproved(design, plant.target.real):
        modes = words.listed(m.name for m in plant.modes)
        bounds = (f"; in that mode it answers with bounds on {words.listed(s.name for s in plant.x)}, and raises an "
                  "alarm where the measurements contradict it") * (design.observer.family in ("guided", "guided_point"))
        if is_guided_filter(design):
            bounds = (f"; in that mode it answers with an estimate of {words.listed(s.name for s in plant.f)}, and "
                      "raises an alarm where that cannot be explained without a fault")
        return (f"This firmware watches “{plant.title or plant.name}”. Every {words.seconds(plant.sample_period)} it "
                f"reads {outputs} and decides which of the modes {modes} is active, without a guarantee{bounds}.")
    if is_bank(design, plant.target.real):
        faults = words.listed([f.name for f in plant.f])
        return (f"This firmware watches “{plant.title or plant.name}”. Every {words.seconds(plant.sample_period)} it "
                f"reads {outputs}, and names the fault that is to blame, if one of {faults} is.")
    states = words.listed(s.name for s in plant.x)
    if is_polytopic(design, plant.target.real):
        when = ("only where a residual cannot be explained without a fault" if design.observer.supervision.assures else
                "where a residual exceeds thresholds that were calibrated by simulation")
        law = design.observer.tables[plant.target.real].law
        steers = "" if law is None else (f"steers {words.listed(plant.y[i].name for i in law.rows)} to references by "
                                         f"{words.listed(s.name for s in plant.u)}, ")
        return (f"This firmware watches “{plant.title or plant.name}”. Every {words.seconds(plant.sample_period)} it "
                f"reads {outputs}, {steers}answers with an estimate of {states}, and raises an alarm {when}.")
    if is_trailing(design, plant.target.real):
        states = f"{states}, with an estimate of {words.listed(s.name for s in plant.f)} in the mode that it finds"
    return (f"This firmware watches “{plant.title or plant.name}”. Every {words.seconds(plant.sample_period)} it reads "
            f"{outputs}, answers with guaranteed bounds on {states}, and raises an alarm only when the measurements "
            "cannot be explained without a fault.")


def _complaints(design, real: str, o: Outcome) -> list[str]:
    name, out = f"“{o.scenario.name}”", []
    if o.differences:
        out.append(f"in {name} the compiled C differs from the reference in {words.listed(o.differences)}")
    if o.lost:
        out.append(f"in {name} a state was outside its bounds at {words.count(o.lost, 'sample')}")
    if o.late:
        out.append(f"in {name} a mode was decided for too long at {words.count(o.late, 'sample')}")
    if o.false_alarms:
        out.append(f"in {name} there were {words.count(o.false_alarms, 'false alarm')}")
    if o.steering is not None:
        out += [f"in {name} {broken}" for broken in o.steering.broken]
    late = [e for e in o.episodes if not outcome_words.kept(design, real, o, e)]
    if late:
        out.append(f"in {name} {words.count(len(late), 'fault')} promised to be found in time went unseen")
    return out


def _figures(design, real: str, record: dict, outcomes: list[Outcome]) -> tuple[Fact, ...]:
    """The tiles: scenarios passed, surely detected faults, cost."""
    passed = sum(o.passed for o in outcomes)
    figures = [Fact("scenarios passed", f"{passed} of {len(outcomes)}")] if outcomes else []
    for channel, unit, size, delay in sure_faults(design, real):
        if size is None:
            figures.append(Fact(f"{channel}: no fault surely detected", "none"))
            continue
        when = words.within(delay, design.plant.sample_period) + " while the mode stays" * finds_mode(design, real)
        figures.append(Fact(f"smallest surely detected {channel} fault, {when}",
                            words.quantity(words.at_most(size), unit)))
    return (*figures, *firmware_words.tiles(record))
