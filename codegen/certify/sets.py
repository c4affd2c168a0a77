"""What the tables of a point observer must hold so that no fault-free residual leaves its set, in exact arithmetic.

With *any* constants M, G, L, N of the C and T = I - N C, the estimate's error e = x - x_hat obeys without a fault

    e+ = M e + T Bw w - L Dv v - N Dv v+  +  (T A - L C - M) x + (T B - L D - G) u + rounding,

and e^ = e + N_o Dv (v - centre), with N_o the gain that produced x_hat (none after a prediction or a restart),

    e^+ = M e^ + T Bw w - (M N_o + L) Dv v + rest,      r = C e^ + (Dv - C N_o Dv) v + rest.

The generators carry M e^ and the noise; every rest (left over constants, rounded inputs, rounded sums, rounded
generators) is bounded here by boxes: ``e`` beside the error set, ``rho`` beside that of the residual. Bounds of sums
rest on |x_hat| <= box = largest |x| + limit and on half widths of the set <= limit; the C starts the set again from
the declared range where a half width exceeds its limit, so that both hold by induction.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .containment import Containment, bounds, dot
from .exact import eye, product, rational, zeros
from .rounding import TINY, UNIT

Array = np.ndarray


def quiet(mode) -> SimpleNamespace:
    """The same mode without disturbance and noise: what is left of a demand then is the rest."""
    names = ("name", "A", "B", "C", "D", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi")
    return SimpleNamespace(**{n: getattr(mode, n) * 0 if n[-3:] in ("_lo", "_hi") else getattr(mode, n) for n in names})


def framers_of(t) -> SimpleNamespace:
    """The tables as ``Containment`` reads them: both sides are the estimate."""
    own = {f"{name}_{side}": getattr(t, name) for name in "MGLNdac" for side in ("hi", "lo")}
    same = {n: getattr(t, n) for n in ("real", "A", "B", "C", "D", "box", "u_lo", "u_hi", "y_lo", "y_hi")}
    return SimpleNamespace(**own, **same, vary=None, change=None)


class SetDemands:
    """Exact columns and smallest boxes of the tables of a point observer.

    Parameters
    ----------
    modes : sequence
        The plant's modes, float64 read as exact rationals.
    t : PointTables
        Its estimate's tables, ``box`` and ``limit`` are read; of ``shape`` only what each method says.
    """

    def __init__(self, modes, t):
        self.t, self.real, self.modes = t, t.real, modes
        if t.kind != "tnl" and np.any(t.N != 0):
            raise CertificateError("certificate: a Luenberger observer with a gain N (found), expected none.")
        if t.kind == "tnl" and any(np.any(m.D != 0) or not np.array_equal(m.C, modes[0].C) for m in modes):
            raise CertificateError("certificate: D that is not zero, or C that differs between modes (found), expected "
                                   "neither beside a gain N on the new measurement.")
        self.plain = Containment([quiet(m) for m in modes], framers_of(t))
        self.exact = [{k: rational(getattr(m, k)) for k in ("C", "Bw", "Dv", "w_lo", "w_hi", "v_lo", "v_hi")}
                      for m in modes]
        self.M, self.A, self.C, self.N, self.L = (rational(getattr(t, k)) for k in "MACNL")
        self.w, self.v = self._noise("w", t.kind == "tnl"), self._noise("v", t.kind == "tnl")
        n_x = len(t.box)
        self.gain = [*self.N, zeros(n_x, self.L.shape[2])] if t.kind == "tnl" else [zeros(n_x, self.L.shape[2])]

    def _noise(self, name: str, common: bool) -> list[tuple[Array, Array]]:
        """Centre and half width of a disturbance per mode; of the noise of a TNL observer the centre is common."""
        ends = [(m[f"{name}_lo"], m[f"{name}_hi"]) for m in self.exact]
        if common and name == "v":
            lo, hi = np.min([a for a, _ in ends], axis=0), np.max([b for _, b in ends], axis=0)
            return [((lo + hi) / 2, np.maximum(b - (lo + hi) / 2, (lo + hi) / 2 - a)) for a, b in ends]
        return [((a + b) / 2, (b - a) / 2) for a, b in ends]

    def centres(self) -> dict[str, Array]:
        """Exact d (N, n_x), a (N, n_x) and c (N, n_y)."""
        out: dict[str, list] = {"d": [], "a": [], "c": []}
        for q, p in enumerate(self.exact):
            w, v = (column(x[q][0]) for x in (self.w, self.v))
            T = eye(len(self.M[q])) - product(self.N[q], p["C"])
            LN = self.L[q] + self.N[q]
            out["d"].append((product(product(T, p["Bw"]), w) - product(LN, product(p["Dv"], v))).ravel())
            out["a"].append(product(p["Bw"], w).ravel())
            out["c"].append(product(p["Dv"], v).ravel())
        return {k: np.array(x, dtype=object) for k, x in out.items()}

    def columns(self) -> dict[str, Array]:
        """Exact F, Fb (N, O, n_x, c) and V (N, O, n_y, s); columns that are zero everywhere are left out."""
        F, Fb, V = [], [], []
        for q, p in enumerate(self.exact):
            Bw, Dv = p["Bw"] * self.w[q][1], p["Dv"] * self.v[q][1]
            T = eye(len(self.M[q])) - product(self.N[q], p["C"])
            rows: list[list] = [[], [], []]
            for gain in self.gain:
                later = product(gain, Dv)  # what of this sample's noise is in the estimate
                rows[0].append(np.concatenate([product(T, Bw), -product(self.M[q], later) - product(self.L[q], Dv)], 1))
                rows[1].append(np.concatenate([Bw, -product(self.A[q], later)], axis=1))
                rows[2].append(Dv - product(self.C[q], later))
            for out, row in zip((F, Fb, V), rows):
                out.append(row)
        F, Fb, V = (np.array(x, dtype=object) for x in (F, Fb, V))
        moved = np.any((F != 0) | (Fb != 0), axis=(0, 1, 2))
        return {"F": F[..., moved], "Fb": Fb[..., moved], "V": V[..., np.any(V != 0, axis=(0, 1, 2))]}

    def rounding(self, q: int, which: str) -> Array:
        """What the C's own sums may be off by in the map "forward", "blind" or "residual" of mode q, row by row."""
        t = self.t
        if which != "residual":
            demands = self.plain.update(q, "hi") if which == "forward" else self.plain.blind(q, "hi")
            given = rational((t.d if which == "forward" else t.a)[q])
            return np.array([d.rounding(g, t.real) for d, g in zip(demands, given)], dtype=object)
        out = []
        for d, g, most in zip(self.plain.output(q, "hi"), rational(t.c[q]), bounds(t.y_lo, t.y_hi)):
            last = UNIT[t.real] * (most + d.magnitude(g, t.real)) + TINY[t.real]
            out.append(d.rounding(g, t.real) + last)
        return np.array(out, dtype=object)

    def rest(self, q: int, measured: bool) -> Array:
        """What a step of mode q adds to the error beside the columns: constants, inputs, rounding of the estimate."""
        t = self.t
        demands = self.plain.update(q, "hi") if measured else self.plain.blind(q, "hi")
        given = rational((t.d if measured else t.a)[q])
        off = abs(given - self.centres()["d" if measured else "a"][q])
        out = np.array([d.need for d in demands], dtype=object) + off
        out = out + self.rounding(q, "forward" if measured else "blind")
        if measured:  # the centre of the next sample's noise, if its mode has another Dv
            shift = [abs(product(self.N[q], product(p["Dv"] - self.exact[q]["Dv"], column(self.v[q][0])))).ravel()
                     for p in self.exact]
            out = out + np.max(shift, axis=0)
        return out

    def residual_rest(self, q: int) -> Array:
        """The same of the residual, the rounding of its last subtraction included."""
        off = abs(rational(self.t.c[q]) - self.centres()["c"][q])
        need = np.array([d.need for d in self.plain.output(q, "hi")], dtype=object)
        return need + off + self.rounding(q, "residual")

    def carried(self) -> Array:
        """Half width that the noise held by the estimate may have, (O, n_x): max over modes of |N_o Dv| v_half."""
        return np.array([np.max([product(abs(product(gain, p["Dv"])), column(v[1])).ravel()
                                 for p, v in zip(self.exact, self.v)], axis=0) for gain in self.gain], dtype=object)


class ZonotopeDemands:
    """Smallest e, spread, rho of a zonotope's tables, for given e, limit and columns.

    Parameters
    ----------
    demands : SetDemands
    z : ZonotopeTables
    """

    def __init__(self, demands: SetDemands, z):
        self.of, self.z = demands, z
        self.u, self.tiny = UNIT[demands.real], TINY[demands.real]
        self.count = z.columns
        self.e = rational(z.e)
        # Row sums of H after a reduction: what the run-time check lets pass, its own rounding, and e.
        self.reach = (rational(demands.t.limit) + 2 * self.e) * (1 + 4 * (self.count + 4) * self.u)
        self.reach = self.reach + 8 * self.count * self.tiny

    def chain(self, magnitude: Array) -> Array:
        """Rounding of a sum of all columns and a constant, each partial sum at most ``magnitude``."""
        return (self.count + 2) * (self.u * magnitude * (1 + 2 * (self.count + 2) * self.u) + self.tiny)

    def carry(self, M: Array) -> Array:
        """Rounding of M H, summed over the columns."""
        n = M.shape[1]
        return (n + 1) * self.u * product(abs(M), column(self.reach)).ravel() + 2 * n * self.count * self.tiny

    def error_box(self) -> Array:
        """Smallest admissible e."""
        exact, out = self.of.columns(), None
        for q in range(len(self.of.modes)):
            for name, M, measured in (("F", self.of.M, True), ("Fb", self.of.A, False)):
                off = abs(rational(getattr(self.z, name)[q]) - exact[name][q]).sum(axis=2)
                here = self.of.rest(q, measured) + self.carry(M[q]) + np.max(off, axis=0) + self.turn(q, measured)
                out = here if out is None else np.maximum(out, here)
        return out + (0 if len(self.z.B) else self.chain(self.reach))

    def turn(self, q: int, measured: bool) -> Array:
        """What a box in other coordinates leaves out of a step: M - S B, and the rounding of S times the box."""
        if not len(self.z.B):
            return zeros(len(self.e), 1).ravel()
        M, S, B = self.of.M if measured else self.of.A, self.z.S if measured else self.z.Sb, rational(self.z.B[q])
        S = rational(S[q])
        lack = product(abs(M[q] - product(S, B)), column(self.reach)).ravel()
        box = product(abs(B), column(self.reach)).ravel() + rational(self.z.inside[q])
        return lack + 2 * self.u * product(abs(S), column(box)).ravel() + len(self.e) * self.tiny

    def inside(self) -> Array:
        """Smallest admissible rounding in other coordinates, (N, n_x), or (0, n_x): e there, B g, and the sums."""
        n, out = len(self.e), []
        for B in self.z.B:
            B = abs(rational(B))
            size = product(B, column(self.reach)).ravel()
            out.append(product(B, column(self.e)).ravel() + (n + 1) * self.u * size + 2 * n * self.count * self.tiny
                       + self.chain(size * (1 + (n + 1) * self.u)))
        return np.array(out, dtype=object).reshape(-1, n)

    def spread(self) -> Array:
        """Smallest admissible spread (O, n_x)."""
        box = rational(self.of.t.box)
        own = self.e + self.chain(self.reach) + 2 * self.u * (box + 2 * self.reach) + 2 * self.tiny
        return self.of.carried() * (1 + 4 * (self.count + 2) * self.u) + own

    def residual_box(self) -> Array:
        """Smallest admissible rho (N, n_y)."""
        exact, out = self.of.columns()["V"], []
        terms = self.count + self.z.V.shape[3]
        for q, C in enumerate(self.of.C):
            off = np.max(abs(rational(self.z.V[q]) - exact[q]).sum(axis=2), axis=0)
            out.append(self.of.residual_rest(q) + product(abs(C), column(self.e)).ravel() + self.carry(C) + off
                       + 8 * terms * self.tiny)
        return np.array(out, dtype=object)

    def slack(self) -> fmpq:
        """Smallest relative room of the membership test."""
        n_y = self.z.V.shape[2]
        return (self.count + self.z.V.shape[3] + 4 * n_y + 16) * self.u * fmpq(17, 16)

    def floor(self) -> fmpq:
        """Smallest absolute room of the membership test: products below the normal numbers may be flushed."""
        n_y = self.z.V.shape[2]
        return 8 * (self.count + self.z.V.shape[3] + 2) * (n_y + 1) * self.tiny

    def steady(self, half: Array) -> str:
        """Why half widths (n_x,) are not kept and entered by the hull in every mode; empty where they are."""
        half, out = rational(half), ""
        n, boxed = len(half), half + self.e + self.chain(half + self.e)  # the sum of a box may be rounded up
        for q, M in enumerate(self.of.M):
            moved = product(abs(M), column(boxed)).ravel() * (1 + (n + 1) * self.u) + 2 * n * self.count * self.tiny
            for o in range(len(self.of.gain)):
                new = moved + abs(rational(self.z.F[q, o])).sum(axis=1)
                for i in range(len(half)):
                    if new[i] > half[i] or dot(M[i], half) >= half[i]:
                        out = f'mode "{self.of.modes[q].name}", state {i}, by {float(new[i] - half[i]):.3g}'
        return out


def column(x: Array) -> Array:
    """A vector as a matrix of one column."""
    return np.asarray(x, dtype=object).reshape(-1, 1)
