"""Banks of observers, checked again: every member, the confidence of the thresholds, who is blamed, the C.

Standard library only, nothing of residua imported; exact fractions. ``independent_member.py`` proves gain, sensitivity,
start and limits of each observer. Thresholds come from simulated runs, which this checker does not repeat: what it
checks is that they are no lower than the levels of the record, and what order statistics say of so many runs.
"""

import re
import sys
from decimal import Decimal
from fractions import Fraction as F  # noqa: N817 - on every line
from math import comb
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, sub  # noqa: E402 - stands beside this file
from independent_formula import unknown  # noqa: E402
from independent_member import Member, largest  # noqa: E402
from independent_sector import read_plant as read  # noqa: E402
from independent_source import TABLE, flat, functions, numbers  # noqa: E402


def read_plant(text):
    """The plant with faults of sensors alone, one Bw for all vertices, and the pairs of vertices.

    A discrete plant E x+ = A x + .. is one of Euler steps of period 1 with A - E, exactly. What weights read of inputs
    and exactly measured parameters is the same in plant and observer.
    """
    p = read(text)
    n, m, vertices = len(p["x"]), len(p["u"]), p["vertices"]
    unknown(p["known"] or any(v["Bw"] != vertices[0]["Bw"] or any(map(any, v["Bf"])) for v in vertices))
    p["Bw"], p["euler"], p["period"] = vertices[0]["Bw"], p["period"], p["period"] or F(1)
    known = {*range(n, n + m), *(n + m + k for k, e in enumerate(p["errors"]) if not e)}
    p["theta"] = [(a - e, b + e) for (a, b), e in zip(p["theta"], p["errors"])]
    tied = -1 if p["read"] <= known else 0  # bits of vertices
    for bit, (key, *_) in enumerate(p["premises"] or []):
        tied |= all(i in known for i, e in enumerate(key) if e) << bit
    every = range(len(vertices))
    p["pairs"] = [(i, j) for i in every for j in every if not (i ^ j) & tied]
    p["vertices"] = [(v["A"] if p["euler"] else sub(v["A"], p["E"]), v["B"]) for v in vertices]
    return p


def check_calibration(t, cert):
    """Thresholds above the levels of the campaign, and the chance that so many runs say so."""
    c, count = cert["calibration"], len(t["members"])
    p, runs = F(c["probability"]), c["runs"]
    demand(all(a <= b for a, b in zip(c["levels"], t["bound"], strict=True)), "a threshold below the largest level")
    demand(0 < p < 1 and runs >= count, "runs of the campaign")
    missed = sum(comb(runs, i) * p ** i * (1 - p) ** (runs - i) for i in range(count))
    demand(F(c["confidence"]) <= 1 - missed, "confidence of the thresholds")
    words = r"1 to (\d+) measurements in succession missing .* paid for by (\d+) others"
    lost = re.fullmatch(words, c["conditions"][-1])
    demand(lost and [int(n) for n in lost.groups()] == [t["bridge"], t["gap"]], "lost samples of the campaign")


def check_parameters(plant, t):
    """All parameters are read, and their bounds accepted, error of measurement included."""
    count = len(plant["theta"])
    demand(t.get("columns", []) == list(range(count)), "columns of the parameters")
    for lo, hi, (a, b) in zip(t.get("theta_lo", []), t.get("theta_hi", []), plant["theta"], strict=True):
        demand(F(lo) <= a and F(hi) >= b, "bounds of a parameter")


def check_words(plant, t, cert, claims):
    """The sizes that are called isolable, and the figures of the sentences."""
    sizes = largest(plant["f"])
    found = [c for c in claims if c.startswith("constant faults of at least this size")]
    demand(len(found) == 1, "sentence on the sizes of faults")
    for k, name in enumerate(plant["names"]):
        said = re.search(rf"{re.escape(name)} (\d[\d.]*)", found[0].partition(": ")[2])
        demand(said, f"size of {name}")
        size = F(Decimal(said[1])) / sizes[k]
        for p, (bound, m) in enumerate(zip(t["bound"], cert["members"])):
            demand(p == k or (size * F(m["beta"])) ** 2 >= 4 * F(bound), f"{name} of {said[1]} is not isolated")
    c = cert["calibration"]
    for words in (f"{t['settle']} samples after a start", f"of {c['runs']} fault-free runs",
                  f"probability {c['probability']:g} at most, confidence {c['confidence']:.4g}"):
        demand(any(words in claim for claim in claims), f"no claim says: {words}")


def check_source(text, header, t, prefix):
    """Each member reads its outputs and holds its numbers; tables, starts, counts and patterns are the design's."""
    real, text = t["real"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    count, n = len(t["members"]), len(t["x_lo"])
    for k, m in enumerate(t["members"]):
        body = functions(text, prefix, f"without_{k}")
        demand(sorted({int(i) for i in re.findall(r"s->y\[(\d+)\]", body)}) == sorted(
            i for j, i in enumerate(m["seen"]) if any(row[j] for row in m["T2"]) or any(m["C"][j])), f"y of member {k}")
        demand({int(i) // n for i in re.findall(r"s->z\[(\d+)\]", body)} == {k}, f"states of member {k}")
        mine = {abs(x) for key in ("T2", "C", "F", "G", "K", "M") for x in flat(m[key])} | {F(t["rate"])}
        here = {abs(x) for x in numbers(body, real)}
        demand(here <= mine | {F(0), F(1)} and mine - {F(0), F(1)} <= here, f"numbers of member {k}")
    known = {"bound": t["bound"], "limit": t["limit"], "most": t["most"]}
    bodies = [numbers(body, real) for body in re.findall(TABLE, text, re.S) if numbers(body, real)]
    demand(sorted(bodies) == sorted(flat(v) for v in known.values()), "tables of thresholds and limits")
    weights = {abs(F(x)) for x in t["weights"]["constants"]}
    demand({abs(x) for x in numbers(functions(text, prefix, "weights"), real)} - {F(0)} == weights - {F(0)}, "weights")
    anew = functions(text, prefix, "anew")
    for name, values in (("z", sum((m["z0"] for m in t["members"]), [])), ("a", [0.0] * len(t["most"]))):
        found = [numbers(x, real)[0] for x in re.findall(rf"s->{name}\[\d+\] = (.*?);", anew)]
        demand(found == exact(values), f"where {name} begins")
    for function, name in (("anew", "settle"), ("init", "begin")):
        found = re.findall(r"s->wait = (\d+)U;", functions(text, prefix, function))
        demand(found == [str(t[name])], f"wait of {function}")
    demand(re.findall(r"s->left\[i\] = (\d+)U;", text) == [str(t["keep"])], "samples that an alarm holds")
    whole = 2 ** count - 1
    patterns = re.search(r"pattern\[\w+\] = \{(.*?)\}", text)
    demand(patterns and [int(x, 16) for x in re.findall(r"0x[0-9A-F]+", patterns[1])] == [
        whole ^ 1 << k for k in range(count)], "pattern of a fault")
    bounds = numbers(functions(text, prefix, "(?:[uy]|theta)_accepted"), real)
    ends = [t.get(f"{k}_{side}", []) for k in ("u", "y", "theta") for side in ("lo", "hi")]
    demand(sorted(bounds) == sorted(flat(ends)), "ranges that are accepted")
    rest = functions(text, prefix, r"(?!without|weights|anew|outside|sound|[uy]_accepted|theta_accepted)\w+")
    demand(not set(numbers(rest, real)) - {F(0)}, "the C holds a number that no table does")
    for name, value in (("NF", count), ("GAP", t["gap"]), ("CREDIT", t["gap"] * t["bridge"])):
        demand(re.findall(rf"#define \w+_{name} (\d+)U", header) == [str(value)], f"macro {name}")


def main(folder, design, record):
    """Check a folder of a bank."""
    plant = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        cert, at, n = design["certificate"][real], 0, len(t["x_lo"])
        demand(len(t["members"]) == len(cert["members"]) == len(plant["f"]), "a member for every fault")
        for k, stored in enumerate(cert["members"]):
            m = Member(plant, t, k, stored)
            m.level()
            m.fault()
            m.starts()
            m.limits(exact(t["limit"][k * n:(k + 1) * n]), exact(t["most"][at:at + len(m.M)]))
            at += len(m.M)
        check_parameters(plant, t)
        check_calibration(t, cert)
        check_words(plant, t, cert, design["proved"][real])
        print(f"proved for {real}: gains, sensitivity, starts, limits of {len(t['members'])} observers; confidence of "
              "the thresholds, not the runs behind them")
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
