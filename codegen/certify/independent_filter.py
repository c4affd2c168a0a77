"""Fault estimation filters, checked again: thresholds here, the energy gain in ``independent_energy.py``.

Standard library only, nothing of residua imported; exact fractions. Plant and filter together are one recursion of
e = [x; xi] with unknowns of known size,

    e+ = J e + W d + sum h_l p_l,   |d_i| <= 1,   |p_l| <= |S_l e| + weight_l |e| + room_l,   f_hat = O e + V d + ...,

d disturbance, noise, inputs and the rounding of y and u on their way in; the p_l what is uncertain in a row of the
plant and what the C rounds of xi. A set |r_i e| <= b_i is kept where each r_i J is a combination of the rows, given by
the certificate, plus a rest that counts by magnitude. Every row of the table must hold f_hat from there.
"""

import re
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, size  # noqa: E402 - stands beside this file
from independent_energy import automaton, check_energy, size_of  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402
from independent_step import entry  # noqa: E402

SHAPES = {"A": "xx", "B": "xu", "C": "yx", "D": "yu", "Bw": "xw", "Dw": "yw", "Dv": "yv", "Bf": "xf", "Df": "yf"}
EPS, NIL = 2.0**-52, 1e-290


def read_plant(text):
    """Modes: every matrix as [middle, effect of each parameter], sizes of w, v and theta; ranges of the signals."""
    p = tomllib.loads(text)
    names = {k: F(repr(float(v))) for k, v in p.get("constants", {}).items()}
    signals = {k: p["signals"].get(k, []) for k in ("x", "u", "y", "w", "v", "f", "theta")}
    order = sorted(signals["theta"], key=lambda s: s.get("measured", True))
    thetas, modes = [s["name"] for s in order], []
    for given in p.get("mode", [{"name": "only"}]):
        bounds = given.get("bounds", {})
        box = [tuple(F(float(b)) for b in bounds.get(s["name"], s["bounds"])) for s in order]
        mode = {"name": given["name"]}
        for key, (r, c) in SHAPES.items():
            rows = given.get(key, p.get("common", {}).get(key, [[0] * len(signals[c])] * len(signals[r])))
            parts = [[entry(e, names, thetas) for e in row] for row in rows]
            mode[key] = [[[e[0] + sum((m * (a + b) / 2 for m, (a, b) in zip(e[1:], box)), F(0)) for e in row]
                          for row in parts]]
            mode[key] += [[[e[1 + k] * (b - a) / 2 for e in row] for row in parts] for k, (a, b) in enumerate(box)]
        for k in "wv":
            mode[k] = [max(abs(F(float(b))) for b in bounds.get(s["name"], s["bounds"])) for s in signals[k]]
        modes.append(mode)
    ranges = {k: [s["range"] for s in signals[k]] for k in "xuyf"}
    if p["time"]["kind"] == "continuous":
        modes = __import__("independent_sampled").of_filter(text, modes)  # stands beside this file
    return modes, ranges, list(zip(p["initial"]["x_lo"], p["initial"]["x_hi"]))


def reach(bounds):
    """Largest magnitudes."""
    return [max(abs(F(float(a))), abs(F(float(b)))) for a, b in bounds]


class Joint:
    """The recursion of one mode: J, columns W and V, pushes (h, S, weight, room, seen), O with its rounding."""

    def __init__(self, p, t, q):
        M, G, L, K, Du, Dy = (exact(t[k][q]) for k in ("M", "G", "L", "K", "Du", "Dy"))
        (u, tiny), n, s = UNIT[t["real"]], len(p["A"][0]), len(M)
        umax, ymax = (reach(zip(t[k + "_lo"], t[k + "_hi"])) for k in "uy")
        utrue = [(1 + u) * b + tiny for b in umax]  # of what is read as at most umax
        A, B, C, D, Bw, Dw, Dv = (p[k][0] for k in ("A", "B", "C", "D", "Bw", "Dw", "Dv"))
        self.n, self.s = n, s
        self.J = [row + [F(0)] * s for row in A] + [a + b for a, b in zip(mul(L, C), M)]
        self.O = [a + b for a, b in zip(mul(Dy, C), K)]  # noqa: E741
        columns = []  # of x+, of xi+, of f_hat
        for to_x, to_y, to_xi, to_f, sizes in (
                (Bw, Dw, None, None, p["w"]), (None, Dv, None, None, p["v"]), (B, D, G, Du, umax),
                (B, D, None, None, [u * b + tiny for b in umax]), (None, None, L, Dy, [u * b + tiny for b in ymax])):
            for j, b in enumerate(sizes):
                y = [row[j] for row in to_y] if to_y else [F(0)] * len(ymax)
                own, out = ([size_of(row, y) + (more[i][j] if more else 0) for i, row in enumerate(gain)]
                            for gain, more in ((L, to_xi), (Dy, to_f)))
                column = [row[j] for row in to_x] if to_x else [F(0)] * n
                columns.append(([x * b for x in column + own], [x * b for x in out]))
        self.W = [list(row) for row in zip(*(c for c, _ in columns))] if columns else [[] for _ in range(n + s)]
        unit = [[F(i == j) for j in range(n + s)] for i in range(n + s)]
        self.pushes, none = [], [F(0)] * (n + s)
        for k in range(1, len(p["A"])):
            for i in range(n + len(ymax)):
                keys = ("A", "Bw", None, "B") if i < n else ("C", "Dw", "Dv", "D")
                x, w, v, of_u = (p[key][k][i if i < n else i - n] if key else [] for key in keys)
                h = unit[i] if i < n else [F(0)] * n + [row[i - n] for row in L]
                seen = [F(0)] * len(K) if i < n else [abs(row[i - n]) for row in Dy]
                room = size(w, p["w"]) + size(v, p["v"]) + size(of_u, utrue)
                if any(x) or room:
                    self.pushes.append((h, x + [F(0)] * s, none, room, seen))
        terms = len(ymax) + len(umax) + s  # every one goes through as many roundings at most
        rate, small = (1 + u) ** terms - 1, 3 * terms * tiny
        for i in range(s):
            room = rate * (size(G[i], umax) + size(L[i], ymax)) + small
            self.pushes.append((unit[n + i], none, [F(0)] * n + [rate * abs(a) for a in M[i]], room, [F(0)] * len(K)))
        self.weight = [[F(0)] * n + [rate * abs(a) for a in row] for row in K]
        self.room = [sum((abs(c[k]) for _, c in columns), rate * (size(Du[k], umax) + size(Dy[k], ymax)) + small)
                     for k in range(len(K))]


def combined(rows, wanted, given):
    """Nonnegative weights of the bounds that hold a functional: of its combination, and of what that leaves over."""
    demand(len(wanted) == len(given), "combinations of the certificate")
    out = []
    for row, (places, values) in zip(wanted, given):
        weights, rest = [F(0)] * len(rows), list(row)
        for j, v in zip(places, exact(values)):
            weights[j] += abs(v)
            rest = [a - v * b for a, b in zip(rest, rows[j])]
        for k, a in enumerate(rest):
            weights[k] += abs(a)
        out.append(weights)
    return out


def bounds_of(m, rows, cert, q):
    """G, omega of the rows a sample later and of f_hat: a bound is weights times b, plus a constant."""
    g = combined(rows, mul(rows, m.J), cert["carry"][q])
    o = [sum(map(abs, row), F(0)) for row in mul(rows, m.W)]
    f, free = combined(rows, m.O, cert["out"][q]), list(m.room)
    f = [[a + b for a, b in zip(row, more + [F(0)] * len(rows))] for row, more in zip(f, m.weight)]
    known = iter(combined(rows, [p[1] for p in m.pushes if any(p[1])], cert["sees"][q]))
    for h, S, weight, room, seen in m.pushes:
        bound = next(known) if any(S) else [F(0)] * len(rows)
        bound = [a + b for a, b in zip(bound, weight + [F(0)] * len(rows))]
        for into, constant, factors in ((f, free, seen), (g, o, [abs(size_of(row, h)) for row in rows])):
            for i, c in enumerate(factors):
                if c:
                    into[i] = [a + c * b if b else a for a, b in zip(into[i], bound)]
                    constant[i] += c * room
    return (g, o), (f, free)


def up(x):
    """A float not below a nonnegative fraction."""
    return float(x) * (1 + 4 * EPS) + NIL if x else 0.0


class Set:
    """The set |r_i e| <= b_i over the nodes of the switching graph, and the bounds that follow from others."""

    def __init__(self, modes, t, cert, graph):
        self.rows, n = exact(cert["rows"]), len(t["x_lo"]) + len(t["limit"])
        demand(self.rows[:n] == [[F(i == j) for j in range(n)] for i in range(n)], "the unit rows")
        self.node, self.edges = graph
        made = [bounds_of(Joint(p, t, q), self.rows, cert, q) for q, p in enumerate(modes)]
        self.b = [[float(x) for x in row] for row in cert["bounds"]]
        demand([len(r) for r in self.b] == [len(self.rows)] * len(self.node) and min(map(min, self.b)) >= 0, "bounds")
        for a, p, to in self.edges:
            g, o = made[p][0]
            b, after = exact(self.b[a]), exact(self.b[to])
            for i, row in enumerate(g):
                demand(size_of(row, b) + o[i] <= after[i], f"row {i} of the set is not kept, mode {modes[p]['name']}")
        self.wide = 1 + (len(self.rows) + 8) * EPS
        self.maps = [[([[up(x) for x in row] for row in A], [up(x) for x in c]) for A, c in pair] for pair in made]

    def times(self, A, b, c):
        """Upper bounds of A b + c, all nonnegative."""
        return [(sum([x * y for x, y in zip(row, b)]) + e) * self.wide for row, e in zip(A, c)]

    def after(self, bounds):
        """A sample later, per node."""
        new = [[0.0] * len(self.rows) for _ in self.node]
        for a, p, to in self.edges:
            (A, c), _ = self.maps[p]
            new[to] = [max(x, y) for x, y in zip(new[to], self.times(A, bounds[a], c))]
        return new

    def holds(self, bounds, thresholds, where):
        """Every threshold of a row of the table holds the estimate."""
        for q, given in enumerate(thresholds):
            A, c = self.maps[q][1]
            for a in (a for a, mode in enumerate(self.node) if mode in (None, q)):
                demand(all(x <= h for x, h in zip(self.times(A, bounds[a], c), given)), f"threshold {where}, mode {q}")

    def settled(self, bounds):
        """Whether bounds are within the last."""
        return all(x <= y for row, last in zip(bounds, self.b) for x, y in zip(row, last))


def check_thresholds(found, t, cert, ranges, box0):
    """All rows of the table, and the bounds that init and a restart begin with."""
    h, lost, shift, rows = t["h"], t["lost"], t["shift"], found.rows
    last, n = len(h) - 1, len(t["x_lo"])
    demand(0 <= lost <= last and t["start"] in (0, lost, last), "rows of the table")
    for name, given in (("x", ranges["x"]), ("x0", box0), ("u", ranges["u"])):
        for lo, hi, (a, b) in zip(t[name + "_lo"], t[name + "_hi"], given):
            room = UNIT[t["real"]][0] * max(abs(F(lo)), abs(F(hi))) if name == "u" else 0  # the caller rounds
            demand(F(lo) - room <= F(float(a)) and F(hi) + room >= F(float(b)), f"box {name} too small")
    declared, first = (reach(zip(t[k + "_lo"], t[k + "_hi"])) for k in ("x", "x0"))
    anywhere = [[up(size(row, declared + exact(t["limit"]))) for row in rows]] * len(found.node)
    begun = [[up(size(row[:n], first)) for row in rows]] * len(found.node)
    still = combined(rows, [row[:n] + [F(0)] * (len(row) - n) for row in rows], cert["lost"])
    still = [[up(x) for x in row] for row in still]
    late = [found.times(still, b, [0.0] * len(rows)) for b in found.b]
    for row, held in ((last, found.b), (lost, late), (0, anywhere)):
        demand(t["start"] != row or all(x <= y for a, b in zip(begun, held) for x, y in zip(a, b)),
               f"the initial box is not within the bounds of row {row}")
    for begin, end, bounds in ((0, lost, anywhere), (lost, last, late)):
        for k in range((end - begin) << shift):
            within = found.settled(bounds)
            found.holds(found.b if within else bounds, h[begin + (k >> shift)], f"row {begin + (k >> shift)}")
            bounds = found.b if within else found.after(bounds)
        demand(found.settled(bounds), f"after row {end - 1} the last bounds do not hold")
    found.holds(found.b, h[last], "for ever")
    for i, limit in enumerate(t["limit"]):
        demand(max(row[n + i] for row in found.b) < limit, f"limit of xi[{i}]")


def check_source(text, header, t, prefix):
    """Every table, number and count of the C is one of the design's; every gain of the design is in the C."""
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    known, affine = [flat(v) for v in t.values() if isinstance(v, list)], functions(text, prefix, "estimate|forward")
    for body in re.findall(TABLE, text, re.S):
        demand(body in affine or numbers(body, real) in known, "a table of the C is none of the design's")
    foreign = {abs(x) for x in numbers(text, real)} - {abs(x) for k in known for x in k} - {F(0), F(1)}
    demand(not foreign, f"the C holds {[float(x) for x in sorted(foreign)][:3]}, no table does")
    needed = {abs(x) for k in ("M", "G", "L", "K", "Du", "Dy") for x in flat(t[k])} - {F(0), F(1)}
    demand(needed <= {abs(x) for x in numbers(affine, real)}, "a constant of the tables is missing in the C")
    counts = {"LOST": t["lost"] << t["shift"], "LAST": (len(t["h"]) - 1) << t["shift"], "ROWS": len(t["h"])}
    for name, value in counts.items():
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(value)], f"macro {name}")
    for function, value in (("init", t["start"] << t["shift"]), ("whole_range", 0)):
        started = re.findall(r"since = (\w+);", functions(text, prefix, function))
        demand(started == [f"{value}U"], f"row that {function} begins with")
    shifts = re.findall(r"since >> (\d+)U", text)
    demand(shifts == [str(t["shift"])] if t["shift"] else not shifts, "samples per row")


def main(folder, design, record):
    """Check a folder of a filter."""
    modes, ranges, box0 = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        dwell = [cert[f"dwell_{k}"] for k in ("add", "drain", "limit")]
        demand(dwell == [design["supervision"][f"dwell_{k}"] for k in ("add", "drain", "limit")], "dwell time watched")
        check_energy(modes, ranges, t, cert, design["options"])
        graph = automaton(len(modes), *dwell) if any(dwell) else ([None], [(0, q, 0) for q in range(len(modes))])
        found, held = Set(modes, t, cert["set_of_both"], graph), cert.get("calibration", {"guaranteed": t["h"][-1]})
        check_thresholds(found, t | {"h": [*t["h"][:-1], held["guaranteed"]]}, cert["set_of_both"], ranges, box0)
        but = ", the last of them calibrated and not proved" * ("calibration" in cert)
        print(f"proved for {real}: thresholds of the estimate with rounding{but}, limits, energy gain")
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
