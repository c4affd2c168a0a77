"""The residual set of a point observer in words and pictures: where the residual is, how large the set, how exact."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..analysis import set_plots
from ..analysis.order_cost import order_cost
from ..analysis.set_compare import DIRECTIONS, closeness, least_dwell
from ..analysis.set_history import SetHistory, exact_areas, exact_sets, hulls, watch
from ..analysis.validate import Outcome
from ..observers import PointTables
from . import words
from .plots import inline
from .table import Cell, Plot, Row, Table, table

Array = np.ndarray
SAMPLES = 100  # that curves over time show
MOST_OUTPUTS = 3
OF_STEPS = (" It is exact for the discrete plant that encloses this one at its samples, where what a disturbance does "
            "within a sample beyond its mean is one of its own for each state.")
QUIET = 2.0  # times as large as before the fault: beyond it a set has started anew


@dataclass(frozen=True)
class SetWords:
    """What the report says of the residual set."""

    text: str
    plots: tuple[Plot, ...]
    tables: tuple[Table, ...]


@dataclass(frozen=True)
class Watched:
    """A scenario with the sets of its samples: the firmware's, and the exact one where it is known."""

    outcome: Outcome
    history: SetHistory
    exact: list[Array | None]


def watched(design, real: str, outcomes: list[Outcome]) -> list[Watched | None]:
    """Return the sets of every scenario; None for other observers, and where nothing was measured.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    outcomes : list of Outcome
    """
    found: list[Watched | None] = []
    for o in outcomes:
        found.append(None)
        if isinstance(design.observer.tables[real], PointTables) and np.all(o.trace.status == 0):
            history = watch(design.observer, real, o.truth)
            found[-1] = Watched(o, history, exact_sets(design.plant, history))
    return found


def moments(w: Watched) -> list[tuple[str, int]]:
    """Choose samples to be shown: around the first fault that was found, else where the residual came closest."""
    o, history = w.outcome, w.history
    good = np.flatnonzero(history.measured)
    if not o.episodes:
        late = good[good >= min(10, len(history.q) // 4)]
        far = history.gauges(late, o.trace.r[late])
        return [("a typical sample", int(late[np.argsort(far)[len(far) // 2]])),
                ("closest to the edge", int(late[np.argmax(far)]))] if len(late) else []
    e = next((e for e in o.episodes if e.delay is not None), o.episodes[0])
    before = good[good < e.start]
    chosen = [("before the fault", int(before[-1]))] if len(before) else []
    first = e.start if e.delay is None else e.start + e.delay
    if history.measured[first]:
        chosen.append(("the fault begins" if e.delay is None else "first alarm", first))
    later = good[(good > first) & (good < e.stop)]
    if len(before):
        later = later[np.all(history.bound[later] <= QUIET * history.bound[before[-1]], axis=1)]
    return [*chosen, ("while it lasts", int(later[-1]))] if len(later) else chosen


def own(design) -> str:
    """The firmware's set in a legend."""
    return f"this firmware: {design.observer.family}"


def pictures(design, w: Watched | None, name: str) -> tuple[Plot, ...]:
    """Draw the residual in its set at chosen samples; nothing for one output, whose set is the band of the other plot.

    Parameters
    ----------
    design : Design
    w : Watched or None
    name : str
        Distinguishes the plots from others of the page.

    Returns
    -------
    tuple of Plot
    """
    if w is None or w.history.bound.shape[1] < 2:
        return ()
    chosen, n_y = moments(w), w.history.bound.shape[1]
    if not chosen:
        return ()
    k = chosen[-1][1] if len(chosen) < 3 else chosen[1][1]
    telling = np.argsort(-np.abs(w.outcome.trace.r[k]) / w.history.bound[k], kind="stable")[:MOST_OUTPUTS]
    plots = []
    for i, j in combinations(sorted(telling.tolist()), 2):
        shots = [_snapshot(design, w, k, label, (i, j)) for label, k in chosen]
        axes = tuple(_named(design.plant.y[a]) for a in (i, j))
        label = (f"Residual set of scenario {w.outcome.scenario.name}, {design.plant.y[i].name} and "
                 f"{design.plant.y[j].name}")
        plots.append(Plot(inline(set_plots.sets_figure(shots, axes), f"{name}p{i}{j}", label), ""))
    return (*plots[:-1], Plot(plots[-1].svg, _caption(n_y, w.outcome)))


def _snapshot(design, w: Watched, k: int, label: str, pair: tuple[int, int]) -> set_plots.Snapshot:
    history, n_y = w.history, w.history.bound.shape[1]
    outlines = {own(design): history.outlines(np.array([k]), pair)[0]}
    if n_y > 2:
        a, b = history.bound[k, list(pair)].astype(float)
        outlines["bound of each"] = np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
    elif w.exact[k] is not None:
        outlines[set_plots.EXACT] = set_plots.zonotope_outline(w.exact[k])
    time = words.seconds(k * design.plant.sample_period)
    return set_plots.Snapshot(f"{label}, {time}", outlines, w.outcome.trace.r[k, list(pair)].astype(float),
                              bool(w.outcome.trace.raw_bits[k] != 0))


def _named(signal) -> str:
    return f"residual of {signal.name}" + (f" ({signal.unit})" if signal.unit else "")


def _caption(n_y: int, o: Outcome) -> str:
    """What is to be seen in the pictures of a scenario."""
    inside = ("Filled: where the firmware takes the pair of residuals for fault-free. " if n_y == 2 else
              "Filled: where the firmware takes the pair for fault-free while the other residuals are zero; the "
              "rectangle: the bounds of each alone. The others are not zero: a mark may lie outside the filled part "
              "without a fault. ")
    exact = ("Dashed: the exact set, which disturbance and noise can fill; what lies between the two is given away for "
             "arithmetic that fits the target. " if n_y == 2 else "")
    fault = ("A residual outside is a fault: the mark turns into a cross. " if o.episodes else
             "No fault acts, and the residual cannot leave the set. ")
    return inside + exact + fault + ("The set depends on the modes alone, not on what is measured." if n_y == 2 else "")


def words_of(design, scenes: list[Watched | None]) -> tuple[SetWords, ...]:
    """Say how large the set is and how close to the exact one.

    Parameters
    ----------
    design : Design
    scenes : list of Watched or None

    Returns
    -------
    tuple of SetWords
        One, or none where there is nothing to say.
    """
    known = [w for w in scenes if w is not None]
    if not known:
        return ()
    w = next((w for w in known if not w.outcome.episodes), known[0])
    stop = min([e.start for e in w.outcome.episodes], default=len(w.history.q))
    index = np.array([k for k in range(stop) if w.exact[k] is not None and np.all(w.history.bound[k] > 0)])
    if len(index) < 2:
        return ()
    exact = hulls([w.exact[k] for k in index])
    plots, text = [], [_about(design, w, stop)]
    if len(design.plant.y) == 2:
        plot, sentence = _areas(design, w, index)
        plots, text = [plot], [*text, sentence]
    plots += _thresholds(design, w, index, exact)
    ratio = w.history.bound[index] / np.maximum(exact, 1e-300)
    settled = ratio[len(ratio) // 4:]
    text.append("The largest residual taken for fault-free is on average "
                f"{words.at_most(float(settled.mean()), 3)} times the exact one, at worst "
                f"{words.at_most(float(settled.max()), 3)} times, the first quarter left out.")
    plots += _orders(design, w.history.t)
    return (SetWords(" ".join(text), tuple(plots), _others(design, w, index)),)


def _about(design, w: Watched, stop: int) -> str:
    part = "" if stop == len(w.history.q) else ", up to its first fault"
    return ("Disturbance and noise move the residual even where nothing is wrong. Where they can move it to is known "
            "beforehand: it depends on the modes alone. The exact set is what they can reach with these gains; the set "
            "of the firmware holds it, and is larger by what bounded arithmetic costs. Both are shown along scenario "
            f"“{w.outcome.scenario.name}”{part}." + (OF_STEPS if design.plant.kind == "continuous" else ""))


def _areas(design, w: Watched, index: Array) -> tuple[Plot, str]:
    shown = index[:SAMPLES]
    areas = {own(design): w.history.areas(shown),
             set_plots.EXACT: exact_areas([w.exact[k] for k in shown])}
    settled = slice(len(shown) // 4, None)
    ratio = float(np.mean(areas[own(design)][settled] / areas[set_plots.EXACT][settled]))
    figure = set_plots.area_figure(shown * design.plant.sample_period, areas)
    return (Plot(inline(figure, "setarea", "Area of the residual set over time"),
                 "Area of the set of both residuals: the smaller, the smaller the faults that show."),
            f"Its area is on average {words.at_most(ratio, 3)} times the exact one.")


def _thresholds(design, w: Watched, index: Array, exact: Array) -> list[Plot]:
    index, exact, plots = index[:SAMPLES], exact[:SAMPLES], []
    time = index * design.plant.sample_period
    for j, signal in enumerate(design.plant.y[:MOST_OUTPUTS]):
        figure = set_plots.threshold_figure(time, exact[:, j], {own(design): w.history.bound[index, j]},
                                            _named(signal))
        plots.append(Plot(inline(figure, f"setbound{j}", f"Threshold of output {signal.name} over time"), ""))
    last = ("Largest residual of each output that the firmware takes for fault-free, beside the exact one. "
            "At first both hold the whole initial box.")
    return [*plots[:-1], Plot(plots[-1].svg, last)]


def _orders(design, t: PointTables) -> list[Plot]:
    """Accuracy and cost against the order of a zonotope; nothing for other sets."""
    order, n_x = getattr(t.shape, "order", None), design.plant.n_x
    if order is None:
        return []
    tried = sorted({*np.unique(np.geomspace(n_x + 1, max(2 * order, 24), 9).astype(int)).tolist(), order})
    found = [o for o in order_cost(design.plant, t, tried, least_dwell(design.plant)) if np.isfinite(o.accuracy)]
    if len(found) < 2:
        return []
    figure = set_plots.order_figure([o.order for o in found], np.array([o.accuracy for o in found]),
                                    np.array([o.worst for o in found]), np.array([o.multiply_adds for o in found]),
                                    "multiply-adds of the set per sample", order)
    lost = [str(n) for n in tried if n < found[0].order]
    caption = (f"What more generators buy and cost, over many mode sequences; the firmware keeps {order} (the line)."
               + (f" With {words.listed(lost)} the set grows without bound." if lost else ""))
    return [Plot(inline(figure, "setorder", "Accuracy and cost against the order of the zonotope"), caption)]


def _others(design, w: Watched, index: Array) -> tuple[Table, ...]:
    """The same gains with other sets, as a table; nothing where the exact set is not known."""
    found, plant = closeness(design.plant, w.history, w.exact, index), design.plant
    if not found:
        return ()
    rows = []
    for c in found:
        figures = [words.at_most(c.mean, 3), words.at_most(c.worst, 3)] if np.isfinite(c.worst) else [
            "grows without bound", words.NONE]
        rows.append(Row((Cell(c.name or own(design)),
                         *(Cell(text, "num") for text in figures)), "" if c.name else "chosen"))
    where = f"{DIRECTIONS} directions" if plant.n_y == 2 else "each output"
    sampled = ", found from points of its edge and so a little too small" if plant.n_y == 2 else ""
    notes = (f"Thresholds over those of the exact set, in {where}, along the modes of the scenario; the first quarter "
             f"is left out. The first row is the firmware, rounding included{sampled}. The others are computed in "
             f"double precision with its gains; the tables know that a mode lasts at least "
             f"{words.count(least_dwell(plant), 'sample')}. What each finds and costs as firmware of its own: "
             "residua compare.",)
    return (table("The same gains with other sets", ("set", "#mean over exact", "#worst over exact"), rows, notes),)
