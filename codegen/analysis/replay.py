"""Replay: the compiled observer over a recorded log."""

from __future__ import annotations

import csv
import os
from contextlib import suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from ..errors import EmitError
from ..observers import BankTrace, FilterTrace, GuidedFilterTrace, PolytopicTrace, TrailingTrace
from ..plant.model import Plant, PlantTrace, Scenario
from . import plots, svg
from .logs import read_log
from .validate import Outcome, judge

BOUNDS, PLOT = "bounds.csv", "replay.svg"


@dataclass(frozen=True)
class ReplayResult:
    """What a replay found.

    Parameters
    ----------
    log : Path
    outcome : Outcome
        The run, judged as a scenario: ``truth`` is the log, ``trace`` the firmware's answers, ``episodes`` the
        labelled faults. Its ``false_alarms`` count only where ``labelled``.
    labelled : bool
        The log says when faults acted.
    period : float
        Seconds.
    bounds, plot : Path
        The files written.
    """

    log: Path
    outcome: Outcome
    labelled: bool
    period: float
    bounds: Path
    plot: Path

    @property
    def alarms(self) -> list[tuple[int, int]]:
        """Stretches [start, stop) of samples with an alarm."""
        return svg.stretches(self.outcome.trace.alarm, longest=len(self.outcome.trace.alarm))

    def rows(self) -> list[tuple[str, str]]:
        """Return the table that the command line prints, as pairs of text."""
        trace, o = self.outcome.trace, self.outcome
        missing = int(np.sum(np.isnan(o.truth.y).any(axis=1)))
        refused = int(np.sum(trace.status != 0))
        alarms = self.alarms
        first = f"; the first at sample {alarms[0][0]} ({alarms[0][0] * self.period:g} s)" if alarms else ""
        rows = [("log", str(self.log)), ("samples", str(len(trace.status))), ("missing samples", str(missing)),
                ("refused samples", f"{refused}{_reasons(trace.status)}"),
                ("assured", f"{np.floor(1000 * np.mean(trace.assured)) / 10:g} %"),
                ("alarms", f"{len(alarms)}, {int(trace.alarm.sum())} samples{first}")]
        if self.labelled:
            found = sum(e.delay is not None for e in o.episodes)
            rows += [("false alarms", f"{o.false_alarms} samples (outside labelled faults and the hold time)"),
                     ("faults found", f"{found} of {len(o.episodes)}"),
                     *((f"{e.channel}, samples {e.start} to {e.stop - 1}", self._found(e)) for e in o.episodes)]
        else:
            rows.append(("false alarms", "not known: the log has no fault column"))
        return [*rows, ("bounds", str(self.bounds)), ("plot", str(self.plot))]

    def _found(self, e) -> str:
        if e.delay is None:
            return f"size {e.size:g}: not found"
        return f"size {e.size:g}: found after {e.delay} samples ({1e3 * e.delay * self.period:g} ms)"


def replay(design, driver, log_path, out_dir, progress=lambda text: None, from_range: bool = False) -> ReplayResult:
    """Run the compiled observer over a log; write its bounds and a plot.

    Parameters
    ----------
    design : Design
    driver : Driver
        Of ``host.build``.
    log_path : str or Path
        See ``logs.read_log``.
    out_dir : str or Path
        Gets ``bounds.csv`` and ``replay.svg``; each appears whole or not at all.
    progress : callable
        Gets one line per step.
    from_range : bool
        Start from the declared ranges instead of the initial box: for a log that begins anywhere.

    Returns
    -------
    ReplayResult

    Raises
    ------
    PlantError
        The log does not fit the plant.
    ToolError
        An MDF file, and asammdf is not installed.
    EmitError
        The results cannot be written.
    """
    plant, log, out_dir = design.plant, Path(log_path), Path(out_dir)
    progress(f"reading {log.name}")
    truth, labelled = read_log(plant, log)
    progress(f"replaying {len(truth.q)} samples")
    box = plant.limits("x") if from_range else (None, None)
    trace = driver.run(u=truth.u, y=truth.y, q=truth.q, theta=truth.theta, x0_lo=box[0], x0_hi=box[1])
    scenario = Scenario(name=log.name, steps=len(truth.q), mode=((0, 0),), u=(), csv=log.name)
    outcome = judge(plant, scenario, truth, trace, [])
    progress("writing bounds and plot")
    figure = plots.run_figure(plots.whole(plant, truth, trace))
    _write(out_dir, {BOUNDS: table(plant, truth, trace), PLOT: svg.standalone(figure)})
    return ReplayResult(log, outcome, labelled, plant.sample_period, out_dir / BOUNDS, out_dir / PLOT)


def table(plant: Plant, truth: PlantTrace, trace) -> str:
    """Print the firmware's answers as CSV: one row per sample, empty cells where there is no number.

    Parameters
    ----------
    plant : Plant
    truth : PlantTrace
    trace : Trace

    Returns
    -------
    text : str
        Columns k, t, x_lo.<state> ..., x_hi.<state> ..., r_lo.<output> ..., r_hi.<output> ..., alarm, latched,
        assured, status; of a filter f_hat.<fault> ..., f_bound.<fault> ... in place of the bounds, where it finds the
        mode after them; of a polytopic observer x_hat.<state> ..., r.<output> ..., r_bound.<output> ...; of a bank
        r.<fault> ..., r_bound.<fault> ...; then the words that only this family has. Every number reads back exactly.
    """
    names = {"x_lo": plant.x, "x_hi": plant.x, "r_lo": plant.y, "r_hi": plant.y}
    if isinstance(trace, FilterTrace):
        names = {"f_hat": plant.f, "f_bound": plant.f}
    elif isinstance(trace, PolytopicTrace):
        names = {"x_hat": plant.estimated(trace.x_hat.shape[-1]), "r": plant.y, "r_bound": plant.y}
    elif isinstance(trace, BankTrace):
        names = {"r": plant.f, "r_bound": plant.f}
    elif isinstance(trace, TrailingTrace | GuidedFilterTrace):
        names |= {"f_hat": plant.f, "f_bound": plant.f}
    header = ["k", "t", *(f"{field}.{s.name}" for field, signals in names.items() for s in signals),
              "alarm", "latched", "assured", "status",
              *trace.word_names()]
    columns = [column for field in names for column in getattr(trace, field).T]
    cells = [["" if np.isnan(v) else str(v) for v in column] for column in columns]
    flags = [a.astype(int).tolist() for a in (
        trace.alarm, trace.latched_bits, trace.assured, trace.status,
        *(getattr(trace, name) for name in trace.word_names()))]
    steps = range(len(truth.q))
    out = StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(zip(steps, (f"{k * plant.sample_period:.12g}" for k in steps), *cells, *flags))
    return out.getvalue()


def _write(folder: Path, texts: dict[str, str]) -> None:
    """Write files beside their places, then move all of them there."""
    parts = {folder / f"{name}.part": folder / name for name in texts}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for part, text in zip(parts, texts.values()):
            part.write_text(text, encoding="utf-8", newline="\n")
        for part, place in parts.items():
            os.replace(part, place)
    except OSError as error:
        for part in parts:
            with suppress(OSError):
                part.unlink()
        raise EmitError(f"{folder}: {error.strerror or error}. Choose a folder that can be written.") from error


def _reasons(status) -> str:
    """Count the samples that the firmware refused, by reason."""
    words = {1: "unknown mode", 2: "input out of range", 3: "output out of range",
             4: "parameter out of its bounds"}
    counts = [f"{int(np.sum(status == code))} {text}" for code, text in words.items() if np.any(status == code)]
    return f" ({', '.join(counts)})" if counts else ""
