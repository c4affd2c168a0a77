"""A fault filter that sliding modes guide, checked again: what ``independent_sliding.py`` hands over for an "E".

Standard library only, nothing of residua imported; exact fractions. Three parts: together they hold the estimate while
the decision is right, of which nothing is said:

1. the estimator (``independent_sliding``);
2. the filter of each mode, which stays: energy gain, and the thresholds from every start on (``independent_trailing``);
3. what joins them: the same ranges, and the state at a start, which is E c but for rounding, c the middle of the range.
"""

import re
import struct
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_filter as filters  # noqa: E402 - stand beside this file
import independent_sliding as sliding  # noqa: E402
import independent_trailing as trailing  # noqa: E402
from independent import UNIT, demand, exact, size  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402


def rounded(value, real):
    """A double as the number type has it."""
    return value if real == "float64" else struct.unpack("f", struct.pack("f", value))[0]


def check_begun(found, t):
    """States at a start, flat over the modes, are E c of the middle as the number type has it, but for rounding."""
    told, real, n = t["told"], t["real"], len(t["x_lo"])
    u, tiny = UNIT[real]
    c = exact([rounded(rounded(lo / 2, real) + rounded(hi / 2, real), real) for lo, hi in zip(t["x_lo"], t["x_hi"])])
    rows = [row for E in exact(told["E"]) for row in E]
    demand(len(found) == len(rows), "states at a start")
    for row, xi in zip(rows, found):
        lost = ((1 + u) ** (n + 1) - 1) * size(row, [abs(a) for a in c]) + 2 * (n + 1) * tiny
        demand(abs(xi - sum(e * a for e, a in zip(row, c))) <= lost, "the state of a filter at a start")


def check_source(text, header, t, prefix):
    """The C: maps hold the filters' numbers, starts and thresholds theirs, all the others are those of an estimator."""
    told, real, bare = t["told"], t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    maps = r"(?:estimate|forward)(?:_\w+)?"
    known = {abs(x) for k in trailing.GAINS[:-1] for x in flat(told[k])} - {0, 1}
    demand({abs(x) for x in numbers(functions(bare, prefix, maps), real)} - {0, 1} == known, "constants of the maps")

    def tables(name):
        return [numbers(body, real) for body in re.findall(TABLE, functions(bare, prefix, name), re.S)]

    (begun,) = tables("told_start")
    check_begun(begun, t)
    demand(tables("beyond") == [flat(told["h"])], "the thresholds")
    demand(tables("advance") == [flat(told["limit"])], "the limits of the filters")
    for name in ("told_start", "beyond", "advance"):
        rest = numbers(re.sub(TABLE, "", functions(bare, prefix, name), flags=re.S), real)
        demand(not any(rest), f"a number in {name}")
    for piece in re.findall(rf"\n\w[^\n]*{prefix}_(?:{maps}|told_start|beyond|advance)\([^;]*?\)\n{{.*?\n}}\n", bare,
                            re.S):
        bare = bare.replace(piece, "\n")
    sliding.check_source(bare, header, t, prefix)
    rows, starts = len(told["h"][0]), len(told["sizes"])
    for name, value in (("ROWS", rows), ("LAST", (rows - 1) << told["shift"]), ("ANYWHERE", starts),
                        ("STAGES", starts + 1)):
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(value)], f"macro {name}")
    shifts = re.findall(r"told_since >> (\d+)U", text)
    demand(shifts == [str(told["shift"])] if told["shift"] else not shifts, "samples per row")


def main(folder, design, record):
    """Check a folder."""
    sliding.check_design(design)
    modes, ranges, _ = filters.read_plant(design["plant"]["toml"])
    demand(not any(map(any, (row for p in modes for M in p["Dw"] for row in M))), "a disturbance in y")
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        trailing.check_joint(t)
        for q, p in enumerate(modes):
            trailing.check_energy(p, t["told"], q, cert["told"], design["options"], ranges)
            trailing.check_thresholds(p, t["told"], q, cert["told"]["sets"][q])
        print(f"proved for {real}: while the decision is right, no estimate is beyond its bound without a fault, with "
              "rounding; energy gain of the filters in modes that stay")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
