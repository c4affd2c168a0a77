"""A point observer that sliding modes guide, checked again: what ``independent_sliding.py`` hands over to it.

Standard library only, nothing of residua imported; exact fractions. Three parts: together they hold the state while the
decision is right, of which nothing is said:

1. the bounds of the estimator, to which those of the observer are cut (``independent_sliding``);
2. the error set of the observer, a step of a mode that is told (``independent_sets``);
3. what joins them: the observer accepts what the estimator accepts, and starts from the very range of the estimator.
"""

import re
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_follower as follower  # noqa: E402 - stands beside this file
import independent_sliding as sliding  # noqa: E402
import independent_source as source  # noqa: E402
from independent import demand  # noqa: E402
from independent_driven import check_ranges  # noqa: E402
from independent_sampled import read_sampled  # noqa: E402


def check_joint(t):
    """Ranges of both."""
    told = t["told"]
    check_ranges(t)
    demand(t["x_lo"] == told["x_lo"] and t["x_hi"] == told["x_hi"], "another range of x than that of the observer")


def check_source(text, header, t, prefix):
    """The C: functions of the observer hold its numbers, all the others are those of an estimator and of a start."""
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    inner, outer = follower.without_observer(bare, t, prefix)
    names = ("forward", "blind", "set_forward", "set_blind", "settle", "residual", "outside", "whole_range")
    demand(all(f"{prefix}_told_{name}(" in inner for name in names), "a function of the observer is missing")
    (point,) = re.findall(rf"\n\w[^\n]*{prefix}_point\([^;]*?\)\n{{.*?\n}}\n", outer, re.S)
    found = [source.numbers(body, t["real"]) for body in re.findall(source.TABLE, point, re.S)]
    demand(len(found) == (t["set"] == "starts"), "half widths of a start")
    for widest in found:
        follower.check_widest(inner, widest, t, prefix)
    rest = re.sub(source.TABLE, "", point, flags=re.S)
    demand(not any(source.numbers(rest, t["real"])), "a number where the observer is driven")
    sliding.check_source(outer.replace(point, "\n"), header, t, prefix)


def main(folder, design, record):
    """Check a folder."""
    sliding.check_design(design)
    seen = read_sampled(design["plant"]["toml"])
    for real, t in design["tables"].items():
        check_joint(t)
        says = follower.check_told(t, design["certificate"][real]["told"], seen)
        print(f"proved for {real}: while the decision is right, {says}")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
