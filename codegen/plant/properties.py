"""What can be said of a plant before any design: stability, detectability, signs, boundedness.

Of a plant with parameters the worst corner of their box speaks for the mode. That is a hint: a plant may be stable at
every corner and still diverge while the parameters move.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from .model import Mode, Plant

Array = np.ndarray


@dataclass(frozen=True)
class ModeProperties:
    """Properties of one mode; where it has parameters, what holds at every corner of their box.

    Parameters
    ----------
    name : str
    radius : float
        Spectral radius of A (discrete) or spectral abscissa (continuous); the largest of the corners.
    stable : bool
    observable : bool
    hidden : tuple of complex
        Eigenvalues that are unstable and invisible to the outputs: must be empty for detectability.
    cooperative : bool
        A >= 0 elementwise (discrete) or off the diagonal (continuous).
    """

    name: str
    radius: float
    stable: bool
    observable: bool
    hidden: tuple[complex, ...]
    cooperative: bool

    @property
    def detectable(self) -> bool:
        """No unstable eigenvalue is invisible."""
        return not self.hidden


def mode_properties(name: str, A: Array, C: Array, kind: str) -> ModeProperties:
    """Compute the properties of one mode with constant matrices.

    Parameters
    ----------
    name : str
    A : ndarray (n_x, n_x), C : ndarray (n_y, n_x)
    kind : {"discrete", "continuous"}

    Returns
    -------
    ModeProperties
    """
    eigenvalues = np.linalg.eigvals(A)
    size = np.abs(eigenvalues) if kind == "discrete" else eigenvalues.real
    limit = 1.0 if kind == "discrete" else 0.0
    hidden, observable = [], True
    for value, s in zip(eigenvalues, size):
        seen = np.linalg.matrix_rank(np.vstack([A - value * np.eye(len(A)), C])) == len(A)
        observable = observable and seen
        # An eigenvalue exactly on the limit counts: it does not decay.
        if not seen and s >= limit - 1e-12:
            hidden.append(complex(value))
    off_diagonal = A if kind == "discrete" else A - np.diag(np.diag(A))
    return ModeProperties(name, float(size.max()), bool(size.max() < limit), bool(observable), tuple(hidden),
                          bool(np.all(off_diagonal >= 0)))


def properties(plant: Plant) -> list[ModeProperties]:
    """Properties of every mode.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    list of ModeProperties
    """
    return [_worst([mode_properties(m.name, *matrices, plant.kind) for matrices in _corners(plant, m)])
            for m in plant.modes]


def _corners(plant: Plant, mode: Mode):
    """Yield A and C at every corner of the parameters' box in a mode; once where there are none."""
    for corner in product(*zip(*plant.theta_box(mode))):
        yield tuple(sum((value * slope for value, slope in zip(corner, mode.theta_terms.get(name, ()))),
                        getattr(mode, name)) for name in ("A", "C"))


def _worst(found: list[ModeProperties]) -> ModeProperties:
    """What holds at all corners."""
    hidden = tuple(value for p in found for value in p.hidden)
    return ModeProperties(found[0].name, max(p.radius for p in found), all(p.stable for p in found),
                          all(p.observable for p in found), hidden, all(p.cooperative for p in found))
