"""What can be said of a plant before any design: stability, detectability, signs, boundedness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .model import Mode, Plant

Array = np.ndarray


@dataclass(frozen=True)
class ModeProperties:
    """Properties of one mode.

    Parameters
    ----------
    name : str
    radius : float
        Spectral radius of A (discrete) or spectral abscissa (continuous).
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


def mode_properties(mode: Mode, kind: str) -> ModeProperties:
    """Compute the properties of one mode (theta at zero).

    Parameters
    ----------
    mode : Mode
    kind : {"discrete", "continuous"}

    Returns
    -------
    ModeProperties
    """
    A, C = mode.A, mode.C
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
    return ModeProperties(mode.name, float(size.max()), bool(size.max() < limit), bool(observable), tuple(hidden),
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
    return [mode_properties(m, plant.kind) for m in plant.modes]
