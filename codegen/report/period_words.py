"""What the sampling period costs, in words, as a plot and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..analysis.period_plot import period_figure
from ..plant.model import Plant
from . import words
from .design_words import settled_width
from .plant_words import reach
from .plots import inline
from .table import Cell, Plot, Row, Table, table

CAPTION = ("For every period the plant is sampled and the gains are designed anew, for the smallest steady width "
           "before rounding{late}{tnl}. Widths below a millionth of the range are not drawn.")
LATE = " and before the union of two modes where one is told late"
TNL = ", with gains N no larger (relative to those that reproduce the measurement) than in this firmware"


@dataclass(frozen=True)
class PeriodWords:
    """What the report says of the sampling period of a continuous plant."""

    text: str
    plots: tuple[Plot, ...]
    tables: tuple[Table, ...]


def words_of(design, real: str, points: Sequence) -> tuple[PeriodWords, ...]:
    """Say how the guaranteed width depends on the sampling period.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    points : sequence of PeriodPoint
        ``period`` (s) ascending, ``width`` (n_x,) or None; may be empty (a discrete plant).

    Returns
    -------
    tuple of PeriodWords
        One, or none where there is nothing to say.
    """
    if not any(p.width is not None for p in points):
        return ()
    plant = design.plant
    scale = np.array([reach(s) for s in plant.x])
    figure = period_figure(points, scale, [s.name for s in plant.x], plant.sample_period)
    plot = Plot(inline(figure, "periods", "Guaranteed width against sampling period"),
                CAPTION.format(tnl=TNL if np.any(design.observer.tables[real].N_hi) else "",
                               late=LATE if plant.switching.late else ""))
    return (PeriodWords(_text(design, real, points, scale), (plot,), (_table(plant, points, scale),)),)


def total(point, scale) -> float | None:
    """Width in units of the ranges, summed over the states; None where there is no design."""
    return None if point.width is None else float(np.sum(point.width / scale))


def _text(design, real: str, points: Sequence, scale) -> str:
    """Compare the chosen period with the shortest, and say where no design exists."""
    period = design.plant.sample_period
    limit = next(p for p in points if p.width is not None)
    here = next((p for p in points if np.isclose(p.period, period) and p.width is not None), None)
    parts = []
    if here is None:
        parts.append(f"For the smallest width no design was found at the chosen {words.seconds(period)}")
    else:
        ratio = total(here, scale) / max(total(limit, scale), 1e-300)
        wide = f"{words.at_most(ratio, 3)} times as wide as" if ratio > 1.005 else "as wide as"
        parts.append(f"At the chosen {words.seconds(period)} the narrowest bounds that this method can have are "
                     f"{percent(total(here, scale))} wide (each state in units of its range, summed): {wide} at "
                     f"{words.seconds(limit.period)}, the shortest period computed, which stands for the continuous "
                     "limit")
    found = settled_width(design, real)
    if found is not None and here is not None:
        sees = bool(design.plant.f) and "criterion" not in design.options
        chosen = " and chosen for the faults that it finds" if sees else ""
        union = design.plant.switching.late
        parts.append(f"These widths leave {'rounding and late switches' if union else 'rounding'} out. The design of "
                     f"this firmware, {'both' if union else 'rounding'} included{chosen}, has "
                     f"{percent(float(np.sum(found / scale)))}")
    gone = [p.period for p in points if p.width is None and p.period > period]
    last = max((p.period for p in points if p.width is not None), default=None)
    if gone and last is not None and last >= period:
        parts.append(f"At {words.seconds(last)} there still is a design, at {words.seconds(min(gone))} none was found")
    return ". ".join(parts) + "."


def percent(share: float) -> str:
    """A share as a percentage, rounded up."""
    return words.quantity(words.at_most(100 * share, 3), "%")


def _table(plant: Plant, points: Sequence, scale) -> Table:
    """The numbers of the plot."""
    limit = total(next(p for p in points if p.width is not None), scale)
    head = ("#sampling period", *(f"#{s.name}" for s in plant.x), "#sum in ranges", "#times the shortest", "")
    rows = []
    for p in points:
        chosen = bool(np.isclose(p.period, plant.sample_period))
        cells = [words.seconds(p.period)]
        if p.width is None:
            cells += [*[words.NONE] * (len(plant.x) + 2), "no design"]
        else:
            cells += [words.quantity(words.at_most(float(w)), s.unit) for w, s in zip(p.width, plant.x)]
            cells += [percent(total(p, scale)), words.at_most(total(p, scale) / max(limit, 1e-300), 3), ""]
        cells[-1] = "chosen" + (f", {cells[-1]}" if cells[-1] else "") if chosen else cells[-1]
        kinds = ["num"] * (len(cells) - 1) + [""]
        rows.append(Row(tuple(Cell(c, k) for c, k in zip(cells, kinds)), "chosen" if chosen else ""))
    return table("Smallest steady width of each state, by sampling period", head, rows)
