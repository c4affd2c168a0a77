"""Figures of residual sets: the set with the residual in it, its area over time, thresholds, order against cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from ..algebra import ellipsoid, zonotope
from .panels import ALARM, ASSURED, BAND, EDGE, FAULT, IDLE, MODE
from .plots import WIDTH
from .svg import pick, style

Array = np.ndarray

#: One colour per set or table, in the order in which they are given; the first is filled.
COLOURS = (EDGE, ASSURED, MODE, "#CC79A7", FAULT, IDLE)
#: What noise alone can fill is dashed and black, whatever stands beside it.
EXACT = "exact"
BUCKETS = 200
#: A residual so many times as far out as the sets is drawn nearer, with how far it is.
FAR = 4.0


@dataclass(frozen=True)
class Snapshot:
    """The residual and its sets at one sample.

    Parameters
    ----------
    title : str
    outlines : mapping of str to ndarray (k, 2)
        Name -> corners, counter-clockwise; ``zonotope_outline`` and its like make them.
    residual : ndarray (2,)
    alarm : bool
    """

    title: str
    outlines: Mapping[str, Array]
    residual: Array
    alarm: bool


def zonotope_outline(G: Array, pair: tuple[int, int] = (0, 1)) -> Array:
    """Return the corners of the projection of a zonotope on two residuals.

    Parameters
    ----------
    G : ndarray (m, g)
    pair : tuple of int

    Returns
    -------
    points : ndarray (k, 2)
    """
    return zonotope.vertices(G[list(pair)])


def ellipsoid_outline(R: Array, pair: tuple[int, int] = (0, 1)) -> Array:
    """Return points on the edge of the projection of an ellipsoid on two residuals.

    Parameters
    ----------
    R : ndarray (m, m)
    pair : tuple of int

    Returns
    -------
    points : ndarray (96, 2)
    """
    return ellipsoid.outline(R[np.ix_(pair, pair)], 96)


def table_outline(h: Array, directions: Array) -> Array:
    """Return the corners of ``|d' r| <= h`` for two residuals.

    Parameters
    ----------
    h : ndarray (d,)
        Above 0.
    directions : ndarray (d, 2)
        The coordinates are among them.

    Returns
    -------
    points : ndarray (k, 2)
    """
    # In the dual plane the line d' r = h is the point d / h: edges of the convex hull of these points are corners here.
    points = np.concatenate([directions, -directions]) / np.concatenate([h, h])[:, None]
    ring = points[ConvexHull(points).vertices]
    return np.array([np.linalg.solve([a, b], np.ones(2)) for a, b in zip(ring, np.roll(ring, -1, axis=0))])


def sets_figure(snapshots: Sequence[Snapshot], names: tuple[str, str]) -> Figure:
    """Draw residual sets with the residual in them, side by side at one scale.

    Parameters
    ----------
    snapshots : sequence of Snapshot
    names : tuple of str
        Of the two residuals, with units.

    Returns
    -------
    Figure
    """
    columns = min(4, len(snapshots))
    rows = -(-len(snapshots) // columns)
    sets = np.max([np.abs(points).max(axis=0) for s in snapshots for points in s.outlines.values()], axis=0)
    residuals = np.max([np.abs(s.residual) for s in snapshots], axis=0)
    reach = 1.08 * np.clip(residuals, sets, FAR * sets)
    with style():
        figure = Figure(figsize=(WIDTH, 1.7 * rows + 0.75), layout="constrained")
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axis, snapshot in zip(axes.flat, snapshots):
            _snapshot(axis, snapshot, reach)
            axis.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))
            axis.locator_params(nbins=4 if columns > 2 else 6)
            axis.ticklabel_format(style="sci", scilimits=(-3, 4), useMathText=False)
        for axis in axes.flat[len(snapshots):]:
            axis.set_visible(False)
        for axis in axes.flat[max(0, len(snapshots) - columns):len(snapshots)]:
            axis.tick_params(labelbottom=True)  # the lowest that is drawn in its column
        figure.supxlabel(names[0], fontsize=9.5)
        figure.supylabel(names[1], fontsize=9.5)
        labels = list(dict.fromkeys(name for s in snapshots for name in s.outlines))
        keys = [Line2D([], [], label=name, **_line(name, i)) for i, name in enumerate(labels)]
        keys.append(Line2D([], [], color="#000000", marker="o", linestyle="", markersize=4, label="residual"))
        if any(s.alarm for s in snapshots):
            keys.append(Line2D([], [], color=ALARM, marker="X", linestyle="", markersize=6, label="outside: alarm"))
        figure.legend(handles=keys, loc="outside upper left", ncols=len(keys), handlelength=1.4, columnspacing=1.2)
    return figure


def _line(name: str, i: int) -> dict:
    """Colour and dashes of a curve by its name and place."""
    exact = name == EXACT
    return {"color": "#000000" if exact else COLOURS[i % len(COLOURS)], "linestyle": "--" if exact else "-"}


def _snapshot(axis: Axes, snapshot: Snapshot, reach: Array) -> None:
    for i, (name, points) in enumerate(snapshot.outlines.items()):
        line = _line(name, i)
        axis.add_patch(Polygon(points, closed=True, facecolor=BAND if i == 0 else "none", edgecolor=line["color"],
                               linestyle=line["linestyle"], linewidth=1.1))
    colour, marker, size = (ALARM, "X", 6) if snapshot.alarm else ("#000000", "o", 4)
    times = 1.08 * np.max(np.abs(snapshot.residual) / reach)
    drawn = snapshot.residual / max(times, 1.0)
    axis.plot(*drawn, linestyle="", color=colour, marker=marker, markersize=size)
    if times > 1.0 + 1e-9:
        side, above = ("right" if drawn[0] > 0 else "left"), ("top" if drawn[1] > 0 else "bottom")
        axis.annotate(f"{times:.2g} × further", drawn, (0, -7 if drawn[1] > 0 else 7), ha=side, va=above,
                      textcoords="offset points", fontsize=8.0)
    axis.set_title(snapshot.title)


def area_figure(time: Array, areas: Mapping[str, Array]) -> Figure:
    """Draw the areas of several sets over time; what they begin with may run off the panel.

    Parameters
    ----------
    time : ndarray (K,)
        Seconds.
    areas : mapping of str to ndarray (K,)

    Returns
    -------
    Figure
    """
    return _lines(time, areas, "area of the residual set")


def threshold_figure(time: Array, exact: Array, tables: Mapping[str, Array], name: str) -> Figure:
    """Draw thresholds in one direction over time, the exact one dashed; what they begin with may run off the panel.

    Parameters
    ----------
    time : ndarray (K,)
        Seconds.
    exact : ndarray (K,)
    tables : mapping of str to ndarray (K,)
    name : str
        Of the direction, with its unit.

    Returns
    -------
    Figure
    """
    return _lines(time, {**tables, EXACT: exact}, f"threshold on {name}")


def _lines(time: Array, curves: Mapping[str, Array], label: str) -> Figure:
    with style():
        figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
        axis = figure.subplots()
        shown = pick(np.array([*curves.values()]).T, BUCKETS)
        for i, (name, values) in enumerate(curves.items()):
            axis.plot(time[shown], values[shown], linewidth=1.2, label=name, **_line(name, i))
        settled = np.array([*curves.values()])[:, len(time) // 4:]
        axis.set(xlabel="time (s)", ylabel=label, xlim=(time[0], time[-1]), ylim=(0.0, 1.15 * np.nanmax(settled)))
        axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=False)
        figure.legend(loc="outside upper left", ncols=6, handlelength=1.8, columnspacing=1.2)
    return figure


def order_figure(orders: Sequence[int], mean: Array, worst: Array, cost: Array, unit: str,
                 chosen: int | None = None) -> Figure:
    """Draw accuracy and cost against the order of a zonotope.

    Parameters
    ----------
    orders : sequence of int
    mean, worst : ndarray (k,)
        Threshold over the exact one.
    cost : ndarray (k,)
    unit : str
        Of the cost.
    chosen : int, optional
        Marked by a line.

    Returns
    -------
    Figure
    """
    with style():
        figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
        axis = figure.subplots()
        axis.plot(orders, worst, color=ALARM, marker="s", markersize=3.5, linewidth=1.2, label="threshold, worst")
        axis.plot(orders, mean, color=EDGE, marker="o", markersize=3.5, linewidth=1.2, label="threshold, mean")
        axis.axhline(1.0, color="#000000", linewidth=0.8, linestyle=":")
        if chosen is not None:
            axis.axvline(chosen, color="#000000", linewidth=0.8)
        axis.set(xlabel="order (columns kept)", ylabel="threshold / exact")
        axis.xaxis.get_major_locator().set_params(integer=True)
        other = axis.twinx()
        other.plot(orders, cost, color=MODE, marker="^", markersize=3.5, linewidth=1.2, linestyle="--", label=unit)
        other.set(ylabel=unit, ylim=(0.0, 1.1 * np.max(cost)))
        other.spines["right"].set_visible(True)
        figure.legend(loc="outside upper left", ncols=3, handlelength=1.8, columnspacing=1.2)
    return figure
