"""A mode estimator by sliding modes in words: what was measured of its decision, and the constants that the C holds."""

from __future__ import annotations

import numpy as np

from . import words
from .table import Cell, Folded, Table, table

CRITERION = ("least levels of Theorem 12 within the limit of the gains; the levels do not say how well modes are told "
             "apart")
NOT_GUARANTEED = (
    "The mode. The decision is right most of the time in the cases measured, and may be wrong in any other; “assured” "
    "is 0 at every sample.",
    "The state bounds while the decision is not that of the true mode: after a switch that is not noticed yet they "
    "may be those of the old mode.",
    "That a fault raises the alarm. Without one there is no alarm as long as the mode keeps its dwell time; a fault "
    "may well pass for a mode.")
FALSE = ("That an alarm means a fault: while the decision is not that of the true mode the measurements may contradict "
         "it. The bit for two changes within a dwell time alone is never false.")


def tables(design, real: str) -> tuple[Table, ...]:
    """Tabulate what was measured over noise and period, and what is proved of the widths.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    tuple of Table
    """
    cert, plant = design.certificate[real], design.plant
    rows = []
    for c in cert["measured"]:
        longest = Cell("not before the next switch", "num warn") if c["missed"] else Cell(_time(c["longest"]), "num")
        rows.append((words.seconds(c["period"]), f"{c['noise']:g}", words.integer(c["switches"]), _time(c["median"]),
                     longest, Cell(words.integer(c["missed"]), "num warn" if c["missed"] else "num"),
                     words.share(c["wrong"], 1)))
    head = ("sampling period", "#noise, of the declared", "#switches", "#median delay", "#longest delay",
            "#switches missed", "#samples with a wrong mode")
    notes = ("Measured, not proved: the reference was run over random switching, at any instant, one to two and a half "
             "dwell times apart, disturbances at their bounds, parameters anywhere but constant, uniform noise; the "
             "same gains at each period. A delay lasts until the mode is right for good. Other inputs, faults or "
             "switching may do worse.",)
    measured = table("How soon the decision is right, and how often wrong: as measured", head, rows, notes)
    width = [(m.name, *(words.at_most(a + b) for a, b in zip(*e))) for m, e in zip(plant.modes, cert["errors"])]
    notes = ("Approached while the mode is the true one and stays; from a detection until the mode is taken up "
             f"({words.delay(cert['blank'] + 1, plant.sample_period)}) the bounds are the declared range.",)
    head = ("mode", *(f"#{s.name}" for s in plant.x))
    proved = table("How wide the bounds become, proved", head, width, notes)
    return measured, *_paced(cert), proved


def _paced(cert: dict) -> tuple[Table, ...]:
    """Tabulate what was measured of an observer in the mode decided for; nothing of an estimator alone."""
    if "paced" not in cert:
        return ()
    rows = [(words.seconds(c["dwell"]), words.integer(c["switches"]), _time(c["median"]),
             Cell("not before the next switch", "num warn") if c["missed"] else Cell(_time(c["longest"]), "num"),
             *(words.quantity(words.at_most(100 * c[key], 2), "%") for key in ("wrong", "alarms", "lost")))
            for c in cert["paced"]]
    head = ("least dwell time", "#switches", "#median delay", "#longest delay", "#samples with a wrong mode",
            "#samples with a false alarm", "#samples with a lost state")
    notes = ("Measured, not proved: the whole observer at its own period and noise, no fault, otherwise as above. "
             "Every alarm is a false one: the observer of a mode that is true no more contradicts the measurement.",)
    return (table("What wrong decisions do to the bounds and alarms: as measured", head, rows, notes),)


def not_guaranteed(cert: dict) -> tuple[str, ...]:
    """List what is not guaranteed."""
    return (*NOT_GUARANTEED, *(FALSE,) * ("told" in cert))


def _time(seconds: float | None) -> str:
    """A delay; the sign for none where there is no number."""
    return words.NONE if seconds is None else words.milliseconds(seconds)


def switching(cert: dict) -> str:
    """Say for which switching something is proved."""
    alarm = "the alarm's bit for two changes" if "told" in cert else "the alarm"
    return (f"a mode that nobody tells, switching at any instant: nothing of the decision; {alarm}, for switches at "
            f"least {cert['dwell']} samples apart; the bounds, while the decision is right")


def gains(design, real: str, matrix, of: str = "") -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, exactly, one fold per mode.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    matrix : callable
        (title, row names, column names, values) -> Table.
    of : str
        What the titles begin with.

    Returns
    -------
    tuple of Folded
    """
    t, plant, cert = design.observer.tables[real], design.plant, design.certificate[real]
    x, u, y = ([s.name for s in getattr(plant, vector)] for vector in "xuy")
    folds = []
    for q, mode in enumerate(plant.modes):
        found = [matrix("G: inputs over a period", x, u, t.G[q])] * bool(u)
        for side, name in (("hi", "upper"), ("lo", "lower")):
            M, L, d = (getattr(t, f"{k}_{side}")[q] for k in "MLd")
            found += [matrix(f"M of the {name} bounds", x, x, M),
                      matrix(f"L of the {name} bounds held for a period, its origin in continuous time, d", x,
                             [*y, *(f"{s} (continuous)" for s in y), "d"],
                             np.column_stack([L, np.array(cert[f"L_{side}"][q]), d]))]
        folds.append(Folded(f"{of}Mode {q}, “{mode.name}”", tuple(found)))
    noise = matrix("Bounds of y - D u - C x", y, ["v_lo", "v_hi"], np.stack([t.v_lo, t.v_hi], axis=1))
    loops = matrix("Loops and decision", ["value"], ["tau k2", "tau k1", "smooth", "share", "blank", "dwell"],
                   np.array([[t.turn, t.pull, t.smooth, t.share, t.blank, t.dwell]], dtype=float))
    return (*folds, Folded(f"{of}noise, loops and decision" if of else "Noise, loops and decision", (noise, loops)))
