"""From constants of an observer of states and faults to its tables: limits of its state, thresholds of a kept set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from flint import fmpq

from ..certify import fault_bounds, fault_sets
from ..certify.exact import Q, rational, up
from ..certify.polytope_thresholds import graph_of
from ..errors import DesignError
from ..observers import PolytopicTables
from ..plant.model import Plant
from ..synthesis.fault_set import kept_ellipsoid
from .filter_tables import LENGTH, Chooser, above, floats
from .polytopic_tables import limited

Array = np.ndarray
#: Limits of z beyond where it can be without a fault, in what runs of the error reach; samples of a table at most;
#: the last level over the smallest one: the smaller, the longer the table.
BEYOND, MOST, ABOVE = 8.0, 8000, 1.05
#: Share by which disturbances are looked at as larger than they are.
MORE = 1e-2


def frozen(plant: Plant, problem, t: PolytopicTables, T1: Array, period: float | None,
           bend: Array) -> tuple[PolytopicTables, dict]:
    """Tables with thresholds and their proof, checked.

    Parameters
    ----------
    plant : Plant
        Its x holds states and faults.
    problem : DescriptorProblem
    t : PolytopicTables
        Of ``polytopic_tables.tables_of``, with the known terms.
    T1 : ndarray (n, n)
    period : float or None
        Of a continuous plant.
    bend : ndarray (n_x,)
        See ``certify.fault_bounds``.

    Returns
    -------
    tables : PolytopicTables
    cert : dict
        For ``certify.fault_sets.check``.

    Raises
    ------
    DesignError
        No ellipsoid is kept, or the thresholds take too long.
    CertificateError
        The exact check refuses them.
    """
    n, first = len(T1), T1 @ problem.E
    t = limited(plant, t, first, np.zeros(n))
    model, _ = fault_bounds.model(plant, problem, t, T1, period, bend)
    chooser = Chooser(model, graph_of(model), 0)
    low = chooser.reached(np.concatenate(chooser.O))
    t = limited(plant, t, first, BEYOND * chooser.sizes[:n])
    model, T1E = fault_bounds.model(plant, problem, t, T1, period, bend)
    rows, kept = floats(model[0].O), [fault_sets.columns_that_matter(m.W) for m in model]
    moved = [widened(floats(fault_sets.condensed(m.W, some))) for m, some in zip(model, kept)]
    found = kept_ellipsoid([floats(m.J) for m in model], moved, rows[np.any(rows != 0, axis=1)],
                           floats(fault_sets.starts(plant, t, T1E)[1]))
    if found is None:
        raise DesignError(f"{plant.name}: no set of the error is kept for all weights (found none), so there is no "
                          "bound. Ask for a faster decay or larger gains.")
    P, D, share = found
    cert = {"P": P.tolist(), "kept": kept, "D": [d.tolist() for d in D], "share": share,
            "reached": low.reshape(-1, len(t.C)).max(axis=0).tolist()}
    t, level = _laid_out(plant, t, model[0], cert, fault_sets.starts(plant, t, T1E))
    cert["level"] = level
    fault_sets.check(plant, problem, t, cert, T1, period, bend)
    return t, cert


def widened(W: Array) -> Array:
    """The same with its last columns, one for each row, a little larger: rows that nothing moves stop a solver.

    Parameters
    ----------
    W : ndarray (n, q)
    """
    total = np.abs(W).sum(axis=1)
    out = W.copy()
    out[:, -len(W):] += np.diag(MORE * total + MORE**2 * total.max())
    return out


def _laid_out(plant: Plant, t: PolytopicTables, found, cert: dict, starts) -> tuple[PolytopicTables, float]:
    """The table of thresholds of an ellipsoid, and its last level."""
    P, share = rational(cert["P"]), Q(cert["share"])
    tau = max(sum(rational(d), fmpq(0)) for d in cert["D"])
    initial, anywhere = (fault_sets.first_level(P, G) for G in starts)
    last = Q(up(tau / (1 - share) * Q(ABOVE)))
    levels = fault_sets.levels(anywhere, share, tau, MOST)
    if levels[-1] > last:
        raise DesignError(f"{plant.name}: the thresholds take more than {MOST} samples to come down from the declared "
                          "range of x (found), expected fewer. Ask for a faster decay, or narrow that range.")
    count = next(k for k, level in enumerate(levels) if level <= last)
    shift = 0
    while count > LENGTH << shift:
        shift += 1
    sizes = fault_sets.unit_bounds(found, P)
    heads = [levels[k << shift] for k in range(-(-count >> shift))]
    start = max((k for k, level in enumerate([*heads, last]) if level >= initial), default=0)
    h = np.array([[np.sqrt(float(level * size)) * (1 + 1e-12) + float(room) * (1 + 1e-12)
                   for size, room in zip(sizes, found.room)] for level in [*heads, last]])
    h = above(h, t.real)
    return replace(t, h=h, start=start, shift=shift), float(last)
