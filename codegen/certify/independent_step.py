"""One step of a plant with parameters, unknowns or continuous time, enclosed: what ``independent_lpv.py`` rests on.

Standard library only, nothing of residua imported; exact fractions. With z = [x; u], the measured p (theta less its
middle; of a sampled plant the mean of both ends, or the one at the start) and everything unknown in D, a step is
z+ = Phi z + W. Discrete: Phi = A + sum p_j A_j + D. Continuous, with F = [A, B] and period h:

    Phi = sum_k h^k/k! (words of k factors, each Fc, p_j F_j or D),      W = int Phi Bw w ds + effect of moving u

Words without D are a polynomial of p: degrees 0, 1 and 2 are kept, the rest is bounded by magnitude. D alone counts by
its mean over the period, longer words with D by magnitude, words of more than ORDER factors by a geometric series. In W
a mean w goes through int e^(A s) Bw ds, what swings about it through the magnitude of the rest.
"""

import ast
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from math import ceil, factorial
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, mul, size, sub, sup  # noqa: E402 - stands beside this file

ORDER = 16
FINE = F(1, 2**256)


def entry(text, names, thetas):
    """Constant and slopes of a matrix entry, each rounded once to float64."""
    def walk(node):
        if isinstance(node, ast.Constant):
            return {"": F(str(node.value))}
        if isinstance(node, ast.Name):
            return {"": names[node.id]} if node.id in names else {node.id: F(1)}
        if isinstance(node, ast.UnaryOp):
            return {k: -v if isinstance(node.op, ast.USub) else v for k, v in walk(node.operand).items()}
        a, b = walk(node.left), walk(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = 1 if isinstance(node.op, ast.Add) else -1
            return {k: a.get(k, 0) + sign * b.get(k, 0) for k in {**a, **b}}
        a, b = (b, a) if isinstance(node.op, ast.Mult) and set(b) - {""} else (a, b)
        demand(set(b) <= {""}, f"entry {text} is not affine")
        if isinstance(node.op, ast.Pow):
            return {"": a[""] ** int(b[""])}
        return {k: v * b[""] if isinstance(node.op, ast.Mult) else v / b[""] for k, v in a.items()}
    found = walk(ast.parse(text, mode="eval").body) if isinstance(text, str) else {"": F(text)}
    return [F(float(found.get(k, 0))) for k in ("", *thetas)]


def read_plant(text):
    """The plant: modes with [A, B] and its slopes, output, bounds, box of every theta."""
    p = tomllib.loads(text)
    names = {k: F(repr(float(v))) for k, v in p.get("constants", {}).items()}
    signals = {k: p["signals"].get(k, []) for k in ("x", "u", "y", "w", "v", "theta")}
    thetas, modes = [s["name"] for s in signals["theta"]], []
    for given in p.get("mode", [{"name": "only"}]):
        def matrix(key, r, c, given=given):
            rows = given.get(key, p.get("common", {}).get(key, [[0] * len(signals[c])] * len(signals[r])))
            parts = [[entry(e, names, thetas) for e in row] for row in rows]
            return [[[e[k] for e in row] for row in parts] for k in range(1 + len(thetas))]

        def join(left, right):
            return [[a + b for a, b in zip(*rows)] for rows in zip(left, right)]
        mode = {"name": given["name"], "F": join(matrix("A", "x", "x"), matrix("B", "x", "u"))}
        for key, r, c in (("C", "y", "x"), ("D", "y", "u"), ("Bw", "x", "w"), ("Dv", "y", "v")):
            mode[key], *slopes = matrix(key, r, c)
            demand(not any(e for slope in slopes for row in slope for e in row), f"{key} depends on a parameter")
        mode["CD"] = join([mode["C"]], [mode["D"]])[0]
        for k in ("w", "v", "theta"):
            bounds = [given.get("bounds", {}).get(s["name"], s.get("bounds")) for s in signals[k]]
            mode[k] = [(F(float(a)), F(float(b))) for a, b in bounds]
        modes.append(mode)
    boxes = {"x": [s["range"] for s in signals["x"]], "x0": list(zip(p["initial"]["x_lo"], p["initial"]["x_hi"]))}
    h = F(float(p["time"]["sample_period"])) if p["time"]["kind"] == "continuous" else None
    return modes, boxes, signals, h, p.get("switching", {}).get("late", False)


def add(*matrices):
    """Sum of matrices."""
    return [[sum(row, F(0)) for row in zip(*rows)] for rows in zip(*matrices)]


def times(c, A):
    """Matrix times a number."""
    return [[c * a for a in row] for row in A]


def mag(A):
    """Magnitude of every entry."""
    return times(1, [[abs(a) for a in row] for row in A])


def then(X, A):
    """X [A; 0]: one more factor F (n rows) behind a word (n rows)."""
    return mul([row[:len(A)] for row in X], A)


def tail(A, h, order):
    """Bound on every entry of sum_{k > order} h^k/k! A^k."""
    step = h * max(sum(row, F(0)) for row in A)
    demand(step * 2 < order, "the sampling period is too long")
    return up(step ** (order + 1) / factorial(order + 1) / (1 - step / (order + 2)))


def up(x):
    """A fraction of moderate length just above."""
    return ceil(x / FINE) * FINE


def transition(mode, signals, h, both):
    """One step of a mode: "poly" (Phi by powers of p), "first" (|s| <= 1 each), "rest" and the effect "W" of w."""
    n, thetas = len(mode["F"][0]), signals["theta"]
    middle, half = ([(b + s * a) / 2 for a, b in mode["theta"]] for s in (1, -1))
    error = [F(float(s.get("error", 0))) for s in thetas]
    known = [j for j, s in enumerate(thetas) if s.get("measured", True)]
    Fc = add(mode["F"][0], *(times(m, Fj) for m, Fj in zip(middle, mode["F"][1:])))
    Fk = [mode["F"][1 + j] for j in known]
    z = {"middle": [middle[j] for j in known], "K": [half[j] + error[j] for j in known]}
    first = [times(error[j] if j in known else half[j], mode["F"][1 + j]) for j in range(len(thetas))]
    none = times(0, Fc)
    if h is None:
        return z | {"poly": {(): Fc} | {(j,): A for j, A in enumerate(Fk)}, "first": first, "rest": none,
                    "W": lambda T, s: [sup(row, mode["w"], s) for row in mul(T, mode["Bw"])]}
    far, mean, z["reach"] = [], [], []
    for j in known:
        width, moved = 2 * half[j], F(thetas[j]["rate"]) * h if "rate" in thetas[j] else 2 * half[j] * 4
        far.append(min(width, moved / (2 if both else 1)))
        mean.append(min(width, moved / (4 if both else 2)))
        z["reach"].append(moved if both and "rate" in thetas[j] and not error[j] and moved <= 4 * width else None)
    a, b = mag(Fc), add(none, *(times(k, mag(A)) for k, A in zip(z["K"], Fk)))
    d = add(none, *map(mag, first), *(times(f, mag(A)) for f, A in zip(far, Fk)))
    one = [[F(i == j) for j in range(len(none[0]))] for i in range(n)]
    words, poly, degree, unknown, whole, rest = {(): one}, {(): one}, [one, none, none, none], none, [one], none
    nominal = [one]
    for k in range(1, ORDER + 1):
        longer = {}
        for which, X in words.items():
            for new, A in [(which, Fc)] + [(tuple(sorted((*which, j))), A) for j, A in enumerate(Fk) if len(which) < 2]:
                longer[new] = add(longer.get(new, none), then(X, A))
        words, w = longer, h**k / factorial(k)
        poly = {new: add(poly.get(new, none), times(w, X)) for new, X in words.items()}
        unknown = add(then(unknown, add(a, b, d)), then(add(*degree), d))
        degree = [add(then(X, a), then(Y, b)) for X, Y in zip(degree, [none, *degree])][:3] + [
            add(then(degree[3], add(a, b)), then(degree[2], b))]
        rest = add(rest, times(w, add(degree[3], unknown if k > 1 else none)))
        whole.append(then(whole[-1], add(a, b, d)))
        nominal.append(words[()])
    end = tail(add(a, b, d), h, ORDER)
    trimmed = {new: [[F(round(x / FINE)) * FINE for x in row] for row in X] for new, X in poly.items()}
    slack = end + FINE * sum(k + l for k, l in product([F(1), *z["K"]], repeat=2))
    rest = [[up(x + slack) for x in row] for row in rest]
    first = [times(h, A) for A in first] + [times(m * h, A) for m, A in zip(mean, Fk)]
    return z | {"poly": trimmed, "first": first, "rest": rest,
                "W": disturbance(mode, signals, h, nominal, whole, end, [row[:n] for row in a], add(a, b, d))}


def disturbance(mode, signals, h, nominal, whole, end, a, most_F):
    """The largest effect of w, and of inputs that move, over a period: a function of T and the sign."""
    n, Bw, w = len(a), mode["Bw"], mode["w"]
    most, half = [max(abs(lo), abs(hi)) for lo, hi in w], [(hi - lo) / 2 for lo, hi in w]
    rates = [F(float(s.get("rate", 0))) for s in signals["u"]]
    effects = [then(X, Bw) for X in nominal]
    gain = add(*(times(h ** (k + 1) / factorial(k + 1), X) for k, X in enumerate(effects)))
    late, plain = tail(a, h, ORDER - 1), [[F(i == j) for j in range(n)] for i in range(n)]
    beyond = [end * h * size(map(sum, zip(*mag(Bw))), most) + late * h * h / 4 * sum(
        (size(row, half) for row in mul(a, mag(Bw))), F(0))] * n
    beyond = [x + end * h * h * sum((size(row[n:], rates) for row in most_F), F(0)) for x in beyond]
    for k in range(ORDER + 1):
        all_words, inputs = [row[:n] for row in whole[k]], [row[n:] for row in most_F]
        other = mul(sub(all_words, plain), mag(Bw))
        moving = mul(all_words, inputs)
        for i in range(n):
            beyond[i] += h ** (k + 1) / factorial(k + 1) * size(other[i], most)
            beyond[i] += h ** (k + 2) / factorial(k + 2) * size(moving[i], rates)
        plain = mul(plain, a)
    beyond = [up(x) for x in beyond]

    def effect(T, s):
        swing = [size(row, beyond) for row in T]
        for k in range(1, ORDER + 1):
            swing = [x + h ** (k + 1) / (4 * factorial(k - 1)) * size(row, half)
                     for x, row in zip(swing, mul(T, effects[k]))]
        return [sup(row, w, s) + x for row, x in zip(mul(T, gain), swing)]
    return effect


def left_over(T, z, target, box, drift, products=(), multiplied=()):
    """Bound on every entry of T Phi - (target_0 + sum theta_j target_j), theta in the box.

    Behind the parameters theta may hold their products, each off by ``multiplied`` at most.
    """
    poly, K, found = z["poly"], z["K"], {tuple(jk): A for jk, A in zip(products, target[1 + len(z["middle"]):])}
    target = target[:1 + len(z["middle"])]
    for (j, k), A in found.items():  # theta_j theta_k = p_j p_k + c_j theta_k + c_k theta_j - c_j c_k
        c, d = z["middle"][j], z["middle"][k]
        target[0] = add(target[0], times(-c * d, A))
        target[1 + k] = add(target[1 + k], times(c, A))
        target[1 + j] = add(target[1 + j], times(d, A))
    middle = sub(mul(T, poly[()]), target[0])
    out = add(mul(mag(T), z["rest"]), *(mag(mul(T, A)) for A in z["first"]))
    for j, ((lo, hi), c) in enumerate(zip(box, z["middle"])):
        TF = mul(T, poly[(j,)])
        slope = sub(TF, target[1 + j])
        middle = add(middle, times(-c, target[1 + j]), times((lo + hi) / 2 - c, slope))
        out = add(out, times((hi - lo) / 2, mag(slope)), times(drift[j], mag(TF)))
    for which, A in ((k, mul(T, A)) for k, A in poly.items() if len(k) == 2):
        i, j = which
        if which in found:  # computed: what is left of its coefficient, and the roundings of both factors and theirs
            at = [max(abs(a - c), abs(b - c)) for (a, b), c in zip(box, z["middle"])]
            slip = at[i] * drift[j] + at[j] * drift[i] + drift[i] * drift[j]
            out = add(out, times(at[i] * at[j], mag(sub(A, found[which]))), times(slip, mag(A)),
                      times(multiplied[[tuple(p) for p in products].index(which)], mag(found[which])))
            continue
        middle = add(middle, times(K[i] ** 2 / 2, A)) if i == j else middle
        out = add(out, times(K[i] * K[j] / (2 if i == j else 1), mag(A)))
    return add(out, mag(middle))


def pacing(v, z, most, both, u, tiny):
    """Parameters whose change over a step is used: the computed factor is never below 1 - (change / reach)^2."""
    for j, pace, top in zip(v.get("paced", []), v.get("pace", []), v.get("top", [])):
        reach, pace = z["reach"][j], F(pace)
        demand(both and reach is not None and reach * pace <= 1, f"the change of parameter {j} tells nothing")
        slip = 2 * (u * most[j] + tiny)
        slip += u * (reach + slip) + tiny
        scaled = (reach + slip) * pace * (1 + u) + tiny
        excess = scaled**2 * (1 + u) + tiny - (reach * pace) ** 2
        demand(F(top) >= 1 + excess + u * (2 + excess) + tiny, f"factor of parameter {j} may be too small")
    return v.get("paced", [])
