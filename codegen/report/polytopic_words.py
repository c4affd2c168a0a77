"""A polytopic observer in words: level, steps, thresholds, and the constants that the C holds."""

from __future__ import annotations

import numpy as np

from . import words
from .table import Fact, Folded, Table, table

LIMITS = (
    "The estimate itself: its error has a certified energy gain from inputs and disturbances, no bound at each sample.",
    "That the alarm lasts as long as the fault: it lasts as long as a residual exceeds its bound. Where all have come "
    "back the thresholds restart from the declared ranges, and the estimate goes on.",
    "Which fault it is, where several can act: every fault may move every residual.")


def facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of a polytopic observer beside what is said of every design.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    cert, plant = design.certificate[real], design.plant
    T = words.seconds(plant.sample_period)
    if plant.kind != "continuous":
        steps = "none: plant and observer step alike"
    elif cert["limit"] is None:
        steps = f"explicit Euler; the observer was designed for the plant's own steps of {T}"
    else:
        steps = (f"explicit Euler, {T}; the observer's own steps decay below {words.seconds(cert['limit'])} while the "
                 "weights stand still, and at the period of the firmware the recursion is certified anew")
    return (Fact("Weights", f"{len(plant.polytope.vertices)} vertices, at the estimate: the proof is for all weights "
                 "of plant and observer, however they move"),
            Fact("Energy gain from inputs and disturbances", f"certified {words.at_most(cert['level'], 4)} on the "
                 f"constants of the C; the solver claimed {words.number(cert['claimed'], 4)} before rounding and "
                 "steps"),
            Fact("Steps", steps),
            Fact("Threshold", "guaranteed, not calibrated: the error is followed over every input, disturbance and "
                 "weight within the declared ranges (peak to peak), between samples too, with the rounding of the C"))


def tables(design, real: str) -> tuple[Table, ...]:
    """Thresholds once settled, beside what some sequence of weights and disturbances makes of the residual.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    t, plant = design.observer.tables[real], design.plant
    reached = design.certificate[real]["thresholds"]["reached"]
    rows = [(s.name, words.quantity(words.at_most(float(t.h[-1, i])), s.unit),
             words.quantity(words.number(reached[i]), s.unit), words.interval(s.lo, s.hi, s.unit))
            for i, s in enumerate(plant.y)]
    notes = (f"Once settled: {words.count(t.last << t.shift, 'sample')} after a start from anywhere in the declared "
             "range, before that the thresholds are higher. The third column is what the error model reaches with some "
             "sequence of weights, inputs and disturbances: no threshold of this model could be below.",)
    head = ("residual", "#largest without a fault, proved", "#reached by the model", "range of y")
    return (table("Thresholds of the decision", head, rows, notes),)


def gains(design, real: str, matrix) -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, one fold per vertex; ``matrix`` is (title, rows, columns, values).

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    matrix : callable
    """
    t, plant = design.observer.tables[real], design.plant
    x, u, y = ([s.name for s in getattr(plant, vector)] for vector in "xuy")
    z = [f"z[{i}]" for i in range(len(x))]
    folds = []
    for j, vertex in enumerate(plant.polytope.vertices):
        shown = (("F", "of x_hat", x, t.F[j]), ("G", "of u", u, t.G[j]), ("K", "of −r", y, t.K[j]))
        folds.append(Folded(f"Vertex {j}, “{vertex.name}”", tuple(matrix(f"{name}: {meaning}", z, columns, values)
                                                                  for name, meaning, columns, values in shown
                                                                  if np.any(values))))
    own = [matrix("x_hat = z + T2 y", x, y, t.T2), matrix("C", y, x, t.C),
           matrix("Limits of z", z, ["from", "to"], np.column_stack([t.z_lo, t.z_hi]))]
    own += [matrix("M: weight of the residual", y, y, t.M)] * t.weighted
    return (*folds, Folded("All vertices", tuple(own)))
