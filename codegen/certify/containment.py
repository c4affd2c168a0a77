"""What the offsets of the tables must cover so that the framers contain the state, exactly.

For *any* constants M, G, L, N that the C holds, put T = I - N C (exact). Then, for the true plant,

    x+ = M x + G u + L y + N y+  +  T Bw w - L Dv v - N Dv v+  +  (T A - L C - M) x + (T B - L D - G) u,

so with M >= 0 elementwise the upper framer stays above x as long as its offset is at least the largest
value of everything after the first four terms, plus what the caller's rounding of u and y and the C's own
rounding can take away. The identities T + N C = I and M = T A - L C therefore need not hold on rounded
constants: what is left over is counted here, as |left over| times the bound on |x| or |u|.

The worst case of the noise is taken with its true sign. The printed (5.2), (5.23) of Zammali (2020) use
``pos(L Dv) v_hi - neg(L Dv) v_lo``, which is right only for v_lo = -v_hi; the error equation needs -L Dv v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from .exact import Q, eye, product, rational, zeros
from .rounding import input_error, sum_error

Array = np.ndarray


@dataclass(frozen=True)
class Demand:
    """Smallest admissible offset of one row, without its rounding part, and the sum it stands in.

    Parameters
    ----------
    need : fmpq
        The offset must reach this far outward ...
    before, after : list of (fmpq, fmpq)
        ... plus the rounding error of the sum before + offset + after.
    """

    need: fmpq
    before: list
    after: list

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
        self.exact = [{k: rational(getattr(m, k)) for k in
                       ("A", "B", "C", "D", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi")} for m in modes]
        self.box = rational(t.box)
        self.u_max, self.y_max = bounds(t.u_lo, t.u_hi), bounds(t.y_lo, t.y_hi)
        self.u_err = np.array([input_error(b, t.real) for b in self.u_max], dtype=object)
        self.y_err = np.array([input_error(b, t.real) for b in self.y_max], dtype=object)
        # The physical u may lie half a unit beyond the table's rounded limit.
        self.u_true = self.u_max + self.u_err
        self._updates: dict[tuple[int, str], list[Demand]] = {}

    def leftover(self, q: int, side: str) -> tuple[Array, Array, Array]:
        """Return T, T A - L C - M and T B - L D - G of mode q on the emitted constants, exact."""
        p, t = self.exact[q], self.t
        L, N = rational(getattr(t, "L_" + side)[q]), rational(getattr(t, "N_" + side)[q])
        M, G = rational(getattr(t, "M_" + side)[q]), rational(getattr(t, "G_" + side)[q])
        T = eye(len(self.box)) - product(N, p["C"])
        return T, product(T, p["A"]) - product(L, p["C"]) - M, product(T, p["B"]) - product(L, p["D"]) - G

    def update(self, q: int, side: str) -> list[Demand]:
        """Demands on d_hi[q] (side "hi") or -d_lo[q] (side "lo"), one per state; they do not depend on d."""
        if (q, side) not in self._updates:
            self._updates[q, side] = self._update(q, side)
        return self._updates[q, side]

    def _update(self, q: int, side: str) -> list[Demand]:
        p, t, sign = self.exact[q], self.t, (1 if side == "hi" else -1)
        L, N = rational(getattr(t, "L_" + side)[q]), rational(getattr(t, "N_" + side)[q])
        M, G = rational(getattr(t, "M_" + side)[q]), rational(getattr(t, "G_" + side)[q])
        T, EM, EG = self.leftover(q, side)
        disturbance = sup(sign * product(T, p["Bw"]), p["w_lo"], p["w_hi"])
        noise = sup(-sign * product(L, p["Dv"]), p["v_lo"], p["v_hi"])
        # v+ belongs to the next sample, whose mode is not known yet: the worst of all modes.
        later = [sup(-sign * product(N, s["Dv"]), s["v_lo"], s["v_hi"]) for s in self.exact]
        out = []
        for i in range(len(self.box)):
            need = disturbance[i] + noise[i] + max(row[i] for row in later)
            need += dot(EM[i], self.box) + dot(EG[i], self.u_true) + dot(G[i], self.u_err)
            need += dot(L[i], self.y_err) + dot(N[i], self.y_err)
            before = [*zip(G[i], self.u_max), *zip(L[i], self.y_max), *zip(N[i], self.y_max)]
            out.append(Demand(need, before, list(zip(M[i], self.box))))
        return out

    def blind(self, q: int, side: str) -> list[Demand]:
        """Demands on a_hi[q] or -a_lo[q]: the open-loop prediction."""
        p, t, sign = self.exact[q], self.t, (1 if side == "hi" else -1)
        A, B = rational(t.A[q]), rational(t.B[q])
        disturbance = sup(sign * p["Bw"], p["w_lo"], p["w_hi"])
        out = []
        for i in range(len(self.box)):
            need = disturbance[i] + dot(p["A"][i] - A[i], self.box) + dot(p["B"][i] - B[i], self.u_true)
            need += dot(B[i], self.u_err)
            out.append(Demand(need, list(zip(B[i], self.u_max)), list(zip(A[i], self.box))))
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

    def offsets(self):
        """Yield (name, q, side, demands) for every offset vector of the tables."""
        for q in range(len(self.modes)):
            for side in ("hi", "lo"):
                yield "d", q, side, self.update(q, side)
                yield "a", q, side, self.blind(q, side)
                yield "c", q, side, self.output(q, side)


def dot(row, magnitudes) -> fmpq:
    """Exact sum of |row| times magnitudes."""
    return sum((abs(a) * m for a, m in zip(row, magnitudes)), fmpq(0))
