"""What the members of the state that hold an error set may be, for the Frama-C harness; one entry per family.

A new family whose state has members of its own adds a function to ``RANGES``: tables -> ``Ranges``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Ranges:
    """Ranges of the members of a set.

    Parameters
    ----------
    numbers : dict
        Member -> (least, most), arrays in the member's order. Eva starts from them and does not show that they stay.
    words : dict
        Member -> largest value, which Eva shows to stay.
    about : tuple of str
        Lines that say what keeps the numbers there.
    """

    numbers: dict
    words: dict
    about: tuple[str, ...]


NONE = Ranges({}, {}, ())


def of(family: str, t) -> Ranges:
    """Return the ranges of a family's own members.

    Parameters
    ----------
    family : str
    t : PointTables

    Returns
    -------
    Ranges
        Of a family that is not listed: none, so that the harness refuses members that it does not know.
    """
    return RANGES.get(family, lambda tables: NONE)(t)


def zonotope(t) -> Ranges:
    """Each number of a generator is at most what the sum of its row may be."""
    most = np.tile(t.limit, t.shape.columns)
    return Ranges({"shape": (-most, most)}, _origin(t),
                  ("The generators' sum of magnitudes in a row has been compared with its limit when a call ends,",
                   "and sums of magnitudes, rounded to nearest, are no smaller than any of their terms: that keeps",
                   "each number of a generator there. From there Eva shows that all stays finite."))


def ellipsoid(t) -> Ranges:
    """Each diagonal is at most what a tangent of its root lets pass, the others at most their geometric mean."""
    z = t.shape
    limit, slope, offset = (np.asarray(a, dtype=float) for a in (t.limit, z.a, z.b))
    square = np.max(np.maximum(limit * (1 + 1e-6) - offset, 0) / slope, axis=0) * (1 + 1e-6)
    root = np.sqrt(square)
    most = (root[:, None] * root * (1 + 1e-6)).astype(t.dtype)
    least = -most
    np.fill_diagonal(least, 0.0)
    return Ranges({"shape": (least.ravel(), most.ravel())}, _origin(t),
                  ("The shape stays positive semidefinite (residua certify proves that what a step adds holds its",
                   "rounding) and its diagonal has been compared with the limits when a call ends: that keeps its",
                   "numbers there. From there Eva shows that all stays finite."))


def thresholds(t) -> Ranges:
    """Stage and count."""
    return Ranges({}, {"stage": len(t.shape.h) - 1, "since": t.shape.cap}, ())


def _origin(t) -> dict:
    return {"origin": t.origins - 1} if t.kind == "tnl" else {}


RANGES = {"zonotope": zonotope, "ellipsoid": ellipsoid, "thresholds": thresholds}
