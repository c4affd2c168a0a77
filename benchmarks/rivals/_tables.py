"""Constant arrays of a case, as a person would write them: a matrix that no mode changes is stored once."""

from __future__ import annotations

import numpy as np

from ..cases import Case


def split(case: Case) -> Case:
    """Return an interval case with C as its positive and negative part; a point case as it is."""
    if case.observer == "point":
        return case
    t = dict(case.tables)
    C = t.pop("C")
    parts = {"C_pos": np.maximum(C, 0) + 0.0, "C_neg": np.maximum(-C, 0) + 0.0}
    return Case(**{**vars(case), "tables": {**t, **parts, "C": C}})


def arrays(case: Case, leave: tuple[str, ...] = (), flat: bool = False, columns: bool = False) -> str:
    """Print all tables as ``static const`` arrays.

    Parameters
    ----------
    case : Case
    leave : tuple of str
        Tables to leave out.
    flat : bool
        One row of numbers per matrix.
    columns : bool
        Column by column, the storage order of Eigen.

    Returns
    -------
    text : str
    """
    suffix, lines = ("f" if case.real == "float32" else ""), []
    for name, table in case.tables.items():
        if name in leave:
            continue
        value = np.swapaxes(table, 1, 2) if columns and table.ndim == 3 else table
        value = value.reshape(len(value), -1) if flat else value
        value = value[0] if case.once(name) else value
        sizes = "".join(f"[{n}]" for n in value.shape)
        lines.append(f"static const bench_real {name}{sizes} = {_braces(value, case.real, suffix)};")
    return "\n".join(lines)


def at(case: Case, name: str) -> str:
    """Return how a table is written for the mode of this sample."""
    return name if case.once(name) else f"{name}[in->mode]"


def _braces(value, real: str, suffix: str) -> str:
    if value.ndim:
        return "{ " + ", ".join(_braces(v, real, suffix) for v in value) + " }"
    return f"{np.dtype(real).type(value)!s}{suffix}"
