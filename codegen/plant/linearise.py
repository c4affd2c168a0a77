r"""Nonlinear equations E x' = f(x, u), linearised at points that the plant file gives.

A_i and B_i are the Jacobians at a point, which need be no equilibrium, and c_i = f - A_i x_i - B_i u_i makes the model
meet f there. Blended by weights it is correct at the points only; nothing bounds the error between them.

References: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, section 2.3.1. Differences from the print:
the constants of (2.13) are kept, with the sign that (2.13) gives them, and go into the model as offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy

from codegen.plant.factors import SectorError
from codegen.plant.model import Array
from codegen.plant.sector import floats


def linearised(f: Sequence[Any], x: Sequence[Any], u: Sequence[Any], at: dict) -> tuple[Array, Array, Array]:
    """Return the Jacobians of f at a point and the constant that makes the linear model meet f there.

    Parameters
    ----------
    f : sequence of sympy.Expr (n_x)
    x, u : sequence of sympy.Symbol
    at : dict
        sympy.Symbol -> value, for every symbol.

    Returns
    -------
    A : ndarray (n_x, n_x), B : ndarray (n_x, n_u), c : ndarray (n_x, 1)

    Raises
    ------
    SectorError
        f or its slope has no value at the point.
    """
    f, values = sympy.Matrix(f), {s: sympy.Rational(repr(float(v))) for s, v in at.items()}
    A, B = (f.jacobian(list(s)).subs(values) if s else sympy.zeros(len(f), 0) for s in (x, u))
    here = [sympy.Matrix([values[s] for s in group]) if group else sympy.zeros(0, 1) for group in (x, u)]
    c = f.subs(values) - A * here[0] - B * here[1]
    try:
        return tuple(map(floats, (A, B, c)))
    except (TypeError, ValueError):
        raise SectorError("", "f or its slope has no value there. Move the point.") from None
