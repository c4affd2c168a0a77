"""Scenarios, checked against the plant: names, lengths, and that every expression can be read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from codegen.errors import PlantError
from codegen.plant.expression import ExpressionError, sampled
from codegen.plant.messages import unknown
from codegen.plant.model import Fault, Scenario, Signal
from codegen.plant.names import check_text
from codegen.plant.record import Record, read_record
from codegen.plant.schema import FaultTable, PlantFile, ScenarioTable
from codegen.plant.signals import count
from codegen.plant.values import Cycle, shown

_FIRST = np.zeros(1)  # one sample is enough to see whether an expression can be read


@dataclass(frozen=True)
class _Context:
    """What a scenario is checked against."""

    place: str
    signals: Mapping[str, tuple[Signal, ...]]
    modes: tuple[str, ...]
    constants: Mapping[str, float]
    sample_period: float
    instants: bool
    dwell: float  # samples between switches at least, where nobody watches that; 0 elsewhere

    def fail(self, key: str, message: str) -> PlantError:
        return PlantError(f"{self.place}.{key}: {message}")


def scenarios_of(
    file: PlantFile, signals: Mapping[str, tuple[Signal, ...]], modes: Sequence[str], folder: str
) -> tuple[Scenario, ...]:
    """Return the scenarios of a plant file.

    Parameters
    ----------
    file : PlantFile
    signals : dict
        From `signals_of`.
    modes : sequence of str
        Mode names.
    folder : str
        Where CSV records are looked for.

    Returns
    -------
    scenarios : tuple of Scenario

    Raises
    ------
    PlantError
        Two scenarios of one name, an unknown mode or channel, an expression that cannot be read, a wrong
        length,
        a CSV record that is missing or too short.
    """
    names = [table.name for table in file.scenario]
    result = []
    for i, table in enumerate(file.scenario):
        check_text(f"scenarios.#{i + 1}.name", table.name)
        if table.name in names[:i]:
            raise PlantError(f"scenarios: the name {shown(table.name)} is used twice. Rename one.")
        place = f"scenarios.{table.name}"
        context = _Context(place, signals, tuple(modes), file.constants, file.time.sample_period,
                           file.time.kind == "continuous" and not file.switching.known,
                           0 if file.switching.known else (file.switching.minimum_dwell or 0) / file.time.sample_period)
        result.append(_scenario(table, context, folder))
    return tuple(result)


def _scenario(table: ScenarioTable, context: _Context, folder: str) -> Scenario:
    try:
        record = read_record(table.csv, folder) if table.csv else None
        _refuse_ambiguous(record, context)
        steps = _steps(table, record, context)
        u = _inputs(table, record, context)
        is_record = record is not None and record.has(context.signals["y"])
    except PlantError as error:
        raise error if str(error).startswith(context.place) else context.fail("csv", str(error)) from None
    if is_record and u:
        raise context.fail("csv", "has a column for every output but none for the inputs. Add their columns.")
    return Scenario(
        name=table.name,
        steps=steps,
        mode=_schedule(table, record, steps, context),
        u=u,
        w=_excitation(table.w, "w", context),
        v=_excitation(table.v, "v", context),
        theta=_excitation(table.theta, "theta", context),
        fault=tuple(_fault(fault, steps, context) for fault in table.fault),
        csv=table.csv,
    )


def _refuse_ambiguous(record: Record | None, context: _Context) -> None:
    """A column that names two signals would be read as both."""
    if record is None:
        return
    names = ["mode", *(s.name for vector in ("u", "y", "f", "theta") for s in context.signals[vector])]
    for column in record.columns:
        if names.count(column) > 1:
            raise PlantError(
                f'{record.name}: the column "{column}" names two signals (of mode, u, y, f, theta). '
                "Rename one in [signals] and in the header."
            )


def _steps(table: ScenarioTable, record: Record | None, context: _Context) -> int:
    if table.steps is not None and table.duration is not None:
        raise context.fail("steps", "steps and duration are both given. Give one of them.")
    steps = table.steps
    if table.duration is not None:
        # The tolerance keeps 0.3 s at 0.1 s from becoming 4 samples.
        steps = max(1, math.ceil(table.duration / context.sample_period - 1e-9))
    if steps is None and record is None:
        raise context.fail("steps", "is missing (expected steps, duration or csv). Add e.g. steps = 200.")
    if record is not None and steps is not None and steps > record.steps:
        raise context.fail(
            "steps", f"is {steps}, but {table.csv} has {record.steps} rows. Give at most {record.steps}."
        )
    return record.steps if steps is None else steps


def _inputs(table: ScenarioTable, record: Record | None, context: _Context) -> tuple[str, ...]:
    """One expression per input; none where the record has the inputs."""
    inputs = context.signals["u"]
    recorded = record is not None and record.has(inputs)
    if recorded and table.u is not None:
        raise context.fail("u", f"the inputs are in {table.csv} too. Leave u out, or remove the columns.")
    if recorded or not inputs:
        if table.u:
            raise context.fail("u", f"has {len(table.u)} expressions, but signals.u is empty. Leave u out.")
        return ()
    if table.u is None:
        raise context.fail(
            "u",
            f"is missing (u has {count(inputs)}). Add one expression per input, or a csv with their columns.",
        )
    return _expressions(table.u, "u", context)


def _excitation(value: str | list[str], vector: str, context: _Context) -> str | tuple[str, ...]:
    return value if isinstance(value, str) else _expressions(value, vector, context)


def _expressions(texts: list[str], vector: str, context: _Context) -> tuple[str, ...]:
    signals = context.signals[vector]
    if len(texts) != len(signals):
        raise context.fail(
            vector,
            f"has {len(texts)} expressions, expected {len(signals)} ({vector} has {count(signals)}). "
            f"Give one per channel: {', '.join(s.name for s in signals)}.",
        )
    for signal, text in zip(signals, texts):
        _check_expression(text, f"{vector}.{signal.name}", context)
    return tuple(texts)


def _check_expression(text: str, key: str, context: _Context) -> None:
    try:
        sampled(text, context.constants, _FIRST, _FIRST)
    except ExpressionError as error:
        raise context.fail(key, f"{error}.") from None


def _schedule(
    table: ScenarioTable, record: Record | None, steps: int, context: _Context
) -> tuple[tuple[int, int], ...]:
    if record is not None and "mode" in record.columns:
        record.modes(context.modes)
        return ((0, 0),)
    if table.mode is None:
        if len(context.modes) > 1:
            raise context.fail(
                "mode", 'is missing (the plant has several modes). Add e.g. mode = [[0, "name"]].'
            )
        return ((0, 0),)
    schedule = table.mode
    if isinstance(schedule, Cycle):
        order = schedule.order
        starts = range(0, steps, schedule.every)
        schedule = [(sample, order[i % len(order)]) for i, sample in enumerate(starts)]
    previous = -1
    for sample, name in schedule:
        if name not in context.modes:
            raise context.fail("mode", unknown("mode", name, context.modes))
        if previous < 0 and sample != 0:
            raise context.fail("mode", f"starts at sample {sample} (expected 0). Add the mode at sample 0.")
        if sample <= previous:
            raise context.fail("mode", f"sample {sample} comes after sample {previous}. Sort the samples.")
        if sample != int(sample) and not context.instants:
            raise context.fail("mode", f"sample {sample:g} is not whole (expected that where the mode is known or time "
                               "is discrete). Round it, or set switching.known = false where nobody tells the mode.")
        if sample >= steps:
            raise context.fail("mode", f"sample {sample} is past the end (steps is {steps}). Remove it.")
        if previous > 0 and sample - previous < context.dwell * (1 - 1e-9):
            raise context.fail("mode", f"samples {previous:g} to {sample:g} are {sample - previous:g} (expected "
                               f"{context.dwell:g} at least, switching.minimum_dwell; nothing watches it where the "
                               "mode is not known). Space the switches.")
        previous = sample
    if previous < 0:
        raise context.fail("mode", 'is empty. Give e.g. [[0, "name"]].')
    return tuple((sample, context.modes.index(name)) for sample, name in schedule)


def _fault(table: FaultTable, steps: int, context: _Context) -> Fault:
    names = [s.name for s in context.signals["f"]]
    if table.channel not in names:
        raise context.fail("fault", unknown("fault channel", table.channel, names))
    stop = steps if table.stop is None else table.stop
    if not table.start < stop <= steps:
        raise context.fail(
            f"fault.{table.channel}",
            f"from {table.start} to {stop} (expected from < to <= {steps}, the steps). Correct the samples.",
        )
    _check_expression(table.value, f"fault.{table.channel}.value", context)
    return Fault(names.index(table.channel), table.start, stop, table.value)
