"""Centred ellipsoids {x, d' x <= sqrt(d' X d) for every d}: sums, membership, boxes.

The shape X is positive semidefinite and may be singular (the image of a disturbance that acts on one state). A sum of
ellipsoids is none; for any t_i > 0 it lies in the one with shape ``sum(t) sum(X_i / t_i)``. t_i = sqrt(tr X_i) makes
the trace smallest (not the volume: Zammali (2020), Remark 23 errs) and costs a square root per sum; weights fixed
offline cost none and keep the result linear in the shapes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray


def support(X: Array, directions: Array) -> Array:
    """Return the largest d' x over the set for each direction.

    Parameters
    ----------
    X : ndarray (n, n)
    directions : ndarray (k, n)

    Returns
    -------
    h : ndarray (k,)
    """
    return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", directions, X, directions), 0.0))


def hull(X: Array) -> Array:
    """Return the half widths of the interval hull, the square roots of the diagonal.

    Parameters
    ----------
    X : ndarray (n, n)

    Returns
    -------
    b : ndarray (n,)
    """
    return np.sqrt(np.diag(X))


def of_box(half: Array) -> Array:
    """Return the smallest ellipsoid around a box, ``s diag(b^2)`` with s the number of sides that are not zero.

    ``diag(b^2)`` alone is *inside* the box: its corners, which bounded noise may reach, would be left out.

    Parameters
    ----------
    half : ndarray (s,)

    Returns
    -------
    X : ndarray (s, s)
    """
    half = np.asarray(half, dtype=float)
    return np.count_nonzero(half) * np.diag(half * half)


def image(M: Array, X: Array) -> Array:
    """Return the shape of {M x}, symmetric to the last digit.

    Parameters
    ----------
    M : ndarray (m, n)
    X : ndarray (n, n)

    Returns
    -------
    Y : ndarray (m, m)
    """
    Y = M @ X @ M.T
    return (Y + Y.T) / 2.0


def add(shapes: Sequence[Array], weights: Sequence[float] | None = None) -> Array:
    """Bound the Minkowski sum of several ellipsoids by one.

    Parameters
    ----------
    shapes : sequence of ndarray (n, n)
    weights : sequence of float or None
        t_i > 0 in any common scale; None: sqrt(tr X_i), the smallest trace. Shapes of zero are passed over.

    Returns
    -------
    X : ndarray (n, n)

    Raises
    ------
    ValueError
        A weight that is not positive, of a shape that is not zero.
    """
    if weights is None:
        weights = [np.sqrt(np.trace(X)) for X in shapes]
    pairs = [(t, X) for t, X in zip(weights, shapes) if np.any(X != 0)]
    if not pairs:
        return np.zeros_like(shapes[0])
    if any(not t > 0 for t, _ in pairs):
        raise ValueError(f"weights: {min(t for t, _ in pairs):g} (found), expected above 0.")
    return sum(t for t, _ in pairs) * sum(X / t for t, X in pairs)


def add_fixed(X: Array, Y: Array, alpha: float) -> Array:
    """Bound the sum of two by ``(1 + alpha) X + (1 + 1/alpha) Y``: sound for any alpha > 0, no square root.

    Parameters
    ----------
    X, Y : ndarray (n, n)
    alpha : float
        Best is sqrt(tr Y / tr X).

    Returns
    -------
    Z : ndarray (n, n)
    """
    return (1.0 + alpha) * X + (1.0 + 1.0 / alpha) * Y


def contains(R: Array, r: Array) -> bool:
    """Decide r' R^-1 r <= 1 by elimination, without a square root; NaN and a flat set are outside.

    Parameters
    ----------
    R : ndarray (m, m)
    r : ndarray (m,)

    Returns
    -------
    inside : bool
        False where R is not positive definite: such a set has to be tested by supports.
    """
    return bool(quadratic(R, r) <= 1.0)  # false for NaN


def quadratic(R: Array, r: Array) -> float:
    """Return r' R^-1 r by an LDL' elimination; NaN where R is not positive definite.

    Parameters
    ----------
    R : ndarray (m, m)
    r : ndarray (m,)

    Returns
    -------
    value : float
    """
    M, z, total = np.array(R, dtype=float), np.array(r, dtype=float), 0.0
    for k in range(len(z)):
        if not M[k, k] > 0:
            return float("nan")
        total += z[k] * z[k] / M[k, k]
        factor = M[k + 1:, k] / M[k, k]
        z[k + 1:] -= factor * z[k]
        M[k + 1:, k + 1:] -= factor[:, None] * M[k, k + 1:][None]
    return float(total)


def gauge(R: Array, r: Array) -> float:
    """Return the smallest t with r in t times the set; inf where R is flat.

    Parameters
    ----------
    R : ndarray (m, m)
    r : ndarray (m,)

    Returns
    -------
    t : float
    """
    value = quadratic(R, r)
    return float(np.sqrt(value)) if value >= 0 else float("inf")


def area(R: Array) -> float:
    """Return the area of an ellipse, pi sqrt(det R).

    Parameters
    ----------
    R : ndarray (2, 2)

    Returns
    -------
    area : float
    """
    return float(np.pi * np.sqrt(max(np.linalg.det(R), 0.0)))


def outline(R: Array, count: int = 64) -> Array:
    """Return points on the edge of an ellipse, counter-clockwise.

    Parameters
    ----------
    R : ndarray (2, 2)
    count : int

    Returns
    -------
    points : ndarray (count, 2)
    """
    size, axes = np.linalg.eigh(R)
    angle = 2.0 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)])
    points = (axes * np.sqrt(np.maximum(size, 0.0))) @ circle
    return points.T if np.linalg.det(axes) > 0 else points.T[::-1]
