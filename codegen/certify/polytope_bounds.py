r"""What moves the error of a polytopic observer at most, on the numbers of the C: what thresholds rest on.

With eb = T1 E x - z (``polytope_error``), the plant at vertex i and the observer at vertex j, exactly,

    eb+ = N_j eb + M_ij x + B_ij u + D_ij d + rounding,      M r = O eb + (what x and d do to it) + rounding,

and what plant and observer do with any weights is a mean of these. x, u, d are in their ranges: each is a middle, one
column of W for all of them, and half widths, one column each. Nothing is said of how the weights move, so the set that
``filter_bounds`` finds holds for every pair at every sample.

A continuous plant moves between samples. Its mean weights and disturbance over a period are weights and a disturbance
again, so that only the change of x since the sample is left over: T1 sum_i h_i A_i (x(t) - x), see ``polytope_drift``.

Rounding: every sum of the C in its order (``rounding.sum_error``), what conversion does to u and y, and weights whose
sum is not 1: ``weight_program`` makes them numbers in [0, 1], and their sum is 1 but for the rounding of a tree of
products, or found to be so by the C itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from .exact import Q, eye, product, rational, zeros
from .filter_model import JointMode
from .polytope_drift import Drift, drift
from .polytope_error import ErrorModel, standard_errors
from .polytope_ranges import Ranges, columns, largest
from .rounding import UNIT, input_error, sum_error

Array = np.ndarray


@dataclass(frozen=True)
class Rounding:
    """What the C may be off by; rational object arrays.

    Parameters
    ----------
    y : ndarray (p,), u : ndarray (m,)
        Of the numbers that it is given.
    x_hat : ndarray (n,), r : ndarray (p,), weighted : ndarray (p,), z : ndarray (n,)
        Of its sums, that of z with weights that do not add up to 1.
    """

    y: Array
    u: Array
    x_hat: Array
    r: Array
    weighted: Array
    z: Array


def sizes(lo: Array, hi: Array) -> Array:
    """Largest magnitudes of ranges, exactly."""
    return np.array([max(abs(Q(a)), abs(Q(b))) for a, b in zip(lo, hi)], dtype=object).reshape(len(lo))


def rounding(t, known=()) -> Rounding:
    """Bound what the C of tables rounds, in its order of evaluation.

    Parameters
    ----------
    t : PolytopicTables
    known : sequence of fmpq
        Largest magnitudes of the known terms.
    """
    real, z, y, u = t.real, sizes(t.z_lo, t.z_hi), sizes(t.y_lo, t.y_hi), sizes(t.u_lo, t.u_hi)

    def row(coefficients, operands, first=()):
        return sum_error([*first, *((Q(c), b) for c, b in zip(coefficients, operands))], real)

    x_hat = [row(t.T2[i], y, [(fmpq(1), z[i])]) for i in range(len(z))]
    most = [m for _, m in x_hat]
    r = [row(t.C[i], most, [(fmpq(1), y[i])]) for i in range(len(y))]
    weighted = [row(M, [m for _, m in r]) for M in t.M] if t.weighted else [(fmpq(0), m) for _, m in r]
    operands = [*most, *u, *(m for _, m in r), *known]
    # |sum h - 1|: what the C accepts, and the rounding of the sum that it looked at.
    off = (8 * len(t.F) + 4) * 2 * UNIT[real]
    after = []
    for i in range(len(z)):
        own = [row(np.where(t.shared[i], 0, M[i]), operands) for M in t.gains]
        terms = [(Q(c), b) for c, b in zip(np.where(t.shared[i], t.gains[0, i], 0), operands)]
        error, _ = sum_error([*terms, *((1 + off, m) for _, m in own)], real)
        after.append(error + (1 + off) * max(e for e, _ in own) + off * max(m for _, m in own))
    vectors = [[input_error(b, real) for b in y], [input_error(b, real) for b in u],
               *([e for e, _ in values] for values in (x_hat, r, weighted)), after]
    return Rounding(*(np.array(v, dtype=object).reshape(len(v)) for v in vectors))


@dataclass(frozen=True)
class Parts:
    """What the recursion of eb is made of.

    Parameters
    ----------
    errors : ErrorModel
    box : Ranges
    slip : Rounding
    moved : Drift or None
        Of a continuous plant.
    period : float or None
    """

    errors: ErrorModel
    box: Ranges
    slip: Rounding
    moved: Drift | None
    period: float | None

    @classmethod
    def of(cls, plant, problem, t, T1: Array, period: float | None) -> Parts:
        """Those of an observer; arguments as for `model`."""
        box = Ranges.of(plant, problem)
        return cls(standard_errors(problem, t, T1, period), box, rounding(t),
                   None if period is None else drift(plant, problem, box, period), period)

    def driven(self, problem, t, j: int, T1: Array, A: Array, B: Array) -> Array:
        """Columns of what moves eb beside itself, the observer at vertex j.

        Parameters
        ----------
        problem : DescriptorProblem
        t : PolytopicTables
        j : int
        T1 : object array (n, n)
            That the plant's flow is taken by.
        A : object array (n, n), B : object array (n, m + q)
            Of x, and of u and d.
        """
        n, m, p = len(problem.E), problem.B.shape[2], len(problem.C)
        F, K, C, T2, G = (rational(getattr(t, key)) for key in ("F", "K", "C", "T2", "G"))
        slip, passed = self.slip, eye(p) - product(C, T2)  # what an error of y is in r
        own = [(product(F[j], T2) - product(K[j], passed)) * slip.y, G[j] * slip.u,
               (F[j] + product(K[j], C)) * slip.x_hat, K[j] * slip.r, eye(n) * slip.z]
        if self.moved is not None:
            change = largest([self.moved.of(product(T1, rational(a))) for a in problem.A])
            own.append(eye(n) * (Q(self.period) * change))
        return columns([(A, self.box.x), (B[:, :m], self.box.u), (B[:, m:], self.box.d)], own)


def model(plant, problem, t, T1: Array, period: float | None,
          parts: Parts | None = None) -> tuple[tuple[JointMode, ...], Array]:
    """The recursion of eb, one entry per pair of vertices, and T1 E.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    T1 : ndarray (n, n) or (h, n, n)
        As for ``polytope_error.standard_errors``.
    period : float or None
        Of a continuous plant.
    parts : Parts, optional
        Where they are at hand.

    Returns
    -------
    model : tuple of JointMode
        What it estimates is M r.
    T1E : object array (n, n)
    """
    parts = Parts.of(plant, problem, t, T1, period) if parts is None else parts
    errors, box, slip = parts.errors, parts.box, parts.slip
    n, m, p = len(problem.E), problem.B.shape[2], len(problem.C)
    C, T2, M = (rational(getattr(t, key)) for key in ("C", "T2", "M"))
    seen = product(M, errors.residual)
    noise = [product(M, eye(p) - product(C, T2)) * slip.y, product(M, C) * slip.x_hat, M * slip.r,
             eye(p) * slip.weighted]
    room = abs(columns([(seen[:, n:2 * n], box.x), (seen[:, 2 * n:2 * n + m], box.u), (seen[:, 2 * n + m:], box.d)],
                       noise)).sum(axis=1)
    out = []
    for (_, j), (A, B) in errors.pairs.items():
        W = parts.driven(problem, t, j, errors.T1[j % len(errors.T1)], A[:n, n:], B[:n])
        out.append(JointMode(A[:n, :n], W, (), seen[:, :n], zeros(p, n), room))
    return tuple(out), product(errors.T1[0], rational(problem.E))
