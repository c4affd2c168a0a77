"""One observer of a bank, checked again: gain, sensitivity, start, limits; ``independent_bank.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. Member p reads y_p, all outputs but those of its
fault; the plant takes Euler steps, or its own. With T1_j E + T2* C = I next to the member's T2 and e = T1 E x - z,

    e+ = T1_j (E x+) - F_j x_hat - G_j u + K_j r,   x_hat = (I - (T2* - T2) C) x - e + T2 v,   r = C x + v - C x_hat,

for plant and observer at any pair of vertices that both can be at. E is diagonal, of ones and zeros; other plants are
not known (status 2).
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from math import isqrt
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, size, sub  # noqa: E402 - stands beside this file
from independent_energy import surely_positive  # noqa: E402
from independent_formula import unknown  # noqa: E402
from independent_table import inverse  # noqa: E402

SHARE = F(1, 20)


def eye(n):
    """Identity."""
    return [[F(i == j) for j in range(n)] for i in range(n)]


def turned(A):
    """Transpose."""
    return [list(c) for c in zip(*A)]


def times(c, A):
    """A number times a matrix."""
    return [[c * a for a in row] for row in A]


def add(*matrices):
    """Sum."""
    return [[sum(e, F(0)) for e in zip(*rows)] for rows in zip(*matrices)]


def beside(*matrices):
    """Side by side."""
    return [sum(map(list, rows), []) for rows in zip(*matrices)]


def gram(P, A):
    """A' P A."""
    return mul(turned(A), mul(P, A))


def largest(bounds):
    """Largest magnitude of each range, 1 where there is none."""
    return [max(abs(a), abs(b)) or F(1) for a, b in bounds]


def root(x):
    """A fraction not below the square root, by a part in 2^60 at most."""
    scale = 4 ** (60 + max(0, (x.denominator.bit_length() - x.numerator.bit_length()) // 2 + 1))
    return F(isqrt(x.numerator * scale // x.denominator) + 1, 2 ** ((scale.bit_length() - 1) // 2))


def norm2(P, bounds):
    """Square of the norm that entries within bounds can have."""
    return sum((abs(a) * x * y for row, x in zip(P, bounds) for a, y in zip(row, bounds)), F(0))


class Member:
    """One observer with its proof."""

    def __init__(self, plant, t, k, stored):
        own, self.k, self.plant, self.t, self.stored, self.proof = t["members"][k], k, plant, t, stored, stored["proof"]
        self.seen = own["seen"]
        kept = [i for i, row in enumerate(plant["Df"]) if row[k] == 0]
        demand(self.seen == kept, f"outputs of member {k}")
        self.others = [j for j in range(len(plant["f"])) if j != k]
        self.T2, self.C, self.F, self.G, self.K, self.M = (exact(own[x]) for x in ("T2", "C", "F", "G", "K", "M"))
        self.z0, self.P1 = exact(own["z0"]), exact(self.proof["level"]["P1"])
        self.Cp = [plant["C"][i] for i in self.seen]
        self.n, self.c = len(self.z0), F(self.proof["level"]["contraction"])
        self.u, self.y = largest(plant["u"]), largest([plant["y"][i] for i in self.seen])
        n, E = self.n, plant["E"]
        unknown(any(x not in (0, int(i == j)) for i, row in enumerate(E) for j, x in enumerate(row)))
        self.Z = [i for i in range(n) if not E[i][i]]
        cols = turned([[row[i] for i in self.Z] for row in self.Cp])  # C K, K the columns of I in the kernel of E
        lack = sub([[F(i == j) for j in self.Z] for i in range(n)], mul(self.T2, turned(cols))) if self.Z else []
        self.near = add(self.T2, mul(lack, mul(inverse(mul(cols, turned(cols))), cols))) if self.Z else self.T2
        base = sub(eye(n), mul(self.near, self.Cp))
        demand(not any(row[i] for row in base for i in self.Z), "T1 E + T2 C = I")
        self.TE = base
        self.T1 = [[[F(T[i][j]) if j in self.Z else base[i][j] for j in range(n)] for i in range(n)]
                   for T in self.every(self.proof["T1"])]
        demand(len(self.T1) == len(self.F) == len(plant["vertices"]), "a T1 for every vertex")

    def every(self, T1):
        """T1 of every vertex, one where both are at one vertex: what is zero is so for a mixture of them alone."""
        count = len(self.plant["vertices"])
        if not isinstance(T1[0][0], list):
            return [T1] * count
        demand(len(self.plant["pairs"]) == count ** 2, "T1 of every vertex where both are at one")
        return T1

    def negative(self, S, words):
        """Refuse unless a symmetric matrix is negative definite."""
        demand(surely_positive(times(F(-1), S)), f"{words} of the observer without {self.plant['names'][self.k]}")

    def level(self):
        """Energy of the weighted residual, and the contraction of the error."""
        p, n, proof = self.plant, self.n, self.proof["level"]
        w = [max(abs(a), abs(b)) or F(1) for a, b in p["w"]]
        v, h = [max(abs(a), abs(b)) or F(1) for a, b in p["v"]], p["period"]
        Dv = [[a * b for a, b in zip(p["Dv"][i], v)] for i in self.seen]
        Bw = [[a * b for a, b in zip(row, w)] for row in p["Bw"]]
        m, q, s = len(self.u), len(w) + len(v), [[F(0)] * len(w) for _ in self.seen]
        zero, D = [[F(0)] * m for _ in range(n)], beside(s, Dv)
        held = sub(eye(n), mul(sub(self.near, self.T2), self.Cp))
        estimate = beside(times(F(-1), eye(n)), held, zero, mul(self.T2, D))
        r = sub(beside([[F(0)] * n for _ in self.seen], self.Cp, [[F(0)] * m for _ in self.seen], D),
                mul(self.C, estimate))
        out, wide, P1, P2, R = mul(self.M, r), 2 * n + m + q, self.P1, exact(proof["P2"]), exact(proof["R"])
        demand(surely_positive(P1) and surely_positive(P2) and turned(P1) == P1 and turned(P2) == P2, "P1, P2")
        heard, g = mul(turned(out), out), F(proof["level2"])
        told = self.proof.get("period")
        demand(F(self.stored["gamma"]) ** 2 >= g and (told if told is None else F(told)) == p["euler"],
               "level or period")
        before = gram(P2, p["E"])
        for i, (A, B) in enumerate(p["vertices"]):
            B = [[a * b for a, b in zip(row, self.u)] for row in B]
            flow = beside([[F(0)] * n for _ in range(n)], add(p["E"], times(h, A)), times(h, B), times(h, Bw),
                          [[F(0)] * len(v) for _ in range(n)])
            zeros = mul(R, [flow[z] for z in self.Z]) if self.Z else times(F(0), heard)
            plain = add(gram(P2, flow), heard, zeros, turned(zeros))
            for j in (b for a, b in p["pairs"] if a == i):
                Fj, G, K = self.F[j], self.G[j], self.K[j]
                fed = beside([[F(0)] * 2 * n for _ in range(n)], [[a * b for a, b in zip(row, self.u)] for row in G],
                             [[F(0)] * q for _ in range(n)])
                step = sub(add(mul(Fj, estimate), fed), mul(K, r))
                S = add(plain, gram(P1, sub(mul(self.T1[j], flow), step)))
                for a in range(n):
                    for b in range(n):
                        S[a][b] -= P1[a][b]
                        S[n + a][n + b] -= before[a][b]
                for a in range(2 * n, wide):
                    S[a][a] -= g
                self.negative(S, f"the level at vertices {i}, {j}")
        for j, (Fj, K) in enumerate(zip(self.F, self.K)):
            self.negative(sub(gram(P1, add(Fj, mul(K, self.C))), times(self.c ** 2, P1)), f"the contraction at {j}")

    def fault(self):
        """Constant faults of other sensors, with weights that stand still."""
        p, n, proof, h = self.plant, self.n, self.proof["fault"], self.plant["period"]
        scale, b, Y = largest(p["f"]), F(proof["level2"]), exact(proof["Y1"])
        Df = [[p["Df"][i][j] * scale[j] for j in self.others] for i in self.seen]
        heard = mul(self.M, beside(self.C, Df))  # of e - T2 Df f, what moves while f stands still
        demand(surely_positive(Y) and turned(Y) == Y and self.proof["criterion"] == "slow", "Y1")
        demand(F(self.stored["beta"]) >= 0 and F(self.stored["beta"]) ** 2 <= b, "sensitivity")
        lost, wide = mul(turned(heard), heard), n + len(self.others)
        for j, (Fj, K) in enumerate(zip(self.F, self.K)):
            N = add(Fj, mul(K, self.C))
            by_f = sub(mul(K, Df), mul(self.T2, Df))  # F T2 and K C T2 are in N T2
            V = mul(Y, times(1 / h, beside(sub(N, eye(n)), by_f))) + [[F(0)] * wide for _ in self.others]
            S = sub(add(V, turned(V)), lost)
            for a in range(n, wide):
                S[a][a] += b
            self.negative(S, f"the sensitivity at {j}")

    def starts(self):
        """What is left of a start when judging begins."""
        t, start, rate, N = self.t, self.stored["start"], F(self.t["rate"]), self.t["settle"]
        g2, out = F(start["gain2"]), mul(self.M, self.C)
        demand(start["member"] == self.k, "start of another member")
        self.negative(sub(mul(turned(out), out), times(g2, self.P1)), "size of the residual")

        def begun(box):
            far = [abs(size_of(row, [(a + b) / 2 for a, b in box]) - z) + size(row, [(b - a) / 2 for a, b in box])
                   for row, z in zip(self.TE, self.z0)]
            return norm2(self.P1, far)
        for name in ("x", "x0"):
            for lo, hi, (a, b) in zip(t[f"{name}_lo"], t[f"{name}_hi"], self.plant[name]):
                demand(F(lo) <= a and F(hi) >= b, f"box {name} too small")
        whole, first = ([(F(a), F(b)) for a, b in zip(t[f"{k}_lo"], t[f"{k}_hi"])] for k in ("x", "x0"))
        most = SHARE ** 2 * F(t["bound"][self.k])
        c = self.c
        factor = rate / (c - 1 + rate) * c ** N if c > 1 - rate else rate * N * max(c, 1 - rate) ** (N - 1)
        demand(0 <= c < 1 and g2 * begun(whole) * factor ** 2 <= most, f"settling time of member {self.k}")
        demand(t["begin"] in (0, N) and (t["begin"] == N or g2 * begun(first) <= most), f"start of member {self.k}")

    def limits(self, limit, most):
        """No accepted measurement takes states or averages to their limits, rounding included."""
        (u, tiny), n, h = UNIT[self.t["real"]], self.n, len(self.F)
        y, inputs = ([max(abs(F(a)), abs(F(b))) for a, b in zip(self.t[k + "_lo"], self.t[k + "_hi"])] for k in "yu")
        y = [y[i] for i in self.seen]
        count = n + len(y) + len(inputs) + h + 4
        g, tiny = (1 + u) ** count - 1, 4 * count * tiny
        more = 16 * (len(self.t["weights"]["operations"]) + h) * u
        x = [(l + size(row, y)) * (1 + g) + tiny for l, row in zip(limit, self.T2)]
        off_x = [g * a + tiny for a in x]
        r = [(a + size(row, x)) * (1 + g) + tiny for a, row in zip(y, self.C)]
        off_r = [g * a + size(row, off_x) + tiny for a, row in zip(r, self.C)]
        back, pushed, off = inverse(self.P1), F(0), [F(0)] * n
        for Fj, G, K in zip(self.F, self.G, self.K):
            by_y = sub(mul(Fj, self.T2), mul(K, sub(eye(len(y)), mul(self.C, self.T2))))
            pushed = max(pushed, root(norm2(self.P1, [size(a, y) + size(b, inputs) for a, b in zip(by_y, G)])))
            lost = [size(a, off_x) + size(k, off_r) + (3 * g + 2 * more) * (1 + g) * (size(a, x) + size(b, inputs)
                    + size(k, r)) + tiny for a, b, k in zip(Fj, G, K)]
            off = [max(a, b) for a, b in zip(off, lost)]
        room = min(l * l / back[i][i] for i, l in enumerate(limit))
        R = room / root(room)
        demand((1 + more) * (self.c * R + pushed + root(norm2(self.P1, off))) <= R, f"limits of member {self.k}")
        demand(norm2(self.P1, list(map(abs, self.z0))) <= R * R, f"start of member {self.k} within its limits")
        rate = F(self.t["rate"])
        for a, row in zip(most, self.M):
            e = size(row, r) * (1 + g) + tiny
            demand(0 < rate <= 1 and rate * (a - e) >= 4 * u * (2 * a + e) + tiny, f"averages of member {self.k}")


def size_of(row, values):
    """Row times values."""
    return sum((a * b for a, b in zip(row, values)), F(0))
