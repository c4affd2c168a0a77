"""Formulas of plant files as quotients of polynomials, exactly; ``independent_sector.py`` rests on it.

Standard library only, nothing of residua imported; exact fractions. A polynomial is {exponents: coefficient}. What is
bounded over a box is first bounded monomial by monomial; `largest` halves boxes where that is loose, and puts a
variable in which a formula only rises or falls to the better end of its box. Other functions are not read: status 2.
"""

import ast
import heapq
import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from itertools import count, product
from math import inf

#: Boxes that are looked at, at most, and the gap at which a bound is tight enough.
BOXES, GAP = 200, F(1, 10**5)


def unknown(condition):
    """Stop where the checker knows no such plant."""
    if condition:
        print("not checked: this checker does not know such a plant or observer", file=sys.stderr)
        sys.exit(2)


def times(a, b):
    """Product of polynomials."""
    out = {}
    for (i, x), (j, y) in product(a.items(), b.items()):
        key = tuple(p + q for p, q in zip(i, j))
        out[key] = out.get(key, F(0)) + x * y
    return {k: c for k, c in out.items() if c}


def plus(a, b, sign=1):
    """Sum or difference of polynomials."""
    out = dict(a)
    for key, y in b.items():
        out[key] = out.get(key, F(0)) + sign * y
    return {k: c for k, c in out.items() if c}


def bounds(p, box):
    """Least and largest value of a polynomial over a box, monomial by monomial."""
    lo, hi = F(0), F(0)
    for key, c in p.items():
        least, most = F(1), F(1)
        for k, (a, b) in ((k, ends) for k, ends in zip(key, box) if k):
            ends = [a**k, b**k] + ([F(0)] if not k % 2 and a < 0 < b else [])
            ends = [x * y for x in (least, most) for y in (min(ends), max(ends))]
            least, most = min(ends), max(ends)
        lo, hi = lo + min(c * least, c * most), hi + max(c * least, c * most)
    return lo, hi


def divided(a, b):
    """The polynomial a / b; None where there is none."""
    first, out = max(b), {}
    while a:
        key = tuple(p - q for p, q in zip(max(a), first))
        if min(key, default=0) < 0:
            return None
        part = {key: a[max(a)] / b[first]}
        out, a = plus(out, part), plus(a, times(part, b), -1)
    return out


class Formula:
    """n / d, of polynomials in the same variables; d is 1 where it divides n."""

    def __init__(self, n, d):
        (one, c), *more = d.items()
        self.n, self.d, one = n, d, (0,) * len(one)
        whole = {k: a / c for k, a in n.items()} if not more and one in d else divided(n, d)
        if whole is not None:
            self.n, self.d = whole, {one: F(1)}

    @classmethod
    def of(cls, c, size):
        """A number."""
        return cls({(0,) * size: F(c)} if c else {}, {(0,) * size: F(1)})

    @classmethod
    def variable(cls, k, size):
        """A variable."""
        return cls({tuple(int(i == k) for i in range(size)): F(1)}, {(0,) * size: F(1)})

    @property
    def plain(self):
        """Whether it is a polynomial."""
        return set(self.d) == {(0,) * len(next(iter(self.d)))}

    @property
    def number(self):
        """Its value where it is a number; else None."""
        return self.n.get(next(iter(self.d)), F(0)) if self.plain and set(self.n) <= set(self.d) else None

    def __add__(self, other, sign=1):
        if self.d == other.d or not other.n:
            return Formula(plus(self.n, other.n, sign), self.d)
        if not self.n:
            return Formula(plus({}, other.n, sign), other.d)
        return Formula(plus(times(self.n, other.d), times(other.n, self.d), sign), times(self.d, other.d))

    def __sub__(self, other):
        return self.__add__(other, -1)

    def __mul__(self, other):
        return Formula(times(self.n, other.n), times(self.d, other.d))

    def __truediv__(self, other):
        unknown(not other.n)
        return Formula(times(self.n, other.d), times(self.d, other.n))

    def __bool__(self):
        return bool(self.n)

    def moved(self, places, size):
        """The same of more variables: the k-th becomes places[k]."""
        def wider(p):
            out = {}
            for key, c in p.items():
                new = [0] * size
                for k, e in zip(places, key):
                    new[k] = e
                out[tuple(new)] = c
            return out
        return Formula(wider(self.n), wider(self.d))

    def slope(self, k):
        """Derivative by a variable."""
        def along(p):
            return {tuple(e - (i == k) for i, e in enumerate(key)): c * key[k] for key, c in p.items() if key[k]}
        if self.plain:
            return Formula(along(self.n), self.d)
        return Formula(plus(times(along(self.n), self.d), times(self.n, along(self.d)), -1), times(self.d, self.d))

    def bounds(self, box):
        """Bounds over a box, part by part; infinite where the divisor may be zero."""
        lo, hi = bounds(self.n, box)
        if self.plain:
            return lo, hi
        a, b = bounds(self.d, box)
        if a <= 0 <= b:
            return -inf, inf
        ends = [x / y for x in (lo, hi) for y in (a, b)]
        return min(ends), max(ends)

    def largest(self, box):
        """Bound from above over a box, tight where that takes few boxes."""
        used = [k for k in range(len(box)) if any(key[k] for p in (self.n, self.d) for key in p)]
        slopes, number, found = {k: self.slope(k) for k in used}, count(), -inf

        def entry(part):
            nonlocal found
            for k in 2 * used:
                lo, hi = slopes[k].bounds(part)
                end = part[k][1] if lo >= 0 else part[k][0] if hi <= 0 else None
                part = part if end is None else [(end, end) if i == k else p for i, p in enumerate(part)]
            found = max(found, self.bounds([((a + b) / 2,) * 2 for a, b in part])[0])
            return -self.bounds(part)[1], next(number), part

        waiting = [entry(list(box))]
        for _ in range(BOXES):
            top, _, part = waiting[0]
            widest = max(used, key=lambda k: (part[k][1] - part[k][0]) / (box[k][1] - box[k][0] or 1), default=None)
            if widest is None or part[widest][0] == part[widest][1] or -top <= found + GAP * abs(found):
                break
            heapq.heappop(waiting)
            a, b = part[widest]
            for half in ((a, (a + b) / 2), ((a + b) / 2, b)):
                heapq.heappush(waiting, entry([half if i == widest else p for i, p in enumerate(part)]))
        unknown(waiting[0][0] == -inf)
        return -waiting[0][0]

    def range(self, box):
        """Tight bounds from below and from above."""
        return -(self * Formula.of(-1, len(box))).largest(box), self.largest(box)


def formula(text, names, constants):
    """An expression of a plant file as a quotient of polynomials of the variables."""
    size = len(names)

    def walk(node):
        if isinstance(node, ast.Constant):
            return Formula.of(F(str(node.value)), size)
        if isinstance(node, ast.Name):
            unknown(node.id not in names and node.id not in constants)
            return Formula.variable(names.index(node.id), size) if node.id in names else Formula.of(
                constants[node.id], size)
        if isinstance(node, ast.UnaryOp):
            return Formula.of(-1 if isinstance(node.op, ast.USub) else 1, size) * walk(node.operand)
        unknown(not isinstance(node, ast.BinOp))
        a, b = walk(node.left), walk(node.right)
        for kind, act in ((ast.Add, Formula.__add__), (ast.Sub, Formula.__sub__), (ast.Mult, Formula.__mul__),
                          (ast.Div, Formula.__truediv__)):
            if isinstance(node.op, kind):
                return act(a, b)
        power = b.number
        unknown(not isinstance(node.op, ast.Pow) or power is None or power.denominator != 1 or power < 1)
        out = a
        for _ in range(int(power) - 1):
            out *= a
        return out

    return walk(ast.parse(str(text), mode="eval").body)


def polynomial(text, names, constants):
    """An expression that must be a polynomial."""
    found = formula(text, names, constants)
    unknown(not found.plain)
    return found.n
