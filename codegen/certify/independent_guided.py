"""Framers that sliding modes guide, checked again: what ``independent_sliding.py`` hands designs with "told" over to.

Standard library only, nothing of residua imported; exact fractions. Three parts: together they hold the state while the
decision is right, of which nothing is said:

1. the bounds of the estimator, to which the framers are cut (``independent_sliding``);
2. the framers of every mode, as where the mode is told (``independent_lpv`` where they have radii);
3. what joins them: framers accept what the estimator accepts, and are for the range from which they start.
"""

import re
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
import independent_driven as driven  # noqa: E402 - stands beside this file
import independent_sliding as sliding  # noqa: E402
from independent import demand  # noqa: E402
from independent_source import functions  # noqa: E402
from independent_step import read_plant  # noqa: E402


def check_joint(t):
    """Ranges of both, bounds of parameters without a mode."""
    told = t["told"]
    driven.check_ranges(t)
    driven.check_bounds(told)
    demand(t["x_lo"] == told["x_lo"] and t["x_hi"] == told["x_hi"], "another range of x than that of the framers")


def check_source(text, header, t, prefix):
    """The C: functions of the framers hold their numbers, all the others are those of an estimator."""
    told, bare = t["told"], re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    names = r"(?:told_\w+|theta_accepted)"
    own = functions(bare, prefix, names)
    demand(all(f"{prefix}_told_{name}(" in own for name in (
        "forward", "blind", "residual", *("to_x", "to_z") * ("change" in told))), "a map is missing")
    driven.check_accepted(bare, prefix, told)
    (driven.lpv if "vary" in told else driven.plain).check_source(own, told)
    for piece in re.findall(rf"\n\w[^\n]*{prefix}_{names}\([^;]*?\)\n{{.*?\n}}\n", bare, re.S):
        bare = bare.replace(piece, "\n")
    sliding.check_source(bare, header, t, prefix)


def main(folder, design, record):
    """Check a folder."""
    sliding.check_design(design)
    plant = read_plant(design["plant"]["toml"])
    for real, t in design["tables"].items():
        check_joint(t)
        driven.check_told(t, design["certificate"][real], plant)
        print(f"proved for {real}: the framers hold x while the decision is right")
    t = design["tables"][record["real"]]
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, t, record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")
    return 0
