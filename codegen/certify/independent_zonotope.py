"""A zonotope's tables, checked again; see ``independent_sets.py``.

The error is in H z + box(e less the rounding of a box's sum). A step takes M H, with the columns beyond the kept ones
summed to a box, and adds F: so ``e`` must hold the rest, what F lacks, and the rounding of M H and of that sum. Where
the box is in other coordinates, ``independent_oblique.py`` says what takes the place of that sum.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, sub  # noqa: E402 - stands beside this file
from independent_oblique import Turn, check_kept  # noqa: E402
from independent_sets import check_boxes, magnitudes, times  # noqa: E402


def check(e, cert, ranges, box0):
    """All conditions of one number type; return what they prove."""
    z, u, tiny, n, m = e.t["shape"], e.u, e.tiny, e.n, e.m
    given = {k: exact(z[k]) for k in ("e", "spread", "rho")}
    Fs, Fb = ([[lists(o, n) for o in q] for q in exact(z[k])] for k in ("F", "Fb"))
    V = [[lists(o, m) for o in q] for q in exact(z["V"])]
    columns, noises = z["order"] + len(Fs[0][0][0]), len(V[0][0][0])
    demand(z["order"] == cert["order"] >= n, "order")
    demand(z["key"] in ("squared", "girard"), "key of the columns")
    # A row's computed sum is at most its limit, hence the exact one at most:
    rows = [(limit + (columns + 1) * tiny) / (1 - u) ** (columns + 1) for limit in e.limit]
    grow = (1 + u) ** (columns + 2) - 1
    chain = [grow * (s + b) + (columns + 2) * 2 * tiny for s, b in zip(rows, given["e"])]
    turn = Turn(e, z, rows, given["e"], columns)
    summed = [F(0)] * n if turn.oblique else chain  # the rounding of a box's sum that e has to hold
    carried = rows if turn.oblique else [(1 + grow) * (s + b) + c for s, b, c in zip(rows, given["e"], chain)]

    def carry(M, q):
        return [((1 + u) ** n - 1) * a + 2 * n * columns * tiny for a in times(magnitudes(M[q]), carried)]

    found = columns_of(e)

    def off(stored, kind, q):
        lack = []
        for o, S in enumerate(stored[q]):
            demand(len(S[0]) == len(found[kind][q, o][0]), f"columns of {kind}")
            lack.append([sum(r, F(0)) for r in magnitudes(sub(S, found[kind][q, o]))])
        return [max(x) for x in zip(*lack)]

    for q in range(len(e.modes)):
        for M, stored, kind in ((e.M, Fs, "F"), (e.A, Fb, "Fb")):
            need = zip(e.rest(q, kind == "F"), carry(M, q), off(stored, kind, q), summed, turn.lack(q, kind == "F"))
            for i, (parts, b) in enumerate(zip(need, given["e"])):
                demand(b >= sum(parts), f"e[{i}] lacks {float(sum(parts) - b):.3g} in mode {q}")
        need = zip(e.residual_rest(q), times(magnitudes(e.C[q]), given["e"]), carry(e.C, q), off(V, "V", q))
        for i, (parts, b) in enumerate(zip(need, given["rho"][q])):
            demand(b >= sum(parts), f"rho[{q}][{i}] lacks {float(sum(parts) - b):.3g}")
    for o, s in enumerate(given["spread"]):
        for i, (h, b, c) in enumerate(zip(e.held(o), given["e"], chain)):
            need = h + b + c + u * (e.box[i] + e.limit[i]) + 2 * tiny
            demand(s[i] >= need, f"spread[{o}][{i}] lacks {float(need - s[i]):.3g}")
    terms = columns + noises
    demand(F(z["slack"]) >= (terms + 3 * m + 8) * u * F(17, 16), "slack of the membership test")
    demand(F(z["floor"]) >= 2 * (terms + 2) * (m + 1) * tiny, "floor of the membership test")
    check_boxes(e, ranges, box0, given["spread"][-1], F(1))
    says, half = "boundedness", exact((cert.get("steady_box") or {}).get("half", []))
    if half and ("boxes" in cert or turn.oblique):
        demand("boxes" in cert, "no boxes that the set keeps")
        pushed = [[max(x) for x in zip(*([sum(map(abs, row)) for row in S] for S in Fs[q]))] for q in range(len(Fs))]
        pushed = [[sum(x) for x in zip(f, carry(e.M, q), turn.lack(q, True))] for q, f in enumerate(pushed)]
        says += " " + check_kept(turn, cert["boxes"], pushed, half)
    elif half:
        for q, M in enumerate(e.M):
            stay = times(magnitudes(M), half)
            boxed = [(1 + grow) * (h + b) + (columns + 2) * 2 * tiny for h, b in zip(half, given["e"])]
            moved = [(1 + u) ** n * b + 2 * n * columns * tiny for b in times(magnitudes(M), boxed)]
            for stored in Fs[q]:
                for i, row in enumerate(stored):
                    new = moved[i] + sum(map(abs, row))
                    demand(stay[i] < half[i] and new <= half[i], f"ultimate box, state {i}")
    for i, h in enumerate(half):
        width = F(cert["steady_box"]["width"][i])
        demand(width >= 2 * (h + max(s[i] for s in given["spread"])), f"ultimate width of state {i}")
    return f"error and residual stay in their zonotopes with rounding, {says}"


def lists(rows, count):
    """A matrix without columns is printed as nothing."""
    return rows or [[] for _ in range(count)]


def columns_of(e):
    """Exact columns by kind, mode and origin; those that are zero everywhere are not in the tables."""
    places = [(q, o) for q in range(len(e.modes)) for o in range(len(e.gains))]
    steps = {kind: {at: e.step(*at, kind == "F") for at in places} for kind in ("F", "Fb")}
    steps["V"] = {at: e.direct(*at) for at in places}
    for kinds in (("F", "Fb"), ("V",)):
        keep = [j for j in range(len(steps[kinds[0]][0, 0][0]))
                if any(row[j] for kind in kinds for S in steps[kind].values() for row in S)]
        for kind in kinds:
            steps[kind] = {at: [[row[j] for j in keep] for row in S] for at, S in steps[kind].items()}
    return steps
