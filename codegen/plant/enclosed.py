"""A continuous plant at its sampling period with constant matrices: all that these leave out is a bounded disturbance.

``sampled`` encloses a period by ``x+ = (A + dA) x + (B + dB) u + Bw [mean; rest] + (Bf + dF) f`` with bounds of dA, dB
and dF elementwise. For x, u and f in their declared ranges ``dA x + dB u + dF f`` is in a box, and the box of ``rest``
is widened by it, and rounded up to 32 bits of the range of x: whoever bounds it in another way gets the same number.
Parameters are bounded by disturbances before that (``bounded``). A disturbance in the outputs is that of the sample
itself, no mean over a period: it becomes noise.

What is left is a discrete plant like any other, for designs that know constant matrices alone.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np

from .bounded import READ, above, bounded
from .model import Mode, Plant
from .sampling import sampled

Array = np.ndarray
BITS = 32


def enclosed(plant: Plant) -> Plant:
    """Return the discrete plant of a continuous one; a discrete or polytopic plant itself.

    Parameters
    ----------
    plant : Plant
        x, u and f with ranges; parameters in A and B alone.

    Returns
    -------
    Plant
        Modes with constant matrices, w = [mean disturbance; rest of each state].

    Raises
    ------
    DesignError
        The sampling period is far too long for the plant.
    """
    if plant.kind != "continuous" or plant.polytope is not None:
        return plant
    plant = bounded(plant)
    found = sampled(plant)
    most = {"A": _most(plant, "x"), "B": _most(plant, "u") * READ, "Bf": _most(plant, "f")}
    noise = plant.v if not _through(plant) else (*plant.v, *plant.w)
    return replace(found, v=noise, modes=tuple(_mode(plant, m, s, most) for m, s in zip(plant.modes, found.modes)))


def coarser(x: Fraction, size: float) -> float:
    """The least multiple of a bit of a size, ``BITS`` bits below its first one, that is not below a number."""
    bit = Fraction(2) ** (math.frexp(size)[1] - BITS)
    return above(math.ceil(x / bit) * bit)


def _through(plant: Plant) -> bool:
    """Whether a disturbance is in the outputs."""
    return any(np.any(m.Dw) for m in plant.modes)


def _most(plant: Plant, vector: str) -> Array:
    """Largest magnitudes of a signal vector."""
    return np.max(np.abs(plant.limits(vector)), axis=0)


def _mode(plant: Plant, given: Mode, sampled_mode, most: dict[str, Array]) -> Mode:
    """A mode with its elementwise bounds in the box of the rest; ``given`` is that of the continuous plant."""
    n, lo, hi = plant.n_x, sampled_mode.w_lo.copy(), sampled_mode.w_hi.copy()
    for i in range(n):
        beyond = sum((Fraction(r) * Fraction(s) for name, size in most.items()
                      for r, s in zip(getattr(sampled_mode, f"{name}_rad")[i], size) if r), Fraction(hi[i - n]))
        hi[i - n] = coarser(beyond, most["A"][i])
        lo[i - n] = -hi[i - n]
    keep = {k: getattr(sampled_mode, k) for k in ("name", "A", "B", "C", "D", "Bw", "Bf", "Df", "Dv", "v_lo", "v_hi")}
    if _through(plant):
        keep |= {"Dv": np.hstack([given.Dv, given.Dw]), "v_lo": np.concatenate([given.v_lo, given.w_lo]),
                 "v_hi": np.concatenate([given.v_hi, given.w_hi])}
    return Mode(**keep, w_lo=lo, w_hi=hi)
