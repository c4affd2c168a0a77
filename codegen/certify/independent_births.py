"""Mode estimators, checked again: do the boxes hold the true mode and the true state, through switches at any instant?

Standard library only, nothing of residua imported; exact fractions. In xi = S x, over a period T, with the switch from
mode i to mode j at an instant s of it (s = 0: mode j alone), w~ what a disturbance differs by from its middle,

    xi+ = S e^(A_j T) x + int S e^(A_j (T - t)) (B_j u + mean + w~) dt + int_0^s f(t) dt,
    f(t) = S e^(A_j (T - t)) ((A_i - A_j) x(t) + (B_i - B_j) u + mean_i - mean_j),

so what a switch adds lies between 0 and T f over the period (``independent_period.py`` bounds it). By when a wrong mode
is out of the set is looked at in ``independent_delays.py``.
"""

import re
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_delays as delays  # noqa: E402 - stands beside this file
from independent import UNIT, demand, exact, mul, read_plant, rounding, size, sub  # noqa: E402
from independent_period import LOSS, Plant, Steps  # noqa: E402
from independent_sets import magnitudes, times  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402

PAIRS = ("J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth")
PRINTED = ("S_inverse", "x_room", "Phi", "Gamma", "shift", "reach", "v_lo", "v_hi", "start_lo", "start_hi", "wide_lo",
           "wide_hi", "limit", *PAIRS)


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
        added = self.plant.reached(j, self.plant.largest(i, j), self.plant.S)
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


def check_boxes(modes, ranges, box0, period, t, known=None):
    """Everything about the boxes of one number type; returns the enclosed plant, to be ``known`` where S is the same.

    A plant without a period is a discrete one.
    """
    S = exact(t["S"])
    plant = known if known and S == known.S else Plant(modes, S, period) if period else Steps(modes, S)
    tables = Tables(modes, t, plant)
    tables.starts(ranges, box0)
    tables.answers(ranges)
    for j in range(len(modes)):
        lost, sums = tables.step(j)
        for i in (i for i in range(len(modes)) if i != j):
            tables.birth(i, j, lost, sums)
    return plant


def check_source(text, header, t, prefix, more=None):
    """Every table of the C is one of the design's, and each of these is there; no other number, the oldest age.

    ``more`` are tables that not every estimator has.
    """
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    between = [(i, j) for i in range(len(t["J"])) for j in range(len(t["J"])) if i != j]
    known = {k: flat([t[k][i][j] for i, j in between] if k in PAIRS else t[k]) for k in PRINTED}
    known |= {"D": flat(t["D"])} if any(flat(t["D"])) else {}
    known |= more or {}
    given = functions(text, prefix, "[uy]_accepted")
    others = functions(text, prefix, r"(?![uy]_accepted)\w+")
    bodies = [numbers(body, real) for body in re.findall(TABLE, others, re.S)]
    for body in bodies:
        demand(body in known.values(), f"a table of the C is none of the design's: {[float(x) for x in body][:3]}")
    for name, values in known.items():
        demand(values in bodies or not values, f"{name} is missing in the C")
    ranges = flat([t[k] for k in ("u_lo", "u_hi", "y_lo", "y_hi")])
    demand(sorted(numbers(given, real)) == sorted(ranges), "ranges that are accepted")
    rest = numbers(re.sub(TABLE, "", others, flags=re.S), real)
    demand(not set(rest) - {F(0)}, "the C holds a number that no table does")
    demand(re.findall(r"#define \w+_(?:AGES|OLDEST) (\d+)U", header) == [str(t["ages"] + 1), str(t["ages"])], "ages")


def period_of(design):
    """Sampling period of a continuous plant."""
    time = tomllib.loads(design["plant"]["toml"])["time"]
    return F(float(time["sample_period"])) if time["kind"] == "continuous" else None


def main(folder, design, record):
    """Check a folder of a mode estimator."""
    modes, ranges, box0 = read_plant(design["plant"]["toml"])
    plant = None
    for real, t in design["tables"].items():
        plant = check_boxes(modes, ranges, box0, period_of(design), t, plant)
        demand(design["certificate"][real]["ages"] == t["ages"] < design["certificate"][real]["dwell"], "oldest age")
        said = delays.check(design, real, ranges)
        print(f"proved for {real}: true mode and state are in the boxes with rounding; {said}")
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
