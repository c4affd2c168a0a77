"""Independent checker of designs with parameters, unknowns or a continuous plant; ``independent.py`` hands over to it.

Standard library only, nothing of residua imported. With the enclosed step z+ = Phi(p) z + W of ``independent_step`` and
T = I - N C, every entry of T Phi(p) - [M, G](theta) - L(theta) [C, D] is bounded over the box of theta; what of it is
beyond the radii R, S must fit, times the ranges, into the offsets, together with T W, noise and rounding. Errors and
widths are followed at the corners of theta; where the mode may be told late, with the steps of every other mode too.
Where coordinates are changed the recursion is that of z = Z x: T = Z, M Z stands for M, and M takes the box of z.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent as plain  # noqa: E402 - stands beside this file
from independent import SIDES, demand, exact, mul, rounding, size, sub, sup  # noqa: E402
from independent_mode import Mode, beyond, size_of, split  # noqa: E402
from independent_step import add, left_over, mag, read_plant, times, transition  # noqa: E402


def covered(t, name, q, i, need, before, after):
    """The outward offset and the rounding of its sum; refuses where it is too small."""
    value = F(t[name][q][i]) * (1 if name.endswith("hi") else -1)
    error, _ = rounding([*before, (F(1), value), *after], t["real"])
    demand(need + error <= value, f"offset {name}[{i}] of mode {q} lacks {float(need + error - value):.3g}")
    return value, error


def check_blind(m, t, q):
    """Prediction without measurement and parameters, and the bounds of the outputs."""
    n, v, p = len(m.x), t["vary"], m.p
    one = [[F(i == j) for j in range(n)] for i in range(n)]
    A, B, C, D, Ra, Sa = (exact(x[q]) for x in (t["A"], t["B"], t["C"], t["D"], v["Ra"], v["Sa"]))
    target = [[a + b for a, b in zip(A, B)], *(times(0, add(p["F"][0])) for _ in m.box)]
    inside = [(c - k, c + k) for c, k in zip(m.z["middle"], m.z["K"])]
    left = split(left_over(one, m.z, target[:1 + len(inside)], inside, [F(0)] * len(inside)), n)
    for side, s in SIDES:
        for i, w in enumerate(m.z["W"](one, s)):
            error, spread = rounding([*zip(Ra[i], m.x), *zip(Sa[i], m.u)], m.real)
            need = w + error + beyond(left[0][i], Ra[i], m.x) + beyond(left[1][i], Sa[i], m.u_true)
            covered(t, "a_" + side, q, i, need + size(B[i] + Sa[i], m.u_slip * 2), zip(B[i], m.u),
                    [*zip(A[i], m.x), (F(1), spread)])
        for j in range(len(C)):
            need = sup(p["Dv"][j], p["v"], s) + size(p["C"][j], m.x, C[j]) + size(p["D"][j], m.u_true, D[j])
            covered(t, "c_" + side, q, j, need + size(D[j], m.u_slip) + m.y_slip[j], zip(D[j], m.u), zip(C[j], m.x))


def check_change(t, cert):
    """The change of coordinates: ranges of z, both maps, and the widths of x that follow from those of z."""
    c = {k: exact(v) for k, v in t["change"].items()}
    x = list(zip(*(exact(t[f"x_{s}"]) for s in ("lo", "hi"))))
    both = {"real": t["real"]} | {f"{k}_{s}": [t["change"][f"{k}_{s}"]] for k in "eb" for s, _ in SIDES}
    identity = [[F(i == j) for j in range(len(x))] for i in range(len(x))]
    lost = sub(identity, mul(c["X"], c["Z"]))
    for i, row in enumerate(c["Z"]):
        demand(c["z_hi"][i] >= sup(row, x) and -c["z_lo"][i] >= sup(row, x, -1)
               and c["box"][i] >= max(c["z_hi"][i], -c["z_lo"][i]), f"range of z[{i}]")
        for s, _ in SIDES:
            covered(both, f"e_{s}", 0, i, F(0), [], zip(row, exact(t["box"])))
    for i, row in enumerate(c["X"]):
        room = [covered(both, f"b_{s}", 0, i, size(lost[i], exact(t["box"])), [], list(zip(row, c["box"])))
                for s, _ in SIDES]
        if cert.get("steady_box"):
            width = size(row, exact(cert["steady_box"]["width"])) + sum(b + error for b, error in room)
            demand(F(cert["x_width"][i]) >= width, f"ultimate width of x[{i}]")


def check_tables(modes, t, late):
    """Containment; returns the tables at the corners of theta, growth of error and width at each, and theta^2."""
    push, theta2, at, widths = {"hi": [], "lo": [], "width": []}, F(0), [], []
    noise2 = [sum((max(sup(r, m.p["v"]), sup(r, m.p["v"], -1)) ** 2 for r in m.p["Dv"]), F(0)) for m in modes]
    tnl = any(any(map(any, m.N)) for m in modes)
    for q, m in enumerate(modes):
        for i, j in product(range(len(m.x)), repeat=2):
            fixed = not any(slope[i][j] for slope in m.M[1:])  # a constant may take the opposite bound
            demand(fixed or min(M[i][j] for M in m.corners("M")) >= 0, f"T A - L C < 0 in mode {m.p['name']}, row {i}")
        check_blind(m, t, q)
        NDv = [(mul(m.N, r.p["Dv"]), r.p["v"]) for r in modes]
        width, grow = [F(0)] * len(m.x), {}
        others = modes if late else [m]
        left = [m.left(r.z) for r in others]
        for side, s in SIDES:
            later = [max(sup(N[i], b, -s) for N, b in NDv) for i in range(len(m.x))]
            slack = [F(0)] * len(m.x)
            for i, (need, before, after, slips, apart) in enumerate(m.rows(s, later, left[others.index(m)])):
                d, error = covered(t, "d_" + side, q, i, need, before, after)
                width[i] += d + error + apart
                slack[i] = d + error + slips
            against = [[w + size(a, m.x) + size(b, m.u_true) for w, a, b in zip(r.z["W"](m.T, -s), *A)]
                       for r, A in zip(others, left)]
            grow[side] = [x + max(rows) for x, rows in zip(slack, zip(*against))], later
        for L in m.corners("L"):
            radius = [size(R, m.x) + size(S, m.u) + size(E, row) for R, S, E, row in zip(m.R, m.S, m.E, L)]
            at.append(q)
            widths.append([a + 2 * b for a, b in zip(width, radius)])
            for side, s in SIDES:
                slack, later = [a + b for a, b in zip(grow[side][0], radius)], grow[side][1]
                LDv = [(mul(L, r.p["Dv"]), r.p["v"]) for r in others]
                rise = [max(sup(D[i], b, s) for D, b in LDv) + max(sup(N[i], b, s) for N, b in NDv)
                        for i in range(len(slack))]
                push[side].append([a + b for a, b in zip(slack, rise)])
                fall = [-s * size_of(row, m.mid) if len(m.M) > 1 else sup(row, m.p["v"], -s)
                        for row in mul(L, m.p["Dv"])]
                slack2 = sum((max(a, -b - c, 0) ** 2 for a, b, c in zip(slack, fall, later)), F(0))
                theta2 = max(theta2, slack2 + noise2[q] + (max(noise2) if tnl else 0))
    push["width"] = widths
    return at, push, theta2


def signed(push, cert):
    """Entries that take the opposite bound mix both errors: what bounds both follows |M|."""
    both = [[max(a, b) for a, b in zip(*rows)] for rows in zip(push["hi"], push["lo"])]
    push["hi"] = push["lo"] = both
    box = cert.get("steady_box") or {"hi": 0, "lo": 0}
    demand(box["hi"] == box["lo"], "ultimate box hi is not lo, M mixes both errors")
    demand(cert["kind"] != "linf", "a Lyapunov inequality per framer, M mixes both errors")


def check_framers(t, cert, given, boxes, signals, h, late, tnl):
    """Framers with parameters, of one number type, and their claims."""
    both = t["vary"]["midpoint"]
    known = [j for j, s in enumerate(signals["theta"]) if s.get("measured", True)]
    demand(t["vary"]["columns"] == known and t["vary"]["late"] == late and t["clamp"], "what is measured")
    demand(not both or (h is not None and tnl and known and all(
        "rate" in signals["theta"][j] for j in known) and all(m["theta"] == given[0]["theta"] for m in given)),
        "the mean of both ends is no measure of the parameters")
    for name, box in boxes.items():
        for lo, hi, (a, b), z in zip(t[name + "_lo"], t[name + "_hi"], box, t["box"]):
            demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)) and max(-lo, hi) <= z, f"box {name} too small")
    modes = [Mode(p, t, q, transition(p, signals, h, both), both) for q, p in enumerate(given)]
    at, push, theta2 = check_tables(modes, t, late)
    if "change" in t:
        check_change(t, cert)
    grown = {f"{k}_{s}": [mag(A) if k == "M" else A for m in modes for A in m.corners(k)]
             for k in "MGLN" for s, _ in SIDES} | ({"G_lo": None} if late else {})  # late: no width
    if any(x < 0 for M in t["M_hi"] for row in M for x in row):
        signed(push, cert)
    spread = {f"P_{s}": [cert[f"P_{s}"][q] for q in at] for s, _ in SIDES if f"P_{s}" in cert}
    plain.check_claims([given[q] for q in at], t | grown, cert | spread, push, theta2)


def check_source(text, t):
    """The C holds the constants of the tables, slopes and radii among them."""
    v = {k: x for k, x in t["vary"].items() if isinstance(x, list) and k not in ("columns", "products", "paced")}
    v |= {k: x for k, x in t.get("change", {}).items() if k != "box"}
    plain.check_source(text, t | {"M_hi": [t["M_hi"], *v.values()], "half": [0.5] * t["vary"]["midpoint"]})


def main(folder, design, record):
    """Check a folder."""
    given, boxes, signals, h, late = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        check_framers(t, cert, given, boxes, signals, h, late, design["family"] == "tnl")
        print(f"proved for {real}: containment with rounding{', of the continuous plant at its samples' if h else ''}, "
              f"for every parameter in its box, {cert['kind']} claim")
    check_source((folder / f"{record['prefix']}.c").read_text(), design["tables"][record["real"]])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
