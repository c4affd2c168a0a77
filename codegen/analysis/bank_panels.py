"""Panels of a bank: the level of each observer with its threshold, and whom the bank blames."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from .panels import ALARM, BUCKETS, EDGE, MODE, TRUTH, Run, _band, _faults, _limits
from .svg import pick, stretches


def level(axis: Axes, run: Run, j: int) -> None:
    """Norm of the averaged residual of one observer, in units of its threshold.

    Parameters
    ----------
    axis : Axes
    run : Run
    j : int
        Number of the observer: that of the fault it leaves out.
    """
    with np.errstate(invalid="ignore"):
        size = np.sqrt(run.trace.r[run.window, j].astype(float) / run.trace.r_bound[run.window, j].astype(float))
    _faults(axis, run)
    _band(axis, run, np.zeros_like(size), np.ones_like(size))
    index = pick(np.nan_to_num(size)[:, None], BUCKETS)
    axis.plot(run.time[index], size[index], color=EDGE, linewidth=1.0)
    for start, stop in stretches((run.trace.raw_bits[run.window] >> j) & 1 == 1):
        at = (run.start + np.array([start, stop])) * run.plant.sample_period
        axis.plot(at, [0.0, 0.0], color=ALARM, linewidth=3.5, solid_capstyle="butt", zorder=3)
    _limits(axis, [np.minimum(size, 5.0), np.array([0.0, 1.2])])
    axis.set_title(f"Observer without the sensors of {run.plant.f[j].name}: residual in units of its threshold")
    axis.set_ylabel("share")


def blame(axis: Axes, run: Run) -> None:
    """Which fault is named, and which one acts where that is known.

    Parameters
    ----------
    axis : Axes
    run : Run
    """
    names = ["none", *(f.name for f in run.plant.f)]
    _faults(axis, run)
    true = np.where(run.truth.f[run.window] != 0, np.arange(1, len(names)), 0).max(axis=1, initial=0)
    for values, colour, width in ((true, TRUTH, 1.0), (run.trace.isolated[run.window] + 1, MODE, 2.0)):
        axis.step(run.time, values, where="post", color=colour, linewidth=width)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(-0.4, len(names) - 0.6)
    axis.set_title("Fault that is named (coloured), and that acts (black)")
