"""Surely detected faults of a point observer whose set is carried online, for any mode sequence.

Once settled the hull of the error set is in the box of the certificate and stays there, so no residual bound exceeds
``B = |C| box + |V| + rho``, one step later ``|C M| box + |C F| + |V| + rho``, and no fault-free residual does. A step
of size f is found within D samples where the response of some residual at some sample up to then exceeds 2 B / f,
whatever disturbance, noise and modes do. The firmware's set lies inside these bounds, mostly well inside: smaller
faults are found as well, without a promise.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..algebra.error_set import ErrorRecursion
from . import set_detectability, sure_faults
from .set_tables import DwellTable

Array = np.ndarray
#: Upper limit on the mode sequences looked at; delays beyond are left out.
MOST_SEQUENCES = 6000


def thresholds(plant, t, cert: dict, within: int) -> Array:
    """Smallest sizes per fault channel and delay.

    Parameters
    ----------
    plant : Plant
    t : PointTables
    cert : dict
        With its "steady_box", or None there: nothing is sure then.
    within : int

    Returns
    -------
    ndarray (n_f, within + 1)
        Infinite where no size is sure.
    """
    if cert["set"] in sure_faults.FOLLOWERS:
        return sure_faults.thresholds(plant, t, cert, within)
    if cert["set"] == "schedule":
        return along_schedule(plant, t, within)
    out = np.full((plant.n_f, within + 1), np.inf)
    if not cert.get("steady_box"):
        return out
    D = t.shape.directions.astype(float) if cert["set"] == "blocks" else np.eye(plant.n_y)
    bounds = block_bounds(t, cert, len(D)) if cert["set"] == "blocks" else settled_bounds(t, cert)
    first, later = (2.0 * b for b in bounds)
    modes = plant.observed.modes
    while plant.n_modes ** (within + 2) > MOST_SEQUENCES and within > 0:
        within -= 1
    for j in range(plant.n_f):
        worst = np.zeros(within + 1)
        for path in product(range(plant.n_modes), repeat=within + 2):
            found = np.inf
            for d, r in enumerate(responses(modes, t, path, j)):
                with np.errstate(divide="ignore"):
                    bound = np.minimum(first[path[d + 1]], later[path[d], path[d + 1]]) if d else first[path[1]]
                    found = min(found, np.min(bound / np.abs(D @ r)))
                worst[d] = max(worst[d], found)
        out[j, :within + 1] = worst
        out[j, within:] = worst[within]
    # The recursion runs in double precision; a part in a million covers its own rounding generously.
    return out * (1.0 + 1e-6)


def tabulated(plant, t, cert: dict, within: int) -> Array:
    """The same for a table of thresholds: the worst over modes, samples since a switch and what may follow.

    "Settled" is told by the width of the bounds of x: of all rows that are no wider the largest thresholds count.
    """
    z, modes = t.shape, plant.observed.modes
    A, C, L, N = (getattr(t, k).astype(float) for k in "MCLN")
    stack = {k: np.stack([getattr(m, k) for m in modes]) for k in ("A", "Bf", "Df")}
    faults = set_detectability.fault_inputs(stack["A"], C, L, stack["Bf"], stack["Df"], N if t.kind == "tnl" else None)
    none = np.zeros((plant.n_modes + 1, plant.n_modes, plant.n_x, 0))
    m = ErrorRecursion(A, C, none, np.zeros((plant.n_modes + 1, plant.n_modes, plant.n_y, 0)), ())
    width = np.array(cert["steady_box"]["width"])
    settled = np.all(2 * z.hx.astype(float) <= width, axis=3)
    h = np.where(settled[..., None], z.h.astype(float), 0.0).max(axis=0)
    table = DwellTable(z.directions.astype(float), h[None], np.zeros((1, plant.n_modes, plant.n_x)), A, z.dwell, 0)
    out = np.full((plant.n_f, within + 1), np.inf)
    for j in range(plant.n_f):
        found = set_detectability.surely_detected(m, faults, table, j, within).by_delay.max(axis=(0, 1))
        out[j, :len(found)] = np.minimum.accumulate(found)
        out[j, len(found):] = out[j, len(found) - 1]
    return out


def along_schedule(plant, t, within: int) -> Array:
    """The same for a list along a schedule, once its rows repeat: the worst over the phase of the onset."""
    z, modes = t.shape, plant.observed.modes
    P, D = len(z.cycle), z.directions.astype(float)
    h, out = z.h[-P:].astype(float), np.full((plant.n_f, within + 1), np.inf)
    for j in range(plant.n_f):
        worst = np.zeros(within + 1)
        for onset in range(P):
            path, found = [z.cycle[(onset + d - 1) % P] for d in range(within + 2)], np.inf
            for d, r in enumerate(responses(modes, t, path, j)):
                with np.errstate(divide="ignore"):
                    found = min(found, np.min(2.0 * h[(onset + d) % P] / np.abs(D @ r)))
                worst[d] = max(worst[d], found)
        out[j] = worst
    return out * (1.0 + 1e-6)


def settled_bounds(t, cert: dict) -> tuple[Array, Array]:
    """Largest r_bound of each mode once settled, (N, n_y), and one step of mode p later in mode q, (N, N, n_y).

    The width that "settled" is measured by holds the noise in the estimate too, which depends on the mode: the box is
    scaled so that it covers any share of it. (A scaled box is kept as the box itself is.)
    """
    z, C, M = t.shape, t.C.astype(float), t.M.astype(float)
    half, e = np.array(cert["steady_box"]["half"]), z.e.astype(float)
    most = np.array(cert["steady_box"]["width"]) / 2 - z.spread.astype(float).min(axis=0)
    half = half * np.max(most / half)
    rest = np.abs(z.V.astype(float)).sum(axis=3).max(axis=1) + z.rho.astype(float)
    room = (1.0 + float(z.slack)) ** 2
    first = np.abs(C) @ half + rest
    added = np.abs(np.einsum("qyx,poxc->pqoyc", C, z.F.astype(float))).sum(axis=4).max(axis=2)
    carried = np.abs(np.einsum("qyx,pxz->pqyz", C, M)) @ (half + e)
    return first * room, (carried + added + rest + np.abs(C) @ e) * room


def block_bounds(t, cert: dict, count: int) -> tuple[Array, Array]:
    """The same of a set carried from block to block, in its directions: (N, m) and (N, N, m)."""
    z, half = t.shape, np.array(cert["steady_box"]["half"])
    reach = np.abs(z.rows.astype(float)) @ half + z.scalars.astype(float).max(axis=0)
    own = z.noise.astype(float).max(axis=0)[:, :count] + reach[:, 1:].max(axis=(0, 1))[:count]  # 0: only at a start
    own = own * (1.0 + 4 * (z.order + len(half) + 8) * float(np.finfo(t.dtype).eps))
    return own, np.broadcast_to(own, (len(t.A), len(t.A), count))


def responses(modes, t, path, channel: int):
    """Yield the residual per unit of a step of one channel, from its onset on.

    Parameters
    ----------
    modes : sequence
    t : PointTables
    path : sequence of int
        Mode before the onset, then those of the samples.
    channel : int

    Yields
    ------
    r : ndarray (n_y,)
    """
    N, L, M = (getattr(t, k).astype(float) for k in ("N", "L", "M"))
    e = -N[path[0]] @ modes[path[1]].Df[:, channel]
    for k, q in enumerate(path[1:], 1):
        m = modes[q]
        yield t.C[q].astype(float) @ e + m.Df[:, channel]
        later = modes[path[k + 1]] if k + 1 < len(path) else m
        T = np.eye(len(e)) - N[q] @ m.C
        e = M[q] @ e + T @ m.Bf[:, channel] - L[q] @ m.Df[:, channel] - N[q] @ later.Df[:, channel]
