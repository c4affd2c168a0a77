"""The C of a point observer against its tables: its numbers, and the sets that init and reset start from.

Standard library only, nothing of residua imported; see ``independent_sets.py``.
"""

import re
import struct
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand  # noqa: E402 - stands beside this file

REAL = r"(-?)(?<![\w.])(\d+\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+)"
TABLE = r"static const \w+ \w+(?:\[[^]]*\])+ = (\{.*?\n    \});"


def flat(value):
    """Numbers of nested lists in order."""
    return [x for v in value for x in flat(v)] if isinstance(value, list) else [F(value)]


def each(value, change):
    """Nested lists with every matrix changed."""
    return change(value) if not isinstance(value[0][0], list) else [each(v, change) for v in value]


def transposed(A):
    """Column after column."""
    return [list(c) for c in zip(*A)]


def lower(A):
    """Lower triangle, row by row: all that the C has of a symmetric matrix."""
    return [row[:i + 1] for i, row in enumerate(A)]


def numbers(piece, real):
    """Real literals of a piece of C, with the sign before each."""
    kind, end = ("f", "F") if real == "float32" else ("d", "")
    return [F(struct.unpack(kind, struct.pack(kind, float(s + m)))[0])
            for s, m in re.findall(REAL + end + r"(?![\w.])", piece)]


def functions(text, prefix, names):
    """Text of the functions with these names."""
    return "".join(re.findall(rf"\n\w[^\n]*{prefix}_(?:{names})\([^;]*?\)\n{{.*?\n}}\n", text, re.S))


STARTS = (("init", "set_initial", "x0"), ("whole_range", "whole_range|set_anywhere", "x"))


def check_source(text, t, prefix, from_boxes=STARTS):
    """Every table and number of the C is one of the design's; what init and reset start from holds its box."""
    real, z = t["real"], t["shape"]
    fields = [v for part in (t, z) for v in part.values() if isinstance(v, list)]
    known = [flat(v) for v in fields] + [flat(z.get("directions", [])[len(t["y_lo"]):])]
    known += [flat(each(z[k], transposed)) for k in ("F", "Fb", "V", "pushed") if {k, "e"} <= set(z)]
    known += [flat(each(z[k], lower)) for k in ("H", "Hb", "V") if {k, "kb"} <= set(z)]
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    starts = functions(text, prefix, "init|set_initial|whole_range")
    affine = functions(text, prefix, r"(?:residual|forward|blind)\w*")
    for body in re.findall(TABLE, text, re.S):
        demand(body in starts or body in affine or numbers(body, real) in known,
               f"a table of the C is none of the design's: {' '.join(body.split())[:60]}")
    every = {abs(x) for k in known for x in k} | {abs(F(x)) for x in z.values() if isinstance(x, float)} | {F(0), F(1)}
    foreign = {abs(x) for x in numbers(text, real)} - every - {abs(x) for x in numbers(starts, real)}
    demand(not foreign, f"the C holds {[float(x) for x in sorted(foreign)][:3]}, no table does")
    needed = {abs(x) for k in "MGLNdABaCDc" for x in flat(t[k])} - {F(0), F(1)}
    demand(needed <= {abs(x) for x in numbers(affine, real)}, "a constant of the tables is missing in the C")
    for centre, table, name in from_boxes:
        check_start(functions(text, prefix, centre), functions(text, prefix, table), t, name)


def check_start(centre, table, t, name):
    """Estimate and set hold the box."""
    real = t["real"]
    middle = [numbers(m, real)[0] for m in re.findall(r"x_hat\[\d+\] = (.*?);", centre)]
    half = [max(F(hi) - c, c - F(lo)) for c, lo, hi in zip(middle, t[name + "_lo"], t[name + "_hi"], strict=True)]
    if "h" in t["shape"] or "pushed" in t["shape"]:  # the first errors are those around this very middle
        kind = "f" if real == "float32" else "d"
        means = [struct.pack(kind, lo / 2 + hi / 2) for lo, hi in zip(t[name + "_lo"], t[name + "_hi"])]
        demand(middle == [F(struct.unpack(kind, mean)[0]) for mean in means], f"middle of the box {name}")
    if "Z" in t["shape"]:  # a box in other coordinates
        back = __import__("independent_box").inverse([[F(x) for x in row] for row in t["shape"]["T"]])
        half = [sum(abs(a) * h for a, h in zip(row, half)) for row in back]
    for body in re.findall(TABLE, table, re.S):
        found = numbers(body, real)
        if "pushed" in t["shape"]:  # proved of these very numbers
            demand(found == flat(t["shape"]["start" if name == "x0" else "anywhere"]), f"set of the box {name}")
        if "kb" in t["shape"]:
            demand(sum((h * h / x for h, x in zip(half, found, strict=True) if h), F(0)) <= 1, f"set of the box {name}")
        else:
            demand(all(h <= x for h, x in zip(half, found, strict=True)), f"set of the box {name}")
