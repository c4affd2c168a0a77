"""Weights of an H-infinity filter, and what is done with its gains afterwards.

``W_f`` shapes the target: the filter estimates W_f f. ``W_d`` colours the disturbance: d = W_d d', with d' of the
energy that the level speaks of. Both raise the order of the filter (Farhat and Koenig (2016), (30) to (33)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import tf2ss

from ..errors import DesignError
from .hinf_problem import Block, FilterMode, FilterProblem

Array = np.ndarray


@dataclass(frozen=True)
class Weight:
    """A discrete-time system, the same in every channel: x+ = A x + B d, out = C x + D d.

    Parameters
    ----------
    A : ndarray (n, n), B : ndarray (n, 1), C : ndarray (1, n), D : ndarray (1, 1)
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def times(self, channels: int) -> Weight:
        """The block-diagonal weight of several channels."""
        return Weight(*(np.kron(np.eye(channels), M) for M in (self.A, self.B, self.C, self.D)))


def weight(num, den) -> Weight:
    """Weight num(q)/den(q), coefficients of falling powers of the shift q.

    Parameters
    ----------
    num, den : sequence of float

    Returns
    -------
    Weight

    Raises
    ------
    DesignError
        It is not proper or not stable.
    """
    num, den = np.trim_zeros(np.atleast_1d(num), "f"), np.trim_zeros(np.atleast_1d(den), "f")
    if not len(num):
        raise DesignError("weight: the numerator is 0 (found), expected a number other than 0: a weight of nothing "
                          "leaves nothing to estimate or to hold against. Leave it out.")
    if len(num) > len(den) or not len(den):
        raise DesignError(f"weight: numerator of degree {len(num) - 1}, denominator of degree {len(den) - 1} (found), "
                          "expected a proper fraction. Add a pole.")
    A, B, C, D = tf2ss(num, den) if len(den) > 1 else (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), num / den)
    radius = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    if radius >= 1:
        raise DesignError(f"weight: a pole of size {radius:.6g} (found), expected less than 1. Move it inside.")
    return Weight(A, B, C, np.reshape(D, (1, 1)))


def weighted(problem: FilterProblem, W_f: Weight | None = None, W_d: Weight | None = None) -> FilterProblem:
    """The problem with weights in it: states [x; target; disturbance].

    Parameters
    ----------
    problem : FilterProblem
        Without weights.
    W_f, W_d : Weight or None
        Of one channel; every channel gets its own copy.

    Returns
    -------
    FilterProblem
    """
    n_f = problem.sizes[3]
    n_w = problem.sizes[1] - n_f
    one = weight([1.0], [1.0])
    target, colour = (W_f or one).times(n_f), (W_d or one).times(n_w)
    return replace(problem, modes=tuple(_with(m, target, colour, n_w) for m in problem.modes))


def _with(m: FilterMode, f: Weight, d: Weight, n_w: int) -> FilterMode:
    n, a, b = len(m.A), len(f.A), len(d.A)
    E_d, E_f, F_d, F_f = m.E[:, :n_w], m.E[:, n_w:], m.F[:, :n_w], m.F[:, n_w:]

    def zero(r, c):
        return np.zeros((r, c))

    def inputs(X, rows):  # [x; d] with d = W_d d'
        return np.hstack([X[:, :n], zero(rows, a), X[:, n:n + n_w] @ d.C, X[:, n:n + n_w] @ d.D, X[:, n + n_w:]])

    A = np.block([[m.A, zero(n, a), E_d @ d.C], [zero(a, n), f.A, zero(a, b)], [zero(b, n + a), d.A]])
    E = np.block([[E_d @ d.D, E_f], [zero(a, n_w), f.B], [d.B, zero(b, E_f.shape[1])]])
    blocks = []
    for block in m.blocks:
        H = np.vstack([block.H[:n], zero(a + b, block.H.shape[1]), block.H[n:]])
        blocks.append(Block(H, inputs(block.S, len(block.S)), block.repeated))
    rows = f.D.shape[0]
    return FilterMode(A, E, np.hstack([m.C, zero(len(m.C), a), F_d @ d.C]), np.hstack([F_d @ d.D, F_f]),
                      np.hstack([zero(rows, n), -f.C, zero(rows, b)]), np.hstack([zero(rows, n_w), -f.D]),
                      tuple(blocks))


def steady_gain(m: FilterMode, gains: tuple[Array, Array, Array, Array], n_x: int) -> Array:
    """Gain from a constant fault to the estimate while one mode stays.

    Parameters
    ----------
    m : FilterMode
    gains : A, B, C, D of the filter in this mode
    n_x : int
        States of the plant; the weights behind them do not enter.

    Returns
    -------
    ndarray (n_f, n_f)
    """
    A, B, C, D = gains
    n_f = m.Cz.shape[0]
    E, F = m.E[:n_x, -n_f:], m.F[:, -n_f:]
    y = m.C[:, :n_x] @ np.linalg.solve(np.eye(n_x) - m.A[:n_x, :n_x], E) + F
    return (C @ np.linalg.solve(np.eye(len(A)) - A, B) + D) @ y


def post_scaling(problem: FilterProblem, gains) -> list[Array]:
    """Matrices xi that make the estimate of a constant fault exact in every mode: f_hat becomes xi f_hat.

    Exact only while a mode stays, and the level of the scaled filter is another one: it has to be certified anew.

    Parameters
    ----------
    problem : FilterProblem
    gains : sequence of (A, B, C, D), one per mode

    Returns
    -------
    list of ndarray (n_f, n_f)

    Raises
    ------
    DesignError
        A constant fault does not reach the estimate.
    """
    out = []
    for name, m, gain in zip(problem.names, problem.modes, gains):
        steady = steady_gain(m, gain, problem.order)
        if np.linalg.cond(steady) > 1e8:
            raise DesignError(f'post scaling: in mode "{name}" a constant fault does not reach the estimate (gain of '
                              f"condition {np.linalg.cond(steady):.3g}). Leave post_scaling out, or weight slow "
                              "faults.")
        out.append(np.linalg.inv(steady))
    return out


def scaled(gains, xi):
    """Gains of the filter whose estimate is multiplied by xi.

    Parameters
    ----------
    gains : sequence of (A, B, C, D), one per mode
    xi : sequence of ndarray (n_f, n_f)

    Returns
    -------
    list of (A, B, C, D)
    """
    return [(A, B, X @ C, X @ D) for (A, B, C, D), X in zip(gains, xi)]
