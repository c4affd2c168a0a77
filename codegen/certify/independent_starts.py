"""A table by size of the start and samples since, for one mode at a time, checked again; see ``independent_sets.py``.

Each mode is a plant of its own, each size a table of one stage (``independent_table.py``) that begins with it; the last
size must be every error that is possible.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact  # noqa: E402 - stand beside this file
from independent_sets import Error  # noqa: E402
from independent_table import Table, room, starts  # noqa: E402

OF_A_MODE = ("M", "G", "L", "N", "d", "A", "B", "a", "C", "D", "c")


def alone(e, q):
    """The recursion of one mode."""
    t = e.t | {name: e.t[name][q:q + 1] for name in OF_A_MODE} | {"shape": e.t["shape"] | {"dwell": 1}}
    return Error(e.modes[q:q + 1], t)


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, anywhere = e.t["shape"], starts(e, ranges, box0)[1]
    sizes = [*exact(z["sizes"]), anywhere]
    demand(len(sizes) == len(z["h"]) == len(z["hx"]), "as many parts of the table as sizes of a start, and one more")
    demand(all(len(s) == e.n and min(s) >= 0 for s in sizes), "sizes of a start")
    for q in range(len(e.modes)):
        one = alone(e, q)
        for k, size in enumerate(sizes):
            demand(len(z["h"][k]) == len(z["hx"][k]) == len(e.modes), "a part of the table per mode")
            rows = [room(one, *pair) for pair in zip(z["h"][k][q], z["hx"][k][q], strict=True)]
            part = {"boxes": [[[0] * e.n]], "coordinates": [[[int(i == j) for j in range(e.n)] for i in range(e.n)]],
                    "back": 0}
            Table(one, [[rows]], part, size).prove()
    for i, w in enumerate(cert["steady_box"]["width"]):
        last = [F(rows[-1][i]) for part in z["hx"] for rows in part]
        demand(F(w) >= 2 * max(last), f"ultimate width of state {i}")
    return "residuals and errors stay within the thresholds from a start on with rounding, boundedness"
