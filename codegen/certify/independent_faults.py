"""Observers of states and faults, checked again: bounds of the residual around what the faults do, the C.

Standard library only, nothing of residua imported; exact fractions. The faults f are states without equations; how
they move is not asked. Plant and observer have the same weights and known terms but for rounding, so that they are at
one vertex: e = T1 E (x, f) - z of ``independent_pairs.py`` is a mean of e+ = N_j e + W_j d, |d_i| <= 1. Columns of W_j
that the certificate does not name are put together, one for each row. Where

    [a P - N_j' P N_j,  -N_j' P W_j;  *,  D_j - W_j' P W_j] > 0,   P > 0,  D_j diagonal and >= 0,  tau = max trace D_j,

V = e' P e obeys V+ <= a V + tau, and |c e| <= sqrt(V c' P^-1 c). A step of a continuous plant is one of Euler but for
what ``independent_bend.py`` bounds; rows without a derivative hold at the sample.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, positive, sub  # noqa: E402 - stands beside this file
from independent_bend import bend  # noqa: E402
from independent_energy import surely_positive  # noqa: E402
from independent_formula import unknown  # noqa: E402
from independent_near import read, weights_apart  # noqa: E402
from independent_pairs import (  # noqa: E402
    Errors,
    Plant,
    beside,
    driven,
    reach,
    solved,
    transposed,
    unit,
)
from independent_polytopic import check_ranges, read_c  # noqa: E402
from independent_sector import read_plant  # noqa: E402
from independent_weights import check_weights  # noqa: E402

GRID = 2**70


def with_faults(p):
    """The plant with its faults behind the states, zero at the start, and known terms behind its inputs.

    The faults have a place behind the noise too, where they do nothing: columns of W are numbered with it.
    """
    n, m, k, none = len(p["x"]), len(p["u"]), len(p["f"]), F(0)
    places, size = [*range(n), *range(n + k, n + k + m)], n + k + m

    def tall(M):
        return M + [[none] * len(M[0]) for _ in range(k)]

    still = [[none] * k for _ in p["Dv"]]
    given = [[F(i == row) for row, _ in p["known"]] for i in range(n)]
    out = p | {"x": p["x"] + p["f"], "x0": p["x0"] + [(none, none)] * k, "C": beside(p["C"], p["Df"]),
               "v": p["v"] + p["f"], "Dv": beside(p["Dv"], still),
               "E": tall(beside(p["E"], [[none] * k] * n)), "vertices": [
        {"A": tall(beside(v["A"], v["Bf"])), "B": tall(beside(v["B"], given)), "Bw": tall(v["Bw"])}
        for v in p["vertices"]]}
    out["known"] = [term.moved(places, size) for _, term in p["known"]]
    unknown(p["premises"] is None)
    out["premises"] = [(key[:n] + (0,) * k + key[n:], lo, hi) for key, lo, hi in p["premises"]]
    ends = out["x"] + p["u"]
    out["u"] = p["u"] + [term.range(ends) for term in out["known"]]
    return out


class FaultErrors(Errors):
    """The recursion of e at every vertex, on the numbers of the tables."""

    def __init__(self, p, t, shares, T1, moved):
        super().__init__(Plant(p), t, T1)
        self.faults, self.moved, real = t["faults"], moved, t["real"]
        u, tiny = UNIT[real]
        own = [beside(*(M[j] for M in (self.F, self.G, self.K)), self.known) for j in range(len(self.F))]
        slips = []
        for k, row in enumerate(self.T2):  # an estimate that is an output, and nothing else at any sample
            at = [i for i, a in enumerate(row) if a]
            still = not any(any(g[k]) for g in own) and t["z0"][k] == t["z_mid"][k] == 0
            alone = still and len(at) == 1 and row[at[0]] == 1
            same = alone and p["C"][at[0]] == unit(len(self.T2))[k] and not any(p["Dv"][at[0]])
            slips.append(u * max(map(abs, p["y"][at[0]])) + tiny if same else None)
        ends = p["x"] + p["u"][:len(t["u_lo"])]
        slips += [u * max(map(abs, pair)) + tiny for pair in ends[len(slips):]]
        self.off = weights_apart(t, shares, p["premises"], ends, slips)
        self.off_known = []
        for node, term in zip(t["weights"]["results"][len(self.F):-1], p["known"], strict=True):
            found = read(t["weights"], node, ends, real, slips)
            unknown(not found.plain)
            self.off_known.append(found.error + max(map(abs, (found.p - term).range(ends))))
        self.told = [max(map(abs, pair)) + off for pair, off in zip(p["u"][len(t["u_lo"]):], self.off_known)]
        self.slips, says = self.rounded(), [own for _, own in self.says()]
        self.left = [sum((e * m for e, (_, m) in zip(self.off, own)), F(0)) for own in says]

    def terms_of(self, j):
        """N_j and the columns of W_j."""
        p, n, left = self.plant, len(self.F[0]), self.left
        y, u, x_hat, r, _, z = self.slips
        of_y = sub(mul(self.F[j], self.T2), mul(self.K[j], self.passed))
        own = [(of_y, y), (self.G[j], u), (self.known, self.off_known), (self.N[j], x_hat), (self.K[j], r),
               (unit(n), z), (unit(n), left)]
        own += [([row[:len(self.moved)] for row in self.T1], self.moved)] if p.T is not None else []
        return self.N[j], driven(zip(self.terms(j, j), (p.box["x"], p.box["u"], p.box["d"])), own)

    def room(self):
        """What else than e is in r less what the faults are in y."""
        p, count = self.plant, len(self.F[0]) - self.faults
        y, _, x_hat, r, *_ = self.slips
        of_x = [[a - (b if k >= count else 0) for k, (a, b) in enumerate(zip(*rows))] for rows in zip(self.r_x, p.C)]
        return [reach(a + b, p.box["x"] + p.box["d"]) + e + sum(
            (abs(c) * m for row, some in zip(more, (y, x_hat)) for c, m in zip(row, some)), F(0))
            for a, b, e, *more in zip(of_x, self.r_d, r, self.passed, self.C)]


def together(W, kept):
    """Some columns, as doubles, and one for each row of the rest."""
    demand(sorted(set(kept)) == kept and all(0 <= k < len(W[0]) for k in kept), "columns of what drives the error")
    out = []
    for i, row in enumerate(W):
        near = [F(float(row[k])) for k in kept]
        left = sum(map(abs, row), F(0)) + sum((abs(row[k] - a) - abs(row[k]) for k, a in zip(kept, near)), F(0))
        out.append(near + [F(float(left)) * (1 + F(1, 2**50)) * (i == k) for k in range(len(W))])
    return out


def check_kept(errors, cert):
    """The ellipsoid at every vertex; P, the share and what drives V at most."""
    P, share, tau, n = exact(cert["P"]), F(cert["share"]), F(0), len(errors.F[0])
    demand(len(P) == n and transposed(P) == P and positive(P) and 0 <= share < 1, "P > 0, 0 <= share < 1")
    demand(len(cert["D"]) == len(cert["kept"]) == len(errors.F), "a D for every vertex")
    for j, (kept, D) in enumerate(zip(cert["kept"], map(exact, cert["D"]))):
        N, W = errors.terms_of(j)
        both = beside(N, together(W, kept))
        demand(len(both[0]) == n + len(D) and min(D) >= 0, f"D of vertex {j}")
        S = mul(transposed(both), mul(P, both))
        S = [[(share * P[a][b] if a < n and b < n else F(0)) + (D[a - n] if a == b and a >= n else F(0)) - e
              for b, e in enumerate(row)] for a, row in enumerate(S)]
        demand(surely_positive(S), f"the ellipsoid of the error is not kept at vertex {j}")
        tau = max(tau, sum(D, F(0)))
    return P, share, tau


def check_bounds(errors, p, cert):
    """All rows of the table, and what init and a restart begin with."""
    t, h = errors.t, exact(errors.t["h"])
    P, share, tau = check_kept(errors, cert)
    last, shift, level = len(h) - 1, t["shift"], F(cert["level"])
    demand(0 <= t["start"] <= last and 0 <= shift < 16, "rows of the table")
    demand(share * level + tau <= level, "the last level is not kept")
    demand(all(a >= c and d <= e for (a, d), (c, e) in zip(p["x0"], p["x"])), "the initial box leaves the range")
    for name in ("z0", "z_mid"):
        demand(all(a <= z <= c for a, z, c in zip(t["z_lo"], t[name], t["z_hi"])), f"{name} within its limits")
    T1E, firsts = mul(errors.T1, errors.plant.E), []
    for box, lo, hi in ((errors.plant.box["x0"], t["z0"], t["z0"]), (errors.plant.box["x"], t["z_lo"], t["z_hi"])):
        at, far = ([(F(b) + s * F(a)) / 2 for a, b in zip(lo, hi)] for s in (1, -1))
        G = [[sum((a * m for a, (m, _) in zip(row, box)), -z), *(a * half for a, (_, half) in zip(row, box)),
              *(b * (i == k) for k, b in enumerate(far))] for i, (row, z) in enumerate(zip(T1E, at))]
        firsts.append(sum((abs(a) for row in mul(transposed(G), mul(P, G)) for a in row), F(0)))
    first, now = firsts
    count, levels = last << shift, [now]
    for _ in range(count):
        levels.append(F(-((-(share * levels[-1] + tau) * GRID) // 1), GRID))
    demand(first <= (level if t["start"] == last else levels[t["start"] << shift]), "the initial box leaves its level")
    demand(levels[count] <= level, "the last row comes too early")
    rows, room = errors.C, errors.room()
    unit_bounds = [sum((a * b for a, b in zip(row, x)), F(0)) for row, x in zip(rows, transposed(
        solved(P, transposed(rows))))]
    for k, now in enumerate([*levels[:count], level]):
        for i, (size, more, given) in enumerate(zip(unit_bounds, room, h[min(k >> shift, last)])):
            demand(given >= more and (given - more) ** 2 >= now * size, f"bound {i} of row {min(k >> shift, last)}")


def main(folder, design, record):
    """Check a folder of an observer of states and faults."""
    if any("energy" in cert for cert in design["certificate"].values()):
        import independent_estimate  # which rests on this file
        independent_estimate.main(folder, design, record)
        return
    p = read_plant(design["plant"]["toml"])
    unknown(design["family"] != "polytopic" or p["theta"] or any("law" in t for t in design["tables"].values()))
    whole, moved = with_faults(p), bend(p) if p["period"] is not None else None
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        unknown("share" not in cert["thresholds"] or t["M"] != unit(len(t["M"])))
        demand(t["faults"] == len(p["f"]) and len(t["known"][0]) == len(p["known"]), "faults and known terms")
        shares = check_weights(t, len(whole["x"]) + len(p["u"]))
        check_ranges(t, p)
        far = None if moved is None else [p["period"] ** 2 / 2 * b for b in moved]
        errors = FaultErrors(whole, t, shares, cert["T1"], far)
        check_bounds(errors, whole, cert["thresholds"])
        print(f"proved for {real}: bounds of the residual around the faults, with rounding")
    read_c(folder, design, record)
