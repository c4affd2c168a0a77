"""Constants of family "mode": one sampling period of every mode, and what a switch within it can add."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class ModeTables:
    """Constants of one period, each box enlarged for what rounding may add; N modes.

    Parameters
    ----------
    S : ndarray (n_x, n_x), S_inverse : ndarray (n_x, n_x)
        xi = S x; the first rows of S are C. S itself is not in the C and stays in double precision.
    x_room : ndarray (n_x,)
        What S_inverse and its product may lose.
    Phi : ndarray (N, n_x, n_x), Gamma : ndarray (N, n_x, n_u), shift : ndarray (N, n_x)
        xi+ = Phi xi + Gamma u + shift +- reach.
    reach : ndarray (N, n_x)
    J : ndarray (N, N, n_x, n_x), J_u : ndarray (N, N, n_x, n_u), J_shift : ndarray (N, N, n_x)
        From mode i to j within the period: what is added lies between 0 and J xi + J_u u + J_shift +- (J_radius |xi| +
        J_u_radius |u| + J_reach).
    J_radius, J_u_radius, J_reach : ndarray (N, N, n_x, n_x), (N, N, n_x, n_u), (N, N, n_x)
    birth : ndarray (N, N, n_x)
        What the disturbances of both modes reach in the period; at least ``reach``.
    D : ndarray (n_y, n_u)
    v_lo, v_hi : ndarray (n_y,)
        Bounds of y - C x - D u.
    start_lo, start_hi : ndarray (n_x,)
        Box of xi at power-up.
    wide_lo, wide_hi : ndarray (n_x,)
        Box of xi by the declared ranges: start after an alarm.
    limit : ndarray (n_x,)
        Magnitude of xi behind the margins, beyond the declared ranges: boxes are cut to it.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n_x,)
        Declared range and initial box.
    u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    ages : int
        Oldest age M; the dwell time is at least M + 1 samples.
    real : {"float32", "float64"}
    """

    S: Array
    S_inverse: Array
    x_room: Array
    Phi: Array
    Gamma: Array
    shift: Array
    reach: Array
    J: Array
    J_u: Array
    J_shift: Array
    J_radius: Array
    J_u_radius: Array
    J_reach: Array
    birth: Array
    D: Array
    v_lo: Array
    v_hi: Array
    start_lo: Array
    start_hi: Array
    wide_lo: Array
    wide_hi: Array
    limit: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    ages: int
    real: str = "float64"

    #: No parameters, no change of coordinates in the sense of ``FramerTables``; boxes are not cut to the ranges of x.
    vary = change = None
    clamp = signed = False

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Modes, states, inputs, outputs."""
        return self.Phi.shape[0], self.Phi.shape[1], self.Gamma.shape[2], len(self.v_lo)

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def A(self) -> Array:
        """Transition matrices, as the other families call them."""
        return self.Phi

    @property
    def C(self) -> Array:
        """C of every mode, (N, n_y, n_x)."""
        n_modes, n_x, _, n_y = self.sizes
        return np.broadcast_to(self.S[:n_y], (n_modes, n_y, n_x))

    @property
    def box(self) -> Array:
        """Bound of every box behind the margins, in xi."""
        return self.limit

    def to_dict(self) -> dict:
        """Return plain lists for design.json; every float is exact."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v.astype(np.float64).tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int] | None = None) -> ModeTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y), else they are read off."""
        n, x, u, y = sizes or (len(data["Phi"]), len(data["S"]), len(data["u_lo"]), len(data["v_lo"]))
        shapes = {"S": (x, x), "S_inverse": (x, x), "Phi": (n, x, x), "Gamma": (n, x, u), "shift": (n, x),
                  "reach": (n, x), "J": (n, n, x, x), "J_u": (n, n, x, u), "J_shift": (n, n, x),
                  "J_radius": (n, n, x, x), "J_u_radius": (n, n, x, u), "J_reach": (n, n, x), "birth": (n, n, x),
                  "D": (y, u)}
        lengths = {"u_lo": u, "u_hi": u, "y_lo": y, "y_hi": y, "v_lo": y, "v_hi": y}
        arrays = {f.name: np.array(data[f.name], dtype=np.float64).reshape(
            shapes.get(f.name, (lengths.get(f.name, x),))).astype("float64" if f.name == "S" else data["real"])
            for f in fields(cls) if f.name not in ("ages", "real")}
        return cls(**arrays, ages=int(data["ages"]), real=data["real"])
