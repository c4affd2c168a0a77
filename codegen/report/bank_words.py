"""A bank of observers in words: members, thresholds and where they come from, who raises whom, constants of the C."""

from __future__ import annotations

import numpy as np

from ..certify.bank import isolable
from . import words
from .table import Fact, Folded, Table, table

LIMITS = (
    "That there is no false alarm: the thresholds are calibrated by runs without fault. “Assured” is never set.",
    "That a fault is named as long as it acts: it is named while all observers but its own are raised.",
    "Two faults at once. They raise observers that no single fault raises, or all; then none is named.")


def facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of a bank beside what is said of every design.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    c, t, T = design.certificate[real]["calibration"], design.observer.tables[real], design.plant.sample_period
    steps = "in Euler steps, certified as stepped" if design.plant.kind == "continuous" else "in discrete time"
    return (Fact("Observers", f"{len(t.members)}, each without the sensors of one fault, which cannot move it; "
                 f"designed for sensitivity to the others against disturbance, {steps}"),
            Fact("Averages", f"of the weighted residuals, time constant {words.seconds(T / t.rate)}; an alarm holds "
                 f"for {words.seconds(T * t.keep)}"),
            Fact("Threshold", f"calibrated, not guaranteed: above the largest of {c['runs']} runs without fault, of "
                 f"{words.count(c['steps'], 'sample')} each. A further run of this kind raises an alarm with "
                 f"probability {c['probability']:g} at most; confidence {words.number(c['confidence'], 4)}"),
            Fact("Kind of these runs", "; ".join(c["conditions"])),
            Fact("Start", f"judged after {words.count(t.begin, 'sample')} at init, after "
                 f"{words.count(t.settle, 'sample')} from anywhere in the declared range"),
            Fact("Lost samples", f"bridged: the last measurement stands in. Each has to be paid for by {t.gap} "
                 f"measured ones, of which enough for {t.bridge} are counted at most; else all observers start anew"))


def tables(design, real: str) -> tuple[Table, ...]:
    """Levels and thresholds of the members, and which of them a fault raises.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    t, plant, cert = design.observer.tables[real], design.plant, design.certificate[real]
    rows = [(f.name, ", ".join(plant.y[i].name for i in m.seen), words.number(np.sqrt(float(b)), 4),
             words.number(own["gamma"] / own["beta"], 4), words.quantity(words.at_most(size), f.unit))
            for f, m, b, own, size in zip(plant.f, t.members, t.bound, cert["members"], isolable(plant, t, cert))]
    head = ("observer without", "reads", "#threshold", "#disturbance over fault, certified",
            "#constant fault named from")
    notes = ("Disturbance over fault: energy gain from inputs and disturbances in units of their bounds, over the "
             "smallest settled response to a constant fault in units of its range. Last column: every other observer "
             "hears twice its threshold then.",)
    raised = [(f.name, *("raised" if r else "quiet" for r in row)) for f, row in zip(plant.f, t.incidence)]
    return (table("Observers and thresholds", head, rows, notes),
            table("Which observers a fault raises", ("fault", *(f"without {f.name}" for f in plant.f)), raised))


def gains(design, real: str, matrix) -> tuple[Folded, ...]:
    """Tabulate the constants of the C, one fold per observer; ``matrix`` is (title, rows, columns, values).

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    matrix : callable
    """
    t, plant = design.observer.tables[real], design.plant
    x, u, z = [s.name for s in plant.x], [s.name for s in plant.u], [f"z[{i}]" for i in range(plant.n_x)]
    folds = []
    for fault, m in zip(plant.f, t.members):
        y = [plant.y[i].name for i in m.seen]
        own = [matrix("x_hat = z + T2 y", x, y, m.T2), matrix("C", y, x, m.C),
               matrix("M: weight of the residual", [f"row {i}" for i in range(len(m.M))], y, m.M)]
        for j, vertex in enumerate(plant.polytope.vertices):
            own += [matrix(f"{name} of vertex “{vertex.name}”: {meaning}", z, columns, values[j])
                    for name, meaning, columns, values in (("F", "of x_hat", x, m.F), ("G", "of u", u, m.G),
                                                           ("K", "of −r", y, m.K)) if np.any(values[j])]
        folds.append(Folded(f"Observer without the sensors of “{fault.name}”", tuple(own)))
    return tuple(folds)
