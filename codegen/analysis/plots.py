"""The figures of one run: what the firmware said, beside what was true."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..observers import BankTrace, FilterTrace, GuidedFilterTrace, Trace, TrailingTrace
from ..plant.model import Plant, PlantTrace
from . import bank_panels, filter_panels, panels, tracking_panels
from .panels import Run
from .svg import style

Panel = tuple[float, Callable[[Axes], None]]  # height in inches, and what draws it
WIDTH = 6.6  # inches


def whole(plant: Plant, truth: PlantTrace, trace: Trace) -> Run:
    """Return the run with all its samples."""
    return Run(plant, truth, trace, 0, len(trace.status))


def residual_figure(run: Run) -> Figure:
    """Draw the residual bounds of every output, and below them parameters, mode, fault, alarm and guarantee.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Figure
    """
    return _draw(run, _outputs(run) + _strips(run), _keys("zero", outside=True))


def state_figure(run: Run) -> Figure:
    """Draw the bounds of every state with the true state; thin ones magnified in a second panel.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Figure
    """
    return _draw(run, _states(run), _keys("true state" if run.simulated else "", outside=False))


def tracking_figure(run: Run, steering, rows: tuple[int, ...]) -> Figure:
    """Draw what a tracking law did: every output with its reference, every input within its limits.

    Parameters
    ----------
    run : Run
    steering : Steering
    rows : tuple of int
        Outputs that follow a reference.

    Returns
    -------
    Figure
    """
    stack = [(1.4, lambda axis, j=j, row=row: tracking_panels.followed(axis, run, steering, row, j))
             for j, row in enumerate(rows)]
    stack += [(1.2, lambda axis, i=i: tracking_panels.commanded(axis, run, steering, i)) for i in range(run.plant.n_u)]
    keys = [Line2D([], [], color=panels.TRUTH, linewidth=1.1, label="output"),
            Line2D([], [], color=panels.MODE, linewidth=1.0, label="input"),
            Line2D([], [], color=panels.EDGE, linewidth=0.9, linestyle="--", label="reference, certified limit"),
            Patch(facecolor=panels.FAULT, alpha=0.45, label="fault acts")]
    return _draw(run, stack, keys)


def run_figure(run: Run) -> Figure:
    """Draw everything of a run in one figure, for a file of its own.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Figure
    """
    return _draw(run, _outputs(run) + _states(run) + _strips(run), _keys("zero", outside=True))


def _outputs(run: Run) -> list[Panel]:
    estimates = [(1.75, lambda axis, j=j: filter_panels.estimate(axis, run, j)) for j in range(run.plant.n_f)]
    if isinstance(run.trace, FilterTrace):
        return estimates
    if isinstance(run.trace, BankTrace):
        levels = [(1.55, lambda axis, j=j: bank_panels.level(axis, run, j)) for j in range(run.plant.n_f)]
        return [*levels, (0.6 + 0.17 * run.plant.n_f, lambda axis: bank_panels.blame(axis, run))]
    outputs = [(1.55, lambda axis, j=j: panels.output(axis, run, j)) for j in range(run.plant.n_y)]
    return outputs + estimates * isinstance(run.trace, TrailingTrace | GuidedFilterTrace)


def _states(run: Run) -> list[Panel]:
    stack: list[Panel] = []
    for i in range(run.plant.n_x) if run.trace.bounded else ():
        stack.append((1.55, lambda axis, i=i: panels.state(axis, run, i)))
        if panels.is_thin(run, i):
            stack.append((1.55, lambda axis, i=i: panels.magnified(axis, run, i)))
    return stack


def _strips(run: Run) -> list[Panel]:
    title = 0.2 * hasattr(run.trace, "mode_set")
    modes = [(0.3 + 0.17 * run.plant.n_modes + title, lambda axis: panels.modes(axis, run))] * (run.plant.n_modes > 1)
    theta = [(0.95, lambda axis, j=j: panels.parameter(axis, run, j)) for j in panels.known_parameters(run)]
    return [*theta, *modes, (0.85, lambda axis: panels.monitor(axis, run))]


def _keys(line: str, outside: bool) -> list:
    """Entries of the legend; ``line`` says what the black line is, if there is one."""
    keys: list = [Patch(facecolor=panels.BAND, edgecolor=panels.EDGE, label="bounds, assured"),
                  Patch(facecolor=panels.IDLE, label="not assured")]
    keys += [Line2D([], [], color=panels.TRUTH, linewidth=1.1, label=line)] if line else []
    keys += [Line2D([], [], color=panels.ALARM, linewidth=3.5, label="zero is outside")] if outside else []
    return [*keys, Patch(facecolor=panels.FAULT, alpha=0.45, label="fault acts")]


def _draw(run: Run, stack: list[Panel], keys: list) -> Figure:
    """Stack the panels over one time axis, with one legend above them."""
    heights = [height for height, _ in stack]
    with style():
        figure = Figure(figsize=(WIDTH, sum(heights) + 0.75), layout="constrained")
        axes = figure.subplots(len(stack), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axis, (_, draw) in zip(axes, stack):
            draw(axis)
        axes[-1].set_xlabel("time (s)")
        period = run.plant.sample_period
        axes[-1].set_xlim(run.start * period, run.stop * period)
        figure.align_ylabels(axes)
        figure.legend(handles=keys, loc="outside upper left", ncols=len(keys), handlelength=1.4, columnspacing=1.2)
    return figure
