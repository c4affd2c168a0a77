"""Where the signals of a polytopic plant are: middles and half widths, and what they do together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .exact import product, rational, zeros

Array = np.ndarray


@dataclass(frozen=True)
class Ranges:
    """Where the signals are, as middles and half widths; rational object arrays.

    Parameters
    ----------
    x, u, d : (ndarray (n,), ndarray (n,))
        u and d in their units, as those of the problem.
    """

    x: tuple[Array, Array]
    u: tuple[Array, Array]
    d: tuple[Array, Array]

    @classmethod
    def of(cls, plant, problem) -> Ranges:
        """Those of a plant file.

        Parameters
        ----------
        plant : Plant
        problem : DescriptorProblem
            With known terms behind the inputs, and faults behind disturbance and noise, where it has so many.
        """
        known = [np.array([getattr(g, end) for g in plant.polytope.known], dtype=float) for end in ("lo", "hi")]
        u, d = [plant.limits("u")], [plant.limits("w"), plant.limits("v")]
        u += [known] if problem.B.shape[2] > plant.n_u else []
        d += [plant.limits("f")] if problem.Bd.shape[2] > plant.n_w + plant.n_v else []
        ends = [[np.concatenate(side) for side in zip(*some)] for some in (u, d)]
        return cls(middle(*plant.limits("x")), middle(*ends[0], problem.u_unit), middle(*ends[1], problem.d_unit))


def middle(lo: Array, hi: Array, unit: Array | None = None) -> tuple[Array, Array]:
    """Middle and half width of ranges, exactly.

    Parameters
    ----------
    lo, hi : ndarray (n,)
    unit : ndarray (n,), optional
        What they are measured in.
    """
    lo, hi = (rational(v).reshape(len(v)) for v in (lo, hi))
    size = rational(np.ones(len(lo)) if unit is None else unit).reshape(len(lo))
    return (lo + hi) / 2 / size, (hi - lo) / 2 / size


def columns(parts: list[tuple[Array, tuple[Array, Array]]], extra: list[Array] = ()) -> Array:
    """What several signals do together: a column of their middles, then one for each half width.

    Parameters
    ----------
    parts : list of (object array (k, n), (middle, half))
    extra : list of object array (k, n)
        Columns of unknowns in [-1, 1].
    """
    rows = len(parts[0][0])
    centre = sum((product(M, mid.reshape(-1, 1)) for M, (mid, _) in parts), zeros(rows, 1))
    return np.concatenate([centre, *(M * half for M, (_, half) in parts), *extra], axis=1)


def reach(M: Array, box: tuple[Array, Array]) -> Array:
    """Largest magnitude of every row of M over a box.

    Parameters
    ----------
    M : object array (k, n), box : (middle, half)
    """
    mid, half = box
    return abs(product(M, mid.reshape(-1, 1)))[:, 0] + product(abs(M), half.reshape(-1, 1))[:, 0]


def largest(rows: list[Array]) -> Array:
    """Entrywise maximum of rational vectors."""
    return np.array([max(values) for values in zip(*rows)], dtype=object).reshape(len(rows[0]))
