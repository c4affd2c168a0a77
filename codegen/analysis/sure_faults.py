"""Surely detected faults of a point observer: the fault's response against the sets of firmware and plant together.

Without a fault the residual is in an exact set R, the plant's; the firmware raises no alarm inside a set S that holds
R. Both are symmetric about zero. A step of size f with the response f r is outside S whatever disturbance and noise do
where for some direction d that the firmware tests

    f |d' r| > h_S(d) + h_R(d).

Both supports are bounded along every mode sequence that the dwell time admits, some samples before the onset and up to
the delay looked at (``past_sets``); what came before counts by the box in which errors and sets are by then. The worst
sequence counts. The promise holds from so many samples after a start on, with no missing measurement since, and while
the estimate stays inside the box behind its margins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.dwell import fewest_samples
from ..algebra.error_set import ErrorRecursion
from . import set_detectability
from .past_boxes import Traced, Widths
from .past_sets import Exact, Follower, entered, sequences
from .past_shapes import Reduced, Rows, Shapes

Array = np.ndarray
#: Upper limit on the mode sequences looked at: before the onset there are as many samples as it leaves.
MOST_SEQUENCES = 3000
#: Samples before the onset at least, which long delays give way to, and at most.
LEAST_BEFORE, LONGEST_BEFORE = 2, 60
#: What bounds the firmware's own set, by its kind.
FOLLOWERS = {"zonotope": Reduced, "ellipsoid": Shapes, "thresholds": Rows, "box": Widths, "ellipsoid_trace": Traced}
#: Directions looked at for two and three residuals where the test is exact.
FAN, BALL = 24, 80


@dataclass(frozen=True)
class BySequence:
    """What has to be exceeded along each mode sequence.

    Parameters
    ----------
    paths : ndarray (P, K) int
    onset : int
        Sample of a path at which the fault begins; the delays are those up to its end.
    sizes : ndarray (n_f, P, K - onset)
        Smallest step that is surely detected by each delay.
    """

    paths: Array
    onset: int
    sizes: Array


def thresholds(plant, t, cert: dict, within: int) -> Array:
    """Smallest sizes per fault channel and delay.

    Parameters
    ----------
    plant : Plant
    t : PointTables
    cert : dict
        With "rest", the rounding of estimate and residual.
    within : int

    Returns
    -------
    ndarray (n_f, within + 1)
        Infinite where no size is sure.
    """
    out = np.full((plant.n_f, within + 1), np.inf)
    if plant.n_f:
        worst = by_sequence(plant, t, cert, within).sizes.max(axis=1)[:, :within + 1]
        out[:, :worst.shape[1]] = worst
        out[:, worst.shape[1]:] = worst[:, -1:]
    return out


def by_sequence(plant, t, cert: dict, within: int) -> BySequence:
    """The same before the worst sequence is taken.

    Parameters
    ----------
    plant : Plant
        With a fault channel at least.
    t, cert, within :
        As ``thresholds``.

    Returns
    -------
    found : BySequence
    """
    firmware, limit = FOLLOWERS[cert["set"]](t), largest(t, cert)
    dwell = max(fewest_samples(plant.switching, plant.sample_period, cert), getattr(t.shape, "dwell", 1))
    free = Exact(free_recursion(plant, t, cert["rest"]))
    paths = sequences(plant.n_modes, dwell, MOST_SEQUENCES, LONGEST_BEFORE + within)
    onset = max(paths.shape[1] - 1 - within, min(LEAST_BEFORE, paths.shape[1] - 1))
    D = directions(t)
    room = (supports(firmware, limit, paths, plant.n_modes, dwell, onset, D)
            + supports(free, limit, paths, plant.n_modes, dwell, onset, D))
    faults, found = fault_inputs(plant, t), []
    for j in range(plant.n_f):
        r = np.abs(responses(free.m, faults, paths, onset, j) @ D.T)
        found.append(set_detectability.sizes(2.0 * zonotope.ratio(r, room).max(axis=2).T))
    return BySequence(paths, onset, np.array(found))


def largest(t, cert: dict) -> Array:
    """Half widths that hold every error while nothing starts anew: the limit, or the widths of settled rows."""
    return t.limit.astype(float) if np.any(t.limit) else np.array(cert["steady_box"]["width"]) / 2.0


def directions(t) -> Array:
    """Directions in which ``|d' r| <= h`` is what the firmware tests, or follows from it."""
    n_y, table = t.C.shape[1], hasattr(t.shape, "h")
    if n_y == 2 and not table:
        return zonotope.fan(FAN)
    own = getattr(t.shape, "directions", np.zeros((0, n_y))).astype(float)
    if getattr(t.shape, "pairs", False):
        own = ball(BALL)
    return own if table else np.concatenate([np.eye(n_y), own])


def ball(count: int) -> Array:
    """Directions spread evenly over half of the sphere, (count, 3)."""
    k = np.arange(count) + 0.5
    height, angle = k / count, np.pi * (1.0 + 5.0 ** 0.5) * k
    flat = np.sqrt(1.0 - height * height)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)


def supports(which: Follower, limit: Array, paths: Array, modes: int, dwell: int, onset: int, D: Array) -> Array:
    """Bounds along mode sequences from the onset on, (delays, P, d)."""
    entries, _ = entered(which, limit, modes, dwell)
    state, out = which.begin(entries[paths[:, 0]]), []
    for k in range(1, paths.shape[1]):
        if k >= onset:
            out.append(which.support(state, paths[:, k], paths[:, k - 1], D))
        state = which.step(state, paths[:, k], paths[:, k - 1])
    return np.array(out)


def free_recursion(plant, t, rest: dict) -> ErrorRecursion:
    """Return the recursion of the errors of an estimate on the numbers of the C, rounding included.

    Parameters
    ----------
    plant : Plant
    t : PointTables
    rest : dict
        "error" (N, n_x) and "residual" (N, n_y): boxes of what rounding adds to a step and to the residual.

    Returns
    -------
    m : ErrorRecursion
    """
    modes, none = plant.observed.modes, np.zeros((1, plant.n_x, plant.n_y))
    M, C, L, N = (getattr(t, k).astype(float) for k in "MCLN")
    v_lo, v_hi = (np.array([getattr(m, k) for m in modes], dtype=float) for k in ("v_lo", "v_hi"))
    middle = (v_lo + v_hi) / 2.0 if t.kind != "tnl" else (v_lo.min(axis=0) + v_hi.max(axis=0)) / 2.0
    v = np.maximum(v_hi - middle, middle - v_lo)
    noise = np.array([m.Dv for m in modes]) * v[:, None, :]
    gust = np.array([(np.eye(plant.n_x) - n @ m.C) @ m.Bw * ((m.w_hi - m.w_lo) / 2.0) for n, m in zip(N, modes)])
    after = np.concatenate([N if t.kind == "tnl" else np.repeat(none, len(N), axis=0), none])  # of the mode before
    own, direct = (np.array([np.diag(x) for x in np.array(rest[k])]) for k in ("error", "residual"))
    W = np.concatenate([np.broadcast_to(gust, (len(after), *gust.shape)), -(M @ after[:, None] + L) @ noise,
                        np.broadcast_to(own, (len(after), *own.shape))], axis=3)
    V = np.concatenate([noise - C @ (after[:, None] @ noise), np.broadcast_to(direct, (len(after), *direct.shape))],
                       axis=3)
    return ErrorRecursion(M, C, W, V, (W.shape[3],))


def fault_inputs(plant, t) -> set_detectability.FaultInputs:
    """Return how faults enter errors and residuals of an estimate.

    Parameters
    ----------
    plant : Plant
    t : PointTables

    Returns
    -------
    inputs : FaultInputs
    """
    A, Bf, Df = (np.stack([getattr(m, k) for m in plant.observed.modes]) for k in ("A", "Bf", "Df"))
    C, L, N = (getattr(t, k).astype(float) for k in "CLN")
    return set_detectability.fault_inputs(A, C, L, Bf, Df, N if t.kind == "tnl" else None)


def responses(m: ErrorRecursion, faults: set_detectability.FaultInputs, paths: Array, onset: int,
              channel: int) -> Array:
    """Return the residuals that a unit step causes along mode sequences, from its onset on.

    Parameters
    ----------
    m : ErrorRecursion
    faults : FaultInputs
    paths : ndarray (P, K) int
    onset, channel : int

    Returns
    -------
    r : ndarray (K - onset, P, n_y)
    """
    e, out = np.zeros((len(paths), m.A.shape[1])), []
    for before, q in zip(paths.T[onset - 1:-1], paths.T[onset:]):
        out.append((m.C[q] @ e[:, :, None])[:, :, 0] + faults.R[before, q, :, channel])
        e = (m.A[q] @ e[:, :, None])[:, :, 0] + faults.X[before, q, :, channel]
    return np.array(out)
