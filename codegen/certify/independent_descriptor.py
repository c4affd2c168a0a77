"""Observers that solve the algebraic equations themselves, checked again: thresholds, energy gain, contraction, the C.

Standard library only, nothing of residua imported; exact fractions. Of the states x_a have no derivative, x_m the rest.
With S' E = 0 and S' A_i = d_i V on x_a, d_i > 0, the equations of plant (weights h_i of the sample) and observer are

    x_a = sum_i g_i (P_i x_m + Q_i u + D_i d),   x_hat_a = sum_k g'_k (P'_k z_m + Q'_k u),    g_i = h_i d_i / sum h d

so x_a - x_hat_a is a mean of P'_k (x_m - z_m) + (P_i - P'_k) x_m + (Q_i - Q'_k) u + D_i d, and with T1 E x = x_m

    e_m+ = T1 (E x+) - F_j x_hat - G_j u + K_j r,    r = y - C x_hat,    x_hat = x - e.

The weights h of the observer and its g' are taken to be any two (the C makes g' of h by a division that no weights in
[0, 1] with a sum near 1 bring to its guard). All else is as in ``independent_polytopic.py``.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, mul, rounding, size, sub  # noqa: E402 - stands beside this file
from independent_drift import Drift, largest, reaches  # noqa: E402
from independent_formula import unknown  # noqa: E402
from independent_pairs import (  # noqa: E402
    Errors,
    Plant,
    add,
    beside,
    driven,
    off_one,
    reach,
    scaled,
    sizes,
    solved,
    transposed,
    unit,
)
from independent_polytopic import check_energy, check_form, check_ranges, check_thresholds, read_c  # noqa: E402
from independent_sector import read_plant  # noqa: E402
from independent_weights import check_weights  # noqa: E402

#: The least factor of the equations of a vertex that a division by their mean leaves sound.
LEAST = F(1, 2**60)


def columns(A, which):
    """Some columns of a matrix."""
    return [[row[k] for k in which] for row in A]


class Solved:
    """The plant's algebraic equations at every vertex, solved."""

    def __init__(self, plant):
        n, St = len(plant.E), transposed(plant.S)
        self.without = [k for k in range(n) if not any(row[k] for row in plant.E)]
        self.moving = [k for k in range(n) if k not in self.without]
        unknown(len(self.without) != len(plant.S[0]))
        tall = columns(plant.E, self.moving)
        self.T1 = solved(mul(transposed(tall), tall), transposed(tall))
        A, B, Bd = ([mul(St, M) for M in some] for some in (plant.A, plant.B, plant.Bd))
        blocks = [columns(M, self.without) for M in A]
        if not St:
            self.factors, self.P, self.Q, self.D = [F(1)] * len(A), *([[]] * len(A) for _ in range(3))
            return
        most, i, j = max((abs(a), i, j) for M in blocks for i, row in enumerate(M) for j, a in enumerate(row))
        V = next(M for M in blocks if abs(M[i][j]) == most)
        self.factors = [M[i][j] / V[i][j] for M in blocks]
        demand(all(d > 0 and scaled(d, V) == M for d, M in zip(self.factors, blocks)),
               "algebraic equations of the vertices that are no positive multiples of one another")
        back = solved(V, unit(len(V)))
        self.P, self.Q, self.D = ([mul(scaled(-1 / d, back), M) for d, M in zip(self.factors, some)]
                                  for some in ([columns(M, self.moving) for M in A], B, Bd))


class DescriptorErrors(Errors):
    """The recursion of e_m, pair by pair of the observer's weights, on the numbers of the tables."""

    def __init__(self, plant, t, known, drift=None):
        self.plant, self.t, self.real, self.drift, self.solved = plant, t, t["real"], drift, known
        self.T2, self.C, self.M, self.F, self.G, self.K = (exact(t[k]) for k in ("T2", "C", "M", "F", "G", "K"))
        n, self.kept, self.told, self.known = len(plant.E), known.moving, [], [[]] * len(plant.E)
        demand(not any(map(any, self.T2)) and t["algebraic"] == known.without, "the states that are solved for")
        self.T1, self.seen = known.T1, unit(n)
        self.P, self.Q, self.pivot = exact(t["P"]), exact(t["Q"]), exact(t["pivot"])
        demand(all(LEAST <= d <= 1 for d in self.pivot) and off_one(t) < F(1, 4), "factors of the solved equations")
        demand(not any(row[k] for P in self.P for row in P for k in known.without), "what is solved for is read")
        self.Ee = [row if k in known.moving else [F(0)] * n for k, row in enumerate(unit(n))]
        self.N = [self.whole(add(rows_of(F_, self.kept), mul(rows_of(K, self.kept), self.C)))
                  for F_, K in zip(self.F, self.K)]
        self.firsts = [k for k in range(len(self.F)) if all((self.P[k], self.Q[k]) != (self.P[i], self.Q[i])
                                                            for i in range(k))]

    def whole(self, rows):
        """Rows x_m among those of x, others zero."""
        given = iter(rows)
        return [next(given) if k in self.kept else [F(0)] * len(rows[0]) for k in range(len(self.Ee))]

    def terms(self, i, j):
        """Matrices of x, u and d in e+ over x - x_hat, rows of x."""
        p, (A, B, Bd) = self.plant, (mul(self.T1, flow[i]) for flow in self.plant.flow)
        F_, G, K = (rows_of(M[j], self.kept) for M in (self.F, self.G, self.K))
        x = add(A, scaled(-1, F_), mul(K, sub(p.C, self.C)))
        return self.whole(x), self.whole(sub(B, G)), self.whole(add(Bd, mul(K, p.Dd)))

    def ties(self, i, j):
        """The observer's algebraic equations less those of the plant, over e, x, u and d."""
        known, d, c = self.solved, self.pivot[j], self.solved.factors[i]
        pick = [unit(len(self.Ee))[k] for k in known.without]

        def spread(P):
            out = [[F(0)] * len(self.Ee) for _ in P]
            for row, given in zip(out, P):
                for k, a in zip(known.moving, given):
                    row[k] = a
            return out

        own, true = self.P[j], spread(known.P[i])
        return beside(scaled(d, sub(own, pick)), add(scaled(d - c, pick), scaled(c, true), scaled(-d, own)),
                      sub(scaled(c, known.Q[i]), scaled(d, self.Q[j])), scaled(c, known.D[i]))

    def estimates(self):
        """Rounding and largest magnitude of every entry of x_hat, with weights that do not add up to 1."""
        z, u, off = sizes(self.t, "z"), sizes(self.t, "u"), off_one(self.t)
        out = [rounding([(F(1), b)], self.real) for b in z]
        for row, k in enumerate(self.solved.without):
            each = [P[row] + Q[row] for P, Q in zip(self.P, self.Q)]
            same = [all(c == every[0] for c in every) for every in zip(*each)]
            own = [rounding([(F(0) if s else c, b) for s, c, b in zip(same, some, z + u)], self.real) for some in each]
            shared = [(c if s else F(0), b) for s, c, b in zip(same, each[0], z + u)]
            error, most = rounding([*shared, *((1 + off, m) for _, m in own)], self.real)
            out[k] = error + (1 + off) * max(e for e, _ in own) + off * max(m for _, m in own), most
        return out

    def mismatch(self, k):
        """Largest |(P_i - P'_k) x_m + (Q_i - Q'_k) u + D_i d| over the plant's vertices."""
        box, known, own = self.plant.box, self.solved, columns(self.P[k], self.kept)
        x = [box["x"][m] for m in self.kept]
        return largest([reaches([(sub(P, own), x), (sub(Q, self.Q[k]), box["u"]), (D, box["d"])])
                        for P, Q, D in zip(known.P, known.Q, known.D)])

    def pushes(self):
        """Per pair of the observer's vertices N, columns of what drives e_m, M r over e_m, and what else is in it."""
        p, at, a = self.plant, self.kept, self.solved.without
        y, u, x_hat, r, shown, z = self.rounded()
        change = [F(0)] * len(at) if p.T is None else [p.T * c for c in largest(
            [self.drift.of(mul(self.T1, M)) for M in p.A])]
        seen, lost, noise = mul(self.M, self.C), mul(self.M, sub(p.C, self.C)), mul(self.M, p.Dd)
        slip = [b + c for b, c in zip(y, r)]
        steady = [reach(a + d, p.box["x"] + p.box["d"]) + e + size(row, slip)
                  for a, d, e, row in zip(lost, noise, shown, self.M)]
        out = []
        for j in range(len(self.F)):
            steps, K, G = (rows_of(M[j], at) for M in (self.N, self.K, self.G))
            fed, left = mul(K, p.Dd), []
            for i in range(len(p.A)):
                of_x, of_u, of_d = (rows_of(M, at) for M in self.terms(i, j))
                left.append(reaches([(of_x, p.box["x"]), (of_u, p.box["u"]), (sub(of_d, fed), p.box["d"])]))
            left = [b + c for b, c in zip(largest(left), change)]
            for k in self.firsts:
                through, late = [row[:] for row in columns(unit(len(self.Ee)), at)], list(x_hat)
                for m, row, more, of_u in zip(a, columns(self.P[k], at), self.mismatch(k), self.Q[k]):
                    through[m] = row
                    late[m] += more + size(of_u, u)
                after = [a + z[m] for a, m in zip(left, at)]
                own = ((unit(len(at)), after), (K, y), (G, u), (K, r), (steps, late))
                room = [b + size(row, late) for b, row in zip(steady, seen)]
                out.append((mul(steps, through), driven([(fed, p.box["d"])], own), mul(seen, through), room))
        return out


def rows_of(A, rows):
    """Some rows of a matrix."""
    return [A[k] for k in rows]


def main(folder, design, record):
    """Check a folder of an observer that solves the algebraic equations."""
    p = read_plant(design["plant"]["toml"])
    unknown(design["family"] != "descriptor" or p["known"] or p["theta"])
    plant = Plant(p)
    known, drift = Solved(plant), Drift(plant) if plant.T is not None else None
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        unknown("waits" in cert["thresholds"] or "near" in cert["thresholds"] or "calibration" in cert)
        unknown("M" in cert["energy"] or "band" in cert or "law" in t)
        check_weights(t, len(p["x"]) + len(p["u"]))
        check_ranges(t, p)
        errors = DescriptorErrors(plant, t, known, drift)
        check_form(cert["energy"], "descriptor", plant)
        check_energy(errors, cert, design["options"].get("channel", "state"))
        check_thresholds(errors, p, cert["thresholds"])
        print(f"proved for {real}: thresholds with rounding, energy gain, contraction, the solved equations")
    read_c(folder, design, record)
