"""Framers that a mode estimator drives, checked again: what ``independent.py`` hands designs with "told" over to.

Standard library only, nothing of residua imported; exact fractions. Three parts, which together hold mode and state:

1. the boxes of the estimator (``independent_births``), of a plant that is given no parameters: what they can do,
   |(A(theta) - A_m) x + (B(theta) - B_m) u| <= sum of the farthest end of each entry times the range, is a disturbance;
2. the framers of every mode, as where the mode is told (``independent_lpv`` where they have parameters or radii);
3. what joins them: framers accept what the estimator accepts, and S x of their bounds holds all rounding.
"""

import re
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent as plain  # noqa: E402 - stands beside this file
import independent_births as births  # noqa: E402
import independent_lpv as lpv  # noqa: E402
from independent import UNIT, demand, exact, mul, rounding, size  # noqa: E402
from independent_source import flat, functions, numbers  # noqa: E402
from independent_step import read_plant  # noqa: E402


def middle_plant(modes, ranges, umax):
    """Modes of the plant without parameters: middle matrices, and the rest as one disturbance per state."""
    most = [max(abs(F(float(a))), abs(F(float(b)))) for a, b in ranges] + umax
    return [middle_mode(p, most) for p in modes]


def middle_mode(p, most):
    """One mode of it; the middle is rounded to float64, and what that moves is in the rest."""
    n, (base, *slopes) = len(p["F"][0]), p["F"]
    whole, rest = [], []
    for i, row in enumerate(base):
        whole.append([])
        rest.append(F(0))
        for k, entry in enumerate(row):
            ends = [entry + sum((c * S[i][k] for c, S in zip(at, slopes)), F(0)) for at in product(*p["theta"])]
            whole[-1].append(F(float((min(ends) + max(ends)) / 2)))
            rest[-1] += max(abs(e - whole[-1][-1]) for e in ends) * most[k]
    own = {k: p[k] for k in ("name", "C", "D", "v")} | {"A": [r[:n] for r in whole], "B": [r[n:] for r in whole]}
    if not slopes:
        return own | {k: p[k] for k in ("Bw", "Dv", "w")}
    return own | {"Bw": [r + [F(i == j) for j in range(n)] for i, r in enumerate(p["Bw"])], "Dv": p["Dv"],
                  "w": [*p["w"], *((-r, r) for r in rest)]}


def check_told(t, cert, plant):
    """The framers of every mode, those of z where coordinates are changed; modes told late are none of theirs."""
    given, boxes, signals, h, late = plant
    told = t["told"]
    demand(not late, "framers for modes told late")
    if "vary" in told:
        lpv.check_framers(told, cert["told"], given, boxes, signals, h, late, True)
        return
    demand(h is None and not signals["theta"], "parameters or time between samples, and no radii")
    modes = [p | {"A": [r[:len(p["C"][0])] for r in p["F"][0]], "B": [r[len(p["C"][0]):] for r in p["F"][0]]}
             for p in given]
    for p, N in zip(modes, told["N_hi"]):
        demand(not any(map(any, mul(exact(N), p["D"]))), "N D is not zero")
    plain.check_claims(modes, told, cert["told"], *plain.check_tables(modes, told, boxes["x"], boxes["x0"]))


def check_ranges(t):
    """Inputs, measurements and states that framers and estimator share."""
    told = t["told"]
    for k in ("u", "y"):
        demand(all(F(a) >= F(b) for a, b in zip(t[f"{k}_lo"], told[f"{k}_lo"])) and all(
            F(a) <= F(b) for a, b in zip(t[f"{k}_hi"], told[f"{k}_hi"])), f"{k} is accepted beyond the framers' range")
    for lo, hi, a, b, box in zip(t["x_lo"], t["x_hi"], told["x_lo"], told["x_hi"], told["box"]):
        demand(a <= lo and hi <= b and max(-lo, hi) <= box, "range of x beyond that of the framers")


def check_bounds(told):
    """Bounds of parameters are those of every mode."""
    for side in ("lo", "hi"):
        bounds = told.get("vary", {}).get(f"theta_{side}", [])
        demand(all(b == bounds[0] for b in bounds), "bounds of parameters that differ between modes")


def check_accepted(text, prefix, told):
    """Parameters that the C accepts are those within the bounds."""
    if "vary" in told:
        bounds = numbers(functions(text, prefix, "theta_accepted"), told["real"])
        ends = [sorted(flat([told["vary"][f"theta_{s}"][:k] for s in ("lo", "hi")])) for k in (1, None)]
        demand(sorted(bounds) in ends, "bounds of parameters that are accepted")


def check_joint(t):
    """Ranges that framers and estimator share, bounds of parameters without a mode, and the way from x to S x."""
    check_ranges(t)
    told, real = t["told"], t["real"]
    check_bounds(told)
    box = exact(told["box"])
    for i, (row, used, room) in enumerate(zip(exact(t["S"]), exact(t["S_rounded"]), t["xi_room"], strict=True)):
        error = rounding([*zip(used, box), (F(1), F(room))], real)[0]
        demand(size(row, box, used) + error <= F(room), f"xi_room[{i}] lacks {float(error):.3g}")


def check_source(text, header, t, prefix):
    """The C: functions of the framers hold their numbers, all the others are those of an estimator."""
    told, bare = t["told"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    names = r"(?:(?:forward|blind)(?:_\w+)?|cut_[xz]|to_[xz]|theta_accepted)"
    own = functions(bare, prefix, names)
    needed = ("forward", "blind", *("to_x", "to_z") * ("change" in told))
    demand(all(f"{prefix}_{name}(" in own for name in needed), "the maps of the framers are missing")
    (lpv.check_source if "vary" in told else plain.check_source)(own, told)
    check_accepted(bare, prefix, told)
    for piece in re.findall(rf"\n\w[^\n]*{prefix}_{names}\([^;]*?\)\n{{.*?\n}}\n", bare, re.S):
        bare = bare.replace(piece, "\n")
    births.check_source(bare, header, t, prefix, {
        "S_rounded": flat(t["S_rounded"]), "xi_room": flat(t["xi_room"]), "box": flat(told["box"])})


def main(folder, design, record):
    """Check a folder; filters are handed over; status 2: what is driven is neither."""
    if any("E" in t["told"] for t in design["tables"].values()):
        return __import__("independent_trailing").main(folder, design, record)
    if any("shape" in t["told"] for t in design["tables"].values()):
        return 2
    plant, known = read_plant(design["plant"]["toml"]), None
    given, boxes, _, h, _ = plant
    for real, t in design["tables"].items():
        cert, (u, tiny) = design["certificate"][real], UNIT[real]
        umax = [max(abs(F(a)), abs(F(b))) for a, b in zip(t["u_lo"], t["u_hi"])]
        modes = middle_plant(given, boxes["x"], [b + u * b + tiny for b in umax])
        known = births.check_boxes(modes, boxes["x"], boxes["x0"], h, t, None if given[0]["F"][1:] else known)
        demand(cert["ages"] == t["ages"] < cert["dwell"], "oldest age")
        check_told(t, cert, plant)
        check_joint(t)
        said = births.delays.check(design, real, boxes["x"])
        print(f"proved for {real}: true mode and state are in the boxes and framers, with rounding; {said}")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
