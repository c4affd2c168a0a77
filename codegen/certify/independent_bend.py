"""How fast the right side of E x' = f changes along a plant: what Euler steps leave out; ``independent_faults.py``.

Standard library only, nothing of residua imported; exact fractions. Over a period E x moves by the integral of f, an
Euler step by the period times f at the sample; row i of the difference is at most period^2/2 max |d f_i/dt|. With x'
from the rows of E x' = f + Bw w that have a derivative and from d f_i/dt = 0 of the others, d f_i/dt is a formula of
ranges: of x, u and their rates, each velocity by itself. The disturbance is none of it: its mean over a period is one.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from math import inf, nextafter
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import sup  # noqa: E402 - stands beside this file
from independent_formula import Formula, unknown  # noqa: E402
from independent_pairs import kernel, solved  # noqa: E402


def outward(ends):
    """Bounds as floats, none narrower."""
    return F(nextafter(float(ends[0]), -inf)), F(nextafter(float(ends[1]), inf))


def bend(p):
    """Largest |d f_i/dt| of every row; zero of rows without a derivative."""
    n, m, f, Bw = len(p["x"]), len(p["u"]), p["f_of"], p["vertices"][0]["Bw"]
    unknown(f is None or any(v["Bw"] != Bw for v in p["vertices"]))
    moving = [i for i, row in enumerate(p["E"]) if any(row)]
    # A combination of rows without derivatives would be an equation that is not looked at; w there lets x jump.
    unknown(len(kernel(p["E"])[0]) != n - len(moving) or any(any(row) for i, row in enumerate(Bw) if i not in moving))
    size = 3 * n + 2 * m  # x, u, the speed of each row, the rate of each input, x'
    f = [row.moved(range(n + m), size) for row in f]
    box = [*p["x"], *p["u"]] + [(F(0), F(0))] * (size - n - m)
    for i in moving:
        lo, hi = f[i].range(box)
        box[n + m + i] = outward((lo - sup(Bw[i], p["w"], -1), hi + sup(Bw[i], p["w"])))
    for k, rate in enumerate(p["rates"]):
        box[2 * n + m + k] = (-rate, rate)

    def variable(k):
        return Formula.variable(k, size)

    left, right = [], []
    for i, row in enumerate(f):
        outer = Formula.of(0, size)
        for k in range(m):
            outer += row.slope(n + k) * variable(2 * n + m + k)
        left.append([Formula.of(e, size) if i in moving else row.slope(j) for j, e in enumerate(p["E"][i])])
        right.append((variable(n + m + i) if i in moving else outer * Formula.of(-1, size), outer))
    order = sorted(range(n), key=lambda i: i not in moving)
    try:
        velocity = solved([left[i] for i in order], [[right[i][0]] for i in order])
    except StopIteration:
        unknown(True)
    for j, (x,) in enumerate(velocity):
        box[2 * n + 2 * m + j] = outward(x.range(box))
    out = [F(0)] * n
    for i in moving:
        change = right[i][1]
        for j in range(n):
            change += f[i].slope(j) * variable(2 * n + 2 * m + j)
        out[i] = max(map(abs, change.range(box)))
    return out
