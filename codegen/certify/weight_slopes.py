r"""How far the weights of plant and observer are apart, by how far their states are: slopes of the weights, enclosed.

With e = x - x_hat and the weights h of the plant file, for each of a few functionals S_l of the state

    h(x) - h(x_hat) = sum_l (a number of magnitude |S_l e| at most) * (a mean of slopes of the set l):

* sector model: a premise is cut to its bounds, and the weights are affine in each premise by itself. So the slopes are
  those at the corners of the other premises, times the largest slope of the premise where it is within its bounds.
* normalised weights: by the mean value theorem along the segment from x_hat to x, whose states are in the ranges of
  both. Its slopes are enclosed in ball arithmetic, cell by cell; cells are halved where the enclosure is wide.

What the C computes in place of h(x_hat) is off by the rounding of ``program_error``, or for exponentials, of which
largest is taken out, by what `exponential_error` says. Their function exp is the target's: it is taken to be right to a
part in 2^14, which says no more than that it is one.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace
from itertools import product as corners_of

import numpy as np
from flint import arb, fmpq

from ..algebra.ball import ball, ends, value
from ..errors import CertificateError
from .exact import Q
from .filter_bounds import RAISE
from .program_error import program_errors
from .rounding import TINY, UNIT

Array = np.ndarray
#: Cells at most, and the share of the largest slope below which a radius is fine.
CELLS, FINE = 300, 0.05
#: Relative error of exp at most.
EXP = fmpq(1, 2**14)
#: Relative error of a rational number as a double, and a size below which there is none.
NEAR, NONE = 4e-16, 1e-300


@dataclass(frozen=True)
class Slope:
    """Changes of the weights that one functional of the state makes.

    Parameters
    ----------
    state : ndarray (n,) fmpq
        S of |S e|.
    room : fmpq
        What inputs add to |S e| by how they are rounded.
    mid, rad : ndarray (cells, h)
        Slopes per unit of S e; h(x) - h(x_hat) adds up to zero.
    """

    state: Array
    room: fmpq
    mid: Array
    rad: Array


@dataclass(frozen=True)
class Weights:
    """Slopes of the weights, and half of the sum of magnitudes by which the C's are off."""

    slopes: tuple[Slope, ...]
    off: fmpq


def weights(polytope, t, box: list[tuple[fmpq, fmpq]], slip_u: Array) -> Weights | None:
    """Slopes of a polytope's weights, and how far the C's are off; arguments as for `slopes`, None as there.

    Parameters
    ----------
    polytope : Polytope
    t : PolytopicTables
    box : list of (lo, hi)
        Of every state, that of the plant and of the estimate together, and of every input.
    slip_u : ndarray (m,) fmpq
    """
    found = slopes(polytope, box, slip_u)
    if found is None:
        return None
    try:
        return Weights(found, exponential_error(t, box) if polytope.softmax else computed_error(t, box))
    except CertificateError:
        return None


def slopes(polytope, box: list[tuple[fmpq, fmpq]], slip_u: Array) -> tuple[Slope, ...] | None:
    """Enclose the slopes of a polytope's weights.

    Parameters
    ----------
    polytope : Polytope
    box : list of (lo, hi)
        Of every state and input.
    slip_u : ndarray (m,) fmpq
        By how much the inputs are off.

    Returns
    -------
    slopes : tuple of Slope or None
        None where they have no bound: they read parameters, jump where they are not in force, or have a function
        without one.
    """
    n, m = len(polytope.E), len(slip_u)
    symbols = polytope.symbols[:n + m]
    if len(polytope.symbols) > n + m or polytope.known:
        return None
    at = {s: ball(*box[k]) for k, s in enumerate(symbols)}
    try:
        if polytope.premises:
            found = _sector(polytope, n, symbols, at, slip_u)
        elif polytope.softmax or _in_force(polytope, at):
            found = _normalised(polytope, n, symbols, at, slip_u)
        else:
            return None
    except TypeError:
        return None
    return None if found is None else tuple(found)


def steepness(found: tuple[Slope, ...], columns: Array) -> tuple[Array, Array]:
    """Largest magnitude of sum_i D_i q_i over the slopes of each functional (L, m), and over any two weights (m,).

    In doubles, raised by more than they can have lost.

    Parameters
    ----------
    found : tuple of Slope
    columns : object array (h, m, c)
        Each row of q_i, less their mean: its magnitude is the sum of those of its columns.
    """
    seen = columns.astype(float)
    size = np.abs(seen).sum(axis=2) * (1 + 1e-12) + NONE  # (h, m)
    steep = []
    for s in found:
        middle = np.abs(np.einsum("ki,imc->kmc", s.mid, seen)).sum(axis=2)
        lost = len(s.mid[0]) * NEAR * 4 * (np.abs(s.mid) @ size)
        steep.append(np.max((middle + lost + s.rad @ size) * RAISE, axis=0) + NONE)
    pairs = [np.abs(a - b).sum(axis=1) for k, a in enumerate(seen) for b in seen[:k]] or [0 * size[0]]
    spread = (np.max(pairs, axis=0) + 8 * NEAR * np.max(size, axis=0)) * RAISE + NONE
    return np.array(steep).reshape(-1, columns.shape[1]), spread


def _in_force(polytope, at: dict) -> bool:
    """Whether the weights that are not exponentials are shares everywhere in the box."""
    found = [value(w, at) for w in polytope.raw]
    return all(v.is_finite() and v.lower() >= 0 for v in found) and sum(found, arb(0)).lower() > 0


def _sector(polytope, n: int, symbols, at: dict, slip_u: Array) -> list[Slope] | None:
    """One slope per premise where that is affine, else one per symbol of it."""
    bits, out = len(polytope.premises), []
    for k, premise in enumerate(polytope.premises):
        others = list(corners_of((0, 1), repeat=bits))
        ends_of = np.zeros((2 ** (bits - 1), 2**bits))
        for row, corner in enumerate(c for c in others if c[k] == 0):
            low = sum(bit << i for i, bit in enumerate(corner))
            ends_of[row, [low, low + (1 << k)]] = -1.0, 1.0
        width, rates = Q(premise.hi) - Q(premise.lo), {}
        for s in premise.term.free_symbols:
            slope = premise.term.diff(s)
            rate = value(slope, {}) if slope.is_number else _largest(slope, premise, at)
            if rate is None or not rate.is_finite():
                return None
            rates[s] = rate, slope.is_number
        state, room = np.array([fmpq(0)] * n, dtype=object), fmpq(0)
        for j, s in enumerate(symbols):
            if s not in rates:
                continue
            rate, number = rates[s]
            most = Q(max(map(abs, ends(rate))))
            if j >= n:
                room += most / width * slip_u[j - n]
            elif number:
                exact = premise.term.diff(s)
                state[j] = (fmpq(int(exact.p), int(exact.q)) if exact.is_Rational else Q(float(exact))) / width
            else:
                unit = np.array([fmpq(int(i == j)) for i in range(n)], dtype=object)
                scale = np.nextafter(float(most / width), np.inf)
                out.append(Slope(unit, fmpq(0), scale * ends_of, 0 * ends_of))
        if any(state != 0) or room:
            out.append(Slope(state, room, ends_of, 0 * ends_of))
    return out


def _largest(slope, premise, at: dict) -> arb | None:
    """Bounds of a slope of a premise where that is within its bounds."""
    lo, hi = arb(premise.lo), arb(premise.hi)

    def rates(cell: dict) -> list[arb]:
        z = value(premise.term, cell)
        return [] if z.is_finite() and (z < lo or z > hi) else [value(slope, cell)]

    cells = _cells(rates, {s: at[s] for s in premise.term.free_symbols})
    return None if cells is None else ball(-max(max(map(abs, ends(v[0]))) for _, v in cells),
                                           max(max(map(abs, ends(v[0]))) for _, v in cells))


def _normalised(polytope, n: int, symbols, at: dict, slip_u: Array) -> list[Slope] | None:
    """Slopes of g_i / sum g; those of exponentials by differences of their exponents."""
    import sympy
    raw, h = polytope.raw, len(polytope.raw)
    used = [s for s in symbols if any(s in w.free_symbols for w in raw)]
    own = {s: at[s] for s in used}
    if polytope.softmax:
        apart = [[sympy.expand(a.args[0] - b.args[0]) for b in raw] for a in raw]
        moved = {s: [[d.diff(s) for d in row] for row in apart] for s in used}
    out = []
    for s in used:
        def rates(cell: dict, s=s) -> list[arb]:
            if polytope.softmax:
                share = [_share([value(apart[k][i], cell) for k in range(h)]) for i in range(h)]
                return [share[i] * sum((share[k] * value(moved[s][i][k], cell) for k in range(h) if k != i), arb(0))
                        for i in range(h)]
            g, slope = [value(w, cell) for w in raw], [value(w.diff(s), cell) for w in raw]
            total, rise = sum(g, arb(0)), sum(slope, arb(0))
            return [(b - a / total * rise) / total for a, b in zip(g, slope)]

        cells = _cells(rates, own)
        if cells is None:
            return None
        bounds = np.array([[ends(v) for v in values] for _, values in cells])
        mid = bounds.mean(axis=2)
        rad = np.nextafter(np.max(np.abs(bounds - mid[:, :, None]), axis=2) * (1 + 1e-12), np.inf)
        j = symbols.index(s)
        unit = np.array([fmpq(int(i == j)) for i in range(n)], dtype=object)
        out.append(Slope(unit, slip_u[j - n] if j >= n else fmpq(0), mid, rad))
    return out


def _share(exponents: list[arb]) -> arb:
    """1 over the sum of exponentials."""
    if not all(e.is_finite() for e in exponents):
        return arb("nan")
    most, least = (sum((arb(e).exp() for e in side), arb(0)) for side in (
        [e.upper() for e in exponents], [e.lower() for e in exponents]))
    return (1 / most).union(1 / least)


def _cells(slopes, box: dict) -> list[tuple[dict, list[arb]]] | None:
    """Cells of a box with their slopes: halved where these are widest, along the side that is longest."""
    def size(values: list[arb]) -> float:
        if not values:
            return 0.0
        return float("inf") if not all(v.is_finite() for v in values) else max(float(v.rad()) for v in values)

    first = slopes(box)
    queue, number, known = [(-size(first), 0, box, first)], 1, 0.0
    while len(queue) < CELLS:
        worst, _, cell, _ = queue[0]
        if -worst <= FINE * known:
            break
        heapq.heappop(queue)
        longest = max(cell, key=lambda s: float(cell[s].rad()) / (float(box[s].rad()) or 1.0))
        lo, mid, hi = cell[longest].lower(), arb(float(cell[longest].mid())), cell[longest].upper()
        for half in (lo.union(mid), mid.union(hi)):
            part = {**cell, longest: half}
            values = slopes(part)
            known = max([known, *(abs(float(v.mid())) - float(v.rad()) for v in values if v.is_finite())])
            heapq.heappush(queue, (-size(values), number, part, values))
            number += 1
    if any(not v.is_finite() for _, _, _, values in queue for v in values):
        return None
    return [(cell, values) for _, _, cell, values in queue if values]


def computed_error(t, box: list[tuple[fmpq, fmpq]]) -> fmpq:
    """Half the sum of magnitudes by which weights without libm are off, and by which their sum is.

    Parameters
    ----------
    t : PolytopicTables
    box : list of (lo, hi)

    Raises
    ------
    CertificateError
        An operation has no bound.
    """
    found = program_errors(t.weights, [(lo, hi, fmpq(0)) for lo, hi in box], t.real)
    # Once more for the sum: the weights of the model are those of the C over their sum.
    return sum((error for _, _, error in found[:len(t.F)]), fmpq(0))


def exponential_error(t, box: list[tuple[fmpq, fmpq]]) -> fmpq:
    """The same for exponentials, the largest exponent taken out, over their sum: relative, as each weight is.

    Parameters
    ----------
    t : PolytopicTables
    box : list of (lo, hi)

    Raises
    ------
    CertificateError
        An exponent has no bound.
    """
    program, u = t.weights, UNIT[t.real]
    differences = [op.args[0] for op in program.operations if op.name == "exp"]
    exponents = [program.operations[k - program.first].args[0] for k in differences]
    before = min(differences) - program.first
    part = replace(program, operations=program.operations[:before], results=(*exponents, 0))
    found = program_errors(part, [(lo, hi, fmpq(0)) for lo, hi in box], t.real)
    top, low = max(hi for _, hi, _ in found), min(lo for lo, _, _ in found)
    error = max(e for _, _, e in found)
    # An exponent and the largest of them, and their difference; exp(d) - 1 <= d + d^2 for d <= 1.
    d = 2 * error + u * (top - low + 2 * error) + TINY[t.real]
    if d > fmpq(1, 4):
        raise CertificateError("certificate: exponents of the weights lose their digits. Use float64.")
    own = (1 + d + d * d) * (1 + EXP) - 1
    after = (len(t.F) + 4) * 2 * u  # one sum, one division, one product
    both = (1 + own) / (1 - own) * (1 + after) - 1
    return both + len(t.F) * TINY[t.real] * 4
