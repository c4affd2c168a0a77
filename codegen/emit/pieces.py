"""What straight-line code and loops print alike: rows of tables, names of bounds, parameters not used."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .cprint import initialiser
from .maps import MapSpec

Array = np.ndarray


def bounds(spec: MapSpec, side: str) -> tuple[str, str]:
    """Return the operand's bound on the same side and that on the opposite one."""
    stem = spec.state.operand
    return {"lo": (f"{stem}_lo", f"{stem}_hi"), "hi": (f"{stem}_hi", f"{stem}_lo"), "": (stem, stem)}[side]


def unused(spec: MapSpec, text: Iterable[str]) -> tuple[str, ...]:
    """Return the parameters that the printed code does not touch."""
    code = " ".join([*text, *spec.tail])
    return tuple(p for p in arguments(spec) if f"{p}->" not in code and f"{p}[" not in code and f"[{p}]" not in code)


def arguments(spec: MapSpec) -> tuple[str, ...]:
    """Return the names of the parameters: pointers, or the number of a mode."""
    return tuple(parameter.replace("*", " ").split()[-1] for parameter in spec.parameters)


def mode_rows(mode: str, value: Array, real: str) -> list[str]:
    """Print one mode's part of a table, long vectors over several lines."""
    if value.ndim == 1 and len(value) <= 6:
        return [f"{initialiser(value, real)}, /* {mode} */"]
    parts = value if value.ndim == 2 else [value[i:i + 6] for i in range(0, len(value), 6)]
    lines = [initialiser(part, real) for part in parts]
    lines = lines if value.ndim == 2 else [line.strip("{} ") for line in lines]
    return [f"{{ /* {mode} */", *(f"    {line}," for line in lines[:-1]), f"    {lines[-1]}", "},"]
