"""Sets of the fault-free residual along a mode sequence: zonotopes (reduced or exact), intervals, ellipsoids.

The offline side of what the firmware carries, and the oracle of every table: nothing here depends on what is measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import ellipsoid, zonotope
from .error_set import ErrorRecursion, stack

Array = np.ndarray


def befores(m: ErrorRecursion, path: Sequence[int], before: int | None = None) -> list[int]:
    """Return the mode before each sample of a path.

    Parameters
    ----------
    m : ErrorRecursion
    path : sequence of int
    before : int or None
        Mode before the first sample; None: it is sample 0.

    Returns
    -------
    modes : list of int
    """
    return [m.start if before is None else before, *path[:-1]]


def zonotopes(m: ErrorRecursion, path: Sequence[int], H0: Array, order: int | None = None, key: str = "squared",
              coordinates: Array | None = None, before: int | None = None) -> list[Array]:
    """Return the generators of the residual set at every sample of a path.

    Parameters
    ----------
    m : ErrorRecursion
    path : sequence of int
    H0 : ndarray (n, g)
        Generators of the first error.
    order : int or None
        Columns kept of the error before each step; None: no reduction, the set is exact.
    key : {"squared", "girard"}
    coordinates : ndarray (n, n) or (Q, n, n) or None
        In which the reduction boxes, per mode of the step that follows.
    before : int or None
        Mode before the first sample; None: it is sample 0.

    Returns
    -------
    sets : list of ndarray (m, columns)
        With the error as it is before the reduction.
    """
    T = None if coordinates is None else stack(coordinates, m.modes, 2)
    H, sets = np.asarray(H0, dtype=float), []
    for b, q in zip(befores(m, path, before), path):
        sets.append(np.concatenate([m.C[q] @ H, m.V[b, q]], axis=1))
        if order is not None:
            H = zonotope.reduce(H, order, key, None if T is None else T[q])
        H = np.concatenate([m.A[q] @ H, m.W[b, q]], axis=1)
    return sets


def thresholds(m: ErrorRecursion, path: Sequence[int], H0: Array, directions: Array, order: int | None = None,
               key: str = "squared", coordinates: Array | None = None, before: int | None = None) -> Array:
    """Return the supports h_k(d) of the residual set at every sample of a path; exact without an order.

    Parameters
    ----------
    m : ErrorRecursion
    path : sequence of int
    H0 : ndarray (n, g)
    directions : ndarray (d, m)
    order, key, coordinates, before :
        As ``zonotopes``.

    Returns
    -------
    h : ndarray (K, d)
    """
    sets = zonotopes(m, path, H0, order, key, coordinates, before)
    return np.array([zonotope.support(R, directions) for R in sets])


def intervals(m: ErrorRecursion, path: Sequence[int], half0: Array, before: int | None = None) -> Array:
    """Return the half widths of the residual box at every sample of a path, with |Ac_q|.

    Parameters
    ----------
    m : ErrorRecursion
    path : sequence of int
    half0 : ndarray (n,)
    before : int or None

    Returns
    -------
    half : ndarray (K, m)
    """
    b, out = np.asarray(half0, dtype=float), []
    for i, q in zip(befores(m, path, before), path):
        out.append(np.abs(m.C[q]) @ b + zonotope.hull(m.V[i, q]))
        b = np.abs(m.A[q]) @ b + zonotope.hull(m.W[i, q])
    return np.array(out)


def pushed_shapes(m: ErrorRecursion) -> tuple[Array, Array]:
    """Return the ellipsoids that hold what a step adds to the error and to the residual.

    A group of columns G that is the image of a box lies in the ellipsoid ``s G G'``, s its columns that are not zero.

    Parameters
    ----------
    m : ErrorRecursion

    Returns
    -------
    Hd : ndarray (Q + 1, Q, n, n)
    Hv : ndarray (Q + 1, Q, m, m)
    """
    ends = np.cumsum(m.groups)
    every = [(i, q) for i in range(m.modes + 1) for q in range(m.modes)]
    Hd, Hv = np.zeros((m.modes + 1, *m.A.shape)), np.zeros((*m.V.shape[:3], m.V.shape[2]))
    for i, q in every:
        Hd[i, q] = ellipsoid.add([of_group(G) for G in np.split(m.W[i, q], ends[:-1], axis=1)])
        Hv[i, q] = of_group(m.V[i, q])
    return Hd, Hv


def of_group(G: Array) -> Array:
    """Return the shape of an ellipsoid around {G z, |z_i| <= 1}: s G G', s the columns that are not zero.

    Parameters
    ----------
    G : ndarray (n, s)

    Returns
    -------
    X : ndarray (n, n)
    """
    return np.count_nonzero(np.any(G != 0, axis=0)) * (G @ G.T)


def ellipsoids(m: ErrorRecursion, path: Sequence[int], X0: Array, alpha: Array | None = None,
               before: int | None = None) -> list[Array]:
    """Return the shape of the residual ellipsoid at every sample of a path.

    Parameters
    ----------
    m : ErrorRecursion
    path : sequence of int
    X0 : ndarray (n, n)
        Shape of the first error; of a box: ``ellipsoid.of_box``.
    alpha : ndarray (Q,) or None
        Fixed weights of ``steady_weights``; None: trace-optimal ones (a square root per step and sum).
    before : int or None

    Returns
    -------
    shapes : list of ndarray (m, m)
    """
    Hd, Hv = pushed_shapes(m)
    X, shapes = np.asarray(X0, dtype=float), []
    for i, q in zip(befores(m, path, before), path):
        shapes.append(ellipsoid.add([ellipsoid.image(m.C[q], X), Hv[i, q]]))
        M = ellipsoid.image(m.A[q], X)
        X = ellipsoid.add([M, Hd[i, q]]) if alpha is None else ellipsoid.add_fixed(M, Hd[i, q], alpha[q])
    return shapes


def steady_weights(m: ErrorRecursion, steps: int = 500) -> Array:
    """Return the weight sqrt(tr Hd / tr M) per mode that trace-optimal sums settle at while the mode stays.

    Parameters
    ----------
    m : ErrorRecursion
    steps : int

    Returns
    -------
    alpha : ndarray (Q,)
        ``(1 + alpha_q) rho(A_q)^2 < 1``, so the linear recursion of each mode is bounded.

    Raises
    ------
    ValueError
        A mode whose shape does not settle, with the spectral radius of Ac_q.
    """
    Hd, _ = pushed_shapes(m)
    alpha = np.ones(m.modes)
    for q in range(m.modes):
        X = Hd[q, q]
        for _ in range(steps):
            M = ellipsoid.image(m.A[q], X)
            X = ellipsoid.add([M, Hd[q, q]])
        top, bottom = np.trace(Hd[q, q]), np.trace(M)
        alpha[q] = np.sqrt(top / bottom) if bottom > 0 else 1e6
        radius = max(abs(np.linalg.eigvals(m.A[q])))
        if not (1.0 + alpha[q]) * radius**2 < 1.0 and bottom > 0 and radius > 0:
            raise ValueError(f"mode {q}: the ellipsoid does not settle (found spectral radius {radius:.3g} of Ac), "
                             "expected below 1.")
    return alpha
