r"""Nonlinear equations E x' = f(x, u) as a polytope of constant matrices, exact by sectors.

Write f = A(x, u) x + B(x, u) u + c(x, u) (``factors``), name the terms z_1 .. z_k that make the entries vary, bound
each over the ranges, and take the 2^k corners. The entries must be affine in each z separately; then

    f = sum_i h_i (A_i x + B_i u + c_i)

with the products of the premises' weights (``polytopic``), exactly, wherever every z_k is within its bounds.

Corners that no state reaches (two premises of one state) and bounds wider than necessary make a design harder; they
never make the model wrong.

References: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, section 2.3.2. Differences from the print:
the denominator of (2.19) is the upper minus the lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy

from codegen.plant.enclosure import Box, UnboundedError, enclosure
from codegen.plant.factors import Factors, SectorError, Wish, brief, tidy
from codegen.plant.model import Array
from codegen.plant.polytopic import Premise, _corners

MOST_PREMISES = 6


def premises_of(factors: Factors, wishes: Sequence[Wish], box: Box) -> tuple[Factors, list[Premise], list[Any]]:
    """Name what varies in the entries, and bound it.

    Parameters
    ----------
    factors : Factors
    wishes : sequence of Wish
        Named terms; what they leave over is named here.
    box : dict
        sympy.Symbol -> (lo, hi): the ranges.

    Returns
    -------
    factors : Factors
        With the symbols of the premises in place of the terms.
    premises : list of Premise
    names : list of sympy.Symbol
        One per premise.

    Raises
    ------
    SectorError
        A term is unbounded, exceeds the bounds that were given, is not used, or enters other than affinely; or there
        are more than `MOST_PREMISES`.
    """
    whole = sympy.Matrix.hstack(factors.A, factors.B, factors.c).applyfunc(tidy)
    found, names = [], []
    largest_first = sorted(wishes, key=lambda w: -w.term.count_ops())
    for wish in largest_first:
        name = sympy.Symbol(f"premise_{wish.name}")
        coefficient, core = tidy(wish.term).as_coeff_Mul()
        after = whole.subs(core, name / coefficient)
        if after == whole:
            raise SectorError(f"premise.{wish.name}", f"the term {brief(wish.term)} is in no entry of A, B (expected a "
                              "part of one). Correct it, or remove the premise.")
        whole = after
        found.append(_bounded(wish, box))
        names.append(name)
    order = sorted(range(len(wishes)), key=lambda k: wishes.index(largest_first[k]))
    found, names = [found[k] for k in order], [names[k] for k in order]
    terms = _varying(whole, names)
    own = {term: sympy.Symbol(f"premise_z{len(found) + k + 1}") for k, term in enumerate(terms)}
    # Term by term: x**4 is no square of the premise x**2.
    whole = whole.applyfunc(lambda e: sympy.Add(*(
        sympy.Mul(number, *(own[g] for g in groups)) for number, groups in _groups(e, names))))
    for k, term in enumerate(terms, start=len(found) + 1):
        found.append(_bounded(Wish(f"z{k}", factors.quotients.get(term, term)), box))
    names += own.values()
    if len(found) > MOST_PREMISES:
        raise SectorError("f", f"{len(found)} terms vary: {', '.join(brief(p.term) for p in found)} (expected at most "
                          f"{MOST_PREMISES}, {2**MOST_PREMISES} vertices). Name products of them as one premise.")
    _check_affine(whole, names)
    n, m = factors.A.shape[1], factors.B.shape[1]
    for premise, name in zip(list(found), list(names)):
        if premise.lo == premise.hi:  # it does not vary over the ranges after all
            whole = whole.subs(name, sympy.Rational(premise.lo))
            found.remove(premise)
            names.remove(name)
    return Factors(whole[:, :n], whole[:, n:n + m], whole[:, -1:]), found, names


def corners(factors: Factors, premises: Sequence[Premise], names: Sequence[Any]) -> list[tuple[Array, Array, Array]]:
    """Return A, B and c of every vertex; bit k of its number is 1 where premise k is at its upper bound.

    Parameters
    ----------
    factors : Factors
    premises : sequence of Premise
    names : sequence of sympy.Symbol
        From `premises_of`.
    """
    out = []
    for ends in _corners([(p.lo, p.hi) for p in premises]):
        values = dict(zip(names, map(sympy.Rational, ends)))
        out.append(tuple(floats(M.subs(values)) for M in (factors.A, factors.B, factors.c)))
    return out


def _bounded(wish: Wish, box: Box) -> Premise:
    try:
        lo, hi = enclosure(wish.term, box)
    except UnboundedError:
        raise SectorError(f"premise.{wish.name}", f"the term {brief(wish.term)} has no bounds over the ranges (it "
                          "divides by zero or leaves the domain of a root or logarithm). Narrow the ranges.") from None
    if wish.bounds is None:
        return Premise(wish.name, wish.term, lo, hi)
    slack = 1e-12 * max(abs(lo), abs(hi))
    if wish.bounds[0] > lo + slack or wish.bounds[1] < hi - slack:
        raise SectorError(f"premise.{wish.name}.bounds", f"is [{wish.bounds[0]:g}, {wish.bounds[1]:g}], but the term "
                          f"reaches [{lo:.9g}, {hi:.9g}] over the ranges. Widen the bounds, or narrow the ranges.")
    return Premise(wish.name, wish.term, *wish.bounds)


def _varying(whole: Any, names: Sequence[Any]) -> list[Any]:
    """Terms of the entries that are no number and no premise yet; factors of different variables apart."""
    terms = {g for entry in whole for _, groups in _groups(entry, names) for g in groups}
    return sorted(terms, key=lambda t: (-t.count_ops(), str(t)))


def _groups(entry: Any, names: Sequence[Any]) -> list[tuple[Any, list[Any]]]:
    """Each term of an entry as a number (or premises) times factors that share no variable."""
    out = []
    for part in sympy.Add.make_args(entry):
        number, groups = sympy.Integer(1), []
        for factor in sympy.Mul.make_args(part):
            if not factor.free_symbols - set(names):
                number *= factor
                continue
            together = [g for g in groups if g.free_symbols & factor.free_symbols]
            groups = [g for g in groups if g not in together] + [sympy.Mul(factor, *together)]
        out.append((number, groups))
    return out


def _check_affine(whole: Any, names: Sequence[Any]) -> None:
    for i in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            entry = sympy.expand(whole[i, j])
            left = entry.free_symbols - set(names)
            bent = [n for n in names if sympy.diff(entry, n, 2) != 0]
            if left or bent:
                what = f"still varies with {sorted(map(str, left))[0]}" if left else (
                    f"is not affine in the premise {str(bent[0]).removeprefix('premise_')}")
                raise SectorError("f", f"the factor {brief(entry)} in row {i + 1} {what} (expected premises, each to "
                                  "the first power). Name the whole term as a premise.")


def floats(M: Any) -> Array:
    """Return a matrix of numbers in float64.

    Parameters
    ----------
    M : sympy.Matrix

    Returns
    -------
    array : ndarray (of its shape)
    """
    return np.array(M.evalf(30).tolist(), dtype=float).reshape(M.shape)
