"""Where the constants stand that a point observer which follows a mode estimator has beside the estimator's.

The functions of the observer itself are read as those of one that is told its mode (``point_places``), but for init,
which it has not: it starts from what the estimator says. What joins both stands in the other functions.
"""

from __future__ import annotations

import numpy as np

from .c_reader import Source
from .point_places import READ_BY_MAPS, TOGETHER, known_of, read_cut, read_starts, read_tables, require_all


def read_told(source: Source, design, d, t, read_apart: set[str], found) -> set[str]:
    """Read the functions of the observer but those of ``read_apart``; return the names of all of them.

    Parameters
    ----------
    source : Source
        Its tree is that of the C as it must be.
    design : Design
    d : DesignView
    t : FollowerTables
    read_apart : set of str
        Its maps, and checks.
    found : object
        Takes what is read, each name with "told_" before it.

    Raises
    ------
    CertificateError
        A number differs from the tables, or is missing.
    """
    prefix, told, part = f"{d.prefix}_told", t.told, found.part("told_")
    functions = {name for name in source.functions if name.startswith(f"{prefix}_")}
    known = known_of(t.alone, told)
    known = {k: v for k, v in known.items() if k not in ("x0_hat", "x0_set")}
    start = "whole_range"
    read_starts(source, prefix, known, part, ((start, "x_hat"),))
    read_cut(source, prefix, told, part)
    seen = {"box", "x_hat"}
    others = set(source.functions) - functions
    read_tables(source, d.real, known, [m.name for m in design.plant.modes],
                read_apart | others | {f"{prefix}_cut"}, {f"{prefix}_{start}"}, seen, part)
    require_all(source, known, seen | READ_BY_MAPS | TOGETHER | getattr(told.shape, "unprinted", set()))
    return functions


def joint_of(t) -> dict[str, np.ndarray]:
    """Constants that the functions of the estimator have because of the observer, by name.

    Parameters
    ----------
    t : FollowerTables

    Returns
    -------
    dict
    """
    turned = {"turn": t.told.shape.Z} if not t.by_squares and getattr(t.told.shape, "turned", False) else {}
    return {"forth": t.S_rounded, "told_box": t.told.box, "x_lo": t.x_lo, "x_hi": t.x_hi,
            "widest": t.widest, **turned}
