"""A period of a plant whose mode may change in it, enclosed: what ``independent_births.py`` rests on.

Standard library only, nothing of residua imported; exact fractions. Exponentials are Taylor sums on a grid of 2^-256.
T f(t) = T S e^(A_j (T - t)) (D e^(W t)) V, D what modes i and j differ in, is taken at the middles of PIECES parts of
the period and bounded between them by its first two derivatives.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, mul, sub  # noqa: E402 - stands beside this file
from independent_sets import add, magnitudes, times  # noqa: E402
from independent_table import inverse  # noqa: E402

PIECES, GRID, LOSS = 24, 2**256, F(1, 2**150)  # LOSS: more than the grid can make of any product here


def cut(A):
    """Entries on the grid."""
    return [[F(round(x * GRID), GRID) for x in row] for row in A]


def grown(A, factor):
    """A matrix times a number."""
    return [[a * factor for a in row] for row in A]


def exponential(A, t):
    """e^(A t) by its Taylor sum, to within 2^-240."""
    n, step = len(A), cut(grown(A, t))
    total = term = [[F(i == j) for j in range(n)] for i in range(n)]
    norm = max(sum(map(abs, row)) for row in step)
    demand(norm < 8, "a period that is long for these modes")
    for k in range(1, 400):
        term = cut(grown(mul(term, step), F(1, k)))
        total = add(total, term)
        if k > 16 and not any(map(any, term)):
            return total
    return demand(False, "an exponential that does not end")


def pattern(A):
    """Where a matrix can be other than zero."""
    return [[F(x != 0) for x in row] for row in A]


def ever(A):
    """Where an exponential of the matrix can be other than zero."""
    out = pattern([[x + (i == j) for j, x in enumerate(row)] for i, row in enumerate(magnitudes(A))])
    for _ in A:
        out = pattern(mul(out, out))
    return out


class Plant:
    """Modes with exponentials at the middles of the parts of a period; W = [A B mean; 0] is the whole of a mode."""

    def __init__(self, modes, S, T):
        self.modes, self.T, self.S, self.back = modes, T, S, inverse(S)
        n, self.h, scale = len(S), T / PIECES, F(len(S) + 4)
        self.x, self.W, self.half = [], [], []  # of every mode: e^(A t), e^(W t); bounds of w~
        for p in modes:
            mean = times(p["Bw"], [(a + b) / 2 for a, b in p["w"]])
            W = [a + b + [m] for a, b, m in zip(p["A"], p["B"], mean)]
            wide = len(W[0])
            W += [[F(0)] * wide for _ in range(wide - n)]
            self.W.append((W, self.middles(W), exponential(magnitudes(W), self.h / 2), exponential(W, T)))
            self.x.append((self.middles(p["A"]), exponential(magnitudes(p["A"]), self.h / 2)))
            self.half.append(times(magnitudes(p["Bw"]), [(b - a) / 2 for a, b in p["w"]]))
            scale = max([scale, *(sum(map(abs, row)) + 1 for M in (W, S, self.back, self.W[-1][3]) for row in M)])
        self.known = {}
        demand(scale**6 * 2**10 * PIECES < GRID * LOSS, "numbers too large for the grid")
        whole = [[F(i == j) for j in range(wide)] for i in range(wide)]
        self.V = [self.back[i] + whole[i][n:] if i < n else whole[i] for i in range(wide)]

    def middles(self, A):
        """Exponentials at the middles of the parts."""
        out, step = [exponential(A, self.h / 2)], exponential(A, self.h)
        while len(out) < PIECES:
            out.append(cut(mul(out[-1], step)))
        return out

    def reached(self, q, half, S):
        """Bounds of int |S e^(A t)| half dt over the period."""
        powers, near = self.x[q]
        total = [F(0)] * len(S)
        for power in powers:
            total = [a + b for a, b in zip(total, times(magnitudes(mul(S, power)), times(near, half)))]
        return [a * self.h + LOSS * (1 + self.T * sum(half)) for a in total]

    def largest(self, i, j):
        """Bounds of w~ while mode i or j is active."""
        return [max(a, b) for a, b in zip(self.half[i], self.half[j])]

    def jumps(self, i, j):
        """Ends of T f(t) over the period as a map of [xi; u; 1], and what disturbances before t add."""
        if (i, j) not in self.known:
            self.known[i, j] = self.jump(i, j)
        return self.known[i, j]

    def jump(self, i, j):
        """The same, calculated."""
        n, (W, there, near_i, _), (rest, near_j) = len(self.S), self.W[i], self.x[j]
        A, T, h = self.modes[j]["A"], self.T, self.h
        change = sub(W, self.W[j][0])[:n]
        slope = sub(mul(change, W), mul(A, change))
        second = magnitudes(sub(mul(slope, W), mul(A, slope)))
        before = self.reached(i, self.half[i], [[F(a == b) for b in range(n)] for a in range(n)])
        least, most, later = None, None, [F(0)] * n
        where = mul(mul(mul(mul(pattern(self.S), ever(A)), pattern(change)), ever(W)), pattern(self.V))
        grid = [[LOSS * (x > 0) for x in row] for row in where]
        for k in range(PIECES):
            left, right = cut(mul(self.S, rest[PIECES - 1 - k])), cut(mul(there[k], self.V))
            wide = mul(magnitudes(left), near_j)
            value, first = (mul(mul(left, M), right) for M in (change, slope))
            room = mul(wide, mul(second, mul(near_i, magnitudes(right))))
            room = [[T * (abs(a) * h / 2 + b * h * h / 8) + c for a, b, c in zip(*rows)]
                    for rows in zip(first, room, grid)]
            ends = [add(grown(value, T), room, sign) for sign in (-1, 1)]
            least = ends[0] if least is None else [[min(e) for e in zip(*rows)] for rows in zip(least, ends[0])]
            most = ends[1] if most is None else [[max(e) for e in zip(*rows)] for rows in zip(most, ends[1])]
            moved = times(wide, times(magnitudes([row[:n] for row in change]), before))
            later = [max(a, T * b + max(c)) for a, b, c in zip(later, moved, grid)]
        return least, most, later


class Steps:
    """The same of a discrete plant: a step belongs to one mode, and a switch adds nothing."""

    def __init__(self, modes, S):
        self.modes, self.S, n = modes, S, len(S)
        self.W, self.half = [], []
        for p in modes:
            mean = times(p["Bw"], [(a + b) / 2 for a, b in p["w"]])
            self.W.append((None, None, None, [a + b + [m] for a, b, m in zip(p["A"], p["B"], mean)]))
            self.half.append(times(magnitudes(p["Bw"]), [(b - a) / 2 for a, b in p["w"]]))
        wide, back = len(self.W[0][3][0]), inverse(S)
        self.V = [[F(i == j) if max(i, j) >= n else back[i][j] for j in range(wide)] for i in range(wide)]

    def reached(self, q, half, S):
        """Bounds of |S w~| of one step."""
        return times(magnitudes(S), half)

    def largest(self, i, j):
        """Bounds of w~ in the step of the new mode."""
        return self.half[j]

    def jumps(self, i, j):
        """Nothing is added."""
        n, wide = len(self.S), len(self.V)
        return [[F(0)] * wide] * n, [[F(0)] * wide] * n, [F(0)] * n
