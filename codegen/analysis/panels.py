"""One panel each: residual bounds, state bounds, parameters, modes, alarms, drawn on given axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from ..observers import Trace
from ..plant.model import Plant, PlantTrace
from .svg import pick, stretches

Array = np.ndarray

# Okabe and Ito's colours, told apart by every kind of colour vision; the names say what each is for.
BAND, EDGE, TRUTH, ALARM, FAULT, ASSURED, MODE, IDLE = ("#c3dcef", "#0072B2", "#000000", "#D55E00", "#F5C243",
                                                        "#009E73", "#56708a", "#b0b0b0")
BUCKETS = 150
THIN = 0.04  # bounds narrower than this part of their panel get a magnified one too
DOTS = 80  # up to so many samples each is marked


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
        """Shown samples that set the scale: bounds in force or an alarm, not the start and not the restarts."""
        calm = (self.trace.assured | (self.trace.raw_bits != 0))[self.window]
        late = np.arange(self.start, self.stop) >= len(self.trace.status) // 20 + 3
        return next((c for c in (calm & late, calm) if c.any()), np.ones_like(calm))

    @property
    def simulated(self) -> bool:
        """Whether there is a true state."""
        return not np.isnan(self.truth.x).all()


def output(axis: Axes, run: Run, j: int) -> None:
    """Residual bounds of one output around zero."""
    lo, hi = run.trace.r_lo[run.window, j], run.trace.r_hi[run.window, j]
    _faults(axis, run)
    _band(axis, run, lo, hi)
    axis.axhline(0.0, color=TRUTH, linewidth=1.0)
    for start, stop in stretches((lo > 0) | (hi < 0)):
        at = (run.start + np.array([start, stop])) * run.plant.sample_period
        axis.plot(at, [0.0, 0.0], color=ALARM, linewidth=3.5, solid_capstyle="butt", zorder=3)
    _limits(axis, [lo[run.calm], hi[run.calm], np.zeros(1)])
    signal = run.plant.y[j]
    axis.set_title(f"Residual of output {signal.name}: bounds on y, minus the y measured")
    axis.set_ylabel(_unit("residual", signal.unit))


def state(axis: Axes, run: Run, i: int) -> None:
    """Bounds of one state, with the true state where it is known."""
    lo, hi, x = run.trace.x_lo[run.window, i], run.trace.x_hi[run.window, i], run.truth.x[run.window, i]
    _faults(axis, run)
    _band(axis, run, lo, hi)
    index = pick(x[:, None], BUCKETS)
    axis.plot(run.time[index], x[index], color=TRUTH, linewidth=1.0)
    _limits(axis, [lo[run.calm], hi[run.calm], x])
    signal = run.plant.x[i]
    axis.set_title(f"State {signal.name}")
    axis.set_ylabel(_unit(signal.name, signal.unit))


def magnified(axis: Axes, run: Run, i: int) -> None:
    """Bounds of one state relative to the true state, or to their middle where it is not known."""
    lo, hi, x = (a.astype(float) for a in (run.trace.x_lo[run.window, i], run.trace.x_hi[run.window, i],
                                           run.truth.x[run.window, i]))
    centre = x if run.simulated else (lo + hi) / 2
    _faults(axis, run)
    _band(axis, run, lo - centre, hi - centre)
    if run.simulated:
        axis.axhline(0.0, color=TRUTH, linewidth=1.0)
    settled = run.calm & run.trace.assured[run.window] & ~np.any(run.truth.f[run.window] != 0, axis=1)
    settled = settled if settled.any() else run.calm
    _limits(axis, [(lo - centre)[settled], (hi - centre)[settled], np.zeros(1)])
    signal = run.plant.x[i]
    zero = "the true state" if run.simulated else "their middle"
    axis.set_title(f"State {signal.name}, magnified: bounds minus {zero}")
    axis.set_ylabel(_unit("distance", signal.unit))


def is_thin(run: Run, i: int) -> bool:
    """Whether the bounds could not be told from a line."""
    lo, hi = (a[run.window, i][run.calm] for a in (run.trace.x_lo, run.trace.x_hi))
    known = ~np.isnan(lo)
    return bool(known.any()) and bool(np.median((hi - lo)[known]) < THIN * (hi[known].max() - lo[known].min()))


def known_parameters(run: Run) -> list[int]:
    """Parameters whose values the run holds; a log may lack those that are not measured."""
    return [j for j in range(len(run.plant.theta)) if not np.isnan(run.truth.theta[run.window, j]).all()]


def parameter(axis: Axes, run: Run, j: int) -> None:
    """One parameter between its bounds, which may be others in each mode."""
    signal, value = run.plant.theta[j], run.truth.theta[run.window, j]
    index = pick(value[:, None], BUCKETS)
    axis.plot(run.time[index], value[index], color=MODE, linewidth=1.1)
    own = [(lo[j], hi[j]) for lo, hi in map(run.plant.theta_box, run.plant.modes)]
    for limits in np.array(own).T if len(set(own)) == 1 else ():
        axis.axhline(limits[0], color=EDGE, linewidth=0.8, linestyle="--")
    if len(set(own)) > 1:
        q = np.clip(run.truth.q[run.window], 0, len(own) - 1)
        for limit in np.array(own).T:
            edges = np.flatnonzero(np.diff(limit[q]))
            if len(edges) < BUCKETS:  # faster ones could not be told apart
                at = np.concatenate([[0], edges + 1])
                axis.stairs(limit[q][at], np.append(run.time[at], run.time[-1]), baseline=None, color=EDGE,
                            linewidth=0.8, linestyle="--")
    _limits(axis, [value, np.array(own)])
    error = f", measured to within {signal.error:g}" if signal.error else ""
    axis.set_title(f"Parameter {signal.name}{error if signal.measured else ', not measured'}; dashed: its bounds")
    axis.set_ylabel(signal.unit or signal.name)


def modes(axis: Axes, run: Run) -> None:
    """The active mode, one row per mode; where nobody tells it also which are possible, and which is decided for."""
    q, found = run.truth.q[run.window], getattr(run.trace, "mode_set", None)
    for mode in range(run.plant.n_modes):
        if found is not None:
            _bars(axis, run, found[run.window] >> mode & 1 == 1, mode, BAND)
        if found is None or run.simulated:
            _bars(axis, run, q == mode, mode, MODE, *() if found is None else (0.36,))
    if found is not None:
        axis.step(run.time, run.trace.mode[run.window], where="post", color=EDGE, linewidth=1.1)
        axis.set_title("Mode: " + "true (dark), " * run.simulated + "not ruled out (light), decided for (line)")
    names = [m.name if len(m.name) <= 12 else m.name[:11] + "…" for m in run.plant.modes]
    _rows(axis, names, "mode")


def joint_only(run: Run) -> Array:
    """Shown samples at which every residual is within its own bound, and all of them together outside their set."""
    raw = run.trace.raw_bits[run.window]
    return (raw == 1 << run.plant.n_y) if hasattr(run.trace, "r_bound") else np.zeros(len(raw), dtype=bool)


def monitor(axis: Axes, run: Run) -> None:
    """What was wrong and what the firmware said of it."""
    refused = run.trace.status[run.window] != 0
    rows = [("fault", np.any(run.truth.f[run.window] != 0, axis=1), FAULT),
            ("alarm", run.trace.alarm[run.window], ALARM), ("assured", run.trace.assured[run.window], ASSURED)]
    rows += [("refused", refused, TRUTH)] if refused.any() else []
    joint = joint_only(run)
    rows[1:1] = [("only jointly", joint, ALARM)] if joint.any() else []
    for row, (name, on, colour) in enumerate(rows):
        if name == "assured":  # where several samples share a column, one without guarantee is enough
            lost = np.zeros_like(on)
            for start, stop in stretches(~on):
                lost[start:stop] = True
            on = ~lost
        _bars(axis, run, on, row, colour)
    _rows(axis, [name for name, _, _ in rows], "monitor")


def _bars(axis: Axes, run: Run, on: Array, row: int, colour: str, height: float = 0.72) -> None:
    period = run.plant.sample_period
    spans = [((run.start + a) * period, (b - a) * period) for a, b in stretches(on)]
    axis.broken_barh(spans, (row - height / 2, height), facecolor=colour, edgecolor=colour, linewidth=0.4)


def _rows(axis: Axes, names: list[str], label: str) -> None:
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.tick_params(axis="y", length=0)
    axis.set_ylabel(label)


def _faults(axis: Axes, run: Run) -> None:
    period = run.plant.sample_period
    for start, stop in stretches(np.any(run.truth.f[run.window] != 0, axis=1)):
        span = (run.start + start) * period, (run.start + stop) * period
        axis.axvspan(*span, facecolor=FAULT, alpha=0.35, linewidth=0)


def _band(axis: Axes, run: Run, lo: Array, hi: Array) -> None:
    """The area between the bounds: outlined while they are assured, grey where they are not."""
    assured = run.trace.assured[run.window]
    changes = np.flatnonzero(np.diff(assured))
    changes = changes if len(changes) < BUCKETS else changes[:0]
    index = np.union1d(pick(np.stack([lo, hi], axis=1).astype(float), BUCKETS), [*changes, *(changes + 1)]).astype(int)
    time, lo, hi, assured = run.time[index], lo[index], hi[index], assured[index]
    idle = ~assured
    idle[1:] |= ~assured[:-1]  # the grey area reaches up to its neighbours
    idle[:-1] |= ~assured[1:]
    axis.fill_between(time, lo, hi, where=idle, facecolor=IDLE, edgecolor=IDLE, linewidth=0.8)
    axis.fill_between(time, lo, hi, where=assured, facecolor=BAND, edgecolor=EDGE, linewidth=0.9)
    if run.stop - run.start <= DOTS:
        for curve in (lo, hi):
            axis.plot(time, curve, color=EDGE, linewidth=0, marker=".", markersize=3)


def _limits(axis: Axes, values: list[Array]) -> None:
    """Show these values, and a margin; what is further out is cut."""
    every = np.concatenate([np.asarray(v, dtype=float).ravel() for v in values])
    every = every[np.isfinite(every)]
    lo, hi = (every.min(), every.max()) if len(every) else (-1.0, 1.0)
    pad = 0.1 * (hi - lo) or 0.1 * abs(hi) or 1.0
    axis.set_ylim(lo - pad, hi + pad)
    axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=False)


def _unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
