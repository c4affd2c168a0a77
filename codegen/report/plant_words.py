"""The plant in words: its signals with units and ranges, its modes, the bounds on what is not known."""

from __future__ import annotations

import numpy as np

from ..plant.model import Plant, Signal
from . import vertex_words, words
from .parameter_words import between, everywhere, parameter_tables, sampling_facts
from .table import Fact, Table, table


def facts(plant: Plant) -> tuple[Fact, ...]:
    """Say what kind of plant it is.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    tuple of Fact
    """
    period = f"{words.seconds(plant.sample_period)} ({plant.kind} time)"
    first = (Fact("Plant", f"{plant.title or plant.name} ({plant.name})"),
             Fact("Source", plant.source or "not given"), Fact("Sample period", period))
    if plant.polytope is not None:
        moves = (Fact("Between samples", between(plant)),) if plant.kind == "continuous" else ()
        return *first, *moves, Fact("Model", _model(plant)), *vertex_words.facts(plant)
    return (*first, *sampling_facts(plant), Fact("Model", _model(plant)), Fact("Modes", _modes(plant)),
            Fact("Switching", switching(plant)))


def _model(plant: Plant) -> str:
    sizes = [words.count(plant.n_x, "state"), words.count(plant.n_u, "input"), words.count(plant.n_y, "output"),
             words.count(plant.n_w, "disturbance"), words.count(plant.n_v, "noise channel"),
             words.count(plant.n_f, "fault channel")]
    if plant.polytope is not None:
        return f"{words.listed(sizes)}; {vertex_words.model(plant)}"
    left = "x′" if plant.kind == "continuous" else "x⁺"
    terms = words.listed(sorted({name for m in plant.modes for name in m.theta_terms}))
    several = " and " in terms
    return (f"{words.listed(sizes)}; per mode q: {left} = A x + B u + Bw w + Bf f, y = C x + D u + Dv v + Df f"
            + (f"; {terms} {'are' if several else 'is'} affine in the parameters theta" if terms else ""))


def _modes(plant: Plant) -> str:
    if plant.n_modes == 1:
        return f"one, “{plant.modes[0].name}”"
    return f"{plant.n_modes}: {words.listed(f'“{m.name}”' for m in plant.modes)}"


def switching(plant: Plant) -> str:
    """Say how the modes may follow each other.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    text : str
    """
    s = plant.switching
    if plant.n_modes == 1:
        return "none: there is one mode"
    told = "the firmware is told the mode at every sample" if s.known else "the firmware must find out the mode"
    told += ", perhaps that of the sample before" if s.late else ""
    if s.average_dwell is None:
        return f"arbitrary, as fast as every sample; {told}"
    samples = words.number(s.average_dwell / plant.sample_period)
    if s.chatter == 1:
        return f"at least {words.seconds(s.average_dwell)} ({samples} samples) between switches; {told}"
    return (f"on average {words.seconds(s.average_dwell)} ({samples} samples) or more between switches, with chatter "
            f"bound {s.chatter:g}; {told}")


def tables(plant: Plant) -> tuple[Table, ...]:
    """List the signals of the plant with its initial box, and its parameters.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    tuple of Table
    """
    rows = []
    for kind, vector in (("state", "x"), ("input", "u"), ("output", "y"), ("fault", "f")):
        for j, signal in enumerate(getattr(plant, vector)):
            rows.append((f"{kind}{words.HARD}{vector}[{j}]", signal.name, signal.unit or words.NONE,
                         words.interval(signal.lo, signal.hi, signal.unit),
                         words.interval(plant.x0_lo[j], plant.x0_hi[j], signal.unit) if vector == "x" else ""))
    signals = table("Signals and their declared ranges", ("signal", "name", "unit", "range", "at the start"), rows)
    parameters = parameter_tables(plant)
    if plant.polytope is not None:
        parameters += vertex_words.tables(plant)
    unknown = [row for vector, kind in (("w", "disturbance"), ("v", "noise")) for row in _bounds(plant, vector, kind)]
    if not unknown:
        return (signals, *parameters)
    return signals, *parameters, table("What may act at any time, within these bounds",
                                       ("signal", "name", "unit", "bounds", "where"), unknown)


def _bounds(plant: Plant, vector: str, kind: str) -> list[tuple[str, ...]]:
    """Rows of w or v: one per channel, or one per channel and mode where the bounds differ."""
    rows = []
    for j, signal in enumerate(getattr(plant, vector)):
        limits = [(float(getattr(m, f"{vector}_lo")[j]), float(getattr(m, f"{vector}_hi")[j]))
                  for m in plant.modes] or [(signal.lo, signal.hi)]
        where = [m.name for m in plant.modes] if len(set(limits)) > 1 else [everywhere(plant)]
        for (lo, hi), mode in zip(limits, where):
            rows.append((f"{kind}{words.HARD}{vector}[{j}]", signal.name, signal.unit or words.NONE,
                         words.interval(lo, hi, signal.unit), mode))
    return rows


def reach(signal: Signal) -> float:
    """Width of a declared range; NaN where there is none."""
    width = signal.hi - signal.lo
    return width if np.isfinite(width) and width > 0 else np.nan
