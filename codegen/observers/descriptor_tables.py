"""The numbers of an observer in descriptor form, as ``observers.descriptor`` and its C hold them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .polytopic_tables import PolytopicTables

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class DescriptorTables(PolytopicTables):
    """The numbers that the C holds; T2 is zero, and entries of z+ that are algebraic take those of x_hat.

    Parameters
    ----------
    algebraic : tuple of int
        The states that no derivative is of; a of them.
    P : ndarray (h, a, n), Q : ndarray (h, a, m)
        The algebraic equations of each vertex, solved for them. Columns of P that are algebraic are zero.
    pivot : ndarray (h,)
        Factor of what each vertex' equations were solved for; above 0, at most 1.
    """

    algebraic: tuple[int, ...]
    P: Array
    Q: Array
    pivot: Array

    @property
    def moving(self) -> Array:
        """The states that are not algebraic."""
        return np.array([k for k in range(len(self.z0)) if k not in self.algebraic])

    @property
    def solved(self) -> Array:
        """P and Q side by side (h, a, n + m): factors of (z, u)."""
        return np.concatenate([self.P, self.Q], axis=2)

    @property
    def common(self) -> Array:
        """Entries of `solved` that are the same at all vertices (a, n + m)."""
        return np.all(self.solved == self.solved[0], axis=0)

    def estimate(self, j: int) -> tuple[Array, Array]:
        """Factors of z and u in x_hat where all weight is at vertex j, (n, n) and (n, m)."""
        of_z, of_u = np.eye(len(self.z0)), np.zeros((len(self.z0), self.Q.shape[2]))
        of_z[list(self.algebraic)], of_u[list(self.algebraic)] = self.P[j], self.Q[j]
        return of_z, of_u

    @property
    def least_pivot(self) -> np.generic:
        """Half the least pivot: what the C divides by at least, whatever a spoilt memory makes of the weights."""
        return np.min(self.pivot) / self.dtype.type(2)

    @property
    def uneven(self) -> bool:
        """Whether the weights of the algebraic equations are others than those of the vertices."""
        return bool(np.any(self.pivot != 1))

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        return super().to_dict() | {"algebraic": list(self.algebraic)}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> DescriptorTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        base = PolytopicTables.from_dict(data, sizes)
        h, n, m = base.G.shape
        shapes = {"P": (h, -1, n), "Q": (h, len(data["algebraic"]), m), "pivot": (h,)}
        own = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(base.dtype) for k, s in shapes.items()}
        return cls(**{f.name: getattr(base, f.name) for f in fields(base)}, algebraic=tuple(data["algebraic"]), **own)
