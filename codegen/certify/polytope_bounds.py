r"""What moves the error of a polytopic observer at most, on the numbers of the C: what thresholds rest on.

With eb = T1 E x - z (``polytope_error``), the plant at vertex i and the observer at vertex j, exactly,

    eb+ = N_j eb + M_ij x + B_ij u + D_ij d + rounding,      M r = O eb + (what x and d do to it) + rounding,

and what plant and observer do with any weights is a mean of these. x, u, d are in their ranges: each is a middle, one
column of W for all of them, and half widths, one column each. Nothing is said of how the weights move, so the set that
``filter_bounds`` finds holds for every pair at every sample.

A continuous plant moves between samples. Its mean weights and disturbance over a period are weights and a disturbance
again, so that only the change of x since the sample is left over: T1 sum_i h_i A_i (x(t) - x), see ``polytope_drift``.

Faults of sensors that are part of the state drive nothing but what rounding leaves of T1 E + T2 C = I, and where they
act on the state too, that; the weights are those of x_hat, which is x less the error, fault or not. So the bounds hold
for every course of the faults within their ranges, of the residual less what the faults do to y.

Rounding is bounded in ``polytope_rounding``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .exact import Q, eye, product, rational, zeros
from .filter_model import JointMode
from .polytope_drift import Drift, drift
from .polytope_error import ErrorModel, of_faults, standard_errors
from .polytope_ranges import Ranges, columns, largest
from .polytope_rounding import Rounding, rounding

Array = np.ndarray


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
    if t.faults:  # r is held against what they do to y, fault or not
        seen[:, n:2 * n] -= product(M, of_faults(problem, t.faults))
    noise = [product(M, eye(p) - product(C, T2)) * slip.y, product(M, C) * slip.x_hat, M * slip.r,
             eye(p) * slip.weighted]
    room = abs(columns([(seen[:, n:2 * n], box.x), (seen[:, 2 * n:2 * n + m], box.u), (seen[:, 2 * n + m:], box.d)],
                       noise)).sum(axis=1)
    out = []
    for (_, j), (A, B) in errors.pairs.items():
        W = parts.driven(problem, t, j, errors.T1[j % len(errors.T1)], A[:n, n:], B[:n])
        out.append(JointMode(A[:n, :n], W, (), seen[:, :n], zeros(p, n), room))
    return tuple(out), product(errors.T1[0], rational(problem.E))
