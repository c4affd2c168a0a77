"""The weights of a polytopic observer, as its C has them: in [0, 1], and they add up to 1.

Standard library only, nothing of residua imported; see ``independent_polytopic.py``. Weights that are no tree of
products are not known here: status 2.
"""

import struct
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand  # noqa: E402 - stands beside this file
from independent_formula import unknown  # noqa: E402

INF = float("inf")


def rounded(value, real):
    """The nearest number of the type; products and sums of two numbers of it are rounded once by that."""
    try:
        return struct.unpack("f", struct.pack("f", value))[0] if real == "float32" and abs(value) < INF else value
    except OverflowError:
        return INF if value > 0 else -INF


def check_weights(t, inputs):
    """Every weight in [0, 1], whatever the estimate; their sum 1 but for a rounding per level of the tree.

    Weights that are normalised are looked at by the C itself, and all the same where it finds them wrong. Returned are
    the shares that the others are products of, the first premise first.
    """
    w, real = t["weights"], t["real"]
    first = w["inputs"] + len(w["constants"])
    nodes = {first + k: op for k, op in enumerate(w["operations"])}
    ends = {k: (-INF, INF) for k in range(inputs)} | {inputs + k: (c, c) for k, c in enumerate(w["constants"])}
    demand(w["inputs"] == inputs, "inputs of the weights")

    def between(k):
        if k not in ends:
            ends[k] = found(nodes[k])
        return ends[k]

    def found(op):
        name, *args = op
        if name == "select":
            truth = nodes[args[0]]
            if truth == ["gt", *args[1:]]:  # the larger of both, the second where the first is no number
                (a, b), (c, d) = map(between, args[1:])
                return max(a, c), max(b, d)
            return -INF, INF
        if name not in ("add", "sub", "mul", "min", "neg"):
            return -INF, INF
        (a, b), (c, d) = (*map(between, args), (0.0, 0.0))[:2]
        if name == "min":
            return min(a, c), min(b, d)
        if name == "neg":
            return -b, -a
        if name == "mul":
            values = [0.0 if 0.0 in (x, y) else x * y for x in (a, b) for y in (c, d)]
            return rounded(min(values), real), rounded(max(values), real)
        part = nodes.get(args[1], [""])
        if name == "sub" and part[0] == "mul" and args[0] in part[1:]:  # w - w mu
            mu = between(part[1] if part[2] == args[0] else part[2])
            if a >= 0 and mu[0] >= 0 and mu[1] <= 1:
                return 0.0, b
        return (rounded(a - d, real), rounded(b - c, real)) if name == "sub" else (
            rounded(a + c, real), rounded(b + d, real))

    def partition(h):
        """Weights of a tree: the share of every level, by which it splits all weights before it."""
        half = len(h) // 2
        if len(h) == 1:
            unknown(w["constants"][h[0] - inputs] != 1 if inputs <= h[0] < first else True)
            return []
        unknown(len(h) % 2)
        lower, upper = h[:half], h[half:]
        before = [nodes.get(k, ["", "", ""])[1] for k in lower]
        mu = {upper[0]} if half == 1 else {next((a for a in nodes[u][1:] if a != b), None) if u in nodes else None
                                           for u, b in zip(upper, before)}
        unknown(len(mu) != 1 or any(nodes.get(k) != ["sub", b, u] for k, b, u in zip(lower, before, upper)))
        demand(half == 1 or all(nodes[u][0] == "mul" and b in nodes[u][1:] for u, b in zip(upper, before)),
               "weights that are products")
        return [*partition(before), *mu]

    results = w["results"][:len(t["F"])]  # known terms stand behind them
    given = [nodes.get(k, [""]) for k in results]
    if all(op[0] == "select" for op in given):
        check_found(given, nodes, dict(enumerate(w["constants"], inputs)), t)
        return None
    shares = partition(results)
    for k in results:
        a, b = between(k)
        demand(a >= 0 and b <= 1, "weights between 0 and 1")
    demand(2 * len(shares) * UNIT[real][0] <= (8 * len(t["F"]) + 4) * 2 * UNIT[real][0], "sum of the weights")
    demand(len(w["results"]) - 1 == len(t["F"]) + len(t.get("known", [[]])[0]), "a weight for each vertex")
    return shares


def check_found(given, nodes, constants, t):
    """Weights that are chosen where the C finds them to be numbers in [0, 1] that add up to 1; else they are equal."""
    eps, count = 2 * UNIT[t["real"]][0], len(t["F"])
    truths, todo = [], [given[0][1]]
    while todo:
        op = nodes[todo.pop()]
        todo += op[1:] if op[0] == "and" else []
        truths.append(op)
    weights = [op[2] for op in given]
    demand(len(given) == count and all(op[1] == given[0][1] for op in given), "a weight for each vertex, one choice")
    total = weights[0]
    for k in weights[1:]:
        total = next((n for n, op in nodes.items() if op == ["add", total, k]), None)
    for k, least, most in (*((k, 0, 1 + 4 * eps) for k in weights), (total, 1 - 4 * count * eps, 1 + 4 * count * eps)):
        lo, hi = ([F(constants[op[2]]) for op in truths if op[0] == name and op[1] == k and op[2] in constants]
                  for name in ("ge", "le"))
        demand(lo and hi and max(lo) >= least - eps and min(hi) <= most + eps, "what the C asks of its weights")
    demand(all(abs(F(constants[op[3]]) * count - 1) <= eps for op in given), "equal weights")
