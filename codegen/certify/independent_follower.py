"""A point observer that follows a mode estimator, checked again: designs with a "square" are handed over to it.

Standard library only, nothing of residua imported; exact fractions. Four parts, which together hold mode and state:

1. the boxes of the estimator (``independent_births``);
2. the error set of the observer, a step of a mode that is told (``independent_sets``);
3. what joins them, as where framers are driven (``independent_driven``);
4. a set that starts from computed half widths holds the box of these bounds, all rounding included.
"""

import re
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_births as births  # noqa: E402 - stand beside this file
import independent_sets as sets  # noqa: E402
import independent_source as source  # noqa: E402
from independent import UNIT, demand, read_plant  # noqa: E402
from independent_driven import check_joint  # noqa: E402
from independent_sampled import read_sampled  # noqa: E402

STARTS = ("zonotope", "box", "ellipsoid", "ellipsoid_trace", "starts")  # sets that can start from any box


def check_told(t, cert, plant):
    """The observer of every mode."""
    modes, ranges, box0 = plant
    demand(cert["set"] == t["set"] in STARTS, "a set that is another, or cannot start from a box")
    e = sets.Error(modes, t["told"])
    says = __import__(f"independent_{sets.KINDS[t['set']]}").check(e, cert, ranges, box0)
    sets.check_level(e, cert)
    return says


def check_start(t):
    """With a half width d as computed, at least (d true - 3 tiny) (1 - u): d grow + floor, squared for an ellipsoid."""
    (u, tiny), n = UNIT[t["real"]], len(t["S"])
    grow, floor, square = (F(t[k]) for k in ("grow", "floor", "square"))
    demand(grow * (1 - u) ** 3 >= 1, "grow")
    demand((floor - tiny) * (1 - u) >= 3 * tiny and floor - tiny >= tiny * square, "floor")
    demand(square * (1 - u) ** 3 >= n, "square")
    told = t["told"]
    demand(all(a <= b for a, b in zip(told["x_lo"], t["x_lo"])) and all(
        a >= b for a, b in zip(told["x_hi"], t["x_hi"])), "range of x beyond that of the observer")


def without_observer(bare, t, prefix):
    """Functions of the observer, whose numbers are those of its tables, and the C without them."""
    told, real, alone = t["told"], t["real"], r"told_\w+"
    inner = source.functions(bare, prefix, alone)
    source.check_source(inner, told, f"{prefix}_told", (("whole_range", "whole_range", "x"),))
    if t["set"] == "starts":
        sizes = re.findall(source.TABLE, source.functions(inner, f"{prefix}_told", "set_box"), re.S)
        demand([source.numbers(body, real) for body in sizes] == [source.flat(told["shape"]["sizes"])],
               "the sizes that a start is compared with")
    for piece in re.findall(rf"\n\w[^\n]*{prefix}_{alone}\([^;]*?\)\n{{.*?\n}}\n", bare, re.S):
        bare = bare.replace(piece, "\n")
    return inner, bare


def check_widest(inner, widest, t, prefix):
    """Half widths from which a start is the whole range."""
    told, real = t["told"], t["real"]
    whole = source.functions(inner, f"{prefix}_told", "whole_range")
    middle = [source.numbers(m, real)[0] for m in re.findall(r"x_hat\[\d+\] = (.*?);", whole)]
    for wide, c, lo, hi in zip(widest, middle, told["x_lo"], told["x_hi"], strict=True):
        need = max(F(hi) - c, c - F(lo))
        demand(need <= wide <= need * (1 + 8 * UNIT[real][0]), "the half widths from which a start is the whole range")


def check_source(text, header, t, prefix):
    """The C: functions of the observer hold its numbers, all the others those of an estimator and of a start."""
    told, real, bare = t["told"], t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    inner, outer = without_observer(bare, t, prefix)
    start = source.functions(outer, prefix, "start")
    plain = re.sub(source.TABLE, "", start, flags=re.S)
    squares = [F(t["square"]), F(t["floor"])] * t["set"].startswith("ellipsoid")
    demand([x for x in source.numbers(plain, real) if x] == [F(1, 2)] * 2 + [F(t["grow"]), F(t["floor"]), *squares],
           "the numbers of a start")
    tables = [source.numbers(body, real) for body in re.findall(source.TABLE, start, re.S)]
    demand(tables[:2] == [source.flat(t[k]) for k in ("x_lo", "x_hi")], "the range that bounds are cut to at a start")
    check_widest(inner, tables[2], t, prefix)
    demand(tables[3:] in ([], [source.flat(told["shape"].get("Z", []))]), "other coordinates of a start")
    outer = outer.replace(plain_start(outer, prefix), "\n")
    births.check_source(outer, header, t, prefix, {
        "S_rounded": source.flat(t["S_rounded"]), "xi_room": source.flat(t["xi_room"]),
        "box": source.flat(told["box"])})


def plain_start(text, prefix):
    """The function that starts the observer, whole."""
    (found,) = re.findall(rf"\n\w[^\n]*{prefix}_start\([^;]*?\)\n{{.*?\n}}\n", text, re.S)
    return found


def main(folder, design, record):
    """Check a folder."""
    plant, seen = (read(design["plant"]["toml"]) for read in (read_plant, read_sampled))
    known = None
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        known = births.check_boxes(*plant, births.period_of(design), t, known)
        demand(cert["ages"] == t["ages"] < cert["dwell"], "oldest age")
        says = check_told(t, cert["told"], seen)
        check_joint(t)
        check_start(t)
        said = births.delays.check(design, real, plant[1])
        print(f"proved for {real}: true mode and state are in the boxes, with rounding; where the mode is right, "
              f"{says}; {said}")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
