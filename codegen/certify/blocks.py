"""Tables of blocks on the numbers of the C: what scalars, noise and the box beside the set must be at least.

The recursion is that of ``thresholds``; ``block_bounds`` says what rounded rows, powers and columns lack of it for any
H whose row sums stay below a limit, and the firmware starts anew where they do not. On top comes the rounding of the
firmware's own sums, per term of each, with and without fused multiply-add.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.optimize import linprog

from ..errors import CertificateError
from .block_bounds import block_needs
from .exact import Q, product, rational, up
from .rounding import TINY, UNIT
from .sets import column
from .thresholds import check_middle, directions_of, recursion, starts

Array = np.ndarray
#: What is left over when demands are rounded up, and the names of what is frozen so.
ROOM, NAMES = Q(1 + 1e-6), ("scalars", "noise", "e")


class BlockDemands:
    """Least values of a table's scalars, noise and box, for given rows, powers, columns and limits.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
        Its estimate is read.
    z : BlockTables
    """

    def __init__(self, modes, t, z):
        self.z, self.u, self.tiny = z, UNIT[t.real], TINY[t.real]
        self.n, self.m, self.n_y = len(t.box), len(z.directions), t.C.shape[1]
        self.count = z.order
        # The row sums are compared as the firmware adds them up.
        self.most = rational(z.most) * (1 + 4 * (self.count + 4) * self.u) + 8 * self.count * self.tiny
        table = SimpleNamespace(directions=directions_of(t, z.directions.astype(float)),
                                **{k: getattr(z, k).astype(float) for k in ("rows", "scalars", "noise", "powers",
                                                                            "pushed")})
        self.needs = block_needs(recursion(modes, t), table, np.array([up(x) for x in self.most]))

    def _along(self, rows: Array, columns: int) -> Array:
        """Rounding of rows times H, summed over the columns."""
        n = rows.shape[-1]
        return (n + 1) * self.u * self._reach(rows) * (1 + 4 * n * self.u) + 2 * n * columns * self.tiny

    def _reach(self, rows: Array) -> Array:
        return product(abs(rational(rows)), column(self.most)).ravel()

    def _chain(self, terms: int, size: Array) -> Array:
        """Rounding of a sum of so many magnitudes, ``size`` in total."""
        return terms * (self.u * size * (1 + 4 * terms * self.u) + self.tiny)

    def _compared(self, bounds: Array) -> Array:
        """Rounding of d' r where no |r_i| is beyond its bound; a coordinate is compared as it is."""
        size = abs(rational(self.z.directions))
        slip = (self.n_y + 3) * self.u * product(size, column(bounds)).ravel() + 4 * self.n_y * self.tiny
        return np.where((size > 0).sum(axis=1) > 1, slip, Q(0))

    def scalars(self) -> Array:
        """Least scalars (O, N, J + 1, d); those of directions that are no coordinates hold the rounding of d' r too."""
        z, out = self.z, rational(self.needs.scalars)
        noise, given = np.max(rational(z.noise).reshape(-1, z.noise.shape[2]), axis=0), rational(z.scalars)
        ends = np.array([Q(0)] * self.m + [2 * self.u * Q(w) + 2 * self.tiny for w in z.wide], dtype=object)
        for q, j in np.ndindex(*z.rows.shape[:2]):
            rows = z.rows[q, j]
            along, reach = self._along(rows, self.count), self._reach(rows)
            for o in range(len(out)):
                size = reach * (1 + 2 * self.n * self.u) + noise + given[o, q, j]
                out[o, q, j] += along + self._chain(self.count + 4, size) + ends
                out[o, q, j, :self.m] += self._compared(size[:self.n_y])
        return out

    def noise(self) -> Array:
        """Least noise (O, N, d)."""
        return rational(self.needs.noise)

    def e(self) -> Array:
        """Least box beside the set (n_x,), over all blocks."""
        z, out, e = self.z, None, rational(self.z.e)
        for q, j in np.ndindex(*z.powers.shape[:2]):
            carry, reach = self._along(z.powers[q, j], self.count), self._reach(z.powers[q, j])
            for o in range(len(z.pushed)):
                size = reach * (1 + 2 * self.n * self.u) + abs(rational(z.pushed[o, q, j])).sum(axis=1) + e
                columns = self.count + z.pushed.shape[4]
                here = rational(self.needs.boxes[o, q, j]) + carry + self._chain(columns + 2, size)
                out = here if out is None else np.maximum(out, here)
        return out

    def steady(self, half: Array) -> bool:
        """Whether the row sums of |H| enter and keep half widths (n_x,) at the end of every block."""
        return bool(np.all(self.left(half) >= 0))

    def left(self, half: Array) -> Array:
        """What half widths (n_x,) have beyond the row sums at the end of any block; below 0 where they are not kept."""
        half, z, least = rational(half), self.z, None
        for q, j in np.ndindex(*z.powers.shape[:2]):
            power = abs(rational(z.powers[q, j]))
            kept = product(power, column(half)).ravel()
            push = max_of(abs(rational(z.pushed[:, q, j])).sum(axis=2))
            rest = rational(z.e) + self._along(z.powers[q, j], self.count)
            here = half - (kept + push + rest) * (1 + 4 * (self.count + 8) * self.u)
            here = np.where(kept < half, here, Q(-1))
            least = here if least is None else np.minimum(least, here)
        return least

    def settled(self, half: Array) -> Array:
        """Bounds in all directions (d,) that no block exceeds whose H has row sums below half widths (n_x,)."""
        z, half = self.z, rational(half)
        noise = np.max(rational(z.noise).reshape(-1, z.noise.shape[2]), axis=0)
        out = [product(abs(rational(z.rows[q, j])), column(half)).ravel() + max_of(rational(z.scalars[:, q, j]))
               for q, j in np.ndindex(*z.rows.shape[:2]) if j]  # none has gone by only at a start
        return (max_of(np.array(out, dtype=object)) + noise) * (1 + 4 * (self.count + self.n + 8) * self.u)


def max_of(x: Array) -> Array:
    """Largest values over the first axis."""
    return np.max(x, axis=0)


def freeze_blocks(shape_class, modes, t, table, order: int, most: Array):
    """Round a table and find what covers its rounding.

    Parameters
    ----------
    shape_class : type
        ``BlockTables``.
    modes : sequence
        The plant's modes.
    t : SimpleNamespace
        The estimate's tables.
    table : BlockTable
        Its directions are those of residual and state together.
    order : int
    most : ndarray (n_x,)
        Row sums of |H| to be expected.

    Returns
    -------
    BlockTables
    """
    real, n_x, n_y = t.real, len(t.box), t.C.shape[1]
    near = {k: getattr(table, k).astype(real) for k in ("rows", "scalars", "noise", "powers", "pushed")}
    origins = t.C.shape[0] + 1 if t.kind == "tnl" else 1
    for name in ("scalars", "noise", "pushed"):
        near[name] = np.broadcast_to(near[name], (origins, *near[name].shape[1:])).copy()
    start, anywhere = ([up(Q(x), real) for x in np.diag(G)] for G in starts(t))
    most = [up(Q(max(a, 1.01 * b)), real) for a, b in zip(most, anywhere)]
    scale = 2.0 ** -np.round(2 * np.log2(np.maximum(most, 1e-30)))
    wide = 1.01 * (np.einsum("qjdx,x->qjd", np.abs(near["rows"][:, :, -n_x:]).astype(float), most).max(axis=(0, 1))
                   + near["scalars"][..., -n_x:].max(axis=(0, 1, 2)) + near["noise"][..., -n_x:].max(axis=(0, 1)))
    given = {"order": order, "weight": scale / scale.max(), "directions": table.directions[:-n_x, :n_y],
             "e": np.zeros(n_x), "start": start, "anywhere": anywhere, "most": most, "wide": wide, **near}
    given = {k: v if k == "order" else np.array(v, dtype=real) for k, v in given.items()}
    for _ in range(3):  # scalars and e enter their own rounding, by parts in a million
        demands = BlockDemands(modes, t, shape_class(**given))
        given |= {k: _raised(getattr(demands, k)(), real) for k in NAMES}
    return shape_class(**given)


def _raised(needed: Array, real: str) -> Array:
    flat = [up(x * ROOM, real) for x in needed.ravel()]
    return np.array(flat, dtype=real).reshape(needed.shape)


def certificate(modes, t, proof: dict) -> dict:
    """What ``check`` needs beside the tables: half widths that the set enters and keeps, if there are any."""
    z, demands, half = t.shape, BlockDemands(modes, t, t.shape), None
    P, n = np.abs(z.powers.astype(float)), len(t.box)
    push = np.abs(z.pushed.astype(float)).sum(axis=4).max(axis=0) + z.e
    push = push + np.array([[[float(x) for x in demands._along(A, z.order)] for A in mode] for mode in z.powers])
    scale = z.most.astype(float)
    rows = np.concatenate([(A * (1 + 1e-4) - np.eye(n)) * scale / scale[:, None] for mode in P for A in mode])
    demand = np.concatenate([-b * (1 + 1e-4) / scale for mode in push for b in mode])
    found = linprog(np.ones(n), A_ub=rows, b_ub=demand, bounds=[(1e-12, None)] * n)
    if found.status == 0 and demands.steady(found.x * scale * (1 + 1e-6)):
        half = found.x * scale * (1 + 1e-6)
    steady = None
    if half is not None:
        width = np.array([up(2 * x) for x in demands.settled(half)[len(z.directions):]]) * (1 + 1e-9)
        half, hi = half.tolist(), (width / 2).tolist()
        steady = {"half": half, "width": width.tolist(), "hi": hi, "lo": hi}
    return {**proof, "set": "blocks", "steady_box": steady}


def first_room(t) -> dict[str, Array]:
    """What the boxes of the first errors have beyond these, and the limit beyond the boxes; exact, not negative."""
    out = {}
    for half, name in zip(starts(t), ("start", "anywhere")):
        held = rational(getattr(t.shape, name))
        out[name] = np.minimum(held - rational(np.diag(half)), rational(t.shape.most) - held)
    return out


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the certificate of tables of blocks; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming what is too small, where and by how much.
    """
    z, n_x, n_y, (N, J, d) = t.shape, len(t.box), t.C.shape[1], t.shape.rows.shape[:3]
    origins = t.origins
    shapes = {"rows": (N, J, d, n_x), "scalars": (origins, N, J, d), "noise": (origins, N, d),
              "powers": (N, J - 1, n_x, n_x)}
    wrong = [k for k, s in shapes.items() if getattr(z, k).shape != s]
    if wrong or z.pushed.shape[:4] != (origins, N, J - 1, n_x) or d != len(z.directions) + n_x or z.order <= n_x:
        raise CertificateError(f"certificate: sizes of the tables of blocks do not agree (found {wrong or 'pushed'}), "
                               "expected one entry per origin, mode, sample and direction.")
    if not np.array_equal(z.directions[:n_y], np.eye(n_y)):
        raise CertificateError("certificate: the first directions are not the coordinates of the residual.")
    if np.any(np.ptp(t.C, axis=0)):
        raise CertificateError("certificate: C differs between modes (found), expected the same in all.")
    demands = BlockDemands(modes, t, z)
    for name in NAMES:
        lack = np.asarray(getattr(demands, name)() - rational(getattr(z, name)), dtype=object)
        if np.any(lack > 0):
            where = np.unravel_index(np.argmax([float(x) for x in lack.ravel()]), lack.shape)
            raise CertificateError(f"certificate: {name}{[int(i) for i in where]} of the blocks is too small by "
                                   f"{float(lack[where]):.3g}: the set could lose a residual without fault.")
    for name, left in first_room(t).items():
        if np.any(left < 0):
            raise CertificateError(f"certificate: {name} does not hold the first errors, or is beyond the limit.")
    check_middle(t)
    claims = ["the residual lies in its set at every sample while no fault acts, so there is no false alarm, for any "
              f"switching, rounding included ({t.real}, with or without fused multiply-add)",
              "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
              f"the row sums of the {z.order} generators stay below [{', '.join(f'{x:.4g}' for x in z.most)}]: a set "
              "that would grow beyond starts again from every error that is possible; the estimate stays in a box; the "
              f"set is carried on at a switch or every {J - 1} samples by tables of {z.words} numbers "
              f"({z.words * z.rows.itemsize} bytes of flash)"]
    if cert.get("steady_box"):
        half, width = np.array(cert["steady_box"]["half"]), np.array(cert["steady_box"]["width"])
        if not demands.steady(half) or np.any(rational(width) < 2 * demands.settled(half)[len(z.directions):]):
            raise CertificateError("certificate: the hull of the error set leaves its box, or x its bounds.")
        claims.append(f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], for arbitrary "
                      "switching")
    return claims
