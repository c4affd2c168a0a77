"""Exact data of what depends on parameters or is only bounded: coefficients affine in theta, and radii.

A coefficient of the C is ``c(theta) = ((c0 + theta_1 c1) + ...)`` over a box of measured values. Everything that is
affine in theta has its extremes at the corners of the box, so bounds are taken there; a sum over columns is bounded
entry by entry, which is never too small.
"""

from __future__ import annotations

from itertools import product as corners_of

import numpy as np
from flint import fmpq

from ..algebra.interval import with_products
from .exact import Q, down, product, rational, up, zeros
from .rounding import input_error, sum_error

Array = np.ndarray
_FIELDS = ("A_theta", "B_theta", "A_unc", "B_unc", "A_rad", "B_rad", "theta_lo", "theta_hi")


def exact_mode(mode, sizes: tuple[int, int]) -> dict[str, Array]:
    """Rational matrices of a mode, with empty ones where it has no parameters and no unknowns."""
    n_x, n_u = sizes
    out = {k: rational(getattr(mode, k)) for k in
           ("A", "B", "C", "D", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi")}
    empty = {"A_theta": (0, n_x, n_x), "B_theta": (0, n_x, n_u), "A_unc": (0, n_x, n_x), "B_unc": (0, n_x, n_u),
             "A_rad": (n_x, n_x), "B_rad": (n_x, n_u), "theta_lo": (0,), "theta_hi": (0,)}
    for name in _FIELDS:
        value = getattr(mode, name, None)
        out[name] = zeros(*empty[name]) if value is None else rational(value)
    out["reach"] = [] if getattr(mode, "reach", None) is None else mode.reach
    out["products"] = getattr(mode, "products", ())
    out["paced"] = [int(j) for j in paced] if (paced := getattr(mode, "paced", None)) is not None else (
        [-1] * len(out["A_unc"]))
    out["box_lo"], out["box_hi"] = with_products(out["theta_lo"], out["theta_hi"], out["products"])
    return out


def computed_box(lo, hi, products, real: str) -> tuple[list, list]:
    """As ``with_products`` for products that are rounded: within the rounded products of the bounds."""
    n = len(lo)
    lo, hi = with_products(lo, hi, products)
    return [*lo[:n], *(Q(down(x, real)) for x in lo[n:])], [*hi[:n], *(Q(up(x, real)) for x in hi[n:])]


class Affine:
    """A matrix affine in theta over a box.

    Parameters
    ----------
    base : object array (r, c)
    slopes : sequence of object array (r, c)
    lo, hi : sequences of fmpq
        Box of theta.
    """

    def __init__(self, base: Array, slopes, lo, hi):
        self.base, self.slopes, self.lo, self.hi = base, list(slopes), list(lo), list(hi)
        middle, radius = base, abs(base) * 0
        for F, a, b in zip(self.slopes, self.lo, self.hi):
            middle = middle + (a + b) / 2 * F
            radius = radius + (b - a) / 2 * abs(F)
        self.middle, self.radius = middle, radius

    def most(self) -> Array:
        """Largest magnitude of each entry."""
        return abs(self.middle) + self.radius

    def least(self) -> Array:
        """Smallest value of each entry."""
        return self.middle - self.radius

    def largest(self) -> Array:
        """Largest value of each entry."""
        return self.middle + self.radius

    def corners(self) -> list[Array]:
        """The matrix at every corner of the box."""
        return [sum((v * F for v, F in zip(vertex, self.slopes)), self.base)
                for vertex in corners_of(*zip(self.lo, self.hi))]

    def rounding(self, real: str) -> Array:
        """Largest error of the computed coefficient, per entry; 0 where it does not depend on theta."""
        out = zeros(*self.base.shape)
        reach = [max(abs(a), abs(b)) for a, b in zip(self.lo, self.hi)]
        for index in np.ndindex(self.base.shape):
            terms = [(F[index], r) for F, r in zip(self.slopes, reach) if F[index] != 0]
            if terms:
                out[index] = sum_error([(self.base[index], fmpq(1)), *terms], real)[0]
        return out


class Scheduled:
    """The tables of one mode with their dependence on theta.

    Parameters
    ----------
    t : FramerTables
    q : int
    p : dict
        ``exact_mode`` of the mode.
    side : {"hi", "lo"}
    """

    def __init__(self, t, q: int, p: dict, side: str):
        vary = t.vary
        self.real, self.p = t.real, p
        self.lo, self.hi = ([], []) if vary is None else (rational(vary.theta_lo[q]), rational(vary.theta_hi[q]))
        base = {k: rational(getattr(t, f"{k}_{side}")[q]) for k in "MGLN"}
        self.N = base["N"]
        self.Z = None if t.change is None else rational(t.change.Z)
        # Three roundings at most stand between the parameter and what the step multiplies: the caller's, and the
        # mean of two samples.
        reach = [max(abs(a), abs(b)) for a, b in zip(self.lo, self.hi)]
        self.theta_error = [3 * input_error(r, self.real) for r in reach]
        products = () if vary is None else vary.products
        for j, k in products:  # of both factors, and of the multiplication
            a, b, e, f = reach[j], reach[k], self.theta_error[j], self.theta_error[k]
            self.theta_error.append(a * f + b * e + e * f + input_error((a + e) * (b + f), self.real))
        self.lo, self.hi = computed_box(self.lo, self.hi, products, self.real)
        for name in "MGL":
            slopes = [] if vary is None else [rational(s) for s in getattr(vary, name)[q]]
            slopes += [zeros(*base[name].shape)] * (len(self.lo) - len(slopes))  # L does not depend on products
            setattr(self, name, Affine(base[name], slopes, self.lo, self.hi))
        n_x, n_u = base["G"].shape
        self.E = zeros(*base["L"].shape) if vary is None else rational(vary.E[q])
        top = [] if vary is None or not vary.paced else rational(vary.top)
        for name, size in (("R", n_x), ("S", n_u)):
            radius = zeros(n_x, size) if vary is None else rational(getattr(vary, name)[q])
            steps = [] if vary is None or not vary.paced else [rational(s) for s in getattr(vary, f"{name}_pace")[q]]
            setattr(self, name, Affine(radius, steps, [fmpq(0)] * len(top), top))

    def of_x(self, M: Array) -> Array:
        """What multiplies x where M multiplies the state of the recursion: M Z with a change of coordinates."""
        return M if self.Z is None else product(M, self.Z)

    def leftover(self, T: Array) -> tuple[Affine, Affine]:
        """T A(theta) - L(theta) C - M(theta) and T B(theta) - L(theta) D - G(theta), exact."""
        p = self.p
        EM = product(T, p["A"]) - product(self.L.base, p["C"]) - self.of_x(self.M.base)
        EG = product(T, p["B"]) - product(self.L.base, p["D"]) - self.G.base
        slopes_M = [product(T, a) - product(L, p["C"]) - self.of_x(M)
                    for a, L, M in zip(p["A_theta"], self.L.slopes, self.M.slopes)]
        slopes_G = [product(T, b) - product(L, p["D"]) - G
                    for b, L, G in zip(p["B_theta"], self.L.slopes, self.G.slopes)]
        return Affine(EM, slopes_M, self.lo, self.hi), Affine(EG, slopes_G, self.lo, self.hi)

    def drift(self, T: Array) -> tuple[Array, Array]:
        """What an error of theta by its rounding changes in T A and T B, elementwise."""
        out = []
        for name in ("A", "B"):
            total = abs(product(T, self.p[name])) * 0
            for e, F in zip(self.theta_error, self.p[f"{name}_theta"]):
                total = total + e * abs(product(T, F))
            out.append(total)
        return out[0], out[1]

    def unknown(self, T: Array, which: int | None = None) -> tuple[Array, Array]:
        """Elementwise bound on what the unknowns do: sum |T A_unc| + |T| A_rad, and the same of B.

        ``which`` is a paced parameter: its unknowns only; -1: all that are not paced, with the radius; None: all.
        """
        out = []
        for name in ("A", "B"):
            total = product(abs(T), self.p[f"{name}_rad"]) * (0 if which is not None and which >= 0 else 1)
            for of, F in zip(self.p["paced"], self.p[f"{name}_unc"]):
                if which is None or of == which:
                    total = total + abs(product(T, F))
            out.append(total)
        return out[0], out[1]


def pace_needed(pace: float, reach: fmpq, most: fmpq, real: str) -> fmpq:
    """Smallest ``top`` with which the computed g is never below 1 - (change / reach)^2.

    The C computes ``top - (change pace)^2``; both ends of the step and every operation round, and only changes up to
    the reach count.

    Parameters
    ----------
    pace : float
        Must be at most 1 / reach.
    reach : fmpq
        Largest change over a step.
    most : fmpq
        Largest magnitude of the parameter.
    real : {"float32", "float64"}
    """
    pace = Q(pace)
    if pace * reach > 1:
        return fmpq(10)
    slip = 2 * input_error(most, real)  # of the difference: both ends, and its own rounding
    slip += input_error(reach + slip, real)
    scaled = (reach + slip) * pace
    # (change pace)^2 <= (change/reach)^2, and for |change| <= reach the square grows by no more than at its end.
    return 1 + scaled**2 - (reach * pace) ** 2 + pace_rounding(scaled, real)


def pace_rounding(scaled: fmpq, real: str) -> fmpq:
    """Largest rounding error of ``top - (change pace)^2`` for |change pace| up to ``scaled`` and top up to 2."""
    slip = input_error(scaled, real)
    square = (scaled + slip) ** 2
    return square - scaled**2 + input_error(square, real) + input_error(2 + square, real)


def noise_size(p: dict) -> Array:
    """Largest |Dv (v - middle)| of each output."""
    half = (p["v_hi"] - p["v_lo"]) / 2
    return product(abs(p["Dv"]), half.reshape(-1, 1)).ravel()


def noise_need(s: Scheduled, p: dict, sign: int) -> Array:
    """Largest sign * (-L(theta) Dv v) of each row that the tables do not add at run time."""
    middle, half = (p["v_lo"] + p["v_hi"]) / 2, noise_size(p)
    n_x, n_y = s.L.base.shape
    shift = product(p["Dv"], middle.reshape(-1, 1))
    moved = Affine(-sign * product(s.L.base, shift), [-sign * product(L, shift) for L in s.L.slopes], s.lo, s.hi)
    out, most = moved.largest().ravel(), s.L.most()
    for i in range(n_x):
        for j in range(n_y):
            lack = half[j] - s.E[i, j]
            out[i] += most[i, j] * lack if lack > 0 else fmpq(0)
    return out


def pairs(coefficients: Affine, i: int, bounds, real: str) -> tuple[list, fmpq]:
    """Terms of row i for ``sum_error``, and the error that computed coefficients add."""
    most, slip = coefficients.most()[i], coefficients.rounding(real)[i]
    extra = sum((e * b for e, b in zip(slip, bounds)), fmpq(0))
    return [(c + e, b) for c, e, b in zip(most, slip, bounds)] if coefficients.slopes else list(
        zip(coefficients.base[i], bounds)), extra

