"""Signals, their limits and the initial box, from the checked tables."""

from __future__ import annotations

import numpy as np

from codegen.errors import PlantError
from codegen.plant.model import Array, Signal
from codegen.plant.names import check_channels, check_text
from codegen.plant.schema import InitialTable, InputSignal, SignalsTable, ThetaSignal

VECTORS = ("x", "u", "y", "w", "v", "f", "theta")


def signals_of(table: SignalsTable) -> dict[str, tuple[Signal, ...]]:
    """Return the signals of each vector.

    Parameters
    ----------
    table : SignalsTable

    Returns
    -------
    signals : dict
        Vector name ("x", "u", ...) -> tuple of Signal.

    Raises
    ------
    PlantError
        A name is used twice or makes no C name, a unit is no plain text, or the range of a state or an output
        is a single point.
    """
    signals = {}
    for vector in VECTORS:
        rows = getattr(table, vector)
        check_channels(f"signals.{vector}", (row.name for row in rows))
        for row in rows:
            check_text(f"signals.{vector}.{row.name}.unit", row.unit)
        signals[vector] = tuple(_signal(row) for row in rows)
    for vector in ("x", "y"):
        for signal in signals[vector]:
            if signal.lo == signal.hi:
                raise PlantError(
                    f"signals.{vector}.{signal.name}.range: is the single point {signal.lo:g} (expected lo < "
                    "hi). Widen it."
                )
    return signals


def initial_box(table: InitialTable, x: tuple[Signal, ...]) -> tuple[Array, Array]:
    """Return the box of the initial state.

    Parameters
    ----------
    table : InitialTable
    x : tuple of Signal
        The states.

    Returns
    -------
    x0_lo, x0_hi : ndarray (n_x,)

    Raises
    ------
    PlantError
        Wrong length, the wrong way round, or outside the declared range of a state.
    """
    for key in ("x_lo", "x_hi"):
        values = getattr(table, key)
        if len(values) != len(x):
            raise PlantError(
                f"initial.{key}: has {len(values)} numbers, expected {len(x)} (x has {count(x)}). "
                f"Give one per state: {', '.join(s.name for s in x)}."
            )
    for signal, lo, hi in zip(x, table.x_lo, table.x_hi):
        if lo > hi:
            raise PlantError(
                f"initial: the box of {signal.name} is the wrong way round (found x_lo {lo:g}, x_hi "
                f"{hi:g}). Swap them."
            )
        if lo < signal.lo or hi > signal.hi:
            raise PlantError(
                f"initial: the box of {signal.name} leaves its range (found [{lo:g}, {hi:g}], expected "
                f"inside [{signal.lo:g}, {signal.hi:g}]). Shrink the box, or widen "
                f"signals.x.{signal.name}.range."
            )
    return frozen(table.x_lo), frozen(table.x_hi)


def frozen(values: object) -> Array:
    """Return a read-only float64 array.

    Parameters
    ----------
    values : array_like

    Returns
    -------
    array : ndarray (any shape)
    """
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def count(signals: tuple[Signal, ...]) -> str:
    """Return "1 signal", "2 signals".

    Parameters
    ----------
    signals : tuple of Signal

    Returns
    -------
    text : str
    """
    return f"{len(signals)} signal" + ("" if len(signals) == 1 else "s")


def _signal(row: object) -> Signal:
    limits = getattr(row, "bounds", None) or getattr(row, "range", None) or (-np.inf, np.inf)
    if isinstance(row, ThetaSignal):
        rate = np.inf if row.rate is None else row.rate
        if row.error and not row.measured:
            raise PlantError(f"signals.theta.{row.name}.error: is {row.error:g}, but the parameter is not measured. "
                             "Leave it out, or set measured = true.")
        if row.error and row.error >= limits[1] - limits[0]:
            raise PlantError(f"signals.theta.{row.name}.error: is {row.error:g}, as much as its bounds are apart, "
                             f"{limits[1] - limits[0]:g}, or more: such a measurement says nothing. Give a smaller "
                             "one, or set measured = false and leave it out.")
        return Signal(row.name, row.unit, *limits, measured=row.measured, rate=rate, error=row.error)
    if isinstance(row, InputSignal):
        return Signal(row.name, row.unit, *limits, rate=row.rate or 0.0)
    return Signal(row.name, row.unit, *limits)
