"""A continuous plant at its sampling period, enclosed again: the discrete plant that independent checks then look at.

Standard library only, nothing of residua imported; exact fractions. Over a period T, inputs held or within their rates,

    x+ = e^(A T) x + J B u + J Bw mean(w) + the rest,       J = int_0^T e^(A s) ds,

where the rest is what w has beside its mean, at most T^2/4 |A| e^(|A| T) |Bw| half, what inputs move in between, at
most T^2 phi_2(|A| T) |B| rate, and what the numbers below differ by from e^(A T) and J: those of TERMS terms, rounded
to float64, which is what the certificate is about. It is in a box, rounded up to 32 bits of the range of x: one
disturbance more per state.
"""

import math
import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, mul, read_plant, size, sub  # noqa: E402 - stands beside this file
from independent_driven import middle_plant  # noqa: E402
from independent_period import exponential, grown  # noqa: E402
from independent_step import read_plant as read_varying  # noqa: E402

TERMS, LOSS, READ = 14, F(1, 2**150), 1 + F(1, 2**22)  # READ: the firmware reads u in float32


def beside(*parts):
    """Matrices side by side."""
    return [sum(rows, []) for rows in zip(*parts)]


def unit(n, factor=1):
    """Unit matrix times a number."""
    return [[F(factor * (i == j)) for j in range(n)] for i in range(n)]


def taylor(A, T, lead, terms):
    """Sum of (A T)^k / (k + lead)! for k up to terms; lead is 0 or 1."""
    total, term = [[F(0)] * len(A) for _ in A], unit(len(A))
    for k in range(terms + 1):
        total = [[a + b for a, b in zip(*rows)] for rows in zip(total, term)]
        term = mul(term, grown(A, T / (k + 1 + lead)))
    return total


def chained(A, T, links):
    """phi_0 .. phi_links of A T, phi_k(z) = sum z^j / (j + k)!, by one exponential."""
    n = len(A)
    step = grown(A, T)
    if max(sum(map(abs, row)) for row in step) > 6:
        print("nothing is said about a period that is long for these modes", file=sys.stderr)
        sys.exit(2)
    rows = [beside(step, unit(n), *[unit(n, 0)] * (links - 1))] + [
        beside(*[unit(n, int(j == i + 1)) for j in range(links + 1)]) for i in range(1, links + 1)]
    whole = exponential(sum(rows, []), F(1))[:n]
    return [[row[k * n:(k + 1) * n] for row in whole] for k in range(links + 1)]


def near(M):
    """Entries rounded to float64."""
    return [[F(float(x)) for x in row] for row in M]


def apart(M, N, sizes):
    """Largest (M - N) x over |x| <= sizes."""
    return [size(row, sizes) for row in sub(M, N)]


def largest(bounds):
    """Largest magnitudes."""
    return [max(abs(a), abs(b)) for a, b in bounds]


def enclosed(p, T, x, u, rates, f=()):
    """A mode in discrete time; x, u, f: largest magnitudes, f where the mode has a "Bf"."""
    A, B, Bw, n = p["A"], p["B"], p["Bw"], len(p["A"])
    size_of_A = [[abs(a) for a in row] for row in A]
    E, phi, _ = chained(A, T, 2)
    steep, _, later = chained(size_of_A, T, 2)
    J, w = grown(phi, T), largest(p["w"])
    held, short = (grown(taylor(A, T, 1, k), T) for k in (TERMS - 1, TERMS))
    out = {"A": near(taylor(A, T, 0, TERMS)), "B": near(mul(held, B)), "Bw": near(mul(short, Bw))}
    pushed = [sum((abs(b) * s for row in M for b, s in zip(row, sizes)), F(0)) for M, sizes in ((B, u), (Bw, w))]
    lost = LOSS * (sum(x) + (1 + T * T) * (sum(pushed) + size(sum(map(list, B), []), rates * n)))
    parts = [apart(E, out["A"], x), apart(mul(J, B), out["B"], [READ * s for s in u]),
             apart(mul(J, Bw), out["Bw"], w),
             [size(row, [(b - a) / 2 for a, b in p["w"]]) * T * T / 4 for row in
              mul(mul(steep, size_of_A), [[abs(b) for b in row] for row in Bw])],
             [size(row, rates) * T * T for row in mul(later, [[abs(b) for b in row] for row in B])]]
    if "Bf" in p:
        out["Bf"] = near(mul(short, p["Bf"]))
        parts.append(apart(mul(J, p["Bf"]), out["Bf"], f))
    bits = [F(2) ** (math.frexp(s)[1] - 32) for s in x]
    rest = [above(math.ceil((sum(values) + lost) / bit) * bit) for bit, values in zip(bits, zip(*parts))]
    return p | out | {"Bw": beside(out["Bw"], unit(n)), "w": [*p["w"], *((-r, r) for r in rest)]}


def above(x):
    """The least float64 that is not below a number."""
    near = float(x)
    return F(near if F(near) >= x else math.nextafter(near, math.inf))


def read_sampled(text):
    """As ``read_plant``; of a continuous plant modes in discrete time, bounded parameters as disturbances."""
    if tomllib.loads(text)["time"]["kind"] == "discrete":
        return read_plant(text)
    given, boxes, signals, T, late = read_varying(text)
    demand(not late and not any(s.get("measured", True) for s in signals["theta"]), "modes told late, or a parameter "
           "that is measured")
    return [enclosed(p, T, *sizes_of(signals)) for p in without_parameters(given, boxes, signals)], *boxes.values()


def without_parameters(given, boxes, signals):
    """Modes with middle matrices; what parameters do is one disturbance more per state."""
    x, u, _, _ = sizes_of(signals)
    modes = middle_plant(given, boxes["x"], [F(float(s) * float(READ)) for s in u])
    return [p | {"w": [(-above(b), above(b)) if k >= len(g["w"]) else (a, b) for k, (a, b) in enumerate(p["w"])]}
            for p, g in zip(modes, given)]


def sizes_of(signals):
    """Largest magnitudes of x and u, rates of u, and largest magnitudes of faults."""
    x, u, f = ([max(abs(F(float(b))) for b in s.get("range", [0])) for s in signals.get(k, [])] for k in "xuf")
    return x, u, [F(float(s.get("rate", 0))) for s in signals.get("u", [])], f


def of_filter(text, modes):
    """Modes as ``independent_filter`` has them, in discrete time; a disturbance in y is that of the sample, a noise."""
    given, boxes, signals, T, _ = read_varying(text)
    faults, out = tomllib.loads(text)["signals"].get("f", []), []
    for mode, p in zip(modes, without_parameters(given, boxes, signals)):
        found = enclosed(p | {"Bf": mode["Bf"][0]}, T, *sizes_of(signals | {"f": faults}))
        more = {k: [found[k]] for k in ("A", "B", "Bw", "Bf")} | {"w": largest(found["w"])}
        more["Dw"] = [[[F(0)] * len(found["w"]) for _ in p["C"]]]
        more |= {k: mode[k][:1] for k in ("C", "D", "Dv", "Df")}
        if any(any(row) for m in modes for row in m["Dw"][0]):
            more |= {"Dv": [beside(mode["Dv"][0], mode["Dw"][0])], "v": [*mode["v"], *mode["w"]]}
        out.append(mode | more)
    return out
