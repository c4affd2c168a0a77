"""Validation in words: every scenario, every fault, and whether each promise was kept."""

from __future__ import annotations

import numpy as np

from ..analysis.mode_promise import due, within_range
from ..analysis.validate import Episode, Outcome
from . import words
from .design_words import (
    NEVER,
    bounds_states,
    finds_mode,
    hides,
    is_bank,
    is_filter,
    is_polytopic,
    settled_width,
    sure_faults,
)
from .table import Cell, Folded, Table, table, verdict

FEW = 6  # episodes that are shown without a click


def validation_table(outcomes: list[Outcome]) -> Table:
    """List what each scenario gave.

    Parameters
    ----------
    outcomes : list of Outcome

    Returns
    -------
    Table
    """
    rows = []
    for o in outcomes:
        found = sum(e.delay is not None for e in o.episodes)
        record = is_record(o)
        rows.append((o.scenario.name, "record" if record else "simulated", words.integer(len(o.trace.status)),
                     verdict(not o.differences, "equal (==)", "DIFFERS: " + ", ".join(o.differences)),
                     Cell("not known", "num") if record else _none(o.lost),
                     Cell(f"{words.integer(o.chance)} (none promised)", "num") if o.chance else _none(o.false_alarms),
                     f"{found} of {len(o.episodes)}" if o.episodes else words.NONE,
                     words.share(int(o.trace.assured.sum()), len(o.trace.assured)),
                     verdict(o.passed, "passed", "FAILED")))
    notes = ("C = reference: every number of the compiled C equals that of the numpy reference. Lost: samples without "
             "fault at which a true state was outside its bounds; a record has no true state to compare with. Assured: "
             "samples at which the firmware says that its guarantee is in force; it is not during an alarm, for the "
             "hold time after it, and (with a latch) until the alarm is acknowledged.",)
    head = ("scenario", "kind", "#samples", "C = reference", "#lost", "#false alarms", "#faults found", "#assured",
            "result")
    return table("Scenarios, run on the compiled C", head, rows, notes)


def _none(n: int) -> Cell:
    """A count that must be zero."""
    return Cell(words.integer(n), "num ok" if n == 0 else "num bad")


def is_record(outcome: Outcome) -> bool:
    """Whether the outputs were recorded, so that the true state is not known."""
    return bool(np.isnan(outcome.truth.x).all())


def threshold(design, real: str, e: Episode) -> float | None:
    """Surely detected size of the episode's channel; None where no size is."""
    return next(size for channel, _, size, _ in sure_faults(design, real) if channel == e.channel)


def promise(design, real: str, outcome: Outcome, e: Episode) -> tuple[int | None, str]:
    """Delay within which this fault was bound to be found.

    Parameters
    ----------
    design : Design
    real : str
    outcome : Outcome
    e : Episode

    Returns
    -------
    samples : int or None
        None: nothing is promised.
    reason : str
        Why nothing is promised; empty where something is.
    """
    names = [f.name for f in design.plant.f]
    f, trace, width = outcome.truth.f, outcome.trace, settled_width(design, real)
    if any(np.any(f[e.start:e.stop, j] != 0) for j, name in enumerate(names) if name != e.channel):
        return None, "several faults at once"
    if is_bank(design, real):
        return None, "the thresholds are calibrated"
    if finds_mode(design, real):
        return _leaves_no_mode(design, real, outcome, e)
    before = e.start - 1
    if is_filter(design, real):
        wide = not np.all(trace.f_bound[e.start] <= design.observer.tables[real].h[-1, outcome.truth.q[e.start]])
    elif is_polytopic(design, real):
        wide = not trace.settled[e.start]
    else:
        wide = width is None or np.any(trace.x_hi[e.start] - trace.x_lo[e.start] > width)
    if wide or e.start == 0 or not (trace.assured[before] and outcome.settled[before]):
        return None, "the observer had not settled"
    values = f[e.start:e.stop, names.index(e.channel)]
    by_delay = next(x for x in design.detection[real] if x["channel"] == e.channel)["by_delay"]
    reason = "below the threshold"
    for d, size in enumerate(by_delay):
        if size is None or abs(values[0]) < size:
            continue
        step, measured = values[:d + 1], ~np.isnan(trace.numbers()[-2][e.start:e.start + d + 1])
        if len(step) == d + 1 and np.all(step == step[0]) and measured.all():
            t, at = design.observer.tables[real], slice(e.start, e.start + d + 1)
            far = bounds_states(design, real) and np.any((trace.x_hi[at] <= t.x_lo) | (trace.x_lo[at] >= t.x_hi))
            return (None, "a bound on the far end of the range") if far and hides(design, real, e.channel) else (d, "")
        reason = "too short, no step, or a sample is missing"
    if np.any(values != values[0]):
        reason = "no step"
    return None, reason


def _leaves_no_mode(design, real: str, outcome: Outcome, e: Episode) -> tuple[int | None, str]:
    """As ``promise``, where the firmware finds the mode."""
    size = threshold(design, real, e)
    if size is None:
        return None, "no size is promised"
    cert, channels = design.certificate[real], tuple(f.name for f in design.plant.f)
    inside = within_range(design.plant, outcome.truth)
    for k, sure in due(design.plant.kind, channels, cert, outcome.truth, outcome.trace, outcome.settled, inside):
        if k == e.start and sure["channel"] == e.channel:
            return sure["within"], ""
    if abs(outcome.truth.f[e.start, channels.index(e.channel)]) < size:
        return None, "below the threshold"
    return None, "no step, a switch or an alarm too near, or a sample is missing"


def kept(design, real: str, outcome: Outcome, e: Episode) -> bool:
    """Whether a fault was found as early as promised (or nothing was promised)."""
    limit, _ = promise(design, real, outcome, e)
    return limit is None or (e.delay is not None and e.delay <= limit)


def episode_tables(design, real: str, outcome: Outcome) -> tuple[tuple[Table, ...], tuple[Folded, ...]]:
    """List the faults of a scenario: shown where they are few, else folded.

    Parameters
    ----------
    design : Design
    real : str
    outcome : Outcome

    Returns
    -------
    shown : tuple of Table
    folded : tuple of Folded
    """
    if not outcome.episodes:
        return (), ()
    units = {f.name: f.unit for f in design.plant.f}
    period, rows = design.plant.sample_period, []
    for e in outcome.episodes:
        (limit, reason), size, unit = promise(design, real, outcome, e), threshold(design, real, e), units[e.channel]
        rows.append((e.channel, f"{e.start} – {e.stop - 1}", f"{words.number(e.start * period, 6)}{words.THIN}s",
                     words.quantity(words.number(e.size), unit),
                     NEVER if size is None else words.quantity(words.at_most(size), unit),
                     f"nothing: {reason}" if limit is None else words.within(limit, period),
                     _found(words.delay(e.delay, period), e.delay is not None, kept(design, real, outcome, e))))
    head = ("fault", "samples", "#from", "#size", "#surely detected from", "promised", "found")
    result = table(f"Faults of “{outcome.scenario.name}”", head, rows)
    if len(rows) <= FEW:
        return (result,), ()
    return (), (Folded(f"All {len(rows)} faults one by one", (result,)),)


def _found(delay: str, found: bool, good: bool) -> Cell:
    return Cell(delay, "ok" if found else "") if good else Cell(f"{delay}: PROMISE BROKEN", "bad")


def summary(design, outcome: Outcome) -> str:
    """Tell in a sentence how a scenario went."""
    period, steps = design.plant.sample_period, len(outcome.trace.status)
    text = (f"{words.count(steps, 'sample')} ({words.seconds(steps * period)}), "
            f"{'a record' if is_record(outcome) else 'simulated'}.")
    alarms = outcome.false_alarms + outcome.chance
    alarms = words.count(alarms, "false alarm") if alarms else "no false alarm"
    if not outcome.episodes:
        return f"{text} No fault, {alarms}."
    faults = words.count(len(outcome.episodes), "fault")
    return f"{text} {faults}, {_when(outcome, period)}; {alarms}.{_fooled(outcome)}"


def _when(outcome: Outcome, period: float) -> str:
    """How many of the faults were found, and how late."""
    delays = [e.delay for e in outcome.episodes if e.delay is not None]
    if not delays:
        return "none found"
    many = len(outcome.episodes) > 1
    some = f"{len(delays)} of them " if len(delays) < len(outcome.episodes) else "all " if many else ""
    first, last = words.delay(min(delays), period), words.delay(max(delays), period)
    if first != last:
        return f"{some}found, the delays from {first} to {last}"
    return f"{some}found {first}" if max(delays) == 0 else f"{some}found after {first}"


def _fooled(outcome: Outcome) -> str:
    """Tell of samples at which an unseen fault made the firmware sure of wrong bounds."""
    o, fault = outcome, np.any(outcome.truth.f != 0, axis=1)
    if not o.trace.bounded:
        return ""
    outside = np.any((o.truth.x > o.trace.x_hi) | (o.truth.x < o.trace.x_lo), axis=1)
    n = int(np.sum(fault & outside & o.trace.assured))
    if n == 0:
        return ""
    return (f" While the fault acted, a state was outside bounds called “assured” at {words.count(n, 'sample')}: the "
            "fault was no longer, or not yet, visible in the measurements.")
