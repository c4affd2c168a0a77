"""The plots of one run: what the firmware said, beside what was true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..observers import Trace
from ..plant.model import Plant, PlantTrace
from .svg import pick, stretches, style

Array = np.ndarray

# Okabe and Ito's colours, told apart by every kind of colour vision; the names say what each is for.
BAND, BAND_EDGE, TRUTH, ALARM, FAULT, ASSURED = "#b9d9ee", "#0072B2", "#000000", "#D55E00", "#F5C243", "#009E73"
WIDTH = 6.6  # inch
BUCKETS = 180
THIN = 0.04  # bounds narrower than this part of the panel need a panel of their own


@dataclass(frozen=True)
class Run:
    """One run and the samples [start, stop) of it to be shown.

    Parameters
    ----------
    plant : Plant
    truth : PlantTrace
    trace : Trace
    start, stop : int
    """

    plant: Plant
    truth: PlantTrace
    trace: Trace
    start: int
    stop: int

    @property
    def window(self) -> slice:
        """The samples as a slice."""
        return slice(self.start, self.stop)

    @property
    def time(self) -> Array:
        """Time of the shown samples, in seconds."""
        return np.arange(self.start, self.stop) * self.plant.sample_period

    @property
    def calm(self) -> Array:
        """Shown samples at which the bounds are in force or the measurement is outside them; not the restarts."""
        return (self.trace.assured | (self.trace.raw_bits != 0))[self.window]


def whole(plant: Plant, truth: PlantTrace, trace: Trace) -> Run:
    """Return the run with all its samples."""
    return Run(plant, truth, trace, 0, len(trace.status))


def residual_figure(run: Run) -> Figure:
    """Residual bounds of every output, and below them mode, fault, alarm and guarantee.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Figure
    """
    n_y = run.plant.n_y
    modes = run.plant.n_modes > 1
    heights = [1.7] * n_y + ([0.28 + 0.2 * run.plant.n_modes] if modes else []) + [0.95]
    figure, axes = _stack(heights)
    for j, axis in enumerate(axes[:n_y]):
        lo, hi = run.trace.r_lo[run.window, j], run.trace.r_hi[run.window, j]
        _band(axis, run, lo, hi)
        axis.axhline(0.0, color=TRUTH, linewidth=0.8)
        out = (run.trace.raw_bits[run.window] >> j) & 1 == 1
        _outside(axis, run, out, np.where(lo > 0, lo, hi))
        axis.set_ylim(_limits(run, [lo, hi, np.zeros(1)]))
        signal = run.plant.y[j]
        axis.set_title(f"residual bounds of {signal.name}")
        axis.set_ylabel(_unit("y bounds − y", signal.unit))
    if modes:
        _mode_strip(axes[n_y], run)
    _monitor(axes[-1], run)
    return _finish(figure, axes, run)


def state_figure(run: Run) -> Figure:
    """Bounds of every state with the true state; bounds too thin to be seen get a magnified panel.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Figure
    """
    panels = [(i, close) for i in range(run.plant.n_x) for close in ((False, True) if _thin(run, i) else (False,))]
    figure, axes = _stack([1.7] * len(panels))
    for axis, (i, close) in zip(axes, panels):
        _state(axis, run, i, close)
    return _finish(figure, axes, run)


def run_figure(run: Run) -> Figure:
    """Everything of a run in one figure, for a file of its own: see ``residual_figure``, ``state_figure``."""
    n_x, n_y = run.plant.n_x, run.plant.n_y
    figure, axes = _stack([1.7] * (n_y + n_x) + [0.28 + 0.2 * run.plant.n_modes, 0.95])
    for j, axis in enumerate(axes[:n_y]):
        _output(axis, run, j)
    for i, axis in enumerate(axes[n_y:n_y + n_x]):
        _state(axis, run, i, False)
    _mode_strip(axes[-2], run)
    _monitor(axes[-1], run)
    return _finish(figure, axes, run)
