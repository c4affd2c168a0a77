"""A zonotope boxed in other coordinates, and boxes that it keeps under a dwell time; see ``independent_zonotope.py``.

Before a step of mode p the columns beyond the kept ones, R, become a box b >= |B_p R| 1 + |B_p| e in coordinates B_p x.
The step takes it back by S_p, and what S_p B_p lacks of M_p is left for ``e``. Row sums c of |B_p H| obey, whichever
columns are kept (the key does not matter), with q the mode of the next step,

    c+ <= |B_q S_p| (c + inside + rounding) + |B_q| (|F| 1 + what the step leaves out).

A box per mode and samples that it has lasted (0 to the dwell time) is entered and kept where this maps each into those
that may follow. Without other coordinates B = I, S = M, inside = e.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul, sub  # noqa: E402 - stands beside this file
from independent_box import inverse  # noqa: E402
from independent_sets import magnitudes, times  # noqa: E402


class Turn:
    """Reduction in the coordinates of each mode: ``rows`` bounds the row sums of |H|, ``own`` is e."""

    def __init__(self, e, z, rows, own, columns):
        n, count, self.e, self.rows, self.own = e.n, len(e.modes), e, rows, own
        self.oblique = bool(z["B"])
        unit = [[F(i == j) for j in range(n)] for i in range(n)]
        self.B, self.S, self.Sb, self.inside = [unit] * count, e.M, e.A, [own] * count
        if self.oblique:
            self.B, self.S, self.Sb, self.inside = (exact(z[k]) for k in ("B", "S", "Sb", "inside"))
        square = all(len(X) == n and all(len(r) == n for r in X) for X in [*self.B, *self.S, *self.Sb])
        each = all(len(k) == count for k in (self.B, self.S, self.Sb, self.inside))
        demand(square and each and all(len(x) == n for x in self.inside),
               "coordinates of boxes are not given for every mode")
        self.slip, self.most = [], []
        for q, (B, inside) in enumerate(zip(self.B, self.inside)):
            size, held = (times(magnitudes(B), x) for x in (rows, own))
            turned = [(((1 + e.u) ** n - 1) * s + 2 * n * columns * e.tiny) * self.oblique for s in size]
            grow, flush = (1 + e.u) ** (columns + 2) - 1, (columns + 2) * 2 * e.tiny
            slip = [c + grow * (s + c + i) + flush for s, c, i in zip(size, turned, inside)]
            for i, need in enumerate(a + b for a, b in zip(held, slip)):
                demand(not self.oblique or inside[i] >= need,
                       f"inside[{q}][{i}] lacks {float(need - inside[i]):.3g}")
            self.slip.append(slip)
            self.most.append([s + i + c for s, i, c in zip(size, inside, slip)])

    def lack(self, q, measured):
        """What a step leaves out: M - S B of the columns and of e, and the rounding of S times the box."""
        if not self.oblique:
            return [F(0)] * self.e.n
        M, S = (self.e.M, self.S) if measured else (self.e.A, self.Sb)
        left = times(magnitudes(sub(M[q], mul(S[q], self.B[q]))), [a + b for a, b in zip(self.rows, self.own)])
        return [a + self.e.u * b + self.e.n * self.e.tiny
                for a, b in zip(left, times(magnitudes(S[q]), self.most[q]))]


def check_kept(turn, boxes, pushed, hull):
    """Boxes per mode and stay are entered and kept, and lie in ``hull``; ``pushed``: what a step adds, by mode."""
    dwell, half, modes = boxes["dwell"], exact(boxes["half"]), range(len(turn.B))
    demand(isinstance(dwell, int) and dwell >= 1, "dwell time")
    states = [(q, s) for q in modes for s in range(dwell + 1)]
    demand(len(half) == len(states) and all(len(x) == len(hull) for x in half), "one box per mode and stay")
    half = dict(zip(states, half))
    maps = {(p, q): magnitudes(mul(turn.B[q], turn.S[p])) for p in modes for q in modes}
    added = {}
    for (p, q), K in maps.items():
        box = times(K, [a + b for a, b in zip(turn.inside[p], turn.slip[p])])
        added[p, q] = [a + b for a, b in zip(box, times(magnitudes(turn.B[q]), pushed[p]))]
    for p, s in states:
        after = [(p, min(s + 1, dwell))] + [(q, 0) for q in modes if q != p and s + 1 >= dwell]
        for q, later in after:
            for i, (stay, more, room) in enumerate(zip(times(maps[p, q], half[p, s]), added[p, q], half[q, later])):
                demand(stay < room and stay + more <= room, f"box of mode {q} after {later} samples, coordinate {i}")
    for q in modes:
        back = magnitudes(inverse(turn.B[q]))
        for s in range(dwell + 1):
            demand(all(a <= b for a, b in zip(times(back, half[q, s]), hull)), f"ultimate box of mode {q}")
    return "for arbitrary switching" if dwell == 1 else f"while every mode lasts at least {dwell} samples"
