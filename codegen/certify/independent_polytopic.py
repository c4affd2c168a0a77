"""Polytopic observers, checked again: thresholds with rounding, energy gain and contraction, the constants of the C.

Standard library only, nothing of residua imported; exact fractions. For the recursion of ``independent_pairs.py`` a set
|r_k eb| <= b_k is kept where each r_k N_j is a combination of the rows, given by the certificate, plus a rest that
counts by magnitude, at every pair of vertices or with weights that are near each other (``independent_near.py``). Every
row of the table must hold M r from there. A quadratic function of eb and x pays for the energy of the error at every
pair of vertices. The claims of a law beside the observer are not looked at.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, positive, sub  # noqa: E402 - stands beside this file
from independent_blend import check_source  # noqa: E402
from independent_drift import Drift, largest  # noqa: E402
from independent_filter import EPS, combined, up  # noqa: E402
from independent_formula import unknown  # noqa: E402
from independent_near import Near  # noqa: E402
from independent_pairs import Errors, Plant, add, beside, scaled, transposed, unit  # noqa: E402
from independent_sector import read_plant  # noqa: E402
from independent_weights import check_weights  # noqa: E402


def check_thresholds(errors, p, cert, shares=None):
    """All rows of the table, and the bounds that init and a restart begin with."""
    t, plant, h = errors.t, errors.plant, errors.t["h"]
    rows, b, n = exact(cert["rows"]), [float(x) for x in cert["bounds"][0]], len(errors.kept)
    demand(rows[:n] == unit(n) and len(b) == len(rows) and min(b) >= 0, "the unit rows, bounds")
    pushes = errors.pushes()
    maps, shown, held = [], [], exact(b)
    demand(len(cert["carry"]) == len(cert["out"]) == len(pushes), "combinations of every pair")
    for (N, W, seen, room), carry, out in zip(pushes, cert["carry"], cert["out"]):
        maps.append((combined(rows, mul(rows, N), carry), [sum(map(abs, row), F(0)) for row in mul(rows, W)]))
        shown.append(([[up(a) for a in row] for row in combined(rows, seen, out)], [*map(up, room)]))
    near = None
    if "near" in cert:
        unknown(shares is None)
        near = Near(errors, rows, shares, cert["near"]["sees"])

    def times(A, v, c, wide):
        return [(sum([a * x for a, x in zip(row, v)]) + e) * wide for row, e in zip(A, c)]

    def after(maps, near, v, wide):
        each = [times(A, v, c, wide) for A, c in maps]
        return near.smaller(each, v, wide) if near else largest(each)

    for k, (a, c) in enumerate(zip(after(maps, near, held, 1), held)):
        demand(a <= c, f"row {k} of the set is not kept")
    maps, near = [([[up(a) for a in row] for row in A], [*map(up, c)]) for A, c in maps], near and near.floats()
    wide = 1 + (len(rows) + 8) * EPS

    T1E, last, shift = mul(errors.T1, plant.E), len(h) - 1, t["shift"]
    demand(t["start"] in (0, last) and 0 <= shift < 16, "rows of the table")
    starts = []
    for box, lo, hi in ((plant.box["x0"], t["z0"], t["z0"]), (plant.box["x"], t["z_lo"], t["z_hi"])):
        at, half = ([(F(hi[k]) + s * F(lo[k])) / 2 for k in errors.kept] for s in (1, -1))
        far = [abs(sum((a * m for a, (m, _) in zip(row, box)), -z)) + sum((abs(a) * s for a, (_, s) in zip(row, box)),
                                                                          r) for row, z, r in zip(T1E, at, half)]
        starts.append([up(sum((abs(a) * f for a, f in zip(row, far)), F(0))) for row in rows])
    first, bounds = starts
    demand(all(x <= y for x, y in zip(first, b if t["start"] else bounds)), "the initial box is not within its row")
    demand(all(a >= c and d <= e for (a, d), (c, e) in zip(p["x0"], p["x"])), "the initial box leaves the range")
    for name in ("z0", "z_mid"):
        demand(all(a <= z <= c for a, z, c in zip(t["z_lo"], t[name], t["z_hi"])), f"{name} within its limits")
    for k in range((last << shift) + 1):
        settled = k == last << shift
        demand(not settled or all(x <= y for x, y in zip(bounds, b)), "the last row comes too early")
        needed = largest([times(A, b if settled else bounds, room, wide) for A, room in shown])
        demand(all(x <= y for x, y in zip(needed, h[k >> shift])), f"threshold row {k >> shift}")
        bounds = after(maps, near, bounds, wide)


def check_energy(errors, cert, channel, first=0):
    """Level and contraction at every pair of vertices; z of the channel "state" is of the states from the first on."""
    plant, proof, n = errors.plant, cert["energy"], len(errors.F[0])
    level, P1, P2 = F(proof["level2"]), exact(proof["P1"]), exact(proof["P2"])
    demand(F(proof["gamma"]) ** 2 >= level >= 0 and cert["level"] == proof["gamma"] >= 0, "the claimed level")
    demand(all(transposed(P) == P and positive(P) for P in (P1, P2)), "P1, P2 > 0")
    of_u, of_d = plant.size["u"], plant.size["w"] + plant.size["v"]
    lost, none = sub(unit(n), errors.seen), [[F(0)] * len(of_u)]
    if "M" in proof:
        demand(exact(proof["M"]) == errors.M, "the weight of the residual")
        z = beside(mul(errors.M, errors.C), mul(errors.M, errors.r_x), none * len(errors.M), mul(errors.M, errors.r_d))
    else:
        of_y = [float(a) for a in plant.size["y"]]
        H = [[F(float(a) / s) for a in row] for row, s in zip(plant.C, of_y)] if channel == "residual" else [
            [F(1 / float(s)) * (i == j) for j in range(n)] for i, s in enumerate(plant.size["x"]) if i >= first]
        J = [[F(float(a) / s) for a in row] for row, s in zip(plant.Dd, of_y)] if channel == "residual" else [
            [F(0)] * len(of_d) for _ in H]
        z = beside(H, mul(H, lost), none * len(H), sub(J, mul(mul(H, errors.T2), plant.Dd)))

    def in_units(A):
        return [row[:2 * n] + [a * s for a, s in zip(row[2 * n:], of_u + of_d)] for row in A]

    def zero_of(S, factor, rows):
        zero = mul(exact(factor), rows)
        return add(S, zero, transposed(zero))

    z, St = in_units(z), transposed(plant.S)
    before, size = mul(mul(transposed(plant.E), P2), plant.E), 2 * n + len(of_u) + len(of_d)
    own = mul(mul(transposed(errors.Ee), P1), errors.Ee)
    for i, j in product(range(len(plant.A)), range(len(errors.F))):
        if any((i ^ j) >> k & 1 for k in plant.tied):
            continue
        e, tie = in_units(beside(errors.N[j], *errors.terms(i, j))), in_units(errors.ties(i, j))
        x = in_units(beside([[F(0)] * n for _ in range(n)], *(flow[i] for flow in plant.flow)))
        S = add(mul(mul(transposed(e), P1), e), mul(mul(transposed(x), P2), x), mul(transposed(z), z))
        S = zero_of(S, proof["R"], mul(St, x)) if St else S
        S = zero_of(S, proof["Re"], tie) if tie else S
        for k in range(size):
            for m in range(n):
                S[k][m] -= own[k][m] if k < n else 0
                S[k][n + m] -= before[k - n][m] if n <= k < 2 * n else 0
            S[k][k] -= level if k >= 2 * n else 0
        demand(positive(scaled(-1, S)), f"energy gain, plant at vertex {i}, observer at {j}")
    for j, N in enumerate(errors.N):
        S, tie = sub(mul(mul(transposed(N), P1), N), scaled(F(proof["contraction"]) ** 2, own)), errors.ties(0, j)
        S = zero_of(S, proof["Rc"], [row[:n] for row in tie]) if tie else S
        demand(proof["contraction"] >= 0 and positive(scaled(-1, S)), f"contraction at vertex {j}")


def check_ranges(t, p):
    """What the C accepts of inputs and measurements is what the plant file declares, but for rounding."""
    for name in "uy":
        for lo, hi, (a, b) in zip(t[name + "_lo"], t[name + "_hi"], p[name]):
            room = UNIT[t["real"]][0] * max(abs(a), abs(b))
            demand(abs(F(lo) - a) <= room and abs(F(hi) - b) <= room, f"range of {name}")


def check_form(proof, form, plant):
    """What the proof of the energy gain is about."""
    demand(proof["form"] == form and proof["time"] == "discrete", "form of the proof")
    period = proof.get("period")
    demand((None if period is None else F(period)) == plant.T, "period")


def read_c(folder, design, record):
    """The C of a folder is that of its tables."""
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    check_source(text, header, design["tables"][record["real"]], record["prefix"])
    print(f"the constants of {record['prefix']}.c are those of the {record['real']} tables")


def main(folder, design, record):
    """Check a folder of a polytopic observer."""
    p = read_plant(design["plant"]["toml"])
    unknown(design["family"] != "polytopic" or p["known"] or p["theta"])
    plant = Plant(p)
    drift = Drift(plant) if plant.T is not None else None
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        T1 = cert.get("energy", cert)["T1"]
        unknown(isinstance(T1[0][0], list))
        # Thresholds that are no bounds, and claims of other kinds.
        unknown("waits" in cert["thresholds"] or "calibration" in cert)
        shares = check_weights(t, len(p["x"]) + len(p["u"]))
        check_ranges(t, p)
        errors = Errors(plant, t, T1, drift)
        if "energy" in cert:
            check_form(cert["energy"], "standard", plant)
            check_energy(errors, cert, design["options"].get("channel", "state"))
        check_thresholds(errors, p, cert["thresholds"], shares)
        print(f"proved for {real}: thresholds with rounding" + ", energy gain, contraction" * ("energy" in cert)
              + "; the law beside it is not checked here" * ("law" in t)
              + "; sensitivity to faults is not checked here" * ("band" in cert))
    read_c(folder, design, record)
