"""Boxes of a point observer: freeze, and the exact proof on the numbers of the C.

The hull of the error set obeys ``b+ <= |M| b + |F| 1 + rest`` and that of the residual ``|C| b + |V| 1 + rest``, with
the columns F, V and rests of ``sets``. Every term of the C's sums is positive, so that a computed sum of n products
and a constant is at least ``1 - (n + 1) u`` times the exact one, less what flushed numbers lose: the tables are larger
by that much. In coordinates ``x - x_hat = T z`` it is ``T^-1 M T``, ``T^-1 F``, ``T^-1 rest`` and ``C T`` instead, for
any T that has an inverse.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from ..errors import CertificateError
from .exact import Q, eye, inverse, product, rational, up
from .freeze import nearest
from .rounding import TINY, UNIT
from .set_freeze import _check_reach
from .sets import SetDemands, column

Array = np.ndarray
#: Conditions "stored >= needed": name, and what it is.
TABLES = (("P", "the size of M"), ("Pb", "the size of A"), ("g", "what a step adds to the error set"),
          ("gb", "what a step without measurement adds"), ("S", "the size of C"),
          ("rho", "the noise in the residual"), ("spread", "the bounds of x"), ("R", "the size of the coordinates"),
          ("Z", "the size of their inverse"))


class BoxDemands:
    """Smallest tables of a box.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
        Its estimate is read.
    """

    def __init__(self, modes, t):
        self.of, self.t, self.u, self.tiny = SetDemands(modes, t), t, UNIT[t.real], TINY[t.real]
        self.columns = self.of.columns()
        self.share = 1 - (len(t.box) + 1) * self.u  # of an exact sum that the computed one keeps at least

    def least(self, T: Array) -> dict[str, Array]:
        """Exact demands by the names of ``BoxTables``, for coordinates T (n_x, n_x)."""
        modes, T = range(len(self.of.modes)), rational(T)
        back = inverse(T)
        size = {name: np.array([abs(product(back, product(A, T))) for A in getattr(self.of, m)], dtype=object)
                / self.share for name, m in (("P", "M"), ("Pb", "A"))}
        size["S"] = np.array([abs(product(C, T)) for C in self.of.C], dtype=object) / self.share
        rests = {"g": [self.of.rest(q, True) for q in modes], "gb": [self.of.rest(q, False) for q in modes],
                 "rho": [self.of.residual_rest(q) for q in modes]}
        added = {}
        for name, noise, matrix, turn in (("g", "F", "P", back), ("gb", "Fb", "Pb", back), ("rho", "V", "S", None)):
            added[name] = np.array([
                [(self.spanned(self.columns[noise][q, o], rests[name][q], turn) + self.flushed(size[matrix][q], T))
                 / self.share for o in range(len(self.of.gain))] for q in modes], dtype=object)
        own = 4 * self.u * (rational(self.t.box) + 2 * rational(self.t.limit)) + 8 * self.tiny
        R, Z = abs(T) / self.share, abs(back) / self.share
        spread = (self.of.carried() * (1 + 4 * self.u) + own + self.flushed(R, T)) / self.share
        plain = np.array_equal(T, eye(len(T)))
        return {**size, **added, "spread": spread, "R": abs(T) if plain else R, "Z": abs(back) if plain else Z}

    def spanned(self, columns: Array, rest: Array, turn: Array | None) -> Array:
        """Half widths of what columns and a box of rests span, turned or not."""
        if turn is None:
            return total(columns) + rest
        return total(product(turn, columns)) + product(abs(turn), column(rest)).ravel()

    def flushed(self, size: Array, T: Array) -> Array:
        """What numbers below the normal ones may lose in a sum: products, half widths and constants read as zero."""
        lost = product(size, column([self.tiny] * size.shape[1])).ravel()
        most = max(rational(self.t.limit)) / min(max(abs(T[:, k])) for k in range(len(T)))  # of a half width
        return 2 * (lost + self.tiny * (size.shape[1] * most + 2 * size.shape[1] + 2))

    def onward(self, half: Array, q: int) -> tuple[Array, Array]:
        """Largest computed half widths after a measured step of mode q, and the part of them that was carried."""
        z, more, T = self.t.shape, 1 + (len(half) + 2) * self.u, rational(self.t.shape.T)
        carried = product(rational(z.P[q]), column(half)).ravel() * more
        return carried + (np.max(rational(z.g[q]), axis=0) + self.flushed(rational(z.P[q]), T)) * more, carried

    def steady(self, half: Array) -> str:
        """Why half widths (n_x,) are not kept and entered in every mode; empty where they are."""
        half, out = rational(half), ""
        for q, mode in enumerate(self.of.modes):
            new, carried = self.onward(half, q)
            for i in range(len(half)):
                if new[i] > half[i] or carried[i] >= half[i]:
                    out = f'mode "{mode.name}", state {i}, by {float(new[i] - half[i]):.3g}'
        return out

    def width(self, half: Array) -> Array:
        """Ultimate width of the bounds of x for steady half widths, the rounding of their sums included."""
        room = 4 * self.u * (rational(self.t.box) + rational(self.t.limit)) + 8 * self.tiny
        wide = product(rational(self.t.shape.R), column(rational(half))).ravel() * (1 + (len(half) + 2) * self.u)
        return 2 * (wide + np.max(rational(self.t.shape.spread), axis=0)) + room

    def start(self) -> Array:
        """Largest half widths of the bounds of x where the set starts from the declared range or the initial box."""
        t, more = self.t, (1 + (len(self.t.box) + 2) * self.u) ** 2
        wide = np.max([rational(getattr(t, f"{n}_hi")) - rational(getattr(t, f"{n}_lo")) for n in ("x", "x0")], axis=0)
        b = product(rational(t.shape.Z), column(wide / 2)).ravel()
        return product(rational(t.shape.R), column(b)).ravel() * more + rational(t.shape.spread)[-1]


def total(columns: Array) -> Array:
    """Row sums of absolute values, exact zeros where there are no columns."""
    return abs(columns).sum(axis=1) if columns.shape[1] else np.array([Q(0)] * len(columns), dtype=object)


def freeze_box(shape_class, modes, t, T: Array):
    """Build the tables of a box for an estimate.

    Parameters
    ----------
    shape_class : type
        ``BoxTables``.
    modes : sequence
    t : object
        Estimate of ``set_freeze.freeze_estimate``, as attributes.
    T : ndarray (n_x, n_x)
        Coordinates; the identity for the states themselves.

    Returns
    -------
    BoxTables
    """
    T = nearest(T, t.real)
    return shape_class(T=T, **{name: np.array([up(x, t.real) for x in need.ravel()], t.real).reshape(need.shape)
                               for name, need in BoxDemands(modes, t).least(T).items()})


def prove(modes, t, proof: dict) -> dict:
    """Make the certificate of the tables of a box; ``check`` accepts it.

    Parameters
    ----------
    modes : sequence
    t : PointTables
    proof : dict
        Of the gains; kept beside what is proved of the set.

    Returns
    -------
    dict

    Raises
    ------
    CertificateError
    """
    demands = BoxDemands(modes, t)
    half = steady_box(t, demands)
    cert = {**proof, "set": "box", "steady_box": None}
    if half is not None:
        width = np.array([float(x) for x in demands.width(half)]) * (1 + 1e-9)
        cert["steady_box"] = {"half": half.tolist(), "hi": (width / 2).tolist(), "lo": (width / 2).tolist(),
                              "width": width.tolist()}
    check(modes, t, cert)
    return cert


def steady_box(t, demands: BoxDemands) -> Array | None:
    """Half widths that the set enters and keeps in every mode; None where no box does it."""
    P, n = t.shape.P.astype(float), len(t.box)
    push = np.max(t.shape.g.astype(float), axis=1) * (1 + 1e-6)
    scale = np.abs(np.linalg.inv(t.shape.T.astype(float))) @ np.maximum(t.limit.astype(float), 1e-300)
    rows = np.concatenate([(m * (1 + 1e-6) - np.eye(n)) * scale / scale[:, None] for m in P])
    found = linprog(np.ones(n), A_ub=rows, b_ub=np.concatenate([-p / scale for p in push]), bounds=[(1e-9, None)] * n)
    if found.status != 0:
        return None
    half = found.x * scale * (1 + 1e-6)
    return half if not demands.steady(half) else None


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the tables of a box in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition and by how much it fails.
    """
    demands = BoxDemands(modes, t)
    least = demands.least(t.shape.T)
    for name, what in TABLES:
        stored = rational(getattr(t.shape, name))
        if stored.shape != least[name].shape:
            raise CertificateError(f"certificate: {name} has shape {stored.shape} (found), expected "
                                   f"{least[name].shape}.")
        lack = least[name] - stored
        if np.any(lack > 0):
            where = np.unravel_index(np.argmax([float(x) for x in lack.ravel()]), lack.shape)
            raise CertificateError(f"certificate: {name}{[int(i) for i in where]}, {what}, is too small by "
                                   f"{float(lack[where]):.3g}: the set could lose a residual without fault.")
    _check_reach(t)
    if t.shape.turned and np.any(demands.start() > rational(t.limit)):
        raise CertificateError("certificate: the box of the declared range in these coordinates is beyond its limit.")
    claims = ["each residual is within its bound at every sample while no fault acts, so there is no false alarm, for "
              f"any switching, rounding included ({t.real}, with or without fused multiply-add)",
              "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
              "the half widths of the error set stay below "
              f"[{', '.join(f'{x:.4g}' for x in t.limit)}]: a set that would grow beyond starts again from the "
              "declared ranges; the estimate stays in a box"]
    if cert.get("steady_box"):
        half, width = (np.array(cert["steady_box"][k]) for k in ("half", "width"))
        bad = demands.steady(half)
        if bad or np.any(rational(width) < demands.width(half)):
            raise CertificateError(f"certificate: the error set leaves its box in {bad or 'the bounds of x'}.")
        claims.append(f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], for arbitrary "
                      "switching")
    return claims
