"""Do the constants of ``mode-set`` hold the plant? Checked anew in ball arithmetic, without the code that made them.

The period is cut into pieces of time whose exponentials are enclosed as balls, so that a switch at any instant is met.
What rounding can do is gamma_k = k u / (1 - k u) times the magnitudes of the terms (u the unit roundoff, k roundings
in a row; fused or not), with the inputs and measurements rounded to the type when they are read.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat, ctx

from ..errors import CertificateError

Array = np.ndarray
PIECES = 64
PRECISION = 128


def ball(M: Array) -> Array:
    """Exact balls of floats, as an object array."""
    M = np.asarray(M, dtype=float)
    out = np.empty(M.shape, dtype=object)
    for index in np.ndindex(M.shape):
        out[index] = arb(float(M[index]))
    return out


def size(M: Array) -> Array:
    """Magnitudes, rounded up, as balls without radius."""
    out = np.empty(M.shape, dtype=object)
    for index in np.ndindex(M.shape):
        out[index] = abs(M[index]).abs_upper()
    return out


def exponential(M: Array, t: arb) -> Array:
    """e^{M t} for all t of a ball."""
    found = (arb_mat([[x for x in row] for row in M.tolist()]) * t).exp().tolist()
    return np.array(found, dtype=object).reshape(M.shape)


def largest(*arrays: Array) -> Array:
    """Elementwise largest of balls without radius."""
    out = arrays[0].copy()
    for other in arrays[1:]:
        for index in np.ndindex(out.shape):
            out[index] = other[index] if other[index] > out[index] else out[index]
    return out


class Enclosure:
    """The exact plant in the coordinates of the tables, and the demands on these.

    Parameters
    ----------
    plant : Plant
        Without parameters; continuous here.
    t : ModeTables
    """

    def __init__(self, plant, t):
        self.left: list[tuple[str, float, str]] = []  # what, by how much it holds at least, where
        self.plant, self.t, self.names = plant, t, [m.name for m in plant.modes]
        self.n, self.n_u, self.p = plant.n_x, plant.n_u, plant.n_y
        self.T, self.S = arb(float(plant.sample_period)), ball(t.S)
        try:
            inverse = arb_mat(self.S.tolist()).inv()
        except ZeroDivisionError:
            raise CertificateError("certificate: the coordinates S have no inverse.") from None
        self.inverse = np.array(inverse.tolist(), dtype=object).reshape(self.n, self.n)
        self.limit, self.u = ball(t.limit), largest(size(ball(t.u_lo)), size(ball(t.u_hi))) if self.n_u else ball([])
        self.unit = arb(float(np.finfo(t.real).eps)) / 2
        self.tiny = arb(float(np.finfo(t.real).smallest_subnormal)) * (4 * (self.n + self.n_u) + 16)
        wide = self.n + self.n_u + 1
        self.whole, self.A, self.w = [], [ball(m.A) for m in plant.modes], []
        for m in plant.modes:
            lo, hi = ball(m.w_lo), ball(m.w_hi)
            M = ball(np.zeros((wide, wide)))
            M[:self.n, :self.n], M[:self.n, self.n:-1] = ball(m.A), ball(m.B)
            M[:self.n, -1] = self.times(ball(m.Bw), (lo + hi) / 2)
            self.whole.append(M)
            self.w.append(size(self.times(size(ball(m.Bw)), (hi - lo) / 2)))
        self.back = ball(np.eye(wide))
        self.back[:self.n, :self.n] = self.inverse
        half = self.T / (2 * PIECES)
        self.pieces = [arb(float((half * (2 * k + 1)).mid()), float((half * 1.0001).abs_upper()))
                       for k in range(PIECES)]
        self.powers = [[exponential(A, s) for s in self.pieces] for A in self.A]

    @staticmethod
    def times(A: Array, x: Array) -> Array:
        """A x; zeros where there is nothing to sum."""
        return A @ x if A.shape[1] else np.array([arb(0)] * A.shape[0], dtype=object)

    def gamma(self, k: int) -> arb:
        """Bound of the relative error of k roundings in a row."""
        return k * self.unit / (1 - k * self.unit)

    def demand(self, what: str, given: Array, least: Array) -> None:
        """Raise where a constant is not surely as large as it must be."""
        for index in np.ndindex(given.shape):
            if not least[index] <= arb(float(given[index])):
                raise CertificateError(f"certificate: {what}{[int(i) for i in index]} is {float(given[index]):.9g}, at "
                                       f"least {float(least[index].abs_upper()):.9g} expected: the true mode could be "
                                       "dropped. Design again.")
            self.note(what, arb(float(given[index])) - least[index], f"{what}{[int(i) for i in index]}")

    def note(self, what: str, left: arb, where: str) -> None:
        """Keep by how much a condition holds, rounded down."""
        least = left.lower()
        value = float(least)
        self.left.append((what.split()[0], value if arb(value) <= least else float(np.nextafter(value, -np.inf)),
                          where))

    def inside(self, what: str, lo: Array, hi: Array, middle: Array, radius: Array) -> None:
        """Raise where [lo, hi] does not hold middle +- radius."""
        for i in range(len(lo)):
            if not (arb(float(lo[i])) <= middle[i] - radius[i] and middle[i] + radius[i] <= arb(float(hi[i]))):
                raise CertificateError(f"certificate: {what}[{i}] is [{float(lo[i]):.9g}, {float(hi[i]):.9g}], it does "
                                       f"not hold {middle[i].str(9)} +- {radius[i].str(9)}. Design again.")
            self.note(what, middle[i] - radius[i] - arb(float(lo[i])), f"{what}_lo[{i}]")
            self.note(what, arb(float(hi[i])) - (middle[i] + radius[i]), f"{what}_hi[{i}]")

    def reached(self, q: int, w: Array, S: Array) -> Array:
        """Bound of |int S e^{A s} w(s) ds| over the period, |w| given."""
        total = sum(size(S @ power) for power in self.powers[q])
        return size(self.times(total, w) * (self.T / PIECES))

    def check(self) -> None:
        """Every demand.

        Raises
        ------
        CertificateError
        """
        before, ctx.prec = ctx.prec, PRECISION
        try:
            self.boxes()
            self.measurement()
            self.answer()
            for q in range(len(self.A)):
                base, error = self.transition(q)
                for i in range(len(self.A)):
                    if i != q:
                        self.birth(i, q, base, error)
        finally:
            ctx.prec = before

    def box(self, lo: Array, hi: Array) -> tuple[Array, Array]:
        """Middle and radius of S x over a box."""
        lo, hi = ball(lo), ball(hi)
        return self.S @ ((lo + hi) / 2), size(self.S) @ ((hi - lo) / 2)

    def boxes(self) -> None:
        """Start and restart hold what is declared; what boxes are cut to holds both."""
        t, plant = self.t, self.plant
        if any(not np.array_equal(t.S[:self.p], m.C) for m in plant.modes):
            raise CertificateError("certificate: the first coordinates are not the outputs C x.")
        self.inside("start", t.start_lo, t.start_hi, *self.box(plant.x0_lo, plant.x0_hi))
        self.inside("wide", t.wide_lo, t.wide_hi, *self.box(*plant.limits("x")))
        most = np.max(np.abs([t.start_lo, t.start_hi, t.wide_lo, t.wide_hi]), axis=0)
        self.demand("limit", t.limit, ball(most))

    def measurement(self) -> None:
        """The cut with y, read and calculated in the type, keeps C x."""
        m, t = self.plant.modes[0], self.t
        lo, hi, Dv = ball(m.v_lo), ball(m.v_hi), ball(m.Dv)
        middle, radius = self.times(Dv, (lo + hi) / 2), self.times(size(Dv), (hi - lo) / 2)
        x = np.max(np.abs(self.plant.limits("x")), axis=0)
        part = size(self.times(ball(m.D), self.u)) if self.n_u else ball(np.zeros(self.p))
        part = part + (size(ball(np.abs(m.D))) @ self.u if self.n_u else part)
        y = size(ball(m.C)) @ ball(x) + part + size(middle) + radius
        lost = self.gamma(self.n_u + 6) * (2 * y + part) + self.tiny
        if self.n_u:
            lost = lost + size(ball(m.D) - ball(t.D)) @ self.u
        self.inside("v", t.v_lo, t.v_hi, middle, size(radius + lost))

    def answer(self) -> None:
        """The bounds of x hold what the boxes of xi do."""
        inverse = ball(self.t.S_inverse)
        x = ball(np.max(np.abs(self.plant.limits("x")), axis=0))
        lost = size(inverse @ self.S - ball(np.eye(self.n))) @ x
        lost = lost + self.gamma(self.n + 2) * (size(inverse) @ self.limit + ball(self.t.x_room)) + self.tiny
        self.demand("x_room", self.t.x_room, lost)

    def flow(self, q: int) -> Array:
        """[x; u; 1] to x over a period of one mode."""
        return exponential(self.whole[q], self.T)[:self.n]

    def transition(self, q: int) -> tuple[Array, Array]:
        """Demand on ``reach``; magnitude of the terms, and what the rounded matrices lose."""
        t, n, n_u = self.t, self.n, self.n_u
        M = self.S @ self.flow(q) @ self.back
        Phi, Gamma, shift = ball(t.Phi[q]), ball(t.Gamma[q]), ball(t.shift[q])
        lost = size(M[:, :n] - Phi) @ self.limit + size(M[:, -1] - shift)
        lost = lost + self.times(size(M[:, n:n + n_u] - Gamma), self.u)
        terms = size(Phi) @ self.limit + self.times(size(Gamma), self.u) + size(shift)
        lost = lost + self.unit * self.times(size(Gamma), self.u) + self.tiny
        need = self.reached(q, self.w[q], self.S) + lost
        need = need + self.gamma(n + n_u + 3) * (terms + ball(t.reach[q]))
        self.demand(f'reach of mode "{self.names[q]}"', t.reach[q], size(need))
        return terms, lost

    def birth(self, i: int, j: int, base: Array, lost: Array) -> None:
        """Demands on what a switch from i to j at any instant of the period adds."""
        t, n, n_u = self.t, self.n, self.n_u
        change = (self.whole[i] - self.whole[j])[:n]
        slope = change @ self.whole[i] - self.A[j] @ change
        near = arb(0, float(self.pieces[0].rad()))
        lo = hi = None
        later = ball(np.zeros(n))
        before = self.reached(i, self.w[i], ball(np.eye(n)))
        for k, at in enumerate(self.pieces):
            rest = self.S @ self.powers[j][PIECES - 1 - k]
            # On a piece: the value at its middle, and its derivative anywhere in it.
            whole, middle = exponential(self.whole[i], at), exponential(self.whole[i], at.mid())
            F = self.S @ exponential(self.A[j], self.T - at.mid()) @ change @ middle + near * (rest @ slope @ whole)
            F = self.T * (F @ self.back)
            later = largest(later, size(self.T * (size(rest @ change[:, :n]) @ before)))
            ends = [np.array([getattr(x, end)() for x in F.ravel()], dtype=object).reshape(F.shape)
                    for end in ("lower", "upper")]
            lo = ends[0] if lo is None else -largest(-lo, -ends[0])
            hi = ends[1] if hi is None else largest(hi, ends[1])
        J = np.column_stack([ball(t.J[i, j]), ball(t.J_u[i, j]), ball(t.J_shift[i, j])])
        given = np.column_stack([t.J_radius[i, j], t.J_u_radius[i, j], t.J_reach[i, j]])
        g = self.gamma(n + n_u + 6)
        need = size(largest(size(lo - J), size(hi - J)) + g * (size(J) + ball(given)))
        need[:, -1] = need[:, -1] + later + self.tiny
        self.demand(f'jump from mode "{self.names[i]}" to "{self.names[j]}"', given, need)
        at = np.concatenate([self.limit, self.u, ball([1.0])])
        jump = (size(J) + ball(given)) @ at
        both = largest(self.w[i], self.w[j])
        need = self.reached(j, both, self.S) + lost + g * (base + jump + ball(t.birth[i, j]))
        self.demand(f'birth from mode "{self.names[i]}" to "{self.names[j]}"', t.birth[i, j], size(need))
