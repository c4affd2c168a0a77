"""Plants from objects of python-control or scipy.signal, by way of the plant file's text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import tomli_w

from codegen.errors import PlantError
from codegen.plant.build import build
from codegen.plant.model import Plant

Limits = Sequence[Sequence[float]] | Mapping[str, Sequence[float]]


def plant_from(
    system: Any,
    *,
    x0: Sequence[Sequence[float]],
    w: Limits = (),
    v: Limits = (),
    x: Limits | None = None,
    u: Limits | None = None,
    y: Limits | None = None,
    f: Limits | None = None,
    Bw: Any = None,
    Dv: Any = None,
    Dw: Any = None,
    Bf: Any = None,
    Df: Any = None,
    name: str = "plant",
    modes: Sequence[str] | None = None,
    sample_period: float | None = None,
    **tables: Any,
) -> Plant:
    """Return the plant of state-space objects; its ``text`` is a plant file to save and continue with.

    Parameters
    ----------
    system : object or list of objects
        With ``A``, ``B``, ``C``, ``D`` and ``dt`` (python-control ``StateSpace``, scipy ``StateSpace`` or
        ``dlti``); each of a list is one mode. ``dt`` None or 0 is continuous.
    x0 : (lo, hi)
        Box of the initial state, two sequences of n_x numbers.
    w, v : sequence of (lo, hi), or mapping of name to (lo, hi)
        Bounds of the disturbances and the noise.
    x, u, y : sequence or mapping, optional
        Ranges, as for w; without them a channel has no range.
    f : sequence or mapping, optional
        Ranges of the faults; without it there is none.
    Bw, Dv, Dw, Bf, Df : array_like, optional
        Shapes (n_x, n_w), (n_y, n_v), (n_y, n_w), (n_x, n_f), (n_y, n_f); a list of them is one per mode.
    name : str
        Plant name.
    modes : sequence of str, optional
        Mode names; default "only", or "mode1", "mode2" ...
    sample_period : float, optional
        Seconds; required where ``dt`` gives none.
    **tables
        Further tables of the plant file: ``switching``, ``observer``, ``target`` as dicts, ``scenario`` as a
        list of dicts, ``title`` and ``source`` as text.

    Returns
    -------
    plant : Plant

    Raises
    ------
    PlantError
        An object lacks a matrix, the modes disagree on ``dt``, or whatever `load` finds wrong.

    Examples
    --------
    >>> system = scipy.signal.dlti([[0.9]], [[1.0]], [[1.0]], [[0.0]], dt=0.1)
    >>> plant_from(system, x0=([-1], [1]), w=[(-0.1, 0.1)], v=[(-0.2, 0.2)], Bw=[[1]], Dv=[[1]]).n_x
    1
    """
    try:
        systems = list(system) if isinstance(system, list | tuple) else [system]
        tables["mode"] = _modes(systems, modes, {"Bw": Bw, "Dw": Dw, "Dv": Dv, "Bf": Bf, "Df": Df})
        first = tables["mode"][0]
        sizes = {"x": len(first["A"]), "u": len(first["B"][0]), "y": len(first["C"])}
        signals = {"x": x, "u": u, "y": y, "w": w, "v": v, "f": f}
        document = {
            "format": 1,
            "name": name,
            "time": _time(systems, sample_period),
            "signals": {key: _channels(key, limits, sizes.get(key, 0)) for key, limits in signals.items()},
            "initial": {"x_lo": _plain("x0", x0[0]), "x_hi": _plain("x0", x0[1])},
        }
        return build(tomli_w.dumps(document | tables))
    except PlantError as error:
        raise PlantError(f"plant_from: {error}") from None


def _modes(systems: list, names: Sequence[str] | None, extra: Mapping[str, Any]) -> list[dict[str, Any]]:
    if not systems:
        raise PlantError("system: is an empty list (expected one system or more). Give one.")
    if names is None:
        names = ["only"] if len(systems) == 1 else [f"mode{i + 1}" for i in range(len(systems))]
    if len(names) != len(systems):
        raise PlantError(f"modes: has {len(names)} names, expected {len(systems)} (the systems). Name each.")
    tables = []
    for q, (name, system) in enumerate(zip(names, systems)):
        given = {key: value for key, value in extra.items() if value is not None}
        own = {key: _of_mode(key, value, q, len(systems)) for key, value in given.items()}
        tables.append({"name": name, **_matrices(system), **own})
    return tables


def _matrices(system: Any) -> dict[str, list]:
    missing = [key for key in "ABCD" if not hasattr(system, key)]
    if missing:
        raise PlantError(
            f"system: {type(system).__name__} has no {missing[0]} (expected a state-space object). "
            "Convert it, e.g. with to_ss() or control.ss()."
        )
    return {key: np.atleast_2d(_array(key, getattr(system, key))).tolist() for key in "ABCD"}


def _of_mode(key: str, value: Any, q: int, n_modes: int) -> list:
    array = _array(key, value)
    if array.ndim == 3:
        if len(array) != n_modes:
            raise PlantError(
                f"{key}: has {len(array)} matrices, expected {n_modes} (the systems). Give one per system."
            )
        array = array[q]
    return np.atleast_2d(array).tolist()


def _time(systems: list, sample_period: float | None) -> dict[str, Any]:
    dt = getattr(systems[0], "dt", None)
    for system in systems[1:]:
        if getattr(system, "dt", None) != dt:
            raise PlantError(f"dt: differs between the systems (found {dt} and {system.dt}). Resample one.")
    # True is how both toolboxes write "discrete, period not stated"; it also equals 1.
    unstated = isinstance(dt, bool | np.bool_)
    continuous = dt is None or (not unstated and dt == 0)
    period = sample_period
    if not unstated and not continuous:
        if sample_period is not None and sample_period != dt:
            raise PlantError(
                f"sample_period: is {sample_period:g}, but the system has dt = {dt:g}. Leave it out."
            )
        period = dt
    if period is None:
        raise PlantError(f"sample_period: is missing (the system has dt = {dt}). Add it, in seconds.")
    return {"kind": "continuous" if continuous else "discrete", "sample_period": float(period)}


def _channels(vector: str, limits: Limits | None, count: int) -> list[dict[str, Any]]:
    """Entries of ``[signals]``; without limits there are ``count`` channels without a range."""
    if limits is None:
        return [{"name": f"{vector}{i + 1}"} for i in range(count)]
    key = "bounds" if vector in ("w", "v") else "range"
    if not isinstance(limits, Mapping):
        limits = {f"{vector}{i + 1}": pair for i, pair in enumerate(limits)}
    return [{"name": name, key: _plain(vector, pair)} for name, pair in limits.items()]


def _plain(what: str, values: Any) -> list[float]:
    """Numbers that TOML can hold; infinite and NaN are refused by the schema, with their place."""
    return _array(what, values).ravel().tolist()


def _array(what: str, values: Any) -> np.ndarray:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise PlantError(f"{what}: holds no numbers, or rows of unequal length. Give an array.") from None
