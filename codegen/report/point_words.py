"""The constants of a point observer in words: estimate, error set, residual set."""

from __future__ import annotations

import numpy as np

from .parameter_words import of_a_step
from .table import Folded, Table


def gains(design, real: str, matrix, t=None) -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, exactly, one fold per mode.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}
    matrix : callable
        (title, row names, column names, values) -> Table.
    t : PointTables, optional
        Default: the design's own.

    Returns
    -------
    tuple of Folded
    """
    t, plant = t or design.observer.tables[real], design.plant
    x, u, y = ([s.name for s in getattr(plant, vector)] for vector in "xuy")
    folds, step = [], of_a_step(plant)
    for q, mode in enumerate(plant.modes):
        tables: list[Table] = []
        for name, meaning, rows, columns in (
                ("M", f"T A − L C{step}", x, x), ("G", f"T B − L D{step}", x, u), ("L", "gain on y", x, y),
                ("N", "gain on the next y", x, y), ("C", "of the residual", y, x)):
            value = getattr(t, name)[q]
            if np.any(value):
                tables.append(matrix(f"{name}: {meaning}", rows, columns, value))
        for name, meaning, rows in (("F", "generators that a step adds", x),
                                    ("V", "generators of the residual's noise", y)):
            value = getattr(t.shape, name, None)
            if value is not None and value.shape[3]:
                last = value[q, -1]  # of an estimate without noise of its own sample
                tables.append(matrix(f"{name}: {meaning}", rows, [f"{i}" for i in range(last.shape[1])], last))
        folds.append(Folded(f"Mode {q}, “{mode.name}”", tuple(tables)))
    return tuple(folds)
