"""Independent checker of a design: ``python independent.py DIR``, standard library only, nothing of residua imported.

From the plant text, the tables and every literal of the C it proves again, in exact fractions, what the certificate
claims, or names the first condition that fails (status 1). Others are handed over (BESIDE). With T = I - N C:
    (T A - L C - M) x + (T B - L D - G) u + T Bw w - L Dv v - N Dv v+  +  rounding of inputs and sums  <=  d_hi

for all x in [-box, box], u, w, v in range; mirrored for d_lo. A product or sum is off by u |value| + tiny.
"""

import ast
import json
import re
import struct
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

UNIT = {"float32": (F(1, 2**24), F(1, 2**126)), "float64": (F(1, 2**53), F(1, 2**1022))}
SIDES = (("hi", 1), ("lo", -1))
BESIDE = dict(members="bank", vary="lpv", shape="sets", lost="filter", square="follower", z_limit="sliding",
              told="driven", birth="births", pivot="descriptor", faults="faults", z_mid="polytopic")


def demand(condition, text):
    """Refuse unless the condition holds."""
    if not condition:
        sys.exit(f"refused: {text}")


def number(entry, names):
    """A matrix entry: a number, or an arithmetic expression of constants, rounded once to float64."""
    def walk(node):
        if isinstance(node, ast.Constant | ast.Name):
            return F(str(node.value)) if isinstance(node, ast.Constant) else names[node.id]
        if isinstance(node, ast.UnaryOp):
            return walk(node.operand) * (-1 if isinstance(node.op, ast.USub) else 1)
        a, b = walk(node.left), walk(node.right)
        return {ast.Add: lambda: a + b, ast.Sub: lambda: a - b, ast.Mult: lambda: a * b, ast.Div: lambda: a / b,
                ast.Pow: lambda: a ** int(b)}[type(node.op)]()
    return F(float(walk(ast.parse(entry, mode="eval").body) if isinstance(entry, str) else entry))


def read_plant(text):
    """Modes as dicts of exact matrices and bounds."""
    p = tomllib.loads(text)
    names = {k: F(float(v)) for k, v in p.get("constants", {}).items()}
    count = {k: len(p["signals"].get(k, [])) for k in "xuywv"}
    shape = {"A": "xx", "B": "xu", "C": "yx", "D": "yu", "Bw": "xw", "Dv": "yv"}
    modes = []
    for given in p.get("mode", [{"name": "only"}]):
        mode = {"name": given["name"]}
        for key, (r, c) in shape.items():
            rows = given.get(key, p.get("common", {}).get(key, [[0] * count[c]] * count[r]))
            mode[key] = [[number(e, names) for e in row] for row in rows]
        for k in "wv":
            mode[k] = [tuple(F(float(b)) for b in given.get("bounds", {}).get(s["name"], s["bounds"]))
                       for s in p["signals"].get(k, [])]
        modes.append(mode)
    return modes, [s["range"] for s in p["signals"]["x"]], list(zip(p["initial"]["x_lo"], p["initial"]["x_hi"]))


def exact(value):
    """Floats to fractions, in lists of lists."""
    return [exact(v) for v in value] if isinstance(value, list) else F(value)


def mul(A, B):
    """Matrix product; B may have no columns."""
    return [[sum((a * B[k][j] for k, a in enumerate(row)), F(0)) for j in range(len(B[0]) if B else 0)] for row in A]


def sub(A, B):
    """Matrix difference."""
    return [[a - b for a, b in zip(r, s)] for r, s in zip(A, B)]


def sup(row, bounds, sign=1):
    """Largest sign * row @ x over a box."""
    return sum((max(sign * a * lo, sign * a * hi) for a, (lo, hi) in zip(row, bounds)), F(0))


def size(row, magnitudes, other=()):
    """Sum of |row - other| times magnitudes."""
    return sum((abs(a - (other[k] if other else 0)) * m for k, (a, m) in enumerate(zip(row, magnitudes))), F(0))


def rounding(terms, real):
    """Error and magnitude of a sum of (coefficient, bound) in order; coefficient 1 is an addition only."""
    (u, tiny), total, error = UNIT[real], F(0), F(0)
    for n, (c, bound) in enumerate(t for t in terms if t[0] * t[1] != 0):
        value = abs(c * bound)
        slip = tiny if abs(c) == 1 else u * value + tiny
        slip += (u * (total + value + slip) + tiny) if n else 0
        total, error = total + value + slip, error + slip
    return error, total


def positive(S):
    """Positive definiteness by elimination."""
    S = [row[:] for row in S]
    for k in range(len(S)):
        if S[k][k] <= 0:
            return False
        for i in range(k + 1, len(S)):
            f = S[i][k] / S[k][k]
            S[i] = [a - f * b for a, b in zip(S[i], S[k])] if f else S[i]
    return True


def check_tables(modes, t, ranges, box0):
    """Containment and boundedness; returns per side the growth of error and width per mode, and theta^2."""
    real, n = t["real"], len(t["box"])
    x, u, y = exact(t["box"]), *([max(abs(F(a)), abs(F(b))) for a, b in zip(t[k + "_lo"], t[k + "_hi"])] for k in "uy")
    u_slip, y_slip = ([UNIT[real][0] * v + UNIT[real][1] for v in m] for m in (u, y))  # the caller's rounding
    u_true = [a + b for a, b in zip(u, u_slip)]

    def covered(name, q, i, need, before, after):
        """The outward offset, the error and the magnitude of its sum; refuses where it is too small."""
        value = F(t[name][q][i]) * (1 if name.endswith("hi") else -1)
        error, most = rounding([*before, (F(1), value), *after], real)
        lack = need + error - value
        demand(lack <= 0, f"offset {name}[{i}] of mode {modes[q]['name']} lacks {float(lack):.3g}")
        return value, error, most

    for name, given in (("x", ranges), ("x0", box0)):
        for lo, hi, (a, b), z in zip(t[name + "_lo"], t[name + "_hi"], given, t["box"]):
            demand(F(lo) <= F(float(a)) and F(hi) >= F(float(b)) and max(-lo, hi) <= z, f"box {name} too small")
    push, theta2 = {"hi": [], "lo": [], "width": []}, F(0)
    noise2 = [sum((max(sup(r, p["v"]), sup(r, p["v"], -1)) ** 2 for r in p["Dv"]), F(0)) for p in modes]
    for q, p in enumerate(modes):
        width = [F(a) - F(b) for a, b in zip(t["d_hi"][q], t["d_lo"][q])]
        A, B, C, D = (exact(t[k][q]) for k in "ABCD")
        for side, s in SIDES:
            M, G, L, N = (exact(t[k + side][q]) for k in ("M_", "G_", "L_", "N_"))
            T = sub([[F(i == j) for j in range(n)] for i in range(n)], mul(N, p["C"]))
            EM, EG = sub(sub(mul(T, p["A"]), mul(L, p["C"])), M), sub(sub(mul(T, p["B"]), mul(L, p["D"])), G)
            TBw, LDv, NDv = mul(T, p["Bw"]), mul(L, p["Dv"]), [(mul(N, m["Dv"]), m["v"]) for m in modes]
            grow, slack2 = [], F(0)
            for i in range(n):
                demand(min(M[i]) >= 0, f"T A - L C < 0 in mode {p['name']}, {side}, row {i}")
                noise = sup(LDv[i], p["v"], -s) + max(sup(m[i], b, -s) for m, b in NDv)
                known = noise + sup(TBw[i], p["w"], s)
                need = known + size(EM[i], x) + size(EG[i], u_true) + size(G[i], u_slip) + size(L[i] + N[i], y_slip * 2)
                d, error, most = covered("d_" + side, q, i, need, [*zip(G[i], u), *zip(L[i], y), *zip(N[i], y)],
                                         list(zip(M[i], x)))
                demand(t["clamp"] or most <= x[i], f"the framer can leave the state box: mode {p['name']}, {side}, {i}")
                slack = 2 * d - known + sup(TBw[i], p["w"], -s)
                slack2 += max(slack, abs(noise)) ** 2
                grow.append(slack + sup(LDv[i], p["v"], s) + max(sup(m[i], b, s) for m, b in NDv))
                width[i] += error
                need = sup(p["Bw"][i], p["w"], s) + size(p["A"][i], x, A[i]) + size(p["B"][i], u_true, B[i])
                covered("a_" + side, q, i, need + size(B[i], u_slip), zip(B[i], u), zip(A[i], x))
            push[side].append(grow)
            tnl = any(any(map(any, t["N_" + k][r])) for k, _ in SIDES for r in range(len(modes)))
            theta2 = max(theta2, slack2 + noise2[q] + (max(noise2) if tnl else 0))
            for j in range(len(C)):
                need = sup(p["Dv"][j], p["v"], s) + size(p["C"][j], x, C[j]) + size(p["D"][j], u_true, D[j])
                covered("c_" + side, q, j, need + size(D[j], u_slip) + y_slip[j], zip(D[j], u), zip(C[j], x))
        push["width"].append(width)
    return push, theta2


def check_claims(modes, t, cert, push, theta2):
    """The criterion and the ultimate boxes."""
    same = all(t[k + "hi"] == t[k + "lo"] for k in ("M_", "G_", "L_", "N_"))
    for side, z in (cert.get("steady_box") or {}).items():
        demand(side != "width" or same, "a width box needs equal gains")
        for q, M in enumerate(exact(t["M_" + ("hi" if side == "width" else side)])):
            for i, stay in enumerate(sum(m * F(b) for m, b in zip(row, z)) for row in M):
                demand(stay < F(z[i]) and stay + push[side][q][i] <= F(z[i]), f"ultimate box {side}, state {i}")
    if cert["kind"] == "width":
        p, a = exact(cert["p"]), F(cert["a"])
        for q in range(len(modes)):
            demand(0 < a < 1 and min(p) > 0, "copositive data")
            for M in (exact(t["M_" + side][q]) for side in ("hi", "lo")):
                demand(all(total <= (1 - a) * x for total, x in zip(mul([p], M)[0], p)), f"p' M, mode {q}")
            grown = sum(x * b for s in (["width"] if same else ["hi", "lo"]) for x, b in zip(p, push[s][q]))
            demand(F(cert["level"]) * a >= grown, "width level")
    if cert["kind"] == "linf":
        check_lyapunov(modes, t, cert, theta2)


def check_lyapunov(modes, t, cert, theta2):
    """The matrix inequality for each mode and side, jump factor, dwell time and level."""
    lam, mu, rho, n = F(cert["lam"]), F(cert["mu"]), F(cert["rho"]), len(t["box"])
    for side, _ in SIDES:
        P = exact(cert["P_" + side])
        demand(min(min(p) for p in P) >= 1 and 0 < lam < 1, "P >= I, 0 < lambda < 1")
        demand(all(a <= rho * b for p in P for r in P for a, b in zip(p, r)), "jump factor")
        for q, (M, L, N) in enumerate(zip(*(exact(t[k + side]) for k in ("M_", "L_", "N_")))):
            H = [[F(i == j) for j in range(n)] + L[i] + (N[i] if any(map(any, N)) else []) for i in range(n)]
            k = len(H[0])
            top = [[(1 - lam) * P[q][i] * (i == j) for j in range(n)] + [F(0)] * k
                   + [P[q][j] * M[j][i] for j in range(n)] for i in range(n)]
            mid = [[F(0)] * n + [mu * (i == j) for j in range(k)] + [a * h[i] for a, h in zip(P[q], H)]
                   for i in range(k)]
            low = [[P[q][i] * M[i][j] for j in range(n)] + [P[q][i] * h for h in H[i]]
                   + [P[q][i] * (i == j) for j in range(n)] for i in range(n)]
            demand(positive(top + mid + low), f"Lyapunov inequality, mode {q}, {side}")
    add, drain, factor = cert["dwell_add"], cert["dwell_drain"], 1 / lam
    if rho > 1:  # V+ <= (1 - lam) V + c^2, at most N0 + s/tau jumps by rho in s samples
        demand((1 - lam) ** add * rho ** drain < 1, "dwell time")
        n0 = F(-((-F(cert["chatter"]) * 64) // 1), 64)
        power = n0 + F(drain, add)
        factor = root(rho, power.numerator, power.denominator) / (1 - (1 - lam) * root(rho, drain, add))
    demand(F(cert["level"]) ** 2 >= factor * mu * theta2, "L-infinity level")


def root(base, power, degree):
    """A fraction just above base^(power/degree)."""
    guess = F(float(base) ** (power / degree))
    while guess ** degree < base ** power:
        guess += guess / 2**52
    return guess


def check_source(text, t):
    """Every real literal of the C is a number of the tables; every gain and offset of the tables is in the C."""
    kind, end = ("f", "F") if t["real"] == "float32" else ("d", "")
    found = re.findall(r"(?<![\w.])(\d+\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+)" + end + r"(?![\w.])", text)
    found = {F(struct.unpack(kind, struct.pack(kind, float(m)))[0]) for m in found}

    def flat(value):
        return set().union(*map(flat, value)) if isinstance(value, list) else {abs(F(value))}

    tables = {k: flat(v) for k, v in t.items() if isinstance(v, list)}
    foreign = found - {F(0), F(1)}.union(*tables.values())
    demand(not foreign, f"the C holds {[float(x) for x in sorted(foreign)][:3]}, no table does")
    needed = set().union(*(tables[k + s] for k in ("M_", "L_", "N_", "G_", "d_") for s, _ in SIDES)) - {F(0), F(1)}
    demand(needed <= found, "a constant of the tables is missing in the C")


def main(folder):
    """Check a folder."""
    design, record = (json.loads((folder / f"{name}.json").read_text()) for name in ("design", "resources"))
    for other in (name for key, name in BESIDE.items() if any(key in t for t in design["tables"].values())):
        sys.path.append(str(Path(__file__).parent))  # beside this file
        sys.exit(__import__(f"independent_{other}").main(folder, design, record))
    modes, ranges, box0 = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        check_claims(modes, t, design["certificate"][real], *check_tables(modes, t, ranges, box0))
        print(f"proved for {real}: containment with rounding, boundedness, {design['certificate'][real]['kind']} claim")
    check_source((folder / f"{record['prefix']}.c").read_text(), design["tables"][record["real"]])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
