"""The C of a polytopic observer against its tables, term by term; its weights are in [0, 1] and add up to 1.

Standard library only, nothing of residua imported; see ``independent_polytopic.py``. The sums are read back to the
matrices that they are made of. Weights that are no tree of products are not known here: status 2.
"""

import re
import struct
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact  # noqa: E402 - stands beside this file
from independent_sector import unknown  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402

TERM = re.compile(r" ?([+-]?) ?(?:\(([\d.e+-]+)F? \* ([\w.\[\]]+)\)|\((h\[\d+\] \* v\[\d+\])\)|([\w.\[\]]+))")
INF = float("inf")


def rounded(value, real):
    """The nearest number of the type; products and sums of two numbers of it are rounded once by that."""
    try:
        return struct.unpack("f", struct.pack("f", value))[0] if real == "float32" and abs(value) < INF else value
    except OverflowError:
        return INF if value > 0 else -INF


def check_weights(t, inputs):
    """Every weight in [0, 1], whatever the estimate; their sum 1 but for a rounding per level of the tree.

    Weights that are normalised are looked at by the C itself, and all the same where it finds them wrong. Returned are
    the shares that the others are products of, the first premise first.
    """
    w, real = t["weights"], t["real"]
    first = w["inputs"] + len(w["constants"])
    nodes = {first + k: op for k, op in enumerate(w["operations"])}
    ends = {k: (-INF, INF) for k in range(inputs)} | {inputs + k: (c, c) for k, c in enumerate(w["constants"])}
    demand(w["inputs"] == inputs, "inputs of the weights")

    def between(k):
        if k not in ends:
            ends[k] = found(nodes[k])
        return ends[k]

    def found(op):
        name, *args = op
        if name == "select":
            truth = nodes[args[0]]
            if truth == ["gt", *args[1:]]:  # the larger of both, the second where the first is no number
                (a, b), (c, d) = map(between, args[1:])
                return max(a, c), max(b, d)
            return -INF, INF
        if name not in ("add", "sub", "mul", "min", "neg"):
            return -INF, INF
        (a, b), (c, d) = (*map(between, args), (0.0, 0.0))[:2]
        if name == "min":
            return min(a, c), min(b, d)
        if name == "neg":
            return -b, -a
        if name == "mul":
            values = [0.0 if 0.0 in (x, y) else x * y for x in (a, b) for y in (c, d)]
            return rounded(min(values), real), rounded(max(values), real)
        part = nodes.get(args[1], [""])
        if name == "sub" and part[0] == "mul" and args[0] in part[1:]:  # w - w mu
            mu = between(part[1] if part[2] == args[0] else part[2])
            if a >= 0 and mu[0] >= 0 and mu[1] <= 1:
                return 0.0, b
        return (rounded(a - d, real), rounded(b - c, real)) if name == "sub" else (
            rounded(a + c, real), rounded(b + d, real))

    def partition(h):
        """Weights of a tree: the share of every level, by which it splits all weights before it."""
        half = len(h) // 2
        if len(h) == 1:
            unknown(w["constants"][h[0] - inputs] != 1 if inputs <= h[0] < first else True)
            return []
        unknown(len(h) % 2)
        lower, upper = h[:half], h[half:]
        before = [nodes.get(k, ["", "", ""])[1] for k in lower]
        mu = {upper[0]} if half == 1 else {next((a for a in nodes[u][1:] if a != b), None) if u in nodes else None
                                           for u, b in zip(upper, before)}
        unknown(len(mu) != 1 or any(nodes.get(k) != ["sub", b, u] for k, b, u in zip(lower, before, upper)))
        demand(half == 1 or all(nodes[u][0] == "mul" and b in nodes[u][1:] for u, b in zip(upper, before)),
               "weights that are products")
        return [*partition(before), *mu]

    given = [nodes.get(k, [""]) for k in w["results"][:-1]]
    if all(op[0] == "select" for op in given):
        check_found(given, nodes, dict(enumerate(w["constants"], inputs)), t)
        return None
    shares = partition(w["results"][:-1])
    for k in w["results"][:-1]:
        a, b = between(k)
        demand(a >= 0 and b <= 1, "weights between 0 and 1")
    demand(2 * len(shares) * UNIT[real][0] <= (8 * len(t["F"]) + 4) * 2 * UNIT[real][0], "sum of the weights")
    demand(len(w["results"]) - 1 == len(t["F"]), "a weight for each vertex")
    return shares


def check_found(given, nodes, constants, t):
    """Weights that are chosen where the C finds them to be numbers in [0, 1] that add up to 1; else they are equal."""
    eps, count = 2 * UNIT[t["real"]][0], len(t["F"])
    truths, todo = [], [given[0][1]]
    while todo:
        op = nodes[todo.pop()]
        todo += op[1:] if op[0] == "and" else []
        truths.append(op)
    weights = [op[2] for op in given]
    demand(len(given) == count and all(op[1] == given[0][1] for op in given), "a weight for each vertex, one choice")
    total = weights[0]
    for k in weights[1:]:
        total = next((n for n, op in nodes.items() if op == ["add", total, k]), None)
    for k, least, most in (*((k, 0, 1 + 4 * eps) for k in weights), (total, 1 - 4 * count * eps, 1 + 4 * count * eps)):
        lo, hi = ([F(constants[op[2]]) for op in truths if op[0] == name and op[1] == k and op[2] in constants]
                  for name in ("ge", "le"))
        demand(lo and hi and max(lo) >= least - eps and min(hi) <= most + eps, "what the C asks of its weights")
    demand(all(abs(F(constants[op[3]]) * count - 1) <= eps for op in given), "equal weights")


def statements(text, real):
    """Assignments to elements of vectors, in their order: (vector, index, {operand: coefficient})."""
    text = re.sub(r"\s+", " ", text.replace("->", "."))
    for vector, index, given in re.findall(r"[ ;{}]([\w.]+)\[(\d+)\] = ([^;]*);", text):
        end, row = 0, {}
        while end < len(given):
            m = TERM.match(given, end)
            demand(m, f"a sum of the C cannot be read: {given[end:end + 40]}")
            end, sign = m.end(), -1 if m[1] == "-" else 1
            name = m[3] or m[4] or m[5]
            demand(name not in row, f"{name} twice in a sum of the C")
            if m[2]:
                row[name] = sign * numbers(m[2] + "F" * (real == "float32"), real)[0]
            elif re.fullmatch(r"[\d.e-]+F?", name):
                row[""] = sign * numbers(name, real)[0]
            else:
                row[name] = F(sign)
        yield vector, int(index), {k: c for k, c in row.items() if c}


def matrix(rows, operands, sign=1):
    """The coefficients of some operands, taken out of rows."""
    return [[sign * row.pop(name, F(0)) for name in operands] for row in rows]


def check_rows(body, real, target, first, given, operands, sign=1):
    """A vector of sums: one operand each, and a matrix times others."""
    rows = [row for vector, _, row in statements(body, real) if vector == target]
    for row, name in zip(rows, first):
        demand(row.pop(name, 0) == 1 if name else True, f"{name} in {target}")
    demand(matrix(rows, operands, sign) == exact(given) and not any(rows), f"the matrix of {target}")


def check_blend(body, real, target, parts):
    """Sums of weights times what each vertex says; ``parts`` are (tables, operands, sign)."""
    own, rows = {}, []
    for vector, index, row in statements(body, real):
        if vector == "v":
            own[index] = row
        elif vector == target:
            demand(index == len(rows) and all(row.pop(f"h[{j}] * v[{j}]", 0) == 1 for j in own), f"weights of {target}")
            rows.append((row, own))
            own = {}
    for given, operands, sign in parts:
        for j, M in enumerate(exact(given)):
            demand(len(rows) == len(M), f"rows of {target}")
            for (shared, some), wanted in zip(rows, M):
                found = [sign * (shared.get(name, F(0)) + some.get(j, {}).get(name, F(0))) for name in operands]
                demand(found == wanted, f"a coefficient of vertex {j} in {target}")
                demand(not any(name in shared and name in v for v in some.values() for name in operands), "twice")
    known = {name for _, operands, _ in parts for name in operands}
    demand(all(set(r) <= known for shared, own in rows for r in (shared, *own.values())), f"operands of {target}")


def check_program(body, t):
    """The operations of the weights in the C, one by one, are those that were looked at."""
    w, real, n, m = t["weights"], t["real"], len(t["T2"]), len(t["u_lo"])
    first = w["inputs"] + len(w["constants"])

    def name(k):
        if k < w["inputs"]:
            return f"x_hat[{k}]" if k < n else f"in.u[{k - n}]" if k < n + m else f"in.theta[{k - n - m}]"
        return f"t{k - first}" if k >= first else f"<{F(w['constants'][k - w['inputs']])}>"

    def known(piece):
        end = "F" if real == "float32" else ""
        piece = re.sub(rf"\(?(-?(?<![\w.\[])(?:\d+\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+){end}(?![\w.]))\)?", lambda m: (
            f"<{numbers(m[1], real)[0]}>"), piece)
        return re.sub(r"[\s()]", "", piece.replace("->", "."))

    signs = {"add": "+", "sub": "-", "mul": "*", "ge": ">=", "le": "<=", "gt": ">", "and": "&&"}
    wanted = []
    for op, *args in w["operations"]:
        a, b, c = (*map(name, args), "", "")[:3]
        forms = {"select": f"{a}?{b}:{c}", "min": f"{a}<{b}?{a}:{b}", "max": f"{a}>{b}?{a}:{b}", "neg": f"-{a}",
                 "div": f"{b}><0>||{b}<<0>?{a}/{b}:", "abs": f"{a}<<0>?-{a}:{a}"}
        wanted.append(f"{a}{signs[op]}{b}" if op in signs else forms.get(op, f"{op}{'f' * (real == 'float32')}{a}"
                                                                       + f",{b}" * (len(args) == 2)))
    found = [known(e) for e in re.findall(r"const \w+ t\d+ = ([^;]*);", body)]
    found = [re.sub(r"(?<=:)(?:FLT|DBL)_MAX$", "", e) for e in found]
    demand(re.findall(r"const \w+ t(\d+) =", body) == [str(k) for k in range(len(wanted))] and found == wanted,
           "an operation of the weights in the C is another one")
    results = [known(e) for e in re.findall(r"(?:h\[\d+\]|inside) = ([^;]*);", body)]
    demand(results == [name(k) for k in w["results"]], "what the weights of the C are")


def check_source(text, header, t, prefix):
    """Every sum, table, number and count of the C is the design's."""
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    n, p, m = len(t["T2"]), len(t["C"]), len(t["u_lo"])
    z, y, hat, r, u = ([f"{name}[{k}]" for k in range(count)] for name, count in (
        ("s.z", n), ("y", p), ("x_hat", n), ("r", p), ("in.u", m)))

    def body(name):
        return functions(text, prefix, name)

    check_rows(body("estimate"), real, "x_hat", z, t["T2"], y)
    check_rows(body("residual"), real, "r", y, t["C"], hat, -1)
    check_rows(body("step"), real, "out.r", [""] * p, t["M"], r)
    check_blend(body("move"), real, "s.z", ((t["F"], hat, 1), (t["G"], u, 1), (t["K"], r, -1)))
    law = t.get("law", {})
    if law:
        s = [f"law.s[{k}]" for k in range(len(law["rows"]))]
        check_blend(body("command"), real, "in.u", ((law["Kx"], hat, 1), (law["Ki"], s, 1)))
    for name, start, vectors in (("init", t["start"] << t["shift"], ("z0", "y0")),
                                 ("whole_range", 0, ("z_mid", "y_mid"))):
        for target, values in zip(("s.z", "s.y"), vectors):
            rows = [row for vector, _, row in statements(body(name), real) if vector == target]
            demand([row.get("", F(0)) for row in rows] == exact(t[values]), f"{values} of {name}")
        demand(re.findall(r"since = (\w+);", body(name)) == [f"{start}U"], f"row that {name} begins with")
    tables = {"outside": ["h"], "move": ["z_lo", "z_hi"]} | ({"command": ["u_lo", "u_hi"]} if law else {})
    for name, fields in tables.items():
        found = [numbers(part, real) for part in re.findall(TABLE, body(name), re.S)]
        demand(found == [flat(t[k]) for k in fields], f"the tables of {name}")
    counts = {"LAST": (len(t["h"]) - 1) << t["shift"], "ROWS": len(t["h"])}
    for name, value in counts.items():
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(value)], f"macro {name}")
    shifts = re.findall(r"since >> (\d+)U", text)
    demand(shifts == [str(t["shift"])] if t["shift"] else not shifts, "samples per row")
    accepted = numbers(body("[uy]_accepted"), real)
    ranges = flat([t[k] for k in ("u_lo", "u_hi", "y_lo", "y_hi")])
    demand(sorted(accepted) == sorted(ranges), "ranges that are accepted")
    check_program(body("weights"), t)
    program = {abs(F(c)) for c in t["weights"]["constants"]}
    known = {abs(x) for v in [*t.values(), *law.values()] if isinstance(v, list) for x in flat(v)} | program
    known |= {F(0), F(1)} | ({F(law["period"])} if law else set())
    demand({abs(x) for x in numbers(text, real)} <= known, "the C holds a number that no table does")
