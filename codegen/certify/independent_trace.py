"""Tables of an ellipsoid of least trace, checked again; see ``independent_sets.py``.

E((1 + 1/a) Z + (1 + a) S) holds E(Z) + E(S) for every a > 0, so for the one that the firmware finds; its two factors
are short of these by a few units at most. A root is of a number above ``least``: no factor exceeds 1 + 1/root(least).
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from math import isqrt
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul, positive, sub  # noqa: E402 - stands beside this file
from independent_ellipsoid import outer  # noqa: E402
from independent_sets import check_boxes, magnitudes, times, transposed  # noqa: E402


def square_root(x):
    """Exact root of a square of fractions."""
    root = F(isqrt(x.numerator), isqrt(x.denominator))
    demand(root * root == x, "a weight of the trace is no square")
    return root


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, u, tiny, n, m = e.t["shape"], e.u, e.tiny, e.n, e.m
    root = [square_root(1 / F(w)) for w in z["weight"]]
    root_y = [square_root(1 / F(w)) for w in z["weight_y"]]
    demand(F(z["least"]) == F(1, 4096) and [float(x) for x in z["a"]] == [0.5 / 16.0**j for j in range(-1, 5)]
           and [float(x) for x in z["b"]] == [16.0**j / 2 for j in range(-1, 5)], "tangents of the root")
    factor = 1 + 64 * F(1025, 1024)
    for kind, noise, k, matrix in (("H", "F", "k", e.M), ("Hb", "Fb", "kb", e.A), ("V", "V", "kr", e.C)):
        rows, units = (m, e.ymax) if kind == "V" else (n, e.limit)
        for q, A in enumerate(matrix):
            for i, r in enumerate(times(magnitudes(A), root)):
                need = rows * (2 * n + 10) * u * r * r * F(17, 16)
                demand(F(z[k][q][i]) >= need, f"{k}[{q}][{i}], the rounding of {kind}")
            most = max(F(1), *(abs(a) for row in A for a in row))
            small = rows * (factor * (2 * n * n * most + 2 * n) + 4) * tiny
            box = e.residual_rest(q) if kind == "V" else e.rest(q, kind == "H")
            for o in range(len(e.gains)):
                columns = e.direct(q, o) if kind == "V" else e.step(q, o, noise == "F")
                columns = [list(c) for c in zip(*columns)] + [[b * (i == j) for j in range(rows)]
                                                              for i, b in enumerate(box)]
                S = exact(z[kind][q][o])
                lack = sub(S, outer(columns, units))
                for i in range(rows):
                    lack[i][i] -= (4 * rows + 4) * u * S[i][i] + small
                demand(transposed(S) == S and positive(lack), f"{kind} of mode {q}, origin {o}, lacks noise")
    for name, exactly in (("scale", root), ("scale_y", root_y)):
        demand(all(F(s) >= (1 + 6 * u) * r for s, r in zip(z[name], exactly, strict=True)), f"{name} of the roots")
    for o, s in enumerate(exact(z["spread"])):
        for i, h in enumerate(e.held(o)):
            need = h * (1 + u) + 2 * u * (e.box[i] + 2 * e.limit[i]) + 4 * tiny
            demand(s[i] >= need, f"spread[{o}][{i}] lacks {float(need - s[i]):.3g}")
    demand(F(z["slack"]) >= (40 if m <= 2 else 4 * m + 8) * u * F(17, 16) and F(z["floor"]) >= 64 * m**3 * tiny,
           "room of the membership test")
    check_boxes(e, ranges, box0, exact(z["spread"])[-1], F(isqrt(n * 10**24) + 1, 10**12))
    if cert.get("steady_box"):
        check_steady(e, cert, z)
    return "error and residual stay in their ellipsoids of least trace with rounding, boundedness"


def check_steady(e, cert, z):
    """The trace comes below the certificate's: root(c T) + root(d) <= root(T), by (T - c T - d)^2 >= 4 c d T."""
    w, u, T = [F(x) for x in z["weight"]], e.u, F(cert["trace"])
    W = [[w[i] * (i == j) for j in range(e.n)] for i in range(e.n)]
    lost = 1 + F(1, 60) + 16 * e.n * u
    demand(T <= 2**36, "trace beyond the tangents")
    for q, (M, theta) in enumerate(zip(e.M, cert["shrink"], strict=True)):
        own = [[F(theta) * x for x in row] for row in W]
        demand(positive(sub(own, mul(transposed(M), mul(W, M)))), f"trace of mode {q} does not shrink")
        traces = [sum(w[i] * F(S[i][i]) for i in range(e.n)) for S in z["H"][q]]
        demand(all(abs(F(r) * s - 1) <= 16 * e.n * u for r, s in zip(z["r"][q], traces, strict=True)), f"r of mode {q}")
        c = lost * (F(theta) + 3 * sum(a * F(b) for a, b in zip(w, z["k"][q])))
        d = lost * max(traces) + 2**20 * e.tiny * sum(w)
        left = T - c * T - d
        demand(left >= 0 and left * left >= 4 * c * d * T, f"trace grows beyond its bound in mode {q}")
    for i, (half, width) in enumerate(zip(cert["steady_box"]["half"], cert["steady_box"]["width"], strict=True)):
        room = 2 * u * (e.box[i] + e.limit[i]) + 4 * e.tiny
        spread = max(F(s[i]) for s in z["spread"])
        least = F(1, 64) * square_root(1 / w[i])
        demand(w[i] * F(half) ** 2 >= T and F(width) >= 2 * (F(1001, 1000) * max(F(half), least) + spread) + room,
               f"ultimate width of state {i}")
