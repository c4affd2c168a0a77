"""A certified polytopic observer in discrete time as firmware: its tables, and its C.

The recursion only: no alarms, no bounds of the state, so that it is no method of ``METHODS`` and no output folder of
``residua generate``. What the caller gets is an estimate, a residual, the weights, and whether they are in force.
"""

from __future__ import annotations

import numpy as np

from . import __version__
from .descriptors import CertifiedObserver
from .emit.polytopic_parts import view
from .emit.render import render
from .errors import EmitError
from .observers.polytopic import PolytopicTables
from .plant.model import Plant
from .plant.weight_program import weight_program

Array = np.ndarray


def tables_of(plant: Plant, observer: CertifiedObserver, real: str) -> PolytopicTables:
    """The numbers that the C of an observer holds.

    Parameters
    ----------
    plant : Plant
        With a polytope, the one of the design.
    observer : CertifiedObserver
        In discrete time, rounded to this type.
    real : {"float32", "float64"}

    Returns
    -------
    tables : PolytopicTables

    Raises
    ------
    EmitError
        The observer is one in continuous time or of the other type, or the weights have a function without operation.
    """
    g, proof = observer.gains, observer.proof
    if proof["time"] != "discrete":
        raise EmitError(f"{plant.name}: the observer is one in continuous time (found), expected a recursion. Design "
                        "it with sampled_observer or descriptor-discrete.")
    if any(not np.array_equal(M, M.astype(real)) for M in vars(g).values()):
        raise EmitError(f"{plant.name}: the observer's constants are no {real} (found). Design it for {real}.")
    try:
        weights = weight_program(plant.polytope, real)
    except TypeError as error:
        raise EmitError(f"{plant.name}: a weight cannot be printed: {error}. Write it with other functions.") from None
    # z starts at T1 E x0 = (I - T2 C) x0: then x_hat is x0 with its algebraic part from the first measurement.
    x0 = (plant.x0_lo + plant.x0_hi) / 2
    z0, y0 = x0 - g.T2 @ (g.C @ x0), g.C @ x0
    ranges = {}
    for vector in ("u", "y", "theta"):
        lo, hi = plant.limits(vector)
        most = float(np.finfo(real).max)
        ranges |= {f"{vector}_lo": _near(np.clip(lo, -most, most), real),
                   f"{vector}_hi": _near(np.clip(hi, -most, most), real)}
    return PolytopicTables(real, g.T2, g.C, g.F, g.G, g.K, _near(z0, real), _near(y0, real), weights=weights, **ranges)


def _near(values: Array, real: str) -> Array:
    return np.asarray(values, dtype=float).astype(real).astype(float) + 0.0


def print_c(plant: Plant, observer: CertifiedObserver, real: str, prefix: str | None = None) -> dict[str, str]:
    """Header and C of an observer.

    Parameters
    ----------
    plant : Plant
    observer : CertifiedObserver
    real : {"float32", "float64"}
    prefix : str, optional
        Default: the plant file's.

    Returns
    -------
    files : dict
        Name -> text.

    Raises
    ------
    EmitError
        See `tables_of`.
    """
    prefix = prefix or plant.target.prefix
    d = view(plant, tables_of(plant, observer, real), observer.claims, prefix, __version__)
    return {f"{prefix}.h": render("polytopic.h.jinja", d=d), f"{prefix}.c": render("polytopic.c.jinja", d=d)}
