"""Widths of the box of a mode that stays, and the refusal of an oldest age that is too young."""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError

Array = np.ndarray
#: Periods within which the box of a mode that stays has reached its bound.
LASTING = 100000
#: A width that no box has.
HUGE = 1e30


class AgesError(CertificateError):
    """The oldest age is too young; ``least`` is one to try next."""

    def __init__(self, text: str, least: int):
        super().__init__(text)
        self.least = least


def rounding(t) -> float:
    """The share of its terms by which a computed end of a box may be beyond the exact one."""
    return (t.Phi.shape[1] + len(t.u_lo) + 8) * float(np.finfo(t.real).eps)


def most(lo: Array, hi: Array) -> Array:
    """Magnitudes that a vector between these ends does not exceed."""
    return np.maximum(np.abs(lo), np.abs(hi)).astype(float)


def measured(t) -> Array:
    """Widths of S x in its first rows just after a measurement, rounding included."""
    p, noise = len(t.v_lo), most(t.v_lo, t.v_hi)
    terms = most(t.wide_lo, t.wide_hi)[:p] + 2 * np.abs(t.D) @ most(t.u_lo, t.u_hi) + 5 * noise
    return (t.v_hi.astype(float) - t.v_lo + 2 * rounding(t) * terms) * (1 + 1e-12)


def narrowed(t, widths: Array, q: int) -> Array:
    """Widths of a box of mode q a period later, cut to the noise, rounding included."""
    p, reach = len(t.v_lo), t.reach[q].astype(float)
    terms = np.abs(t.Phi[q]) @ t.limit + np.abs(t.Gamma[q]) @ most(t.u_lo, t.u_hi) + np.abs(t.shift[q]) + reach
    widths = (np.abs(t.Phi[q]).astype(float) @ widths + 2 * reach + 2 * rounding(t) * terms) * (1 + 1e-12)
    widths[:p] = np.minimum(widths[:p], measured(t))
    return widths


def contracted(t, widths: Array, q: int, samples: int) -> Array:
    """Widths of a box of mode q after so many periods and ever after: narrow boxes may grow again.

    Raises
    ------
    CertificateError
        They have no bound.
    """
    for _ in range(samples):
        before, widths = widths, np.minimum(narrowed(t, widths, q), HUGE)  # refused below, before it overflows
        if np.array_equal(before, widths):
            break
    for _ in range(LASTING):
        later = narrowed(t, widths, q)
        if np.all(later <= widths):  # and so at every later sample
            return widths
        widths = np.maximum(widths, later * (1 + 1e-6))
        if np.any(widths >= HUGE):
            break
    raise CertificateError(f"certificate: the box of mode {q}, counted from 0, grows while the mode stays. Measure "
                           "another state, or bound the disturbance closer.")
