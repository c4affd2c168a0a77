"""Recorded logs: CSV or MDF4, as the samples that the firmware would have read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import PlantError, ToolError
from ..plant.model import Plant, PlantTrace
from ..plant.record import Record, read_record

Array = np.ndarray
CLOCKS = ("t", "time")  # columns that are times in seconds, where no signal has such a name


def read_log(plant: Plant, path: Path) -> tuple[PlantTrace, bool]:
    """Read a log whose columns or channels are named after the plant's signals.

    Needed are every input, output and measured parameter, and ``mode`` where the firmware is told one. Fault columns
    are labels; a parameter that the firmware does not read is only drawn. Others are left alone.

    Parameters
    ----------
    plant : Plant
    path : Path
        ``.csv``, or ``.mf4``/``.mdf`` (needs asammdf). In CSV an empty or ``nan`` output is a missing sample.

    Returns
    -------
    truth : PlantTrace
        y is NaN where a sample is missing; x, w, v are NaN throughout, theta where the log has no column.
    labelled : bool
        The log has a column for a fault.

    Raises
    ------
    PlantError
        The file or a column is missing, a cell is no number, a mode is unknown, the sample period is another.
    ToolError
        An MDF file, and asammdf is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise PlantError(f"{path}: no such file. Give a CSV or MDF4 log.")
    if path.suffix.lower() in (".mf4", ".mdf"):
        record = _read_mdf(plant, path)
    else:
        record = replace(read_record(path.name, str(path.parent)), name=path.name)
    _check_columns(plant, record)
    _check_clock(plant, record)
    labels = np.zeros((record.steps, plant.n_f))
    known = [(j, s) for j, s in enumerate(plant.f) if s.name in record.columns]
    for j, signal in known:
        labels[:, j] = record.numbers((signal,))[:, 0]
    theta = np.full((record.steps, len(plant.theta)), np.nan)
    for j, signal in enumerate(plant.theta):
        if signal.name in record.columns:
            theta[:, j] = record.numbers((signal,), gaps=not signal.measured)[:, 0]
    unknown = {name: np.full((record.steps, n), np.nan)
               for name, n in (("x", plant.n_x), ("w", plant.n_w), ("v", plant.n_v))}
    q = (record.modes(tuple(m.name for m in plant.modes)) if "mode" in record.columns
         else np.zeros(record.steps, dtype=int))
    truth = PlantTrace(u=record.numbers(plant.u), y=record.numbers(plant.y, gaps=True), q=q, f=labels, theta=theta,
                       **unknown)
    return truth, bool(known)


def _needed(plant: Plant) -> list[str]:
    measured = [s for s in plant.theta if s.measured]
    told = plant.n_modes > 1 and plant.switching.known
    return [*(s.name for s in (*plant.u, *plant.y, *measured)), *(["mode"] if told else [])]


def _check_columns(plant: Plant, record: Record) -> None:
    """Every needed column must be there, and name one signal only."""
    names = ["mode", *(s.name for vector in (plant.u, plant.y, plant.f, plant.theta) for s in vector)]
    for name in _needed(plant):
        if name not in record.columns:
            hint = f"; mode holds {', '.join(m.name for m in plant.modes)}, or indices from 0" if name == "mode" else ""
            raise PlantError(f'{record.name}: has no column "{name}" (found: {", ".join(record.columns)}; expected: '
                             f"{', '.join(_needed(plant))}). Name the columns as in [signals]{hint}.")
    for name in record.columns:
        if names.count(name) > 1:
            raise PlantError(f'{record.name}: the column "{name}" names two signals (of mode, u, y, f, theta). Rename '
                             "one in [signals] and in the header.")


def _check_clock(plant: Plant, record: Record) -> None:
    """A time column, if there is one, must advance by the sample period."""
    signals = {s.name for vector in (plant.u, plant.y, plant.f, plant.theta) for s in vector}
    clock = next((name for name in CLOCKS if name in record.columns and name not in signals), None)
    if clock is None or record.steps < 2:
        return
    try:
        times = np.array([float(cell) for cell in record.columns[clock]])
    except ValueError:
        return  # dates and the like
    period = float(np.median(np.diff(times)))
    if not abs(period - plant.sample_period) <= 0.01 * plant.sample_period:
        raise PlantError(f'{record.name}: column "{clock}" advances by {period:g} per row (found), expected the sample '
                         f"period of {plant.sample_period:g} s. Resample the log, or rename the column if it is no "
                         "time in seconds.")


def _read_mdf(plant: Plant, path: Path) -> Record:
    """The needed channels of an MDF file on the plant's sample period, as the columns of a record."""
    try:
        from asammdf import MDF
    except ImportError:
        raise ToolError(f"{path}: reading MDF needs asammdf. Install it: pip install residua[mdf], or export the log "
                        "as CSV.") from None
    optional = [s.name for s in (*plant.f, *plant.theta)] + ["mode"]
    try:
        with MDF(path) as mdf:
            names = [n for n in dict.fromkeys([*_needed(plant), *optional]) if n in mdf.channels_db]
            # A name may occur in several groups: take the first.
            signals = {n: mdf.get(n, group=mdf.channels_db[n][0][0], index=mdf.channels_db[n][0][1]) for n in names}
            found = sorted(mdf.channels_db)
    except Exception as error:
        raise PlantError(f"{path}: cannot be read as MDF ({type(error).__name__}: {error}). Export it again, or as "
                         "CSV.") from error
    empty = [n for n in _needed(plant) if n not in signals or not len(signals[n].samples)]
    if empty:
        raise PlantError(f'{path.name}: has no channel "{empty[0]}" with samples (found: {", ".join(found)}). Name the '
                         "channels as in [signals].")
    channels = {n: (np.asarray(s.timestamps, float), np.asarray(s.samples)) for n, s in signals.items()
                if len(s.samples)}
    columns = resample(channels, plant.sample_period, {s.name for s in plant.y})
    steps = len(next(iter(columns.values())))
    return Record(path.name, columns, tuple(range(steps)))


def resample(channels: dict[str, tuple[Array, Array]], period: float, measured: set[str]) -> dict[str, list[str]]:
    """Bring channels with clocks of their own onto one clock.

    A sample is the last value stamped before the middle of the next period. An output that has none within
    its period is missing; other channels keep their last value.

    Parameters
    ----------
    channels : dict
        Name -> (times (K,) ascending, values (K,)).
    period : float
        Seconds.
    measured : set of str
        Names of the outputs.

    Returns
    -------
    columns : dict
        Name -> cells, as a CSV file would hold them.
    """
    start = max(times[0] for times, _ in channels.values())
    stop = min(times[-1] for times, _ in channels.values())
    clock = start + period * np.arange(max(0, int(np.floor((stop - start) / period + 1e-6))) + 1)
    columns = {}
    for name, (times, values) in channels.items():
        index = np.maximum(np.searchsorted(times, clock + period / 2, side="left") - 1, 0)
        stale = (times[index] < clock - period / 2) & (name in measured)
        columns[name] = ["" if old else _cell(v) for old, v in zip(stale, values[index])]
    return columns


def _cell(value) -> str:
    """A value of an MDF channel as a CSV cell; numbers read back exactly."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 ")
    if isinstance(value, str):
        return value
    number = float(value)
    return str(int(number)) if number.is_integer() else repr(number)
