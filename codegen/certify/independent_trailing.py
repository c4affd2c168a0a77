"""Filters beside a mode estimator, checked again: what ``independent_driven.py`` hands over where starts have an "E".

Standard library only, nothing of residua imported; exact fractions. Three parts, which together hold mode and estimate:

1. the boxes of the estimator (``independent_births``), of a plant that is given no parameters;
2. the filter of each mode, which stays (``independent_filter``): its energy gain, a set of plant and filter, and the
   thresholds from every start on. A start is x = c + d, c in the declared range, |d| within a size, xi = E c but for
   rounding; or x in its range and xi within its limits;
3. half widths as they are computed hold d, sizes hold the declared range, and both accept the same inputs.
"""

import re
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_births as births  # noqa: E402 - stand beside this file
import independent_filter as filters  # noqa: E402
from independent import UNIT, demand, exact, mul, size  # noqa: E402
from independent_driven import middle_plant  # noqa: E402
from independent_filter import reach, up  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402
from independent_step import read_plant  # noqa: E402

GAINS, STAYS, MOST = ("M", "G", "L", "K", "Du", "Dy", "E"), ([None], [(0, 0, 0)]), 5000
RANGES = [f"{v}_{side}" for v in "xuy" for side in ("lo", "hi")]


def alone(told, q):
    """The constants of one mode."""
    return told | {k: [told[k][q]] for k in GAINS}


def begins(told, q, rows):
    """Bounds of the rows at a start of each size, and from anywhere."""
    n, E, c = len(told["x_lo"]), exact(told["E"][q]), reach(zip(told["x_lo"], told["x_hi"]))
    u, tiny = UNIT[told["real"]]
    lost = [((1 + u) ** (n + 1) - 1) * size(row, c) + 2 * (n + 1) * tiny for row in E]
    fixed = [size([a + b for a, b in zip(row[:n], mul([row[n:]], E)[0])], c) + size(row[n:], lost) for row in rows]
    out = [[up(f + size(row[:n], d)) for f, row in zip(fixed, rows)] for d in exact(told["sizes"])]
    return [*out, [up(size(row, c + exact(told["limit"]))) for row in rows]]


def check_energy(p, told, q, cert, options, ranges):
    """Energy gain of one filter in its mode."""
    energy = {"P": [cert["energy"]["P"][q]], "level2": cert["energy"]["level2"]}
    filters.check_energy([p], ranges, alone(told, q), {"energy": energy, "level": cert["level"], "dwell_add": 0,
                                                       "dwell_drain": 0, "dwell_limit": 0}, options)


def check_thresholds(p, told, q, own):
    """Set and thresholds of one filter in its mode."""
    found, n = filters.Set([p], alone(told, q), own | {"bounds": [own["bounds"]]}, STAYS), len(told["x_lo"])
    last = (len(told["h"][0]) - 1) << told["shift"]
    for k, bounds in enumerate(begins(told, q, found.rows)):
        bounds, since = [bounds], 0
        while since <= last or not found.settled(bounds):
            demand(since < MOST, f"thresholds of start {k} in mode {q} do not come down")
            within = found.settled(bounds)
            row = told["h"][k][min(since, last) >> told["shift"]][q]
            found.holds(found.b if within else bounds, [row], f"{since} samples after start {k}")
            bounds, since = found.b if within else found.after(bounds), since + 1
        found.holds(found.b, [told["h"][k][-1][q]], "for ever")
    for i, limit in enumerate(told["limit"]):
        demand(found.b[0][n + i] < limit, f"limit of xi[{i}]")


def check_joint(t):
    """What both share, and the half widths of a start."""
    told, (u, tiny) = t["told"], UNIT[t["real"]]
    demand(all(t[k] == told[k] for k in RANGES), "ranges of filters and estimator differ")
    grow, floor = F(told["grow"]), F(told["floor"])
    demand(grow * (1 - u) ** 3 >= 1 and (floor - tiny) * (1 - u) >= 3 * tiny, "grow or floor of a half width")
    for lo, hi, d in zip(told["x_lo"], told["x_hi"], told["sizes"][0]):
        need = (F(hi) - F(lo)) / 2 + 2 * u * max(abs(F(lo)), abs(F(hi))) + 2 * tiny
        demand(need <= F(d), "the largest size does not hold the declared range")


def check_source(text, header, t, prefix):
    """The C: maps hold the filters' numbers, a start its own, all the others those of an estimator."""
    told, real, bare = t["told"], t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    names = r"(?:estimate|forward)(?:_\w+)?"
    affine = functions(bare, prefix, names)
    known = {abs(x) for k in GAINS[:-1] for x in flat(told[k])} - {F(0), F(1)}
    demand({abs(x) for x in numbers(affine, real)} - {F(0), F(1)} == known, "constants of the maps of the filters")
    begin = functions(bare, prefix, "begin")
    plain = [x for x in numbers(re.sub(TABLE, "", begin, flags=re.S), real) if x]
    demand(plain == [F(1, 2), F(1, 2), F(told["grow"]), F(told["floor"])], "the numbers of a start")
    tables = [numbers(body, real) for body in re.findall(TABLE, begin, re.S)]
    demand(tables == [flat(told[k]) for k in ("E", "sizes", "x_lo", "x_hi")], "the tables of a start")
    for piece in re.findall(rf"\n\w[^\n]*{prefix}_(?:{names}|begin)\([^;]*?\)\n{{.*?\n}}\n", bare, re.S):
        bare = bare.replace(piece, "\n")
    thresholds = [numbers(body, real) for body in re.findall(TABLE, functions(bare, prefix, "beyond"), re.S)]
    demand(thresholds == [flat(told["h"])], "the thresholds")
    births.check_source(bare, header, t, prefix, {"h": flat(told["h"]), "told limit": flat(told["limit"])})
    rows, sizes = len(told["h"][0]), len(told["sizes"])
    for name, value in (("ROWS", rows), ("LAST", (rows - 1) << told["shift"]), ("SIZES", sizes), ("ANYWHERE", sizes),
                        ("STAGES", sizes + 1)):
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(value)], f"macro {name}")
    shifts = re.findall(r"told_since\[q\] >> (\d+)U", bare)
    demand(shifts == [str(told["shift"])] if told["shift"] else not shifts, "samples per row")


def main(folder, design, record):
    """Check a folder."""
    given, boxes, _, h, _ = read_plant(design["plant"]["toml"])
    modes, ranges, _ = filters.read_plant(design["plant"]["toml"])
    demand(not any(map(any, (row for p in modes for M in p["Dw"] for row in M))), "a disturbance in y")
    for real, t in design["tables"].items():
        cert, (u, tiny) = design["certificate"][real], UNIT[real]
        umax = [max(abs(F(a)), abs(F(b))) for a, b in zip(t["u_lo"], t["u_hi"])]
        plain = middle_plant(given, boxes["x"], [b + u * b + tiny for b in umax])
        births.check_boxes(plain, boxes["x"], boxes["x0"], h, t)
        demand(cert["ages"] == t["ages"] < cert["dwell"], "oldest age")
        check_joint(t)
        for q, p in enumerate(modes):
            check_energy(p, t["told"], q, cert["told"], design["options"], ranges)
            check_thresholds(p, t["told"], q, cert["told"]["sets"][q])
        said = births.delays.check(design, real, boxes["x"])
        print(f"proved for {real}: the true mode is in the boxes, with rounding; thresholds and energy gain of the "
              f"filters in modes that stay; {said}")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
