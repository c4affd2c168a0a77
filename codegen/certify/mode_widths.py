"""Widths of the box of a mode that stays, and the refusal of an oldest age that is too young."""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError

Array = np.ndarray
#: Periods within which the box of a mode that stays has reached its bound.
LASTING = 100000


class AgesError(CertificateError):
    """The oldest age is too young; ``least`` is one to try next."""

    def __init__(self, text: str, least: int):
        super().__init__(text)
        self.least = least


def narrowed(t, widths: Array, q: int) -> Array:
    """Widths of a box of mode q a period later, cut to the noise."""
    p = len(t.v_lo)
    widths = (np.abs(t.Phi[q]).astype(float) @ widths + 2 * t.reach[q].astype(float)) * (1 + 1e-12)
    widths[:p] = np.minimum(widths[:p], (t.v_hi - t.v_lo).astype(float) * (1 + 1e-12))
    return widths


def contracted(t, widths: Array, q: int, samples: int) -> Array:
    """Widths of a box of mode q after so many periods and ever after: narrow boxes may grow again.

    Raises
    ------
    CertificateError
        They have no bound.
    """
    for _ in range(samples):
        widths = narrowed(t, widths, q)
    for _ in range(LASTING):
        later = narrowed(t, widths, q)
        if np.all(later <= widths):  # and so at every later sample
            return widths
        widths = np.maximum(widths, later * (1 + 1e-6))
        if np.any(widths > 1e30):
            break
    raise CertificateError(f"certificate: the box of mode {q} grows while the mode stays. Measure another state, or "
                           "bound the disturbance closer.")
