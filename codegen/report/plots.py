"""The plots of a scenario, as SVG that stands inside the page."""

from __future__ import annotations

import re

from markupsafe import Markup, escape
from matplotlib.figure import Figure

from ..analysis import plots, svg
from ..analysis.panels import Run, joint_only
from ..analysis.validate import Episode, Outcome
from ..observers import FilterTrace, SlidingTrace
from . import words
from .table import Plot

LONG = 600  # samples from which the first fault gets a plot of its own
JOINTLY = (" “Only jointly”: every residual is within its own bound, and all of them together cannot be explained; the "
           "pictures below show why.")
MANY = 3  # faults from which it does too
RESIDUAL = ("While zero lies between the bounds, the measurement agrees with the plant; where it does not, a fault is "
            "proved. Bounds that restart from the declared ranges after an alarm may run off the panel.")
DOUBTED = ("While zero lies between the bounds, the measurement agrees with the mode that is decided for; where it "
           "does not, a fault acts, or the decision is not right. From a detection until a mode is taken up, and after "
           "an alarm, the bounds are those of the declared ranges and may run off the panel.")
ESTIMATE = ("While the estimate is within the band, it may all be disturbance; beyond it a fault is proved. The "
            "band is wide for a while after a start, and where a fault has been seen and is over.")


def residuals(plant, o: Outcome, name: str) -> tuple[Plot, ...]:
    """Plot the residuals of a scenario, and its first fault magnified where the scenario is long.

    Parameters
    ----------
    plant : Plant
    o : Outcome
    name : str
        Distinguishes the plots from others of the page.

    Returns
    -------
    tuple of Plot
    """
    if o.steering is not None and not o.steering.drawn:
        return ()
    run, title = plots.whole(plant, o.truth, o.trace), o.scenario.name
    joint = o.trace.bounded and joint_only(run).any()
    usual = DOUBTED if isinstance(o.trace, SlidingTrace) else RESIDUAL
    caption = ESTIMATE if isinstance(o.trace, FilterTrace) else usual + JOINTLY * bool(joint)
    every = Plot(inline(plots.residual_figure(run), f"{name}r", f"Residuals of scenario {title}"), caption)
    if not o.episodes or (len(o.episodes) <= MANY and len(o.trace.status) <= LONG):
        return (every,)
    first = o.episodes[0]
    zoomed = inline(plots.residual_figure(around(run, first)), f"{name}z", f"First fault of scenario {title}")
    found = words.delay(first.delay, plant.sample_period)
    return every, Plot(zoomed, f"The first fault, magnified: {first.channel}, from sample {first.start} on. "
                               f"Found: {found}.")


def tracking(design, real: str, o: Outcome, name: str) -> tuple[Plot, ...]:
    """Plot what a tracking law did in a run; nothing where none steered.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    o : Outcome
    name : str
    """
    if o.steering is None or not o.steering.drawn:
        return ()
    run, rows = plots.whole(design.plant, o.truth, o.trace), design.observer.tables[real].law.rows
    figure = plots.tracking_figure(run, o.steering, rows)
    cut = words.count(int((o.steering.limited != 0).sum()), "sample")
    caption = f"The compiled C steers the true plant. An input or an integral was cut at {cut}."
    return (Plot(inline(figure, f"{name}t", f"Tracking in {o.scenario.name}"), caption),)


def states(plant, o: Outcome, name: str) -> tuple[Plot, ...]:
    """Plot the state bounds of a scenario; the parameters are those of ``residuals``."""
    if not o.trace.bounded:
        return ()
    run = plots.whole(plant, o.truth, o.trace)
    known = "" if run.simulated else " A record has no true state to compare with."
    kind = "bounds of every state, guaranteed while the decision is right" if isinstance(o.trace, SlidingTrace) else (
        "guaranteed bounds of every state")
    return (Plot(inline(plots.state_figure(run), f"{name}x", f"State bounds of scenario {o.scenario.name}"),
                 f"The {kind}.{known}"),)


def around(run: Run, e: Episode) -> Run:
    """The part of a run around a fault: what comes before it, its beginning, and its end if that is near."""
    length = min(e.stop - e.start, 160)
    margin = max(10, length // 4)
    stop = min(run.stop, e.start + length + 2 * margin)
    return Run(run.plant, run.truth, run.trace, max(0, e.start - margin), stop)


def inline(figure: Figure, name: str, label: str) -> Markup:
    """Print a figure to stand inside HTML, as wide as its place.

    Parameters
    ----------
    figure : Figure
    name : str
        Distinguishes it from the other figures of the page.
    label : str
        What a screen reader says.

    Returns
    -------
    svg : Markup
    """
    text = svg.text(figure).replace('="r-', f'="{name}-').replace("#r-", f"#{name}-")
    for size in ("width", "height"):
        text = re.sub(rf'^(<svg[^>]*?) {size}="[^"]*"', r"\1", text)
    return Markup(text.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1))
