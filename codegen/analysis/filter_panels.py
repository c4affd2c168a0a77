"""The panel of an estimated fault: what the filter says, what it may say without a fault, what the fault was."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from .panels import ALARM, BUCKETS, EDGE, TRUTH, Run, _band, _faults, _limits, _unit
from .svg import pick, stretches


def estimate(axis: Axes, run: Run, j: int) -> None:
    """Estimate of one fault, the bounds that it keeps without a fault, and the true fault where it is known."""
    f_hat, bound = (a[run.window, j].astype(float) for a in (run.trace.f_hat, run.trace.f_bound))
    fault = run.truth.f[run.window, j]
    _faults(axis, run)
    _band(axis, run, -bound, bound)
    for values, colour in ((fault, TRUTH), (f_hat, EDGE)):
        index = pick(np.nan_to_num(values)[:, None], BUCKETS)
        axis.plot(run.time[index], values[index], color=colour, linewidth=1.0)
    for start, stop in stretches(np.abs(f_hat) > bound):
        at = (run.start + np.array([start, stop])) * run.plant.sample_period
        axis.plot(at, [0.0, 0.0], color=ALARM, linewidth=3.5, solid_capstyle="butt", zorder=3)
    low = np.nanmin(bound) if np.any(np.isfinite(bound)) else 0.0
    shown = bound[bound <= 3 * low]  # not the high ones after a start
    _limits(axis, [f_hat, fault, shown, -shown])
    signal = run.plant.f[j]
    axis.set_title(f"Fault {signal.name}: estimate (blue), what it may be without a fault (band), the fault (black)")
    axis.set_ylabel(_unit(signal.name, signal.unit))
