"""The C of a polytopic observer against its tables, term by term.

Standard library only, nothing of residua imported; see ``independent_polytopic.py``. The sums are read back to the
matrices that they are made of, the program of the weights operation by operation.
"""

import re
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact  # noqa: E402 - stands beside this file
from independent_source import TABLE, flat, functions, numbers  # noqa: E402

TERM = re.compile(r" ?([+-]?) ?(?:\(([\d.e+-]+)F? \* ([\w.\[\]]+)\)|\((h\[\d+\] \* v\[\d+\])\)|([\w.\[\]]+))")


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


def check_solved(body, t, z, u):
    """What solves the algebraic equations: the weights of its vertices, then its sums."""
    real = t["real"]
    if any(d != 1 for d in t["pivot"]):
        found, count = re.sub(r"[\s()]", "", body), len(t["pivot"])
        total = "+".join(f"g[{j}]" for j in range(count))
        given = [re.search(rf";g\[{j}\]=h\[{j}\](?:\*([\d.e-]+F?))?;", found) for j in range(count)]
        demand(all(given) and [numbers(m[1], real)[0] if m[1] else F(1) for m in given] == exact(t["pivot"]),
               "factors of the solved equations")
        guard = re.search(re.escape(f";pivot={total};pivot=pivot>") + r"([\d.e-]+F?)\?pivot:\1;", found)
        demand(guard and numbers(guard[1], real) == [F(min(t["pivot"])) / 2], "sum of the factors")
        demand(all(f";g[{j}]=g[{j}]/pivot;" in found for j in range(count)), "weights of the solved equations")
        used = re.findall(r"\(g\[\d+\] \* v", body)
        demand("(h[" not in body and found.count("g[") == 4 * count + 1 + len(used), "other weights")
        body = re.sub(r"\n *g\[[^;]*;", "", body).replace("(g[", "(h[")
    demand(re.findall(r"_weights\((?:in, )?(.*?)\);", body) == ["s->z, h"], "weights at z")
    n, solved = len(t["z0"]), {k: row for row, k in enumerate(t["algebraic"])}

    def whole(M, others):
        return [M[solved[i]] if i in solved else others[i] for i in range(n)]

    of_z = [whole(P, [[float(i == k) for k in range(n)] for i in range(n)]) for P in t["P"]]
    of_u = [whole(Q, [[0.0] * len(u)] * n) for Q in t["Q"]]
    check_blend(body, real, "x_hat", ((of_z, z, 1), (of_u, u, 1)))


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

    terms = [f"h[{len(t['F']) + k}]" for k in range(len(t.get("known", [[]])[0]))]
    told = [([t["known"]] * len(t["F"]), terms, 1)] if terms else []

    def body(name):
        return functions(text, prefix, name)

    if "pivot" in t:
        check_solved(body("estimate"), t, z, u)
    else:
        check_rows(body("estimate"), real, "x_hat", z, t["T2"], y)
    check_rows(body("residual"), real, "r", y, t["C"], hat, -1)
    check_rows(body("step"), real, "out.r", [""] * p, t["M"], r)
    check_blend(body("move"), real, "s.z", ((t["F"], hat, 1), (t["G"], u, 1), (t["K"], r, -1), *told))
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
    known |= {F(0), F(1)} | ({F(law["period"])} if law else set()) | {F(d) / 2 for d in t.get("pivot", [])}
    demand({abs(x) for x in numbers(text, real)} <= known, "the C holds a number that no table does")
