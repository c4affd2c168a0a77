"""Tables of framers, or of a point observer, that an estimator by sliding modes guides: both in one."""

from __future__ import annotations

from dataclasses import fields

import numpy as np


def guided(tables_class, own, told, **more):
    """Put both in one table; it accepts the inputs and measurements that both accept.

    Parameters
    ----------
    tables_class : type
        ``GuidedTables`` or ``GuidedPointTables``.
    own : SlidingTables
    told : FramerTables or PointTables
        Of the same number type.
    **more
        What else the class has.

    Returns
    -------
    GuidedTables or GuidedPointTables
    """
    both = {f.name: getattr(own, f.name) for f in fields(own)}
    for name, inner in (("u_lo", np.maximum), ("u_hi", np.minimum), ("y_lo", np.maximum), ("y_hi", np.minimum)):
        both[name] = inner(both[name], getattr(told, name))
    return tables_class(**both, told=told, **more)
