"""What a wrong hypothesis of a mode estimator must be like to live: inequalities, summed up by given multipliers.

Standard library only, nothing of residua imported; exact fractions. A story is the true course (mode old, from the
period after sample 0 on mode new) and one hypothesis: an established mode, or its child in mode wrong, born in the
period after sample born. At every sample there are numbers xi, u, y (less D u), the box lo, hi of the hypothesis and a
point c that all stories of one run share. They meet, sample by sample and row by row in this order:

1. c begins with y; the rest is the middle of the first box, and then moves as the true mode does (two rows each);
2. S^-1 xi is in the declared range of x; y - xi is noise; the box is cut by y and not empty;
3. first sample: all in one box, or the box holds xi and is of given widths at most. Later: xi moves as the true mode
   does; the box moves as its mode does, rounding included. A switch adds max(0, J .. + radius) at most, which a chord
   bounds.

For any multipliers y >= 0 no solution has a larger cost than y'b + max over the box of (cost - y'A) z.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from math import ceil
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, sub  # noqa: E402 - stands beside this file
from independent_sets import magnitudes, times  # noqa: E402

FINE = 2**100


def up(values):
    """Numbers of moderate length just above."""
    return [F(ceil(x * FINE), FINE) for x in values]


def total(*vectors):
    """Sum of vectors."""
    return [sum(row, F(0)) for row in zip(*vectors)]


def minus(A):
    """Minus a vector or matrix."""
    return [minus(a) if isinstance(a, list) else -a for a in A]


def parts(A):
    """Positive and negative part."""
    return [[max(a, F(0)) for a in row] for row in A], [[max(-a, F(0)) for a in row] for row in A]


def chord(lo, hi):
    """Slope and level of a line above max(0, z) on [lo, hi]."""
    slope = F(lo >= 0) if lo >= 0 or hi <= 0 else F(min(1.0, float(hi) / float(hi - lo)))
    return slope, max(F(0), -slope * lo, (1 - slope) * hi)


class Stories:
    """Rows of stories; ``widths`` bound the box of an established true mode when a story begins."""

    def __init__(self, t, ranges, widths, more=None):
        keys = ("Phi", "Gamma", "shift", "reach", "J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth")
        self.t = {k: exact(t[k]) for k in (*keys, "v_lo", "v_hi", "u_lo", "u_hi", "wide_lo", "wide_hi", "start_lo",
                                           "start_hi", "S_inverse")}
        n, self.known = len(t["S"]), {}
        self.n, self.more = n, more or [F(0)] * len(t["v_lo"])  # what a fault does to y at most
        self.p, self.widths, (unit, _) = len(t["v_lo"]), widths, UNIT[t["real"]]
        self.umax = [max(abs(a), abs(b)) for a, b in zip(self.t["u_lo"], self.t["u_hi"])]
        self.far = [max(abs(a), abs(b)) for a, b in zip(self.t["wide_lo"], self.t["wide_hi"])]
        self.noise = [max(abs(a), abs(b)) for a, b in zip(self.t["v_lo"], self.t["v_hi"])]
        self.share = 2 * (n + len(self.umax) + 8) * unit  # of its terms a sum is off by less
        self.cut = [self.share * (a + 5 * b + c) for a, b, c in zip(self.far, self.noise, self.more)]
        demand(min(map(min, self.t["reach"])) > F(1, 2**80), "a reach in which no underflow fits")
        demand(all(a <= b for a, b in zip(self.cut, self.noise)), "noise in which the rounding of y does not fit")
        demand(all(max(-F(a), F(b)) <= c for a, b, c in zip(t["start_lo"], t["start_hi"], self.far)), "the first box")
        self.one = [[F(i == j) for j in range(n)] for i in range(n)]
        lost = sub(mul(self.t["S_inverse"], exact(t["S"])), self.one)
        x = [(F(float(a)), F(float(b))) for a, b in ranges]
        room = times(magnitudes(lost), [max(abs(a), abs(b)) for a, b in x])
        self.x_hi, self.x_lo = total([b for _, b in x], room), total([a for a, _ in x], minus(room))

    def reach(self, samples):
        """Bounds of both ends of any box over so many samples: before it is born, and at all."""
        if samples not in self.known:
            demand((1 + self.share) ** (samples + 2) < F(1001, 1000), "too many roundings")
            self.known[samples] = [[F(1001, 1000) * x for x in size] for size in self.grown(samples)]
        return self.known[samples]

    def grown(self, samples):
        """The same without what is rounded on the way."""
        t, modes = self.t, range(len(self.t["Phi"]))
        plain = once = total(self.far, self.widths)
        for _ in range(samples + 1):
            found = [plain, once]
            for q in modes:
                A, births = magnitudes(t["Phi"][q]), [max(b[q][r] for b in t["birth"]) for r in range(self.n)]
                given = times(magnitudes(t["Gamma"][q]), self.umax)
                move = total(given, map(abs, t["shift"][q]), births, t["reach"][q])
                stay, jumps = times(A, plain), [self.jump(i, q, plain) for i in modes]
                jump = [max(column) for column in zip(*jumps)]
                born = [max(a, b + c) for a, b, c in zip(times(A, once), stay, jump)]
                found += [total(stay, move), total(born, move)]
            plain = [max(column) for column in zip(found[0], *found[2::2])]
            once = [max(column) for column in zip(plain, found[1], *found[3::2])]
            for size in (plain, once):
                size[:self.p] = [a + 3 * b + c for a, b, c in zip(self.far, self.noise, self.more)]
            plain, once = up(plain), up(once)
        return plain, once

    def jump(self, i, q, size):
        """Magnitude of what a switch from mode i to mode q adds."""
        t = self.t
        own = total(times(magnitudes(t["J"][i][q]), size), times(magnitudes(t["J_u"][i][q]), self.umax))
        return total(own, map(abs, t["J_shift"][i][q]), self.radius(i, q, size))

    def radius(self, i, q, size):
        """What of it is not in J."""
        t = self.t
        return total(times(t["J_radius"][i][q], size), times(t["J_u_radius"][i][q], self.umax), t["J_reach"][i][q])

    def chords(self, i, q, box, size):
        """Lines above what a switch adds upwards and downwards: slopes and right sides."""
        t, radius = self.t, self.radius(i, q, size)
        ends = [*zip(*box), *zip(t["u_lo"], t["u_hi"])]
        out = []
        for sign in (1, -1):
            slopes, right = [], []
            for J, J_u, c, r in zip(t["J"][i][q], t["J_u"][i][q], t["J_shift"][i][q], radius):
                row = [sign * a for a in J + J_u]
                least, most = (sum((pick(a * b for b in e) for a, e in zip(row, ends)), sign * c + r)
                               for pick in (min, max))
                slope, level = chord(least, most)
                slopes.append(slope)
                right.append(slope * (sign * c + r) + level)
            out.append((slopes, right))
        return out

    def program(self, story, first, last):
        """Blocks of rows ([(matrix, first column), ...], right sides), ends of variables, those of the last sample."""
        blocks, lo, hi, now, (plain, most), t = [], [], [], None, self.reach(last - first), self.t
        v_hi, v_lo, none = total(t["v_hi"], self.cut), total(minus(t["v_lo"]), self.cut), [F(0)] * self.n
        one, ones = self.one, [row[:self.p] for row in self.one[:self.p]]
        top, rest = one[:self.p], one[self.p:]
        seen = [[a + sign * (2 * max(sign * b, F(0)) + c) for a, b, c in zip(t[f"wide_{s}"], t[f"v_{s}"], self.more)]
                for s, sign in (("lo", -1), ("hi", 1))]
        twice, half = [2 * a for a in most], [[-a / 2 for a in row] for row in rest]
        for k in range(first, last + 1):
            before, now = now, {}
            for name, a, b in (("xi", t["wide_lo"], t["wide_hi"]), ("u", t["u_lo"], t["u_hi"]), ("y", *seen),
                               ("lo", minus(most), most), ("hi", minus(most), most), ("c", minus(twice), twice)):
                now[name] = len(lo)
                lo, hi = lo + a, hi + b
            xi, y, c, a, b = (now[name] for name in ("xi", "y", "c", "lo", "hi"))
            q = story[0] if k <= 0 else story[1]
            moved = ([(rest, c), (half, a), (half, b)], none[self.p:]) if before is None else (
                [(rest, c), (minus(t["Phi"][q][self.p:]), before["c"]), (minus(t["Gamma"][q][self.p:]), before["u"])],
                t["shift"][q][self.p:])
            for terms, right in (([(top, c), (minus(ones), y)], none[:self.p]), moved):
                blocks += [(terms, right), ([(minus(M), at) for M, at in terms], minus(right))]
            blocks += [([(t["S_inverse"], xi)], self.x_hi), ([(minus(t["S_inverse"]), xi)], minus(self.x_lo)),
                       *self.measured(k, now, lo, hi), ([(ones, y), (minus(top), a)], v_hi),
                       ([(minus(ones), y), (top, b)], v_lo), ([(one, a), (minus(one), b)], none)]
            if before is not None:
                blocks += [*self.truth(story, k - 1, before, now), *self.hypothesis(story, k - 1, before, now, plain)]
            elif story[5] == "settled":
                blocks += [([(one, a), (minus(one), xi)], none), ([(one, xi), (minus(one), b)], none),
                           ([(one, b), (minus(one), a)], self.widths)]
            else:
                for at in (a, b, xi):
                    blocks += [([(one, at)], t[f"{story[5]}_hi"]), ([(minus(one), at)], minus(t[f"{story[5]}_lo"]))]
        return blocks, lo, hi, now

    def measured(self, k, now, lo, hi):
        """Rows of y less the truth; lo and hi take variables of their own."""
        ones, top = [row[:self.p] for row in self.one[:self.p]], self.one[:self.p]
        return [([(ones, now["y"]), (minus(top), now["xi"])], self.t["v_hi"]),
                ([(minus(ones), now["y"]), (top, now["xi"])], minus(self.t["v_lo"]))]

    def truth(self, story, k, a, b):
        """Rows of the true state over the period after sample k."""
        t, (old, new) = self.t, story[:2]
        q = old if k < 0 else new
        A, B, c, switch = t["Phi"][q], t["Gamma"][q], t["shift"][q], k == 0 and old != new
        reach = t["birth"][old][q] if switch else t["reach"][q]
        rows = [([(self.one, b["xi"]), (minus(A), a["xi"]), (minus(B), a["u"])], total(c, reach)),
                ([(minus(self.one), b["xi"]), (A, a["xi"]), (B, a["u"])], total(minus(c), reach))]
        if not switch:
            return rows
        lines = self.chords(old, q, (t["wide_lo"], t["wide_hi"]), self.far)
        return [(terms + [(scaled(s, t["J"][old][q], -sign), a["xi"]), (scaled(s, t["J_u"][old][q], -sign), a["u"])],
                 total(right, more)) for (terms, right), (s, more), sign in zip(rows, lines, (1, -1))]

    def hypothesis(self, story, k, a, b, most):
        """Rows of the box over that period."""
        t, (old, _, wrong, born, parent, _) = self.t, story
        source, birth = old if parent is None else parent, born is not None and k == born
        q = wrong if born is not None and k >= born else source
        (P, N), B, c = parts(t["Phi"][q]), t["Gamma"][q], t["shift"][q]
        reach = t["birth"][source][q] if birth else t["reach"][q]
        terms = total(times(magnitudes(t["Phi"][q]), most), times(magnitudes(B), self.umax), map(abs, c), reach)
        terms = total(terms, self.jump(source, q, most)) if birth else terms
        reach = [x + self.share * y for x, y in zip(reach, terms)]
        lower = [(minus(self.one), b["lo"]), (P, a["lo"]), (minus(N), a["hi"]), (B, a["u"])], total(minus(c), reach)
        upper = [(self.one, b["hi"]), (minus(P), a["hi"]), (N, a["lo"]), (minus(B), a["u"])], total(c, reach)
        if not birth:
            return [lower, upper]
        (P, N), J_u = parts(t["J"][source][q]), t["J_u"][source][q]
        (s, more), (r, less) = self.chords(source, q, (minus(most), most), most)
        return [(upper[0] + [(scaled(s, P, -1), a["hi"]), (scaled(s, N), a["lo"]), (scaled(s, J_u, -1), a["u"])],
                 total(upper[1], more)),
                (lower[0] + [(scaled(r, P), a["lo"]), (scaled(r, N, -1), a["hi"]), (scaled(r, J_u), a["u"])],
                 total(lower[1], less))]

    def bound(self, program, y, cost=None):
        """Return y'b + max over the box of (cost - y'A) z, for multipliers (row, value) in ascending order."""
        (blocks, lo, hi, _), left, right, begin, at = program, dict(cost or {}), F(0), 0, iter(y)
        row, value = next(at, (None, F(0)))
        for terms, rights in blocks:
            while row is not None and row < begin + len(rights):
                demand(value >= 0, "a negative multiplier")
                right += value * rights[row - begin]
                for M, first in terms:
                    for j, x in enumerate(M[row - begin]):
                        if x:
                            left[first + j] = left.get(first + j, F(0)) - value * x
                row, value = next(at, (None, F(0)))
            begin += len(rights)
        demand(row is None, "a multiplier of no row")
        return right + sum((x * (hi[i] if x > 0 else lo[i]) for i, x in left.items()), F(0))


def scaled(slopes, A, sign=1):
    """Rows times slopes."""
    return [[sign * s * a for a in row] for s, row in zip(slopes, A)]
