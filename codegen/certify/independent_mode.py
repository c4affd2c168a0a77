"""Exact tables of one mode with parameters, and what its offsets must hold; ``independent_lpv.py`` rests on it.

Standard library only, nothing of residua imported.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, rounding, size, sub, sup  # noqa: E402 - stands beside this file
from independent_step import add, left_over, mag, pacing, times  # noqa: E402


class Mode:
    """Exact tables of one mode: "MGL" as [base, slopes ...], N, radii; ranges and slips of the caller's rounding."""

    def __init__(self, p, t, q, z, both):
        v, self.t, self.q, self.p, self.z, self.real = t["vary"], t, q, p, z, t["real"]
        u, tiny = UNIT[self.real]
        for k in "MGL":
            setattr(self, k, [exact(t[f"{k}_hi"][q]), *exact(v[k][q])])
            demand(t[f"{k}_hi"][q] == t[f"{k}_lo"][q] and t["N_hi"][q] == t["N_lo"][q], "equal gains of both framers")
        self.N, self.E = exact(t["N_hi"][q]), exact(v["E"][q])
        self.box = [(F(a), F(b)) for a, b in zip(v["theta_lo"][q], v["theta_hi"][q])]
        for (lo, hi), c, k in zip(self.box, z["middle"], z["K"]):
            room = 2 * (u * max(abs(c - k), abs(c + k)) + tiny)
            demand(c - k - room <= lo <= c - k and c + k <= hi <= c + k + room, f"theta box of mode {p['name']}")
        self.reach = [max(abs(a), abs(b)) for a, b in self.box]
        self.drift = [(3 if both else 1) * (u * r + tiny) for r in self.reach]  # of p: the caller's rounding, the mean
        self.products, self.multiplied = v.get("products", []), []
        for j, k in self.products:  # the firmware rounds the product once
            ends = [a * b for a, b in product(self.box[j], self.box[k])]
            self.multiplied.append(u * max(map(abs, ends)) + tiny)
            self.box.append((min(ends) - self.multiplied[-1], max(ends) + self.multiplied[-1]))
        self.reach = [max(abs(a), abs(b)) for a, b in self.box]
        self.L += [times(0, self.L[0]) for _ in self.products]
        demand(len(self.M) == len(self.G) == len(self.L) == 1 + len(self.box), "a slope for every parameter")
        self.paced = pacing(v, z, self.reach, both, u, tiny)
        for k in "RS":
            parts = [exact(x) for x in v[f"{k}_pace"][q]] if self.paced else []
            base, reach = exact(v[k][q]), [F(x) for x in v["top"]] if self.paced else []
            setattr(self, f"{k}_parts", [base, *parts])
            setattr(self, k, add(base, *map(times, reach, parts)))
            setattr(self, f"{k}_slip", [[rounding([(e, F(1)), *((x[i][j], r) for x, r in zip(parts, reach))],
                                                  self.real)[0] if any(x[i][j] for x in parts) else F(0)
                                         for j, e in enumerate(row)] for i, row in enumerate(base)])
        n = len(t["box"])
        self.T = sub([[F(i == j) for j in range(n)] for i in range(n)], mul(self.N, p["C"]))
        demand(not any(map(any, mul(self.N, p["D"]))), "N D is not zero")
        self.x = self.state = exact(t["box"])
        self.Z = exact(t["change"]["Z"]) if "change" in t else None
        if self.Z:
            demand(not any(map(any, self.N)), "N is not zero")
            self.T, self.state = self.Z, exact(t["change"]["box"])
        self.u, self.y = ([max(abs(F(a)), abs(F(b))) for a, b in zip(t[k + "_lo"], t[k + "_hi"])] for k in "uy")
        self.u_slip, self.y_slip = ([u * b + tiny for b in m] for m in (self.u, self.y))
        self.u_true = [a + b for a, b in zip(self.u, self.u_slip)]
        half, self.mid = [(b - a) / 2 for a, b in p["v"]], [(a + b) / 2 for a, b in p["v"]]
        self.half = [size(row, half) for row in p["Dv"]]

    def corners(self, k):
        """A table at every corner of theta."""
        base, *slopes = getattr(self, k) if k != "N" else [self.N, *[times(0, self.N)] * len(self.box)]
        return [add(base, *map(times, at, slopes)) for at in product(*self.box)]

    def most(self, k):
        """Largest magnitude of every entry: at a corner."""
        return [[max(map(abs, e)) for e in zip(*rows)] for rows in zip(*map(mag, self.corners(k)))]

    def slip(self, k):
        """Rounding error of every computed coefficient."""
        base, *slopes = getattr(self, k)
        return [[rounding([(e, F(1)), *((s[i][j], r) for s, r in zip(slopes, self.reach))], self.real)[0]
                 if any(s[i][j] for s in slopes) else F(0) for j, e in enumerate(row)] for i, row in enumerate(base)]

    def noise(self, i, s):
        """Largest -s L(theta) Dv v that E |L(theta)| does not cover at run time."""
        base, *slopes = self.L
        if not any(any(slope[i]) for slope in slopes) and not any(self.E[i]):
            return sup(mul([base[i]], self.p["Dv"])[0], self.p["v"], -s)
        shift = [size_of(row, self.mid) for row in self.p["Dv"]]
        return max(-s * size_of(L[i], shift) for L in self.corners("L")) + sum(
            (m * max(h - e, 0) for m, h, e in zip(self.most("L")[i], self.half, self.E[i])), F(0))

    def left(self, z):
        """|T Phi - L C - M|, |T Phi - L D - G| over the box of theta, for the step z."""
        of_x = [mul(M, self.Z) for M in self.M] if self.Z else self.M
        target = [add([m + g for m, g in zip(M, G)], mul(L, self.p["CD"])) for M, G, L in zip(of_x, self.G, self.L)]
        out = left_over(self.T, z, target, self.box, self.drift, self.products, self.multiplied)
        if z is self.z:  # what a paced radius covers is counted here: all that it leaves
            count = len(z["middle"])
            for j, R, S in zip(self.paced, self.R_parts[1:], self.S_parts[1:]):
                whole = mag(mul(self.T, z["first"][len(z["first"]) - count + j]))
                kept = [[min(a, b) for a, b in zip(row, [*r, *s])] for row, r, s in zip(whole, R, S)]
                out = sub(out, kept)
        return split(out, len(self.x))

    def rows(self, s, later, left):
        """Per state: demand on the offset, terms of the sum before and after it, rounding of inputs and coefficients.

        Last, what of this rounding drives both framers apart.
        """
        most, slip, W = {k: self.most(k) for k in "MGL"}, {k: self.slip(k) for k in "MGL"}, self.z["W"](self.T, s)
        for i in range(len(self.x)):
            def terms(k, bounds, i=i):
                c = [a + b for a, b in zip(most[k][i], slip[k][i])] if len(self.M) > 1 else getattr(self, k)[0][i]
                return list(zip(c, bounds))
            R, S = ([a + b for a, b in zip(x[i], y[i])] for x, y in ((self.R, self.R_slip), (self.S, self.S_slip)))
            radius = [*zip(R, self.x), *zip(S, self.u), *(
                (e, a + b) for e, a, b in zip(self.E[i], most["L"][i], slip["L"][i]))]
            error, spread = rounding(radius, self.real)
            error += size(slip["M"][i], self.state) + size(slip["L"][i], self.E[i])
            error += size(self.R_slip[i], self.x) + size(self.S_slip[i], self.u)
            slips = error + size(slip["G"][i], self.u) + size(slip["L"][i], self.y) + size(self.S[i], self.u_slip)
            slips += size(most["G"][i], self.u_slip) + size(most["L"][i] + self.N[i], self.y_slip * 2)
            need = W[i] + self.noise(i, s) + later[i] + slips
            need += beyond(left[0][i], self.R_parts[0][i], self.x) + beyond(left[1][i], self.S_parts[0][i], self.u_true)
            yield need, [*terms("G", self.u), *terms("L", self.y), *zip(self.N[i], self.y)], [
                *terms("M", self.state), (F(1), spread)], slips, error


def size_of(row, values):
    """Exact row times values."""
    return sum((a * b for a, b in zip(row, values)), F(0))


def split(A, n):
    """State and input columns."""
    return [row[:n] for row in A], [row[n:] for row in A]


def beyond(row, radii, bounds):
    """What the radii of a row leave, times the bounds."""
    return sum((max(a - r, 0) * b for a, r, b in zip(row, radii, bounds)), F(0))
