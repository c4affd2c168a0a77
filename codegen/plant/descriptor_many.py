"""Many runs of a polytopic plant at once, for campaigns: those of `descriptor.simulated`, a row of every array a run.

The signals of each run come from its own seed, so that run k is what ``simulate(plant, scenario, seed)`` gives but for
the last bits of sums; one sample of all runs costs little more than one of one run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from codegen.errors import PlantError
from codegen.plant.descriptor import ITERATIONS, PIECES, TOLERANCE, Implicit, rows_of
from codegen.plant.excitation import disturbances, faults, initial_state, inputs, scheduling
from codegen.plant.model import Array, Plant, PlantTrace, Scenario


def simulate_many(plant: Plant, runs: Sequence[tuple[Scenario, int]]) -> list[PlantTrace]:
    """Run scenarios of one length on the true plant.

    Parameters
    ----------
    plant : Plant
        With a polytope, whose parameters are measured exactly.
    runs : sequence of (Scenario, int)
        Each with its seed; none that reads a record.

    Returns
    -------
    traces : list of PlantTrace

    Raises
    ------
    PlantError
        A signal leaves its limits, or the algebraic equations have no solution somewhere.
    """
    p, pieces = plant.polytope, PIECES if plant.kind == "continuous" else 1
    h, steps = plant.sample_period / pieces, runs[0][0].steps
    u, f, theta, w, v, state = (np.array(s) for s in zip(*(_signals(plant, s, seed, h, pieces) for s, seed in runs)))
    ends = np.concatenate([u[:, 1:], u[:, -1:]], axis=1)
    held = np.array([s.rate == 0 for s in plant.u], dtype=bool)
    true, solver, x = truth_many(plant), Implicit(p.E), np.empty((len(runs), steps, plant.n_x))
    for k in range(steps):
        def at(now, share, k=k):
            """The right side on a piece, the inputs at a share of the sample."""
            moving = np.where(held, u[:, k], u[:, k] + share * (ends[:, k] - u[:, k]))
            return lambda z: true(z, moving, theta[:, now], w[:, now], f[:, k])
        x[:, k] = state = _consistent(solver, state, at(k * pieces, 0.0))
        if plant.kind != "continuous":
            state = at(k, 0.0)(state)[0] @ solver.forward.T + state @ solver.algebraic
            continue
        for i in range(pieces):
            now = k * pieces + i
            if i:
                state = _consistent(solver, state, at(now, i / pieces))
            slopes: list[Array] = []
            for share in (0.0, 0.5, 0.5, 1.0):
                g = at(now, (i + share) / pieces)
                here = _consistent(solver, state + share * h * slopes[-1], g) if slopes else state
                slopes.append(g(here)[0] @ solver.forward.T)
            k1, k2, k3, k4 = slopes
            state = _consistent(solver, state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), at(now, (i + 1.0) / pieces))
    y = x @ p.C.T + u @ p.D.T + v @ p.Dv.T + f @ p.Df.T
    q = np.zeros(steps, dtype=int)
    return [PlantTrace(x=x[s], u=u[s], y=y[s], q=q, theta=theta[s, ::pieces][:steps], w=w[s, ::pieces][:steps], v=v[s],
                       f=f[s]) for s in range(len(runs))]


def _signals(plant: Plant, scenario: Scenario, seed: int, h: float, pieces: int) -> tuple[Array, ...]:
    """What drives one run, drawn in the order of `descriptor.simulated`, and where it starts."""
    rng = np.random.default_rng(seed)
    f, u = faults(plant, scenario, None), inputs(plant, scenario, None)
    fine, dense = replace(plant, sample_period=h), replace(scenario, steps=scenario.steps * pieces + 1)
    theta = scheduling(fine, dense, rng, None, pieces)
    w = disturbances(fine, dense, "w", *rows_of(plant, "w", dense.steps), rng, pieces)
    v = disturbances(plant, scenario, "v", *rows_of(plant, "v", scenario.steps), rng)
    return u, f, theta, w, v, initial_state(plant, scenario, rng)


def _consistent(solver: Implicit, x: Array, g: Callable[[Array], tuple[Array, Array]]) -> Array:
    """Newton's method of `Implicit.consistent` for every row of x."""
    if not len(solver.rows):
        return x
    for _ in range(ITERATIONS):
        value, slope = g(x)
        try:
            inner = np.linalg.solve(solver.rows @ slope @ solver.columns, (value @ solver.rows.T)[..., None])
        except np.linalg.LinAlgError:
            break
        step = inner[..., 0] @ solver.columns.T
        x = x - step
        if np.all(np.abs(step).max(axis=1) <= TOLERANCE * (1 + np.abs(x).max(axis=1))):
            return x
    raise PlantError("the algebraic equations have no solution near the state of some run (Newton's method does not "
                     "converge). Is the plant impulse-free there? See: residua check.")


def truth_many(plant: Plant) -> Callable[..., tuple[Array, Array]]:
    """The true right sides and their Jacobians (S, n), (S, n, n), as one function of the rows of x, u, theta, w, f.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    """
    import sympy
    p, n = plant.polytope, plant.n_x
    Bw, Bf = (np.array([getattr(v, name) for v in p.vertices]) for name in ("Bw", "Bf"))

    def function(expressions):
        made = sympy.lambdify(p.symbols, expressions, "numpy", cse=True)  # a pole in a branch not taken warns

        def values(x, u, theta):
            with np.errstate(all="ignore"):
                out = made(*x.T, *u.T, *theta.T)
            return np.stack([np.broadcast_to(value, len(x)) for value in out], axis=1).astype(float)
        return values

    if p.equations:
        jacobian = sympy.Matrix(p.equations).jacobian(list(p.symbols[:n]))
        both = function([*p.equations, *jacobian])

        def exact(x, u, theta, w, f):
            out = both(x, u, theta)
            if not np.all(np.isfinite(out)):
                raise PlantError("the equations have no value where the state of some run goes. Does the scenario keep "
                                 "to the ranges?")
            return out[:, :n] + w @ Bw[0].T + f @ Bf[0].T, out[:, n:].reshape(-1, n, n)

        return exact
    A, B, offset = (np.array([getattr(v, name) for v in p.vertices]) for name in ("A", "B", "offset"))
    weights = function(p.expressions)

    def blended(x, u, theta, w, f):
        h = weights(x, u, theta)
        slope = (h @ A.reshape(len(A), -1)).reshape(-1, n, n)
        rest = u @ np.swapaxes(B, 1, 2) + w @ np.swapaxes(Bw, 1, 2) + f @ np.swapaxes(Bf, 1, 2) + offset[:, None]
        return (slope @ x[..., None])[..., 0] + np.einsum("sh,hsn->sn", h, rest), slope

    return blended
