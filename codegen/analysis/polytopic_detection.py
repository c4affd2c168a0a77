"""Surely detected faults of a polytopic observer: a step of a sensor fault that is seen at its first sample.

The residual is linear in y at its own sample: a fault f adds M (I - C T2) Df f to what it would be without, which is
at most the last threshold h once settled. So an alarm is sure where that exceeds 2 h in one residual. Later samples
are not looked at: the estimate takes up a lasting fault. A fault that moves the state is in the residual later, by
way of weights that it moves too: nothing is promised of it. Where the threshold is calibrated, what is there without
the fault is as large as the guaranteed one, and nothing is sure where there is none.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def thresholds(plant, t, within: int, calibration: dict | None = None) -> Array:
    """Smallest sizes per fault channel and delay.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    t : PolytopicTables
    within : int
    calibration : dict, optional
        Of the certificate.

    Returns
    -------
    ndarray (n_f, within + 1)
        Infinite where no size is sure.
    """
    T2, C, M = (getattr(t, k).astype(float) for k in ("T2", "C", "M"))
    seen = np.abs(M @ (plant.polytope.Df - C @ (T2 @ plant.polytope.Df)))
    # What is left of an exact zero, of terms of about one unit of y, is none.
    seen = np.where(seen > 1e-6 * (np.abs(M) @ np.abs(plant.polytope.Df)), seen, 0.0)
    beside = t.h[-1].astype(float)
    if calibration is not None:
        beside = np.array(calibration["guaranteed"] or [np.inf] * len(beside), dtype=float)
    with np.errstate(divide="ignore"):
        size = np.min((t.h[-1].astype(float) + beside)[:, None] / seen, axis=0)
    moved = [np.any([v.Bf[:, j] for v in plant.polytope.vertices]) for j in range(plant.n_f)]
    # Double precision; a part in a million covers its rounding generously.
    return np.tile(np.where(moved, np.inf, size)[:, None] * (1 + 1e-6), within + 1)
