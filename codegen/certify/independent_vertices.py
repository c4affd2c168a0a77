"""The vertices of a polytopic plant read again: ``independent_bank.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. A file with ``[[vertex]]`` tables has them. Of
polynomial equations each product goes to the column of its first state, else input; each power of one variable that
is left beside it is a premise between its bounds over the ranges, and the vertices are the corners, so that f is a
mixture of them exactly. Where the file names premises or factors, or has other functions, nothing is said (status 2).

A discrete plant E x+ = A x + .. is one of Euler steps of period 1 with A - E, exactly. Weights of inputs and exactly
measured parameters alone are the same in plant and observer: then both are at one vertex.
"""

import ast
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import number  # noqa: E402 - stands beside this file
from independent_sector import polynomial, unknown  # noqa: E402


def read_plant(text):
    """The plant: E, vertices with A and B, their pairs, C, Bw, Dv, Df, ranges and bounds of signals, boxes, period."""
    p = tomllib.loads(text)
    signals = {k: p["signals"].get(k, []) for k in ("x", "u", "y", "w", "v", "f", "theta")}
    common, given, own = p.get("common", {}), p.get("vertex", []), p.get("nonlinear", {})
    unknown(any(not s.get("measured", True) for s in signals["theta"]) or "D" in common or any(
        k in own for k in ("premise", "A", "B", "known", "point")) or any(k in v for v in given for k in (
            "E", "C", "Bw", "offset", "Bf")))
    plain = {k: F(float(v)) for k, v in p.get("constants", {}).items()}
    decimal = {k: F(repr(float(v))) for k, v in p.get("constants", {}).items()}
    n, m = len(signals["x"]), len(signals["u"])

    def matrix(rows, r, c):
        rows = rows if rows is not None else [[0] * c] * r
        return [[number(e, plain) for e in row] for row in rows]

    plant = {k: matrix(common.get(k), len(signals[r]), len(signals[c])) for k, r, c in (
        ("C", "y", "x"), ("Bw", "x", "w"), ("Dv", "y", "v"), ("Df", "y", "f"))}
    unknown("Bf" in common)
    plant["E"] = matrix(own.get("E", common.get("E", [[i == j for j in range(n)] for i in range(n)])), n, n)
    plant |= {k: [tuple(F(float(b)) for b in s.get("range", s.get("bounds", (0, 0)))) for s in signals[k]]
              for k in "xuywvf"}
    plant["x0"] = [(F(float(a)), F(float(b))) for a, b in zip(p["initial"]["x_lo"], p["initial"]["x_hi"])]
    plant["names"], euler = [s["name"] for s in signals["f"]], p["time"]["kind"] == "continuous"
    plant["period"] = F(float(p["time"]["sample_period"])) if euler else F(1)
    plant["euler"] = plant["period"] if euler else None
    plant["theta"] = [tuple(F(float(b)) + s * F(float(v.get("error", 0))) for s, b in zip((-1, 1), v["bounds"]))
                      for v in signals["theta"]]
    names = [s["name"] for k in ("x", "u", "theta") for s in signals[k]]
    known = {k for k, s in enumerate([*signals["u"], *signals["theta"]], n) if not s.get("error", 0)}
    if given:
        plant["vertices"] = [[matrix(v.get(k, common.get(k)), n, c) for k, c in (("A", n), ("B", m))] for v in given]
        read = {k.id for v in given for k in ast.walk(ast.parse(str(v["weight"]))) if isinstance(k, ast.Name)}
        tied = all(k in known for k, name in enumerate(names) if name in read)
    else:
        box = plant["x"] + plant["u"] + [tuple(F(float(b)) for b in v["bounds"]) for v in signals["theta"]]
        plant["vertices"], read = corners([polynomial(f, names, decimal) for f in own["f"]], n, m, box)
        tied = all(k in known for k, _ in read)
    every = range(len(plant["vertices"]))
    plant["pairs"] = [(i, j) for i in every for j in every if i == j or not tied]
    if not euler:
        plant["vertices"] = [([[a - e for a, e in zip(*rows)] for rows in zip(A, plant["E"])], B)
                             for A, B in plant["vertices"]]
    return plant


def corners(f, n, m, box):
    """Vertices of equations, the first premise turning fastest; the premises: variable and power."""
    premises, rows = [], []
    for row in f:
        parts = []
        for key, c in row.items():
            column = next((k for k, e in enumerate(key[:n + m]) if e), None)
            unknown(column is None)
            left = [e - (k == column) for k, e in enumerate(key)]
            parts.append((column, c, [(k, e) for k, e in enumerate(left) if e]))
            premises += [(k, e) for k, e in enumerate(left) if e]
        rows.append(parts)
    premises = sorted(set(premises))
    unknown(len(premises) > 1)  # of several the order would have to be that of the file's tool
    ends = []
    for k, e in premises:
        values = [b ** e for b in box[k]] + [F(0)] * (e % 2 == 0 and box[k][0] < 0 < box[k][1])
        ends.append((min(values), max(values)))
    out = []
    for at in product(*reversed(ends)):
        value, whole = dict(zip(premises, reversed(at))), [[F(0)] * (n + m) for _ in f]
        for i, parts in enumerate(rows):
            for column, c, factors in parts:
                for factor in factors:
                    c *= value[factor]
                whole[i][column] += c
        whole = [[F(float(e)) for e in row] for row in whole]
        out.append(([row[:n] for row in whole], [row[n:] for row in whole]))
    return out, premises
