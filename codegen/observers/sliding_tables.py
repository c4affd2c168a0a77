"""Constants of family "sliding": a pair of bounds per mode, a super-twisting loop per bound, the decision."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

Array = np.ndarray
#: Whole numbers among the constants.
COUNTS = ("blank", "dwell")


@dataclass(frozen=True)
class SlidingTables:
    """Constants of one period; N modes.

    Parameters
    ----------
    M_hi, M_lo : ndarray (N, n_x, n_x), L_hi, L_lo : ndarray (N, n_x, n_y)
        x_hi+ = d_hi + G u + L_hi s + M_hi x_hi with s = y - D u, and so x_lo; M >= 0.
    G : ndarray (N, n_x, n_u), d_hi, d_lo : ndarray (N, n_x)
        Offsets: disturbance, noise, and all that rounding may do.
    K_hi, K_lo : ndarray (N, n_y, n_y)
        C L: what the bounds' outputs take of the measurement.
    H : ndarray (n_y, n_x), D : ndarray (n_y, n_u)
        C and D of all modes.
    v_lo, v_hi : ndarray (n_y,)
        Bounds of s - C x.
    limit : ndarray (n_x,), z_limit, rate_limit : ndarray (n_y,)
        Magnitudes that bounds, sliding variables and rates are cut to.
    period, turn, pull, ground, inverse, foot : ndarray ()
        tau, tau k2, tau k1, h = tau^2 k2, 1 / h, tau sqrt(k2); k1 = 2 sqrt(k2).
    a, b : ndarray (K,)
        Tangents that a root starts from.
    smooth, share : ndarray ()
        Part that a sample has in the mean of the rates; part of the present mode's mean that another must fall below.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n_x,), u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        Ranges and initial box.
    blank : int
        Samples after a detection at which the decision stands still.
    dwell : int
        Samples that a mode lasts at least.
    real : {"float32", "float64"}
    """

    M_hi: Array
    M_lo: Array
    L_hi: Array
    L_lo: Array
    G: Array
    d_hi: Array
    d_lo: Array
    K_hi: Array
    K_lo: Array
    H: Array
    D: Array
    v_lo: Array
    v_hi: Array
    limit: Array
    z_limit: Array
    rate_limit: Array
    period: Array
    turn: Array
    pull: Array
    ground: Array
    inverse: Array
    foot: Array
    a: Array
    b: Array
    smooth: Array
    share: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    blank: int
    dwell: int
    real: str = "float64"

    #: No parameters, no change of coordinates; bounds are not cut to the ranges of x.
    vary = change = None
    clamp = signed = False

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Modes, states, inputs, outputs."""
        return self.M_hi.shape[0], self.M_hi.shape[1], self.G.shape[2], len(self.v_lo)

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def least(self) -> Array:
        """Smallest number that a root is taken of."""
        return self.ground

    @property
    def A(self) -> Array:
        """Matrices of the upper bounds, where other families have those of the plant; one per mode."""
        return self.M_hi

    @property
    def C(self) -> Array:
        """C of every mode, (N, n_y, n_x)."""
        return np.broadcast_to(self.H, (len(self.M_hi), *self.H.shape))

    @property
    def box(self) -> Array:
        """Magnitude of every bound behind the margins."""
        return self.limit

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v.astype(np.float64).tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> SlidingTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y), else they are read off."""
        n, x, u, y = sizes or (len(data["M_hi"]), len(data["limit"]), len(data["u_lo"]), len(data["v_lo"]))
        shapes = {"G": (n, x, u), "D": (y, u), "H": (y, x), "u_lo": (u,), "u_hi": (u,)}
        shapes |= {f"{k}_{s}": shape for s in ("hi", "lo") for k, shape in
                   (("M", (n, x, x)), ("L", (n, x, y)), ("K", (n, y, y)), ("d", (n, x)))}
        arrays = {f.name: np.array(data[f.name], dtype=np.float64) for f in fields(cls)
                  if f.name not in (*COUNTS, "real")}
        arrays = {k: v.reshape(shapes.get(k, v.shape)).astype(data["real"]) for k, v in arrays.items()}
        return cls(**arrays, **{k: int(data[k]) for k in COUNTS}, real=data["real"])
