"""Run-time family "box": a point observer whose error lies in a box, the interval residual set.

At sample k, from estimate, half widths b, input, output and mode p of sample k-1::

    1  b = P_p b + g_p                                     P >= |M|; g: disturbance, noise and rounding of the step
    2  x_hat = M_p x_hat- + G_p u- + L_p y- + N_p y + d_p,  r = y - C x_hat - D u - c
    3  alarm where |r| > S b + rho                         S >= |C|; rho: noise and rounding of the residual
    4  keep x_hat, u, y, mode

Source: the interval evaluation that Zammali (2020), 6.3.5, compares its sets with: a zonotope reduced to its hull at
every step. g and rho depend on the gain that produced the estimate, so that both copies of a sample's noise partly
cancel (see ``point``). All terms are positive: what rounding can take is a share of P, g, S and rho, and no term rests
on how large b is. Where the sizes of M grow although its powers do not, the box is one of T^-1 (x - x_hat), with M, C
and the noise turned accordingly and bounds of x from ``R b``, R >= |T|.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .framer import add_terms
from .point import PointObserver, PointTables, centred, plain

Array = np.ndarray


@dataclass(frozen=True)
class BoxTables:
    """The numbers of the error set; N modes, O origins (``PointTables.origins``).

    Parameters
    ----------
    P, Pb : ndarray (N, n_x, n_x)
        Sizes of M and A, rounded up.
    g, gb : ndarray (N, O, n_x)
        What a step adds, with and without its measurement.
    S : ndarray (N, n_y, n_x)
        Size of C, rounded up.
    rho : ndarray (N, O, n_y)
        What noise adds to the residual.
    spread : ndarray (O, n_x)
        What the bounds of x have beyond b.
    T : ndarray (n_x, n_x)
        Coordinates, the identity where none are needed; not in the C.
    R, Z : ndarray (n_x, n_x)
        Sizes of T and of its inverse, rounded up.
    """

    P: Array
    Pb: Array
    g: Array
    gb: Array
    S: Array
    rho: Array
    spread: Array
    T: Array
    R: Array
    Z: Array

    @property
    def turned(self) -> bool:
        """Whether there are coordinates other than the states themselves."""
        return not np.array_equal(self.T, np.eye(len(self.T)))

    @property
    def unprinted(self) -> set[str]:
        """Fields that the C does not hold."""
        return {"T", "Z"} if self.turned else {"T", "Z", "R"}

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, kind: str, sizes: tuple[int, int, int, int], real: str) -> BoxTables:
        """Rebuild from ``to_dict``."""
        return cls(**{f.name: np.array(data[f.name], dtype=np.float64).astype(real) for f in fields(cls)})


class BoxObserver(PointObserver):
    """The observer with a box; see ``Runner`` for the calls. Its set is b, (S, n_x)."""

    family = "box"
    shape_class = BoxTables

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Estimate and half widths of another initial box; see ``Runner.initial``."""
        if x0_lo is None and x0_hi is None:
            return [None, None]
        ends = [record["ranges"][f"x0_{side}"] if x0 is None else x0 for side, x0 in (("lo", x0_lo), ("hi", x0_hi))]
        centre, half = (np.ascontiguousarray(np.broadcast_to(a, shape)) for a in centred(*ends, dtype))
        if "box_start" in record["ranges"]:
            half = turned_start(np.array(record["ranges"]["box_start"]).astype(dtype), half)
        return [centre, half]

    def bits(self, n_y: int) -> int:
        """Alarm bits: one per output, the box says nothing about several together."""
        return n_y

    def whole(self, t: PointTables, half: Array, first: bool = False) -> Array:
        """The half widths themselves, or of a box in the coordinates that holds theirs."""
        half = np.array(half, dtype=t.dtype)
        return turned_start(t.shape.Z, half) if t.shape.turned else half

    def moved(self, t: PointTables, p: Array, q: Array, origin: Array, b: Array, measured: bool) -> Array:
        """The set one step of the modes p later."""
        z = t.shape
        P, g = (z.P, z.g) if measured else (z.Pb, z.gb)
        return add_terms(g[p, np.minimum(origin, t.origins - 1)], P[p], b)

    def radius(self, t: PointTables, q: Array, origin: Array, b: Array) -> Array:
        """Half widths of the bounds of x."""
        z = t.shape
        return add_terms(z.spread[origin], z.R[None], b) if z.turned else z.spread[origin] + b

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether the set is within its limits, and no half width below zero (an upset of the memory), per run."""
        return ((radius >= 0) & (radius <= t.limit)).all(axis=1)

    def judged(self, t: PointTables, q: Array, origin: Array, b: Array, r: Array) -> tuple[Array, Array]:
        """Bounds of each residual, and which one is outside."""
        bound = add_terms(t.shape.rho[q, origin], t.shape.S[q], b)
        return bound, ~(np.abs(r) <= bound)


def turned_start(Z: Array, half: Array) -> Array:
    """Half widths in the coordinates, (S, n_x), of a box with these in x."""
    return add_terms(np.zeros_like(half), Z[None], half)
