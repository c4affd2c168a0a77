"""A mode estimator in words: by when each switch is known, and the constants that the C holds."""

from __future__ import annotations

import numpy as np

from . import words
from .table import Cell, Folded, Table, table

#: What the declared range of the state is for, by kind of the certificate.
RANGE = {"mode": "is where the boxes start again after a fault.",
         "sliding": "is what is answered from a detection until a mode is taken up, and where the bounds start then."}


def dwell(cert: dict, period: float) -> str:
    """Say how far apart switches have to be, for what.

    Parameters
    ----------
    cert : dict
    period : float

    Returns
    -------
    text : str
    """
    least = words.delay(cert["dwell"], period)
    if cert["kind"] == "sliding":
        return f"Switches are at least {least} apart: nothing watches that, and what is said of the alarm rests on it."
    return (f"Switches are at least {words.delay(cert['ages'] + 1, period)} apart: nothing watches that, and all "
            f"bounds rest on it. The delays rest on {least}.")


def delays(design, real: str) -> tuple[Table, ...]:
    """Tabulate the certified delays; nothing of other observers.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    tuple of Table
    """
    cert, plant = design.certificate[real], design.plant
    if cert["kind"] != "mode":
        return ()
    T, names = plant.sample_period, [m.name for m in plant.modes]
    rows = [(names[i], names[j], words.delay(cert["old"][i][j], T), words.delay(cert["identified"][i][j], T))
            for i in range(len(names)) for j in range(len(names)) if i != j]
    rows.append(("power-up", "any", words.NONE, words.delay(cert["start"], T)))
    wherever = ", wherever it falls between two samples," if plant.kind == "continuous" else ""
    notes = (f"From the switch at the latest{wherever} if switches are at least "
             f"{words.delay(cert['dwell'], T)} apart and no measurement is missing. The true mode is in the set all "
             f"the time, also where switches are only {words.delay(cert['ages'] + 1, T)} apart.",)
    head = ("from", "to", "#old mode ruled out", "#mode right")
    return (table("How soon the firmware knows the mode, proved", head, rows, notes),)


def smallest_promises(design, real: str) -> dict[str, dict]:
    """The promise of the smallest size, by channel, where the firmware finds the mode.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    """
    promised = sorted(design.certificate[real].get("faults", ()), key=lambda f: -f["size"])
    return {f["channel"]: f for f in promised}


def detection(design, real: str) -> Table:
    """Tabulate the faults that leave no mode possible, and say of the others that nothing is promised.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    Table
    """
    plant, cert = design.plant, design.certificate[real]
    sure, T, rows = cert.get("faults", ()), plant.sample_period, []
    for signal in plant.f:
        name = signal.name, words.interval(signal.lo, signal.hi, signal.unit)
        own = [f for f in sure if f["channel"] == signal.name]
        for f in own:
            size = words.at_most(f["size"]) + (f" to {words.at_least(f['upto'])}" if "upto" in f else "")
            size = Cell(words.quantity(size, signal.unit), "num")
            rows.append((*name, size, words.within(f["within"], T), words.delay(f["after"], T)))
        if not own:
            rows.append((*name, Cell("no size is promised", "num warn"), words.NONE, words.NONE))
    held = ("A step of this size or more (or between these sizes), of either sign, leaves no mode possible within this "
            "time, if it lasts as long, begins so long after power-up and the last switch, the mode stays, no alarm "
            "came before, no measurement is missing and x is within its range.")
    if plant.kind == "continuous" and any(plant.acts_on_state(f["channel"]) for f in sure):
        held += " One that moves the state has to begin at a sample."
    notes = [held] * bool(sure)
    if len({f["channel"] for f in sure}) < plant.n_f:
        notes.append("Where no size is promised a fault may pass for a change of the mode, or for a decision that is "
                     "not right; it is often found all the same.")
    head = ("fault", "declared range", "#size", "#found", "#earliest, after a switch")
    return table("Smallest fault that is surely detected", head, rows, notes)


def switching(cert: dict) -> str:
    """Say for which switching the set of modes is proved."""
    when = cert.get("switches", "at any instant")
    return (f"a mode that nobody tells, switching {when}, at least {cert['ages'] + 1} samples apart (for the "
            f"delays: {cert['dwell']} samples)")


def gains(design, real: str, matrix, whose: str = "") -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, exactly, one fold per mode.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    matrix : callable
        (title, row names, column names, values) -> Table.
    whose : str
        What the titles of the folds begin with.

    Returns
    -------
    tuple of Folded
    """
    t, plant = design.observer.tables[real], design.plant
    xi, u = [f"xi[{i}]" for i in range(plant.n_x)], [s.name for s in plant.u]
    folds = []
    for q, mode in enumerate(plant.modes):
        tables = [matrix("Phi: a period of the mode", xi, xi, t.Phi[q])]
        tables += [matrix("Gamma: inputs over a period", xi, u, t.Gamma[q])] * bool(u)
        tables.append(matrix("What is added, and what disturbances and rounding reach", xi, ["shift", "reach"],
                             np.stack([t.shift[q], t.reach[q]], axis=1)))
        for j, other in enumerate(plant.modes):
            if j != q:
                tables.append(matrix(f"A switch to {other.name} within the period: J, J_shift, J_reach, birth", xi,
                                     [*xi, "J_shift", "J_reach", "birth"],
                                     np.column_stack([t.J[q, j], t.J_shift[q, j], t.J_reach[q, j], t.birth[q, j]])))
        folds.append(Folded(f"{whose}Mode {q}, “{mode.name}”", tuple(tables)))
    coordinates = matrix("xi = S x", xi, [s.name for s in plant.x], t.S)
    noise = matrix("Bounds of y - D u - C x", [s.name for s in plant.y], ["v_lo", "v_hi"],
                   np.stack([t.v_lo, t.v_hi], axis=1))
    return (*folds, Folded(f"{whose}Coordinates and noise", (coordinates, noise)))
