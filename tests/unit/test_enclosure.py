"""Bounds of expressions over a box: never too narrow, tight, and told where there are none."""

import numpy as np
import pytest
import sympy

from codegen.plant.enclosure import UnboundedError, enclosure, lower_bound, quotient

X, Y = sympy.symbols("x y", real=True)
ENCLOSED = {
    X**2: (0, 4), X - X**2: (-6, 0.25), 1 / (X + 3): (0.25, 1), sympy.sin(X): (-1, np.sin(1)), X**3: (-8, 1),
    sympy.sqrt(X + 2): (0, 3**0.5), sympy.log(X + 3): (0, np.log(4)), X * Y: (-2, 2), X**2 * Y - X * Y: (-6, 6),
    sympy.exp(-X**2 / 2): (np.exp(-2), 1), sympy.Min(sympy.Max(X, -1), Y): (-1, 1), sympy.Abs(X): (0, 2),
    quotient(sympy.sin(X), X): (np.sin(2) / 2, 1), quotient(sympy.exp(X) - 1, X): ((1 - np.exp(-2)) / 2, np.e - 1),
    sympy.tan(X / 2): (-np.tan(1), np.tan(0.5)), sympy.Integer(3): (3, 3),
}


@pytest.mark.parametrize("expression", ENCLOSED, ids=str)
def test_enclosures_hold_and_are_tight(expression):
    box = {X: (-2.0, 1.0), Y: (-1.0, 1.0)}
    lo, hi = enclosure(expression, box)
    exact = ENCLOSED[expression]
    assert lo <= exact[0] + 1e-15 and hi >= exact[1] - 1e-15
    assert (lo, hi) == pytest.approx(exact, abs=2e-4)
    numeric, rng = sympy.lambdify((X, Y), expression, "math"), np.random.default_rng(0)
    for x, y in rng.uniform([-2, -1], [1, 1], (300, 2)):
        assert lo <= numeric(x, y) <= hi
    assert lower_bound(expression, box, -100.0) <= exact[0]


@pytest.mark.parametrize("expression", [1 / X, sympy.log(X), sympy.sqrt(X), sympy.tan(X), 1 / (X**2 - X), X**-2])
def test_what_has_no_bounds_is_told(expression):
    with pytest.raises(UnboundedError):
        enclosure(expression, {X: (-1.6, 1.0)})
