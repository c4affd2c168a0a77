"""Tables of blocks, checked again; see ``independent_sets.py``.

j samples of mode b make A^j e + G_j z of the error e at a block's start: G_j holds the columns and the rest of every
sample. With H of row sums of at most ``most``, row D of residual or state and power P_j as rounded,

    |D A^j H|_1 + |D G_j|_1 <= |D_j H|_1 + |D A^j - D_j| most + |D G_j|_1,   and ``scalars`` must hold what is added,
    A^j H + G_j z  in  P_j H + pushed z + box(|A^j - P_j| most + what the columns pushed lack),   ``e`` must hold it,

each with the rounding of the firmware's sums. Which columns a reduction keeps is of no account: boxes hold the others.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul, sub  # noqa: E402 - stands beside this file
from independent_sets import magnitudes, times  # noqa: E402
from independent_table import starts  # noqa: E402


def sums(A):
    """Sums of the rows' magnitudes."""
    return [sum(map(abs, row), F(0)) for row in A]


def largest(vectors):
    """Entry by entry."""
    return [max(x) for x in zip(*vectors)]


def sizes(value):
    """Lengths of nested lists of equal parts."""
    if not isinstance(value, list):
        return ()
    parts = {sizes(v) for v in value}
    demand(len(parts) == 1, "sizes of the tables of blocks")
    return (len(value), *parts.pop())


def lacking(columns, stored):
    """Half widths of a box that columns stored need beside them to hold others.

    A column with one entry is a side of a box; any other stands for the nearest one of the columns, if it is near.
    """
    left, box = [list(c) for c in zip(*columns)], [F(0)] * len(stored)
    for column in zip(*stored):
        if sum(x != 0 for x in column) == 1:
            box = [b - abs(x) for b, x in zip(box, column)]
        elif any(column):
            apart = [sum(abs(a - b) for a, b in zip(c, column)) for c in left]
            best = min(range(len(left)), key=apart.__getitem__, default=None)
            if best is not None and apart[best] < sum(map(abs, left[best])):
                box = [b + abs(x - y) for b, x, y in zip(box, left.pop(best), column)]
    return [max(b + sum(abs(c[i]) for c in left), F(0)) for i, b in enumerate(box)]


class Blocks:
    """The tables in fractions, with the rounding of the sums of the firmware."""

    def __init__(self, e):
        z, self.e, self.u, self.tiny = e.t["shape"], e, e.u, e.tiny
        self.order, self.N, self.O = z["order"], len(e.modes), len(e.gains)
        self.D, self.rows, self.scalars, self.noise, self.powers, self.pushed, self.box, self.wide = (
            exact(z[k]) for k in ("directions", "rows", "scalars", "noise", "powers", "pushed", "e", "wide"))
        self.J, self.d, self.added = len(self.powers[0]), len(self.D) + e.n, sizes(self.pushed)[-1]
        N, O, J, d, n = self.N, self.O, self.J, self.d, e.n
        wanted = {"D": (d - n, e.m), "rows": (N, J + 1, d, n), "scalars": (O, N, J + 1, d), "noise": (O, N, d),
                  "powers": (N, J, n, n), "pushed": (O, N, J, n, self.added), "box": (n,), "wide": (n,)}
        demand(all(sizes(getattr(self, k)) == s for k, s in wanted.items()) and self.order > n and J >= 1,
               "sizes of the tables of blocks")
        demand(all(e.C[0] == C for C in e.C), "C differs between modes")
        # A row's computed sum is at most its limit, hence the exact one at most:
        self.most = [(F(x) + self.order * self.tiny) / (1 - self.u) ** self.order for x in z["most"]]
        self.T = mul(self.D, e.C[0]) + [[F(i == j) for j in range(n)] for i in range(n)]

    def grow(self, terms):
        """Largest relative rounding of that many operations after each other."""
        return (1 + self.u) ** terms - 1

    def carry(self, A):
        """Rounding of A H, summed over the columns of H."""
        n = self.e.n
        return [self.grow(n) * a + 2 * n * self.order * self.tiny for a in times(magnitudes(A), self.most)]

    def check(self):
        """Noise, scalars and the box beside the set."""
        every = largest(row for o in self.noise for row in o)
        for o in range(self.O):
            for q in range(self.N):
                for i, need in enumerate(self.own(q, o)):
                    demand(self.noise[o][q][i] >= need, f"noise[{o}][{q}][{i}] lacks "
                           f"{float(need - self.noise[o][q][i]):.3g}")
                power, G = [[F(i == j) for j in range(self.e.n)] for i in range(self.e.n)], None
                for j in range(self.J + 1):
                    if j:  # of the first sample the estimate holds the noise of what came before, then its own
                        new = self.pushes(q, o if j == 1 else min(q, self.O - 1))
                        G = new if G is None else [a + b for a, b in zip(mul(self.e.M[q], G), new)]
                        power = mul(self.e.M[q], power)
                        self.ends(o, q, j - 1, power, G)
                    self.within(o, q, j, power, G, every)

    def pushes(self, q, o):
        """Columns that a sample adds, the rest as a box among them."""
        rest = self.e.rest(q, True)
        return [row + [r * (i == k) for k in range(self.e.n)]
                for i, (row, r) in enumerate(zip(self.e.step(q, o, True), rest))]

    def own(self, q, o):
        """Least noise: of the sample itself, and half of the rounding of x_hat plus and minus a half width."""
        e = self.e
        seen = sums(mul(self.D, e.direct(q, o)))
        rest = times(magnitudes(self.D), e.residual_rest(q))
        held = times(magnitudes(mul(e.gains[o], e.modes[q]["Dv"])), e.v[q][1])
        return [a + b for a, b in zip(seen, rest)] + [h + self.u * b + self.tiny for h, b in zip(held, e.box)]

    def within(self, o, q, j, power, G, noise):
        """Scalars after j samples of mode q."""
        rows, given, m = self.rows[q][j], self.scalars[o][q][j], self.e.m
        exactly = mul(self.T, power)
        off = times(magnitudes(sub(exactly, rows)), self.most)
        more = sums(mul(self.T, G)) if G else [F(0)] * self.d
        reach, carry = times(magnitudes(rows), self.most), self.carry(rows)
        size = [a + b + c + s for a, b, c, s in zip(reach, carry, noise, given)]
        adds = self.order + 1
        slip = [self.grow(adds) * s + adds * self.tiny for s in size]
        bounds = [s + x for s, x in zip(size, slip)][:m]
        for i in range(self.d):
            need = off[i] + more[i] + carry[i] + slip[i]
            if i >= len(self.D):
                need += self.u * self.wide[i - len(self.D)] + self.tiny
            elif sum(x != 0 for x in self.D[i]) > 1:  # a sum of residuals, each within its bound
                need += self.grow(m) * sum(abs(a) * b for a, b in zip(self.D[i], bounds)) + 2 * m * self.tiny
            demand(given[i] >= need, f"scalars[{o}][{q}][{j}][{i}] lacks {float(need - given[i]):.3g}")

    def ends(self, o, q, j, power, G):
        """The box of the rounding where a block ends after j + 1 samples."""
        P, pushed, count = self.powers[q][j], self.pushed[o][q][j], self.order + self.added
        off, lack, carry = times(magnitudes(sub(power, P)), self.most), lacking(G, pushed), self.carry(P)
        reach = times(magnitudes(P), self.most)
        for i, b in enumerate(self.box):
            size = reach[i] + carry[i] + sum(map(abs, pushed[i])) + b
            need = off[i] + lack[i] + carry[i] + self.grow(count) * size + count * self.tiny
            demand(b >= need, f"e[{i}] lacks {float(need - b):.3g} after {j + 1} samples of mode {q}")

    def after(self, half):
        """Per end of a block: |P_j| half widths, and all that the new row sums may be."""
        count = self.order + self.added
        for q in range(self.N):
            for j, P in enumerate(self.powers[q]):
                stay, push = times(magnitudes(P), half), largest(sums(o[q][j]) for o in self.pushed)
                total = [sum(x) for x in zip(stay, push, self.box, self.carry(P))]
                yield stay, [(1 + self.grow(count)) * x + count * self.tiny for x in total]

    def reaches(self, half, samples):
        """Largest half widths of the bounds of x, of sets with these row sums."""
        noise, m = largest(row for o in self.noise for row in o), len(self.D)
        found = []
        for q in range(self.N):
            for j in samples:
                along, most = times(magnitudes(self.rows[q][j]), half), largest(o[q][j] for o in self.scalars)
                found.append([a + b + c for a, b, c in zip(along, most, noise)][m:])
        count = self.order + self.e.n + 2
        return [(1 + self.grow(count)) * x + 2 * count * self.order * self.tiny for x in largest(found)]


def check_first(blocks, ranges, box0):
    """The sets that init and reset start from; what they reach is within the limits."""
    z = blocks.e.t["shape"]
    for name, given in zip(("start", "anywhere"), starts(blocks.e, ranges, box0)):
        for i, (h, x, most) in enumerate(zip(given, exact(z[name]), exact(z["most"]))):
            demand(h <= x <= most, f"{name}[{i}] does not hold the first errors, or is beyond the limit")
    for i, (r, w) in enumerate(zip(blocks.reaches(blocks.most, range(blocks.J + 1)), blocks.wide)):
        demand(r <= w, f"wide[{i}] below the bounds of a set within its limit")


def check_steady(blocks, cert):
    """Row sums enter and keep the certificate's, from those of any error, below the limit all the way."""
    z, half = blocks.e.t["shape"], exact(cert["half"])
    for stay, new in blocks.after(half):
        for i, h in enumerate(half):
            demand(stay[i] < h and new[i] <= h, f"ultimate box, state {i}")
    most = [F(x) * (1 - blocks.u) ** blocks.order - blocks.order * blocks.tiny for x in z["most"]]  # summed up, passes
    room, now = min(a / b for a, b in zip(most, half)), largest([exact(z["start"]), exact(z["anywhere"])])
    for _ in range(100):  # from below a multiple of half widths that is below the limit it stays below
        if all(x <= room * h for x, h in zip(now, half)):
            break
        now = largest(new for _, new in blocks.after(now))
        now = [F(-(-x * 2**80 // 1), 2**80) for x in now]
        demand(all(a <= b for a, b in zip(now, most)), "a set that starts anew grows beyond its limit")
    demand(room >= 1 and all(x <= room * h for x, h in zip(now, half)), "a set that starts anew does not shrink")
    for i, (r, w) in enumerate(zip(blocks.reaches(half, range(1, blocks.J + 1)), cert["width"], strict=True)):
        demand(F(w) >= 2 * r, f"ultimate width of state {i}")


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    blocks = Blocks(e)
    check_first(blocks, ranges, box0)
    blocks.check()
    if cert.get("steady_box"):
        check_steady(blocks, cert["steady_box"])
    return "residuals and errors stay in the sets carried in blocks with rounding, boundedness"
