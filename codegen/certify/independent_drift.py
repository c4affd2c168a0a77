"""How far a continuous polytopic plant moves between samples, checked again; ``independent_polytopic.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. Over a period E (x(t) - x) is the integral of the
flow f, and S' f = 0 at t as at the sample. With W near the inverse of [E; S' A], for a row a, whatever W is,

    a (x(t) - x) = a W [int f; -S' (A_t - A_0) x - S' (B_t - B_0) u - S' (Bd_t d(t) - Bd_0 d)]
                   + a (I - W [E; S' A_t]) (x(t) - x),

A_t and A_0 by the weights at t and at the sample. The mean of int f is half a period of f at most; f is as large as at
a vertex, and so is f with any multiple of S' f added to a W f. The weights of a sector model are as far apart as their
premises, taken one after the other: each as far as its slopes take the change of x.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import combinations
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import mul, sub  # noqa: E402 - stands beside this file
from independent_filter import up  # noqa: E402
from independent_formula import bounds, unknown  # noqa: E402
from independent_pairs import add, kernel, reach, scaled, solved, transposed, unit  # noqa: E402

TURNS = 30


def above(x):
    """The fraction of a float that is not below."""
    return F(up(x)) if x > 0 else x


def short(A):
    """The nearest floats of a matrix: any would do where it stands."""
    return [[F(float(a)) for a in row] for row in A]


def slopes(premise, box):
    """Of a premise over its width, {variable: largest slope} over a box; a power counts up to its bounds alone."""
    key, lo, hi = premise
    used, found = [k for k, e in enumerate(key) if e], {}
    if len(used) == 1 and key[used[0]] > 1:
        far = F(float(max(abs(lo), abs(hi))) ** (1 / key[used[0]])) * (1 + F(1, 10**14))
        box = [(max(a, -far), min(b, far)) if k == used[0] else (a, b) for k, (a, b) in enumerate(box)]
    for k in used:
        lower = tuple(e - (j == k) for j, e in enumerate(key))
        found[k] = max(map(abs, bounds({lower: F(key[k])}, box))) / abs(hi - lo)
    return found


def turned(count, k):
    """Pairs of vertices: premise k at either bound, the others anywhere."""
    return [(i, i | 1 << k) for i in range(count) if not i >> k & 1]


def reaches(parts):
    """Largest magnitude of every row of a sum of (matrix, box of its signal)."""
    boxes, out = [box for _, box in parts], []
    for rows in zip(*(M for M, _ in parts)):
        pairs = [(a, m, h) for row, box in zip(rows, boxes) for a, (m, h) in zip(row, box)]
        out.append(abs(sum((a * m for a, m, _ in pairs), F(0))) + sum((abs(a) * h for a, _, h in pairs), F(0)))
    return out


def largest(some):
    """Entry by entry."""
    return [max(values) for values in zip(*some)]


class Drift:
    """Bounds of the mean of |a (x(t) - x)| over a period: ``of``; of |x(t) - x|: ``moved``."""

    def __init__(self, plant):
        self.plant, n, h, St = plant, len(plant.E), len(plant.A), transposed(plant.S)
        x, u, d = (plant.box[k] for k in "xud")
        self.SA, SB, SD = ([mul(St, M) for M in some] for some in (plant.A, plant.B, plant.Bd))
        mean = scaled(F(1, h), add(*plant.A))
        tall = plant.E + mul(St, mean)
        self.W = short(solved(mul(transposed(tall), tall), transposed(tall)))
        self.tall = [plant.E + M for M in self.SA]
        # What is algebraic leaves the flow: (A + k S' A) K = 0 with E K = 0, in the mean.
        self.out, K = None, kernel(transposed(plant.E))
        if St and K[0]:
            own = transposed(mul(mul(St, mean), K))
            self.out = short(scaled(-1, transposed(mul(solved(mul(transposed(own), own), transposed(own)),
                                                       transposed(mul(mean, K))))))
        self.moved, self.left = [2 * half for _, half in x], []
        if St:
            unknown(plant.premises is None and h > 1)  # weights of another kind have slopes that are not known here

            def apart(i, k):
                return reaches([(sub(A[i], A[k]), box) for A, box in ((self.SA, x), (SB, u))])

            alike = all(SD[0] == M for M in SD)
            noise = [sum((abs(a) * half for a, (_, half) in zip(row, d)), F(0)) for row in SD[0]] if alike else largest(
                [[reach(row, d) for row in M] for M in SD])
            any_two = largest([apart(i, k) for i, k in combinations(range(h), 2)] or [[F(0)] * len(St)])
            ways = [(slopes(premise, plant.ends), largest([apart(i, k) for i, k in turned(h, bit)]))
                    for bit, premise in enumerate(plant.premises or ())]
        for _ in range(TURNS):
            if St:
                far = [sum((s * self.moved[k] for k, s in some.items() if k < n), F(0)) for some, _ in ways]
                slow = [sum((f * rows[r] for f, (_, rows) in zip(far, ways)), F(0)) for r in range(len(St))]
                self.left = [min(a, b) + 2 * e for a, b, e in zip(any_two, slow, noise)]
            self.moved = [above(min(a, b)) for a, b in zip(self.moved, self.of(unit(n)))]

    def of(self, rows):
        """Bounds for every row."""
        p, n, near = self.plant, len(self.plant.E), mul(rows, self.W)
        flow, rest = [row[:n] for row in near], [row[n:] for row in near]

        def fastest(rows):
            return largest([reaches([(mul(rows, M[i]), p.box[k]) for k, M in (("x", p.A), ("u", p.B), ("d", p.Bd))])
                            for i in range(len(p.A))])

        speed = fastest(flow)
        if self.out is not None:
            freed = add(flow, mul(short(mul(flow, self.out)), transposed(p.S)))
            speed = [min(a, b) for a, b in zip(speed, fastest(freed))]
        lost = largest([[sum((abs(a) * m for a, m in zip(row, self.moved)), F(0))
                         for row in sub(rows, mul(near, tall))] for tall in self.tall])
        known = [sum((abs(a) * m for a, m in zip(row, self.left)), F(0)) for row in rest]
        return [p.T / 2 * a + b + c for a, b, c in zip(speed, known, lost)]
