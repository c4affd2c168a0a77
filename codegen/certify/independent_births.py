"""Mode estimators, checked again: do the boxes hold the true mode and the true state, through switches at any instant?

Standard library only, nothing of residua imported; exact fractions. In xi = S x, over a period T, with the switch from
mode i to mode j at an instant s of it (s = 0: mode j alone), w~ what a disturbance differs by from its middle,

    xi+ = S e^(A_j T) x + int S e^(A_j (T - t)) (B_j u + mean + w~) dt + int_0^s f(t) dt,
    f(t) = S e^(A_j (T - t)) ((A_i - A_j) x(t) + (B_i - B_j) u + mean_i - mean_j),

so what a switch adds lies between 0 and T f over the period. Exponentials are Taylor sums on a grid of 2^-256; between
the middles of PIECES parts of the period T f is bounded by its derivatives. By when a wrong mode is out of the set is
not checked here: that rests on linear programs, whose witnesses ``codegen.certify.mode_delay`` checks.
"""

import re
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, read_plant, rounding, size, sub  # noqa: E402 - stands beside this file
from independent_sets import add, magnitudes, times  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402
from independent_table import inverse  # noqa: E402

PIECES, GRID, LOSS = 24, 2**256, F(1, 2**150)  # LOSS: more than the grid can make of any product here
PAIRS = ("J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth")
PRINTED = ("S_inverse", "x_room", "Phi", "Gamma", "shift", "reach", "v_lo", "v_hi", "start_lo", "start_hi", "wide_lo",
           "wide_hi", "limit", *PAIRS)


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
        for k in range(PIECES):
            left, right = cut(mul(self.S, rest[PIECES - 1 - k])), cut(mul(there[k], self.V))
            wide = mul(magnitudes(left), near_j)
            value, first = (mul(mul(left, M), right) for M in (change, slope))
            room = mul(wide, mul(second, mul(near_i, magnitudes(right))))
            room = [[T * (abs(a) * h / 2 + b * h * h / 8) + LOSS for a, b in zip(*rows)] for rows in zip(first, room)]
            ends = [add(grown(value, T), room, sign) for sign in (-1, 1)]
            least = ends[0] if least is None else [[min(e) for e in zip(*rows)] for rows in zip(least, ends[0])]
            most = ends[1] if most is None else [[max(e) for e in zip(*rows)] for rows in zip(most, ends[1])]
            moved = times(wide, times(magnitudes([row[:n] for row in change]), before))
            later = [max(a, T * b + LOSS) for a, b in zip(later, moved)]
        return least, most, later


class Tables:
    """The tables of one number type against the plant."""

    def __init__(self, modes, t, plant):
        self.t, self.real, (self.u, self.tiny), self.modes = t, t["real"], UNIT[t["real"]], modes
        self.plant, self.limit = plant, exact(t["limit"])
        self.umax, self.ymax = ([max(abs(F(a)), abs(F(b))) for a, b in zip(t[k + "_lo"], t[k + "_hi"])] for k in "uy")
        self.uslip = [self.u * b + self.tiny for b in self.umax]
        self.utrue = [a + b for a, b in zip(self.umax, self.uslip)]

    def holds(self, name, given, need):
        """Refuse where a constant is too small."""
        for i, (a, b) in enumerate(zip(given, need, strict=True)):
            demand(F(a) >= b, f"{name}[{i}] lacks {float(b - F(a)):.3g}")

    def starts(self, ranges, box0):
        """Boxes of init and of a restart hold S x, limits both; the first coordinates are the outputs."""
        t, S = self.t, self.plant.S
        demand(all(S[:len(self.ymax)] == p["C"] for p in self.modes), "the first coordinates are the outputs")
        demand(all(p["D"] == self.modes[0]["D"] and p["Dv"] == self.modes[0]["Dv"] and p["v"] == self.modes[0]["v"]
                   for p in self.modes), "D, Dv or v that changes with the mode")
        for name, box in (("start", box0), ("wide", ranges)):
            ends = [[(F(float(b)) + s * F(float(a))) / 2 for a, b in box] for s in (1, -1)]
            middle, radius = times(S, ends[0]), times(magnitudes(S), ends[1])
            self.holds(f"{name}_hi", t[f"{name}_hi"], [a + b for a, b in zip(middle, radius)])
            self.holds(f"minus {name}_lo", [-x for x in t[f"{name}_lo"]], [b - a for a, b in zip(middle, radius)])
            self.holds("limit", t["limit"], [max(-F(a), F(b)) for a, b in zip(t[f"{name}_lo"], t[f"{name}_hi"])])

    def answers(self, ranges):
        """What a measurement leaves of a box holds C x, what is answered holds x."""
        t, p, n = self.t, self.modes[0], len(self.limit)
        D, half = exact(t["D"]), [(F(b) - F(a)) / 2 for a, b in p["v"]]
        middle = times(p["Dv"], [(F(a) + F(b)) / 2 for a, b in p["v"]])
        for side, s in (("hi", 1), ("lo", -1)):
            need = []
            for i, y in enumerate(self.ymax):
                given = F(t[f"v_{side}"][i])
                error = rounding([(F(1), y), *zip(D[i], self.umax), (F(1), given)], self.real)[0]
                slip = (y * self.u + self.tiny) * (1 + 2 * self.u)
                need.append(s * middle[i] + size(p["Dv"][i], half) + error + slip + size(D[i], self.uslip)
                            + size(p["D"][i], self.utrue, D[i]))
            self.holds(f"v_{side}", [s * x for x in t[f"v_{side}"]], need)
        back = exact(t["S_inverse"])
        x = [max(abs(F(float(a))), abs(F(float(b)))) for a, b in ranges]
        lost = sub(mul(back, self.plant.S), [[F(i == j) for j in range(n)] for i in range(n)])
        self.holds("x_room", t["x_room"], [size(lost[i], x) + rounding(
            [*zip(back[i], self.limit), (F(1), F(t["x_room"][i]))], self.real)[0] for i in range(n)])

    def step(self, q):
        """Of a period in mode q: what the tables leave out, terms of each sum and its rounding."""
        t, n, n_u = self.t, len(self.limit), len(self.umax)
        M = mul(mul(self.plant.S, self.plant.W[q][3][:n]), self.plant.V)
        Phi, Gamma, shift = (exact(t[k][q]) for k in ("Phi", "Gamma", "shift"))
        lost, sums, grid = [], [], LOSS * (1 + sum(self.limit + self.utrue))
        for i in range(n):
            lost.append(size(M[i][:n], self.limit, Phi[i]) + size(M[i][n:n + n_u], self.utrue, Gamma[i])
                        + abs(M[i][-1] - shift[i]) + size(Gamma[i], self.uslip) + grid)
            sums.append([(F(1), abs(shift[i])), *zip(Gamma[i], self.umax), *zip(Phi[i], self.limit)])
        need = [a + b + rounding([*terms, (F(1), F(r))], self.real)[0] for a, b, terms, r in zip(
            self.plant.reached(q, self.plant.half[q], self.plant.S), lost, sums, t["reach"][q])]
        self.holds(f"reach of mode {self.modes[q]['name']}", t["reach"][q], need)
        return lost, sums

    def birth(self, i, j, lost, sums):
        """Of a period in which mode i becomes mode j."""
        t, n = self.t, len(self.limit)
        where = f"{self.modes[i]['name']} to {self.modes[j]['name']}"
        J, J_u, shift, R, R_u, reach, birth = (exact(t[k][i][j]) for k in PAIRS)
        least, most, later = self.plant.jumps(i, j)
        both = [max(a, b) for a, b in zip(self.plant.half[i], self.plant.half[j])]
        added = self.plant.reached(j, both, self.plant.S)
        for r in range(n):
            middle = J[r] + J_u[r] + [shift[r]]
            far = [max(abs(a - c), abs(b - c)) for a, b, c in zip(least[r], most[r], middle)]
            self.holds(f"jump {where}, row {r}, ", [*R[r], *R_u[r], reach[r]], [*far[:-1], far[-1] + later[r]])
            parts = [rounding(terms, self.real) for terms in (
                sums[r], [(F(1), abs(shift[r])), *zip(J_u[r], self.umax), *zip(J[r], self.limit)],
                [(F(1), reach[r]), *zip(R_u[r], self.umax), *zip(R[r], self.limit)])]
            jump = rounding([(F(1), parts[1][1]), (F(1), parts[2][1])], self.real)
            last = rounding([(F(1), parts[0][1]), (F(1), jump[1]), (F(1), birth[r])], self.real)
            slip = size([a + b for a, b in zip(magnitudes([J_u[r]])[0], R_u[r])], self.uslip)
            need = added[r] + lost[r] + slip + jump[0] + last[0] + sum(error for error, _ in parts)
            self.holds(f"birth {where}, row {r}, ", [birth[r]], [need])


def check_source(text, header, t, prefix):
    """Every table of the C is one of the design's, and each of these is there; no other number, the oldest age."""
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    between = [(i, j) for i in range(len(t["J"])) for j in range(len(t["J"])) if i != j]
    known = {k: flat([t[k][i][j] for i, j in between] if k in PAIRS else t[k]) for k in PRINTED}
    known |= {"D": flat(t["D"])} if any(flat(t["D"])) else {}
    bodies = [numbers(body, real) for body in re.findall(TABLE, text, re.S)]
    for body in bodies:
        demand(body in known.values(), f"a table of the C is none of the design's: {[float(x) for x in body][:3]}")
    for name, values in known.items():
        demand(values in bodies or not values, f"{name} is missing in the C")
    bounds = numbers(functions(text, prefix, "[uy]_accepted"), real)
    demand(sorted(bounds) == sorted(flat([t[k] for k in ("u_lo", "u_hi", "y_lo", "y_hi")])), "ranges that are accepted")
    rest = functions(re.sub(TABLE, "", text, flags=re.S), prefix, r"(?![uy]_accepted)\w+")
    demand(not set(numbers(rest, real)) - {F(0)}, "the C holds a number that no table does")
    demand(re.findall(r"#define \w+_(?:AGES|OLDEST) (\d+)U", header) == [str(t["ages"] + 1), str(t["ages"])], "ages")


def main(folder, design, record):
    """Check a folder of a mode estimator."""
    modes, ranges, box0 = read_plant(design["plant"]["toml"])
    period, plant = F(float(tomllib.loads(design["plant"]["toml"])["time"]["sample_period"])), None
    for real, t in design["tables"].items():
        plant = plant if plant and exact(t["S"]) == plant.S else Plant(modes, exact(t["S"]), period)
        tables = Tables(modes, t, plant)
        tables.starts(ranges, box0)
        tables.answers(ranges)
        for j in range(len(modes)):
            lost, sums = tables.step(j)
            for i in (i for i in range(len(modes)) if i != j):
                tables.birth(i, j, lost, sums)
        demand(design["certificate"][real]["ages"] == t["ages"] < design["certificate"][real]["dwell"], "oldest age")
        print(f"proved for {real}: true mode and state are in the boxes with rounding; delays are not checked here")
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
