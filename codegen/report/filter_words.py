"""A fault estimation filter in words: its constants, and how sharp level and thresholds are."""

from __future__ import annotations

import numpy as np

from . import words
from .table import Fact, Folded, Table, table


def facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of a filter beside what is said of every design."""
    cert, plant = design.certificate[real], design.plant
    parts = [f"certified {words.at_most(cert['level'], 4)} on the constants of the C"]
    if cert.get("reached"):
        parts.append(f"a run was found that reaches {words.number(cert['reached'], 4)}: no proof could go below that")
    if "pairs" in cert:
        parts.append(f"gains for each pair of modes, which the projections allow, could not come below "
                     f"{words.number(cert['pairs'], 4)} (the solver's word): the C has one set per mode")
    target = "the fault itself" if "target" not in plant.options else "the fault, weighted by W_f (target)"
    weight = "" if "colour" not in plant.options else "; disturbances, noises and inputs are weighted by W_d (colour)"
    scaled = ("the estimate is scaled so that a lasting fault is met exactly while a mode stays",) * bool(cert["post"])
    missed = tuple(f"next to nothing is in it of fault {name}" for name in cert.get("missed", ()))
    return (Fact("Estimate", "; ".join([f"{target}{weight}", *scaled, *missed])),
            Fact("Energy gain from all unknowns to the error of the estimate", "; ".join(parts)),
            Fact("Threshold", threshold(cert)))


def threshold(cert: dict) -> str:
    """Whether thresholds are guaranteed or calibrated, and what that means."""
    c = cert.get("calibration")
    if c is None:
        return ("guaranteed, not calibrated: the estimate of a plant without fault is followed over "
                "every disturbance, input, parameter and mode sequence (peak to peak), with the rounding of the C")
    chance, sure = (words.quantity(words.number(100 * c[name]), "%") for name in ("probability", "confidence"))
    return (f"calibrated, not guaranteed: from {words.count(c['runs'], 'simulated run')} without fault. In a further "
            f"run like these a false alarm has a probability of at most {chance}, with {sure} confidence. Runs like "
            f"these: {'; '.join(c['conditions'])}. “assured” is never set")


def tables(design, real: str) -> tuple[Table, ...]:
    """Thresholds by mode once settled, beside what runs without a fault reach."""
    t, plant = design.observer.tables[real], design.plant
    reached = np.array(design.certificate[real]["set_of_both"]["reached"])
    calibration, rows = design.certificate[real].get("calibration"), []
    proved = t.h[-1].astype(float) if calibration is None else np.array(calibration["guaranteed"])
    for q, mode in enumerate(plant.modes):
        for j, fault in enumerate(plant.f):
            own = () if calibration is None else (words.quantity(words.number(float(t.h[-1, q, j])), fault.unit),)
            rows.append((mode.name, fault.name, *own, words.quantity(words.at_most(float(proved[q, j])), fault.unit),
                         words.quantity(words.number(float(reached[q, j])), fault.unit)))
    notes = (f"Once settled: {words.count(t.lost << t.shift, 'sample')} after a start from anywhere in the declared "
             f"range, {words.count((t.last - t.lost) << t.shift, 'sample')} after one without measurement; before that "
             "the thresholds are higher. The last column is what some fault-free run reaches: a lower threshold would "
             "be a false alarm there.",)
    head = ("mode", "fault", *["#threshold, calibrated"] * (calibration is not None),
            "#largest estimate without a fault, proved", "#reached by a run")
    return (table("Thresholds of the decision", head, rows, notes),)


def gains(design, real: str, matrix, t=None) -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, one fold per mode; ``matrix`` is (title, rows, columns, values).

    ``t`` are those of the filters, by default the design's.

    Returns
    -------
    tuple of Folded
    """
    t, plant = t or design.observer.tables[real], design.plant
    u, y, f = ([s.name for s in getattr(plant, vector)] for vector in "uyf")
    xi = [f"xi[{i}]" for i in range(len(t.limit))]
    shown = (("M", "of the filter", xi, xi), ("G", "gain on u", xi, u), ("L", "gain on y", xi, y),
             ("K", "estimate from xi", f, xi), ("Du", "estimate from u", f, u), ("Dy", "estimate from y", f, y))
    return tuple(Folded(f"Mode {q}, “{mode.name}”", tuple(
        matrix(f"{name}: {meaning}", rows, columns, getattr(t, name)[q]) for name, meaning, rows, columns in shown
        if np.any(getattr(t, name)[q]))) for q, mode in enumerate(plant.modes))
