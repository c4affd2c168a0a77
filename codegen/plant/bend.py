r"""How fast the right side of E x' = f changes along the plant: what explicit Euler steps leave out.

Over a period E x moves by the integral of f, an Euler step by period times f at the sample; the difference in row i is
at most period^2/2 times the largest |d f_i/dt|. With x' from E x' = f + Bw w and from the algebraic rows, whose
derivative along x' is zero too, df/dt is a function of x, u, theta, w and of the rates of u and theta, bounded over
their ranges. The disturbance itself is no part of it: its mean over a period is a disturbance again.
"""

from __future__ import annotations

import numpy as np

from codegen.algebra.pencil import svd_form
from codegen.errors import PlantError
from codegen.plant.enclosure import UnboundedError, enclosure
from codegen.plant.model import Array, Plant


def bend(plant: Plant) -> Array:
    """Largest |d f_i/dt| of every row of E x' = f over the ranges; 0 for rows that are algebraic.

    Parameters
    ----------
    plant : Plant
        Continuous, with a polytope.

    Returns
    -------
    bound : ndarray (n_x,)

    Raises
    ------
    PlantError
        A signal has no range or no rate, a row of E mixes algebraic and differential equations, the disturbance is in
        an algebraic row, or the bound is infinite.
    """
    import sympy
    p, n = plant.polytope, plant.n_x
    box = _box(plant)
    f = sympy.Matrix(p.equations or _blended(p))
    moving = np.any(p.E != 0, axis=1)
    form = svd_form(p.E, np.zeros_like(p.E))
    if form.r != moving.sum():
        raise PlantError(f"{plant.name}: a row of E is a combination of others (found rank {form.r} of {moving.sum()} "
                         "rows), expected algebraic equations as rows of zeros. Combine the rows.")
    if any(v.Bw[~moving].any() for v in p.vertices):
        raise PlantError(f"{plant.name}: a disturbance acts on an algebraic equation, so that the state may jump "
                         "between samples (Bw is not zero there). Give it dynamics.")
    x = sympy.Matrix(p.symbols[:n])
    slope = f.jacobian(x)
    speed, known = sympy.zeros(n, 1), {}
    for i in np.flatnonzero(moving):  # one symbol for each row's value: small expressions
        known[symbol := sympy.Symbol(f"speed_{i}")] = _row(plant, f[int(i)], int(i), box)
        speed[int(i)] = symbol
    rates = [(s, *_rate(plant, s, k)) for k, s in enumerate(p.symbols[n:])]
    outer = sympy.zeros(n, 1)
    for s, symbol, size in rates:
        if size:
            known[symbol] = (-size, size)
            outer += f.diff(s) * symbol
    E = sympy.Matrix(n, n, lambda i, j: sympy.Rational(float(p.E[i, j])) if moving[i] else slope[i, j])
    velocity = E.LUsolve(sympy.Matrix(n, 1, lambda i, _: speed[i] if moving[i] else -outer[i]))
    names = sympy.symbols(f"velocity_:{n}")
    try:
        for name, value in zip(names, velocity):
            known[name] = enclosure(value, box | known)
        change = slope * sympy.Matrix(names) + outer
        sizes = [max(map(abs, enclosure(row, box | known))) if i else 0.0 for row, i in zip(change, moving)]
    except UnboundedError:
        raise PlantError(f"{plant.name}: how fast the state moves has no bound over the ranges (an algebraic equation "
                         "cannot be solved everywhere in them). Narrow the ranges.") from None
    return np.array(sizes)


def _box(plant: Plant) -> dict:
    """The ranges of all symbols."""
    box = {}
    for symbol, signal in zip(plant.polytope.symbols, (*plant.x, *plant.u, *plant.theta)):
        if not np.isfinite([signal.lo, signal.hi]).all():
            raise PlantError(f"{plant.name}: {signal.name} has no range (expected one, the change of f between samples "
                             "depends on it). Add range = [lo, hi].")
        box[symbol] = (signal.lo, signal.hi)
    return box


def _blended(p) -> list:
    """Return f of vertices: their sum with their weights."""
    import sympy
    n, m = p.vertices[0].A.shape[0], p.vertices[0].B.shape[1]
    x, u = sympy.Matrix(p.symbols[:n]), sympy.Matrix(p.symbols[n:n + m])

    def exact(M):
        return sympy.Matrix(*M.shape, [sympy.Rational(float(v)) for v in np.ravel(M)])

    return list(sum((h * (exact(v.A) * x + (exact(v.B) * u if m else sympy.zeros(n, 1)) + exact(v.offset[:, None]))
                     for h, v in zip(p.expressions, p.vertices)), sympy.zeros(n, 1)))


def _row(plant: Plant, row, i: int, box: dict) -> tuple[float, float]:
    """Least and largest value of a row of f with the disturbance."""
    try:
        lo, hi = enclosure(row, box)
    except UnboundedError:
        raise PlantError(f"{plant.name}: row {i + 1} of f has no bounds over the ranges. Narrow them.") from None
    w_lo, w_hi = plant.limits("w")
    ends = [np.sort(np.stack([v.Bw[i] * w_lo, v.Bw[i] * w_hi]), axis=0) for v in plant.polytope.vertices]
    return (float(np.nextafter(lo + min(e[0].sum() for e in ends), -np.inf)),
            float(np.nextafter(hi + max(e[1].sum() for e in ends), np.inf)))


def _rate(plant: Plant, symbol, k: int):
    """The symbol of an input's or parameter's rate, and its largest magnitude."""
    import sympy
    signal = (*plant.u, *plant.theta)[k]
    if not np.isfinite(signal.rate):
        raise PlantError(f"{plant.name}: {signal.name} may jump between samples (it has no rate). Give it one.")
    return sympy.Symbol(f"rate_{k}"), float(signal.rate)
