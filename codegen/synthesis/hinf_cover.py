"""A mode of a filter whose plant depends on a number that is known by its range only, such as the speed of a vehicle.

``[x'; y] = M(s) [x; v]`` with M a polynomial in s, and v = V d the inputs. The sampled matrix is covered for every s of
the range (``algebra.cover``): a repeated real number for the straight line in s, and a full block for what the line
misses. Nothing is linearised away. s is constant within a sampling period and may jump between them.
"""

from __future__ import annotations

import numpy as np

from ..algebra.cover import sampled_cover
from .hinf_problem import FilterMode, elementwise, mode_of, repeated

Array = np.ndarray


def covered_mode(motion, outputs, period: float, bounds, V: Array, F: Array, extra: tuple[Array, Array], n_f: int,
                 x_size: Array) -> FilterMode:
    """Sample, cover and scale.

    Parameters
    ----------
    motion, outputs : sequence of ndarray (n_x, n_x + n_v) and (n_y, n_x + n_v)
        Coefficients of s^0, s^1, ... of x' and y.
    period : float
        Seconds.
    bounds : (lo, hi)
        Of s, floats or balls.
    V : ndarray (n_v, n_d)
        Inputs of the plant from normalised unknowns d; the last n_f of them are the faults.
    F : ndarray (n_y, n_d)
        What else d does to the outputs: noise.
    extra : (ndarray (m, n_x), ndarray (m, n_d))
        Outputs that do not depend on s.
    n_f : int
    x_size : ndarray (n_x,)
        Sizes of the states, by which they are scaled.

    Returns
    -------
    FilterMode
    """
    n, n_y = len(x_size), len(outputs[0])
    found = sampled_cover(motion, outputs, period, *bounds)
    place = np.zeros((n + len(V), n + V.shape[1]))
    place[:n, :n], place[n:, n:] = np.diag(x_size), V
    rows = np.concatenate([1 / np.asarray(x_size), np.ones(n_y)])[:, None]
    base = rows * found.base @ place
    total = n + n_y + len(extra[0])
    # What float64 loses in the scaling and in the factors of the repeated number.
    size = np.abs(rows) * (np.abs(found.base) + 8 * np.linalg.norm(found.slope)) @ np.abs(place)
    rest = rows * found.radius @ np.abs(place) + 2.0**-44 * size
    blocks = (repeated(rows * found.slope @ place, total), elementwise(rest, total))
    C = np.vstack([base[n:, :n], extra[0] * x_size])
    Fd = np.vstack([base[n:, n:] + F, extra[1]])
    split = V.shape[1] - n_f
    return mode_of(base[:n, :n], base[:n, n:n + split], base[:n, n + split:], C, Fd[:, :split], Fd[:, split:], blocks)
