r"""The weights of a polytope as one program: for any input weights in [0, 1] whose sum is 1 but for rounding.

Sector model: each premise is cut to its bounds, its upper weight is (z - lo)/(hi - lo), and the products are built as a
tree, w - w mu beside w mu: so they are in [0, 1], and each of them adds a rounding to their sum. Normalised weights:
exponentials with the largest exponent taken out, so that their sum is at least 1; one division.

The last result is the truth `inside`: the premises were within their bounds (but for rounding), or what was normalised
is numbers in [0, 1] that add up to 1 within rounding. Where these do not, all weights are equal.
"""

from __future__ import annotations

import numpy as np

from codegen.algebra.program import Builder, Program
from codegen.plant.polytopic import Polytope


def weight_program(polytope: Polytope, real: str, checked: dict | None = None) -> Program:
    """Return the program of the weights, the known terms and `inside`, over the polytope's symbols.

    Parameters
    ----------
    polytope : Polytope
    real : {"float32", "float64"}
        Its constants are numbers of this type.
    checked : dict, optional
        Symbol -> its range, of what the input check keeps within it: not checked again.

    Returns
    -------
    program : Program
        h results, one for each known term, and one more.

    Raises
    ------
    TypeError
        An expression has a function without operation.
    """
    b, h, step = Builder(polytope.symbols), len(polytope.vertices), float(np.finfo(real).eps)
    known = [b.value(k.term) for k in polytope.known]
    if polytope.premises:
        truths: list[tuple] = []
        free = [p for p in polytope.premises if not _kept(p, checked or {})]
        weights = _tree(b, polytope, truths, real, free or polytope.premises)
        return _rounded(b.done([*weights, *known, b.fold("and", truths)]), real)
    if polytope.softmax:
        exponents = [b.value(w.args[0]) for w in polytope.raw]
        most = b.fold("max", exponents)
        zero = b.constant(0.0)
        below = [b.apply("sub", e, most) for e in exponents]
        # None is above zero but for NaN, one of them is zero: said again where an analyser of the C can see it.
        weights = _normalised(b, [b.apply("exp", b.apply("min", d, zero)) for d in below], b.constant(1.0))
        sound = [b.apply("le", d, zero) for d in below]
    else:
        weights, sound = _normalised(b, [b.value(w) for w in polytope.raw]), []
    total = b.fold("add", weights)
    sound += [b.apply("ge", w, b.constant(0.0)) for w in weights]
    sound += [b.apply("le", w, b.constant(1.0 + 4 * step)) for w in weights]
    sound += [b.apply("ge", total, b.constant(1.0 - 4 * h * step)),
              b.apply("le", total, b.constant(1.0 + 4 * h * step))]
    fine = b.fold("and", sound)
    results = [b.apply("select", fine, w, b.constant(float(np.dtype(real).type(1 / h)))) for w in weights]
    return _rounded(b.done([*results, *known, fine]), real)


def _kept(premise, checked: dict) -> bool:
    """Whether a premise is a symbol that is kept within its bounds already."""
    lo, hi = checked.get(premise.term, (-np.inf, np.inf))
    return premise.lo <= lo and hi <= premise.hi


def _tree(b: Builder, polytope: Polytope, truths: list, real: str, free) -> list[tuple]:
    """Products of the premises' weights; the first premise is the lowest bit. Those in ``free`` are checked."""
    weights: list[tuple] = []
    kind, step = np.dtype(real).type, float(np.finfo(real).eps)
    for p in polytope.premises:
        z, slack = b.value(p.term), 8 * step * max(abs(p.lo), abs(p.hi))
        if p in free:
            truths += [b.apply("ge", z, b.constant(p.lo - slack)), b.apply("le", z, b.constant(p.hi + slack))]
        # A comparison with NaN is false: then z is its lower bound.
        cut = b.apply("select", b.apply("gt", z, b.constant(p.lo)), z, b.constant(p.lo))
        cut = b.apply("min", cut, b.constant(p.hi))
        above = b.apply("sub", cut, b.constant(p.lo)) if p.lo else cut
        mu = b.apply("mul", above, b.constant(_reciprocal(kind(p.hi) - kind(p.lo))))
        if not weights:
            weights = [b.apply("sub", b.constant(1.0), mu), mu]
            continue
        upper = [b.apply("mul", w, mu) for w in weights]
        weights = [b.apply("sub", w, u) for w, u in zip(weights, upper)] + upper
    return weights


def _reciprocal(width) -> float:
    """The largest number of the type that makes no more than 1 of the width, nor, rounding being monotone, of less."""
    kind = type(width)
    found = kind(1) / width
    while width * found > 1:
        found = np.nextafter(found, kind(0))
    return float(found)


def _normalised(b: Builder, values: list[tuple], least: tuple | None = None) -> list[tuple]:
    """The values over their sum, by one division; ``least`` is what their sum is at least."""
    total = b.fold("add", values)
    scale = b.apply("div", b.constant(1.0), total if least is None else b.apply("max", total, least))
    return [b.apply("mul", v, scale) for v in values]


def _rounded(program: Program, real: str) -> Program:
    """The program with constants of the type; those beyond it are its largest."""
    most = float(np.finfo(real).max)
    constants = tuple(float(np.dtype(real).type(min(max(c, -most), most))) for c in program.constants)
    return Program(program.inputs, constants, program.operations, program.results)
