"""What a mode estimator promised of a run: the true mode in its set, and the decision in time."""

from __future__ import annotations

import numpy as np

from ..observers import SlidingTrace

Array = np.ndarray


def acting(kind: str, q: Array) -> Array:
    """The mode of every sample: of a discrete plant, whose q[k] acts from sample k on, that of the step before it."""
    return np.concatenate([q[:1], q[:-1]]) if kind == "discrete" else q


def keeps_the_true_mode(trace) -> bool:
    """Whether a trace has a set of modes that holds the true one, and bounds cut with every measurement."""
    return hasattr(trace, "mode_set") and not isinstance(trace, SlidingTrace)


def dropped(kind: str, truth, trace) -> Array:
    """Samples at which the true mode is not among those called possible; none of other observers, or of records.

    Parameters
    ----------
    kind : {"discrete", "continuous"}
    truth : PlantTrace
    trace : Trace or ModeTrace

    Returns
    -------
    ndarray (K,) bool
    """
    if not keeps_the_true_mode(trace) or np.isnan(truth.x).all():  # of a record nobody knows
        return np.zeros(len(truth.q), dtype=bool)
    return (trace.mode_set.astype(np.int64) >> acting(kind, truth.q)) & 1 == 0


def understated(kind: str, truth, trace) -> Array:
    """Samples at which an estimate of faults in the true mode is beyond its bound; none of observers without.

    Where nothing is proved of the decision, the mode has to be the true one since the filter's start.

    Parameters
    ----------
    kind : {"discrete", "continuous"}
    truth : PlantTrace
    trace : Trace, TrailingTrace or GuidedFilterTrace

    Returns
    -------
    ndarray (K,) bool
    """
    if not (hasattr(trace, "mode_set") and hasattr(trace, "f_hat")):
        return np.zeros(len(truth.q), dtype=bool)
    right = trace.mode == acting(kind, truth.q) if keeps_the_true_mode(trace) else ~unbound(truth, trace)
    return right & np.any(np.abs(trace.f_hat) > trace.f_bound, axis=1)


def unbound(truth, trace) -> Array:
    """Samples at which bounds of x are not promised: where they are those of a mode that was not always the true one.

    Parameters
    ----------
    truth : PlantTrace
    trace : Trace or SlidingTrace

    Returns
    -------
    ndarray (K,) bool
    """
    out = np.zeros(len(truth.q), dtype=bool)
    if isinstance(trace, SlidingTrace):
        for k, age in enumerate(trace.age.astype(int)):
            out[k] = np.any(truth.q[max(k - age, 0):k + 1] != trace.mode[k])
    return out


def late(kind: str, cert: dict, truth, trace, settled: Array) -> int:
    """Samples at which the decision is wrong though the certificate says that it is right by then.

    Parameters
    ----------
    kind : {"discrete", "continuous"}
    cert : dict
        Of the number type that ran.
    truth : PlantTrace
    trace : ModeTrace
    settled : ndarray (K,) bool
        Where the promise is in force: no fault so far.

    Returns
    -------
    int
    """
    q, found = acting(kind, truth.q), 0
    whole = settled & (trace.status == 0) & ~np.isnan(trace.r_lo).any(axis=1)
    edges = [0, *(np.flatnonzero(np.diff(q)) + 1), len(q)]
    for n, (begin, end) in enumerate(zip(edges, edges[1:])):
        if n == 0:
            due = cert["start"]
            calm = end - begin > cert["dwell"] or end == len(q)
        else:  # the switch fell after sample begin - 1; one sample more than the dwell time, as it may fall anywhere
            due = begin - 1 + cert["identified"][q[begin - 1]][q[begin]]
            calm = begin - edges[n - 1] > cert["dwell"]
        if not calm or not whole[:end].all():
            return found
        found += int(np.sum(trace.mode[due:end] != q[begin]))
    return found


def due(kind: str, names: tuple[str, ...], cert: dict, truth, trace, settled: Array, inside=True) -> list:
    """Steps of a fault of which the certificate says that they leave no mode possible.

    Parameters
    ----------
    kind, cert, truth, trace, settled
        As of ``late``.
    names : tuple of str
        Channels of the faults.
    inside : ndarray (K,) bool
        Where x is within its declared range.

    Returns
    -------
    list of (int, dict)
        First sample of the step, and the promise.
    """
    q, found = acting(kind, truth.q), []
    whole = (trace.status == 0) & ~np.isnan(trace.r_lo).any(axis=1) & inside
    edges = np.concatenate([[0], np.flatnonzero(np.diff(q)) + 1])
    for promise in cert.get("faults", ()):
        f, others = truth.f[:, names.index(promise["channel"])], np.delete(truth.f, names.index(promise["channel"]), 1)
        for k in np.flatnonzero((f[1:] != 0) & (f[:-1] == 0)) + 1:
            end = k + promise["within"] + 1
            calm = k - edges[edges <= k][-1] > promise["after"] and end < len(q) and np.all(q[k:end + 1] == q[k])
            step = np.all(f[k:end] == f[k]) and promise["size"] <= abs(f[k]) <= promise.get("upto", np.inf)
            if calm and step and not np.any(others[k:end]) and settled[:k].all() and whole[:end].all():
                found.append((int(k), promise))
    return found


def missed(kind: str, names: tuple[str, ...], cert: dict, truth, trace, settled: Array, inside=True) -> int:
    """How many of the steps that are ``due`` left a mode possible; the parameters are the same."""
    return sum(not np.any(trace.raw_bits[k:k + promise["within"] + 1])
               for k, promise in due(kind, names, cert, truth, trace, settled, inside))


def within_range(plant, truth) -> Array:
    """Samples at which x is within its declared range.

    Parameters
    ----------
    plant : Plant
    truth : PlantTrace

    Returns
    -------
    ndarray (K,) bool
        Where x is not known, it counts as that.
    """
    lo, hi = plant.limits("x")
    return ~np.any((truth.x < lo) | (truth.x > hi), axis=1)
