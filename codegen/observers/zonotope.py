"""Run-time family "zonotope": a point observer whose error lies in a zonotope of bounded order.

At sample k, from estimate, generators H, input, output and mode p of sample k-1::

    1  keep the l - n_x largest columns of H, box the others                 exactly l columns
       (in coordinates z = B_p x of the mode, where a box in those of x could grow: M_p g = S_p B_p g)
    2  H = [M_p H, F_p]                                                      F: disturbance and noise of the step
    3  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    4  alarm where r is not in {[C H, V] z, |z_i| <= 1} + box(rho)
    5  keep x_hat, u, y, mode

Source: Zammali (2020), 6.2.3, Algorithms 1 and 2, as corrected in ``synthesis``. No measurement enters H. Columns are
selected by repeated maximum with a swap, by a strict > from the lowest index on: the number of compares does not
depend on data. Membership needs no linear program: |r| <= bound for one output; for two, the normals of all
generators; for three, where that many multiplications are accepted, the normals of all pairs of generators, with unit
vectors among them (a flat set would else be taken for the strip around it); else the coordinates and directions chosen
offline, which never alarm falsely.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import PointObserver, PointTables, centred, plain

Array = np.ndarray


@dataclass(frozen=True)
class ZonotopeTables:
    """The numbers of the error set; N modes, O origins (``PointTables.origins``), c columns per step.

    Parameters
    ----------
    order : int
        l >= n_x, columns after a reduction; the C holds l + c.
    key : {"squared", "girard"}
        What columns are compared by: sum of squares, or |z|_1 - |z|_inf.
    weight : ndarray (n_x,)
        Of the squares (sizes) in a column's key: powers of two that make states of different units alike.
    B, S, Sb : ndarray (N, n_x, n_x) or (0, n_x, n_x)
        Coordinates of boxes, and what takes a box back to x one step later, measured or not: M = S B, A = Sb B but for
        rounding. None: those of x.
    inside : ndarray (N, n_x) or (0, n_x)
        Rounding in these coordinates: ``e`` there, and that of B g.
    F, Fb : ndarray (N, O, n_x, c)
        Columns that a step adds, with and without its measurement.
    V : ndarray (N, O, n_y, s)
        Noise in the residual.
    e : ndarray (n_x,)
        Box beside the generators: rounding of everything.
    spread : ndarray (O, n_x)
        What the bounds of x have beyond the generators.
    rho : ndarray (N, n_y)
        Box beside the generators of the residual: rounding.
    pairs : bool
        For three outputs: membership by the normals of all pairs.
    directions : ndarray (m, n_y)
        For more than two outputs where it is not.
    slack, floor : ndarray ()
        Relative and absolute rounding of the membership test.
    """

    order: int
    key: str
    weight: Array
    B: Array
    S: Array
    Sb: Array
    inside: Array
    F: Array
    Fb: Array
    V: Array
    e: Array
    spread: Array
    rho: Array
    pairs: bool
    directions: Array
    slack: Array
    floor: Array

    @property
    def columns(self) -> int:
        """Columns of H."""
        return self.order + self.F.shape[3]

    @property
    def oblique(self) -> bool:
        """Whether boxes are in other coordinates than those of x."""
        return len(self.B) > 0

    @property
    def unprinted(self) -> set[str]:
        """Fields that the C does not hold: what reading H may lose is part of ``inside`` there."""
        return {"e"} if self.oblique else set()

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> ZonotopeTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        n, x, _, y = sizes
        origins = n + 1 if kind == "tnl" else 1
        shapes = {"weight": (x,), "B": (-1, x, x), "S": (-1, x, x), "Sb": (-1, x, x), "inside": (-1, x),
                  "F": (n, origins, x, -1), "Fb": (n, origins, x, -1), "V": (n, origins, y, -1), "e": (x,),
                  "spread": (origins, x), "rho": (n, y), "directions": (-1, y), "slack": (), "floor": ()}

        def shaped(name):
            value = np.array(data[name], dtype=np.float64)
            size = shapes[name]
            if value.size == 0:  # -1 of nothing has no meaning to numpy
                size = tuple(0 if s == -1 else s for s in size)
            return value.reshape(size).astype(real)

        return cls(order=int(data["order"]), pairs=bool(data["pairs"]), key=data["key"],
                   **{name: shaped(name) for name in shapes})


@dataclass(frozen=True)
class SetWork:
    """What the set of an observer costs in a sample, the estimate apart.

    Parameters
    ----------
    multiply, add, compare : int
        Operations of the dearest sample, which is one without a fault.
    words : int
        Numbers of the state.
    """

    multiply: int
    add: int
    compare: int
    words: int


def set_work(n_x: int, n_y: int, order: int, added: int, noises: int, directions: int = 0,
             pairs: bool = False, turned: bool = False, girard: bool = False) -> SetWork:
    """Count reduction, carrying of the generators, bounds of x and membership, as the C does them.

    Sums begin with 0, so a scalar product of n numbers takes n additions; a magnitude takes a comparison. The bounds
    of x count twice: a set beyond its limit starts again.

    Parameters
    ----------
    n_x, n_y : int
    order : int
        l >= n_x.
    added, noises : int
        Columns of F and of V.
    directions : int
        Rows of the template; read for more than two outputs.
    pairs : bool
        Membership by the normals of all pairs, for three outputs.
    turned : bool
        Boxes in other coordinates than those of x.
    girard : bool
        Columns compared by Girard's key.

    Returns
    -------
    work : SetWork
    """
    columns, kept = order + added, order - n_x
    terms = columns + noises
    crossed = (terms + 3) * (terms + 2) // 2 if pairs else 0
    rows = crossed or {1: 0, 2: terms}.get(n_y, directions)
    each = rows * (n_y * terms + 2 * n_y) + n_y * bool(rows)
    multiply = 6 * crossed + 2 * n_x * columns + n_x * n_x * (kept + 1) + n_y * n_x * columns + n_y + each
    add = (3 * crossed + n_x * columns + n_x * (columns - kept) + n_x * n_x * kept + 2 * n_x * columns
           + n_y * n_x * columns + n_y * (terms + 1) + each + rows * terms)
    compare = (kept * columns - kept * (kept + 1) // 2 + n_x * (columns - kept) + 2 * n_x * (columns + 1)
               + n_y * (terms + 2) + rows * (terms + n_y + 2))
    if turned:  # every column for its key, those that are boxed once more
        multiply += n_x * n_x * (2 * columns - kept)
        add += n_x * n_x * (2 * columns - kept)
    if girard:  # weight times magnitude, the largest taken off the sum
        multiply, add, compare = multiply - n_x * columns, add + columns, compare + 2 * n_x * columns
    return SetWork(multiply, add, compare, n_x * columns)


def keys(z: ZonotopeTables, Z: Array) -> Array:
    """What columns (S, n_x, g) are compared by, (S, g); sums in ascending order of the states."""
    if z.key == "squared":
        key = z.weight[0] * (Z[:, 0] * Z[:, 0])
        for i in range(1, Z.shape[1]):
            key = key + z.weight[i] * (Z[:, i] * Z[:, i])
        return key
    key = most = z.weight[0] * np.abs(Z[:, 0])
    for i in range(1, Z.shape[1]):
        size = z.weight[i] * np.abs(Z[:, i])
        key, most = key + size, np.where(size > most, size, most)
    return key - most


def reduced(z: ZonotopeTables, H: Array, p: Array | None = None) -> tuple[Array, Array]:
    """Keep the l - n_x columns with the largest keys; box the others.

    Parameters
    ----------
    H : ndarray (S, n_x, l + c)
    p : ndarray (S,) int or None
        Modes of the step that follows; read where boxes are in other coordinates.

    Returns
    -------
    kept : ndarray (S, n_x, l - n_x), box : ndarray (S, n_x)
    """
    runs, n_x, columns = H.shape
    H, rows = H.copy(), np.arange(runs)
    Z = times(z.B[p], H) if z.oblique else H
    key, kept = keys(z, Z), z.order - n_x
    for j in range(kept):
        best = j + np.argmax(key[:, j:], axis=1)  # the first of the largest, as a strict > finds it
        for array in (H.swapaxes(1, 2), key) + (Z.swapaxes(1, 2),) * z.oblique:
            first, chosen = array[:, j].copy(), array[rows, best].copy()
            array[rows, best], array[:, j] = first, chosen
    box = z.inside[p] if z.oblique else np.broadcast_to(z.e, (runs, n_x))
    for j in range(kept, columns):
        box = box + np.abs(Z[:, :, j])
    return H[:, :, :kept], box


def times(M: Array, H: Array) -> Array:
    """Return M H, each product and sum rounded, states in ascending order: (S, r, n), (S, n, g) -> (S, r, g)."""
    total = M[:, :, 0, None] * H[:, None, 0]
    for i in range(1, M.shape[2]):
        total = total + M[:, :, i, None] * H[:, None, i]
    return total


class ZonotopeObserver(PointObserver):
    """The observer with a zonotope; see ``Runner`` for the calls."""

    family = "zonotope"
    shape_class = ZonotopeTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Estimate and generators of another initial box; see ``Runner.initial``."""
        ends = [record["ranges"][f"x0_{side}"] if x0 is None else x0 for side, x0 in (("lo", x0_lo), ("hi", x0_hi))]
        if x0_lo is None and x0_hi is None:
            return [None, None]
        centre, half = (np.broadcast_to(a, shape) for a in centred(*ends, dtype))
        columns = next(count for name, _, count in record["state"] if name == "shape") // shape[1]
        H = np.zeros((shape[0], columns, shape[1]), dtype=dtype)
        diagonal = np.arange(shape[1])
        H[:, diagonal, diagonal] = half
        return [np.ascontiguousarray(centre), H]

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """The set of a box: half widths (S, n_x) -> generators (S, n_x, l + c)."""
        H = np.zeros((*half.shape, t.shape.columns), dtype=t.dtype)
        diagonal = np.arange(half.shape[1])
        H[:, diagonal, diagonal] = half
        return H

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, H: Array, measured: bool) -> Array:
        """The set one step of the modes p later."""
        z, M = t.shape, (t.M if measured else t.A)[p]
        kept, box = reduced(z, H, p)
        back = (z.S if measured else z.Sb)[p] if z.oblique else M
        fresh = (z.F if measured else z.Fb)[p, np.minimum(origin, t.origins - 1)]
        return np.concatenate([times(M, kept), back * box[:, None, :], fresh], axis=2)

    def radius(self, t: PointTables, q: Array, origin: Array, H: Array) -> Array:
        """Half widths of the bounds of x."""
        total = t.shape.spread[origin]
        for j in range(H.shape[2]):
            total = total + np.abs(H[:, :, j])
        return total

    def judged(self, t: PointTables, q: Array, origin: Array, H: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and what is outside: a bit per output and, with several, one for the set."""
        z = t.shape
        R = np.concatenate([times(t.C[q], H), z.V[q, origin]], axis=2)
        rho = z.rho[q]
        reach = rho
        for j in range(R.shape[2]):
            reach = reach + np.abs(R[:, :, j])
        bound = reach + z.slack * reach
        raw = ~(np.abs(r) <= bound)
        if r.shape[1] == 1:
            return bound, raw
        margin = rho + z.slack * bound
        if r.shape[1] == 2:
            D = np.stack([-R[:, 1], R[:, 0]], axis=2)  # normals of the generators
        elif z.pairs:
            D = crossed(R)
        else:
            D = np.broadcast_to(z.directions, (len(r), *z.directions.shape))
        value, least = D[:, :, 0] * r[:, 0, None], z.floor + np.abs(D[:, :, 0]) * margin[:, 0, None]
        for i in range(1, r.shape[1]):
            value = value + D[:, :, i] * r[:, i, None]
            least = least + np.abs(D[:, :, i]) * margin[:, i, None]
        for j in range(R.shape[2]):
            along = D[:, :, 0] * R[:, 0, j, None]
            for i in range(1, r.shape[1]):
                along = along + D[:, :, i] * R[:, i, j, None]
            least = least + np.abs(along)
        return bound, np.concatenate([raw, ~(np.abs(value) <= least).all(axis=1)[:, None]], axis=1)


def crossed(R: Array) -> Array:
    """Normals of all pairs of generators and unit vectors of three residuals: (S, 3, g) -> (S, k, 3)."""
    unit = np.broadcast_to(np.eye(3, dtype=R.dtype), (len(R), 3, 3))
    a, b = (np.concatenate([R, unit], axis=2)[:, :, at] for at in np.triu_indices(R.shape[2] + 3, 1))
    return np.stack([a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1], a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
                     a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], axis=2)
