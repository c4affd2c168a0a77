"""What the offsets of the tables must cover so that the framers contain the state, exactly.

For *any* constants M, G, L, N that the C holds, put T = I - N C (exact). Then, for the true plant,

    x+ = M x + G u + L y + N y+  +  T Bw w - L Dv v - N Dv v+  +  (T A - L C - M) x + (T B - L D - G) u,

so with M >= 0 elementwise the upper framer stays above x as long as its offset is at least the largest
value of everything after the first four terms, plus what the caller's rounding of u and y and the C's own
rounding can take away. The identities T + N C = I and M = T A - L C therefore need not hold on rounded
constants: what is left over is counted here, as |left over| times the bound on |x| or |u|.

Where the tables depend on measured parameters or carry radii (``t.vary``) the same holds for every theta in its box,
with ``T A(theta) - L(theta) C - M(theta)`` bounded over the box, and what the plant's unknowns do beyond the radii
counted with the rest (``variation``). Where M has negative entries its row is bounded from above by the upper bound of
x times the positive and the lower bound times the negative ones, which is an inclusion for any M.

With a change of coordinates (``t.change``) the recursion is that of z = Z x: T = Z, and M takes the bounds of z, so
T A - L C - M Z is left over. The two maps between the boxes have offsets of their own: z = Z x holds by definition,
x = X z + (I - X Z) x for any X.

The worst case of the noise is taken with its true sign. The printed (5.2), (5.23) of Zammali (2020) use
``pos(L Dv) v_hi - neg(L Dv) v_lo``, which is right only for v_lo = -v_hi; the error equation needs -L Dv v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from .exact import Q, eye, product, rational, zeros
from .rounding import input_error, sum_error
from .variation import Affine, Scheduled, exact_mode, noise_need, pace_needed, pairs

Array = np.ndarray


@dataclass(frozen=True)
class Demand:
    """Smallest admissible offset of one row, without the rounding of its sum, and the sum it stands in.

    Parameters
    ----------
    need : fmpq
        The offset must reach this far outward ...
    before, after : list of (fmpq, fmpq)
        ... plus the rounding error of the sum before + offset + after.
    computed : fmpq
        The part of ``need`` that is rounding as well: of coefficients that depend on theta, and of the radius.
    """

    need: fmpq
    before: list
    after: list
    computed: fmpq = fmpq(0)

    def shortfall(self, offset: fmpq, real: str) -> fmpq:
        """How much the (outward) offset lacks; <= 0 means it suffices."""
        return self.need + self.rounding(offset, real) - offset

    def rounding(self, offset: fmpq, real: str) -> fmpq:
        """Largest rounding error of the sum with this offset."""
        return sum_error([*self.before, (fmpq(1), offset), *self.after], real)[0]

    def magnitude(self, offset: fmpq, real: str) -> fmpq:
        """Bound on the magnitude of the computed sum."""
        return sum_error([*self.before, (fmpq(1), offset), *self.after], real)[1]


def sup(A: Array, lo: Array, hi: Array) -> Array:
    """Exact row-wise maximum of A @ x over the box."""
    out = zeros(A.shape[0])
    for i, row in enumerate(A):
        out[i] = sum((a * (h if a > 0 else b) for a, b, h in zip(row, lo, hi)), fmpq(0))
    return out


def bounds(a, b) -> Array:
    """Exact elementwise max(|a|, |b|)."""
    return np.array([max(abs(Q(x)), abs(Q(y))) for x, y in zip(a, b)], dtype=object)


class Containment:
    """Demands of one table on one plant.

    Parameters
    ----------
    modes : sequence
        The plant's modes (``A B C D Bw Dv w_lo w_hi v_lo v_hi``), float64 read as exact rationals.
    t : FramerTables
    """

    def __init__(self, modes, t):
        self.t, self.real = t, t.real
        self.modes = modes
        self.exact = [exact_mode(m, t.G_hi.shape[1:]) for m in modes]
        self.parts: dict[tuple[int, str], Scheduled] = {}
        self.box = rational(t.box)
        self.state = self.box if t.change is None else rational(t.change.box)  # of what M multiplies
        self.u_max, self.y_max = bounds(t.u_lo, t.u_hi), bounds(t.y_lo, t.y_hi)
        self.u_err = np.array([input_error(b, t.real) for b in self.u_max], dtype=object)
        self.y_err = np.array([input_error(b, t.real) for b in self.y_max], dtype=object)
        # The physical u may lie half a unit beyond the table's rounded limit.
        self.u_true = self.u_max + self.u_err
        self._updates: dict[tuple[int, str], list[Demand]] = {}

    def scheduled(self, q: int, side: str) -> Scheduled:
        """The tables of one mode and framer with their dependence on theta."""
        if (q, side) not in self.parts:
            self.parts[q, side] = Scheduled(self.t, q, self.exact[q], side)
        return self.parts[q, side]

    def leftover(self, q: int, side: str) -> tuple[Array, Affine, Affine]:
        """Return T, T A - L C - M and T B - L D - G of mode q on the emitted constants, exact."""
        s = self.scheduled(q, side)
        T = eye(len(self.box)) - product(s.N, self.exact[q]["C"])
        T = T if s.Z is None else product(s.Z, T)
        return T, *s.leftover(T)

    def update(self, q: int, side: str) -> list[Demand]:
        """Demands on d_hi[q] (side "hi") or -d_lo[q] (side "lo"), one per state; they do not depend on d."""
        if (q, side) not in self._updates:
            self._updates[q, side] = self._update(q, side)
        return self._updates[q, side]

    def _update(self, q: int, side: str) -> list[Demand]:
        p, sign, s = self.exact[q], (1 if side == "hi" else -1), self.scheduled(q, side)
        T, EM, EG = self.leftover(q, side)
        disturbance = sup(sign * product(T, p["Bw"]), p["w_lo"], p["w_hi"])
        noise = self.noise(q, side)
        # v+ belongs to the next sample, whose mode is not known yet: the worst of all modes.
        later = [sup(-sign * product(s.N, r["Dv"]), r["v_lo"], r["v_hi"]) for r in self.exact]
        lack_x, lack_u = self._lack(s, T)
        left_x, left_u = EM.most() + lack_x, EG.most() + lack_u
        L_most, L_slip = s.L.most(), s.L.rounding(self.real)
        out = []
        for i in range(len(self.box)):
            need = disturbance[i] + noise[i] + max(row[i] for row in later)
            need += dot(left_x[i], self.box) + dot(left_u[i], self.u_true) + dot(s.G.most()[i], self.u_err)
            need += dot(L_most[i], self.y_err) + dot(s.N[i], self.y_err) + dot(s.S.most()[i], self.u_err)
            G, slip_G = pairs(s.G, i, self.u_max, self.real)
            L, slip_L = pairs(s.L, i, self.y_max, self.real)
            M, slip_M = pairs(s.M, i, self.state, self.real)
            slip_E = dot(s.E[i], L_slip[i])
            R, slip_R = pairs(s.R, i, self.box, self.real)
            S, slip_S = pairs(s.S, i, self.u_max, self.real)
            apart, size = sum_error([*R, *S, *zip(s.E[i], L_most[i] + L_slip[i])], self.real)
            computed = slip_G + slip_L + slip_M + slip_E + slip_R + slip_S + apart
            before, after = [*G, *L, *zip(s.N[i], self.y_max)], [*M, (fmpq(1), size)]
            out.append(Demand(need + computed, before, after, computed))
        return out

    def noise(self, q: int, side: str) -> Array:
        """Largest -L Dv v (side "hi") or L Dv v that the offset has to cover."""
        p, sign, s = self.exact[q], (1 if side == "hi" else -1), self.scheduled(q, side)
        if s.L.slopes:
            return noise_need(s, p, sign)
        return sup(-sign * product(s.L.base, p["Dv"]), p["v_lo"], p["v_hi"])

    def _lack(self, s: Scheduled, T: Array) -> tuple[Array, Array]:
        """What the unknowns and the rounding of theta do beyond the radii of the tables, elementwise."""
        (UA, UB), (DA, DB) = s.unknown(T, -1), s.drift(T)
        out = [positive(UA - s.R.base) + DA, positive(UB - s.S.base) + DB]
        for j in sorted({of for of in s.p["paced"] if of >= 0}):
            more = s.unknown(T, j)
            if self.paced(j):
                i = self.t.vary.paced.index(j)
                more = [positive(U - radius.slopes[i]) for U, radius in zip(more, (s.R, s.S))]
            out = [a + b for a, b in zip(out, more)]
        return out[0], out[1]

    def paced(self, j: int) -> bool:
        """Whether the tables have a radius that shrinks with the change of parameter j, and one that is large enough.

        Where its ``top`` is too small nothing may be taken from it.
        """
        v = self.t.vary
        if v is None or j not in v.paced:
            return False
        i = v.paced.index(j)
        most = max(max(abs(Q(a)), abs(Q(b))) for a, b in zip(v.theta_lo[:, j], v.theta_hi[:, j]))
        reach = max(Q(p["reach"][j]) for p in self.exact)
        return Q(v.top[i]) >= pace_needed(v.pace[i], reach, most, self.real)

    def blind(self, q: int, side: str) -> list[Demand]:
        """Demands on a_hi[q] or -a_lo[q]: the open-loop prediction, which does not look at theta."""
        p, t, sign = self.exact[q], self.t, (1 if side == "hi" else -1)
        A, B = rational(t.A[q]), rational(t.B[q])
        disturbance = sup(sign * p["Bw"], p["w_lo"], p["w_hi"])
        n_x, n_u = B.shape
        Ra, Sa = (zeros(n_x, n_x), zeros(n_x, n_u)) if t.vary is None else (
            rational(t.vary.Ra[q]), rational(t.vary.Sa[q]))
        s = self.scheduled(q, side)
        UA, UB = s.unknown(eye(n_x))
        left_x = positive(Affine(p["A"] - A, p["A_theta"], p["box_lo"], p["box_hi"]).most() + UA - Ra)
        left_u = positive(Affine(p["B"] - B, p["B_theta"], p["box_lo"], p["box_hi"]).most() + UB - Sa)
        out = []
        for i in range(len(self.box)):
            need = disturbance[i] + dot(left_x[i], self.box) + dot(left_u[i], self.u_true)
            need += dot(B[i], self.u_err) + dot(Sa[i], self.u_err)
            apart, size = sum_error([*zip(Ra[i], self.box), *zip(Sa[i], self.u_max)], self.real)
            after = [*zip(A[i], self.box), (fmpq(1), size)]
            out.append(Demand(need + apart, list(zip(B[i], self.u_max)), after, apart))
        return out

    def output(self, q: int, side: str) -> list[Demand]:
        """Demands on c_hi[q] or -c_lo[q]: the output framers, against the y that the firmware reads."""
        p, t, sign = self.exact[q], self.t, (1 if side == "hi" else -1)
        C, D = rational(t.C[q]), rational(t.D[q])
        noise = sup(sign * p["Dv"], p["v_lo"], p["v_hi"])
        out = []
        for j in range(C.shape[0]):
            need = noise[j] + dot(p["C"][j] - C[j], self.box) + dot(p["D"][j] - D[j], self.u_true)
            need += dot(D[j], self.u_err) + self.y_err[j]
            out.append(Demand(need, list(zip(D[j], self.u_max)), list(zip(C[j], self.box))))
        return out

    def changed(self, name: str) -> list[Demand]:
        """Demands on the offsets "e" of z = Z x or "b" of x = X z; both sides and all modes have the same."""
        Z, X = rational(self.t.change.Z), rational(self.t.change.X)
        if name == "e":
            return [Demand(fmpq(0), [], list(zip(row, self.box))) for row in Z]
        return [Demand(dot(left, self.box), [], list(zip(row, self.state)))
                for left, row in zip(eye(len(Z)) - product(X, Z), X)]

    def offsets(self):
        """Yield (name, q, side, demands) for every offset vector of the tables, see ``offset``."""
        for q in range(len(self.modes)):
            for side in ("hi", "lo"):
                yield "d", q, side, self.update(q, side)
                yield "a", q, side, self.blind(q, side)
                yield "c", q, side, self.output(q, side)
                for name in "eb" if self.t.change is not None else "":
                    yield name, q, side, self.changed(name)


def offset(t, name: str, side: str) -> Array:
    """The offsets (N, n) of a table by the names of ``Containment.offsets``."""
    if name in "eb":
        return np.broadcast_to(getattr(t.change, f"{name}_{side}"), t.d_hi.shape)
    return getattr(t, f"{name}_{side}")


def positive(A: Array) -> Array:
    """Elementwise max(A, 0), exact."""
    return np.array([a if a > 0 else fmpq(0) for a in A.ravel()], dtype=object).reshape(A.shape)


def dot(row, magnitudes) -> fmpq:
    """Exact sum of |row| times magnitudes."""
    return sum((abs(a) * m for a, m in zip(row, magnitudes)), fmpq(0))
