"""The error of a polytopic observer pair of vertices by pair; ``independent_polytopic.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. With eb = T1 E x - z for the plant at vertex i and
the observer at vertex j, whatever T1 is, R = I - T1 E - T2 C,

    x_hat = (I - R) x - eb + T2 Dd d,    r = y - C_o x_hat,    eb+ = T1 (E x+) - F_j x_hat - G_j u + K_j r

where E x+ = A_i x + B_i u + Bd_i d, of a continuous plant E x + T (A_i x + ..) with the mean of the change of x since
the sample added, see ``independent_drift.py``.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, exact, mul, rounding, sub  # noqa: E402 - stands beside this file


def unit(n):
    """Identity."""
    return [[F(i == j) for j in range(n)] for i in range(n)]


def add(*parts):
    """Sum of matrices."""
    return [[sum(e, F(0)) for e in zip(*rows)] for rows in zip(*parts)]


def scaled(c, A):
    """Matrix times a number."""
    return [[c * a for a in row] for row in A]


def beside(*parts):
    """Matrices side by side."""
    return [sum(rows, []) for rows in zip(*parts)]


def transposed(A):
    """Column after column."""
    return [list(c) for c in zip(*A)]


def reach(row, box):
    """Largest magnitude of a row over a box of (middle, half width)."""
    middle = sum((a * m for a, (m, _) in zip(row, box)), F(0))
    return abs(middle) + sum((abs(a) * h for a, (_, h) in zip(row, box)), F(0))


def kernel(E):
    """Columns S with E' S = 0; empty rows where there are none."""
    rows, n, pivots = transposed(E), len(E), []
    for c in range(n):
        k = len(pivots)
        best = next((i for i in range(k, len(rows)) if rows[i][c]), None)
        if best is None:
            continue
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [a / rows[k][c] for a in rows[k]]
        rows = [row if i == k else [a - row[c] * b for a, b in zip(row, rows[k])] for i, row in enumerate(rows)]
        pivots.append(c)
    free = [c for c in range(n) if c not in pivots]
    S = [[F(int(i == c)) for c in free] for i in range(n)]
    for row, c in zip(rows, pivots):
        S[c] = [-row[k] for k in free]
    return S


def solved(A, B):
    """Solution of A X = B by elimination."""
    rows, n = beside(A, B), len(A)
    for k in range(n):
        best = next(i for i in range(k, n) if rows[i][k])
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [a / rows[k][k] for a in rows[k]]
        rows = [row if i == k else [a - row[k] * b for a, b in zip(row, rows[k])] for i, row in enumerate(rows)]
    return [row[n:] for row in rows]


def nearest(E, C, S, T1, T2):
    """The T1 that T2, rounded as it is, leaves least over of T1 E + T2 C = I: its part on algebraic rows is the given.

    Any T1 would do; E K = 0 and T (I - T2 C) K = 0 say which T2 is the next one for which there is an exact one.
    """
    n, K = len(E), kernel(transposed(E))
    if K[0]:
        seen = mul(C, K)
        T2 = add(T2, mul(sub(K, mul(T2, seen)), solved(mul(transposed(seen), seen), transposed(seen))))
    own = []
    for c in transposed(E):  # columns that span the others
        own += [] if kernel([*own, c])[0] else [c]
    left = solved(mul(own, transposed(own)), own)
    H = mul(left, E)
    inverse = mul(transposed(H), solved(mul(H, transposed(H)), left))
    base = mul(sub(unit(n), mul(T2, C)), inverse)
    if S[0]:
        onto = mul(S, solved(mul(transposed(S), S), transposed(S)))
        base = add(base, mul(sub(T1, base), onto))
    return base


def driven(known, own):
    """Columns of what several signals do: of their middles, of each half width, and of unknowns of known sizes."""
    known = list(known)
    rows = range(len(known[0][0]))
    columns = [[sum((b * m for M, box in known for b, (m, _) in zip(M[k], box)), F(0)) for k in rows]]
    columns += [[row[k] * half for row in M] for M, box in known for k, (_, half) in enumerate(box)]
    columns += [[row[k] * size for row in M] for M, sizes in own for k, size in enumerate(sizes)]
    return transposed(columns)


def sizes(t, name):
    """Largest magnitudes of what the C accepts or limits."""
    return [max(abs(F(a)), abs(F(b))) for a, b in zip(t[name + "_lo"], t[name + "_hi"])]


def off_one(t):
    """How far the weights of the C may add up to something else than 1."""
    return (8 * len(t["F"]) + 4) * 2 * UNIT[t["real"]][0]


class Plant:
    """Vertices for [w; v], boxes as (middle, half width), steps of the plant, and the premises of its weights."""

    def __init__(self, p):
        self.E, self.C, self.T = p["E"], p["C"], p["period"]
        n, n_w, n_v = len(self.E), len(p["w"]), len(p["v"])
        self.A, self.B = ([v[k] for v in p["vertices"]] for k in "AB")
        self.Bd = [beside(v["Bw"], [[F(0)] * n_v for _ in range(n)]) for v in p["vertices"]]
        self.Dd = [[F(0)] * n_w + row for row in p["Dv"]]
        self.box = {k: [((a + b) / 2, (b - a) / 2) for a, b in ends] for k, ends in p.items() if k in ("x", "u", "x0")}
        self.box["d"] = [((a + b) / 2, (b - a) / 2) for a, b in p["w"] + p["v"]]
        self.size = {k: [max(abs(a), abs(b)) or F(1) for a, b in p[k]] for k in "xuywv"}
        self.S = kernel(self.E)
        self.tied, self.premises, self.ends = p["tied"], p["premises"], p["x"] + p["u"]
        if self.T is not None:
            self.flow = [[add(scaled(self.T, M), base) if base else scaled(self.T, M) for M in some]
                         for some, base in ((self.A, self.E), (self.B, None), (self.Bd, None))]
        else:
            self.flow = [self.A, self.B, self.Bd]


class Errors:
    """The recursion of eb, pair by pair, on the numbers of the tables."""

    def __init__(self, plant, t, T1, drift=None):
        self.plant, self.t, self.real, self.drift = plant, t, t["real"], drift
        self.T2, self.C, self.M = exact(t["T2"]), exact(t["C"]), exact(t["M"])
        self.T1 = nearest(plant.E, plant.C, plant.S, exact(T1), self.T2)
        self.F, self.G, self.K = (exact(t[k]) for k in "FGK")
        self.kept, self.known, self.told = range(len(self.C[0])), exact(t.get("known", [[]] * len(self.C[0]))), []
        self.seen = add(mul(self.T1, plant.E), mul(self.T2, plant.C))  # I - R
        self.passed = sub(unit(len(self.C)), mul(self.C, self.T2))
        self.r_x = sub(plant.C, mul(self.C, self.seen))
        self.shown_x, self.r_d = self.r_x, mul(self.passed, plant.Dd)  # what is judged may leave some of x out
        self.Ee = unit(len(self.C[0]))
        self.N = [add(F_, mul(K, self.C)) for F_, K in zip(self.F, self.K)]

    def terms(self, i, j):
        """Matrices of x, u and d in eb+."""
        a, b, g = (mul(self.T1, flow[i]) for flow in self.plant.flow)
        x = add(a, scaled(-1, mul(self.F[j], self.seen)), mul(self.K[j], self.r_x))
        d = add(g, scaled(-1, mul(mul(self.F[j], self.T2), self.plant.Dd)), mul(self.K[j], self.r_d))
        return x, sub(b, beside(self.G[j], self.known)), d

    def ties(self, i, j):
        """Rows that are zero on e, x, u and d: none, as eb has no algebraic part."""
        return []

    def estimates(self):
        """Rounding and largest magnitude of every entry of x_hat."""
        z, y = (sizes(self.t, k) for k in "zy")
        return [rounding([(F(1), z[i]), *zip(self.T2[i], y)], self.real) for i in range(len(z))]

    def residuals(self):
        """Rounding and largest magnitude of every entry of r."""
        y, most = sizes(self.t, "y"), [m for _, m in self.estimates()]
        return [rounding([(F(1), y[i]), *zip(self.C[i], most)], self.real) for i in range(len(y))]

    def says(self):
        """Per state the terms that all vertices share, and rounding and magnitude of what each says beside them."""
        values = [*(m for _, m in self.estimates()), *sizes(self.t, "u"), *(m for _, m in self.residuals()), *self.told]
        gains = [beside(*(M[j] for M in (self.F, self.G, self.K)), self.known) for j in range(len(self.F))]
        for i in range(len(self.F[0])):
            same = [all(g[i][k] == gains[0][i][k] for g in gains) for k in range(len(values))]
            own = [rounding([(F(0) if s else c, v) for s, c, v in zip(same, g[i], values)], self.real) for g in gains]
            yield [(c if s else F(0), v) for s, c, v in zip(same, gains[0][i], values)], own

    def rounded(self):
        """Rounding of y, u, x_hat, r, M r and z."""
        (u, tiny), off, x_hat, r = UNIT[self.real], off_one(self.t), self.estimates(), self.residuals()
        shown, after = [(F(0), m) for _, m in r], []
        if unit(len(r)) != self.M:
            shown = [rounding(zip(row, [m for _, m in r]), self.real) for row in self.M]
        for shared, own in self.says():
            error, _ = rounding([*shared, *((1 + off, m) for _, m in own)], self.real)
            after.append(error + (1 + off) * max(e for e, _ in own) + off * max(m for _, m in own))
        return (*([u * b + tiny for b in sizes(self.t, k)] for k in "yu"),
                *([e for e, _ in some] for some in (x_hat, r, shown)), after)

    def pushes(self):
        """Per pair of vertices N, columns of what drives eb, M r over eb, and what else is in it."""
        p, n = self.plant, len(self.F[0])
        y, u, x_hat, r, shown, z = self.rounded()
        if p.T is not None:
            change = [self.drift.of(mul(self.T1, M)) for M in p.A]
            z = [a + p.T * max(c) for a, c in zip(z, zip(*change))]
        seen, room = mul(self.M, self.C), []
        parts = [(mul(self.M, self.shown_x), p.box["x"]), (mul(self.M, self.r_d), p.box["d"])]
        for k, row in enumerate(self.M):
            errors = ((mul([row], self.passed)[0], y), (seen[k], x_hat), (row, r))
            lost = sum((abs(a) * e for some, es in errors for a, e in zip(some, es)), F(0))
            room.append(reach(sum((M[k] for M, _ in parts), []), sum((box for _, box in parts), [])) + shown[k] + lost)
        out = []
        for i, j in product(range(len(p.A)), range(len(self.F))):
            of_y = sub(mul(self.F[j], self.T2), mul(self.K[j], self.passed))
            own = ((of_y, y), (self.G[j], u), (self.N[j], x_hat), (self.K[j], r), (unit(n), z))
            known = zip(self.terms(i, j), (p.box["x"], p.box["u"], p.box["d"]))
            out.append((self.N[j], driven(known, own), seen, room))
        return out
