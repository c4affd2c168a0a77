"""One sampling period of every mode in ball arithmetic (Arb), rounded outward: constants of ``mode_tables``.

With the switch from mode i to j at an unknown instant s of the period T,

    ``xi+ = Phi_j xi + Gamma_j u + (disturbance) + int_0^s f(t) dt``,
    ``f(t) = S e^{A_j (T - t)} ((A_i - A_j) x(t) + (B_i - B_j) u)``, x(t) in mode i,

so what is added lies between 0 and T f over all t in the period. Of a discrete plant the mode changes at samples: the
step belongs to one mode, and nothing is added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

Array = np.ndarray
#: Pieces of the period on which integrands are bounded.
PIECES = 16


@dataclass(frozen=True)
class Parts:
    """Float values with elementwise bounds of their error: what ``tables_of`` rounds to the type of the C."""

    value: Array
    error: Array


def exact(M: Array) -> arb_mat:
    """Ball matrix of a float array."""
    return arb_mat(np.asarray(M, dtype=float).tolist())


def magnitude(M: arb_mat) -> arb_mat:
    """Elementwise magnitude."""
    return arb_mat([[abs(x) for x in row] for row in M.tolist()])


def top(M: arb_mat) -> Array:
    """Upper ends, as floats rounded up."""
    out = np.array([[float(x.upper()) for x in row] for row in M.tolist()], dtype=float).reshape(M.nrows(), M.ncols())
    return np.where(out > 0, np.nextafter(out, np.inf), np.maximum(out, 0.0))


def parts(M: arb_mat) -> Parts:
    """Float near the middle, and the distance from all of the ball."""
    value = np.array([[float(x.mid()) for x in row] for row in M.tolist()]).reshape(M.nrows(), M.ncols())
    return Parts(value, top(magnitude(M - exact(value))))


class Period:
    """Ball matrices of one period in all modes.

    Parameters
    ----------
    A, B, shift : sequences over modes of ndarray (n_x, n_x), (n_x, n_u), (n_x, 1)
        x' = A x + B u + shift + w.
    w : sequence of ndarray (n_x, 1)
        |w| per mode.
    S : ndarray (n_x, n_x)
    T : float
        Seconds.
    """

    def __init__(self, A, B, shift, w, S: Array, T: float):
        self.A, self.T, self.S = [exact(a) for a in A], arb(float(T)), exact(S)
        self.inverse = self.S.inv()
        self.w = [exact(x) for x in w]
        n, self.n_u = S.shape[0], B[0].shape[1]
        self.wide = n + self.n_u + 1
        self.whole = []
        for a, b, c in zip(A, B, shift):
            M = np.zeros((self.wide, self.wide))
            M[:n] = np.hstack([a, b, c])
            self.whole.append(exact(M))
        self.n = n
        back = [[arb(0)] * self.wide for _ in range(self.wide)]
        for i in range(self.wide):
            for j in range(self.wide):
                inside = i < n and j < n
                back[i][j] = self.inverse[i, j] if inside else arb(int(i == j))
        self.back = arb_mat(back)

    def rows(self, M: arb_mat) -> arb_mat:
        """The first n_x rows."""
        return arb_mat(M.tolist()[:self.n])

    def transition(self, q: int) -> arb_mat:
        """[Phi, Gamma, shift] of one mode."""
        return self.S * self.rows((self.whole[q] * self.T).exp()) * self.back

    def reached(self, q: int, w: arb_mat, S: arb_mat | None = None) -> arb_mat:
        """Bound of |int_0^T S e^{A s} w(s) ds|: on each piece the integrand at its middle and its slope."""
        S = self.S if S is None else S
        slope = magnitude(S) * magnitude(self.A[q]) * (magnitude(self.A[q]) * self.T).exp()
        total = 0 * slope
        for k in range(PIECES):
            middle = S * (self.A[q] * (self.T * (2 * k + 1) / (2 * PIECES))).exp()
            total = total + magnitude(middle) + slope * (self.T / (2 * PIECES))
        return total * w * (self.T / PIECES)

    def largest(self, i: int, j: int) -> arb_mat:
        """Elementwise larger disturbance of two modes."""
        return arb_mat([[a[0] if a[0].upper() > b[0].upper() else b[0]]
                        for a, b in zip(self.w[i].tolist(), self.w[j].tolist())])

    def jump(self, i: int, j: int) -> tuple[Parts, Array]:
        """T f over the period as middle and radius in [xi; u; 1], and what disturbances before the switch add to it."""
        change = self.rows(self.whole[i] - self.whole[j])
        slope = (magnitude(self.S) * (magnitude(self.A[j]) * self.T).exp()
                 * magnitude(change * self.whole[i] - self.A[j] * change)
                 * (magnitude(self.whole[i]) * self.T).exp() * magnitude(self.back))
        low = high = None
        for k in range(PIECES):
            t = self.T * (2 * k + 1) / (2 * PIECES)
            F = self.S * (self.A[j] * (self.T - t)).exp() * change * (self.whole[i] * t).exp() * self.back
            near = parts(F)
            spread = near.error + top(slope * (self.T / (2 * PIECES)))
            low = near.value - spread if low is None else np.minimum(low, near.value - spread)
            high = near.value + spread if high is None else np.maximum(high, near.value + spread)
        T = float(self.T.mid())
        middle, radius = (high + low) / 2, (high - low) / 2 * (1 + 1e-12)
        inside = arb_mat([row[:self.n] for row in change.tolist()])
        before = self.reached(i, self.w[i], exact(np.eye(self.n)))
        later = magnitude(self.S) * (magnitude(self.A[j]) * self.T).exp() * magnitude(inside) * before
        return Parts(T * middle, T * radius * (1 + 1e-12)), top(later * self.T)[:, 0]


class Step(Period):
    """The same of a discrete plant, x+ = A x + B u + shift + w; parameters as ``Period``."""

    def transition(self, q: int) -> arb_mat:
        """[Phi, Gamma, shift] of one mode."""
        return self.S * self.rows(self.whole[q]) * self.back

    def reached(self, q: int, w: arb_mat, S: arb_mat | None = None) -> arb_mat:
        """Bound of |S w|."""
        return magnitude(self.S if S is None else S) * w

    def largest(self, i: int, j: int) -> arb_mat:
        """The disturbance of the mode that takes the step."""
        return self.w[j]

    def jump(self, i: int, j: int) -> tuple[Parts, Array]:
        """Nothing is added."""
        zero = np.zeros((self.n, self.wide))
        return Parts(zero, zero), np.zeros(self.n)
