"""A box's tables, checked again; see ``independent_sets.py``.

The half widths obey b+ = P b + g, the residual's are S b + rho. All terms are positive: a computed sum of n products
and a constant is at least (1 - u)^(n + 1) of the exact one, less what flushed numbers lose. The box is one of
T^-1 (x - x_hat): T^-1 M T stands for M, C T for C, and the bounds of x are R b, R >= |T|.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul  # noqa: E402 - stands beside this file
from independent_sets import check_boxes, magnitudes, times  # noqa: E402


def inverse(T):
    """Inverse by Gauss and Jordan."""
    n = len(T)
    rows = [[*row, *(F(i == j) for j in range(n))] for i, row in enumerate(T)]
    for k in range(n):
        p = next((i for i in range(k, n) if rows[i][k]), None)
        demand(p is not None, "coordinates without an inverse")
        rows[k], rows[p] = rows[p], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k])]
    return [row[n:] for row in rows]


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, u, tiny, n = {k: exact(v) for k, v in e.t["shape"].items()}, e.u, e.tiny, e.n
    keep, grow = (1 - u) ** (n + 1), (1 + u) ** (n + 2)

    T = z["T"]
    back, plain = inverse(T), all(T[i][j] == (i == j) for i in range(n) for j in range(n))
    most = max(e.limit) / min(max(abs(r[k]) for r in T) for k in range(n))  # of a half width in these coordinates

    def lost(row):
        return tiny * (2 * n + 2 + sum(row) + n * most)

    for name, exactly in (("R", T), ("Z", back)):
        for row, given in zip(exactly, z[name], strict=True):
            pairs = zip(row, given, strict=True)
            demand(all(g * (1 if plain else keep) >= abs(x) for x, g in pairs), f"{name} too small")
    for name, added, kind, matrix in (("P", "g", "F", e.M), ("Pb", "gb", "Fb", e.A), ("S", "rho", "V", e.C)):
        for q, A in enumerate(matrix):
            A = magnitudes(mul(A, T) if kind == "V" else mul(back, mul(A, T)))
            rest = e.residual_rest(q) if kind == "V" else times(magnitudes(back), e.rest(q, kind == "F"))
            for i, (row, given) in enumerate(zip(A, z[name][q], strict=True)):
                demand(all(p * keep >= a for a, p in zip(row, given, strict=True)), f"{name}[{q}][{i}] too small")
            for o in range(len(e.gains)):
                columns = e.direct(q, o) if kind == "V" else mul(back, e.step(q, o, kind == "F"))
                for i, (c, r, g) in enumerate(zip(columns, rest, z[added][q][o], strict=True)):
                    need = sum(map(abs, c)) + r + lost(z[name][q][i])
                    demand(g * keep >= need, f"{added}[{q}][{o}][{i}] lacks {float(need - g):.3g}")
    for o, s in enumerate(z["spread"]):
        for i, h in enumerate(e.held(o)):
            need = (h * (1 + u) + 2 * u * (e.box[i] + 2 * e.limit[i]) + 4 * tiny + lost(z["R"][i])) / keep
            demand(s[i] >= need, f"spread[{o}][{i}] lacks {float(need - s[i]):.3g}")
    check_boxes(e, ranges, box0, z["spread"][-1], F(1))
    for name in ("x", "x0"):
        half = [(F(b) - F(a)) / 2 for a, b in zip(e.t[name + "_lo"], e.t[name + "_hi"])]
        start = zip(times(z["R"], times(z["Z"], half)), z["spread"][-1], e.limit)
        demand(plain or all(r * grow**2 + s <= limit for r, s, limit in start), "limit below the set of a start")
    if cert.get("steady_box"):
        half = exact(cert["steady_box"]["half"])
        for q, P in enumerate(z["P"]):
            for i, stay in enumerate(times(P, half)):
                new = (stay + max(g[i] for g in z["g"][q]) + lost(P[i])) * grow
                demand(stay * grow < half[i] and new <= half[i], f"ultimate box, state {i}")
        for i, w in enumerate(cert["steady_box"]["width"]):
            room = 2 * u * (e.box[i] + e.limit[i]) + 4 * tiny
            wide = times(z["R"], half)[i] * (1 if plain else grow)
            demand(F(w) >= 2 * (wide + max(s[i] for s in z["spread"])) + room, f"ultimate width of state {i}")
    return "error and residual stay in their boxes with rounding, boundedness"
