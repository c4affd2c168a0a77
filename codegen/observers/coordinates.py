"""Tables of a change of coordinates: the firmware carries bounds of z = Z x beside those of x.

Z is exact by definition of z. The C holds it, and a rounded inverse X::

    z_hi = pos(Z) x_hi - neg(Z) x_lo + e_hi      cut to what Z makes of the range of x
    x_hi = pos(X) z_hi - neg(X) z_lo + b_hi      cut to the range of x

with z_lo, x_lo mirrored. e covers the rounding of its sum, b that and (I - X Z) x. Lamouchi (2016) calls Z and X R and
S; here these are the radii.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Coordinates:
    """One change of coordinates for all modes.

    Parameters
    ----------
    Z, X : ndarray (n_x, n_x)
        To z, and back.
    e_lo, e_hi, b_lo, b_hi : ndarray (n_x,)
        Offsets of both maps.
    z_lo, z_hi : ndarray (n_x,)
        What Z makes of the declared range of x.
    box : ndarray (n_x,)
        Bound on the magnitude of both framers of z.
    """

    Z: Array
    X: Array
    e_lo: Array
    e_hi: Array
    b_lo: Array
    b_hi: Array
    z_lo: Array
    z_hi: Array
    box: Array

    def to_dict(self) -> dict:
        """Return plain lists for design.json; every float is exact."""
        return {f.name: getattr(self, f.name).astype(np.float64).tolist() for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, real: str) -> Coordinates:
        """Rebuild from ``to_dict``."""
        return cls(**{f.name: np.array(data[f.name], dtype=np.float64).astype(real) for f in fields(cls)})
