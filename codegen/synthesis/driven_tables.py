"""Tables of framers that are driven by a mode estimator: both, and the way from the bounds of x to those of S x."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from .mode_period import exact, magnitude, top
from .mode_tables import directed

Array = np.ndarray


def joined(tables_class, mode, told):
    """Put both in one table; it accepts the inputs and measurements that both accept.

    Parameters
    ----------
    tables_class : type
        ``DrivenTables``.
    mode : ModeTables
    told : FramerTables
        Of the same number type.

    Returns
    -------
    DrivenTables
    """
    own = {f.name: getattr(mode, f.name) for f in fields(mode)}
    for name, inner in (("u_lo", np.maximum), ("u_hi", np.minimum), ("y_lo", np.maximum), ("y_hi", np.minimum)):
        own[name] = inner(own[name], getattr(told, name))
    S, kind, n = mode.S.astype(mode.dtype), np.finfo(mode.dtype), len(mode.S)
    lost = top(magnitude(exact(S) - exact(mode.S))) + (n + 3) * float(kind.eps) * np.abs(S.astype(float))
    room = lost @ told.box.astype(float) * (1 + 1e-6) + 8 * (n + 2) * float(kind.smallest_subnormal)
    return tables_class(**own, told=told, S_rounded=S, xi_room=directed(room, mode.real, 1))
