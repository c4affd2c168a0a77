"""Sensitivity of given constants to faults of low frequency: the matrices that ``certify.finite_frequency`` judges."""

from __future__ import annotations

from math import sqrt

import cvxpy as cp
import numpy as np

from .descriptor_lmi import he, solve
from .descriptor_problem import Scaling

Array = np.ndarray


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))


def band_level(errors: tuple[dict, Array, Array], M: Array, s: Scaling, band: float, period: float | None,
               margin: float) -> dict | None:
    """Largest share of a fault's energy that the weighted residual has at least, over a band.

    Parameters
    ----------
    errors : (dict, ndarray (p, n), ndarray (p, n_f))
        j -> (N_j, B_j); C and D. Anything that converts to floats.
    M : ndarray (k, p)
    s : Scaling
    band : float
        rad per unit of the plant's time.
    period : float or None
    margin : float
        What every inequality keeps to spare in scaled coordinates.

    Returns
    -------
    proof : dict or None
        "level2", "beta", "P", "Q", "Y", "band", "period"; None where the solver finds none.
    """
    own, C, D = errors
    n, n_f, columns = C.shape[1], D.shape[1], s.columns
    w, T = band / s.time, 0.0 if period is None else period * s.time
    P, Q = (cp.Variable((n, n), symmetric=True) for _ in range(2))
    Y, level = cp.Variable((2 * n + n_f, n)), cp.Variable()
    out = M @ np.hstack([np.zeros((len(C), n)), _floats(C) * columns, _floats(D)])
    none = np.zeros((n, n_f))
    base = cp.bmat([[Q - T * P, -P, none], [-P, -w**2 * Q, none],
                    [none.T, none.T, -level * np.eye(n_f)]]) + out.T @ out
    conditions = [Q >> margin * np.eye(n)]
    for N, B in own.values():
        N = _floats(N) * columns / columns[:, None] / s.time
        flow = np.hstack([np.eye(n), -N, -_floats(B) / columns[:, None] / s.time])
        S = base + he(Y @ flow)
        conditions.append((S + S.T) / 2 >> margin * np.eye(2 * n + n_f))
    if not solve(cp.Problem(cp.Maximize(level), conditions)) or level.value <= 0:
        return None
    # Back in the plant's units: d = time columns ds, e = columns es; the energies stay.
    both = np.outer(columns, columns)
    left = np.concatenate([1 / (columns * s.time), 1 / columns, np.ones(n_f)])
    value = float(level.value) * (1 - 1e-9)
    return {"level2": value, "beta": sqrt(value) * (1 - 1e-12), "band": band, "period": period,
            "P": ((P.value + P.value.T) / 2 / both / s.time).tolist(),
            "Q": ((Q.value + Q.value.T) / 2 / both / s.time**2).tolist(),
            "Y": (left[:, None] * Y.value / columns / s.time).tolist()}
