"""Thresholds along a known schedule, checked again; see ``independent_sets.py`` and ``independent_table.py``.

From the initial box at phase 0, and from any error at any phase, the modes are those of the cycle; any other mode
starts anew. So the support in direction a at phase p, k samples after a start, is |a_k H0| + |a_(k-1) W_first| + the
sum of |a_i W| over i < k - 1, with a_i the row a taken back through i steps of the cycle: the same rows for all starts.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul  # noqa: E402 - stands beside this file
from independent_table import EPS, SMALL, WIDE, Gens, Mode, Table, room, starts, up  # noqa: E402


class Cycle:
    """Norms of what a cycle of modes makes of a row, in units of s."""

    def __init__(self, M, cycle, s):
        self.P, self.cycle, unit = len(cycle), cycle, [[F(i == j) for j in range(len(s))] for i in range(len(s))]
        self.windows, laps = [], []
        for phase in range(self.P):  # M of the step into this phase, then of those before it
            power, norms = unit, []
            for i in range(self.P):
                norms.append(max(sum(abs(x) * b for x, b in zip(r, s)) / a for r, a in zip(power, s)))
                power = mul(power, M[cycle[(phase - 1 - i) % self.P]])
                power = [[F(round(x * 2**400), 2**400) for x in r] for r in power]
            self.windows.append(norms)
            laps.append(Mode(power, s))
        self.most = up(max(max(w) for w in self.windows)) * max(lap.most for lap in laps) * WIDE
        self.all = up(max(sum(w) for w in self.windows)) * max(lap.all for lap in laps) * WIDE
        self.steps = [Mode.__new__(Mode) for _ in M]
        for mode, A in zip(self.steps, M):
            mode.n, mode.s, mode.columns = len(s), [up(x) for x in s], [[float(x) for x in c] for c in zip(*A)]
            mode.one = up(max(sum(abs(x) * b for x, b in zip(r, s)) / a for r, a in zip(A, s)))

    def back(self, phase, a, error, W, least):
        """Rows before this phase until little is left: (row, error, sum of what the steps up to it have added)."""
        size, out, added = self.steps[0].size(a), [], 0.0
        error *= self.most
        while True:
            out.append((a, error, added))
            before = self.cycle[(phase - 1 - len(out) + 1) % self.P]
            step, gens = self.steps[before], W(phase - len(out))
            if step.size(a) <= SMALL * size and len(out) > least + 2 or len(out) > 5000 + least:
                return out
            added = (added + gens.along(a) + error * gens.norm) * (1 + EPS)
            error += self.most**2 * (step.n + 2) * EPS * step.one * step.size(a) * WIDE
            a = [sum([x * y for x, y in zip(a, c)]) for c in step.columns]


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z = e.t["shape"]
    cycle, J, N, P = z["cycle"], z["rows"], len(e.modes), len(z["cycle"])
    first, anywhere = starts(e, ranges, box0)
    D, rows = exact(z["directions"]), [room(e, *pair) for pair in zip(z["h"], z["hx"])]
    demand(J >= 1 and len(rows) == J + J * N + P and all(0 <= q < N for q in cycle), "rows of the schedule")
    demand(all(k == P or cycle[k] == q for q, k in enumerate(z["entry"])) and len(z["entry"]) == N, "entries")
    s = [F(2) * b for b in e.box]
    path = Cycle(e.M, cycle, s)
    H0, H = Gens([], first, s), Gens([], anywhere, s)
    made = [[Table.gens_of(e, q, o, s) for q in range(N)] for o in range(len(e.gains))]
    none = len(e.gains) - 1
    unit = [[F(i == j) for j in range(e.n)] for i in range(e.n)]
    noise = [[Table.noise_of(e, q, o, D) for q in range(N)] for o in range(len(e.gains))]

    def steady(phase):
        """What the step of a phase adds where the estimate holds the noise of the mode before."""
        return made[min(cycle[(phase - 1) % P], none)][cycle[phase % P]]

    for phase in range(P):
        q = cycle[phase]
        held = noise[min(cycle[phase - 1], none)][q]
        for r, row in enumerate(mul(D, e.C[q]) + unit):
            a = [float(x) for x in row]
            back = path.back(phase, a, 2 * EPS * path.steps[0].size(a), steady, J)
            left = (path.steps[0].size(back[-2][0]) + back[-2][1]) * path.most * WIDE
            ever = left * (max(H0.norm, H.norm) + made[none][0].norm + path.all * max(
                g.norm for o in made for g in o)) + max(g.norm for g in made[none]) * left
            last = rows[J + J * N + phase][r]
            demand((back[-1][2] + ever + held[r]) * WIDE <= last, f"threshold of phase {phase}, direction {r}")
            for k, (b, error, _) in enumerate(back):
                begin = (phase - k) % P
                added = 0.0
                if k:
                    last_row, slip, before = back[k - 1]
                    gens = made[none][cycle[begin]]
                    added = gens.along(last_row) + slip * gens.norm + before
                more = noise[none][q][r] if k == 0 else held[r]
                for start, given in ((H, rows[J + k * N + q][r] if k < J else last),
                                     (H0, rows[k][r] if k < J else last)):
                    if start is H or begin == 0:
                        need = (start.along(b) + error * start.norm + added + more) * WIDE
                        demand(need <= given, f"threshold of phase {phase}, sample {k}, direction {r}")
    for q in range(N):
        for r, row in enumerate(mul(D, e.C[q]) + unit):
            need = (H.along([float(x) for x in row]) + noise[none][q][r]) * WIDE
            demand(need <= rows[J + q][r], f"threshold of mode {q} out of turn, direction {r}")
    for i, w in enumerate(cert["steady_box"]["width"]):
        demand(F(w) >= 2 * max(F(row[i]) for row in z["hx"][-P:]), f"ultimate width of state {i}")
    return "residuals and errors stay within the thresholds of the schedule with rounding, boundedness"
