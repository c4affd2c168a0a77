"""Nonlinear equations as a polytope: exact within the ranges, published vertices, weights that C computes."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
import sympy

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.tools import need  # noqa: E402

from codegen.plant.load import gallery_names, load, loads  # noqa: E402

PENDULUM = """
format = 1
name = "pendulum"
[time]
kind = "continuous"
sample_period = 0.01
[signals]
x = [{ name = "angle", range = [-2, 1.5] }, { name = "rate", range = [-3, 3] }]
u = [{ name = "push", range = [-1, 2] }]
y = [{ name = "angle" }]
theta = [{ name = "gust", bounds = [0.5, 1.5] }]
[initial]
x_lo = [0, 0]
x_hi = [0, 0]
[constants]
g = 9.81
[common]
C = [[1, 0]]
[nonlinear]
f = ["rate - 0.2", "-g*sin(angle) - 0.3*gust*rate*rate + 2*exp(0.5*angle) + cos(angle)*push + 2*push/(4 + rate) - 1"]
[[scenario]]
name = "s"
steps = 20
u = ["1"]
"""
SECTORS = {name: load(name) for name in gallery_names() if load(name).polytope and load(name).polytope.premises}
SECTORS["pendulum"] = loads(PENDULUM)
SECTORS["wide disc"] = loads(load("disc").text.replace("[nonlinear]\n", '[nonlinear]\npremise = [{ name = "z", term = '
                                                       '"position**2", bounds = [-0.15, 0.28] }]\n'))


def points(plant, count=400):
    """Random points of the ranges, some of them on their ends or at zero."""
    rng, p = np.random.default_rng(1), plant.polytope
    lo, hi = (np.concatenate([plant.limits(v)[i] for v in ("x", "u", "theta")]) for i in (0, 1))
    for _ in range(count):
        at = rng.uniform(lo, hi)
        pick = rng.random(len(lo))
        at = np.where(pick < 0.1, lo, np.where(pick > 0.9, hi, np.where((pick > 0.8) & (lo <= 0) & (hi >= 0), 0.0, at)))
        yield p, np.split(at, [plant.n_x, plant.n_x + plant.n_u])


def equations(p):
    return sympy.lambdify(p.symbols, p.equations, "math")


def residual(plant, count=400):
    """Largest |f - sum h_i (A_i x + B_i u + c_i)| relative to the size of the rows."""
    f, worst = equations(plant.polytope), 0.0
    for p, (x, u, theta) in points(plant, count):
        h, inside = p.weights(x, u, theta)
        if not (inside and h.min() >= 0 and h.max() <= 1 and abs(h.sum() - 1) < 1e-14):
            return np.inf
        true = np.array(f(*x, *u, *theta))
        size = np.array([np.abs(np.hstack([v.A, v.B])).max(axis=1) for v in p.vertices]).max(axis=0)
        worst = max(worst, np.max(np.abs(true - p.right_side(x, u, theta)) / np.maximum(size, 1e-300)))
    return worst


@pytest.mark.parametrize("name", SECTORS)
def test_sector_models_are_exact(name):
    plant = SECTORS[name]
    assert residual(plant) < 1e-12
    assert len(plant.polytope.vertices) == 2 ** len(plant.polytope.premises)


@pytest.mark.parametrize("name", SECTORS)
def test_a_wrong_vertex_weight_or_bound_is_seen(name):
    plant = SECTORS[name]
    p = plant.polytope
    first = p.vertices[0]
    j = int(np.argmax(np.abs(p.vertices[0].A - p.vertices[-1].A)) // plant.n_x)
    A = first.A.copy()
    A[j] *= 1.001
    wrong = [replace(p, vertices=(replace(first, A=A), *p.vertices[1:])),
             replace(p, vertices=p.vertices[1:] + p.vertices[:1]),
             replace(p, premises=(replace(p.premises[0], hi=p.premises[0].hi + 0.1), *p.premises[1:])),
             replace(p, premises=(replace(p.premises[0], term=p.premises[0].term * sympy.Rational(9, 10)),
                                  *p.premises[1:]))]
    for mutant in wrong:
        assert residual(replace(plant, polytope=mutant), 60) > 1e-9


def test_printed_weights_of_the_disc_are_not_exact():
    """(2.22) prints (1 - z)/(z + 1); with it the model is off by more than half."""
    plant = SECTORS["wide disc"]
    p, f, worst = plant.polytope, equations(plant.polytope), 0.0
    assert [v.A[1, 0] for v in p.vertices] == pytest.approx([-2.125, -3.2])
    for _, (x, u, _theta) in points(plant, 200):
        z = x[0] ** 2
        h = (1 - z) / (z + 1)
        printed = h * (p.vertices[0].A @ x) + (1 - h) * (p.vertices[1].A @ x) + p.vertices[0].B @ u
        worst = max(worst, np.abs(printed - f(*x, *u)).max())
    assert worst > 0.1


def test_published_vertices_of_the_disc():
    p = load("disc").polytope
    tight = [[0, 1, 0, 0], [-2.5, -0.75, 0, 0.025], [0, 1, -0.4, 0], [-2.5, -0.75, 0, 0.075]]
    assert np.allclose(p.vertices[0].A, tight, atol=1e-12)
    assert p.vertices[1].A[1, 0] == p.vertices[1].A[3, 0] == pytest.approx(-2.696)
    assert all(v.B.ravel() == pytest.approx([0, 0, 0, -0.125]) and not v.offset.any() for v in p.vertices)
    assert (p.premises[0].lo, p.premises[0].hi) == (0, pytest.approx(0.0784))
    assert p.E.tolist() == np.diag([1, 1, 0, 0]).tolist()


def test_published_points_of_the_linearised_disc():
    """-3.04675 where the thesis prints -2.5, which is the slope at zero."""
    p = load("disc_points").polytope
    left, right = p.vertices
    assert [left.A[1, 0], left.A[3, 0]] == pytest.approx([-2.8, -2.8])
    assert [right.A[1, 0], right.A[3, 0]] == pytest.approx([-3.04675, -3.04675])
    assert left.offset == pytest.approx([0, -0.04, 0, -0.04])
    assert right.offset == pytest.approx([0, 0.098415, 0, 0.098415])
    assert left.A[2].tolist() == [0, 1, -0.4, 0] and left.B.ravel() == pytest.approx([0, 0, 0, -0.125])
    f = equations(p)
    for vertex, at in ((left, -0.2), (right, 0.27)):
        x = np.array([at, 0, 0, 0])
        assert p.weights(x, [0.0])[0][p.vertices.index(vertex)] == 1
        assert p.right_side(x, [0.0]) == pytest.approx(np.array(f(*x, 0.0)), abs=1e-12)
    # Between the points it is no more than near.
    x = np.array([0.03, 0, 0, 0])
    assert 1e-3 < np.abs(p.right_side(x, [0.0]) - np.array(f(*x, 0.0))).max() < 0.2


def test_published_error_of_the_linearised_disc():
    """Table 2.2, called RMS: the mean square of the model as printed (A of 2.5, weights 1 - tanh) over 24 s."""
    def algebraic(x1, x2, u, spring):
        return (spring + 0.75 * x2 + 0.125 * u) / 0.075

    def true(t, x):
        u, spring = max(2 - t, 0.0), 2.5 * (x[0] + x[0] ** 3)
        return [x[1], -spring - 0.75 * x[1] + algebraic(*x, u, spring) / 40]

    def printed(t, x):
        u, h = max(2 - t, 0.0), np.tanh(x[0])
        spring = (1 - h) * (2.8 * x[0] + 0.04) + h * (2.5 * x[0] - 0.0984)
        return [x[1], -spring - 0.75 * x[1] + algebraic(*x, u, spring) / 40]

    times = np.linspace(0, 24, 4801)
    a, b = (scipy.integrate.solve_ivp(f, (0, 24), [0.1, 0.3], t_eval=times, rtol=1e-8, atol=1e-10, max_step=0.05).y
            for f in (true, printed))
    error = np.mean((a - b) ** 2, axis=1)
    spin = error[1] / 0.4**2
    assert error == pytest.approx([2.5e-4, 6e-5], rel=0.05) and spin == pytest.approx(3.9e-4, rel=0.05)


def test_published_vertices_of_the_bioreactor():
    plant = load("bioreactor")
    p, day = plant.polytope, 86400
    assert [(z.name, z.lo, z.hi) for z in p.premises] == [("z1", 0.2, 0.7), ("z2", 0.01, 0.6), ("z3", 0.2, 0.8),
                                                          ("z4", 3.7, 9.9)]
    for i, v in enumerate(p.vertices):
        z1, z2, z3, z4 = (z.hi if i >> k & 1 else z.lo for k, z in enumerate(p.premises))
        A = [[-0.02, 0, 0, 0.1 * z1], [0, 0, 0, -z1], [0, 0, -1, 0.9 * 0.35 * z1], [0, z4 * day, 0, -day]]
        B = [[-0.5 * z1, 0], [-z2, z3], [0, 0], [0, 0]]
        assert np.allclose(v.A * day, A, rtol=1e-14) and np.allclose(v.B * day, B, rtol=1e-14)
    assert len({v.A.tobytes() for v in p.vertices}) == 4 and len({v.B.tobytes() for v in p.vertices}) == 8
    own = loads(plant.text.replace(", bounds = [3.7, 9.9]", "")).polytope.premises[3]
    assert (own.lo, own.hi) == (pytest.approx(4.204, abs=5e-4), pytest.approx(9.068, abs=5e-4))
    # Without the factors of the print: other vertices, as exact.
    free = loads(re.sub(r"# The factors.*?\npremise = \[.*?\n\]\n", "", plant.text, flags=re.S))
    assert len(free.polytope.vertices) == 16 and residual(free) < 1e-12
    assert not np.allclose(free.polytope.vertices[0].A, p.vertices[0].A)


def test_weights_are_closed_expressions():
    """Of the state, the input and theta; those that are normalised too."""
    for name in ("disc", "bioreactor", "dlpv", "disc_points"):
        plant = load(name)
        p = plant.polytope
        numeric = sympy.lambdify(p.symbols, p.expressions, "math")
        assert len(p.expressions) == len(p.vertices)
        for _, (x, u, theta) in points(plant, 30):
            assert np.allclose(numeric(*x, *u, *theta), p.weights(x, u, theta)[0], atol=1e-13)


def test_weights_in_c_are_those_of_the_model(tmp_path):
    need("gcc")
    plants, lines, expected = [load(n) for n in ("disc", "bioreactor", "dlpv", "disc_points")], [], []
    for plant in [*plants, SECTORS["pendulum"]]:
        p = plant.polytope
        for _, at in points(plant, 5):
            values = np.concatenate(at)
            lines.append("{" + "".join(f"const double {s} = {float(v)!r};" for s, v in zip(p.symbols, values)))
            for i, weight in enumerate(p.expressions):
                text = sympy.ccode(weight, strict=True)
                lines.append(f'printf("%.17g\\n", {text});')
                expected.append(p.weights(*at)[0][i])
            lines.append("".join(f"(void){s};" for s in p.symbols) + "}")
    text = "#include <math.h>\n#include <stdio.h>\n"
    (tmp_path / "w.c").write_text(text + "int main(void){" + "\n".join(lines) + "return 0;}")
    subprocess.run(["gcc", "-std=c99", "-o", "w", "w.c", "-lm"], cwd=tmp_path, check=True)
    out = subprocess.run(["./w"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout.split()
    assert len(out) == len(expected) > 300
    assert np.allclose([float(v) for v in out], expected, atol=1e-13)


def test_gaussian_weights_hold_far_from_all_centres():
    p = load("dlpv").polytope
    assert p.softmax
    h, inside = p.weights([300.0, 0, 0], [0.0])
    assert inside and h.tolist() == [0, 0, 1]  # each exp is zero in float64, the largest is not in doubt
    h, inside = p.weights([np.nan, 0, 0], [0.0])
    assert not inside and h.tolist() == [1 / 3] * 3
    # At the instant of the thesis' page 81, x1 = .1440: the Gaussians with the minus sign.
    assert p.weights([0.1440, 0, 0], [0.0])[0] == pytest.approx([0.6731, 0.0459, 0.2810], abs=2e-4)


def test_outside_the_ranges_weights_are_clamped_and_say_so():
    p = load("disc").polytope
    assert p.weights([0.28, 0, 0, 0], [0.0]) == (pytest.approx([0, 1]), True)
    h, inside = p.weights([0.5, 0, 0, 0], [0.0])
    assert not inside and h.tolist() == [0, 1]
    h, inside = p.weights([np.nan, 0, 0, 0], [0.0])
    assert not inside and h.tolist() == [1, 0]


def test_a_quotient_is_its_limit_at_zero():
    plant = SECTORS["pendulum"]
    slopes = [z for z in plant.polytope.premises if z.term.has(sympy.Piecewise)]
    assert len(slopes) == 2
    f = equations(plant.polytope)
    for angle in (0.0, 1e-12, -1e-9, 1e-8, 2e-8, -1e-7, 1e-4):
        x = np.array([angle, 0.3])
        assert np.abs(plant.polytope.right_side(x, [0.5], [1.0]) - np.array(f(*x, 0.5, 1.0))).max() < 1e-14


def test_given_factors_are_compared_with_the_equations_by_identities():
    """sin^2 + cos^2 = 1 is seen, and so is a common denominator; the constant that is left over is the offset."""
    text = PENDULUM.replace('f = [', 'A = [[0, 1], [0, "-rate/(rate + 4)"]]\nB = [[0], ["sin(angle)**2"]]\nf = [')
    text = re.sub(r'"-g\*sin.*?"\]', '"push*(1 - cos(angle)**2) - rate + 4*rate/(rate + 4) + 0.5"]', text)
    plant = loads(text)
    assert residual(plant, 100) < 1e-12
    assert all(v.offset.tolist() == [-0.2, 0.5] for v in plant.polytope.vertices)


def test_what_varies_with_parameters_alone_goes_to_the_offset():
    plant = loads(PENDULUM.replace("- 1\"]", "- gust**2\"]").replace("cos(angle)*push", "push"))
    assert residual(plant, 100) < 1e-12
    assert len({v.offset.tobytes() for v in plant.polytope.vertices}) == 2


def test_a_linear_descriptor_plant_is_one_vertex():
    text = re.sub(r"\[\[vertex\]\]\nA = \[\[-10, 5, 6.5\], \[5.*?(?=\[\[scenario)", "", load("dlpv").text, flags=re.S)
    one = loads(text.replace('weight = "exp(-0.5*((x1 + 0.4)/0.5)**2)"', ""))
    assert len(one.polytope.vertices) == 1 and one.polytope.weights([9.0, 9, 9], [0.0])[0].tolist() == [1.0]
    assert one.modes == () and one.polytope.vertices[0].Bw.tolist() == [[1], [0], [0.5]]


def test_powers_of_one_state_are_premises_of_their_own():
    """x**4 is not read as the square of the premise x**2, nor is a premise of the file taken out of another."""
    text = PENDULUM.replace("2*exp(0.5*angle)", "0.1*angle**5 - angle**3").replace("cos(angle)*push", "push")
    plant = loads(text)
    terms = {str(z.term) for z in plant.polytope.premises}
    assert {"angle**2", "angle**4"} <= terms and residual(plant, 100) < 1e-12
    named = loads(text.replace("[nonlinear]", '[nonlinear]\npremise = [{ name = "p", term = "angle**4" }]'))
    assert named.polytope.premises[0].name == "p" and residual(named, 100) < 1e-12


def test_equations_that_are_linear_are_one_vertex():
    text = load("disc").text.replace(" + position**3", "")
    p = loads(text).polytope
    assert len(p.vertices) == 1 and p.premises == () and p.vertices[0].A[1, 0] == -2.5
    assert p.weights([0.0] * 4, [0.0]) == ([1.0], True)


def test_a_term_that_does_not_vary_is_no_premise():
    plant = loads(load("bioreactor").text.replace("range = [0.2, 0.8]", "range = [0.5, 0.5]"))
    assert [z.name for z in plant.polytope.premises] == ["z1", "z2", "z4"]
    assert len(plant.polytope.vertices) == 8 and residual(plant, 50) < 1e-12
