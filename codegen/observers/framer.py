"""Tables and arithmetic of the interval family: what the C computes, operation by operation.

An interval observer carries two framers, ``x_lo <= x <= x_hi``. In mode q both obey the same recursion

    x_hi+ = M x_hi + (G u + L y + N y+) + d_hi,      x_lo+ = M x_lo + (G u + L y + N y+) + d_lo,

with ``M >= 0`` elementwise, N = 0 for the classical observer. ``d_hi``/``d_lo`` hold the worst case of
disturbance, noise *and rounding*, so the two lines are sound in floating point.

A plant with parameters or bounded unknowns has a ``Variation`` beside the tables: M, G and L then are affine in the
measured parameters theta, and both framers move apart by a radius that grows with the state::

    radius = R max(-x_lo, x_hi) + S |u| + |L(theta)| E

A table may multiply out products of parameters (``products``: further entries of theta), and let a part of R and S
shrink with how far a parameter moved over the step (``paced``: R + sum_j g_j R_pace_j with ``g = max(top - (change *
pace)^2, 0)``).

Such tables may have negative constants in M (method "component-interval"): each takes the opposite bound of x. With
``change`` beside them the recursion is that of z = Z x: M takes the bounds of z, the radii still those of x.

Every function here repeats the C's operations in the C's order and precision: a sum starts with the
input terms, then the outputs, then the offset, then the state; products are rounded before they are
added. Terms with coefficient zero, which the C leaves out, change no value. The arrays have a leading
axis of S independent runs, so that a test can drive many at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from itertools import product

import numpy as np

from ..algebra.interval import with_products
from .coordinates import Coordinates

Array = np.ndarray


@dataclass(frozen=True)
class Variation:
    """What depends on the parameters, and what is only bounded.

    Parameters
    ----------
    theta_lo, theta_hi : ndarray (N, J)
        What the check of the measured parameters accepts in each mode.
    columns : tuple of int
        Which of the plant's parameters are measured, in the order of the firmware's inputs.
    midpoint : bool
        The step takes the mean of theta at both its ends (a sampled plant), else theta at its start.
    late : bool
        The mode that is told may be one sample late: where it has changed since the last sample, the bounds of both
        modes are joined.
    M, G, L : ndarray (N, J, n_x, n_x), (N, J, n_x, n_u), (N, J, n_x, n_y)
        Slopes in theta; the same for both framers.
    R : ndarray (N, n_x, n_x), S : ndarray (N, n_x, n_u)
        Bounds of the unknown part, >= 0.
    E : ndarray (N, n_x, n_y)
        Largest noise in each output where the gain on it depends on theta, else 0.
    Ra : ndarray (N, n_x, n_x), Sa : ndarray (N, n_x, n_u)
        As R, S for the open-loop prediction.
    products : tuple of (int, int)
        Pairs of measured parameters whose products count as parameters behind them; M and G have slopes in them, too.
    paced : tuple of int
        Measured parameters j whose change over a step tells how far their mean may have been off.
    pace, top : ndarray (len(paced),)
        Factor on the change, and what the square is taken from.
    R_pace, S_pace : ndarray (N, len(paced), n_x, n_x), (N, len(paced), n_x, n_u)
        What is added to R and S times g_j.
    """

    theta_lo: Array
    theta_hi: Array
    columns: tuple[int, ...]
    midpoint: bool
    late: bool
    M: Array
    G: Array
    L: Array
    R: Array
    S: Array
    E: Array
    Ra: Array
    Sa: Array
    products: tuple[tuple[int, int], ...] = ()
    paced: tuple[int, ...] = ()
    pace: Array | None = None
    top: Array | None = None
    R_pace: Array | None = None
    S_pace: Array | None = None

    @property
    def parameters(self) -> int:
        """Number of measured parameters."""
        return self.theta_lo.shape[1]

    def to_dict(self) -> dict:
        """Return plain lists for design.json."""
        out = {f.name: value.astype(np.float64).tolist() if isinstance(value := getattr(self, f.name), np.ndarray)
               else [list(x) if isinstance(x, tuple) else x for x in value] if isinstance(value, tuple) else value
               for f in fields(self)}
        optional = [] if self.products else ["products"]
        optional += [] if self.paced else ["paced", "pace", "top", "R_pace", "S_pace"]
        return {k: v for k, v in out.items() if k not in optional}

    def read(self, theta: Array) -> Array:
        """Take the measured columns out of theta (..., n_theta); (..., J) is returned as it is."""
        return theta[..., list(self.columns)] if theta.shape[-1] > self.parameters else theta

    def multiplied(self, theta: Array) -> Array:
        """Return theta (S, J) with the products behind it, each rounded once."""
        return np.hstack([theta, *(theta[:, j, None] * theta[:, k, None] for j, k in self.products)])

    def corners(self, q: int) -> Array:
        """Corners of the box of theta and of its products in mode q, float64 (2^n, n)."""
        box = list(zip(*with_products(self.theta_lo[q].astype(float), self.theta_hi[q].astype(float), self.products)))
        return np.array(list(product(*box)), dtype=float).reshape(2 ** len(box), len(box))

    def slack(self, change: Array) -> Array:
        """Factors g (S, len(paced)) for the change of theta over the step (S, J), operation by operation."""
        scaled = change[:, list(self.paced)] * self.pace
        g = self.top - scaled * scaled
        return np.where(g > 0, g, np.zeros_like(g))

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int], real: str) -> Variation:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        n, x, u, y = sizes
        J, products = np.array(data["theta_lo"]).reshape(n, -1).shape[1], tuple(map(tuple, data.get("products", ())))
        K, P, paced = J + len(products), len(data.get("paced", ())), tuple(data.get("paced", ()))
        shapes = {"theta_lo": (n, J), "theta_hi": (n, J), "M": (n, K, x, x), "G": (n, K, x, u), "L": (n, J, x, y),
                  "R": (n, x, x), "S": (n, x, u), "E": (n, x, y), "Ra": (n, x, x), "Sa": (n, x, u)}
        shapes |= {"pace": (P,), "top": (P,), "R_pace": (n, P, x, x), "S_pace": (n, P, x, u)} if paced else {}
        return cls(midpoint=bool(data["midpoint"]), late=bool(data["late"]), columns=tuple(data["columns"]),
                   products=products, paced=paced, **{
                       k: np.array(data[k], dtype=np.float64).reshape(s).astype(real) for k, s in shapes.items()})


@dataclass(frozen=True)
class FramerTables:
    """The numbers that the C holds, exactly (dtype float32 or float64); N modes on the first axis.

    Parameters
    ----------
    real : {"float32", "float64"}
    M_hi, M_lo : ndarray (N, n_x, n_x)
        T A - L C of the upper and lower framer, >= 0 elementwise.
    G_hi, G_lo : ndarray (N, n_x, n_u)
        T B - L D.
    L_hi, L_lo, N_hi, N_lo : ndarray (N, n_x, n_y)
    d_hi, d_lo : ndarray (N, n_x)
        Offsets: worst case of w and v, plus what rounding can take away.
    A : ndarray (N, n_x, n_x), B : ndarray (N, n_x, n_u)
        Open-loop prediction, for a sample whose measurement is missing.
    a_hi, a_lo : ndarray (N, n_x)
        Its offsets.
    C : ndarray (N, n_y, n_x), D : ndarray (N, n_y, n_u), c_hi, c_lo : ndarray (N, n_y)
        Output framers.
    x_lo, x_hi, x0_lo, x0_hi, box : ndarray (n_x,)
        Declared range, initial box, and the bound on the magnitude of both framers behind the margins.
    u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    clamp : bool
        The framers are cut to the declared range after each update (where no invariant box exists).
    vary : Variation or None
        None: constant matrices per mode.
    change : Coordinates or None
        None: no change of coordinates. Else M, G, L, d, R, S are those of z = Z x, all others those of x.
    """

    real: str
    M_hi: Array
    M_lo: Array
    G_hi: Array
    G_lo: Array
    L_hi: Array
    L_lo: Array
    N_hi: Array
    N_lo: Array
    d_hi: Array
    d_lo: Array
    A: Array
    B: Array
    a_hi: Array
    a_lo: Array
    C: Array
    D: Array
    c_hi: Array
    c_lo: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    box: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    clamp: bool
    vary: Variation | None = field(default=None, metadata={"type": Variation})
    change: Coordinates | None = field(default=None, metadata={"type": Coordinates})

    @property
    def flipped(self) -> Array:
        """Where M takes the opposite bound: negative entries that no mode schedules; (N, n_x, n_x)."""
        if self.vary is None:
            return np.zeros(self.M_hi.shape, dtype=bool)
        return (self.M_hi < 0) & ~np.any(self.vary.M != 0, axis=(0, 1))

    @property
    def signed(self) -> bool:
        """Whether M has entries that take the opposite bound."""
        return bool(np.any(self.flipped))

    @property
    def shared(self) -> bool:
        """Both framers have the same gains, so the C computes their common part once."""
        pairs = ((self.M_hi, self.M_lo), (self.G_hi, self.G_lo), (self.L_hi, self.L_lo), (self.N_hi, self.N_lo))
        return all(np.array_equal(a, b) for a, b in pairs)

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        out = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("vary", "change"):
                out |= {} if value is None else {f.name: value.to_dict()}
                continue
            out[f.name] = value.astype(np.float64).tolist() if isinstance(value, np.ndarray) else value
        return out

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> FramerTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y), needed where n_u is 0."""
        n, x, u, y = sizes
        shapes = {"M_hi": (n, x, x), "M_lo": (n, x, x), "G_hi": (n, x, u), "G_lo": (n, x, u),
                  "L_hi": (n, x, y), "L_lo": (n, x, y), "N_hi": (n, x, y), "N_lo": (n, x, y),
                  "d_hi": (n, x), "d_lo": (n, x), "A": (n, x, x), "B": (n, x, u), "a_hi": (n, x),
                  "a_lo": (n, x), "C": (n, y, x), "D": (n, y, u), "c_hi": (n, y), "c_lo": (n, y),
                  "x_lo": (x,), "x_hi": (x,), "x0_lo": (x,), "x0_hi": (x,), "box": (x,),
                  "u_lo": (u,), "u_hi": (u,), "y_lo": (y,), "y_hi": (y,)}
        dtype = np.dtype(data["real"])
        arrays = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(dtype) for k, s in shapes.items()}
        vary = Variation.from_dict(data["vary"], sizes, data["real"]) if "vary" in data else None
        change = Coordinates.from_dict(data["change"], data["real"]) if "change" in data else None
        return cls(real=data["real"], clamp=bool(data["clamp"]), vary=vary, change=change, **arrays)


def add_terms(total: Array, matrix: Array, vector: Array) -> Array:
    """Add ``matrix @ vector`` to ``total`` one column after the other, each product and sum rounded.

    Shapes: total (S, r), matrix (S, r, c), vector (S, c).
    """
    for j in range(matrix.shape[2]):
        total = total + matrix[:, :, j] * vector[:, j, None]
    return total


def scheduled(base: Array, slopes: Array, theta: Array) -> Array:
    """Evaluate ``base + theta_1 slopes_1 + ...``, each product and sum rounded.

    Shapes: base (S, r, c), slopes (S, J, r, c), theta (S, J).
    """
    for j in range(slopes.shape[1]):
        base = base + theta[:, j, None, None] * slopes[:, j]
    return base


def propagate(t: FramerTables, q: Array, x_lo: Array, x_hi: Array, u: Array, y: Array, y_next: Array,
              theta: Array | None = None, z: tuple[Array, Array] | None = None, change: Array | None = None):
    """One step of both framers from sample k to k+1 with the mode q of sample k.

    Parameters
    ----------
    q : ndarray (S,) int
    x_lo, x_hi : ndarray (S, n_x)
    u : ndarray (S, n_u)
    y, y_next : ndarray (S, n_y)
        y at k, and y at k+1 (multiplied by N; pass zeros for the classical observer).
    theta : ndarray (S, J)
        Measured parameters of the step; (S, 0) or nothing where the tables are constant.
    z : (ndarray (S, n_x), ndarray (S, n_x))
        Both framers of z, where the tables change coordinates; those of the next sample are returned.
    change : ndarray (S, J)
        Change of theta over the step, where the tables are paced.

    Returns
    -------
    lo, hi : ndarray (S, n_x)
    """
    zero = np.zeros_like(x_lo)
    lo, hi = (x_lo, x_hi) if z is None else z
    sides = []
    with_products = theta if t.vary is None else t.vary.multiplied(theta)
    for M, G, L, N, d, own, other in ((t.M_lo, t.G_lo, t.L_lo, t.N_lo, t.d_lo, lo, hi),
                                      (t.M_hi, t.G_hi, t.L_hi, t.N_hi, t.d_hi, hi, lo)):
        M, G, L = M[q], G[q], L[q]
        if t.vary is not None:
            M, G = (scheduled(a, b[q], with_products) for a, b in ((M, t.vary.M), (G, t.vary.G)))
            L = scheduled(L, t.vary.L[q], theta)
        common = add_terms(zero, G, u)
        common = add_terms(common, L, y)
        common = add_terms(common, N[q], y_next)
        sides.append(add_chosen_terms(common + d[q], M, t.flipped[q], own, other))
    lo, hi = sides
    if t.vary is not None:
        R, S = t.vary.R[q], t.vary.S[q]
        if t.vary.paced:
            g = t.vary.slack(change)
            R, S = scheduled(R, t.vary.R_pace[q], g), scheduled(S, t.vary.S_pace[q], g)
        apart = spread(R, S, x_lo, x_hi, u)
        for j in range(L.shape[2]):
            apart = apart + np.abs(L[:, :, j]) * t.vary.E[q][:, :, j]
        lo, hi = lo - apart, hi + apart
    if z is not None:
        return cut(t.change, lo, hi, "z")
    return cut(t, lo, hi) if t.clamp else (lo, hi)


def to_z(c: Coordinates, x_lo: Array, x_hi: Array):
    """Return both framers of z = Z x for those of x (S, n_x)."""
    Z = np.broadcast_to(c.Z, (len(x_lo), *c.Z.shape))
    zero = np.zeros_like(x_lo)
    return cut(c, add_signed_terms(zero + c.e_lo, Z, x_hi, x_lo), add_signed_terms(zero + c.e_hi, Z, x_lo, x_hi), "z")


def to_x(t: FramerTables, z_lo: Array, z_hi: Array):
    """Return both framers of x for those of z (S, n_x), cut to the declared range."""
    c, zero = t.change, np.zeros_like(z_lo)
    X = np.broadcast_to(c.X, (len(z_lo), *c.X.shape))
    return cut(t, add_signed_terms(zero + c.b_lo, X, z_hi, z_lo), add_signed_terms(zero + c.b_hi, X, z_lo, z_hi))


def spread(R: Array, S: Array, x_lo: Array, x_hi: Array, u: Array) -> Array:
    """Return ``R max(-x_lo, x_hi) + S |u|``: how far the unknown part can move each state."""
    return add_terms(add_terms(np.zeros_like(x_lo), R, np.maximum(-x_lo, x_hi)), S, np.abs(u))


def add_chosen_terms(total: Array, matrix: Array, flipped: Array, own: Array, other: Array) -> Array:
    """Add ``matrix @ own`` column by column, with ``other`` where ``flipped`` (S, r, c) says so."""
    if not flipped.any():
        return add_terms(total, matrix, own)
    for j in range(matrix.shape[2]):
        total = total + matrix[:, :, j] * np.where(flipped[:, :, j], other[:, j, None], own[:, j, None])
    return total


def add_signed_terms(total: Array, matrix: Array, below: Array, above: Array) -> Array:
    """Add ``pos(matrix) @ above - neg(matrix) @ below`` column by column (interval product, one bound)."""
    return add_chosen_terms(total, matrix, matrix < 0, above, below)


def open_loop(t: FramerTables, q: Array, x_lo: Array, x_hi: Array, u: Array):
    """Predict without a measurement: x+ = A x + B u + Bw w over the box, cut to the declared range.

    Returns
    -------
    lo, hi : ndarray (S, n_x)
    """
    common = add_terms(np.zeros_like(x_lo), t.B[q], u)
    lo = add_signed_terms(common + t.a_lo[q], t.A[q], x_hi, x_lo)
    hi = add_signed_terms(common + t.a_hi[q], t.A[q], x_lo, x_hi)
    if t.vary is not None:
        apart = spread(t.vary.Ra[q], t.vary.Sa[q], x_lo, x_hi, u)
        lo, hi = lo - apart, hi + apart
    return cut(t, lo, hi)


def cut(t, lo: Array, hi: Array, of: str = "x"):
    """Cut both framers to the declared range (sound as long as the state is in it), of x or of z."""
    least, most = getattr(t, f"{of}_lo"), getattr(t, f"{of}_hi")

    def clip(x):
        x = np.where(x < least, least, x)
        return np.where(x > most, most, x)
    return clip(lo), clip(hi)


def residuals(t: FramerTables, q: Array, x_lo: Array, x_hi: Array, u: Array, y: Array):
    """Residual bounds r_lo = y_lo - y and r_hi = y_hi - y; a fault is proved where r_lo > 0 or r_hi < 0.

    Returns
    -------
    r_lo, r_hi : ndarray (S, n_y)
    """
    common = add_terms(np.zeros_like(y), t.D[q], u)
    lo = add_signed_terms(common + t.c_lo[q], t.C[q], x_hi, x_lo) - y
    hi = add_signed_terms(common + t.c_hi[q], t.C[q], x_lo, x_hi) - y
    return lo, hi
