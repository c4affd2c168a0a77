"""An ellipsoid's tables, checked again; see ``independent_sets.py``.

E(g M X M' + g/(g-1) Q) holds M E(X) + E(Q) for g > 1. A sum of segments f z, |z| <= 1, lies in E(Q) with
Q = sum(t) sum f f'/t for any t > 0. The rounding of g M X M' is entrywise at most d m_i m_j trace, below a diagonal.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from math import isqrt
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, positive, sub  # noqa: E402 - stands beside this file
from independent_sets import check_boxes, magnitudes, times  # noqa: E402


def outer(columns, units):
    """Q of segments; t is their length in these units, but not next to nothing."""
    used = [c for c in columns if any(c)]
    n = len(units)
    length = [sum(((x / s) ** 2 for x, s in zip(c, units)), F(0)) for c in used]
    t = [F(float(x) ** 0.5) for x in length]
    t = [max(x, max(t) / 10**12) for x in t]
    return [[sum(t) * sum((c[i] * c[j] / x for c, x in zip(used, t)), F(0)) for j in range(n)] for i in range(n)]


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, u, tiny, n, m = e.t["shape"], e.u, e.tiny, e.n, e.m
    half = F(isqrt(n * 10**24) + 1, 10**12)  # above the square root of n
    check_boxes(e, ranges, box0, exact(z["spread"])[-1], half)
    size = [1 / F(w) for w in z["weight"]]  # squares of powers of two
    for s in size:
        demand(F(isqrt(s.numerator), isqrt(s.denominator)) ** 2 == s, "a weight of the trace is no square")
    root = [F(isqrt(s.numerator), isqrt(s.denominator)) for s in size]
    for kind, noise, factor, k, matrix in (("H", "F", "g", "k", e.M), ("Hb", "Fb", "gb", "kb", e.A),
                                           ("V", "V", "gr", "kr", e.C)):
        rows = m if kind == "V" else n
        units = e.ymax if kind == "V" else e.limit
        for q, A in enumerate(matrix):
            g, reach = F(z[factor][q]), times(magnitudes(A), root)
            demand(g > 1, f"{factor} of mode {q}")
            for i, r in enumerate(reach):
                need = rows * (2 * n + 6) * u * g * r * r * F(17, 16)
                demand(F(z[k][q][i]) >= need, f"{k}[{q}][{i}], the rounding of {kind}")
            most = max(F(1), *(abs(a) for row in A for a in row))
            small = rows * (g * (2 * n * n * most + 2 * n) + 4) * tiny
            box = e.residual_rest(q) if kind == "V" else e.rest(q, kind == "H")
            for o in range(len(e.gains)):
                columns = e.direct(q, o) if kind == "V" else e.step(q, o, noise == "F")
                columns = [list(c) for c in zip(*columns)] + [[b * (i == j) for j in range(rows)]
                                                              for i, b in enumerate(box)]
                S, Q = exact(z[kind][q][o]), outer(columns, units)
                lack = sub(S, [[g / (g - 1) * x for x in row] for row in Q])
                for i in range(rows):
                    lack[i][i] -= (rows + 4) * u * S[i][i] + small
                demand([list(r) for r in zip(*S)] == S and positive(lack), f"{kind} of mode {q}, origin {o}, does not "
                       "hold its noise")
    for a, b in (("a", "b"), ("ay", "by")):
        for slope, offset in zip((x for r in z[a] for x in r), (x for r in z[b] for x in r)):
            demand(4 * F(slope) * (F(offset) - 4 * tiny) >= (1 + 4 * u) ** 2, f"tangent {a}, {b} below the root")
    for o, s in enumerate(exact(z["spread"])):
        for i, h in enumerate(e.held(o)):
            need = h * (1 + u) + 2 * u * (e.box[i] + 2 * e.limit[i]) + 4 * tiny
            demand(s[i] >= need, f"spread[{o}][{i}] lacks {float(need - s[i]):.3g}")
    demand(F(z["slack"]) >= (40 if m <= 2 else 4 * m + 8) * u * F(17, 16) and F(z["floor"]) >= 64 * m**3 * tiny,
           "room of the membership test")
    demand(cert.get("steady_box") is None, "a steady box of an ellipsoid")
    return "error and residual stay in their ellipsoids with rounding, boundedness"
