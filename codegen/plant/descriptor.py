r"""The true plant of a polytope, simulated: E x' = f(x, u, theta) + Bw w + Bf f with algebraic rows.

f is the equations of [nonlinear] where the plant file has them, so that a linearised model meets its errors, and
sum_i h_i (A_i x + B_i u + offset_i) elsewhere. In the coordinates where E = diag(I, 0) the last rows are algebraic;
they are solved by Newton's method at every stage (the plant must be impulse-free where it goes), and the others are
integrated by the classical Runge-Kutta method on `PIECES` parts of each sample. In discrete time E x+ = f(x, u): the
algebraic rows hold at every sample, and a step gives the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from codegen.algebra.pencil import svd_form
from codegen.errors import PlantError
from codegen.plant.excitation import disturbances, faults, given_theta, initial_state, inputs, scheduling
from codegen.plant.model import Array, Plant, PlantTrace, Scenario
from codegen.plant.record import Record

#: Parts of a sample, on each of which the disturbance is constant.
PIECES = 2
ITERATIONS, TOLERANCE = 30, 1e-11


def truth(plant: Plant) -> Callable[..., tuple[Array, Array]]:
    """Return the true right side and its Jacobian, as one function of x, u, theta, w, f.

    The Jacobian is exact for equations; for vertices the weights are held.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    """
    p = plant.polytope
    A, B, Bw, Bf, offset = (np.array([getattr(v, n) for v in p.vertices]) for n in ("A", "B", "Bw", "Bf", "offset"))
    if not p.equations:
        flat = A.reshape(len(A), -1)

        def blended(x, u, theta, w, f):
            h, _ = p.weights(x, u, theta)
            slope = (h @ flat).reshape(A.shape[1:])
            return slope @ x + h @ (B @ u + Bw @ w + Bf @ f + offset), slope

        return blended
    import sympy
    jacobian = sympy.Matrix(p.equations).jacobian(list(p.symbols[:plant.n_x]))
    both = sympy.lambdify(p.symbols, [list(p.equations), jacobian.tolist()], "math", cse=True)

    def exact(x, u, theta, w, f):
        try:
            value, slope = both(*x.tolist(), *u.tolist(), *theta.tolist())
        except (ValueError, ZeroDivisionError, OverflowError):
            raise PlantError("the equations have no value where the state goes (found a division by zero, a root or a "
                             "logarithm). Does the scenario keep to the ranges?") from None
        # Bw and Bf of [nonlinear] are those of [common], the same at all vertices.
        return np.array(value, dtype=float) + Bw[0] @ w + Bf[0] @ f, np.array(slope, dtype=float)

    return exact


class Implicit:
    """E x' = g(x) solved for the derivative of its differential coordinates, at given algebraic ones.

    Parameters
    ----------
    E : ndarray (n, n)
    """

    def __init__(self, E: Array):
        form = svd_form(E, np.zeros_like(E))
        r = form.r
        self.rows, self.columns = form.P[r:], form.Q[:, r:]
        self.forward = form.Q[:, :r] @ form.P[:r]
        self.algebraic = self.columns @ self.columns.T  # where the next solution is looked for

    def consistent(self, x: Array, g: Callable[[Array], tuple[Array, Array]]) -> Array:
        """Return x with its algebraic coordinates moved to where the algebraic rows of g are zero.

        Parameters
        ----------
        x : ndarray (n,)
        g : callable
            x -> right side (n,), and its Jacobian (n, n).

        Raises
        ------
        PlantError
            Newton's method finds no solution near.
        """
        if not len(self.rows):
            return x
        for _ in range(ITERATIONS):
            value, slope = g(x)
            try:
                step = self.columns @ np.linalg.solve(self.rows @ slope @ self.columns, self.rows @ value)
            except np.linalg.LinAlgError:
                break
            x = x - step
            if np.abs(step).max() <= TOLERANCE * (1 + np.abs(x).max()):
                return x
        raise PlantError("the algebraic equations have no solution near the state (Newton's method does not converge). "
                         "Is the plant impulse-free there? See: residua check.")

    def advance(self, x: Array, h: float, g: Callable[[float], Callable]) -> Array:
        """Return the consistent state after h, by one step of Runge and Kutta.

        Parameters
        ----------
        x : ndarray (n,)
            Consistent.
        h : float
        g : callable
            Share of h that has gone -> function of x as for `consistent`.
        """
        slopes: list[Array] = []
        for share in (0.0, 0.5, 0.5, 1.0):
            at = g(share)
            here = self.consistent(x + share * h * slopes[-1], at) if slopes else x
            slopes.append(self.forward @ at(here)[0])
        k1, k2, k3, k4 = slopes
        return self.consistent(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), g(1.0))


def simulated(
    plant: Plant, scenario: Scenario, record: Record | None, theta: Array | None, rng: np.random.Generator
) -> PlantTrace:
    """Run a scenario on the true plant.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    scenario : Scenario
    record : Record or None
        Gives the inputs.
    theta : ndarray (K, n_theta) or None
    rng : Generator

    Returns
    -------
    trace : PlantTrace

    Raises
    ------
    PlantError
        A signal leaves its limits, or the algebraic equations have no solution.
    """
    p, steps, true, solver = plant.polytope, scenario.steps, truth(plant), Implicit(plant.polytope.E)
    f, u = faults(plant, scenario, record), inputs(plant, scenario, record)
    pieces = PIECES if plant.kind == "continuous" else 1
    h = plant.sample_period / pieces
    dense_plant, dense = replace(plant, sample_period=h), replace(scenario, steps=steps * pieces + 1)
    theta = (scheduling(dense_plant, dense, rng, None, pieces) if theta is None else
             np.repeat(given_theta(plant, theta, steps), pieces, axis=0))
    w = disturbances(dense_plant, dense, "w", *rows_of(plant, "w", dense.steps), rng, pieces)
    v = disturbances(plant, scenario, "v", *rows_of(plant, "v", steps), rng)
    ends = np.vstack([u[1:], u[-1:]])
    held = np.array([s.rate == 0 for s in plant.u], dtype=bool)
    x, state = np.empty((steps, plant.n_x)), initial_state(plant, scenario, rng)
    for k in range(steps):
        def at(now, share, k=k):
            """The right side on a piece, the inputs at a share of the sample."""
            moving = np.where(held, u[k], u[k] + share * (ends[k] - u[k]))
            return lambda z: true(z, moving, theta[now], w[now], f[k])
        x[k] = state = solver.consistent(state, at(k * pieces, 0.0))
        if plant.kind != "continuous":
            state = solver.forward @ at(k, 0.0)(state)[0] + solver.algebraic @ state
            continue
        for i in range(pieces):
            now = k * pieces + i
            if i:  # the disturbance is another one from here on
                state = solver.consistent(state, at(now, i / pieces))
            state = solver.advance(state, h, lambda share, now=now, i=i, at=at: at(now, (i + share) / pieces))
    y = x @ p.C.T + u @ p.D.T + v @ p.Dv.T + f @ p.Df.T
    return PlantTrace(x=x, u=u, y=y, q=np.zeros(steps, dtype=int), theta=theta[::pieces][:steps],
                      w=w[::pieces][:steps], v=v, f=f)


def rows_of(plant: Plant, vector: str, steps: int) -> tuple[Array, Array]:
    """Limits of a vector, one row per sample.

    Parameters
    ----------
    plant : Plant
    vector : str
    steps : int
    """
    lo, hi = plant.limits(vector)
    return np.tile(lo, (steps, 1)), np.tile(hi, (steps, 1))
