"""From the text of a plant file to a Plant: every check in the order in which a reader would make it."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from codegen.errors import PlantError
from codegen.plant.matrices import modes_of
from codegen.plant.messages import first_error, unknown
from codegen.plant.model import Plant, Switching, Target
from codegen.plant.names import check_plant_name, check_symbols, check_text, prefix_of
from codegen.plant.polytopic import Polytope
from codegen.plant.scenarios import scenarios_of
from codegen.plant.schema import PlantFile, SwitchingTable, TargetTable
from codegen.plant.signals import initial_box, signals_of
from codegen.plant.values import Cycle, shown

#: Samples in a period of a schedule.
LONGEST_SCHEDULE = 256
#: Samples of a dwell time: proofs walk along it, and the firmware counts in 32 bits.
LONGEST_DWELL = 100000


def build(text: str, folder: str = "", scenarios: bool = True) -> Plant:
    """Return the plant that a TOML text states.

    Parameters
    ----------
    text : str
    folder : str
        Where CSV records are looked for.
    scenarios : bool
        False leaves the scenarios out, and with them the need for the CSV records.

    Returns
    -------
    plant : Plant

    Raises
    ------
    PlantError
        Anything wrong with the text; the message starts with the place, not with the file.
    """
    raw = _parsed(text)
    try:
        file = PlantFile.model_validate(raw)
    except ValidationError as error:
        raise PlantError(first_error(error, raw)) from None
    check_plant_name(file.name)
    check_text("title", file.title)
    check_text("source", file.source)
    signals = signals_of(file.signals)
    check_symbols(file.constants, (s.name for s in signals["theta"]))
    x0_lo, x0_hi = initial_box(file.initial, signals["x"])
    polytope = _polytope(file, signals)
    modes = modes_of(file, signals) if polytope is None else ()
    names = [mode.name for mode in modes]
    return Plant(
        name=file.name,
        title=file.title,
        source=file.source,
        kind=file.time.kind,
        sample_period=float(file.time.sample_period),
        **signals,
        x0_lo=x0_lo,
        x0_hi=x0_hi,
        modes=modes,
        switching=replace(_switching(file.switching, file.time.sample_period), schedule=_schedule(file, names)),
        method=file.observer.method,
        options=dict(file.observer.model_extra or {}),
        target=_target(file.name, file.target),
        scenarios=scenarios_of(file, signals, names, folder) if scenarios else (),
        constants=dict(file.constants),
        text=text,
        folder=folder,
        polytope=polytope,
    )


def _polytope(file: PlantFile, signals: dict) -> Polytope | None:
    if file.nonlinear is None and not file.vertex:
        return None
    from codegen.plant.vertices import polytope_of  # sympy takes half a second that most plants need not pay
    return polytope_of(file, signals)


def _parsed(text: str) -> dict[str, Any]:
    if not text.strip():
        raise PlantError("the file is empty (expected a plant in TOML). Start from: residua init NAME.")
    try:
        raw = tomllib.loads(text)
    except RecursionError:
        raise PlantError("the TOML nests too deeply. Flatten it.") from None
    except ValueError as error:  # TOMLDecodeError, or an integer of thousands of digits
        what, _, where = re.sub(r"\)$", "", str(error)).rpartition(" (at ")
        raise PlantError(f"{where}: no TOML: {what}. Correct the line.") from None
    if "format" not in raw:
        raise PlantError('the key "format" is missing. Add format = 1 as the first line.')
    if type(raw["format"]) is not int or raw["format"] != 1:
        raise PlantError(f"format: is {shown(raw['format'])} (expected 1). Write format = 1.")
    return raw


def _switching(table: SwitchingTable, period: float) -> Switching:
    if table.late and not table.known:
        raise PlantError("switching.late: is true where nobody tells the mode (known = false). Leave one of them out.")
    for name in ("average_dwell", "minimum_dwell"):
        value = getattr(table, name)
        if value is not None and value > LONGEST_DWELL * period:
            raise PlantError(f"switching.{name}: is {value:g} s, {value / period:.3g} samples (expected at most "
                             f"{LONGEST_DWELL}). State a shorter one: it covers whatever switches more slowly.")
    if table.average_dwell is not None and table.minimum_dwell is not None:
        raise PlantError("switching: average_dwell and minimum_dwell are both given. Give one of them.")
    if table.minimum_dwell is not None:
        if table.chatter != 1:
            raise PlantError(
                f"switching.chatter: is {table.chatter:g} (expected 1 with minimum_dwell). "
                "Leave it out, or give average_dwell."
            )
        return Switching(table.known, float(table.minimum_dwell), 1.0, table.late)
    if table.average_dwell is None:
        if table.chatter != 1:
            raise PlantError(
                f"switching.chatter: is {table.chatter:g}, but there is no average_dwell. Add average_dwell."
            )
        return Switching(table.known, late=table.late)
    return Switching(table.known, float(table.average_dwell), float(table.chatter), table.late)


def _schedule(file: PlantFile, names: list[str]) -> tuple[int, ...]:
    """Modes of one period of ``switching.schedule``."""
    cycle, place = file.switching.schedule, "switching.schedule"
    if cycle is None:
        return ()
    if not isinstance(cycle, Cycle):
        raise PlantError(f"{place}: is a list (expected a period that repeats). Write e.g. {{ every = 5, order = "
                         '["a", "b"] }, with every = 1 and all samples of the period if stays differ.')
    for name in cycle.order:
        if name not in names:
            raise PlantError(f"{place}: {unknown('mode', name, names)}")
    period = [names.index(name) for name in cycle.order for _ in range(cycle.every)]
    if len(period) > LONGEST_SCHEDULE:
        raise PlantError(f"{place}: has {len(period)} samples (expected at most {LONGEST_SCHEDULE}: each is a row of a "
                         "table). Leave it out and give minimum_dwell.")
    stays = np.diff([k for k in range(2 * len(period)) if period[k % len(period)] != period[(k - 1) % len(period)]])
    shortest, declared = (min(stays) if len(stays) else np.inf), file.switching.minimum_dwell
    if declared is not None and shortest * file.time.sample_period < declared * (1 - 1e-9):
        raise PlantError(f"{place}: has a stay of {shortest * file.time.sample_period:g} s (expected at least the "
                         f"minimum_dwell of {declared:g} s). Correct one of them.")
    return tuple(period)


def _target(name: str, table: TargetTable) -> Target:
    debounce = table.alarm.debounce
    if len(debounce) != 2 or not 1 <= debounce[0] <= debounce[1] <= 32:
        raise PlantError(
            f"target.alarm.debounce: is {shown(debounce)} (expected [m, n] with 1 <= m <= n <= 32). "
            "Write e.g. [2, 3] for two of three samples."
        )
    return Target(
        prefix=prefix_of(name, table.prefix),
        real=table.real,
        layout=table.layout,
        debounce=(debounce[0], debounce[1]),
        latch=table.alarm.latch,
        recover=table.recover,
        hold=table.hold,
    )
