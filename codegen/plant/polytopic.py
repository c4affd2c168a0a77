r"""A polytopic descriptor plant: constant vertices, blended by weights that depend on where the plant is.

    E x' = sum_i h_i (A_i x + B_i u + Bw_i w + Bf_i f + offset_i) + g,    y = C x + D u + Dv v + Df f

(x+ in place of x' in discrete time), h_i >= 0 with sum 1, functions of x, u and theta; E may be singular, E and the
outputs are the same at all vertices. g, zero in most plants, is any function of what is known exactly at run time.
The weights are sympy expressions and come in two forms:

* sector: each `Premise` z_k in [lo_k, hi_k] has two weights, (hi_k - z_k)/(hi_k - lo_k) and 1 minus that; h_i is the
  product of one of them per premise, bit k of i (first premise first) telling which. The model is exact.
* normalised: h_i = g_i / sum g. Where all g_i = exp(e_i) the largest e_i is taken out first, because far from all
  centres every g_i would be zero in floating point. Where the sum is not positive the weights are 1/h each.

Outside the ranges of [signals] nothing is promised: there `weights` clamps a premise, and says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from codegen.plant.model import Array


@dataclass(frozen=True)
class Vertex:
    """One vertex of E x' = A x + B u + Bw w + Bf f + offset.

    Parameters
    ----------
    name : str
    A : ndarray (n_x, n_x), B : ndarray (n_x, n_u)
    Bw : ndarray (n_x, n_w), Bf : ndarray (n_x, n_f)
    offset : ndarray (n_x,)
    """

    name: str
    A: Array
    B: Array
    Bw: Array
    Bf: Array
    offset: Array


@dataclass(frozen=True)
class Premise:
    """A term z of the equations that the vertices take at its two bounds.

    Parameters
    ----------
    name : str
    term : sympy.Expr
    lo, hi : float
        lo < hi; they enclose the term over the ranges of [signals].
    """

    name: str
    term: Any
    lo: float
    hi: float


@dataclass(frozen=True)
class Known:
    """A term that is known exactly at run time: of inputs, exact parameters, and states that an output is.

    Parameters
    ----------
    row : int
        Of E x' = .., where it is added.
    term : sympy.Expr
    lo, hi : float
        They enclose it over the ranges of [signals].
    """

    row: int
    term: Any
    lo: float
    hi: float


@dataclass(frozen=True)
class Polytope:
    """What a polytopic plant has in place of modes.

    Parameters
    ----------
    E : ndarray (n_x, n_x), C : ndarray (n_y, n_x), D : ndarray (n_y, n_u)
    Dv : ndarray (n_y, n_v), Df : ndarray (n_y, n_f)
    vertices : tuple of Vertex
    symbols : tuple of sympy.Symbol
        One per state, input and theta, in this order: the arguments of all expressions.
    premises : tuple of Premise
        Of a sector model, else empty.
    raw : tuple of sympy.Expr
        The weights before they are normalised; empty for a sector model.
    equations : tuple of sympy.Expr
        Of ``[nonlinear]``: the right sides of E x' = f without disturbance and fault; else empty.
    known : tuple of Known
        The rows of g that are not zero.
    """

    E: Array
    C: Array
    D: Array
    Dv: Array
    Df: Array
    vertices: tuple[Vertex, ...]
    symbols: tuple[Any, ...]
    premises: tuple[Premise, ...] = ()
    raw: tuple[Any, ...] = ()
    equations: tuple[Any, ...] = ()
    known: tuple[Known, ...] = ()

    @cached_property
    def exact(self) -> dict[int, int]:
        """State -> the output that is this state, without noise, fault or input."""
        beside = np.hstack([self.D, self.Dv, self.Df]).any(axis=1)
        return {int(np.argmax(row)): i for i, row in enumerate(self.C)
                if not beside[i] and row.max(initial=0.0) == 1 and np.count_nonzero(row) == 1}

    @cached_property
    def softmax(self) -> bool:
        """Whether all weights are exponentials before they are normalised."""
        import sympy
        return bool(self.raw) and all(w.func is sympy.exp for w in self.raw)

    @cached_property
    def expressions(self) -> tuple[Any, ...]:
        """The weights themselves, closed sympy expressions of ``symbols`` (h,); valid within the ranges."""
        import sympy
        if self.premises:
            return tuple(sympy.prod(factors) for factors in _corners(
                [((p.hi - p.term) / (p.hi - p.lo), (p.term - p.lo) / (p.hi - p.lo)) for p in self._rational()]))
        total = sympy.Add(*self.raw)
        return tuple(w / total for w in self.raw)

    def weights(self, x: Array, u: Array, theta: Array = ()) -> tuple[Array, bool]:
        """Return the weights at one point, and whether the point is inside the bounds of all premises.

        Parameters
        ----------
        x : ndarray (n_x,), u : ndarray (n_u,), theta : ndarray (n_theta,)

        Returns
        -------
        weights : ndarray (h,)
            In [0, 1], sum 1 but for rounding.
        inside : bool
        """
        try:
            values = np.array(self._numeric(*map(float, x), *map(float, u), *map(float, theta)))
        except (ValueError, ZeroDivisionError, OverflowError):  # a pole, or outside the domain of a root or logarithm
            values = np.full(len(self.premises) or len(self.vertices), np.nan)
        if self.premises:
            lo, hi = (np.array([getattr(p, end) for p in self.premises]) for end in ("lo", "hi"))
            clamped = np.clip(np.where(np.isfinite(values), values, lo), lo, hi)
            above = (clamped - lo) / (hi - lo)
            # What float64 rounds is no departure from the box.
            slack = 1e-12 * np.maximum(np.abs(lo), np.abs(hi))
            inside = bool(np.all((values >= lo - slack) & (values <= hi + slack)))
            return np.array([np.prod(f) for f in _corners(list(zip(1 - above, above)))]), inside
        if self.softmax:
            values = np.exp(values - values.max())
        total = float(values.sum())
        if not 0 < total < np.inf or values.min() < 0:
            return np.full(len(self.vertices), 1 / len(self.vertices)), False
        return values / total, True

    def right_side(self, x: Array, u: Array, theta: Array = ()) -> Array:
        """Return sum_i h_i (A_i x + B_i u + offset_i) + g.

        Parameters
        ----------
        x : ndarray (n_x,), u : ndarray (n_u,), theta : ndarray (n_theta,)

        Returns
        -------
        value : ndarray (n_x,)
        """
        h, _ = self.weights(x, u, theta)
        out = np.zeros(len(self.E))
        for known, value in zip(self.known, self._known(*map(float, x), *map(float, u), *map(float, theta))):
            out[known.row] = value
        return sum((weight * (v.A @ x + v.B @ u + v.offset) for weight, v in zip(h, self.vertices)), out)

    @cached_property
    def _known(self) -> Callable:
        """The rows of g as one function of all symbols."""
        import sympy
        return sympy.lambdify(self.symbols, [k.term for k in self.known], "math")

    @cached_property
    def _numeric(self) -> Callable:
        """Premises, exponents or raw weights as one function of all symbols."""
        import sympy
        terms = [p.term for p in self.premises] or [w.args[0] if self.softmax else w for w in self.raw]
        # No common subexpressions: 1/x would be taken out of the branch of a quotient that is not for x = 0.
        return sympy.lambdify(self.symbols, terms, "math", cse=False)

    def _rational(self) -> list[Premise]:
        import sympy
        return [Premise(p.name, p.term, sympy.Rational(p.lo), sympy.Rational(p.hi)) for p in self.premises]


def _corners(pairs: list) -> list[tuple]:
    """One of each pair, in all ways; the first premise is the lowest bit."""
    return [tuple(reversed(choice)) for choice in product(*reversed(pairs))]
