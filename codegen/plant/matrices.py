"""Modes: matrices completed from ``[common]``, their entries evaluated, their shapes checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from codegen.errors import PlantError
from codegen.plant.affine import affine
from codegen.plant.expression import ExpressionError
from codegen.plant.messages import unknown
from codegen.plant.model import Array, Mode, Signal
from codegen.plant.names import check_channels
from codegen.plant.schema import MATRIX_NAMES, MatricesTable, ModeTable, PlantFile
from codegen.plant.signals import count, frozen

# Matrix -> the vectors that number its rows and its columns.
SHAPES = {
    "E": ("x", "x"),
    "A": ("x", "x"),
    "B": ("x", "u"),
    "C": ("y", "x"),
    "D": ("y", "u"),
    "Bw": ("x", "w"),
    "Dw": ("y", "w"),
    "Dv": ("y", "v"),
    "Bf": ("x", "f"),
    "Df": ("y", "f"),
}
# Left out, these are zero.
_ZERO_WHEN_MISSING = ("B", "D", "Dw", "Bf", "Df")

Signals = Mapping[str, tuple[Signal, ...]]
Rows = list[list[float | str]]


@dataclass(frozen=True)
class Source:
    """One matrix as written: its rows and where they stand."""

    place: str
    rows: Rows


def modes_of(file: PlantFile, signals: Signals) -> tuple[Mode, ...]:
    """Return the modes; a file without ``[[mode]]`` has the one mode "only" of ``[common]``.

    Parameters
    ----------
    file : PlantFile
    signals : mapping
        From `signals_of`.

    Returns
    -------
    modes : tuple of Mode

    Raises
    ------
    PlantError
        A matrix is missing, has the wrong shape or an entry with no value; the name of a mode or of a
        channel in
        ``bounds`` is wrong; the file asks for a descriptor plant (E).
    """
    tables = file.mode
    if not tables:
        if file.common.A is None:
            raise PlantError(
                "modes: there is none (expected [[mode]] tables, or A in [common]). Add a [[mode]]."
            )
        tables = [ModeTable(name="only")]
    check_channels("modes", (table.name for table in tables))
    return tuple(_mode(table, file, signals) for table in tables)


def _mode(table: ModeTable, file: PlantFile, signals: Signals) -> Mode:
    _refuse_descriptor(table, file.common, len(signals["x"]))
    matrices: dict[str, Array] = {}
    theta_terms: dict[str, tuple[Array, ...]] = {}
    if signals["f"] and all(_source("", table, file.common, name) is None for name in ("Bf", "Df")):
        raise PlantError(
            f"modes.{table.name}: Bf and Df are both missing (signals.f has {count(signals['f'])}). "
            "Give Bf for a fault on the state, Df for a fault on an output."
        )
    for name in MATRIX_NAMES:
        place = f"modes.{table.name}.{name}"
        source = _source(place, table, file.common, name)
        if source is None:
            matrices[name] = _missing(place, name, signals)
            continue
        check_shape(source, name, signals)
        terms = entries(source, name, file.constants, signals)
        matrices[name] = terms[0]
        if any(term.any() for term in terms[1:]):
            theta_terms[name] = terms[1:]
    bounds = _mode_bounds(table, signals)
    return Mode(name=table.name, **matrices, **bounds, theta_terms=theta_terms)


def _source(place: str, table: ModeTable, common: MatricesTable, name: str) -> Source | None:
    """The mode's own matrix, else the common one, with the place where the user has to look."""
    own, shared = getattr(table, name), getattr(common, name)
    if own is not None:
        return Source(place, own)
    return None if shared is None else Source(f"common.{name}", shared)


def _missing(place: str, name: str, signals: Signals) -> Array:
    rows, columns = (signals[vector] for vector in SHAPES[name])
    if columns and name not in _ZERO_WHEN_MISSING:
        raise PlantError(
            f"{place} is missing (expected {len(rows)}x{len(columns)}: {SHAPES[name][0]} has {count(rows)}, "
            f"{SHAPES[name][1]} has {len(columns)}). Add it to the mode or to [common]."
        )
    return frozen(np.zeros((len(rows), len(columns))))


def check_shape(source: Source, name: str, signals: Signals) -> None:
    """Refuse a matrix that has not as many rows and columns as there are signals.

    Parameters
    ----------
    source : Source
    name : str
        A key of `SHAPES`.
    signals : mapping
        From `signals_of`.

    Raises
    ------
    PlantError
    """
    vectors = SHAPES[name]
    n_rows, n_columns = (len(signals[vector]) for vector in vectors)
    found = (len(source.rows), len(source.rows[0]) if source.rows else 0)
    if found == (n_rows, n_columns):
        return
    if n_columns == 0:
        raise PlantError(
            f"{source.place} is {found[0]}x{found[1]}, but signals.{vectors[1]} is empty. "
            f"Declare {found[1]} signal{'s' * (found[1] > 1)} there, or leave {name} out."
        )
    reason = f"{vectors[0]} has {count(signals[vectors[0]])}"
    if vectors[1] != vectors[0]:
        reason += f", {vectors[1]} has {n_columns}"
    raise PlantError(
        f"{source.place} is {found[0]}x{found[1]}, expected {n_rows}x{n_columns} ({reason}). "
        f"Give {n_rows} row{'s' * (n_rows > 1)} of {n_columns}."
    )


def entries(
    source: Source, name: str, constants: Mapping[str, float], signals: Signals
) -> tuple[Array, ...]:
    """Return the constant part of a matrix, then one array per theta.

    Parameters
    ----------
    source : Source
        Of the right shape.
    name : str
        A key of `SHAPES`.
    constants : mapping
        The file's ``[constants]``.
    signals : mapping
        From `signals_of`.

    Returns
    -------
    parts : tuple of ndarray (1 + n_theta of the matrix's shape)

    Raises
    ------
    PlantError
        An entry cannot be read.
    """
    thetas = [signal.name for signal in signals["theta"]]
    shape = tuple(len(signals[vector]) for vector in SHAPES[name])
    parts = np.zeros((1 + len(thetas), *shape))
    for i, row in enumerate(source.rows):
        for j, entry in enumerate(row):
            if not isinstance(entry, str):
                parts[0, i, j] = entry
                continue
            try:
                parts[0, i, j], parts[1:, i, j] = affine(entry, constants, thetas)
            except ExpressionError as error:
                raise PlantError(f"{source.place}: row {i + 1}, column {j + 1}: {error}.") from None
    return tuple(frozen(part) for part in parts)


def _mode_bounds(table: ModeTable, signals: Signals) -> dict:
    known = [signal.name for vector in ("w", "v", "theta") for signal in signals[vector]]
    for name in table.bounds:
        if name not in known:
            raise PlantError(f"modes.{table.name}.bounds: {unknown('channel of w, v or theta', name, known)}")
        if known.count(name) > 1:
            raise PlantError(
                f'modes.{table.name}.bounds: "{name}" names two channels of w, v and theta. Rename one of the two.'
            )
    limits = {}
    for vector in ("w", "v"):
        pairs = [table.bounds.get(s.name, (s.lo, s.hi)) for s in signals[vector]]
        limits[f"{vector}_lo"] = frozen([lo for lo, _ in pairs])
        limits[f"{vector}_hi"] = frozen([hi for _, hi in pairs])
    if any(s.name in table.bounds for s in signals["theta"]):
        limits["theta_bounds"] = _theta_bounds(table, signals)
    return limits


def _theta_bounds(table: ModeTable, signals: Signals) -> tuple[Array, Array]:
    pairs = [table.bounds.get(s.name, (s.lo, s.hi)) for s in signals["theta"]]
    for signal, (lo, hi) in zip(signals["theta"], pairs):
        if lo < signal.lo or hi > signal.hi:
            raise PlantError(
                f"modes.{table.name}.bounds.{signal.name}: is [{lo:g}, {hi:g}], expected within "
                f"[{signal.lo:g}, {signal.hi:g}] of signals.theta. Widen those."
            )
    return frozen([lo for lo, _ in pairs]), frozen([hi for _, hi in pairs])


def _refuse_descriptor(table: ModeTable, common: MatricesTable, n_x: int) -> None:
    source = _source(f"modes.{table.name}.E", table, common, "E")
    if source is not None and source.rows != np.eye(n_x).tolist():
        raise PlantError(
            f"{source.place}: a plant with modes is no descriptor plant (found E other than the identity). "
            "Leave E out, or give [[vertex]] tables in place of [[mode]] with E in [common]."
        )
