"""The energy gain of a fault estimation filter, checked again: ``independent_filter.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. With z = [x; weights; xi], quadratic functions
V_a of the nodes a of the switching graph and d = disturbances, noises, inputs and faults in units of their sizes,

    g |d|^2 - |f_hat - W_f f|^2 + V_a(z) - V_b(z+) > 0      on every edge a -> b and at every corner of the parameters,

which gives sum |f_hat - W_f f|^2 <= g sum |d|^2 from rest. The left side is concave in the parameters, on which z+ and
f_hat depend affinely: what holds at the corners holds between them, however the parameters move.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from math import log2
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul, positive  # noqa: E402 - stands beside this file

SLIGHT = F(1, 2**40)


def automaton(count, add, drain, limit):
    """Mode of each node and edges (node, mode of the step, node): a mode with the fill of the leaky bucket."""
    fills, todo, moves = {0}, [0], []
    while todo:
        fill = todo.pop()
        for switch, level in ((False, fill), (True, fill + add)):
            if level <= limit:
                left = max(level - drain, 0)
                moves.append((fill, left, switch))
                if left not in fills:
                    fills.add(left)
                    todo.append(left)
    if not add:
        moves = [(0, 0, False), (0, 0, True)]
    nodes = [(q, fill) for q in range(count) for fill in sorted(fills)]
    at = {node: i for i, node in enumerate(nodes)}
    return [q for q, _ in nodes], [(at[q, a], q, at[r, b]) for q in range(count) for a, b, switch in moves
                                   for r in range(count) if (r != q) == switch]


def weight(given, channels):
    """A B C D of a weight num/den in falling powers of the shift, the same in every channel."""
    num, den = ([F(x) for x in (given or {"num": [1], "den": [1]})[k]] for k in ("num", "den"))
    den = den[next(i for i, x in enumerate(den) if x):]
    num = num[next((i for i, x in enumerate(num) if x), len(num)):]
    num, den = [x / den[0] for x in [F(0)] * (len(den) - len(num)) + num], [x / den[0] for x in den]
    n = len(den) - 1
    A = [[-x for x in den[1:]]] + [[F(i == j) for j in range(n)] for i in range(n - 1)] if n else []
    B, C = [[F(i == 0)] for i in range(n)], [[b - num[0] * a for a, b in zip(den[1:], num[1:])]]
    return [blocks(M, channels, cols) for M, cols in ((A, n), (B, 1), (C, n), ([[num[0]]], 1))]


def blocks(M, times, columns):
    """Block-diagonal."""
    return [[F(0)] * (columns * k) + row + [F(0)] * (columns * (times - 1 - k)) for k in range(times) for row in M]


def surely_positive(S):
    """Positive definite: L L' of floats, and what is left over has a dominant diagonal; else by elimination."""
    n = len(S)
    if any(S[i][i] <= 0 for i in range(n)):
        return False
    scale = [F(2) ** -round(log2(S[i][i]) / 2) for i in range(n)]
    S = [[a * p * q for a, q in zip(row, scale)] for row, p in zip(S, scale)]
    L = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            left = float(S[i][j] - (SLIGHT if i == j else 0)) - sum(a * b for a, b in zip(L[i][:j], L[j]))
            if i == j and left <= 0:
                return positive(S)
            L[i][j] = left ** 0.5 if i == j else left / L[j][j]
    rows = exact(L)
    rest = [[S[i][j] - size_of(rows[i][:j + 1], rows[j]) for j in range(i + 1)]
            for i in range(n)]
    rest = [[rest[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
    return all(2 * row[i] > sum(map(abs, row)) for i, row in enumerate(rest)) or positive(S)


def size_of(row, values):
    """Row times values."""
    return sum((a * b for a, b in zip(row, values)), F(0))


def known_sizes(values):
    """Sizes of unknowns; 1 where there is nothing."""
    return [v if v else F(1) for v in values]


class Loop:
    """z+ = move [z; d], error = out [z; d] of one mode, at one corner of the parameters."""

    def __init__(self, p, t, q, corner, units, target, colour):
        def at(key):
            return [[sum((s * e for s, e in zip(corner, entry[1:])), entry[0]) for entry in zip(*rows)]
                    for rows in zip(*p[key])]
        x, u, f = units
        d = [*p["w"], *p["v"], *u]
        A, B, C, D, Bw, Dw, Dv, Bf, Df = (at(k) for k in ("A", "B", "C", "D", "Bw", "Dw", "Dv", "Bf", "Df"))
        n, n_v, n_w, n_u = len(A), len(p["v"]), len(p["w"]), len(u)
        A = [[a * s / r for a, s in zip(row, x)] for row, r in zip(A, x)]
        C = [[c * s for c, s in zip(row, x)] for row in C]
        E = [[e * s / r for e, s in zip(a + [F(0)] * n_v + b, d)] for a, b, r in zip(Bw, B, x)]
        H = [[e * s for e, s in zip(a + b + c, d)] for a, b, c in zip(Dw, Dv, D)]
        U = [[F(0)] * (n_w + n_v + k) + [s] + [F(0)] * (n_u - 1 - k) for k, s in enumerate(u)]
        Ef = [[e * s / r for e, s in zip(row, f)] for row, r in zip(Bf, x)]
        Hf = [[e * s for e, s in zip(row, f)] for row in Df]
        M, G, L, K, Du, Dy = (exact(t[k][q]) for k in ("M", "G", "L", "K", "Du", "Dy"))
        (Af, B1, Cf, D1), (Ad, B2, Cd, D2) = target, colour
        a, b, s, n_d, n_f = len(Af), len(Ad), len(M), len(d), len(f)

        def row_of(of_x=None, of_f=None, of_d=None, of_s=None, d_in=None, f_in=None):
            parts = ((of_x, n), (of_f, a), (of_d, b), (of_s, s), (d_in, n_d), (f_in, n_f))
            return [v for part, count in parts for v in (part or [F(0)] * count)]
        coloured = [row_of(of_d=c, d_in=e) for c, e in zip(Cd or [None] * n_d, D2)]
        plain = [row_of(of_x=[F(i == j) for j in range(n)]) for i in range(n)]
        faults = [row_of(f_in=[F(i == j) for j in range(n_f)]) for i in range(n_f)]
        weights = [row_of(of_f=[F(i == j) for j in range(a)]) for i in range(a)]
        colours = [row_of(of_d=[F(i == j) for j in range(b)]) for i in range(b)]
        states = [row_of(of_s=[F(i == j) for j in range(s)]) for i in range(s)]
        inner = [row_of(d_in=[F(i == j) for j in range(n_d)]) for i in range(n_d)]
        y = total((C, plain), (H, coloured), (Hf, faults))
        seen = total((U, coloured)) if n_u else []
        self.move = [*total((A, plain), (E, coloured), (Ef, faults)), *total((Af, weights), (B1, faults)),
                     *total((Ad, colours), (B2, inner)), *total((M, states), (L, y), (G, seen))]
        found = total((K, states), (Dy, y), (Du, seen))
        wanted = total((Cf, weights), (D1, faults))
        self.out = [[e / r - w for e, w in zip(row, own)] for row, own, r in zip(found, wanted, f)]
        self.states = len(self.move)


def total(*products):
    """Sum of products of matrices; those with nothing between are zero."""
    parts = [mul(A, B) for A, B in products if A and B]
    return [[sum(e) for e in zip(*rows)] for rows in zip(*parts)] if parts else []


def check_energy(modes, ranges, t, cert, options):
    """The inequality on every edge and at every corner, and the level."""
    x, u, f = ([max(abs(F(float(a))), abs(F(float(b)))) for a, b in ranges[k]] for k in "xuf")
    x = [F(2) ** round(log2(s)) if s else F(1) for s in x]
    units, proof = (x, known_sizes(u), known_sizes(f)), cert["energy"]
    count = len(modes[0]["w"]) + len(modes[0]["v"]) + len(u)
    target, colour = weight(options.get("target"), len(f)), weight(options.get("colour"), count)
    nodes, edges = automaton(len(modes), *(cert[f"dwell_{k}"] for k in ("add", "drain", "limit")))
    P, g = exact(proof["P"]), F(proof["level2"])
    demand(len(P) == len(nodes) and F(cert["level"]) ** 2 >= g, "level")
    demand(all(p == [list(c) for c in zip(*p)] and surely_positive(p) for p in P), "a Lyapunov matrix")
    for q, p in enumerate(modes):
        for corner in product((-1, 1), repeat=len(p["A"]) - 1):
            loop = Loop(p, t, q, corner, units, target, colour)
            k, wide = loop.states, len(loop.move[0])
            demand(all(len(m) == k for m in P), "a Lyapunov matrix of another size")
            error = gram(loop.out, loop.out)
            for b in sorted({b for a, _, b in edges if nodes[a] == q}):
                after = gram(loop.move, mul(P[b], loop.move))
                for a in {a for a, _, to in edges if nodes[a] == q and to == b}:
                    S = [[(P[a][i][j] if i < k and j < k else g * (i == j and i >= k)) - error[i][j] - after[i][j]
                          for j in range(wide)] for i in range(wide)]
                    demand(surely_positive(S), f"the energy gain fails from node {a} to {b}, mode {p['name']}")


def gram(A, B):
    """A' B."""
    return mul([list(c) for c in zip(*A)], B)
