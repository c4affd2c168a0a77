"""Tables of a point observer that follows a mode estimator: both, and what the start of a set from a box needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .driven_tables import joined


def following(tables_class, mode, told, family: str):
    """Put both in one table; it accepts the inputs and measurements that both accept.

    Parameters
    ----------
    tables_class : type
        ``FollowerTables``.
    mode : ModeTables
    told : PointTables
        Of the same number type.
    family : str
        Run-time family of the observer.

    Returns
    -------
    FollowerTables
    """
    kind, real, n = np.finfo(mode.dtype), mode.dtype.type, len(mode.S)
    return replace(joined(tables_class, mode, told), set=family, grow=np.array(1 + 4 * kind.eps, real),
                   square=np.array(n * (1 + 8 * kind.eps), real), floor=np.array(8 * (n + 2) * kind.tiny, real))
