"""The true descriptor plant: against another integrator, its algebraic rows, its starts, its gallery."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate

from codegen.errors import PlantError
from codegen.plant.load import gallery_names, load, loads
from codegen.plant.simulate import range_violations, simulate


def against_scipy(plant, trace, f, algebraic):
    """The trace of differential states against an integration of their own equations."""
    h, steps = plant.sample_period, 60
    x = trace.x[0].copy()
    worst = 0.0
    for k in range(steps):
        step = scipy.integrate.solve_ivp(lambda t, z, k=k: f(algebraic(z, trace.u[k]), trace.u[k], trace.w[k]), (0, h),
                                         x[:f.r], rtol=1e-10, atol=1e-12)
        x = algebraic(step.y[:, -1], trace.u[min(k + 1, len(trace.u) - 1)])
        worst = max(worst, np.abs(x - trace.x[k + 1])[:f.r].max())
    return worst


def test_simulated_disc_is_that_of_its_equations():
    plant = load("disc")
    trace = simulate(plant, "printed run")

    def algebraic(z, u):
        force = (2.5 * (z[0] + z[0] ** 3) + 0.75 * z[1] + 0.125 * u[0]) / 0.075
        return np.array([z[0], z[1], z[1] / 0.4, force])

    def f(x, u, w):
        return [x[1], -2.5 * (x[0] + x[0] ** 3) - 0.75 * x[1] + x[3] / 40]

    f.r = 2
    assert against_scipy(plant, trace, f, algebraic) < 1e-9
    assert trace.x[0] == pytest.approx([0.1, 0.3, 0.75, 9.7])
    # The printed bounds of the position are those of this run.
    assert -0.15 < trace.x[:, 0].min() < -0.12 and 0.22 < trace.x[:, 0].max() < 0.28
    for x, u in zip(trace.x, trace.u):
        assert np.abs(algebraic(x, u) - x).max() < 1e-8
    assert np.allclose(trace.y, trace.x @ plant.polytope.C.T)


def test_simulated_vertices_keep_to_their_algebraic_row():
    plant = load("dlpv")
    trace = simulate(plant, "no fault")
    for k in range(0, len(trace.x), 50):
        h, _ = plant.polytope.weights(trace.x[k], trace.u[k])
        w = trace.w[k]
        row = sum(a * (v.A @ trace.x[k] + v.B @ trace.u[k] + v.Bw @ w) for a, v in zip(h, plant.polytope.vertices))[2]
        assert abs(row) < 1e-8
    start = trace.x[0]
    assert start[:2].tolist() == [0, 1] and start[2] != -1  # the printed start is moved to a consistent one


def test_the_printed_start_of_the_bioreactor_is_not_consistent():
    """growth(0) = 0.001 in print; 1.888 is what its equation gives, and what the simulation starts from."""
    plant = loads(load("bioreactor").text.replace("1.888082", "0.001"))
    trace = simulate(plant, replace(plant.scenarios[0], steps=2))
    assert trace.x[0] == pytest.approx([0.523, 0.345, 1e-5, 5.1 * 0.345 / 0.845 * 0.9068])
    assert trace.x[0][3] == pytest.approx(1.888, abs=5e-4)


def test_linearised_truth_is_that_of_the_equations():
    a, b = (simulate(plant, replace(plant.scenarios[0], steps=50)) for plant in map(load, ("disc", "disc_points")))
    assert np.array_equal(a.x, b.x)


def test_a_discrete_descriptor_plant_is_stepped():
    text = load("dlpv").text.replace('"continuous"', '"discrete"')
    for old, new in (("[-10, 5, 6.5], [2, -5.5, -1.25]", "[0.5, 0.1, 0.1], [0, 0.4, 0.1]"),
                     ("[-10, 5, 6.5], [5, -4, -1.25]", "[0.4, 0.1, 0.1], [0, 0.5, 0.1]"),
                     ("[-8, 5, 6.5], [5, -4, -1.25]", "[0.3, 0.1, 0.1], [0, 0.3, 0.1]")):
        text = text.replace(old, new)
    text = text.replace('u     = ["4*sin(t)"]', 'u     = ["0.1*sin(t)"]')
    plant = loads(text)
    trace, p = simulate(plant, "no fault"), plant.polytope
    for k in range(0, 40):
        h, _ = p.weights(trace.x[k], trace.u[k])
        right = sum(a * (v.A @ trace.x[k] + v.B @ trace.u[k] + v.Bw @ trace.w[k]) for a, v in zip(h, p.vertices))
        assert trace.x[k + 1][:2] == pytest.approx(right[:2], abs=1e-12) and abs(right[2]) < 1e-8


RAMP = """
format = 1
name = "ramp"
[time]
kind = "continuous"
sample_period = 0.25
[signals]
x = [{ name = "x", range = [-5, 5] }, { name = "z", range = [-5, 5] }]
u = [{ name = "u", range = [0, 9], rate = 1 }]
y = [{ name = "x" }]
[initial]
x_lo = [0, 0]
x_hi = [0, 0]
[common]
C = [[1, 0]]
[nonlinear]
E = [[1, 0], [0, 0]]
f = ["u", "z + z**3 - x"]
[[scenario]]
name = "s"
steps = 9
u = ["t"]
"""


def test_inputs_with_a_rate_move_between_samples_and_nonlinear_rows_are_solved():
    trace = simulate(loads(RAMP), "s")
    t = 0.25 * np.arange(9)
    assert np.allclose(trace.x[:, 0], t**2 / 2, atol=1e-12)
    z = trace.x[:, 1]
    assert np.abs(z + z**3 - trace.x[:, 0]).max() < 1e-12
    held = simulate(loads(RAMP.replace(", rate = 1", "")), "s")
    assert np.allclose(held.x[1:, 0], 0.25 * np.cumsum(t)[:-1], atol=1e-12)


def test_equations_without_a_solution_are_told():
    text = load("disc").text.replace("(r**2/J + 1/m)*contact", "0*contact")
    with pytest.raises(PlantError, match=r"disc: scenarios.printed run: the algebraic equations have no solution"):
        simulate(loads(text), 0)


@pytest.mark.parametrize("name", [n for n in gallery_names() if load(n).polytope is not None])
def test_gallery_scenarios_keep_to_their_ranges(name):
    plant = load(name)
    for scenario in plant.scenarios:
        trace = simulate(plant, scenario.name)
        assert trace.y.shape == (scenario.steps, plant.n_y) and np.isfinite(trace.x).all()
        assert range_violations(plant, trace) == []
        if plant.polytope.premises:
            assert all(plant.polytope.weights(x, u)[1] for x, u in zip(trace.x[::20], trace.u[::20]))
