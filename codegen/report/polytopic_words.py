"""A polytopic observer in words: level, steps, thresholds, and the constants that the C holds."""

from __future__ import annotations

import numpy as np

from ..observers import DescriptorTables
from . import words
from .table import Fact, Folded, Table, table

LIMITS = (
    "The estimate itself: its error has a certified energy gain from inputs and disturbances, no bound at each sample.",
    "That the alarm lasts as long as the fault: it lasts as long as a residual exceeds its bound. Where all have come "
    "back the thresholds restart from the declared ranges, and the estimate goes on.",
    "Which fault it is, where several can act: every fault may move every residual.")
GUARANTEED = ("guaranteed, not calibrated: the error is followed over every input, disturbance and weight within the "
              "declared ranges (peak to peak), between samples too, with the rounding of the C")


def facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of a polytopic observer beside what is said of every design.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    cert, plant, law = design.certificate[real], design.plant, design.observer.tables[real].law
    if "slow" in cert:
        return fault_facts(design, real)
    T, of = words.seconds(plant.sample_period), "inputs and disturbances"
    if law is not None:
        of = "disturbances and noises to the tracking error"
        steps = f"second order, {T}; what they miss of the continuous plant is bounded and borne by the ranges"
    elif plant.kind != "continuous":
        steps = "none: plant and observer step alike"
    elif cert["limit"] is None:
        steps = f"explicit Euler; the observer was designed for the plant's own steps of {T}"
    else:
        steps = (f"explicit Euler, {T}; the observer's own steps decay below {words.seconds(cert['limit'])} while the "
                 "weights stand still, and at the period of the firmware the recursion is certified anew")
    return (Fact("Weights", f"{len(plant.polytope.vertices)} vertices, at the estimate: the proof is for all weights "
                 "of plant and observer, however they move"),
            Fact(f"Energy gain from {of}", f"certified {words.at_most(cert['level'], 4)} on the "
                 "constants of the C" + ("" if law is not None else "; the solver claimed "
                                         f"{words.number(cert['claimed'], 4)} before rounding and steps")),
            Fact("Steps", steps),
            *solved_facts(design, real),
            Fact("Threshold", GUARANTEED if "calibration" not in cert else calibrated(cert["calibration"])),
            *law_facts(design, real))


def calibrated(c: dict) -> str:
    """What is said of thresholds that come from runs.

    Parameters
    ----------
    c : dict
        "calibration" of a certificate.
    """
    before = "what no measurement exceeds" if c["guaranteed"] is None else "guaranteed thresholds"
    return (f"calibrated, not guaranteed: the largest residuals of {words.count(c['runs'], 'simulated run')} "
            "without fault; a false alarm in a further one has a probability of at most "
            f"{words.number(c['probability'], 3)}, with {words.number(100 * c['confidence'], 4)} % confidence. Before "
            f"it has settled nothing is judged below {before}")


def solved_facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of algebraic equations that the observer solves itself.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    t, plant = design.observer.tables[real], design.plant
    if not isinstance(t, DescriptorTables):
        return ()
    named = ", ".join(plant.x[k].name for k in t.algebraic)
    division = (f"one division by a mean of the pivots of the vertices, which is at least "
                f"{words.number(float(t.pivot.min()), 3)}" if t.uneven else "no division: all vertices have one pivot")
    return (Fact("Algebraic states", f"{named}: solved at every sample from the other states and the inputs, "
                 f"whether or not an output sees them, by what was made offline and {division}"),)


def law_facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of the tracking law, where there is one.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    law, plant = design.observer.tables[real].law, design.plant
    if law is None:
        return ()
    refs = ", ".join(f"{plant.y[i].name} {words.quantity(words.number(float(most)), plant.y[i].unit)}"
                     for i, most in zip(law.rows, law.reference))
    factor = design.certificate[real]["loop"]["decay"]["factor"]
    return (Fact("Tracking law", f"references up to {refs}; plant, observer and law together shrink by "
                 f"{words.number(factor, 4)} per sample, for all weights; without a fault no input saturates and no "
                 "state leaves its range, whatever the references do within these sizes"),)


def fault_facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of an observer of states and faults.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    cert, plant = design.certificate[real], design.plant
    rate = "/s" if plant.kind == "continuous" else " per sample"
    slow = "; ".join(f"{name} by {words.number(mode, 4)}{rate}" for name, mode in cert["slow"])
    known = f" and {words.count(len(plant.polytope.known), 'known term')}" if plant.polytope.known else ""
    weights = (f"{len(plant.polytope.vertices)} vertices{known}, of inputs, parameters and outputs that are exact: "
               "those of the plant")
    level = ()
    if "energy" in cert:
        weights = (f"{len(plant.polytope.vertices)} vertices, at the estimate, which a sensor's fault does not move: "
                   "the proof is for all weights of plant and observer, however they move")
        level = (Fact("Energy gain from inputs, disturbances and faults to the error of the faults",
                      f"certified {words.at_most(cert['level'], 4)} on the constants of the C; the solver claimed "
                      f"{words.number(cert['claimed'], 4)} before rounding"),)
    bounds = ("guaranteed, with and without faults: y − C x_hat is what the faults do to y, and no further from it "
              "than r_bound; the error is followed over every input, disturbance and weight within the declared "
              "ranges, with the rounding of the C")
    return (Fact("Estimated", f"{words.count(plant.n_f, 'fault')} behind the states in x_hat, however they move: no "
                 "model of a fault is part of the observer"),
            Fact("Weights", weights), *level,
            Fact("Steps", f"explicit Euler, {words.seconds(plant.sample_period)}; what the plant does beside them is "
                 "part of the bounds" if plant.kind == "continuous" else "none: plant and observer step alike"),
            *((Fact("Slower than the decay asked for, and moved by no observer", slow),) if slow else ()),
            Fact("Bounds", bounds if "calibration" not in cert else calibrated(cert["calibration"])))


def tables(design, real: str) -> tuple[Table, ...]:
    """Thresholds once settled, beside what some sequence of weights and disturbances makes of the residual.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    t, plant, cert = design.observer.tables[real], design.plant, design.certificate[real]
    if "calibration" in cert:
        rows = [(s.name, words.quantity(words.number(float(h)), s.unit), words.interval(s.lo, s.hi, s.unit))
                for s, h in zip(plant.y, t.h[-1])]
        return (table("Thresholds of the decision", ("residual", "#calibrated", "range of y"), rows, ()),)
    reached = cert["thresholds"]["reached"]
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
    u, y = ([s.name for s in getattr(plant, vector)] for vector in "uy")
    x = [s.name for s in plant.estimated(len(t.T2))]
    z = [f"z[{i}]" for i in range(len(x))]
    folds = []
    for j, vertex in enumerate(plant.polytope.vertices):
        shown = (("F", "of x_hat", x, t.F[j]), ("G", "of u", u, t.G[j]), ("K", "of −r", y, t.K[j]))
        folds.append(Folded(f"Vertex {j}, “{vertex.name}”", tuple(matrix(f"{name}: {meaning}", z, columns, values)
                                                                  for name, meaning, columns, values in shown
                                                                  if np.any(values))))
    solves = isinstance(t, DescriptorTables)
    if solves:
        named = [x[k] for k in t.algebraic]
        folds += [Folded(f"Algebraic states at vertex {j}, pivot {words.number(float(d), 6)}",
                         (matrix("P: of z", named, x, P), matrix("Q: of u", named, u, Q)))
                  for j, (P, Q, d) in enumerate(zip(t.P, t.Q, t.pivot))]
    own = [] if solves else [matrix("x_hat = z + T2 y", x, y, t.T2)]
    own += [matrix("C", y, x, t.C),
           matrix("Limits of z", z, ["from", "to"], np.column_stack([t.z_lo, t.z_hi]))]
    own += [matrix("M: weight of the residual", y, y, t.M)] * t.weighted
    folds.append(Folded("All vertices", tuple(own)))
    if t.law is not None:
        refs = [y[i] for i in t.law.rows]
        folds += [Folded(f"Law at vertex {j}", (matrix("Kx: of x_hat", u, x, Kx), matrix("Ki: of s", u, refs, Ki)))
                  for j, (Kx, Ki) in enumerate(zip(t.law.Kx, t.law.Ki))]
    return tuple(folds)
