"""Surely detected faults of a residual set: how large a step has to be to leave the set whatever the noise does.

The residual is the fault's response plus a fault-free residual, which lies in the exact set and so in any set R that
holds it, symmetric about zero. It is outside R for every disturbance and noise where the response is outside 2 R: a
step of size f is surely detected where ``f gauge_R(response to 1) > 2``. (R exact: and only there.) One figure per
channel, mode and samples since the mode was entered; the worst over the mode sequences that may follow counts.

Source: Zammali (2020), chapter 6, gives no detectability; the figures are ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra import ellipsoid, zonotope
from ..algebra.contraction import contraction, settled
from ..algebra.error_set import ErrorRecursion, stack, tnl
from ..algebra.residual_sets import befores
from .set_tables import DwellTable

Array = np.ndarray

#: Upper limit on the futures looked at per mode and index; delays beyond are left out.
MOST_FUTURES = 3000
#: The figures are computed in double precision; a part in a million covers that generously.
OUTWARD = 1.0 + 1e-6


@dataclass(frozen=True)
class FaultInputs:
    """How faults enter the recursion of ``algebra.error_set``: e+ = Ac e + X f, r = C e + R f, indexed like W and V.

    Parameters
    ----------
    X : ndarray (Q + 1, Q, n, n_f)
    R : ndarray (Q + 1, Q, m, n_f)
    """

    X: Array
    R: Array


def fault_inputs(A, C, L, Bf, Df, N=None) -> FaultInputs:
    """Return how faults on the state and on the outputs enter the error and the residual.

    A fault on an output is read twice by a TNL observer, like noise; the error is that of ``algebra.error_set.tnl``, in
    which the fault of this sample has not acted yet.

    Parameters
    ----------
    A : ndarray (Q, n, n)
    C : ndarray (m, n) or (Q, m, n)
    L : ndarray (Q, n, m)
    Bf : ndarray (n, n_f) or (Q, n, n_f)
    Df : ndarray (m, n_f) or (Q, m, n_f)
    N : ndarray (Q, n, m) or None

    Returns
    -------
    inputs : FaultInputs
    """
    Q, N = len(A), np.zeros_like(L) if N is None else N
    Bf, Df = stack(Bf, Q, 2), stack(Df, Q, 2)
    one = np.ones(Bf.shape[2])
    as_noise = tnl(A, C, L, N, Bf, Df, one, one)
    n_f = len(one)
    return FaultInputs(as_noise.W[..., :n_f] + as_noise.W[..., n_f:], as_noise.V)


def response(m: ErrorRecursion, faults: FaultInputs, path: Sequence[int], before: int, channel: int) -> Array:
    """Return the residual that a unit step causes, from its onset at the first sample of a path on.

    Parameters
    ----------
    m : ErrorRecursion
    faults : FaultInputs
    path : sequence of int
        Modes from the onset on.
    before : int
        Mode before the onset (``m.start``: the onset is sample 0).
    channel : int

    Returns
    -------
    r : ndarray (K, m)
    """
    e, out = np.zeros(m.A.shape[1]), []
    for i, q in zip(befores(m, path, before), path):
        out.append(m.C[q] @ e + faults.R[i, q, :, channel])
        e = m.A[q] @ e + faults.X[i, q, :, channel]
    return np.array(out)


def zonotope_gauges(sets: Sequence[Array], responses: Array) -> Array:
    """Return the gauge of each response in the zonotope of its sample.

    Parameters
    ----------
    sets : sequence of ndarray (m, g)
    responses : ndarray (K, m)

    Returns
    -------
    t : ndarray (K,)
    """
    return np.array([_gauge(G, r) for G, r in zip(sets, responses)])


def _gauge(G: Array, r: Array) -> float:
    """Gauge in any dimension; with more than three residuals a linear program finds the direction."""
    if len(G) > 3 and np.any(r != 0):
        return zonotope.gauge(G, r, zonotope.best_direction(G, r)[None])
    return zonotope.gauge(G, r) if np.any(r != 0) else 0.0


def ellipsoid_gauges(shapes: Sequence[Array], responses: Array) -> Array:
    """Return the gauge of each response in the ellipsoid of its sample.

    Parameters
    ----------
    shapes : sequence of ndarray (m, m)
    responses : ndarray (K, m)

    Returns
    -------
    t : ndarray (K,)
    """
    return np.array([ellipsoid.gauge(R, r) for R, r in zip(shapes, responses)])


def threshold_gauges(h: Array, directions: Array, responses: Array) -> Array:
    """Return the gauge of each response in the polytope of the thresholds; an interval is the coordinate directions.

    Parameters
    ----------
    h : ndarray (K, d)
    directions : ndarray (d, m)
    responses : ndarray (K, m)

    Returns
    -------
    t : ndarray (K,)
    """
    return zonotope.ratio(np.abs(responses @ directions.T), h).max(axis=1)


def sizes(gauges: Array) -> Array:
    """Return the smallest step that is surely detected within each delay.

    Parameters
    ----------
    gauges : ndarray (K,) or (..., K)
        Of the response to a unit step, by samples since the onset.

    Returns
    -------
    f : ndarray (K,) or (..., K)
        Decreasing; inf where no size is enough.
    """
    with np.errstate(divide="ignore"):
        needed = np.where(gauges > 0, 2.0 * OUTWARD / gauges, np.inf)
    return np.minimum.accumulate(needed, axis=-1)


def steady_set(m: ErrorRecursion, q: int, small: float = 1e-6) -> Array:
    """Return the residual set of a mode that lasts for ever; what is left out of the sum is boxed.

    Parameters
    ----------
    m : ErrorRecursion
    q : int
    small : float
        The sum stops where so little is left of C Ac^j.

    Returns
    -------
    G : ndarray (m, g)
        A bound on every later set too, once the first error has died away.

    Raises
    ------
    ValueError
        The mode is not stable.
    """
    by = contraction(m.A[q])
    if by is None:
        raise ValueError(f"mode {q}: spectral radius of Ac {max(abs(np.linalg.eigvals(m.A[q]))):.4g} (found), "
                         "expected below 1.")
    powers = settled(m.A[q], m.C[q], by, small)
    parts = [m.V[q, q], *(powers[:-1] @ m.W[q, q])]
    rest = by.rows(powers[-1]) * by.columns(m.W[q, q]) / (1.0 - by.mu)
    return np.concatenate([*parts, np.diag(rest)], axis=1)


def settled_mode(m: ErrorRecursion, faults: FaultInputs, q: int, channel: int, within: int) -> tuple[Array, float]:
    """Return the thresholds of a mode that has lasted and lasts for ever, with its exact set.

    Parameters
    ----------
    m : ErrorRecursion
    faults : FaultInputs
    q, channel : int
    within : int
        Longest delay.

    Returns
    -------
    by_delay : ndarray (within + 1,)
    eventually : float
        Once the response has settled (a step may do more, or less, on the way).
    """
    G = steady_set(m, q)
    r = response(m, faults, [q] * (within + 1), q, channel)
    e = np.linalg.solve(np.eye(len(m.A[q])) - m.A[q], faults.X[q, q, :, channel])
    last = zonotope_gauges([G], (m.C[q] @ e + faults.R[q, q, :, channel])[None])
    return sizes(zonotope_gauges([G] * len(r), r)), float(sizes(last)[0])


def futures(modes: int, q: int, lasted: int, dwell: int, steps: int) -> Iterator[tuple[int, ...]]:
    """Give every mode sequence that may follow, the mode at hand first.

    Parameters
    ----------
    modes, q : int
    lasted : int
        Samples that mode q has been active before the first sample of the sequence.
    dwell : int
        Samples a mode lasts at least.
    steps : int

    Yields
    ------
    path : tuple of int
        Of that length.
    """
    if steps <= 1:
        yield (q,) * steps
        return
    for other in range(modes):
        if other == q or lasted + 1 >= dwell:
            for rest in futures(modes, other, lasted + 1 if other == q else 0, dwell, steps - 1):
                yield (q, *rest)


@dataclass(frozen=True)
class SureByMode:
    """Smallest surely detected step of one channel with a table of thresholds, the worst over what may follow.

    Parameters
    ----------
    by_delay : ndarray (Q, J + 1, D + 1)
        By mode and index (samples since it was entered, the last for all later) at the onset, and delay.
    late : ndarray (Q,)
        In a mode that lasts, with the table's last row, once the response has settled.
    """

    by_delay: Array
    late: Array

    @property
    def onset(self) -> float:
        """Worst threshold at the sample of the onset."""
        return float(self.by_delay[:, :, 0].max())

    @property
    def within(self) -> float:
        """Worst threshold at the longest delay."""
        return float(self.by_delay[:, :, -1].max())


def surely_detected(m: ErrorRecursion, faults: FaultInputs, table: DwellTable, channel: int,
                    within: int = 3) -> SureByMode:
    """Return the thresholds of one channel with a dwell table in its last stage.

    Parameters
    ----------
    m : ErrorRecursion
    faults : FaultInputs
    table : DwellTable
    channel : int
    within : int
        Longest delay; shortened where the sequences become too many.

    Returns
    -------
    figures : SureByMode
    """
    h, D, J = table.h[-1], table.directions, table.h.shape[2] - 1
    while within > 0 and _count(m.modes, table.dwell, within) > MOST_FUTURES:
        within -= 1
    worst = np.zeros((m.modes, J + 1, within + 1))
    late = np.full(m.modes, np.inf)
    for q in range(m.modes):
        for j in range(J + 1):
            # In the last row the mode may have lasted any longer: for a dwell beyond the table, any time is possible.
            lasted = [j] if j < J or j >= table.dwell else [j, table.dwell]
            for path in {p for s in lasted for p in futures(m.modes, q, s, table.dwell, within + 1)}:
                index = _indices(path, j, J)
                rows = np.array([h[a, b] for a, b in zip(path, index)])
                for before in (m.others(q) or [m.start]) if j == 0 else [q]:
                    r = response(m, faults, path, before, channel)
                    worst[q, j] = np.maximum(worst[q, j], sizes(threshold_gauges(rows, D, r)))
        e = np.linalg.solve(np.eye(len(m.A[q])) - m.A[q], faults.X[q, q, :, channel])
        settled_response = m.C[q] @ e + faults.R[q, q, :, channel]
        late[q] = sizes(threshold_gauges(h[q, J][None], D, settled_response[None]))[0]
    return SureByMode(worst, late)


def _indices(path: Sequence[int], j: int, last: int) -> list[int]:
    """Row of the table at every sample of a path that begins at index j."""
    out = [j]
    for a, b in zip(path, path[1:]):
        j = min(j + 1, last) if a == b else 0
        out.append(j)
    return out


def _count(modes: int, dwell: int, within: int) -> int:
    """How many futures there are at most: a mode that may be left at once."""
    waiting = [0] * dwell  # paths by samples lasted, capped
    waiting[-1] = 1
    for _ in range(within):
        free = waiting[-1]
        waiting = [free * (modes - 1), *waiting[:-2], free + waiting[-2]] if dwell > 1 else [free * modes]
    return sum(waiting)
