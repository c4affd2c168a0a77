"""Independent checker of designs with parameters, unknowns or a continuous plant; ``independent.py`` hands over to it.

Standard library only, nothing of residua imported. With the enclosed step z+ = Phi(p) z + W of ``independent_step`` and
T = I - N C, every entry of T Phi(p) - [M, G](theta) - L(theta) [C, D] is bounded over the box of theta; what of it is
beyond the radii R, S must fit, times the ranges, into the offsets, together with T W, noise and rounding. Errors and
widths are followed at the corners of theta; where the mode may be told late, with the steps of every other mode too.
Where coordinates are changed the recursion is that of z = Z x: T = Z, M Z stands for M, and M takes the box of z.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent as plain  # noqa: E402 - stands beside this file
from independent import SIDES, UNIT, demand, exact, mul, rounding, size, sub, sup  # noqa: E402
from independent_step import add, left_over, mag, read_plant, times, transition  # noqa: E402


class Mode:
    """Exact tables of one mode: "MGL" as [base, slopes ...], N, radii; ranges and slips of the caller's rounding."""

    def __init__(self, p, t, q, z, both):
        v, self.t, self.q, self.p, self.z, self.real = t["vary"], t, q, p, z, t["real"]
        u, tiny = UNIT[self.real]
        for k in "MGL":
            setattr(self, k, [exact(t[f"{k}_hi"][q]), *exact(v[k][q])])
            demand(t[f"{k}_hi"][q] == t[f"{k}_lo"][q] and t["N_hi"][q] == t["N_lo"][q], "equal gains of both framers")
        self.N, self.R, self.S, self.E = exact(t["N_hi"][q]), *(exact(v[k][q]) for k in "RSE")
        self.box = [(F(a), F(b)) for a, b in zip(v["theta_lo"][q], v["theta_hi"][q])]
        for (lo, hi), c, k in zip(self.box, z["middle"], z["K"]):
            room = 2 * (u * max(abs(c - k), abs(c + k)) + tiny)
            demand(c - k - room <= lo <= c - k and c + k <= hi <= c + k + room, f"theta box of mode {p['name']}")
        self.reach = [max(abs(a), abs(b)) for a, b in self.box]
        self.drift = [(3 if both else 1) * (u * r + tiny) for r in self.reach]  # of p: the caller's rounding, the mean
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
        return split(left_over(self.T, z, target, self.box, self.drift), len(self.x))

    def rows(self, s, later, left):
        """Per state: demand on the offset, terms of the sum before and after it, rounding of inputs and coefficients.

        Last, what of this rounding drives both framers apart.
        """
        most, slip, W = {k: self.most(k) for k in "MGL"}, {k: self.slip(k) for k in "MGL"}, self.z["W"](self.T, s)
        for i in range(len(self.x)):
            def terms(k, bounds, i=i):
                c = [a + b for a, b in zip(most[k][i], slip[k][i])] if len(self.M) > 1 else getattr(self, k)[0][i]
                return list(zip(c, bounds))
            radius = [*zip(self.R[i], self.x), *zip(self.S[i], self.u),
                      *((e, a + b) for e, a, b in zip(self.E[i], most["L"][i], slip["L"][i]))]
            error, spread = rounding(radius, self.real)
            error += size(slip["M"][i], self.state) + size(slip["L"][i], self.E[i])
            slips = error + size(slip["G"][i], self.u) + size(slip["L"][i], self.y) + size(self.S[i], self.u_slip)
            slips += size(most["G"][i], self.u_slip) + size(most["L"][i] + self.N[i], self.y_slip * 2)
            need = W[i] + self.noise(i, s) + later[i] + slips
            need += beyond(left[0][i], self.R[i], self.x) + beyond(left[1][i], self.S[i], self.u_true)
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


def covered(t, name, q, i, need, before, after):
    """The outward offset and the rounding of its sum; refuses where it is too small."""
    value = F(t[name][q][i]) * (1 if name.endswith("hi") else -1)
    error, _ = rounding([*before, (F(1), value), *after], t["real"])
    demand(need + error <= value, f"offset {name}[{i}] of mode {q} lacks {float(need + error - value):.3g}")
    return value, error


def check_blind(m, t, q):
    """Prediction without measurement and parameters, and the bounds of the outputs."""
    n, v, p = len(m.x), t["vary"], m.p
    one = [[F(i == j) for j in range(n)] for i in range(n)]
    A, B, C, D, Ra, Sa = (exact(x[q]) for x in (t["A"], t["B"], t["C"], t["D"], v["Ra"], v["Sa"]))
    target = [[a + b for a, b in zip(A, B)], *(times(0, add(p["F"][0])) for _ in m.box)]
    inside = [(c - k, c + k) for c, k in zip(m.z["middle"], m.z["K"])]
    left = split(left_over(one, m.z, target, inside, [F(0)] * len(inside)), n)
    for side, s in SIDES:
        for i, w in enumerate(m.z["W"](one, s)):
            error, spread = rounding([*zip(Ra[i], m.x), *zip(Sa[i], m.u)], m.real)
            need = w + error + beyond(left[0][i], Ra[i], m.x) + beyond(left[1][i], Sa[i], m.u_true)
            covered(t, "a_" + side, q, i, need + size(B[i] + Sa[i], m.u_slip * 2), zip(B[i], m.u),
                    [*zip(A[i], m.x), (F(1), spread)])
        for j in range(len(C)):
            need = sup(p["Dv"][j], p["v"], s) + size(p["C"][j], m.x, C[j]) + size(p["D"][j], m.u_true, D[j])
            covered(t, "c_" + side, q, j, need + size(D[j], m.u_slip) + m.y_slip[j], zip(D[j], m.u), zip(C[j], m.x))


def check_change(t, cert):
    """The change of coordinates: ranges of z, both maps, and the widths of x that follow from those of z."""
    c = {k: exact(v) for k, v in t["change"].items()}
    x = list(zip(*(exact(t[f"x_{s}"]) for s in ("lo", "hi"))))
    both = {"real": t["real"]} | {f"{k}_{s}": [t["change"][f"{k}_{s}"]] for k in "eb" for s, _ in SIDES}
    identity = [[F(i == j) for j in range(len(x))] for i in range(len(x))]
    lost = sub(identity, mul(c["X"], c["Z"]))
    for i, row in enumerate(c["Z"]):
        demand(c["z_hi"][i] >= sup(row, x) and -c["z_lo"][i] >= sup(row, x, -1)
               and c["box"][i] >= max(c["z_hi"][i], -c["z_lo"][i]), f"range of z[{i}]")
        for s, _ in SIDES:
            covered(both, f"e_{s}", 0, i, F(0), [], zip(row, exact(t["box"])))
    for i, row in enumerate(c["X"]):
        room = [covered(both, f"b_{s}", 0, i, size(lost[i], exact(t["box"])), [], list(zip(row, c["box"])))
                for s, _ in SIDES]
        if cert.get("steady_box"):
            width = size(row, exact(cert["steady_box"]["width"])) + sum(b + error for b, error in room)
            demand(F(cert["x_width"][i]) >= width, f"ultimate width of x[{i}]")


def check_tables(modes, t, late):
    """Containment; returns the tables at the corners of theta, growth of error and width at each, and theta^2."""
    push, theta2, at, widths = {"hi": [], "lo": [], "width": []}, F(0), [], []
    noise2 = [sum((max(sup(r, m.p["v"]), sup(r, m.p["v"], -1)) ** 2 for r in m.p["Dv"]), F(0)) for m in modes]
    tnl = any(any(map(any, m.N)) for m in modes)
    for q, m in enumerate(modes):
        for i, j in product(range(len(m.x)), repeat=2):
            fixed = not any(slope[i][j] for slope in m.M[1:])  # a constant may take the opposite bound
            demand(fixed or min(M[i][j] for M in m.corners("M")) >= 0, f"T A - L C < 0 in mode {m.p['name']}, row {i}")
        check_blind(m, t, q)
        NDv = [(mul(m.N, r.p["Dv"]), r.p["v"]) for r in modes]
        width, grow = [F(0)] * len(m.x), {}
        others = modes if late else [m]
        left = [m.left(r.z) for r in others]
        for side, s in SIDES:
            later = [max(sup(N[i], b, -s) for N, b in NDv) for i in range(len(m.x))]
            slack = [F(0)] * len(m.x)
            for i, (need, before, after, slips, apart) in enumerate(m.rows(s, later, left[others.index(m)])):
                d, error = covered(t, "d_" + side, q, i, need, before, after)
                width[i] += d + error + apart
                slack[i] = d + error + slips
            against = [[w + size(a, m.x) + size(b, m.u_true) for w, a, b in zip(r.z["W"](m.T, -s), *A)]
                       for r, A in zip(others, left)]
            grow[side] = [x + max(rows) for x, rows in zip(slack, zip(*against))], later
        for L in m.corners("L"):
            radius = [size(R, m.x) + size(S, m.u) + size(E, row) for R, S, E, row in zip(m.R, m.S, m.E, L)]
            at.append(q)
            widths.append([a + 2 * b for a, b in zip(width, radius)])
            for side, s in SIDES:
                slack, later = [a + b for a, b in zip(grow[side][0], radius)], grow[side][1]
                LDv = [(mul(L, r.p["Dv"]), r.p["v"]) for r in others]
                rise = [max(sup(D[i], b, s) for D, b in LDv) + max(sup(N[i], b, s) for N, b in NDv)
                        for i in range(len(slack))]
                push[side].append([a + b for a, b in zip(slack, rise)])
                fall = [-s * size_of(row, m.mid) if len(m.M) > 1 else sup(row, m.p["v"], -s)
                        for row in mul(L, m.p["Dv"])]
                slack2 = sum((max(a, -b - c, 0) ** 2 for a, b, c in zip(slack, fall, later)), F(0))
                theta2 = max(theta2, slack2 + noise2[q] + (max(noise2) if tnl else 0))
    push["width"] = widths
    return at, push, theta2


def main(folder, design, record):
    """Check a folder."""
    given, boxes, signals, h, late = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        both, cert = t["vary"]["midpoint"], design["certificate"][real]
        known = [j for j, s in enumerate(signals["theta"]) if s.get("measured", True)]
        demand(t["vary"]["columns"] == known and t["vary"]["late"] == late and t["clamp"], "what is measured")
        demand(not both or (h is not None and design["family"] == "tnl" and known and all(
            "rate" in signals["theta"][j] for j in known) and all(m["theta"] == given[0]["theta"] for m in given)),
            "the mean of both ends is no measure of the parameters")
        for name, box in boxes.items():
            for lo, hi, (a, b), z in zip(t[name + "_lo"], t[name + "_hi"], box, t["box"]):
                demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)) and max(-lo, hi) <= z, f"box {name} too small")
        modes = [Mode(p, t, q, transition(p, signals, h, both), both) for q, p in enumerate(given)]
        at, push, theta2 = check_tables(modes, t, late)
        if "change" in t:
            check_change(t, cert)
        grown = {f"{k}_{s}": [mag(A) if k == "M" else A for m in modes for A in m.corners(k)]
                 for k in "MGLN" for s, _ in SIDES} | ({"G_lo": None} if late else {})  # late: no width
        spread = {f"P_{s}": [cert[f"P_{s}"][q] for q in at] for s, _ in SIDES if f"P_{s}" in cert}
        plain.check_claims([given[q] for q in at], t | grown, cert | spread, push, theta2)
        print(f"proved for {real}: containment with rounding{', of the continuous plant at its samples' if h else ''}, "
              f"for every parameter in its box, {cert['kind']} claim")
    t = design["tables"][record["real"]]
    v = {k: x for k, x in t["vary"].items() if isinstance(x, list) and k != "columns"}
    v |= {k: x for k, x in t.get("change", {}).items() if k != "box"}
    plain.check_source((folder / f"{record['prefix']}.c").read_text(), t | {
        "M_hi": [t["M_hi"], *v.values()], "half": [0.5] * t["vary"]["midpoint"]})
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
