"""A table of thresholds, checked again; see ``independent_sets.py``.

Every entry must be at least the support of all that the error recursion allows: a stage begins with its box, which must
hold whatever leaves the stage before it after the dwell time; a row j is j samples later. Supports along rows a M^j are
calculated in floats with an error bound: |a|_s = sum |a_k| s_k, powers of M are bounded in it exactly (norm of M^p at
most a half), so a rounding d of any step is at most (largest norm of a power) |d|_s in all later ones.
"""

import struct
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul  # noqa: E402 - stands beside this file
from independent_sets import magnitudes, times  # noqa: E402

EPS, WIDE, NIL = 2.0**-52, 1 + 1e-11, 1e-290  # WIDE: of sums of some thousand nonnegative floats
SMALL = 1e-12


def up(x):
    """A float not below a fraction."""
    return float(x) * (1 + 4 * EPS) + NIL


class Mode:
    """Powers of one matrix: norms in units of s."""

    def __init__(self, M, s):
        self.M, self.n = [[float(x) for x in r] for r in M], len(s)
        self.s, norms, power = [up(x) for x in s], [], [[F(i == j) for j in range(len(s))] for i in range(len(s))]
        for _ in range(400):
            norms.append(max(sum(abs(x) * b for x, b in zip(r, s)) / a for r, a in zip(power, s)))
            if norms[-1] <= F(1, 2):
                break
            power = mul(power, M)
            power = [[F(round(x * 2**400), 2**400) for x in r] for r in power]  # an error of 1e-120 changes nothing
        demand(norms[-1] <= F(1, 2), "a mode whose error does not decay")
        self.most, self.all = up(max(norms)) * WIDE, up(2 * sum(norms[:-1]) + 1) * WIDE
        self.columns = [list(c) for c in zip(*self.M)]
        self.one = up(norms[1]) if len(norms) > 1 else 1.0

    def size(self, a):
        """|a|_s."""
        return sum([abs(x) * b for x, b in zip(a, self.s)])


class Gens:
    """Columns and a box, as floats."""

    def __init__(self, columns, box, s):
        self.columns = [[float(x) for x in c] for c in columns]
        self.box = [up(b) for b in box]
        self.rows = [sum([abs(x) for x in r], b) for r, b in zip(zip(*self.columns), self.box)] if columns else self.box
        norm = sum((max(abs(x) / b for x, b in zip(c, s)) for c in columns), F(0)) + max(x / b for x, b in zip(box, s))
        self.norm = up(norm) * WIDE

    def along(self, a):
        """Upper bound of the support in direction a."""
        plain = sum([abs(sum([x * g for x, g in zip(a, c)])) for c in self.columns])
        b = [abs(x) for x in a]
        return (plain + sum([x * w for x, w in zip(b, self.box)])
                + (len(a) + 3) * EPS * sum([x * w for x, w in zip(b, self.rows)])) * WIDE + NIL


class Rows:
    """a M^j for some rows until little is left, with what every step adds."""

    def __init__(self, mode, rows, W, least=0, size=0.0):
        self.mode, self.W, self.rows, self.error, self.before, self.known = mode, W, [], [], [], {}
        for a, error in rows:
            powers, errors, sums, size = [a], [mode.most * error], [0.0], size or mode.size(a)
            while len(powers) < max(least, 1) + 2 or (mode.size(powers[-1]) > SMALL * size and len(powers) < 3000):
                last = powers[-1]
                powers.append([sum([x * y for x, y in zip(last, c)]) for c in mode.columns])
                errors.append(errors[-1] + mode.most**2 * (mode.n + 2) * EPS * mode.one * mode.size(last) * WIDE)
                sums.append((sums[-1] + W.along(last) + errors[-1] * W.norm) * (1 + EPS))
            self.rows.append(powers)
            self.error.append(errors)
            self.before.append(sums)

    def at(self, r, j, gens):
        """Support of M^j gens in direction r."""
        if (r, j, id(gens)) not in self.known:
            self.known[r, j, id(gens)] = (gens.along(self.rows[r][j]) + self.error[r][j] * gens.norm) * WIDE
        return self.known[r, j, id(gens)]

    def added(self, r, j, first):
        """What j steps add, the first of them ``first``."""
        return (self.at(r, j - 1, first) + self.before[r][j - 1]) * WIDE if j else 0.0

    def ever(self, r, entry, firsts, since):
        """Over all steps from ``since`` on."""
        end, mode = len(self.rows[r]) - 1, self.mode
        left = (mode.size(self.rows[r][end - 1]) + self.error[r][end - 1]) * WIDE * mode.most
        out = (left * (entry.norm + max([f.norm for f in firsts]) + mode.all * self.W.norm)
               + self.before[r][end - 1]) * WIDE
        for j in range(since, end):
            out = max(out, (self.at(r, j, entry) + max([self.added(r, j, f) for f in firsts])) * WIDE)
        return out


class Table:
    """One part of a table: its stages, from one kind of start."""

    def __init__(self, e, h, part, start):
        self.e, self.h, self.part, self.dwell = e, h, part, e.t["shape"]["dwell"]
        self.Q, self.s = len(e.modes), [F(2) * b for b in e.box]
        self.modes = [Mode(M, self.s) for M in e.M]
        origins = range(self.Q + 1)
        made = [[self.gens_of(e, q, o, self.s) for q in range(self.Q)] for o in range(len(e.gains))]
        self.W = [made[min(i, len(made) - 1)] for i in origins]
        self.start = Gens([], start, self.s)
        T = [exact(x) for x in part["coordinates"]]
        self.entries = [[self.start] * self.Q] + [
            [Gens([[x * b for x in c] for c, b in zip(zip(*T[q]), exact(stage[q]))], [F(0)] * e.n, self.s)
             for q in range(self.Q)] for stage in part["boxes"][1:]]
        self.back = [inverse(x) for x in T]
        self.lookback = {}

    @staticmethod
    def gens_of(e, q, o, s):
        """What a step adds."""
        return Gens([list(c) for c in zip(*e.step(q, o, True))], e.rest(q, True), s)

    def firsts(self, stage, q):
        """What the first step may add."""
        return [self.W[i][q] for i in range(self.Q) if i != q] if stage else [self.W[self.Q][q]]

    def rounded(self, q, rows):
        """Exact rows as floats, each with its error."""
        return [([float(x) for x in r], 2 * EPS * self.modes[q].size([float(x) for x in r])) for r in rows]

    def prove(self):
        """All boxes and thresholds."""
        last = len(self.h) - 1
        demand(len(self.entries) == len(self.h) and (last or self.Q == 1), "stages")
        before = [[]] + [[s - 1, s] if s == last else [s - 1] for s in range(1, last + 1)]
        leave = [Rows(self.modes[i], self.rounded(i, [r for T in self.back for r in T]), self.W[i][i])
                 for i in range(self.Q)] if last else []
        for stage in range(1, last + 1):
            for i, q in ((i, q) for i in range(self.Q) for q in range(self.Q) if i != q):
                for p in before[stage]:
                    for k in range(self.e.n):
                        most = leave[i].ever(q * self.e.n + k, self.entries[p][i], self.firsts(p, i), self.dwell)
                        demand(most <= self.part["boxes"][stage][q][k], f"box of stage {stage}, mode {q}")
        for q in range(self.Q):
            self.thresholds(q, before)

    def thresholds(self, q, before):
        """All rows of one mode."""
        e, z = self.e, self.e.t["shape"]
        unit = [[F(i == j) for j in range(e.n)] for i in range(e.n)]
        D = exact(z["directions"])
        there = Rows(self.modes[q], self.rounded(q, mul(D, e.C[q]) + unit), self.W[q][q], len(self.h[0][0]) + 1)
        noise = [self.noise_of(e, q, min(i, len(e.gains) - 1), D) for i in range(self.Q + 1)]
        for stage, rows in enumerate(self.h):
            entry, last = self.entries[stage][q], len(rows[q]) - 1
            for r in range(len(D) + e.n):
                stop = max(last + 1, min(len(there.rows[r]) - 1, self.part["back"]))
                for i in (i for i in range(self.Q) if i != q) if stage else [self.Q]:
                    for j in range(stop):
                        more = there.added(r, j, self.W[i][q]) + noise[q if j else i][r]
                        given = rows[q][min(j, last)][r]
                        if (there.at(r, j, entry) + more) * WIDE > given and stage:
                            begin = max(self.entered(i, q, r, j, there, p) for p in before[stage])
                            demand((begin + more) * WIDE <= given, f"threshold {stage}, {q}, {j}, {r}")
                        else:
                            demand((there.at(r, j, entry) + more) * WIDE <= given, f"threshold {stage}, {q}, {j}, {r}")
                tail = there.ever(r, entry, self.firsts(stage, q), stop) + noise[q][r]
                demand(tail * WIDE <= rows[q][last][r], f"last threshold {stage}, {q}, {r}")

    def entered(self, i, q, r, j, there, p):
        """Support j samples after mode i, in stage p, was left for mode q."""
        if (i, q, r, j) not in self.lookback:
            whole, start = self.modes[i].size(there.rows[r][0]), (there.rows[r][j], there.error[r][j])
            self.lookback[i, q, r, j] = Rows(self.modes[i], [start], self.W[i][i], size=whole), {}
        rows, known = self.lookback[i, q, r, j]
        if p not in known:
            known[p] = rows.ever(0, self.entries[p][i], self.firsts(p, i), self.dwell)
        return known[p]

    @staticmethod
    def noise_of(e, q, o, D):
        """What the noise of the sample itself and rounding add, by direction and state."""
        half = e.v[q][1]
        seen = mul(D, e.direct(q, o))
        rest = times(magnitudes(D), e.residual_rest(q))
        held = times(magnitudes(mul(e.gains[o], e.modes[q]["Dv"])), half)
        return [up(sum(map(abs, a)) + b) for a, b in zip(seen, rest)] + [up(h) for h in held]


def inverse(A):
    """Exact inverse."""
    n = len(A)
    rows = [list(r) + [F(i == j) for j in range(n)] for i, r in enumerate(A)]
    for k in range(n):
        at = next((i for i in range(k, n) if rows[i][k]), None)
        demand(at is not None, "coordinates without inverse")
        rows[k], rows[at] = rows[at], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        rows = [r if i == k else [x - r[k] * y for x, y in zip(r, rows[k])] for i, r in enumerate(rows)]
    return [r[n:] for r in rows]


def room(e, h, hx):
    """What entries leave to the set: less the firmware's rounding of d' r, and of x_hat plus and minus a width."""
    (u, tiny), m = UNIT[e.real], e.m
    h = [F(x) for x in h]
    slip = [m * u * F(17, 16) * sum((abs(a) * b for a, b in zip(d, h)), F(0)) + 2 * m * tiny
            if sum(x != 0 for x in d) > 1 else F(0) for d in exact(e.t["shape"]["directions"])]
    x = [F(x) - u * F(17, 16) * (b + F(x)) - 2 * tiny for x, b in zip(hx, e.box)]
    return [float(a - b) * (1 - 4 * EPS) for a, b in zip(h, slip)] + [float(a) * (1 - 4 * EPS) for a in x]


def starts(e, ranges, box0):
    """Half widths of the first errors: of the initial box, and of all that are possible; checks the boxes too."""
    t, m, kind = e.t, e.m, "f" if e.real == "float32" else "d"
    demand(exact(t["shape"]["directions"])[:m] == [[F(i == j) for j in range(m)] for i in range(m)],
           "the first directions are the residuals")
    for name, given in (("x", ranges), ("x0", box0)):
        for lo, hi, (a, b), box in zip(t[name + "_lo"], t[name + "_hi"], given, e.box):
            demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)), f"box {name} too small")
            demand(max(abs(F(lo)), abs(F(hi))) <= box and abs(F(lo) + F(hi)) / 2 < box, "box of the estimate too small")
    middle = [F(struct.unpack(kind, struct.pack(kind, lo / 2 + hi / 2))[0]) for lo, hi in zip(t["x0_lo"], t["x0_hi"])]
    first = [max(F(hi) - c, c - F(lo)) for c, lo, hi in zip(middle, t["x0_lo"], t["x0_hi"])]
    return first, [max(abs(F(lo)), abs(F(hi))) + b for lo, hi, b in zip(t["x_lo"], t["x_hi"], e.box)]


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z = e.t["shape"]
    first, anywhere = starts(e, ranges, box0)
    rows = [[[room(e, *pair) for pair in zip(*q)] for q in zip(*s)] for s in zip(z["h"], z["hx"])]
    Table(e, rows[:z["anew"]], cert["first"], first).prove()
    Table(e, rows[z["anew"]:], cert["main"], anywhere).prove()
    for i, w in enumerate(cert["steady_box"]["width"]):
        last = [F(row[i]) for s in (z["anew"] - 1, -1) for q in z["hx"][s] for row in q]
        demand(F(w) >= 2 * max(last), f"ultimate width of state {i}")
    return "residuals and errors stay within the thresholds with rounding, boundedness"
