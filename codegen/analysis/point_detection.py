"""Surely detected faults of a point observer, for any mode sequence: of each set by its own way.

Sets that ``sure_faults`` can follow are left to it. Of a set carried from block to block: once settled the hull of the
error set is in the box of the certificate and stays there, so no bound in a direction exceeds B, what the tables make
of that box, and no fault-free residual does. A step of size f is found within D samples where the response of some
residual at some sample up to then exceeds 2 B / f, whatever disturbance, noise and modes do. The firmware's set lies
inside these bounds, mostly well inside: smaller faults are found as well, without a promise.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from . import sure_faults

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
    if cert["set"] == "starts" or not cert.get("steady_box"):  # in a mode that nobody tells nothing is promised
        return out
    D = t.shape.directions.astype(float)
    first, later = (2.0 * b for b in block_bounds(t, cert, len(D)))
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


def block_bounds(t, cert: dict, count: int) -> tuple[Array, Array]:
    """Largest bounds of each mode once settled, (N, m), and one step of mode p later in mode q, (N, N, m)."""
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
