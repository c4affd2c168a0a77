"""The transition of a continuous plant over one sampling period, term by term, in balls; see ``sampling``."""

from __future__ import annotations

import numpy as np
from flint import arb

Array = np.ndarray
#: Terms of the series; what is beyond is bounded by its tail.
TERMS = 14


def balls(array) -> Array:
    """Object array of exact balls."""
    array = np.asarray(array, dtype=float)
    out = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        out[index] = arb(float(array[index]))
    return out


def mul(A: Array, B: Array) -> Array:
    """Matrix product of balls; an empty inner dimension gives zeros."""
    return balls(np.zeros((A.shape[0], B.shape[1]))) if A.shape[1] == 0 else A @ B


def size(A: Array) -> Array:
    """Elementwise magnitude."""
    return np.array([abs(a) for a in A.ravel()], dtype=object).reshape(A.shape)


def ceiling(A: Array) -> Array:
    """Upper ends of the balls, as float64 rounded up."""
    out = np.array([float(a.upper()) for a in A.ravel()]).reshape(A.shape)
    return np.where(out > 0, np.nextafter(out, np.inf), 0.0)


def middles(A: Array) -> tuple[Array, Array]:
    """Float64 near the middle of each ball, and a bound on its distance from all of the ball."""
    near = np.array([float(a.mid()) for a in A.ravel()]).reshape(A.shape)
    return near, ceiling(size(A - balls(near)))


class Period:
    """The transition of [x; u] over one period in one mode.

    Parameters
    ----------
    Fc, slopes : object arrays (m, m), (J, m, m)
        Middle, and effect of the known parameters.
    known, average, excursion : object arrays (J,)
        Largest |p_j|, and of theta_j - p_j the largest mean and magnitude over the period.
    unknown : object array (S, m, m)
        Effect of what is not known at all, scaled to |s_l| <= 1.
    h : arb
    order : int
    products : tuple of (int, int)
        Pairs of known parameters whose product is computed; empty: bounded.
    """

    def __init__(self, Fc, slopes, known, average, excursion, unknown, h, order, products=()):
        self.Fc, self.slopes, self.h, self.order, self.products = Fc, slopes, h, order, products
        self.average, self.unknown, self.known = average, unknown, known
        m = Fc.shape[0]
        zero = balls(np.zeros((m, m)))
        self.Fb = size(Fc)
        self.Tb = sum((k * size(F) for k, F in zip(known, slopes)), zero)
        self.Db = sum((e * size(F) for e, F in zip(excursion, slopes)), zero) + sum(map(size, unknown), zero)
        self.powers = [balls(np.eye(m))]
        for _ in range(TERMS):
            self.powers.append(mul(self.powers[-1], Fc))
        self.weight = [arb(1)]
        for k in range(1, 2 * TERMS):
            self.weight.append(self.weight[-1] * h / k)

    def series(self, terms) -> Array:
        """Sum of weight[k] * terms[k]."""
        return sum((self.weight[k] * term for k, term in terms), 0 * self.Fc)

    def nominal(self) -> Array:
        """Phi0, with the middle of the squares p_j^2 of the second order."""
        out = self.series((k, self.powers[k]) for k in range(self.order + 1))
        if self.order >= 2 and not self.products:
            for k, F in zip(self.known, self.slopes):
                out = out + self.weight[2] * k * k / 2 * mul(F, F)
        return out

    def derivative(self, F: Array, order: int) -> Array:
        """Derivative of the truncated exponential in the direction F: sum_k h^k/k! sum_{a+b=k-1} Fc^a F Fc^b."""
        return self.series((k, sum((mul(mul(self.powers[a], F), self.powers[k - 1 - a]) for a in range(k)),
                                   0 * self.Fc)) for k in range(1, order + 1))

    def second(self, j: int, k: int) -> Array:
        """Coefficient of p_j p_k: all words with these two and any number of Fc, up to the order."""
        F = self.slopes
        out, plain, with_j, with_k, both = 0 * self.Fc, self.powers[0], 0 * self.Fc, 0 * self.Fc, 0 * self.Fc
        for n in range(1, self.order + 1):
            both = mul(both, self.Fc) + mul(with_j, F[k]) + (mul(with_k, F[j]) if j != k else 0 * self.Fc)
            with_j, with_k = (mul(w, self.Fc) + mul(plain, F[i]) for w, i in ((with_j, j), (with_k, k)))
            plain = self.powers[n]
            out = out + self.weight[n] * both
        return out

    def unknowns(self) -> list[tuple[int, Array]]:
        """First-order effect of each unknown, |s_l| <= 1; time weighted evenly, the rest is in the radius.

        Beside it the known parameter whose mean over the period it is; -1: none.
        """
        first = [(-1, self.weight[1] * F) for F in self.unknown]
        first += [(j, a * F) for j, (a, F) in enumerate(zip(self.average, self.slopes)) if a.upper() > 0]
        if self.order >= 2 and not self.products:  # p_j^2 is in [0, known^2]: half the range is a radius
            first += [(-1, self.weight[2] * k * k / 2 * mul(F, F)) for k, F in zip(self.known, self.slopes)]
        return first

    def radius(self) -> Array:
        """Everything else, elementwise."""
        Fb, Tb, Db, order = self.Fb, self.Tb, self.Db, self.order
        whole, plain, middle = Fb + Tb + Db, Fb, Fb + Tb
        powers = {name: [balls(np.eye(len(Fb)))] for name in ("whole", "plain", "middle")}
        for _ in range(TERMS):
            for name, base in (("whole", whole), ("plain", plain), ("middle", middle)):
                powers[name].append(mul(powers[name][-1], base))
        out, degree = 0 * Fb, [powers["plain"][1], Tb, 0 * Fb]
        for k in range(2, TERMS + 1):
            degree = [mul(x, Fb) + y for x, y in zip(degree, (0 * Fb, *(mul(x, Tb) for x in degree)))]
            # Unknown at least once, from the second order on.
            term = powers["whole"][k] - powers["middle"][k]
            if k <= order:
                # Known parameters twice or more; of the second order the squares p_j^2 are treated apart.
                term = term + powers["middle"][k] - degree[0] - degree[1] - (degree[2] if self.products else 0 * Fb)
                if k == 2 and not self.products:
                    for kj, Fj in zip(self.known, self.slopes):
                        term = term - kj * kj * mul(size(Fj), size(Fj))
            else:
                term = term + powers["middle"][k]
            out = out + self.weight[k] * term
        return out + self.tail(whole, TERMS)

    def tail(self, base: Array, terms: int) -> Array:
        """Bound on sum_{k > terms} h^k/k! base^k, elementwise: a geometric series of the largest row sum."""
        row = max(float((sum(r, arb(0))).upper()) for r in base) if base.size else 0.0
        step = arb(row) * self.h
        ratio = step / (terms + 2)
        if not ratio.upper() < 0.5:
            raise OverflowError
        rest = step ** (terms + 1) / arb.fac_ui(terms + 1) / (1 - ratio)
        return np.full(base.shape, arb(rest.upper()), dtype=object)


def upper(x: arb) -> float:
    """Upper end of a ball."""
    return float(x.upper())
