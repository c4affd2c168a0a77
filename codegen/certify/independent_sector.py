"""Polytopic plants from their file, read again: vertices, or equations as polynomials with their premises as sectors.

Standard library only, nothing of residua imported; exact fractions. A product of an equation goes to the column of a
state that is no premise, else of its first state, else of its first input, unless the file gives A and B. What varies
in an entry is a premise: those of the file first, then powers of one variable each. Vertices are the corners of their
bounds, the first premise turning fastest. Other equations than polynomials are not read: status 2.
"""

import ast
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand  # noqa: E402 - stands beside this file

SHAPES = {"E": "xx", "A": "xx", "B": "xu", "C": "yx", "Bw": "xw", "Dv": "yv"}


def unknown(condition):
    """Stop where the checker knows no such plant."""
    if condition:
        print("not checked: this checker does not know such a plant or observer", file=sys.stderr)
        sys.exit(2)


def times(a, b):
    """Product of polynomials: {exponents: coefficient}."""
    out = {}
    for (i, x), (j, y) in product(a.items(), b.items()):
        key = tuple(p + q for p, q in zip(i, j))
        out[key] = out.get(key, F(0)) + x * y
    return {k: c for k, c in out.items() if c}


def plus(a, b, sign=1):
    """Sum or difference of polynomials."""
    out = dict(a)
    for key, y in b.items():
        out[key] = out.get(key, F(0)) + sign * y
    return {k: c for k, c in out.items() if c}


def polynomial(text, names, constants):
    """An expression of a plant file as a polynomial of the variables."""
    one = (0,) * len(names)

    def walk(node):
        if isinstance(node, ast.Constant):
            return {one: F(str(node.value))} if node.value else {}
        if isinstance(node, ast.Name):
            unknown(node.id not in names and node.id not in constants)
            return {tuple(int(n == node.id) for n in names): F(1)} if node.id in names else {one: constants[node.id]}
        if isinstance(node, ast.UnaryOp):
            return plus({}, walk(node.operand), -1 if isinstance(node.op, ast.USub) else 1)
        unknown(not isinstance(node, ast.BinOp))
        a, b = walk(node.left), walk(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            return plus(a, b, 1 if isinstance(node.op, ast.Add) else -1)
        if isinstance(node.op, ast.Mult):
            return times(a, b)
        unknown(set(b) != {one})
        if isinstance(node.op, ast.Div):
            return {k: c / b[one] for k, c in a.items()}
        unknown(not isinstance(node.op, ast.Pow) or b[one].denominator != 1 or b[one] < 1)
        out = a
        for _ in range(int(b[one]) - 1):
            out = times(out, a)
        return out

    return walk(ast.parse(str(text), mode="eval").body)


def bounds(p, box):
    """Least and largest value of a polynomial over a box, monomial by monomial."""
    lo, hi = F(0), F(0)
    for key, c in p.items():
        least, most = F(1), F(1)
        for k, (a, b) in zip(key, box):
            ends = [a**k, b**k] + ([F(0)] if k and not k % 2 and a < 0 < b else [])
            ends = [x * y for x in (least, most) for y in (min(ends), max(ends))]
            least, most = min(ends), max(ends)
        lo, hi = lo + min(c * least, c * most), hi + max(c * least, c * most)
    return lo, hi


def read_plant(text):
    """E, C, Dv, vertices with A, B, Bw, ranges of the signals, initial box, period, and the bits that inputs tell."""
    p = tomllib.loads(text)
    signals = {k: p["signals"].get(k, []) for k in ("x", "u", "y", "w", "v", "theta")}
    constants = {k: F(repr(float(v))) for k, v in p.get("constants", {}).items()}
    names = [s["name"] for k in "xu" for s in signals[k]]
    common, own = p.get("common", {}), p.get("nonlinear", {})
    unknown(signals["theta"] or "point" in own or "known" in own)
    unknown(any(polynomial(e, [], constants) for row in common.get("D", []) for e in row))

    def matrix(key, given=None):
        r, c = (signals[v] for v in SHAPES[key])
        rows = given if given is not None else common.get(key, [
            [int(key == "E" and i == j) for j in range(len(c))] for i in range(len(r))])
        rows = [[polynomial(e, [], constants).get((), F(0)) for e in row] for row in rows]
        return [[F(float(e)) for e in row] for row in rows]

    box = [tuple(F(float(b)) for b in s["range"]) for k in "xu" for s in signals[k]]
    plant = {"E": matrix("E", own.get("E")), "C": matrix("C"), "Dv": matrix("Dv"), "tied": [], "period": (
        F(float(p["time"]["sample_period"])) if p["time"]["kind"] == "continuous" else None)}
    for k in "xuywv":
        plant[k] = [tuple(F(float(b)) for b in s["range" if k in "xuy" else "bounds"]) for s in signals[k]]
    plant["x0"] = [(F(float(a)), F(float(b))) for a, b in zip(p["initial"]["x_lo"], p["initial"]["x_hi"])]
    if p.get("vertex"):
        unknown(any(any(v.get("offset", [])) for v in p["vertex"]))
        plant["vertices"] = [{k: matrix(k, v.get(k)) for k in ("A", "B", "Bw")} for v in p["vertex"]]
        plant["premises"] = None
        return plant
    entries = factors(own, names, len(signals["x"]), constants)
    parts, cores, limits, tied = sectors(own, entries, names, len(signals["x"]), box, constants)
    plant["tied"], plant["premises"] = tied, [(key, *ends) for key, ends in zip(cores, limits)]
    plant["vertices"] = []
    for ends in product(*reversed(limits)):
        at = list(reversed(ends))

        def value(entry, at=at):
            total = F(0)
            for which, c in entry.items():
                for k in which:
                    c *= at[k]
                total += c
            return F(float(total))

        rows = [[value(e) for e in row] for row in parts]
        plant["vertices"].append({"A": [row[:len(signals["x"])] for row in rows],
                                  "B": [row[len(signals["x"]):] for row in rows], "Bw": matrix("Bw")})
    return plant


def factors(own, names, n_x, constants):
    """Rows of [A B] as polynomials: those of the file, or by the rule; together they are f exactly."""
    f = [polynomial(e, names, constants) for e in own["f"]]
    unit = [tuple(int(i == k) for i in range(len(names))) for k in range(len(names))]
    if "A" in own:
        rows = [[polynomial(e, names, constants) for e in [*a, *b]] for a, b in zip(own["A"], own["B"])]
    else:
        named = [polynomial(q["term"], names, constants) for q in own.get("premise", [])]
        order = sorted(range(len(names)), key=lambda k: ({unit[k]: F(1)} in named, k))
        rows = [[{} for _ in names] for _ in f]
        for row, given in zip(rows, f):
            for key, c in given.items():
                column = next((k for k in order if key[k]), None)
                unknown(column is None)
                rest = tuple(e - (i == column) for i, e in enumerate(key))
                row[column] = plus(row[column], {rest: c})
    for row, given in zip(rows, f):
        total = {}
        for k, entry in enumerate(row):
            total = plus(total, times(entry, {unit[k]: F(1)}))
        demand(total == given, "A x + B u is not f")
    return rows


def sectors(own, rows, names, n_x, box, constants):
    """Entries as sums of products of premises, these as exponents, their bounds, and those that read inputs alone."""
    cores, limits = [], []
    for q in own.get("premise", []):
        p = polynomial(q["term"], names, constants)
        unknown(len(p) != 1)
        (key, c), = p.items()
        cores.append(key)
        ends = [F(float(b)) for b in q["bounds"]] if "bounds" in q else bounds(p, box)
        limits.append([e / c for e in ends])
    found = set()
    for key in (k for row in rows for entry in row for k in entry):
        for core in cores:
            if all(a >= b for a, b in zip(key, core)):
                key = tuple(a - b for a, b in zip(key, core))
        found |= {tuple(k * (i == j) for j in range(len(key))) for i, k in enumerate(key) if k}
    words = {key: "*".join(n if k == 1 else f"{n}**{k}" for n, k in zip(names, key) if k) for key in found}
    for key in sorted(found, key=lambda k: (-int(max(k) > 1), words[k])):
        cores.append(key)
        limits.append(list(bounds({key: F(1)}, box)))

    def entry(p):
        out = {}
        for key, c in p.items():
            which = []
            for k, core in enumerate(cores):
                if any(core) and all(a >= b for a, b in zip(key, core)):
                    key = tuple(a - b for a, b in zip(key, core))
                    which.append(k)
            unknown(any(key))
            out[tuple(which)] = out.get(tuple(which), F(0)) + c
        return out

    tied = [k for k, core in enumerate(cores) if not any(core[:n_x])]
    return [[entry(p) for p in row] for row in rows], cores, limits, tied
