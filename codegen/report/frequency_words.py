"""Where in frequency a polytopic observer sees faults, in words and as a plot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..analysis.frequency import Responses, frequency_figure, responses
from ..observers import BankTables, PolytopicTables
from . import words
from .plots import inline
from .table import Plot

TEXT = ("With the weights held at one vertex the residual is a linear function of what drives it. Inputs are in units "
        "of their largest sizes, the residual is that of the firmware. ")
CAPTION = ("One line per vertex, plant and observer computed side by side at the period of the firmware. What is "
           "proved above holds for weights that move.")


@dataclass(frozen=True)
class FrequencyWords:
    """What the report says of frequencies."""

    text: str
    plots: tuple[Plot, ...]


def words_of(design, real: str) -> tuple[FrequencyWords, ...]:
    """Say at which frequencies faults are seen.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    tuple of FrequencyWords
        One, or none where the observer is no polytopic one or the plant has no fault.
    """
    t, plant = design.observer.tables[real], design.plant
    if not plant.f or not isinstance(t, PolytopicTables | BankTables) or getattr(t, "faults", 0):
        return ()
    found = [("the residual", responses(plant, t))] if isinstance(t, PolytopicTables) else [
        (f"observer without the sensors of {f.name}",
         responses(plant, m, m.seen, np.delete(np.arange(plant.n_f), i)))
        for i, (f, m) in enumerate(zip(plant.f, t.members))]
    every = "all faults" if isinstance(t, PolytopicTables) else "the other faults"
    proof = design.certificate[real].get("band")
    band = None if proof is None else (proof["band"] / (2 * np.pi), proof["beta"])
    figure = frequency_figure(found, every, band)
    plot = Plot(inline(figure, "frequencies", "Gains to the residual against frequency"), CAPTION)
    said = "" if band is None else (f" Up to {words.number(band[0], 3)} Hz, shaded, faults of sensors have a certified "
                                    f"gain of at least {words.at_least(band[1])}.")
    return (FrequencyWords(TEXT + " ".join(sentence(name, r) for name, r in found) + said, (plot,)),)


def sentence(name: str, r: Responses) -> str:
    """How an observer takes faults that last, beside what else may drive it."""
    slow, most = r.fault[:, 0].min(), r.unknown.max()
    seen = words.number(float(slow), 3) if slow > 1e-9 * most else "zero (some direction of them is not seen)"
    return (f"{name[0].upper()}{name[1:]}: lasting faults have a gain of at least {seen}, all else at most "
            f"{words.number(float(most), 3)}.")
