"""Estimators by sliding modes, checked again: do the bounds of a mode hold x while it is active; Theorem 12.

Standard library only, nothing of residua imported; exact fractions. Over a period T in mode q, s = C x + Dv v + its own
rounding, w~ what a disturbance differs by from its middle,

    x+ = e^(A T) x + int e^(A t) (B u + mean + w~) dt,      x_hi+ = d_hi + G u + L s + M x_hi   (rounded),   M >= 0,

so d_hi has to hold all that x+ - G u - L s - M x can be over the ranges, and the rounding. The gains are those of the
certificate, held for a period; these meet two matrix inequalities in continuous time. Which mode the loops decide for
is not looked at: nothing is claimed of it.
"""

import re
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_driven as framers  # noqa: E402 - stands beside this file
from independent import SIDES, UNIT, demand, exact, mul, read_plant, rounding, size, sub, sup  # noqa: E402
from independent_energy import surely_positive  # noqa: E402 - both stand beside this file
from independent_period import LOSS, Plant, exponential  # noqa: E402
from independent_sets import magnitudes  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402

PRINTED = ("M_hi", "M_lo", "L_hi", "L_lo", "d_hi", "d_lo", "K_hi", "K_lo", "G", "H", "v_lo", "v_hi", "limit", "z_limit",
           "rate_limit", "a", "b", "x_lo", "x_hi", "x0_lo", "x0_hi")
DEFINED = ("period", "turn", "pull", "ground", "inverse", "foot", "smooth", "share")


def most(bounds):
    """Largest magnitudes."""
    return [max(abs(F(float(a))), abs(F(float(b)))) for a, b in bounds]


def driven(plant, q):
    """Bounds of int |e^(A t)| half dt over the period: of an entry that keeps its sign, its integral."""
    A, n, (powers, near), half = plant.modes[q]["A"], len(plant.S), plant.x[q], plant.half[q]
    apart = sub(near, plant.S)  # plant.S is the identity here
    rates = [(mul(power, A), mul(mul(magnitudes(power), apart), magnitudes(A))) for power in powers]
    values = [(power, mul(magnitudes(power), apart)) for power in powers]
    whole = [a + b for a, b in zip(A, plant.S)] + [[F(0)] * (2 * n) for _ in range(n)]
    integral, out = [row[n:] for row in exponential(whole, plant.T)[:n]], [F(0)] * n
    for j in range(n):
        coarse = plant.reached(q, [h * (k == j) for k, h in enumerate(half)], plant.S)
        for i in range(n):  # off the diagonal an entry begins at zero, so that it keeps its sign if its rate does
            here = [(v[i][j], room[i][j] + LOSS) for v, room in (values if i == j else rates)]
            keeps = any(all(s * v > room for v, room in here) for s in (1, -1))
            out[i] += abs(integral[i][j]) * half[j] + LOSS if keeps else coarse[i]
    return out


class Tables:
    """The tables of one number type against the plant."""

    def __init__(self, modes, t, plant, ranges, box0):
        self.modes, self.t, self.plant, self.real = modes, t, plant, t["real"]
        self.u, self.tiny = UNIT[self.real]
        self.box = [(F(float(a)), F(float(b))) for a, b in ranges]
        self.limit, self.x = exact(t["limit"]), most(ranges)
        for name, given in (("x", ranges), ("x0", box0)):
            for lo, hi, (a, b), far in zip(t[name + "_lo"], t[name + "_hi"], given, self.limit):
                demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)), f"box {name} too small")
                demand(max(-F(lo), F(hi)) <= far, f"limit within the box {name}")
        self.inputs = list(zip(exact(t["u_lo"]), exact(t["u_hi"])))
        self.umax, ymax = (most(zip(t[k + "_lo"], t[k + "_hi"])) for k in "uy")
        self.uslip = [self.u * b + self.tiny for b in self.umax]
        self.utrue = [(a - s, b + s) for (a, b), s in zip(self.inputs, self.uslip)]
        first, D = modes[0], exact(t["D"])
        demand(all(p[k] == first[k] for p in modes for k in ("C", "D", "Dv", "v")), "C, D, Dv or v that changes")
        self.seen, self.lost = [], []  # magnitude of y - D u as computed, what it is off from C x + Dv v
        for i, y in enumerate(ymax):
            error, top = rounding([(F(1), y), *zip(D[i], self.umax)], self.real)
            self.seen.append(top + error)
            self.lost.append(error + self.u * y + self.tiny + size(D[i], self.uslip)
                             + size(first["D"][i], most(self.utrue), D[i]))

    def test(self):
        """Bounds of the noise: the test of the active mode cannot fail."""
        p, H = self.modes[0], exact(self.t["H"])
        for side, s in SIDES:
            for i, given in enumerate(exact(self.t[f"v_{side}"])):
                slip = rounding([*zip(H[i], self.limit), (F(1), given)], self.real)[0]
                need = sup(p["Dv"][i], p["v"], s) + size(p["C"][i], self.x, H[i]) + self.lost[i] + slip
                demand(s * given >= need, f"v_{side}[{i}] lacks {float(need - s * given):.3g}")

    def step(self, q, errors):
        """Offsets of a mode, and the errors that its bounds settle to."""
        p, t, n, n_u = self.modes[q], self.t, len(self.limit), len(self.umax)
        whole, G = self.plant.W[q][3], exact(t["G"][q])
        added = driven(self.plant, q)
        for (side, s), given in zip(SIDES, errors, strict=True):
            M, L, d = (exact(t[f"{k}_{side}"][q]) for k in "MLd")
            demand(min(map(min, M)) >= 0, f"M_{side} < 0 in mode {p['name']}")
            of_x = sub(sub([row[:n] for row in whole[:n]], M), mul(L, p["C"]))
            of_u, of_v, e = sub([row[n:n + n_u] for row in whole[:n]], G), mul(L, p["Dv"]), exact(given)
            for i in range(n):
                slip = rounding([(F(1), d[i]), *zip(G[i], self.umax), *zip(L[i], self.seen), *zip(M[i], self.limit)],
                                self.real)[0]
                slip += size(L[i], self.lost) + size(G[i], self.uslip) + LOSS * (1 + sum(self.x + self.umax))
                ends = [sup(of_x[i], self.box, k) + sup(of_u[i], self.utrue, k) + sup(of_v[i], p["v"], -k)
                        + k * whole[i][-1] + added[i] + slip for k in (s, -s)]
                where = f"x_{side}[{i}] of mode {p['name']}"
                demand(s * d[i] >= ends[0], f"offset of {where} lacks {float(ends[0] - s * d[i]):.3g}")
                demand(size(M[i], e) + s * d[i] + ends[1] <= e[i], f"the error of {where} does not settle")


def check_theorem(modes, cert):
    """P >= 1, gains that are Metzler within their limit, and the inequalities of gamma and beta in every mode."""
    P = exact(cert["P"])
    n, limit, J = len(P[0]), F(cert["limit"]), F(cert["target"])
    demand(min(map(min, P)) >= 1 and 2 * J == 1, "P or J")
    C, p = modes[0]["C"], len(modes[0]["C"])
    seen = [[max(x, 0) for x in row] + [max(-x, 0) for x in row] for row in C]
    seen += [[-max(-x, 0) for x in row] + [-max(x, 0) for x in row] for row in C]
    both, wide = P[0] + P[1], 2 * n
    for q, mode in enumerate(modes):
        S = [[sum(row[i] * row[j] for row in seen) for j in range(wide)] for i in range(wide)]
        for k, (side, _) in enumerate(SIDES):
            closed = sub(mode["A"], mul(exact(cert[f"L_{side}"][q]), C))
            demand(all(x + limit * (i == j) >= 0 for i, row in enumerate(closed) for j, x in enumerate(row)),
                   f"A - L_{side} C is not Metzler within the limit in mode {mode['name']}")
            for i in range(n):
                for j in range(n):
                    S[k * n + i][k * n + j] += P[k][i] * closed[i][j] + P[k][j] * closed[j][i]
        sign = [1 if i < n else -1 for i in range(wide)]
        told = [[sign[i] * both[i] * (i % n == j) - J * sum(row[i] for row in seen) for j in range(n)]
                for i in range(wide)]
        square = [[2 * p * J * J - F(cert["beta"][q]) * (i == j) for j in range(n)] for i in range(n)]
        gamma = [[both[i] * (i == j) for j in range(wide)] for i in range(wide)]
        corner = [[-F(cert["gamma"][q]) * (i == j) for j in range(wide)] for i in range(wide)]
        for name, off, end in (("gamma", gamma, corner), ("beta", told, square)):
            whole = [a + b for a, b in zip(S, off)] + [list(c) + b for c, b in zip(zip(*off), end)]
            demand(surely_positive([[-x for x in row] for row in whole]), f"level {name} of mode {mode['name']}")


def check_held(modes, t, cert, T):
    """The gains of the tables are those of the theorem, held for a period."""
    near = UNIT[t["real"]][0] * 2
    for q, mode in enumerate(modes):
        for side, _ in SIDES:
            L, n = exact(cert[f"L_{side}"][q]), len(mode["A"])
            whole = [a + b for a, b in zip(sub(mode["A"], mul(L, mode["C"])), L)]
            whole += [[F(0)] * len(whole[0]) for _ in L[0]]
            held = [row[n:] for row in exponential(whole, T)[:n]]
            for row, given in zip(held, exact(t[f"L_{side}"][q])):
                demand(all(abs(a - b) <= near * abs(a) + F(1e-30) for a, b in zip(row, given, strict=True)),
                       f"L_{side} of mode {mode['name']} is not the gain of the certificate, held for a period")


def check_source(text, header, t, prefix):
    """Every table and number of the C is one of the design's, and each of these is there; blanking and dwell time."""
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    known = {k: flat(t[k]) for k in PRINTED + ("D",) * any(flat(t["D"]))}
    bodies = [numbers(body, real) for body in re.findall(TABLE, text, re.S)]
    for body in bodies:
        demand(body in known.values(), f"a table of the C is none of the design's: {[float(x) for x in body][:3]}")
    for name, values in known.items():
        demand(values in bodies or not values, f"{name} is missing in the C")
    for side, _ in SIDES:  # upper and lower bounds have tables of the same names
        for function, names in (("move", "MLd"), ("turn", "K")):
            body = functions(text, prefix, f"{function}_{side}")
            here = [numbers(table, real) for table in re.findall(TABLE, body, re.S)]
            demand(all(known[f"{k}_{side}"] in here for k in names), f"tables of {function}_{side}")
    for name in DEFINED:
        found = [numbers(line, real) for line in re.findall(rf"(?m)^#define \w+_{name.upper()} (.*)$", text)]
        demand(found == [[F(t[name])]], f"macro {name.upper()}")
    bounds = numbers(functions(text, prefix, "[uy]_accepted"), real)
    demand(sorted(bounds) == sorted(flat([t[k] for k in ("u_lo", "u_hi", "y_lo", "y_hi")])), "ranges that are accepted")
    rest = functions(re.sub(TABLE, "", text, flags=re.S), prefix, r"(?![uy]_accepted)\w+")
    demand(not set(map(abs, numbers(rest, real))) - {F(0), F(1, 2), F(1)}, "the C holds a number that no table does")
    for name in ("BLANK", "DWELL"):
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(t[name.lower()])], f"macro {name}")


def without_parameters(design):
    """Modes whose parameters are bounded disturbances, for the widest inputs that are accepted; ranges, initial box."""
    u = [max(abs(F(t[f"u_{s}"][j])) * (1 + UNIT[t["real"]][0]) + UNIT[t["real"]][1] for t in design["tables"].values()
             for s in ("lo", "hi")) for j in range(len(next(iter(design["tables"].values()))["u_lo"]))]
    given, boxes, *_ = framers.read_plant(design["plant"]["toml"])
    return framers.middle_plant(given, boxes["x"], u), boxes["x"], boxes["x0"]


def check_design(design):
    """The tables of an estimator against the plant."""
    toml = tomllib.loads(design["plant"]["toml"])
    theta = toml["signals"].get("theta")
    modes, ranges, box0 = without_parameters(design) if theta else read_plant(design["plant"]["toml"])
    T, dwell = F(float(toml["time"]["sample_period"])), toml["switching"]
    dwell = F(float(dwell.get("minimum_dwell", dwell.get("average_dwell"))))
    plant = Plant(modes, [[F(i == j) for j in range(len(ranges))] for i in range(len(ranges))], T)
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        demand((t["dwell"], t["blank"]) == (cert["dwell"], cert["blank"]), "dwell or blanking time of the certificate")
        demand(t["dwell"] * T <= dwell * (1 + F(1, 10**8)), "dwell time")
        check_theorem(modes, cert)
        check_held(modes, t, cert, T)
        tables = Tables(modes, t, plant, ranges, box0)
        tables.test()
        for q in range(len(modes)):
            tables.step(q, cert["errors"][q])
        print(f"proved for {real}: bounds hold x while their mode is active, tests, widths, Theorem 12; no decision")


def main(folder, design, record):
    """Check a folder of an estimator by sliding modes; those that guide another observer are handed over."""
    told = [t["told"] for t in design["tables"].values() if "told" in t]
    if told:
        part = ("independent_guided_filter" if "E" in told[0] else
                "independent_guided_point" if "shape" in told[0] else "independent_guided")
        return __import__(part).main(folder, design, record)
    check_design(design)
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
