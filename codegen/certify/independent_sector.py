"""Polytopic plants from their file, read again: vertices, or equations as polynomials with their premises as sectors.

Standard library only, nothing of residua imported; exact fractions. A product of an equation goes to the column of a
state that is no premise, else of its first state, else of its first input, unless the file gives A and B. What varies
in an entry is a premise: those of the file first, then powers of one variable each. Vertices are the corners of their
bounds, the first premise turning fastest. Other equations than polynomials are not read (status 2), but that terms
which the file calls known, and with them a row of f, may be quotients.
"""

import ast
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand  # noqa: E402 - stands beside this file
from independent_formula import Formula, bounds, formula, plus, polynomial, unknown  # noqa: E402

SHAPES = {"E": "xx", "A": "xx", "B": "xu", "C": "yx", "Bw": "xw", "Dv": "yv", "Bf": "xf", "Df": "yf"}


def read_plant(text):
    """E, C, Dv, Df, vertices, ranges, initial box, period, bits that inputs tell, what weights read, known terms, f."""
    p = tomllib.loads(text)
    signals = {k: p["signals"].get(k, []) for k in ("x", "u", "y", "w", "v", "f", "theta")}
    constants = {k: F(repr(float(v))) for k, v in p.get("constants", {}).items()}
    names = [s["name"] for k in ("x", "u", "theta") for s in signals[k]]
    common, own = p.get("common", {}), p.get("nonlinear", {})
    unknown("point" in own or any(not s.get("measured", True) for s in signals["theta"]))
    unknown(any(polynomial(e, [], constants) for row in common.get("D", []) for e in row))

    def matrix(key, given=None):
        r, c = (signals[v] for v in SHAPES[key])
        rows = given if given is not None else common.get(key, [
            [int(key == "E" and i == j) for j in range(len(c))] for i in range(len(r))])
        rows = [[polynomial(e, [], constants).get((), F(0)) for e in row] for row in rows]
        return [[F(float(e)) for e in row] for row in rows]

    plant = {k: matrix(k) for k in ("C", "Dv", "Df")} | {"E": matrix("E", own.get("E")), "tied": [], "known": []}
    plant["period"] = F(float(p["time"]["sample_period"])) if p["time"]["kind"] == "continuous" else None
    for k in "xuywvf":
        key = "bounds" if k in "wv" else "range"
        plant[k] = [tuple(F(float(b)) for b in (s[key] if k != "f" else s.get(key, (0, 0)))) for s in signals[k]]
    plant["theta"] = [tuple(F(float(b)) for b in s["bounds"]) for s in signals["theta"]]
    plant["errors"] = [F(float(s.get("error", 0))) for s in signals["theta"]]
    plant["rates"] = [F(float(s.get("rate", 0))) for s in signals["u"]]
    plant["names"] = [s["name"] for s in signals["f"]]
    plant["x0"] = [(F(float(a)), F(float(b))) for a, b in zip(p["initial"]["x_lo"], p["initial"]["x_hi"])]
    if p.get("vertex"):
        unknown(any(any(v.get("offset", [])) for v in p["vertex"]))
        plant["vertices"] = [{k: matrix(k, v.get(k)) for k in ("A", "B", "Bw", "Bf")} for v in p["vertex"]]
        nodes = [node for v in p["vertex"] for node in ast.walk(ast.parse(str(v.get("weight", 0))))]
        read = {node.id for node in nodes if isinstance(node, ast.Name)}
        plant["premises"] = plant["f_of"] = None
        plant["read"] = {k for k, name in enumerate(names) if name in read}
        return plant
    plant["f_of"] = [formula(e, names, constants) for e in own["f"]]
    plant["known"] = [(i, t) for i, t in enumerate(formula(e, names, constants) for e in own.get("known", [])) if t]
    entries = factors(own, names, plant, constants)
    box = plant["x"] + plant["u"] + plant["theta"]
    parts, cores, limits = sectors(own, entries, names, box, constants)
    plant["premises"], n_x = [(key, *ends) for key, ends in zip(cores, limits)], len(signals["x"])
    plant["tied"] = [k for k, core in enumerate(cores) if not any(core[:n_x])]
    plant["read"] = {k for core in cores for k, e in enumerate(core) if e}
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
        A, B = ([row[part] for row in rows] for part in (slice(n_x), slice(n_x, None)))
        plant["vertices"].append({"A": A, "B": B, "Bw": matrix("Bw"), "Bf": matrix("Bf")})
    return plant


def factors(own, names, plant, constants):
    """Rows of [A B] as polynomials: those of the file, or by the rule; with the known terms they are f exactly."""
    size, wide, f = len(names), len(plant["x"] + plant["u"]), list(plant["f_of"])
    for i, term in plant["known"]:
        f[i] -= term
    if "A" in own:
        rows = [[polynomial(e, names, constants) for e in [*a, *b]] for a, b in zip(own["A"], own["B"])]
    else:
        unknown(not all(given.plain for given in f))
        named = [polynomial(q["term"], names, constants) for q in own.get("premise", [])]
        order = sorted(range(wide), key=lambda k: (Formula.variable(k, size).n in named, k))
        rows = [[{} for _ in range(wide)] for _ in f]
        for row, given in zip(rows, f):
            for key, c in given.n.items():
                column = next((k for k in order if key[k]), None)
                unknown(column is None)
                rest = tuple(e - (i == column) for i, e in enumerate(key))
                row[column] = plus(row[column], {rest: c})
    for row, left in zip(rows, f):
        for k, entry in enumerate(row):
            left -= Formula(entry, {(0,) * size: F(1)}) * Formula.variable(k, size)
        demand(not left, "A x + B u is not f")
    return rows


def sectors(own, rows, names, box, constants):
    """Entries as sums of products of premises, these as exponents, their bounds."""
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

    return [[entry(p) for p in row] for row in rows], cores, limits
