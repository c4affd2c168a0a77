"""The design in words: what was chosen and why, what is proved, for what, and what is not."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

import numpy as np

from ..analysis.detectability import limited, ultimate_errors
from ..certify.claims import ultimate_width
from ..observers import BankTables, FilterTables, PointTables, PolytopicTables, TrailingTables
from . import (
    bank_words,
    filter_words,
    mode_words,
    parameter_words,
    polytopic_words,
    sliding_words,
    trailing_words,
    words,
)
from .plant_words import reach
from .table import Cell, Fact, Folded, Row, Table, table

NEVER = "not at any size"
SHOWN = 8  # rows of the table of what was tried; the others are folded

WHY = {
    "linf": "the one with the lowest certified level on the framer error was kept",
    "width": "the one with the narrowest guaranteed bounds was kept",
    "": "the one with the smallest surely detected fault was kept (the worst channel counts, relative to its declared "
        "range); thresholds within 10 % count as equal, then a proof for any switching goes before one with a dwell "
        "time, then narrower bounds before wider ones",
}


@dataclass(frozen=True)
class DesignWords:
    """What the report says of a design, for one number type."""

    facts: tuple[Fact, ...]
    choice: Table
    others: tuple[Folded, ...]
    proved: tuple[str, ...]
    bounds: tuple[Table, ...]
    assumed: tuple[str, ...]
    not_guaranteed: tuple[str, ...]
    detection: tuple[Table, ...]


def words_of(design, real: str) -> DesignWords:
    """Say what is to be said of a design.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    DesignWords
    """
    choice, others = _choice(design)
    return DesignWords(_facts(design, real), choice, others, tuple(_sentence(c) for c in design.claims(real)),
                       _bounds(design, real), _assumed(design, real), _not_guaranteed(design, real),
                       _detection(design, real))


def _sentence(claim: str) -> str:
    """A claim with a capital, if it begins with a word and not with a symbol, and a full stop."""
    first = claim.split(" ", 1)[0]
    return (claim[:1].upper() + claim[1:] if first.rstrip(":").isalpha() else claim).rstrip(".") + "."


def proved_switching(cert: dict) -> str:
    """Say for which switching the certificate's level holds."""
    if cert["kind"] == "mode":
        return mode_words.switching(cert)
    if cert["kind"] == "sliding":
        return sliding_words.switching(cert)
    if cert["kind"] in ("polytopic", "bank"):
        return "any weights of the vertices, as they move with the state and as the estimate takes them"
    if cert["kind"] == "filter" and cert["dwell_add"]:
        tau, chatter = cert["dwell_add"] / cert["dwell_drain"], cert["dwell_limit"] / cert["dwell_add"]
    elif cert["kind"] != "linf" or limited(cert) is None:
        return "any switching, as fast as every sample"
    else:
        tau, chatter = limited(cert)
    return (f"switching with an average dwell time of at least {tau:g} samples and chatter bound {chatter:g}; the "
            "firmware watches it and withdraws “assured” when it is faster")


def is_point(design, real: str) -> bool:
    """Whether the observer is an estimate with a set of errors, and no pair of framers."""
    return isinstance(design.observer.tables[real], PointTables)


def _facts(design, real: str) -> tuple[Fact, ...]:
    criterion = design.options.get("criterion", "")
    own = filter_words.facts(design, real) if is_filter(design, real) else ()
    own = polytopic_words.facts(design, real) if is_polytopic(design, real) else own
    own = bank_words.facts(design, real) if is_bank(design, real) else own
    own = trailing_words.facts(design, real) if is_trailing(design, real) or is_guided_filter(design) else own
    tried = words.count(len(design.choice), "certified design")
    if "gains" in design.options:
        why = "the gains were given in the plant file; they were certified, not chosen"
    elif design.certificate[real]["kind"] == "sliding" and "told" not in design.certificate[real]:
        why = sliding_words.CRITERION
    elif design.certificate[real]["kind"] == "mode" and "told" not in design.certificate[real]:
        why = "there is nothing to choose but how many ages are told apart: the fewest that can be certified"
    elif is_trailing(design, real) or is_guided_filter(design):
        why = trailing_words.WHY
    elif is_polytopic(design, real) or is_bank(design, real):
        why = "there is one design: the lowest level within the bounds of gain and decay"
    elif len(design.choice) == 1:
        why = "one design was certified; there was nothing to choose from"
    elif not design.plant.f and not criterion:
        why = f"of {tried}, the narrowest was kept: there is no fault channel"
    else:
        why = f"of {tried}, {WHY.get(criterion, WHY[''])}"
        why += "; compared as if the mode were told" * ("told" in design.certificate[real])
    asked = f"“{criterion}” was asked for" if criterion else "none was asked for"
    return (Fact("Method", f"{design.method}: {_family(design)}{_varying(design, real)}"), *own,
            Fact("Criterion", f"{asked}; {why}"),
            Fact("Proved for", proved_switching(design.certificate[real])
                 + ("; the parameters anywhere within their bounds" if design.plant.theta else "")),
            Fact("Arithmetic", f"{real}; the proof is about the rounded constants and covers all rounding at run time"))


def _family(design) -> str:
    """What the firmware computes, in the words of the family's own documentation."""
    text = (inspect.getdoc(inspect.getmodule(type(design.observer))) or design.observer.family).splitlines()[0]
    return text.split(":", 1)[-1].strip().rstrip(".")


def _varying(design, real: str) -> str:
    """What is added for parameters and unknowns."""
    vary = design.observer.tables[real].vary
    if vary is None or is_polytopic(design, real) or is_bank(design, real):
        return ", with weights that read measured parameters" * (vary is not None)
    told = getattr(design.observer.tables[real], "told", design.observer.tables[real])
    parts = ["constants affine in the measured parameters"] * bool(vary.parameters)
    parts += ["radii for what is only bounded"] * bool(np.any(vary.R) or np.any(vary.S))
    parts += ["bounds of z = Z x, of which those of x are made"] * (told.change is not None)
    parts += ["each entry of T A − L C on the bound that its sign asks for"] * told.signed
    return f", with {words.listed(parts)}" if parts else ""


def _choice(design) -> tuple[Table, tuple[Folded, ...]]:
    """What was tried, best first."""
    promised = any(size is not None for entry in design.choice for size in entry["surely_detected"])
    channels = design.plant.f if promised else ()
    head = ("method", "design", *(f"#{f.name}" for f in channels), "#relative width", "#level")
    rows: list[Row] = []
    for entry in design.choice:
        faults = [words.quantity(words.at_most(x), f.unit) if x is not None else NEVER
                  for x, f in zip(entry["surely_detected"], channels)]
        label = entry["design"] + (" (chosen)" if entry["chosen"] else "")
        cells = (entry["method"], label, *faults, words.at_most(entry["relative_width"], 3),
                 words.at_most(entry["level"]))
        kinds = ("", "", *["num"] * (len(cells) - 2))
        rows.append(Row(tuple(Cell(c, k) for c, k in zip(cells, kinds)), "chosen" if entry["chosen"] else ""))
    notes = ("Columns named after a fault: the smallest step of it that is surely detected. " * promised
             + "Relative width: guaranteed ultimate width of the states, each in units of its declared range, summed"
             + (" (of the observer told its mode)" if finds_mode(design, design.plant.target.real) else "")
             + ". Level: of the criterion that gave the design; not to be compared between criteria.",)
    rest = rows[SHOWN:]
    others = f"{words.count(len(rest), 'other design')} that {'was' if len(rest) == 1 else 'were'} tried"
    folded = (Folded(others, (table("The others, best first", head, rest),)),) if rest else ()
    return table("What was tried, best first", head, rows[:SHOWN], notes), folded


def settled_width(design, real: str) -> np.ndarray | None:
    """Guaranteed width of each state once the framers have settled; None where none is proved."""
    cert = design.certificate[real]
    width, errors = ultimate_width(cert), ultimate_errors(cert)
    if width is not None:
        return np.array(width)
    return None if errors is None else errors[0] + errors[1]


def _bounds(design, real: str) -> tuple[Table, ...]:
    if is_filter(design, real):
        return filter_words.tables(design, real)
    if is_unproved(design, real):
        own = sliding_words.tables(design, real)
        if is_guided_filter(design):
            own += (trailing_words.thresholds(design, real, "where its state has left its limits"),)
        return own
    if is_polytopic(design, real):
        return polytopic_words.tables(design, real)
    if is_bank(design, real):
        return bank_words.tables(design, real)
    if is_trailing(design, real):
        return trailing_words.bounds(design, real)
    width = settled_width(design, real)
    if width is None:
        return mode_words.delays(design, real)
    rows = []
    for signal, w in zip(design.plant.x, width):
        part = w / reach(signal)
        share = words.quantity(words.at_most(100 * part, 3), "%")
        rows.append((signal.name, words.quantity(words.at_most(w), signal.unit),
                     words.interval(signal.lo, signal.hi, signal.unit), share,
                     Cell("wider than the range: says nothing new", "warn") if part >= 1 else ""))
    head = ("state", "#proved width at most", "declared range", "#share of the range", "remark")
    head, rows = (head, rows) if any(row[-1] for row in rows) else (head[:-1], [row[:-1] for row in rows])
    return (table("How wide the bounds can be, once settled", head, rows),)


def _assumed(design, real: str) -> tuple[str, ...]:
    plant, tables = design.plant, design.observer.tables[real]
    told = "that of the sample or of the one before" if plant.switching.late else "the true one"
    given = f"the mode given to the firmware is {told}" if plant.switching.known else "nobody tells its mode"
    given = f"; {given}" if plant.modes else ""
    items = [f"The plant is the one of the plant file, with no fault acting{given}.",
             f"There is one call of step or predict every {words.seconds(plant.sample_period)}.",
             "At init the state is in its initial box; at all times it is in its declared range. The range "
             + ("cuts the bounds at every call." if tables.clamp else
                mode_words.RANGE[design.certificate[real]["kind"]] if finds_mode(design, real) else
                "is where the estimate and its set restart after a fault." if isinstance(tables, PointTables) else
                "is where the thresholds restart after a fault." if not bounds_states(design, real) else
                "is where the bounds restart after a fault, and cuts them while a measurement is missing."),
             "Disturbance and noise keep to the bounds listed above."]
    items += parameter_words.assumed(plant)
    if finds_mode(design, real):
        items.append(mode_words.dwell(design.certificate[real], plant.sample_period))
    if design.observer.supervision.monitors_dwell:
        items.append("The modes switch slowly enough on average; this is watched at run time.")
    items.append("Arithmetic is IEEE 754, rounding to nearest, with subnormal numbers.")
    return tuple(items)


_FILTER_LIMITS = (
    "That the estimate is the fault at every sample: the energy gain bounds the error over a run, started from rest.",
    "That the alarm lasts as long as the fault: it lasts as long as the estimate exceeds its bound. Where the estimate "
    "has come back the thresholds restart from the declared ranges, and the estimate goes on.",
    "Which fault it is, where several can act: every fault may move every estimate.")


def _limits(design, point: bool) -> tuple[str, ...]:
    """What observers with bounds of the state do not guarantee."""
    return ("The state bounds while a fault acts. A fault too small to be seen can act while “assured” is set: it "
            "means that nothing measured contradicts the assumptions.",
            "That the alarm lasts as long as the fault. After an alarm the observer restarts from the declared ranges "
            "and may then take a constant fault for part of the plant"
            + ("; the latched bits remember it." if design.observer.supervision.latch else "."),
            "Which fault it is. The alarm says that no mode explains the measurements, not why."
            if design.certificate[design.plant.target.real]["kind"] == "mode" else
            "Which fault it is. An alarm bit says which output left its bounds"
            + (" (the last one: all of them together), not why." if point and design.plant.n_y > 1 else ", not why."))


def _not_guaranteed(design, real: str) -> tuple[str, ...]:
    debounce, point = design.observer.supervision.debounce, is_point(design, real)
    sure = any(size is not None for _, _, size, _ in sure_faults(design, real))
    items = ["That a fault below the thresholds is found. It may be, or may not." if sure else
             "That a fault is found, of whatever size. It may be, or may not.",
             *(_FILTER_LIMITS if is_filter(design, real) else polytopic_words.LIMITS if is_polytopic(design, real)
               else (*sliding_words.not_guaranteed(design.certificate[real]),
                     *trailing_words.LIMITS[1:2] * is_guided_filter(design)) if is_unproved(design, real)
               else bank_words.LIMITS if is_bank(design, real)
               else trailing_words.LIMITS if is_trailing(design, real) else _limits(design, point)),
             *["Detection of faults that drift slowly or act together: the thresholds are for one step on one channel, "
               "with the observer settled before it."] * sure, *parameter_words.not_guaranteed(
                 design.plant, "thresholds" if is_filter(design, real) else "state bounds")]
    if debounce != (1, 1):
        items.append("The delays below for the debounced alarm: they count to the first sample outside its bounds; the "
                     f"alarm itself wants {debounce[0]} of {debounce[1]} samples.")
    if design.certificate[real]["kind"] == "none":
        items.append("Any level on the width: the gains given were certified for containment alone.")
    return tuple(items)


def is_filter(design, real: str) -> bool:
    """Whether the firmware estimates faults, without bounds of the state."""
    return isinstance(design.observer.tables[real], FilterTables)


def is_unproved(design, real: str) -> bool:
    """Whether the firmware decides for a mode of which nothing is proved."""
    return design.certificate[real]["kind"] == "sliding"


def finds_mode(design, real: str) -> bool:
    """Whether the firmware is not told its mode."""
    return design.certificate[real]["kind"] in ("mode", "sliding")


def sure_faults(design, real: str) -> list[tuple[str, str, float | None, int]]:
    """List channel, unit, the size that is surely detected (None: no size is) and within how many samples.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    list of tuple
        Where the firmware finds the mode: of a step while the mode stays.
    """
    own = {name: (f["size"], f["within"]) for name, f in mode_words.smallest_promises(design, real).items()}
    out = []
    for fault in design.detection[real]:
        size = fault["by_delay"][-1]
        found = own.get(fault["channel"], (size, 0 if size is None else fault["by_delay"].index(size)))
        out.append((fault["channel"], fault["unit"], *found))
    return out


def is_polytopic(design, real: str) -> bool:
    """Whether the firmware is an observer with weights, without bounds of the state."""
    return isinstance(design.observer.tables[real], PolytopicTables)


def is_trailing(design, real: str) -> bool:
    """Whether the firmware estimates faults in a mode that it finds itself."""
    return isinstance(design.observer.tables[real], TrailingTables)


def is_guided_filter(design) -> bool:
    """Whether the firmware estimates faults in a mode of which nothing is proved."""
    return design.observer.family == "guided_filter"


def is_bank(design, real: str) -> bool:
    """Whether the firmware is a bank of observers, without bounds of the state."""
    return isinstance(design.observer.tables[real], BankTables)


def bounds_states(design, real: str) -> bool:
    """Whether the firmware answers with bounds of the state."""
    return not (is_filter(design, real) or is_polytopic(design, real) or is_bank(design, real))


def varies(design, real: str) -> bool:
    """Whether the constants depend on parameters or have radii."""
    own = is_polytopic(design, real) or is_bank(design, real)  # their weights alone read some
    return not own and design.observer.tables[real].vary is not None


def hides(design, real: str, channel: str) -> bool:
    """Whether a fault can hide behind the cut to the declared range (``analysis.robust``): one on the state can."""
    j = [f.name for f in design.plant.f].index(channel)
    return varies(design, real) and any(np.any(m.Bf[:, j]) for m in design.plant.modes)


def _detection(design, real: str) -> tuple[Table, ...]:
    """Thresholds per channel and delay."""
    faults = design.detection[real]
    if not faults:
        return (table("Smallest fault that is surely detected", ("fault",), [("the plant file declares none",)]),)
    if finds_mode(design, real):
        return (mode_words.detection(design, real),)
    period = design.plant.sample_period
    longest = max(len(f["by_delay"]) for f in faults)
    head = ["fault", "declared range", *(f"#{words.within(d, period)}" for d in range(longest))]
    rows: list[list] = []
    warned = False
    for fault, signal in zip(faults, design.plant.f):
        largest = max(abs(signal.lo), abs(signal.hi))
        cells = [fault["channel"], words.interval(signal.lo, signal.hi, signal.unit)]
        for size in fault["by_delay"]:
            beyond = size is not None and size > largest
            warned |= beyond
            text = NEVER if size is None else words.quantity(words.at_most(size), fault["unit"])
            cells.append(Cell(text + (" *" if beyond else ""), "num warn" if beyond or size is None else "num"))
        rows.append(cells)
    where = "the residual outside its set" if is_point(design, real) else "an output outside its bounds"
    courses = "mode sequence that the certificate admits" if design.plant.polytope is None else "course of the weights"
    none = all(size is None for fault in faults for size in fault["by_delay"])
    notes = [] if none else [
        f"A step of this size or more, of either sign, puts {where} within this time, whatever the disturbance, the "
        f"noise and the {courses}. The delay counts from the first sample of the fault; “at once” is that sample "
        "itself."]
    if varies(design, real) and not none:
        notes.append("Parameters and unknowns move the errors too: these thresholds bound every path of theta and "
                     "every unknown at once, over all modes. They are safe and may be larger than need be."
                     + (" For a fault that acts on the state they hold while no bound is on the far end of the "
                        "declared range, x_hi on the least or x_lo on the largest value: the state then is so close "
                        "to that end that the fault can hide in the cut."
                        if any(hides(design, real, f["channel"]) for f in faults) else ""))
    known = is_point(design, real) or design.observer.family == "filter"
    if known and design.plant.kind == "continuous" and any(np.any(m.Bf) for m in design.plant.modes):
        notes.append("What a fault on the state does within a sample is bounded for its declared range: no size beyond "
                     f"that is promised to be found (“{NEVER}”).")
    notes += ["* larger than the declared range of the fault"] * warned
    return (table("Smallest fault that is surely detected", head, rows, notes),)
