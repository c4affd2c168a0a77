"""The figure of guaranteed width against sampling period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .panels import ALARM, ASSURED, EDGE, FAULT, IDLE, MODE
from .plots import WIDTH
from .svg import stretches, style

Array = np.ndarray
LINES = ((EDGE, "o"), (ALARM, "s"), (ASSURED, "^"), (MODE, "D"), ("#CC79A7", "v"), (FAULT, "P"))
UNITS = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))
LEAST = 1e-6  # share of the range below which a width is drawn as none


def period_figure(points: Sequence, reach: Array, names: Sequence[str], chosen: float) -> Figure:
    """Draw the width of every state against the sampling period, both logarithmic.

    Parameters
    ----------
    points : sequence of PeriodPoint
        ``period`` (s) ascending, ``width`` (n_x,) or None where there is no design.
    reach : ndarray (n_x,)
        Width of each state's declared range.
    names : sequence of str
    chosen : float
        Sampling period of the plant file, s.

    Returns
    -------
    Figure
    """
    factor, unit = next(((f, u) for f, u in UNITS if chosen * f >= 1), UNITS[-1])
    periods = factor * np.array([p.period for p in points])
    shares = np.array([np.full(len(reach), np.nan) if p.width is None else 100 * p.width / reach for p in points])
    shares = np.where(shares > 100 * LEAST, shares, np.nan)
    with style():
        figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
        axis = figure.subplots()
        axis.set(xscale="log", yscale="log", xlabel=f"sampling period ({unit})", ylabel="width, % of the range",
                 xlim=(periods[0] / 1.2, periods[-1] * 1.2))
        for j, name in enumerate(names):
            if np.isfinite(shares[:, j]).any():
                colour, marker = LINES[j % len(LINES)]
                axis.plot(periods, shares[:, j], color=colour, marker=marker, markersize=3.5, linewidth=1.2, label=name)
        for start, stop in stretches(np.array([p.width is None for p in points])):
            axis.axvspan(_between(periods, start), _between(periods, stop), facecolor=IDLE, alpha=0.45, linewidth=0)
        axis.set_ylim(*_decades(shares))
        axis.axvline(chosen * factor, color="#000000", linewidth=1.0, linestyle="--", label="chosen period")
        if np.nanmax(shares, initial=0.0) > 100:
            axis.axhline(100, color="#000000", linewidth=0.8, linestyle=":", label="the whole range")
        if any(p.width is None for p in points):
            axis.fill_between([], [], color=IDLE, alpha=0.45, linewidth=0, label="no design")
        axis.xaxis.set_major_locator(LogLocator(numticks=8))
        for side in (axis.xaxis, axis.yaxis):
            side.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            side.set_minor_formatter(NullFormatter())
        entries = len(axis.get_legend_handles_labels()[0])
        figure.legend(loc="outside upper left", ncols=min(6, entries), handlelength=1.8, columnspacing=1.2)
    return figure


def _between(periods: Array, i: int) -> float:
    """Where a point begins on the axis: half way from the one before."""
    step = np.sqrt(periods[1] / periods[0]) if len(periods) > 1 else 1.2
    return periods[i] / step if i < len(periods) else periods[-1] * step


def _decades(shares: Array) -> tuple[float, float]:
    """Limits that hold all values, from one power of ten to another, so that they can be read."""
    known = shares[np.isfinite(shares)]
    least, most = (known.min(), known.max()) if len(known) else (1.0, 1.0)
    lo, hi = np.floor(np.log10(least / 1.1)), np.ceil(np.log10(most * 1.1))
    return float(10.0 ** lo), float(10.0 ** hi)
