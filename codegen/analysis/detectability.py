"""Surely detected faults: how small a fault may be and still raise the alarm for every disturbance.

A step of size f on one channel is surely detected within D samples of its onset when, whatever the mode
sequence that the certificate admits and whatever the disturbance and noise within their bounds, some
output leaves its bounds at some sample up to then. For one sequence, output i and delay d that is
``f > sup r_i / |response_i|`` (adjoint); the smallest over i and d counts, and then the worst over all
sequences. Before the onset the errors are anywhere in their ultimate box: the figure holds once the
framers have settled, and again after each recovery. Plants with parameters or unknowns go their own way (``robust``),
with an assumption more where the fault acts on the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..algebra.dwell import admissible
from ..observers import BankTables, FilterTables, PointTables, PolytopicTables
from . import filter_detection, point_detection, polytopic_detection, robust
from .adjoint import ResidualModel, extremes, fault_response

Array = np.ndarray

#: Upper limit on mode sequences looked at; the history before the onset is shortened to stay below it.
MOST_SEQUENCES = 6000


@dataclass(frozen=True)
class SureFault:
    """Smallest step fault of one channel that is surely detected.

    Parameters
    ----------
    channel : str
    unit : str
    by_delay : tuple of float
        Entry d: threshold when the alarm must come within d samples after the onset sample; inf where no
        size is enough.
    """

    channel: str
    unit: str
    by_delay: tuple[float, ...]

    @property
    def best(self) -> float:
        """Threshold at the longest delay looked at."""
        return self.by_delay[-1]


def ultimate_errors(cert: dict) -> tuple[Array, Array] | None:
    """Bounds on both framer errors once settled: the box of the certificate, else its Lyapunov level."""
    if cert.get("steady_box"):
        return np.array(cert["steady_box"]["hi"]), np.array(cert["steady_box"]["lo"])
    if cert["kind"] == "linf" and "P_hi" in cert:
        # e' P e <= level^2 with P >= I: no component exceeds level / sqrt(min_q P_ii).
        return tuple(cert["level"] / np.sqrt(np.min(np.array(cert["P_" + s]), axis=0)) for s in ("hi", "lo"))
    return None


def sequences(n_modes: int, length: int, switching: tuple[float, float] | None) -> Array:
    """All mode sequences of a length, or those that respect (tau, N0)."""
    every = product(range(n_modes), repeat=length)
    if switching is not None:
        every = (s for s in every if admissible(s, *switching))
    return np.array(list(every), dtype=int).reshape(-1, length)


def covered(plant, sizes: Array) -> Array:
    """No size of a fault on the state beyond its range: what it does within a period is enclosed for that range alone.

    Parameters
    ----------
    plant : Plant
    sizes : ndarray (n_f, D + 1)
        By channel and delay.

    Returns
    -------
    ndarray (n_f, D + 1)
        Infinite where nothing is promised.
    """
    if plant.kind != "continuous":
        return sizes
    inside = np.array([any(np.any(m.Bf[:, j]) for m in plant.modes) for j in range(plant.n_f)], dtype=bool)
    most = np.where(inside, np.max(np.abs(plant.limits("f")), axis=0), np.inf)
    return np.where(sizes <= most[:, None], sizes, np.inf)


def surely_detected(plant, t, cert: dict, within: int = 3) -> list[SureFault]:
    """Thresholds per fault channel for delays 0..within, worst over admissible mode sequences.

    Parameters
    ----------
    plant : Plant
    t : FramerTables
    cert : dict
        Certificate of these tables.
    within : int
        Longest delay in samples.

    Returns
    -------
    list of SureFault
        One per channel of ``plant.f``.
    """
    if isinstance(t, PointTables):
        found = covered(plant, point_detection.thresholds(plant.enclosed, t, cert, within))
        return [SureFault(f.name, f.unit, tuple(map(float, row))) for f, row in zip(plant.f, found)]
    if isinstance(t, FilterTables):
        calibrated = cert.get("calibration")
        quiet = calibrated and np.array(calibrated["guaranteed"])
        found = covered(plant, filter_detection.thresholds(plant.enclosed, t, within, quiet))
        return [SureFault(f.name, f.unit, tuple(map(float, row))) for f, row in zip(plant.f, found)]
    if isinstance(t, PolytopicTables):
        found = polytopic_detection.thresholds(plant, t, within, cert.get("calibration"))
        return [SureFault(f.name, f.unit, tuple(map(float, row))) for f, row in zip(plant.f, found)]
    if isinstance(t, BankTables):
        return [SureFault(f.name, f.unit, tuple([np.inf] * (within + 1))) for f in plant.f]
    tails = ultimate_errors(cert)
    infinite = tuple([np.inf] * (within + 1))
    if tails is None or not plant.f:
        return [SureFault(f.name, f.unit, infinite) for f in plant.f]
    if t.vary is not None:
        return [SureFault(f.name, f.unit, robust.thresholds(plant.observed.modes, t, tails, j, within))
                for j, f in enumerate(plant.f)]
    model = ResidualModel.of(plant.modes, t)
    before = 1
    while plant.n_modes > 1 and plant.n_modes ** (within + before + 2) <= MOST_SEQUENCES and before < 6:
        before += 1
    if plant.n_modes == 1:
        before = 12
    while plant.n_modes ** (within + before + 1) > 4 * MOST_SEQUENCES and within > 0:
        within -= 1
    switching = None if cert["kind"] != "linf" else limited(cert)
    paths = sequences(plant.n_modes, before + within + 1, switching)
    result = thresholds(model, beginnings(paths, before), range(plant.n_f), before, tails).max(axis=2)
    # Delays that were too many to look at: what is found by an earlier one is found by then too.
    return [SureFault(f.name, f.unit, tuple(float(by[min(d, len(by) - 1)]) for d in range(len(infinite))))
            for f, by in zip(plant.f, result)]


def limited(cert: dict) -> tuple[float, float] | None:
    """The (tau, N0) of a certificate whose claim rests on it; None for arbitrary switching."""
    if cert["dwell_add"] <= cert["dwell_drain"] or cert["rho"] <= 1:
        return None
    return cert["dwell_add"] / cert["dwell_drain"], cert["chatter"]


def along(m: ResidualModel, paths: Array, channel: int, onset: int, tails: tuple[Array, Array]) -> Array:
    """Thresholds of one channel for delays 0.. and each of the given sequences (onset at that sample).

    Returns
    -------
    ndarray (paths.shape[1] - onset, S)
        Worse of the two signs of the fault; decreasing along the first axis.
    """
    return thresholds(m, beginnings(paths, onset), [channel], onset, tails)[0]


def beginnings(paths: Array, onset: int) -> list[tuple[Array, Array]]:
    """For each delay the different sequences up to it, and which of them each path begins with."""
    found = (np.unique(paths[:, :stop], axis=0, return_inverse=True) for stop in range(onset + 1, paths.shape[1] + 1))
    return [(head, inverse.ravel()) for head, inverse in found]


def thresholds(m: ResidualModel, heads: list[tuple[Array, Array]], channels: Sequence[int], onset: int,
               tails: tuple[Array, Array]) -> Array:
    """As ``along`` for several channels at once: what the disturbance can do is the same for all of them.

    Parameters
    ----------
    heads : list of (ndarray (H, onset + d + 1), ndarray (S,))
        Of ``beginnings``.

    Returns
    -------
    ndarray (len(channels), len(heads), S)
    """
    best = np.full((len(channels), 2, len(heads[0][1])), np.inf)
    out = np.empty((len(channels), len(heads), best.shape[2]))
    for d, (head, inverse) in enumerate(heads):
        above, below = extremes(m, head, *tails)
        for j, channel in enumerate(channels):
            g_hi, g_lo = fault_response(m, head, channel, onset)
            for s, sign in enumerate((+1, -1)):
                down, up = -sign * g_hi, sign * g_lo
                with np.errstate(divide="ignore", invalid="ignore"):
                    needed = np.minimum(np.where(down > 1e-12 * above, above / down, np.inf),
                                        np.where(up > 1e-12 * below, below / up, np.inf)).min(axis=1)
                best[j, s] = np.minimum(best[j, s], needed[inverse])
            out[j, d] = best[j].max(axis=0)
    # The recursion runs in double precision; a part in a million covers its own rounding generously.
    return out * (1 + 1e-6)
