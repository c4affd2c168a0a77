"""Where a guarantee says little: bounds and sizes of faults that are close to what the plant file declares, or beyond.

A certificate may hold and yet be of no use: an interval as wide as the range of the state, a threshold that no fault
within its range can pass.
"""

from __future__ import annotations

import numpy as np

from ..observers import PolytopicTables
from . import words
from .design_words import bounds_states, is_filter, is_guided_filter, is_trailing, settled_width, sure_faults
from .plant_words import reach

SHARE = 0.75  # of the declared range; from there on a guarantee is called useless
TRY = "Declare less noise and disturbance or wider ranges, measure more, or try another method (residua compare)."


def warnings(design, real: str) -> tuple[str, ...]:
    """Name the guarantees that say little.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    tuple of str
        One sentence per kind of guarantee, then what to try; empty where all are well within the declared ranges.
    """
    plant, width, out = design.plant, settled_width(design, real), []
    if width is not None and bounds_states(design, real):
        out += _told("the guaranteed bounds are nearly as wide as the declared range, or wider: ",
                     [(s.name, w / reach(s)) for s, w in zip(plant.x, width)])
    what, shares = _estimated(design, real)
    out += _told(what, shares)
    largest = {f.name: max(abs(f.lo), abs(f.hi)) for f in plant.f}
    out += _told("no step is surely detected that is smaller than this share of the declared range of its fault: ",
                 [(channel, size / largest[channel]) for channel, _, size, _ in sure_faults(design, real)
                  if size is not None and np.isfinite(largest[channel])])
    return (*(f"{text}." for text in out), *(TRY,) * bool(out))


def _told(sentence: str, shares: list[tuple[str, float]]) -> list[str]:
    """The sentence with the names of the large shares."""
    large = [f"{name} {words.quantity(words.at_most(100 * share, 3), '%')}" for name, share in shares if share >= SHARE]
    return [sentence + ", ".join(large)] if large else []


def _estimated(design, real: str) -> tuple[str, list[tuple[str, float]]]:
    """What is said of estimates of faults, and of each its share of the range; none of other observers."""
    t, plant = design.observer.tables[real], design.plant
    largest = np.array([max(abs(f.lo), abs(f.hi)) for f in plant.f])
    if isinstance(t, PolytopicTables) and t.faults:
        moved = np.abs(np.asarray(plant.polytope.Df)) @ largest
        return ("what the faults do to an output is estimated to within this share of the most they can do: ",
                [(s.name, float(h) / m) for s, h, m in zip(plant.y, t.h[-1], moved) if 0 < m < np.inf])
    if is_filter(design, real):
        bound = np.asarray(t.h[-1], dtype=float).max(axis=0)
    elif is_trailing(design, real) or is_guided_filter(design):
        bound = np.asarray(t.told.h[:, -1], dtype=float).max(axis=(0, 1))
    else:
        return "", []
    return ("without any fault an estimate may reach this share of the declared range of its fault: ",
            [(f.name, b / m) for f, b, m in zip(plant.f, bound, largest) if 0 < m < np.inf])
