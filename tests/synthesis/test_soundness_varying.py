"""Parameters, unknowns and radii: the observers contain the exact state, and mutants of what covers them do not.

The discrete plant ``plant.observed`` is simulated in exact rational arithmetic: every unknown s in a corner of [-1, 1],
every entry of the boxes dA, dB at an end, disturbances and noise in corners, parameters in corners of what the
firmware may read, a switch at every sample; nothing is compared with a tolerance. That ``observed`` encloses a
continuous plant is ``test_sampling``'s part.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from exact import Q, false_alarms, lost, nearest
from helpers.varying import changed_text

from codegen.certify.freeze import with_offsets
from codegen.observers import framer
from codegen.plant.load import load, loads
from codegen.plant.uncertain import UncertainMode
from codegen.selection.select import choose

VARYING = ("chevet", "buck", "motor", "lamouchi", "lamouchi_detector", "zammali_lpv_dt", "zammali_lpv_ct1",
           "zammali_lpv_quadratic")
CHANGED = ("lamouchi", "chevet")  # again, in other coordinates

# Everything at once in discrete time, states on both sides of zero; "split" as lamouchi has no measured parameter.
SMALL = """
format = 1
name = "small"
[time]
kind = "discrete"
sample_period = 1
[signals]
x = [{ name = "a", range = [-60, 60] }, { name = "b", range = [-60, 60] }]
u = [{ name = "u", range = [-5, 7] }]
y = [{ name = "y", range = [-150, 150] }]
w = [{ name = "w", bounds = [-0.1, 0.3] }]
v = [{ name = "v", bounds = [-2, 2] }]
theta = [{ name = "e", bounds = [1, 2], error = 0.05 }, { name = "g", bounds = [-0.1, 0.1], measured = false }]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[common]
C = [[1, 0.5]]
Dv = [[1]]
Bw = [[1], [-1]]
[[mode]]
name = "one"
A = [["0.3*e - 0.2", "0.3 + g"], ["0.1 + 0.2*e", "0.2 - g"]]
B = [["e"], ["1 + g"]]
[[mode]]
name = "two"
A = [["0.1*e + g", 0.4], ["0.3*e - 0.1", "0.3"]]
B = [["-e"], [1]]
"""
# A plant of one mode with rates, so that a step takes the mean of the parameters at both ends.
RATED = SMALL.replace('kind = "discrete"', 'kind = "continuous"').replace(
    "sample_period = 1", "sample_period = 0.02").replace(
    "error = 0.05", "rate = 20").replace('"0.3*e - 0.2"', '"-2*e"').replace('"0.2 - g"', '"-1 - g"').replace(
    '"0.1*e + g"', '"-e"').replace('"0.3"]]', '"-2"]]')
OWN = {"small": (SMALL, "lpv-interval"), "small tnl": (SMALL, "tnl-interval-lpv"), "rated": (RATED, "lpv-interval"),
       "changed": (changed_text().replace("[-0.01, 0.01]", "[-0.08, 0.08]"), "component-interval")}
CASES = [*VARYING, *OWN, *(f"{name} changed" for name in CHANGED)]
_DONE = {}


@dataclass(frozen=True)
class Runs:
    """Exact states (rows of fmpq) and what the firmware reads of S runs."""

    x: list
    u: np.ndarray
    y: np.ndarray
    q: np.ndarray
    theta: np.ndarray


def corner(lo, hi, rng):
    return np.where(rng.random(np.shape(lo)) < 0.5, lo, hi)


def exact_sum(matrix, vector):
    return [sum((Q(a) * b for a, b in zip(row, vector) if a), Q(0)) for row in matrix]


def simulate(plant, seed, steps=60, hold=5):
    """One exact run of ``plant.observed``; signals stay for a while, so that they add up."""
    rng, seen = np.random.default_rng(seed), plant.observed
    def rational(values):
        return [Q(a) for a in values]

    x, q = rational(corner(plant.x0_lo, plant.x0_hi, rng)), rng.integers(0, plant.n_modes, steps)
    boxes = [(m.theta_lo, m.theta_hi) for m in seen.modes]
    theta = np.array([corner(*boxes[i], rng) for i in q]).reshape(steps, -1).astype(np.float32)
    theta = np.array([np.clip(t, *boxes[i]) for t, i in zip(theta, q)]).astype(np.float32)
    if seen.modes[0].products:  # within their rates, and at rest half of the time
        theta = paced(theta, seen.modes[0], rng)
    rows, ys, us = [], [], []
    for k in range(steps):
        m: UncertainMode = seen.modes[q[k]]
        if k % hold == 0:
            u = corner(*plant.limits("u"), rng)
            signs = rng.choice([-1, 1], 2 + len(m.A_unc) + 64)
        w, v = corner(m.w_lo, m.w_hi, rng), corner(m.v_lo, m.v_hi, rng)
        us.append(u)
        rows.append(x)
        now = rational(u)
        ys.append([a + b for a, b in zip(exact_sum(m.C, x), exact_sum(m.Dv, rational(v)))])
        p = rational(theta[k])
        if plant.reads_both_ends:
            p = [(a + Q(b)) / 2 for a, b in zip(p, theta[min(k + 1, steps - 1)])]
        p += [p[j] * p[k] for j, k in m.products]
        change = [Q(b) - Q(a) for a, b in zip(theta[k], theta[min(k + 1, steps - 1)])]
        pace = [-1] * len(m.A_unc) if m.paced is None else m.paced
        share = [1 if j < 0 else 1 - (change[j] / Q(m.reach[j])) ** 2 for j in pace]
        after = [a + b + c for a, b, c in zip(exact_sum(m.A, x), exact_sum(m.B, now), exact_sum(m.Bw, rational(w)))]
        parts = [(t, F, G) for t, F, G in zip(p, m.A_theta, m.B_theta)]
        parts += [(Q(s) * r, F, G) for s, r, F, G in zip(signs[2:], share, m.A_unc, m.B_unc)]
        for factor, F, G in parts:
            after = [a + factor * (b + c) for a, b, c in zip(after, exact_sum(F, x), exact_sum(G, now))]
        # dA, dB at the end that pushes state i up or down as far as it goes.
        sizes = [abs(a) for a in x], [abs(a) for a in now]
        apart = [b + c for b, c in zip(exact_sum(m.A_rad, sizes[0]), exact_sum(m.B_rad, sizes[1]))]
        x = [a + int(signs[-1 - i % 2]) * b for i, (a, b) in enumerate(zip(after, apart))]
    return rows, np.array(us), ys, q, theta


def paced(theta, mode, rng):
    """A path from one corner to the next, at most as fast as the rates, held for a while at each."""
    out, goal = theta.copy(), theta[0]
    for k in range(1, len(out)):
        goal = theta[k] if k % 8 == 0 else goal
        step = np.clip(goal.astype(float) - out[k - 1], -0.999 * mode.reach, 0.999 * mode.reach)
        out[k] = np.clip((out[k - 1] + step * (k % 8 > 3)).astype(np.float32), mode.theta_lo, mode.theta_hi)
    return out


def case(name, runs=6):
    """Design and exact runs, made once."""
    if name not in _DONE:
        text, method = OWN.get(name, (None, None))
        gallery, *changed = name.split()
        plant = loads(text, name) if text else load(gallery)
        options = {**plant.options, **({"criterion": "width"} if text else {})}
        if changed and not text:
            method, options = "component-interval", {"coordinates": "change"}
        design = choose(plant, method or plant.method, options, lambda message: None)
        out = [simulate(plant, 11 * s + len(name)) for s in range(runs)]
        y = np.array([[[nearest(a) for a in row] for row in r[2]] for r in out])
        _DONE[name] = design, Runs([r[0] for r in out], np.array([r[1] for r in out]), y,
                                   np.array([r[3] for r in out]), np.array([r[4] for r in out]))
    return _DONE[name]


def feed(observer, r):
    return observer.run_many(r.u, r.y, r.q, theta=r.theta)


def missed(trace, r):
    """Samples at which the exact state is outside; those in the declared ranges alone count."""
    class Row:
        def __init__(self, x):
            self.x = x
    return lost([Row(x) for x in r.x], trace)


def with_tables(design, **changes):
    t = design.observer.tables["float32"]
    vary = replace(t.vary, **{k: v for k, v in changes.items() if hasattr(t.vary, k) and k not in ("d_hi", "d_lo")})
    new = replace(t, vary=vary, **{k: v for k, v in changes.items() if k in ("d_hi", "d_lo")})
    return type(design.observer)({"float32": new}, design.observer.supervision)


@pytest.mark.parametrize("name", CASES)
def test_contains_the_exact_state(name):
    design, r = case(name)
    lo, hi = ([Q(a) for a in side] for side in design.plant.limits("x"))
    kept = all(a <= b <= c for run in r.x for row in run for a, b, c in zip(lo, row, hi))
    assert kept, "runs must keep to the ranges"
    trace = feed(design.observer, r)
    assert np.all(trace.status == 0)
    assert missed(trace, r) == 0 and false_alarms(trace) == 0


@pytest.mark.parametrize("name", CASES)
def test_unmutated_copy_survives(name):
    design, r = case(name)
    t = with_offsets(design.plant.observed.modes, design.observer.tables["float32"])
    assert missed(feed(type(design.observer)({"float32": t}, design.observer.supervision), r), r) == 0


# -- mutants ---------------------------------------------------------------------------------------
def no_radius(design, monkeypatch):
    t = design.observer.tables["float32"].vary
    return with_tables(design, R=0 * t.R, S=0 * t.S)


def no_input_radius(design, monkeypatch):
    return with_tables(design, S=0 * design.observer.tables["float32"].vary.S)


def no_noise(design, monkeypatch):
    """The noise through L(theta) is forgotten."""
    return with_tables(design, E=0 * design.observer.tables["float32"].vary.E)


def noise_of_one_corner(design, monkeypatch):
    """|L(theta)| taken once, at the corner of the box where it is smallest, and put into the offsets."""
    t = design.observer.tables["float32"]
    v = t.vary
    corners = [t.L_hi + np.einsum("qj,qjxy->qxy", c, v.L) for c in (v.theta_lo, v.theta_hi)]
    least = np.min([np.sum(np.abs(L) * v.E, axis=2) for L in corners], axis=0).astype("float32")
    return with_tables(design, E=0 * v.E, d_hi=t.d_hi + least, d_lo=t.d_lo - least)


def one_sided(design, monkeypatch):
    """The unknown counts with the sign of the upper framer: a state below zero makes the radius shrink."""
    monkeypatch.setattr(framer, "spread", lambda R, S, lo, hi, u: framer.add_terms(
        framer.add_terms(np.zeros_like(lo), R, hi), S, u))
    return design.observer


def start_of_the_step(design, monkeypatch):
    """The parameters at the start of the step in place of their mean."""
    return with_tables(design, midpoint=False)


def never_off(design, monkeypatch):
    """The mean of both ends taken for the mean over the step, whatever the parameter did."""
    return with_tables(design, top=0 * design.observer.tables["float32"].vary.top)


def wrong_product(design, monkeypatch):
    """Squares of the first parameter in place of the products."""
    return with_tables(design, products=((0, 0), (0, 0), (1, 1)))


def coordinates_transposed(design, monkeypatch):
    """x = S' z in place of S z."""
    t = design.observer.tables["float32"]
    turned = replace(t, change=replace(t.change, X=np.ascontiguousarray(t.change.X.T)))
    return type(design.observer)({"float32": turned}, design.observer.supervision)


def parts_exchanged(design, monkeypatch):
    """The bounds of x take the bounds of z by the sign of the wrong matrix: pos(S) and neg(S) exchanged."""
    t, right = design.observer.tables["float32"], framer.add_chosen_terms

    def wrong(total, matrix, flipped, own, other):
        back = matrix.shape[1:] == t.change.X.shape and np.array_equal(matrix[0], t.change.X)
        return right(total, matrix, ~flipped if back else flipped, own, other)
    monkeypatch.setattr(framer, "add_chosen_terms", wrong)
    return design.observer


MUTANTS = {
    never_off: ("zammali_lpv_quadratic",), wrong_product: ("zammali_lpv_quadratic",),
    no_radius: ("chevet", "buck", "motor", "lamouchi", "lamouchi changed", "small", "small tnl", "rated",
                "changed"),
    coordinates_transposed: ("lamouchi changed", "chevet changed", "changed"),
    parts_exchanged: ("lamouchi changed", "chevet changed", "changed"),
    no_input_radius: ("small", "rated"),
    no_noise: ("small", "zammali_lpv_dt"),
    noise_of_one_corner: ("small", "zammali_lpv_dt"),
    one_sided: ("chevet", "lamouchi", "lamouchi changed", "small", "small tnl"),
    start_of_the_step: ("rated", "motor"),
}


@pytest.mark.parametrize(("mutant", "name"), [(m, n) for m, names in MUTANTS.items() for n in names])
def test_mutant_loses_the_state(mutant, name, monkeypatch):
    design, r = case(name)
    assert missed(feed(mutant(design, monkeypatch), r), r) > 0


def test_a_parameter_outside_its_box_is_refused_and_not_saturated():
    """The status says so; an observer that takes it silently for the end of the box loses the state."""
    design, r = case("small")
    v = design.observer.tables["float32"].vary
    wrong = replace(r, theta=r.theta + np.where(r.theta > 1.5, 1, 0).astype("float32"))
    trace = feed(design.observer, wrong)
    beyond = np.any(wrong.theta > v.theta_hi[wrong.q], axis=2)
    assert beyond.any() and np.array_equal(trace.status != 0, beyond)
    assert not trace.assured[beyond].any()
    saturated = replace(r, theta=np.clip(r.theta, v.theta_lo[r.q], (v.theta_lo[r.q] + v.theta_hi[r.q]) / 2))
    assert missed(feed(design.observer, saturated), r) > 0
