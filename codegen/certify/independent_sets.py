"""Point observers with an error set, checked again: what ``independent.py`` hands designs with a ``shape`` over to.

Standard library only, nothing of residua imported; exact fractions. With x_hat as the C computes it, T = I - N C and
e^ = x - x_hat + N_o Dv (v - c) (N_o: the gain that put this sample's noise into x_hat, or none), any constants give

    e^+ = M e^ + T Bw w - (M N_o + L) Dv (v - c) + rest,        r = C e^ + (Dv - C N_o Dv) (v - c) + rest,
    rest = (T A - L C - M) x + (T B - L D - G) u + offset left over + inputs' and sums' rounding.

One file per kind of set (``KINDS``) asks that the set takes all of it.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, positive, root, rounding, size, sub  # noqa: E402
from independent_source import check_source  # noqa: E402 - both stand beside this file


def transposed(A):
    """Transpose."""
    return [list(row) for row in zip(*A)]


def scaled(A, factors):
    """Columns times factors."""
    return [[a * f for a, f in zip(row, factors)] for row in A]


def add(A, B, sign=1):
    """A + sign B."""
    return [[a + sign * b for a, b in zip(r, s)] for r, s in zip(A, B)]


def times(A, x):
    """Matrix times vector."""
    return [sum((a * b for a, b in zip(row, x)), F(0)) for row in A]


def magnitudes(A):
    """Entries' magnitudes."""
    return [[abs(a) for a in row] for row in A]


#: The file that checks a kind of set: ``check(e, cert, ranges, box0)`` says what it has proved.
KINDS = {"zonotope": "zonotope", "ellipsoid": "ellipsoid", "box": "box", "thresholds": "table", "schedule": "schedule",
         "ellipsoid_trace": "trace", "blocks": "blocks", "starts": "starts"}


class Error:
    """The error recursion of the tables of one number type: columns of noise per mode and origin, and the rests."""

    def __init__(self, modes, t):
        self.modes, self.t, self.real, (self.u, self.tiny) = modes, t, t["real"], UNIT[t["real"]]
        self.n, self.m, self.tnl = len(t["box"]), len(t["y_lo"]), t["kind"] == "tnl"
        self.box, self.limit = exact(t["box"]), exact(t["limit"])
        self.M, self.A, self.C, self.G, self.L, self.N = (exact(t[k]) for k in "MACGLN")
        self.none = [[F(0)] * self.m for _ in range(self.n)]
        demand(self.tnl or not any(any(map(any, N)) for N in self.N), "a gain N in a Luenberger observer")
        demand(not self.tnl or all(p["C"] == modes[0]["C"] and not any(map(any, p["D"])) for p in modes),
               "N beside D, or beside a C that changes")
        self.gains = [*self.N, self.none] if self.tnl else [self.none]
        self.w = [([(a + b) / 2 for a, b in p["w"]], [(b - a) / 2 for a, b in p["w"]]) for p in modes]
        self.v = [([(a + b) / 2 for a, b in p["v"]], [(b - a) / 2 for a, b in p["v"]]) for p in modes]
        if self.tnl:  # one centre for all modes: the noise of a sample is in two steps
            centre = [(min(a) + max(b)) / 2 for a, b in (zip(*e) for e in zip(*(p["v"] for p in modes)))]
            self.v = [(centre, [max(b - c, c - a) for (a, b), c in zip(p["v"], centre)]) for p in modes]
        self.umax, self.ymax = ([max(abs(F(a)), abs(F(b))) for a, b in zip(t[k + "_lo"], t[k + "_hi"])] for k in "uy")
        self.uslip, self.yslip = ([self.u * b + self.tiny for b in k] for k in (self.umax, self.ymax))
        self.utrue = [a + b for a, b in zip(self.umax, self.uslip)]

    def step(self, q, o, measured):
        """Columns that a step of mode q adds where the estimate holds the noise of gain o."""
        p, N = self.modes[q], self.N[q] if measured else self.none
        Bw, Dv = scaled(p["Bw"], self.w[q][1]), scaled(p["Dv"], self.v[q][1])
        TBw = sub(Bw, mul(N, mul(p["C"], Bw)))
        held = mul((self.M if measured else self.A)[q], mul(self.gains[o], Dv))
        LDv = mul(self.L[q], Dv) if measured else [[F(0)] * len(r) for r in held]
        return [a + [-b - c for b, c in zip(r, s)] for a, r, s in zip(TBw, held, LDv)]

    def direct(self, q, o):
        """Columns of noise in the residual."""
        Dv = scaled(self.modes[q]["Dv"], self.v[q][1])
        return sub(Dv, mul(self.C[q], mul(self.gains[o], Dv)))

    def held(self, o):
        """Largest part of x_hat's error that is noise of its own sample."""
        rows = [times(magnitudes(mul(self.gains[o], p["Dv"])), self.v[q][1]) for q, p in enumerate(self.modes)]
        return [max(r) for r in zip(*rows)]

    def rest(self, q, measured):
        """Box that a step adds besides."""
        p, t, n = self.modes[q], self.t, self.n
        w, v = self.w[q][0], self.v[q][0]
        if measured:
            M, G, L, N, name = self.M[q], self.G[q], self.L[q], self.N[q], "d"
        else:
            M, G, L, N, name = self.A[q], exact(t["B"][q]), self.none, self.none, "a"
        T = sub([[F(i == j) for j in range(n)] for i in range(n)], mul(N, p["C"]))
        EM, EG = sub(sub(mul(T, p["A"]), mul(L, p["C"])), M), sub(sub(mul(T, p["B"]), mul(L, p["D"])), G)
        centre = times(mul(T, p["Bw"]), w)
        if measured:
            centre = [a - b for a, b in zip(centre, times(mul(add(L, N), p["Dv"]), v))]
        moved = [times(mul(N, sub(s["Dv"], p["Dv"])), v) for s in self.modes]
        out = []
        for i in range(n):
            given = F(t[name][q][i])
            terms = [*zip(G[i], self.umax), *zip(L[i], self.ymax), *zip(N[i], self.ymax), (F(1), given),
                     *zip(M[i], self.box)]
            out.append(size(EM[i], self.box) + size(EG[i], self.utrue) + size(G[i], self.uslip)
                       + size(L[i], self.yslip) + size(N[i], self.yslip) + abs(given - centre[i])
                       + max(abs(r[i]) for r in moved) + rounding(terms, self.real)[0])
        return out

    def residual_rest(self, q):
        """The same of the residual."""
        p, t, D = self.modes[q], self.t, exact(self.t["D"][q])
        centre = times(p["Dv"], self.v[q][0])
        out = []
        for i in range(self.m):
            given = F(t["c"][q][i])
            terms = [*zip(D[i], self.umax), (F(1), given), *zip(self.C[q][i], self.box), (F(1), self.ymax[i])]
            out.append(size(p["C"][i], self.box, self.C[q][i]) + size(p["D"][i], self.utrue, D[i])
                       + size(D[i], self.uslip) + self.yslip[i] + abs(given - centre[i])
                       + rounding(terms, self.real)[0])
        return out


def check_boxes(e, ranges, box0, spread, share):
    """Ranges, limits and the box of the estimate; ``share`` is what a box's set has of its half widths, at most."""
    t = e.t
    for name, given in (("x", ranges), ("x0", box0)):
        for lo, hi, (a, b), z, limit, s in zip(t[name + "_lo"], t[name + "_hi"], given, e.box, e.limit, spread):
            demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)), f"box {name} too small")
            demand(max(abs(F(lo)), abs(F(hi))) + limit <= z, "box of the estimate below range plus limit")
            demand(share * (F(hi) - F(lo)) / 2 + s <= limit, "limit below the declared range")


def check_level(e, cert):
    """The matrix inequality of the gains, jumps, dwell time and level (the head of residual_gain states them)."""
    if cert["kind"] == "none":
        return
    lam, rho, g, hinf = F(cert["lam"]), F(cert["rho"]), F(cert["g"]), cert["kind"] == "hinf"
    P, n, k = exact(cert["P"]), e.n, 0
    demand(0 <= lam < 1 and (hinf or lam > 0) and rho >= 1, "lambda or rho")
    units = [1 / F(x) ** 2 for x in cert.get("x_unit", [1] * n)] if not hinf else [F(0)] * n
    yunit = [F(1) / F(x) for x in cert.get("y_unit", [1] * e.m)]
    for p in P:
        demand(p == transposed(p) and positive([[x - units[i] * (i == j) for j, x in enumerate(r)]
                                               for i, r in enumerate(p)]), "P")
    half = [max(h) for h in zip(*([(b - a) / 2 for a, b in p["v"]] for p in e.modes))] or []
    noises = [scaled(p["Dv"], half) for p in e.modes]
    tnl = any(any(map(any, N)) for N in e.N)
    for q, p in enumerate(e.modes):
        T = sub([[F(i == j) for j in range(n)] for i in range(n)], mul(e.N[q], p["C"]))
        M = sub(mul(T, p["A"]), mul(e.L[q], p["C"]))
        TBw, LDv = mul(T, scaled(p["Bw"], [(b - a) / 2 for a, b in p["w"]])), mul(e.L[q], noises[q])
        C = [[c * s for c in row] for row, s in zip(p["C"], yunit)]
        for later in noises if tnl else noises[:1]:
            ND = [[-x for x in r] for r in mul(e.N[q], later)] if tnl else [[] for _ in range(n)]
            H = [a + [-b for b in r] + c for a, r, c in zip(TBw, LDv, ND)]
            k = len(H[0])
            Z = [[F(0)] * len(TBw[0]) + [x * s for x in row] + [F(0)] * len(ND[0])
                 for row, s in zip(noises[q], yunit)]
            for after in [P[q]] if lam > 0 else P:
                demand(positive(inequality(M, H, C, Z, P[q], after, lam, g, hinf)), f"matrix inequality, mode {q}")
    factor = F(1)
    if lam > 0:
        demand(all(a == b or positive(sub([[rho * x for x in r] for r in b], a)) for a in P for b in P), "jump factor")
        factor = (lam if hinf else k) / lam
        if rho > 1:  # at most N0 + s/tau jumps by rho in s samples
            drain, tau = cert["dwell_drain"], cert["dwell_add"]
            demand((1 - lam) ** tau * rho ** drain < 1, "dwell time")
            power = F(-((-F(cert["chatter"]) * 64) // 1), 64) + F(drain, tau)
            factor *= lam * root(rho, power.numerator, power.denominator) / (1 - (1 - lam) * root(rho, drain, tau))
    demand(F(cert["level"]) ** 2 >= factor * g, "level")


def inequality(M, H, C, Z, P, after, lam, g, hinf):
    """Rows of the symmetric matrix that must be positive definite."""
    n, k = len(M), len(H[0])
    CC, CZ, ZZ = (mul(transposed(a), b) if hinf else [[F(0)] * len(b[0])] * len(a[0])
                  for a, b in ((C, C), (C, Z), (Z, Z)))
    PM, PH = mul(after, M), mul(after, H)
    top = [[(1 - lam) * P[i][j] - CC[i][j] for j in range(n)] + [-x for x in CZ[i]] + [r[i] for r in PM]
           for i in range(n)]
    mid = [[-CZ[j][i] for j in range(n)] + [g * (i == j) - ZZ[i][j] for j in range(k)] + [r[i] for r in PH]
           for i in range(k)]
    return top + mid + [PM[i] + PH[i] + after[i] for i in range(n)]


def main(folder, design, record):
    """Check a folder of a point observer."""
    modes, ranges, box0 = __import__("independent_sampled").read_sampled(design["plant"]["toml"])  # stands beside
    for real, t in design["tables"].items():
        e, cert = Error(modes, t), design["certificate"][real]
        if cert["set"] not in KINDS:
            print(f"nothing is said about sets of kind {cert['set']}", file=sys.stderr)
            sys.exit(2)
        says = __import__(f"independent_{KINDS[cert['set']]}").check(e, cert, ranges, box0)  # stands beside this file
        check_level(e, cert)
        print(f"proved for {real}: {says}, {cert['kind']} claim")
    check_source((folder / f"{record['prefix']}.c").read_text(), design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
