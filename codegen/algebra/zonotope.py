"""Centred zonotopes {G z, |z_i| <= 1}: support, sum, reduction as the firmware does it, membership without a program.

A generator matrix G is (n, g), one column per generator; a set with a centre is moved to zero by its user. The linear
image of a set is ``M @ G``, the sum of two is ``add(G, H)``. Reduction keeps the largest columns and boxes the rest
(Zammali (2020), Algorithm 1, with Girard's key as an alternative); selection is by repeated maximum with a swap, whose
number of compares depends on the sizes only, so that the target has no sort whose time depends on data.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

Array = np.ndarray

#: Keys by which columns are kept.
KEYS = ("squared", "girard")
#: Rounding of a support in double precision, of the magnitudes that it sums.
SLACK = 1e-13


def support(G: Array, directions: Array) -> Array:
    """Return the largest d' x over the set for each direction.

    Parameters
    ----------
    G : ndarray (n, g)
    directions : ndarray (k, n)

    Returns
    -------
    h : ndarray (k,)
    """
    return np.abs(directions @ G).sum(axis=1)


def hull(G: Array) -> Array:
    """Return the half widths of the interval hull, the row sums of |G|.

    Parameters
    ----------
    G : ndarray (n, g)

    Returns
    -------
    b : ndarray (n,)
    """
    return np.abs(G).sum(axis=1)


def add(*sets: Array) -> Array:
    """Return the generators of the Minkowski sum: all columns side by side.

    Parameters
    ----------
    *sets : ndarray (n, g_i)

    Returns
    -------
    G : ndarray (n, sum g_i)
    """
    return np.concatenate(sets, axis=1)


def keys(G: Array, key: str, weight: Array | None = None) -> Array:
    """Return what columns are compared by: the squared norm, or Girard's |h|_1 - |h|_inf.

    Girard's key is the error that boxing the column makes. It is rarely worse, and much better where reduction nearly
    diverges.

    Parameters
    ----------
    G : ndarray (n, g)
    key : {"squared", "girard"}
    weight : ndarray (n,) or None
        Of the squares (of the sizes, with Girard's key): makes states of different units alike.

    Returns
    -------
    values : ndarray (g,)

    Raises
    ------
    ValueError
        Another key.
    """
    weight = np.ones(len(G)) if weight is None else np.asarray(weight)
    if key == "squared":
        return (weight[:, None] * (G * G)).sum(axis=0)
    if key == "girard":
        size = weight[:, None] * np.abs(G)
        return size.sum(axis=0) - size.max(axis=0)
    raise ValueError(f"key: {key!r} (found), expected one of {', '.join(KEYS)}.")


def reduce(G: Array, order: int, key: str = "squared", coordinates: Array | None = None,
           weight: Array | None = None) -> Array:
    """Bound a set by one with at most ``order`` columns.

    The ``order - n`` columns with the largest keys go first, found one after the other by a strict > from the lowest
    index on and swapped into place; the others become a box. Where nothing is too many, G is returned as it is.

    Parameters
    ----------
    G : ndarray (n, g)
    order : int
        At least n.
    key : {"squared", "girard"}
    coordinates : ndarray (n, n) or None
        T: keys and box are those of T^-1 G (a parallelotope in x). None: the coordinates of x.
    weight : ndarray (n,) or None
        Of ``keys``.

    Returns
    -------
    H : ndarray (n, min(g, order))
        Contains the set of G.

    Raises
    ------
    ValueError
        ``order`` below n.
    """
    n, columns = G.shape
    if order < n:
        raise ValueError(f"order: {order} (found), expected at least {n}, the columns of a box.")
    if columns <= order:
        return G
    if coordinates is not None:
        return coordinates @ reduce(np.linalg.solve(coordinates, G), order, key, None, weight)
    G, size = G.copy(), keys(G, key, weight)
    kept = order - n
    for i in range(kept):
        best = i + int(np.argmax(size[i:]))  # the first of the largest, as a strict > finds it
        G[:, [i, best]] = G[:, [best, i]]
        size[[i, best]] = size[[best, i]]
    return np.concatenate([G[:, :kept], np.diag(hull(G[:, kept:]))], axis=1)


def compares(n: int, order: int, appended: int) -> int:
    """Return how many compares one selection takes, whatever the data: (l-n)(l+c) - (l-n)(l-n+1)/2.

    Parameters
    ----------
    n : int
        Rows.
    order : int
        Columns kept, l.
    appended : int
        Columns above the order, c.

    Returns
    -------
    count : int
    """
    kept = order - n
    return kept * (order + appended) - kept * (kept + 1) // 2


def normals(G: Array) -> Array:
    """Return directions whose supports describe the set exactly, in one, two and three dimensions.

    Those are the normals of every m - 1 generators. The unit vectors count as generators here: they give the
    coordinate rows, without which a flat set would be taken for the unbounded strip around it.

    Parameters
    ----------
    G : ndarray (m, g)
        m <= 3.

    Returns
    -------
    directions : ndarray (k, m)
        k is 1, g + 2 or (g + 3)(g + 2)/2.

    Raises
    ------
    ValueError
        More than three dimensions; use ``template``.
    """
    m = len(G)
    if m > 3:
        raise ValueError(f"normals: {m} residuals (found), expected at most 3. Use template directions.")
    every = np.concatenate([np.eye(m), G], axis=1)
    if m == 1:
        return np.eye(1)
    if m == 2:
        return np.stack([-every[1], every[0]], axis=1)
    return np.array([np.cross(every[:, i], every[:, j]) for i, j in combinations(range(every.shape[1]), 2)])


def contains(G: Array, r: Array, directions: Array | None = None) -> bool:
    """Decide whether r lies in the set, by supports: exact with ``normals``, and never falsely no with others.

    Exact up to ``SLACK`` of what the supports are sums of, so that a point of a flat set is not lost to rounding.

    Parameters
    ----------
    G : ndarray (m, g)
    r : ndarray (m,)
        A NaN is outside.
    directions : ndarray (k, m) or None
        None: ``normals(G)``.

    Returns
    -------
    inside : bool
    """
    D = normals(G) if directions is None else directions
    return bool(np.all(np.abs(D @ r) <= support(G, D) + SLACK * _scale(D, G, r)))  # <= is false for NaN


def _scale(D: Array, G: Array, r: Array) -> Array:
    """What D r and the supports are sums of, in magnitude."""
    return np.abs(D) @ (hull(G) + np.abs(r))


def ratio(top: Array, bottom: Array) -> Array:
    """Divide sizes elementwise, with 0/0 = 0 (nothing asked of nothing) and x/0 = inf.

    Parameters
    ----------
    top, bottom : ndarray (...)

    Returns
    -------
    quotient : ndarray (...)
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(top > 0, top / bottom, 0.0)


def gauge(G: Array, r: Array, directions: Array | None = None) -> float:
    """Return the smallest t with r in t times the set; inf where no multiple of the set reaches r.

    Parameters
    ----------
    G : ndarray (m, g)
    r : ndarray (m,)
    directions : ndarray (k, m) or None
        None: ``normals(G)``, for which the value is exact; others give a lower bound.

    Returns
    -------
    t : float
    """
    D = normals(G) if directions is None else directions
    h, top = support(G, D), np.abs(D @ r)
    tiny = SLACK * _scale(D, G, r)  # a normal's product with its own generator is only rounding
    return float(np.max(ratio(np.where(top > tiny, top, 0.0), np.where(h > tiny, h, 0.0)), initial=0.0))


def best_direction(G: Array, r: Array) -> Array:
    """Return the direction d with the largest |d' r| / h(d), d' r = 1 or the gauge's normal: a fault's best test.

    Parameters
    ----------
    G : ndarray (m, g)
    r : ndarray (m,)
        Residual that the fault causes; not zero.

    Returns
    -------
    d : ndarray (m,)
        Scaled to unit Euclidean length.
    """
    if len(G) <= 3:
        D = normals(G)
        D = D[np.linalg.norm(D, axis=1) > 0]
        value = ratio(np.abs(D @ r), support(G, D))
        d = D[int(np.argmax(value))]
    else:
        from scipy.optimize import linprog  # minimise |d'G|_1 over d'r = 1, as a linear program

        m, g = G.shape
        cost = np.concatenate([np.zeros(m), np.ones(g)])
        sides = np.block([[G.T, -np.eye(g)], [-G.T, -np.eye(g)]])
        found = linprog(cost, A_ub=sides, b_ub=np.zeros(2 * g), A_eq=np.concatenate([r, np.zeros(g)])[None],
                        b_eq=[1.0], bounds=[(None, None)] * m + [(0, None)] * g)
        d = found.x[:m]
    d = d / np.linalg.norm(d)
    return d if d @ r >= 0 else -d


def template(G: Array, responses: Array) -> Array:
    """Return directions for a bounded test in any dimension: the coordinates, and the best one per fault.

    Parameters
    ----------
    G : ndarray (m, g)
        A typical residual set.
    responses : ndarray (n_f, m)
        Residual per unit of each fault; rows of zeros are passed over.

    Returns
    -------
    directions : ndarray (k, m)
        The coordinate rows first; m <= k <= m + n_f.
    """
    rows = list(np.eye(len(G)))
    for r in responses:
        if np.any(r != 0):
            d = best_direction(G, r)
            if all(np.linalg.norm(d - s) > 1e-9 and np.linalg.norm(d + s) > 1e-9 for s in rows):
                rows.append(d)
    return np.array(rows)


def fan(count: int) -> Array:
    """Return directions spread evenly over the half circle, for two residuals.

    Parameters
    ----------
    count : int

    Returns
    -------
    directions : ndarray (count, 2)
        The first is (1, 0); an even count holds (0, 1) too, exactly.
    """
    angle = np.pi * np.arange(count) / count
    D = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    D[np.abs(D) < 1e-15] = 0.0
    return D


def vertices(G: Array) -> Array:
    """Return the corners of a set in the plane, counter-clockwise.

    Parameters
    ----------
    G : ndarray (2, g)

    Returns
    -------
    points : ndarray (2 k, 2)
        k the number of generators that are not zero; parallel ones leave points on an edge.
    """
    up = np.where((G[1] < 0) | ((G[1] == 0) & (G[0] < 0)), -1.0, 1.0) * G
    up = up[:, np.any(up != 0, axis=0)]
    up = up[:, np.argsort(np.arctan2(up[1], up[0]), kind="stable")]
    first = -up.sum(axis=1, keepdims=True)  # the lowest point; every edge is twice a generator
    half = np.cumsum(np.concatenate([first, 2 * up], axis=1), axis=1)[:, :-1]
    return np.concatenate([half, -half], axis=1).T


def area(G: Array) -> float:
    """Return the area of a set in the plane, 4 sum |det(g_i, g_j)|.

    Parameters
    ----------
    G : ndarray (2, g)

    Returns
    -------
    area : float
    """
    det = G[0][:, None] * G[1][None] - G[1][:, None] * G[0][None]
    return float(2.0 * np.abs(det).sum())
