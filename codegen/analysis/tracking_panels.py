"""The picture of a tracking law: outputs beside their references, inputs within their limits."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from .panels import EDGE, FAULT, IDLE, MODE, TRUTH, Run
from .steering import Steering
from .svg import stretches


def followed(axis: Axes, run: Run, steering: Steering, row: int, j: int) -> None:
    """A true output and its reference.

    Parameters
    ----------
    axis : Axes
    run : Run
    steering : Steering
    row : int
        Of the output in y.
    j : int
        Of its reference.
    """
    _faults(axis, run)
    signal, at = run.plant.y[row], run.window
    true = run.truth.x[at] @ run.plant.polytope.C[row]
    axis.step(run.time, steering.ref[at, j], where="post", color=EDGE, linewidth=1.0, linestyle="--")
    axis.plot(run.time, true, color=TRUTH, linewidth=1.1)
    axis.set_title(f"{signal.name}, without the errors of its sensor; dashed: its reference")
    axis.set_ylabel(f"{signal.name} ({signal.unit})" if signal.unit else signal.name)


def commanded(axis: Axes, run: Run, steering: Steering, i: int) -> None:
    """An input, its certified largest magnitude, and the ends of its range where they are near.

    Parameters
    ----------
    axis : Axes
    run : Run
    steering : Steering
    i : int
    """
    _faults(axis, run)
    signal, at, most = run.plant.u[i], run.window, float(steering.u_most[i])
    u = run.truth.u[at, i]
    axis.step(run.time, u, where="post", color=MODE, linewidth=1.0)
    for end in (-most, most):
        axis.axhline(end, color=EDGE, linewidth=0.8, linestyle="--")
    reach = 1.15 * max(most, float(np.abs(u).max()))
    for end in (signal.lo, signal.hi):
        if abs(end) <= reach:
            axis.axhline(end, color=IDLE, linewidth=1.2)
    axis.set_ylim(-reach, reach)
    axis.set_title(f"Input {signal.name}; dashed: certified without a fault; range {signal.lo:g} to {signal.hi:g}")
    axis.set_ylabel(signal.unit or signal.name)


def _faults(axis: Axes, run: Run) -> None:
    period = run.plant.sample_period
    for start, stop in stretches(np.any(run.truth.f[run.window] != 0, axis=1)):
        span = (run.start + start) * period, (run.start + stop) * period
        axis.axvspan(*span, facecolor=FAULT, alpha=0.35, linewidth=0)
