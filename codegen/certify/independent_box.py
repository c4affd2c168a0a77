"""A box's tables, checked again; see ``independent_sets.py``.

The half widths obey b+ = P b + g, the residual's are S b + rho. All terms are positive: a computed sum of n products
and a constant is at least (1 - u)^(n + 1) of the exact one, less what flushed numbers lose.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact  # noqa: E402 - stands beside this file
from independent_sets import check_boxes, magnitudes, times  # noqa: E402


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, u, tiny, n = {k: exact(v) for k, v in e.t["shape"].items()}, e.u, e.tiny, e.n
    keep, grow = (1 - u) ** (n + 1), (1 + u) ** (n + 2)

    def lost(row):
        return tiny * (2 * n + 2 + sum(row) + sum(e.limit))

    for name, added, kind, matrix in (("P", "g", "F", e.M), ("Pb", "gb", "Fb", e.A), ("S", "rho", "V", e.C)):
        for q, A in enumerate(magnitudes(row) for row in matrix):
            rest = e.residual_rest(q) if kind == "V" else e.rest(q, kind == "F")
            for i, (row, given) in enumerate(zip(A, z[name][q], strict=True)):
                demand(all(p * keep >= a for a, p in zip(row, given, strict=True)), f"{name}[{q}][{i}] too small")
            for o in range(len(e.gains)):
                columns = e.direct(q, o) if kind == "V" else e.step(q, o, kind == "F")
                for i, (c, r, g) in enumerate(zip(columns, rest, z[added][q][o], strict=True)):
                    need = sum(map(abs, c)) + r + lost(z[name][q][i])
                    demand(g * keep >= need, f"{added}[{q}][{o}][{i}] lacks {float(need - g):.3g}")
    for o, s in enumerate(z["spread"]):
        for i, h in enumerate(e.held(o)):
            need = h * (1 + u) + 2 * u * (e.box[i] + 2 * e.limit[i]) + 4 * tiny
            demand(s[i] >= need, f"spread[{o}][{i}] lacks {float(need - s[i]):.3g}")
    check_boxes(e, ranges, box0, z["spread"][-1], F(1))
    if cert.get("steady_box"):
        half = exact(cert["steady_box"]["half"])
        for q, P in enumerate(z["P"]):
            for i, stay in enumerate(times(P, half)):
                new = (stay + max(g[i] for g in z["g"][q]) + lost(P[i])) * grow
                demand(stay * grow < half[i] and new <= half[i], f"ultimate box, state {i}")
        for i, w in enumerate(cert["steady_box"]["width"]):
            room = 2 * u * (e.box[i] + e.limit[i]) + 4 * tiny
            demand(F(w) >= 2 * (half[i] + max(s[i] for s in z["spread"])) + room, f"ultimate width of state {i}")
    return "error and residual stay in their boxes with rounding, boundedness"
