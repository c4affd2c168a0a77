r"""Run-time family "descriptor": an observer that solves the algebraic equations itself, thresholds for its residual.

At sample k, from the observer's state z::

    1  h = weights at z,  g_j = h_j d_j / sum_i h_i d_i      d_j the pivot of the algebraic equations at vertex j
    2  x_hat = z, but its algebraic part is sum_j g_j (P_j z + Q_j u);  r = y - C x_hat
    3  alarm where |M r| > threshold[since >> shift]         no fault: it cannot exceed it
    4  z+ = sum_j h_j (F_j x_hat + G_j u - K_j r), cut to its limits; its algebraic part is that of x_hat

So no output has to see the algebraic states: they follow from the others and from the inputs, at every sample.
What z holds of them only chooses the weights of the next sample, and a start value that contradicts the equations does
no harm. Where all vertices have the same pivot g is h, and nothing is divided.

Rows 1 and 2 solve sum_j h_j S' (A_j x_hat + B_j u) = 0 exactly, where S' A_j is d_j times one matrix on the algebraic
states: P_j and Q_j are the solution at vertex j, and with g in place of h so is their mean. The
certificate checks d_j > 0, thus the sum of h_i d_i is at least the least of them; the guard of the division, half of
that, is for what intervals cannot tell and for a spoilt memory.

All else is as in ``polytopic``.
"""

from __future__ import annotations

import numpy as np

from .descriptor_tables import DescriptorTables
from .polytopic import PolytopicObserver
from .polytopic_step import evaluate, moved, summed

Array = np.ndarray


class DescriptorObserver(PolytopicObserver):
    """The observer as the firmware runs it, on S independent runs at once; see ``Runner`` for the calls."""

    family = "descriptor"
    tables_class = DescriptorTables

    @staticmethod
    def advance(t: DescriptorTables, z: Array, u: Array, y: Array, theta: Array, measured: Array) -> tuple[Array, ...]:
        """One sample of S runs: x_hat, r, inside and the z after it, before it is cut.

        Parameters
        ----------
        t : DescriptorTables
        z : ndarray (S, n), u : ndarray (S, m), y : ndarray (S, p), theta : ndarray (S, n_theta)
        measured : ndarray (S,) bool
        """
        with np.errstate(all="ignore"):
            *h, inside = evaluate(t.weights, [*z.T, *u.T, *theta.T], z.dtype)
            h = np.stack([np.broadcast_to(w, inside.shape) for w in h], axis=1).astype(z.dtype)
            x_hat = z.copy()
            x_hat[:, list(t.algebraic)] = solved(t, of_pivots(t, h), np.concatenate([z, u], axis=1))
            r = np.where(measured[:, None], summed(-t.C, x_hat, y), np.zeros_like(y))
            return x_hat, r, inside, moved(t, x_hat, u, r, h)


def of_pivots(t: DescriptorTables, h: Array) -> Array:
    """The weights of the solved equations, term after term.

    Parameters
    ----------
    t : DescriptorTables
    h : ndarray (S, h)
    """
    if not t.uneven:
        return h
    g = h * t.pivot
    total = g[:, 0]
    for j in range(1, g.shape[1]):
        total = total + g[:, j]
    return g / np.where(total > t.least_pivot, total, t.least_pivot)[:, None]


def solved(t: DescriptorTables, g: Array, values: Array) -> Array:
    """The algebraic states (S, a) from z and u; entries that all vertices share stand before the weights.

    Parameters
    ----------
    t : DescriptorTables
    g : ndarray (S, h)
    values : ndarray (S, n + m)
    """
    out = summed(np.where(t.common, t.solved[0], 0), values)
    for j, M in enumerate(t.solved):
        own = np.where(t.common, 0, M)
        out = np.where(np.any(own != 0, axis=1), out + g[:, [j]] * summed(own, values), out)
    return out
