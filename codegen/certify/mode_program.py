"""Linear programs whose answers are sure: infeasible by a witness (Farkas) that is checked in rational numbers.

The solver's multipliers, made nonnegative, prove by themselves that there is no solution, or none of a larger cost.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from ..algebra.interval import neg, pos
from .exact import Q

Array = np.ndarray
#: A witness must be worth this much before it is checked exactly.
WORTH = 1e-9


class Program:
    """Rows a'z <= b over boxed variables.

    Parameters
    ----------
    kept : dict or None
        Takes what proves something: name -> (program, multipliers, cost).
    name : str
        Under which it is kept.
    """

    def __init__(self, kept: dict | None = None, name: str = ""):
        self.kept, self.name = kept, name
        self.lo: list[float] = []
        self.hi: list[float] = []
        self.rows: list[dict[int, float]] = []
        self.right: list[float] = []

    def variables(self, lo, hi) -> Array:
        """Indices of new variables with bounds."""
        first = len(self.lo)
        self.lo += [float(x) for x in lo]
        self.hi += [float(x) for x in hi]
        return np.arange(first, len(self.lo))

    def below(self, terms, right) -> None:
        """Rows sum of M z[idx] <= right, for (M, idx) in terms; M may have one row per entry of right."""
        for r, b in enumerate(np.atleast_1d(right)):
            row: dict[int, float] = {}
            for M, idx in terms:
                for a, i in zip(np.atleast_2d(M)[r], idx):
                    if a != 0.0:
                        row[int(i)] = row.get(int(i), 0.0) + float(a)
            # Products of two table entries are rounded once; what that can do to the row is let go.
            slip = 4e-16 * sum(abs(a) * max(abs(self.lo[i]), abs(self.hi[i])) for i, a in row.items())
            self.rows.append(row)
            self.right.append(float(b) + slip)

    def infeasible(self) -> bool:
        """Whether it surely has no solution: by a witness that is checked exactly."""
        data = [(r, i, a) for r, row in enumerate(self.rows) for i, a in row.items()]
        r, i, a = (np.array(x) for x in zip(*data))
        m, n = len(self.rows), len(self.lo)
        # Least violation t >= 0 of all rows at once; its dual is the witness.
        A = csr_matrix((np.concatenate([a, -np.ones(m)]),
                        (np.concatenate([r, np.arange(m)]), np.concatenate([i, np.full(m, n)]))), shape=(m, n + 1))
        bounds = [*zip(self.lo, self.hi), (0.0, None)]
        found = linprog(np.r_[np.zeros(n), 1.0], A_ub=A, b_ub=self.right, bounds=bounds, method="highs")
        if not found.success or found.fun <= WORTH:
            return False
        y = np.maximum(-found.ineqlin.marginals, 0.0)
        sure = self.witnessed(y)
        if sure and self.kept is not None:
            self.kept[self.name] = self, y, None
        return sure

    def most(self, cost: dict[int, float], name: str = "") -> float:
        """A sure upper bound of a linear function over the solutions; minus infinity where there surely is none."""
        data = [(r, i, a) for r, row in enumerate(self.rows) for i, a in row.items()]
        r, i, a = (np.array(x) for x in zip(*data))
        c = np.zeros(len(self.lo))
        c[list(cost)] = list(cost.values())
        A = csr_matrix((a, (r, i)), shape=(len(self.rows), len(c)))
        found = linprog(-c, A_ub=A, b_ub=self.right, bounds=[*zip(self.lo, self.hi)], method="highs")
        if not found.success and self.infeasible():
            return -np.inf
        y = np.maximum(-found.ineqlin.marginals, 0.0) if found.success else np.zeros(len(self.rows))
        if self.kept is not None:
            self.kept[f"{self.name} {name}"] = self, y, cost
        # Weak duality in floats, outward: y'b + max over the box of (c - A'y)'z.
        rest = c - A.T @ y
        slip = 1e-13 * (np.abs(c) + np.abs(A.T) @ y)
        sizes = np.maximum(np.abs(self.lo), np.abs(self.hi))
        top = y @ self.right + pos(rest) @ self.hi - neg(rest) @ self.lo + slip @ sizes
        return float(top + 1e-12 * (y @ np.abs(self.right)))

    def witnessed(self, y) -> bool:
        """Whether min over the box of y'A z exceeds y'b, exactly; y >= 0."""
        return self.exactly(y, {}) < 0

    def exactly(self, y, cost: dict[int, float]) -> fmpq:
        """Return y'b + max over the box of (cost - y'A) z, exactly: no solution has a larger cost."""
        total: dict[int, fmpq] = {i: -Q(c) for i, c in cost.items()}
        right = fmpq(0)
        for weight, row, b in zip(y, self.rows, self.right):
            if weight > 0:
                weight = Q(weight)
                right += weight * Q(b)
                for i, a in row.items():
                    total[i] = total.get(i, fmpq(0)) + weight * Q(a)
        least = fmpq(0)
        for i, a in total.items():
            least += a * (Q(self.lo[i]) if a > 0 else Q(self.hi[i]))
        return right - least


def outward(value: Array) -> Array:
    """Right sides a little larger: float sums of table entries must not lose anything."""
    return value + 1e-12 * np.abs(value) + 1e-300
