"""Weights of plant and observer as far apart as the error allows, checked again; beside ``independent_polytopic.py``.

Standard library only, nothing of residua imported; exact fractions. With the weights g of the C over their sum, h those
of the plant at x and q_i its flow at vertex i, T1 (E x+) = sum_j g_j T1 q_j + sum_i (h_i - g_i) T1 q_i: plant and
observer at one vertex, and what is left over. Of a sector model h is a product of shares of premises, taken from x_hat
to x one after the other: each share changes by its slopes times |S (x - x_hat)|, what that does to a row is largest at
a corner of the other premises, and x - x_hat = (I - T1 E - T2 C) x + eb - T2 Dd d less what is rounded. How far g is
from h(x_hat) is read off the program of the C, whose shares must be premises cut to their bounds. Weights that are no
shares of powers of one variable are not known here: status 2.
"""

import sys
from copy import copy
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import combinations
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import UNIT, demand, exact, mul, sub  # noqa: E402 - stands beside this file
from independent_drift import largest, reaches, slopes, turned  # noqa: E402
from independent_filter import combined, up  # noqa: E402
from independent_formula import Formula, unknown  # noqa: E402
from independent_pairs import unit  # noqa: E402


def box_of(errors):
    """Ranges of every state, that of the plant and of the estimate together, and of every input."""
    t, off = errors.t, errors.rounded()[2]
    ranges = {k: list(zip(exact(t[k + "_lo"]), exact(t[k + "_hi"]))) for k in "zyu"}
    out = []
    for (a, c), row, e, (lo, hi) in zip(ranges["z"], errors.T2, off, errors.plant.ends):
        seen = [sorted((g * a, g * c)) for g, (a, c) in zip(row, ranges["y"])]
        out.append((min(lo, a - e + sum((s for s, _ in seen), F(0))), max(hi, c + e + sum((s for _, s in seen), F(0)))))
    return out + [(min(a, c), max(b, d)) for (a, b), (c, d) in zip(errors.plant.ends[len(out):], ranges["u"])]


class Share:
    """A value of the C: scale * (formula cut to lo, hi) + shift, all but an error."""

    def __init__(self, p, error=F(0), cut=(None, None), scale=F(1), shift=F(0)):
        self.p, self.error, self.cut, self.scale, self.shift = p, error, cut, scale, shift

    def most(self, box):
        """Largest magnitude, error and all."""
        ends = [c if c is not None else e for c, e in zip(self.cut, self.p.bounds(box))]
        return max(abs(self.scale * e + self.shift) for e in ends) + self.error

    @property
    def plain(self):
        """Whether it is a formula alone."""
        return self.cut == (None, None) and self.scale == 1 and not self.shift


def read(w, node, box, real, slips=None):
    """The share that a node of the program stands for; ``slips`` are errors of the inputs, None of one not known."""
    (u, tiny), inputs, size = UNIT[real], w["inputs"], len(box)
    first = inputs + len(w["constants"])
    if node < inputs:
        unknown(slips is not None and slips[node] is None)
        return Share(Formula.variable(node, size), F(0) if slips is None else slips[node])
    if node < first:
        return Share(Formula.of(w["constants"][node - inputs], size))
    name, *args = w["operations"][node - first]
    if name in ("select", "min"):
        if name == "select":
            unknown(w["operations"][args[0] - first] != ["gt", *args[1:]])
            args = args[1:]
        a, b = (read(w, k, box, real, slips) for k in args)
        end, limit = int(name == "min"), b.p.number
        unknown(limit is None or b.error or not b.plain or a.scale != 1 or a.shift or a.cut[end] is not None)
        demand(end == 0 or a.cut[0] is None or a.cut[0] <= limit, "bounds of a premise in the C")
        return Share(a.p, a.error, (a.cut[0], limit) if end else (limit, a.cut[1]))
    unknown(name not in ("add", "sub", "mul", "neg", "div"))
    a, *b = (read(w, k, box, real, slips) for k in args)
    if name == "neg":
        unknown(not a.plain)
        return Share(a.p * Formula.of(-1, size), a.error)
    (b,), sign = b, -1 if name == "sub" else 1
    for x, y in ((a, b), (b, a)):
        if not (a.plain and b.plain) and y.plain and y.p.number is not None and not y.error and name != "div" and (
                sign == 1 or x is a):
            c = y.p.number
            out = Share(x.p, x.error * abs(c), x.cut, x.scale * c, x.shift * c) if name == "mul" else Share(
                x.p, x.error, x.cut, x.scale, x.shift + sign * c)
            return Share(out.p, out.error + u * out.most(box) + tiny, out.cut, out.scale, out.shift)
    unknown(not (a.plain and b.plain))
    if name == "mul":
        out = Share(a.p * b.p, a.most(box) * b.error + b.most(box) * a.error)
    elif name == "div":
        lo, hi = b.p.bounds(box)
        least = max(lo, -hi) - b.error
        unknown(least <= 0)  # the C gives its largest number there
        out = Share(a.p / b.p, (a.error + a.most(box) / (least + b.error) * b.error) / least)
    else:
        out = Share(a.p + b.p if sign == 1 else a.p - b.p, a.error + b.error)
    return Share(out.p, out.error + u * out.most(box) + tiny)


def apart(share, premise):
    """Largest difference of a share of the C and that of a premise, at the same state."""
    key, lo, hi = premise
    unknown(not share.p.plain or set(share.p.n) != {key} or None in share.cut)
    c = share.p.n[key]
    cuts = zip(sorted(e / c for e in share.cut), sorted((lo, hi)))
    slope = share.scale * c
    return abs(slope) * max(abs(a - b) for a, b in cuts) + share.error + max(
        abs(slope * z + share.shift - (z - lo) / (hi - lo)) for z in (lo, hi))


def weights_apart(t, shares, premises, box, slips=None):
    """How much each weight of the C is off the plant's at the same state, at most."""
    (u, tiny), errors = UNIT[t["real"]], [F(0)]
    demand(len(shares) == len(premises), "a share of the weights for each premise")
    for k, (node, premise) in enumerate(zip(shares, premises)):
        off = apart(read(t["weights"], node, box, t["real"], slips), premise)
        upper = [e + off + (u + tiny if k else 0) for e in errors]
        errors = [e + a + u + tiny for e, a in zip(errors, upper)] + upper
    return errors


class Near:
    """What weights that differ add to rows: min(spread, sum_l (|S_l eb| + room_l) steep_l + off spread)."""

    def __init__(self, errors, rows, shares, sees):
        p, n = errors.plant, len(errors.F[0])
        premises, box, h = p.premises, box_of(errors), len(p.A)
        unknown(premises is None or any(sum(map(bool, key)) != 1 for key, _, _ in premises))
        y, u, x_hat = errors.rounded()[:3]
        still = x_hat if errors.drift is None else [a + b for a, b in zip(x_hat, errors.drift.moved)]
        lost, Dd = sub(unit(n), errors.seen), mul(errors.T2, p.Dd)
        moves = [[mul(rows, mul(errors.T1, M[i])) for M in p.flow] for i in range(h)]

        def differ(i, k):
            return reaches([(sub(a, b), p.box[name]) for a, b, name in zip(moves[k], moves[i], "xud")])

        self.spread = largest([differ(i, k) for i, k in combinations(range(h), 2)])
        functionals, self.room, self.steep, self.vertices = [], [], [], h
        for bit, premise in enumerate(premises):
            (k, slope), = slopes(premise, box).items()
            by = slope if premise[0][k] == 1 and k < n else F(1)  # a premise that is a state counts by its width
            row = [by * (j == k) for j in range(n)]
            functionals.append(row)
            steep = largest([differ(i, j) for i, j in turned(h, bit)])
            self.steep.append([a * slope / by for a in steep])
            far = reaches([(mul([row], lost), p.box["x"])])[0] + reaches([(mul([row], Dd), p.box["d"])])[0]
            far += sum((abs(a) * e for a, e in zip(mul([row], errors.T2)[0], y)), F(0))
            self.room.append(far + sum((abs(a) * e for a, e in zip(row, still)), F(0)) + (u[k - n] if k >= n else 0))
        # Once for the half of their differences, and for that of their sum from 1.
        self.off = sum(weights_apart(errors.t, shares, premises, box), F(0))
        self.sees = combined(rows, functionals, sees)

    def floats(self):
        """The same in floats, none smaller."""
        out = copy(self)
        out.off, out.spread, out.room = up(self.off), [*map(up, self.spread)], [*map(up, self.room)]
        out.steep, out.sees = ([[up(a) for a in row] for row in M] for M in (self.steep, self.sees))
        return out

    def smaller(self, each, b, wide):
        """Bounds of rows a sample later, given those of every pair of vertices: of these, or with near weights."""
        far = [(sum(a * x for a, x in zip(row, b)) + room) * wide for row, room in zip(self.sees, self.room)]
        own = largest(each[::self.vertices + 1])
        mixed = [min(s, (sum(f * a for f, a in zip(far, some)) + self.off * s) * wide)
                 for s, *some in zip(self.spread, *self.steep)]
        return [min(a, (c + m) * wide) for a, c, m in zip(largest(each), own, mixed)]
