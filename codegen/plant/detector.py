"""The copy of a plant that sees its component faults: an observer made for them bears them, one made without does not.

An unmeasured parameter with zero within its bounds may stand for a fault: zero is the plant as it ought to be. With
its bounds at zero the observer knows no such change, and its bounds lose the state once there is one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import Any

import tomli_w

from ..errors import PlantError
from .build import build
from .model import Plant


def fault_parameters(plant: Plant) -> tuple[str, ...]:
    """Name the parameters that may stand for faults: not measured, zero within their bounds in every mode.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    names : tuple of str
        Without those that are zero anyway.
    """
    found = []
    for j, signal in enumerate(plant.theta):
        boxes = [plant.theta_box(mode) for mode in plant.modes]
        if not signal.measured and all(lo[j] <= 0 <= hi[j] for lo, hi in boxes) and any(
                lo[j] < hi[j] for lo, hi in boxes):
            found.append(signal.name)
    return tuple(found)


def detector(plant: Plant, faults: Sequence[str] | None = None) -> Plant:
    """Copy a plant with the bounds of its fault parameters at zero; an observer made for the copy sees these faults.

    In firmware both run side by side, that of the plant for its bounds, that of the copy for its alarm.

    Parameters
    ----------
    plant : Plant
    faults : sequence of str, optional
        Parameters that stand for faults; default: all that may, see `fault_parameters`.

    Returns
    -------
    plant : Plant
        Named ``<name>_detector``. Scenarios that give the parameters a course of their own have them at zero; recorded
        ones are left out.

    Raises
    ------
    PlantError
        No parameter may stand for a fault, or one that is named may not.
    """
    possible = fault_parameters(plant)
    faults = possible if faults is None else tuple(faults)
    for name in faults:
        if name not in possible:
            raise PlantError(f"{plant.name}: the parameter {name!r} cannot stand for a fault (expected one of "
                             f"{', '.join(possible) or 'none'}: not measured, zero within its bounds).")
    if not faults:
        raise PlantError(f"{plant.name}: no parameter can stand for a fault (expected one that is not measured, with "
                         "zero within its bounds). Name the fault in signals.theta.")
    document = tomllib.loads(plant.text)
    document["name"] = f"{plant.name}_detector"
    document["title"] = f"{plant.title or plant.name}, detector of {', '.join(faults)}"
    document.get("target", {}).pop("prefix", None)
    for signal in document["signals"]["theta"]:
        if signal["name"] in faults:
            signal["bounds"] = [0.0, 0.0]
    for mode in document.get("mode", []):
        for name in faults:
            mode.get("bounds", {}).pop(name, None)
    _quiet(document, [s.name for s in plant.theta], faults)
    return build(tomli_w.dumps(document))


def _quiet(document: dict[str, Any], thetas: list[str], faults: tuple[str, ...]) -> None:
    """Put the fault parameters to zero in every scenario that gives the parameters one by one."""
    kept = [scenario for scenario in document.get("scenario", []) if not scenario.get("csv")]
    for scenario in kept:
        course = scenario.get("theta")
        if isinstance(course, list):
            scenario["theta"] = ["0" if name in faults else text for name, text in zip(thetas, course, strict=True)]
    if kept:
        document["scenario"] = kept
    else:
        document.pop("scenario", None)
