"""Parameters and sampling in words: what is known of theta, and what may happen between samples."""

from __future__ import annotations

import numpy as np

from ..plant.detector import fault_parameters
from ..plant.model import Plant, Signal
from . import words
from .table import Fact, Table, table

SCHEMES = {
    "exponential": "the whole series of the transition over a period, to the last digits",
    "second-order": "the series of the transition over a period up to its second order",
    "euler": "the Euler step",
}


def parameter_tables(plant: Plant) -> tuple[Table, ...]:
    """List the parameters with bounds, rates and errors; none where the plant has no parameters.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    tuple of Table
    """
    rows = []
    for j, s in enumerate(plant.theta):
        limits = limits_of(plant, j)
        where = [m.name for m in plant.modes] if len(set(limits)) > 1 else [everywhere(plant)]
        known = f"yes, to within {words.quantity(words.number(s.error), s.unit)}" if s.error else "yes"
        for (lo, hi), mode in zip(limits, where):
            rows.append((s.name, words.interval(lo, hi, s.unit), mode,
                         known if s.measured else "no", _rate(s) if np.isfinite(s.rate) else "any: it may jump"))
    often = "sample" if plant.kind == "discrete" else "instant"
    notes = ("A measured parameter is an input of the firmware (in->theta); a value beyond its bounds, error included, "
             f"is refused. One that is not measured may be anything within its bounds, and another at every {often}.",)
    return (table("Parameters of the matrices", ("theta", "bounds", "where", "measured", "fastest change"), rows,
                  notes),) if rows else ()


def everywhere(plant: Plant) -> str:
    """What holds in all of a plant."""
    return "every mode" if plant.modes else "every vertex"


def limits_of(plant: Plant, j: int) -> list[tuple[float, float]]:
    """Bounds of a parameter in every mode."""
    s = plant.theta[j]
    own = [m.theta_bounds for m in plant.modes] or [None]
    return [(s.lo, s.hi) if b is None else (float(b[0][j]), float(b[1][j])) for b in own]


def _rate(s: Signal) -> str:
    return words.quantity(words.number(s.rate), f"{s.unit}/s" if s.unit else "per s")


def sampling_facts(plant: Plant) -> tuple[Fact, ...]:
    """Say how a continuous plant becomes a discrete one, and what is assumed between samples.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    tuple of Fact
        Empty for a discrete plant.
    """
    if plant.kind != "continuous":
        return ()
    scheme = plant.options.get("sampling", "exponential")
    how = (f"“{scheme}”: {SCHEMES[scheme]}; what that leaves out is bounded in ball arithmetic and part of the "
           "constants, so the guarantee is about the continuous plant")
    facts = [Fact("Sampling", how), Fact("Between samples", between(plant))]
    if any(s.measured for s in plant.theta):
        facts.append(Fact("Parameters of a step", "the mean of the measurements at both its ends"
                          if plant.reads_both_ends else "the measurement at its start"))
    return tuple(facts)


def between(plant: Plant) -> str:
    """Say what may move between samples."""
    held = [s.name for s in plant.u if not s.rate]
    parts = [f"{words.listed(held)} {'is' if len(held) == 1 else 'are'} held"] if held else []
    parts += [f"{s.name} moves by at most {_rate(s)}" for s in plant.u if s.rate]
    moving = [what for what, some in (("disturbances", plant.w), ("parameters", plant.theta)) if some]
    free = [f"{words.listed(moving)} move as they like within their bounds"
            + (" and rates" if any(np.isfinite(s.rate) for s in plant.theta) else "")] if moving else []
    when = "at samples only" if plant.switching.known else "at any instant"
    return "; ".join([*parts, *([f"the mode changes {when}"] if plant.n_modes > 1 else []), *free])


def of_a_step(plant: Plant) -> str:
    """Say of which equation A and B are in constants of the C; nothing of a discrete plant, which has but one."""
    return ", with A and B of a step from sample to sample" if plant.kind == "continuous" else ""


def assumed(plant: Plant) -> tuple[str, ...]:
    """State what is assumed of parameters and of the time between samples."""
    items = []
    for j, s in enumerate(plant.theta):
        limits = limits_of(plant, j)
        where = words.interval(*limits[0], s.unit) if len(set(limits)) == 1 else "; ".join(
            f"{words.interval(lo, hi, s.unit)} in mode “{m.name}”" for (lo, hi), m in zip(limits, plant.modes))
        speed = f"changes by at most {_rate(s)}" if np.isfinite(s.rate) else "may jump"
        known = ("is measured without error" if not s.error else
                 f"is measured to within {words.quantity(words.number(s.error), s.unit)}") if s.measured else (
                     "is not measured")
        items.append(f"The parameter {s.name} is in {where}, {speed}, and {known}.")
    if plant.kind == "continuous":
        items.append(f"Between samples: {between(plant)}.")
    return tuple(items)


def detector_words(plant: Plant) -> str:
    """Say which second observer sees the component faults that this one bears; empty where none may be."""
    faults = fault_parameters(plant)
    if not faults:
        return ""
    verb = "stands" if len(faults) == 1 else "stand"
    return (f" Where {words.listed(faults)} {verb} for faults, a second observer sees what this one bears: that of the "
            "plant with these bounds at zero, codegen.plant.detector.detector(plant). Run both, "
            "this one for the bounds and the other for the alarm.")


def not_guaranteed(plant: Plant) -> tuple[str, ...]:
    """State what parameters and sampling leave open."""
    items = []
    if any(not s.measured for s in plant.theta):
        names = words.listed(s.name for s in plant.theta if not s.measured)
        items.append(f"That a change of {names} is noticed: the observer is made to bear every one within the bounds. "
                     "Nothing watches these bounds: outside them there is no guarantee, and “assured” may stay."
                     + detector_words(plant))
    if any(s.measured for s in plant.theta):
        rates = plant.kind == "continuous" and any(np.isfinite(s.rate) for s in plant.theta if s.measured)
        items.append("Anything while a measured parameter is off by more than its error"
                     f"{' or moves faster than its rate' if rates else ''}: at run time only its bounds are checked.")
    if plant.kind == "continuous":
        items.append("The state bounds between samples. They hold at the samples.")
    return tuple(items)
