"""Scripts of all families but framers and point observers are about the sums that the reference calculates, with ==."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers import driven, follower, guided, guided_filter, guided_point, small_sliding, solved, trailing
from helpers.kept import OTHERS, family_of
from helpers.small_modes import PLANTS, stand_in
from target.test_gappa import REALS, evaluate, fraction, script_of

from codegen.certify.descriptor_bounds import algebraic_rounding
from codegen.certify.exact import Q
from codegen.certify.fault_bounds import slips
from codegen.certify.filter_model import joint, rounding_of
from codegen.certify.loose_filter import rounded_start
from codegen.certify.polytope_rounding import rounding as rounding_bounds
from codegen.certify.sets import SetDemands
from codegen.designs import read_design
from codegen.observers.descriptor import of_pivots
from codegen.observers.filter import add_terms
from codegen.observers.framer import open_loop, propagate, residuals, scheduled, to_x, to_z
from codegen.observers.mode_set import ModeSet, affine, image
from codegen.observers.point import blind, forward, residual
from codegen.observers.polytopic_step import evaluate as evaluate_program
from codegen.observers.polytopic_step import step
from codegen.observers.sliding import carried

ROW = r'(?m)^# [^\n]*: margin [^\n]*\n(\w+) r=$'
FILTERS = [f for f in OTHERS if family_of(f) == "filter"]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("folder", FILTERS, ids=lambda f: f.name)
def test_script_of_a_filter_is_about_the_sums_of_the_reference(folder, real):
    """The margin of each is what the model behind the thresholds holds for the rounding of the sum."""
    design, rng = read_design(folder), np.random.default_rng(3)
    t, text = design.observer.tables[real], script_of(design, real)
    ranges = ((-t.limit, t.limit), (t.u_lo, t.u_hi), (t.y_lo, t.y_hi))
    xi, u, y = (rng.uniform(lo, hi).astype(real) for lo, hi in ranges)
    values = {f"{s}_{j}": a for s, row in (("s_xi", xi), ("in_u", u), ("in_y", y)) for j, a in enumerate(row)}
    checked, model = 0, joint(design.plant.observed.modes, t)
    for note, name, which, i in re.findall(
            r'(?m)^# [^\n]*, mode (.*): margin [^\n]*\n(\w+_(estimate|forward)_(\d+)_mode_\d+) r=$', text):
        of_u, of_y, state = (getattr(t, k) for k in (("Du", "Dy", "K") if which == "estimate" else ("G", "L", "M")))
        i, margin = int(i), Q(float.fromhex(re.search(rf"exact_{name}\| <= (\S+)", text)[1]))
        for q, mode in enumerate(design.plant.modes):
            if f'"{mode.name}"' not in note:
                continue
            p = np.array([q])
            result = add_terms(add_terms(add_terms(np.zeros((1, state.shape[1]), real), of_u[p], u[None]), of_y[p],
                                         y[None]), state[p], xi[None])
            assert evaluate(text, name, values, np.dtype(real).type) == result[0, i], name
            held = rounding_of(t, which, q)[i]
            assert 0 < margin <= held
            if which == "forward":  # what the model of the proof adds for this very sum
                push = next(x for x in model[q].pushes if x.h[len(t.x_lo) + i] == 1 and not np.any(x.seen)
                            and np.any(x.weight) and not np.any(x.S))
                assert push.room + sum(w * Q(b) for w, b in zip(push.weight[len(t.x_lo):], t.limit)) == held
            checked += 1
    assert checked == len(design.plant.modes) * (len(t.limit) + t.K.shape[1])


POLYTOPIC = [f for f in OTHERS if family_of(f) == "polytopic"]
SOLVED = [f for f in OTHERS if family_of(f) == "descriptor"]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("folder", POLYTOPIC, ids=lambda f: f.name)
def test_script_of_a_polytopic_observer_is_about_the_sums_of_the_reference(folder, real):
    """Put one into the other, the sums make a whole step; each margin is a part of what the thresholds hold."""
    design, rng, number = read_design(folder), np.random.default_rng(5), np.dtype(real).type
    t, text, prefix = design.observer.tables[real], script_of(design, real), design.plant.target.prefix
    z, y, u = (rng.uniform(lo, hi).astype(real) for lo, hi in ((t.z_lo, t.z_hi), (t.y_lo, t.y_hi), (t.u_lo, t.u_hi)))
    x_hat, r, _, after = step(t, z[None], u[None], y[None], np.zeros((1, 0), real), np.array([True]))
    weights = np.array([w[0] for w in evaluate_program(t.weights, [*x_hat.T, *u[None].T], real)[:-1]], real)
    known = slips(t, design.plant.polytope.premises).size if t.known.size else ()
    held = rounding_bounds(t, known)
    values = {f"{s}_{j}": a for s, row in (("z", z), ("y", y), ("u", u), ("x_hat", x_hat[0]), ("r", r[0]),
                                           ("h", weights), ("g", weights[len(t.F):])) for j, a in enumerate(row)}
    names = re.findall(ROW, text)
    for name in (n for n in names if "_vertex_" in n):
        values["v_" + name.partition("_vertex_")[2]] = evaluate(text, name, values, number)
    expected = {"estimate": (x_hat[0], held.x_hat), "residual": (r[0], held.r), "move": (after[0], held.z)}
    for name in (n for n in names if "_vertex_" not in n):
        which, i = name.removeprefix(f"{prefix}_").split("_")
        margin = Q(float.fromhex(re.search(rf"exact_{name}\| <= (\S+)", text)[1]))
        assert evaluate(text, name, values, number) == expected[which][0][int(i)], name
        assert 0 < margin <= expected[which][1][int(i)]
    stated = {name.removeprefix(f"{prefix}_").rpartition("_")[0] for name in names}
    assert {"estimate", "residual", "move"} <= stated and sum("_move_" in n for n in names) >= len(z) - 1


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("which", [*SOLVED, "two pivots"], ids=lambda w: getattr(w, "name", w))
def test_script_of_solved_equations_is_about_the_sums_of_the_reference(which, real):
    """Weights at z; what every vertex says of an algebraic state, the state, residual and z of the next sample."""
    design = solved.stand_in(True, real) if which == "two pivots" else read_design(which)
    rng, number = np.random.default_rng(6), np.dtype(real).type
    t, text, prefix = design.observer.tables[real], script_of(design, real), design.plant.target.prefix
    z, y, u = (rng.uniform(lo, hi).astype(real) for lo, hi in ((t.z_lo, t.z_hi), (t.y_lo, t.y_hi), (t.u_lo, t.u_hi)))
    x_hat, r, _, after = design.observer.advance(t, z[None], u[None], y[None], np.zeros((1, 0), real), np.array([True]))
    h = np.array([w[0] for w in evaluate_program(t.weights, [*z[None].T, *u[None].T], real)[:-1]], real)
    values = {f"{s}_{j}": a for s, row in (("z", z), ("y", y), ("u", u), ("x_hat", x_hat[0]), ("r", r[0]), ("h", h), (
        "g", of_pivots(t, h[None])[0])) for j, a in enumerate(row)}
    names, held = re.findall(ROW, text), rounding_bounds(t, (), algebraic_rounding(t))
    for name in names:
        for kind, letter in (("solved", "a"), ("vertex", "v")):
            if f"_{kind}_" in name:
                values[f"{letter}_" + name.partition(f"_{kind}_")[2]] = evaluate(text, name, values, number)
    expected = {"estimate": (x_hat[0], held.x_hat), "residual": (r[0], held.r), "move": (after[0], held.z)}
    said = [name.removeprefix(f"{prefix}_").split("_") for name in names]
    for kind, *at in said:
        margin = Q(float.fromhex(re.search(rf"exact_{'_'.join((prefix, kind, *at))}\| <= (\S+)", text)[1]))
        i = int(at[0])
        if kind in expected:
            assert evaluate(text, f"{prefix}_{kind}_{i}", values, number) == expected[kind][0][i], (kind, i)
        assert 0 < margin <= expected.get(kind, expected["estimate" if kind == "solved" else "move"])[1][i]
    assert {int(at[0]) for kind, *at in said if kind == "estimate"} == set(t.algebraic)
    assert {int(at[0]) for kind, *at in said if kind == "move"} == set(t.moving)
    assert ("g_0 in [" in text) == t.uneven


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("plant", PLANTS)
def test_script_of_a_mode_estimator_is_about_the_sums_of_the_reference(plant, real):
    design, rng = stand_in(plant, 3), np.random.default_rng(4)
    names, expected, values, text, prefix = boxes_of(design, real, rng)
    assert {f"{prefix}_{name}" for name in expected} == set(names) and len(names) == len(expected)
    agree(text, prefix, expected, values, real)


def boxes_of(design, real, rng):
    """Names of the script; the sums of boxes, and the numbers that they read."""
    t, text, run = design.observer.tables[real], script_of(design, real), ModeSet(design.observer.tables[real])
    lo, hi = np.sort(rng.uniform(-t.limit, t.limit, (2, len(t.limit))), axis=0).astype(real)
    u, y = (rng.uniform(a, b).astype(real) for a, b in ((t.u_lo, t.u_hi), (t.y_lo, t.y_hi)))
    size = np.where(-lo > hi, -lo, hi)
    values = {f"{s}_{j}": a for s, row in (("s_lo", lo), ("s_hi", hi), ("in_u", u), ("in_y", y), ("a", np.abs(u)),
                                           ("m", size)) for j, a in enumerate(row)}
    expected, prefix = {}, design.plant.target.prefix
    ends = zip(("lo", "hi"), (run.seen(u, y) - t.v_hi, run.seen(u, y) - t.v_lo))
    expected |= {f"cut_{side}_{i}": v for side, row in ends for i, v in enumerate(row)}
    below, above = image(t.S_inverse, lo, hi, np.zeros(len(lo), real))
    for side, row in (("lo", below - t.x_room), ("hi", above + t.x_room)):
        expected |= {f"answer_{side}_{i}": v for i, v in enumerate(row)}
    modes = range(design.plant.n_modes)
    for q in modes:
        base = run.carried(q, (lo, hi), u)
        for side, row in (("lo", base[0] - t.reach[q]), ("hi", base[1] + t.reach[q])):
            expected |= {f"carried_{side}_{i}_mode_{q}": v for i, v in enumerate(row)}
        for p in (p for p in modes if p != q):
            added, _ = image(t.J[p, q], lo, hi, affine(t.J_shift[p, q], t.J_u[p, q], u))
            radius = affine(affine(t.J_reach[p, q], t.J_u_radius[p, q], np.abs(u)), t.J_radius[p, q], size)
            row = (base[0] + (added - radius)) - t.birth[p, q]
            expected |= {f"born_{i}_modes_{p}_{q}": v for i, v in enumerate(row)}
    return re.findall(ROW, text), expected, values, text, prefix


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("plant", PLANTS)
def test_script_of_sliding_modes_is_about_the_sums_of_the_reference(plant, real):
    design, rng = small_sliding.stand_in(plant), np.random.default_rng(5)
    names, expected, values, text, prefix = pairs_of(design, real, rng)
    assert {f"{prefix}_{name}" for name in expected} == set(names) and len(names) == len(expected)
    agree(text, prefix, expected, values, real)


def pairs_of(design, real, rng):
    """Names of the script; the sums of pairs, and the numbers that they read."""
    t, text = design.observer.tables[real], script_of(design, real)
    lo, hi = np.sort(rng.uniform(-t.limit, t.limit, (2, len(t.limit))), axis=0).astype(real)
    u, y = (rng.uniform(a, b).astype(real) for a, b in ((t.u_lo, t.u_hi), (t.y_lo, t.y_hi)))
    seen = affine(y, -t.D, u)
    values = {f"{s}_{j}": a for s, row in (("s_lo", lo), ("s_hi", hi), ("in_u", u), ("in_y", y), ("seen", seen))
              for j, a in enumerate(row)}
    expected = {f"seen_{i}": v for i, v in enumerate(seen) if np.any(t.D)}
    for side, row, v in zip(("lo", "hi"), image(t.H, lo, hi, np.zeros(len(y), real)), (t.v_lo, t.v_hi)):
        expected |= {f"tested_{side}_{i}": a for i, a in enumerate(row + v)}
    for q in range(design.plant.n_modes):
        for side, x, parts in (("lo", lo, (t.d_lo, t.G, t.L_lo, t.M_lo)), ("hi", hi, (t.d_hi, t.G, t.L_hi, t.M_hi))):
            row = carried([part[q] for part in parts], u, seen, x)
            expected |= {f"moved_{side}_{i}_mode_{q}": a for i, a in enumerate(row)}
    return re.findall(ROW, text), expected, values, text, design.plant.target.prefix


def agree(text, prefix, expected, values, real):
    """The sums of the script are those expected; exact, they are the same words, off by the margin at most."""
    for name, value in expected.items():
        rounded, exact = (evaluate(text, f"{s}{prefix}_{name}", values, fraction) for s in ("", "exact_"))
        assert rounded == exact
        got = evaluate(text, f"{prefix}_{name}", values, np.dtype(real).type)
        assert got == value, name
        assert abs(fraction(got) - exact) <= fraction(float.fromhex(
            re.search(rf"exact_{prefix}_{name}\| <= (\S+)", text)[1]))


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("plant", driven.PLANTS)
def test_script_of_driven_framers_is_about_the_sums_of_the_reference(plant, real):
    """Boxes as of an estimator; framers of every mode with parameters; and S x of these."""
    design, rng = driven.stand_in(plant), np.random.default_rng(5)
    names, expected, values, text, prefix = boxes_of(design, real, rng)
    agree(text, prefix, expected, values, real)
    t = design.observer.tables[real]
    lo, hi, own = framers_of(t, names, values, (text, prefix, "frame_m"), rng)
    below, above = image(t.S_rounded, lo, hi, np.zeros(len(t.S), real))
    own |= {f"narrowed_{side}_{i}": v for side, row in (("lo", below - t.xi_room), ("hi", above + t.xi_room))
            for i, v in enumerate(row)}
    known = {f"{prefix}_{name}" for name in (*expected, *own)}
    assert known <= set(names) and all(re.search(r"_(theta|L|residual)_", name) for name in set(names) - known)
    agree(text, prefix, own, values, real)


@pytest.mark.parametrize("plant, real", [("no input, two outputs", "float64"), ("parameters", "float32"),
                                         ("turned", "float32")])
def test_script_of_guided_framers_is_about_the_sums_of_the_reference(plant, real):
    """Pairs as of an estimator; and framers of every mode, with what they expect of y."""
    design, rng = guided.stand_in(plant), np.random.default_rng(6)
    names, expected, values, text, prefix = pairs_of(design, real, rng)
    agree(text, prefix, expected, values, real)
    t = design.observer.tables[real]
    lo, hi, own = framers_of(t, names, values, (text, f"{prefix}_told", "m"), rng)
    values |= {f"out_x_{side}_{j}": a for side, row in (("lo", lo), ("hi", hi)) for j, a in enumerate(row)}
    u, y = (np.array([[values[f"in_{v}_{j}"] for j in range(n)]], dtype=real).reshape(1, n)
            for v, n in (("u", len(t.u_lo)), ("y", len(t.y_lo))))
    for q in range(design.plant.n_modes):
        # The measurement is subtracted last, which keeps the sign.
        for side, row in zip(("lo", "hi"), residuals(t.told, np.array([q]), lo[None], hi[None], u, 0 * y)):
            own |= {f"residual_{side}_{i}_mode_{q}": v for i, v in enumerate(row[0])
                    if f"{prefix}_told_residual_{side}_{i}_mode_{q}" in names}
    known = {*(f"{prefix}_{name}" for name in expected), *(f"{prefix}_told_{name}" for name in own)}
    assert known <= set(names) and all(re.search(r"_told_(theta|L)_", name) for name in set(names) - known)
    assert sum("residual" in name for name in known) >= 2 * len(t.y_lo)
    agree(text, f"{prefix}_told", own, values, real)


def framers_of(t, names, values, script, rng):
    """Bounds of x, and the sums of framers from there; the numbers that these read are put to the values."""
    (text, prefix, size), told, real, n_u = script, t.told, t.real, len(t.u_lo)
    lo, hi = np.sort(rng.uniform(-told.box, told.box, (2, 1, len(told.box))), axis=0).astype(real)
    u, y, y_next = (rng.uniform(a, b, (1, len(a))).astype(real) for a, b in (
        (t.u_lo, t.u_hi), (t.y_lo, t.y_hi), (t.y_lo, t.y_hi)))
    values |= {f"in_y_{j}": a for j, a in enumerate(y_next[0])} | {f"a_{j}": abs(u[0, j]) for j in range(n_u)}
    values |= {f"s_{v}_{j}": a for v, row in (("x_lo", lo), ("x_hi", hi), ("u", u), ("y", y)) for j, a in
               enumerate(row[0])}
    values |= {f"{size}_{j}": a for j, a in enumerate(np.maximum(-lo, hi)[0])}
    uncut, z = replace(told, clamp=False, x_lo=told.x_lo - np.inf, x_hi=told.x_hi + np.inf), None
    if told.change is not None:
        c = told.change
        z = tuple(np.sort(rng.uniform(-c.box, c.box, (2, 1, len(c.box))), axis=0).astype(real))
        values |= {f"s_z_{side}_{j}": a for side, row in zip(("lo", "hi"), z) for j, a in enumerate(row[0])}
        uncut = replace(uncut, change=replace(c, z_lo=c.z_lo - np.inf, z_hi=c.z_hi + np.inf))
    theta = np.zeros((1, 0), dtype=real)
    if told.vary is not None and told.vary.parameters:
        theta = rng.uniform(told.vary.theta_lo[:1], told.vary.theta_hi[:1]).astype(real)
        values |= {f"th_{j}_mode_0": a for j, a in enumerate(theta[0])}
        for i, j, q in re.findall(r"(?m)^\w+_L_(\d+)_(\d+)_mode_(\d+) r=$", text):
            at, name = np.array([int(q)]), f"L_{i}_{j}_mode_{q}"
            gain = scheduled(told.L_hi[at], told.vary.L[at], theta)[0, int(i), int(j)]
            assert evaluate(text, f"{prefix}_{name}", values, np.dtype(real).type) == gain
            values |= {f"size_{name}": abs(gain), f"exact_size_{name}": abs(gain)}
    own = {}
    for q in range(len(told.M_hi)):
        p = np.array([q])
        for which, sides in (("forward", propagate(uncut, p, lo, hi, u, y, y_next, theta, z)),
                             ("blind", open_loop(uncut, p, lo, hi, u)),
                             *((("to_x", to_x(uncut, *z)), ("to_z", to_z(uncut.change, lo, hi))) if z else ())):
            own |= {f"{which}_{side}_{i}_mode_{q}": v for side, row in zip(("lo", "hi"), sides)
                    for i, v in enumerate(row[0]) if f"{prefix}_{which}_{side}_{i}_mode_{q}" in names}
    assert z is None or sum(name.startswith("to_") for name in own) == 8
    assert sum(name.startswith("forward") for name in own) > 4 and sum(name.startswith("blind") for name in own) >= 4
    return lo[0], hi[0], own


@pytest.mark.parametrize("name, real", [("zonotope", "float32"), ("box", "float64"), ("ellipsoid", "float64"),
                                        ("table", "float64"), ("trace", "float32")])
def test_script_of_an_observer_that_follows_is_about_the_sums_of_the_reference(name, real):
    """Boxes as of an estimator; the estimate of every mode, which has what its set holds for it; and S x."""
    design, rng = follower.stand_in(name), np.random.default_rng(7)
    names, expected, values, text, prefix = boxes_of(design, real, rng)
    agree(text, prefix, expected, values, real)
    t = design.observer.tables[real]
    told = t.told
    x, x_lo, x_hi = rng.uniform(-told.box, told.box, (3, 1, len(told.box))).astype(real)
    u, y, y_next = (rng.uniform(a, b, (1, len(a))).astype(real) for a, b in (
        (t.u_lo, t.u_hi), (t.y_lo, t.y_hi), (t.y_lo, t.y_hi)))
    values |= {f"{s}_{j}": a for s, row in (("s_x_hat", x), ("out_x_hat", x), ("s_u", u), ("in_u", u), ("s_y", y),
                                            ("in_y", y_next), ("s_told_lo", x_lo), ("s_told_hi", x_hi))
               for j, a in enumerate(row[0])}
    below, above = image(t.S_rounded, x_lo[0], x_hi[0], np.zeros(len(t.S), real))
    own = {f"narrowed_{side}_{i}": v for side, row in (("lo", below - t.xi_room), ("hi", above + t.xi_room))
           for i, v in enumerate(row)}
    agree(text, prefix, own, values, real)
    estimates_agree(design.plant.modes, told, text, prefix, values, (x, u, y, y_next))
    others = {n for n in names if not n.startswith(f"{prefix}_told_")}
    assert others == {f"{prefix}_{n}" for n in (*expected, *own)}


@pytest.mark.parametrize("name, real", [("table", "float64"), ("parameters", "float32")])
def test_script_of_guided_point_observers_is_about_the_sums_of_the_reference(name, real):
    """Pairs as of an estimator; the estimate of every mode, which has what its set holds for it."""
    design, rng = guided_point.stand_in(name, real), np.random.default_rng(9)
    names, expected, values, text, prefix = pairs_of(design, real, rng)
    agree(text, prefix, expected, values, real)
    told = design.observer.tables[real].told
    x = rng.uniform(-told.box, told.box, (1, len(told.box))).astype(real)
    u, y_next = (np.array([values[f"in_{v}_{j}"] for j in range(n)], dtype=real).reshape(1, n)
                 for v, n in (("u", len(told.u_lo)), ("y", len(told.y_lo))))
    y = rng.uniform(told.y_lo, told.y_hi, (1, len(told.y_lo))).astype(real)
    values |= {f"{s}_{j}": a for s, row in (("s_x_hat", x), ("out_x_hat", x), ("s_u", u), ("s_y", y))
               for j, a in enumerate(row[0])}
    estimates_agree(design.plant.enclosed.modes, told, text, prefix, values, (x, u, y, y_next))
    assert {n for n in names if not n.startswith(f"{prefix}_told_")} == {f"{prefix}_{n}" for n in expected}


def estimates_agree(modes, told, text, prefix, values, given):
    """Estimate and residual in every mode are the sums of the script, with no more room than their set has for them."""
    (x, u, y, y_next), real = given, told.real
    uncut, demands, checked = replace(told, box=told.box * 0 + np.inf), SetDemands(modes, told), set()
    for which_modes, row, which, i in re.findall(
            rf'(?m)^# .*, mode (.*): margin .*\n({prefix}_told_(\w+?)_(\d+)_mode_\d+) r=$', text):
        margin = Q(float.fromhex(re.search(rf"exact_{row}\| <= (\S+)", text)[1]))
        for q in (q for q, mode in enumerate(modes) if f'"{mode.name}"' in which_modes):
            p = np.array([q])
            result = {"forward": lambda p: forward(uncut, p, x, u, y, y_next), "blind": lambda p: blind(uncut, p, x, u),
                      "residual": lambda p: residual(told, p, x, u, y_next)}[which](p)
            assert evaluate(text, row, values, np.dtype(real).type) == result[0, int(i)], row
            assert 0 <= margin <= demands.rounding(q, which)[int(i)]
            checked.add((q, which, i))
    assert len(checked) == len(modes) * (2 * len(told.box) + len(told.y_lo))


@pytest.mark.parametrize("name, real", [("input", "float32"), ("no input", "float64")])
def test_script_of_filters_beside_an_estimator_is_about_the_sums_of_the_reference(name, real):
    """Boxes as of an estimator; estimate and step of every filter, as of one that is told its mode; its start."""
    design, rng = trailing.stand_in(name), np.random.default_rng(8)
    names, expected, values, text, prefix = boxes_of(design, real, rng)
    t = design.observer.tables[real]
    told, every = t.told, range(len(t.Phi))
    x = rng.uniform(told.x_lo, told.x_hi).astype(real)
    values |= {f"centre_{j}": a for j, a in enumerate(x)}
    own, held = filtered(told, values, rng)
    begun = told.started(*[np.tile(x, (1, len(every), 1))] * 2)[0][0]
    own |= {f"begun_{i}_mode_{q}": v for (q, i), v in np.ndenumerate(begun)}
    held |= {f"begun_{i}_mode_{q}": v for (q, i), v in np.ndenumerate(rounded_start(told)[1])}
    all_are_stated((own, held), expected, names, values, (text, prefix, real))


@pytest.mark.parametrize("name, real", [("one input", "float32"), ("parameters", "float64")])
def test_script_of_guided_filters_is_about_the_sums_of_the_reference(name, real):
    """Pairs as of an estimator; estimate and step of the filter of every mode. Where it starts is a table."""
    design, rng = guided_filter.stand_in(name), np.random.default_rng(10)
    names, expected, values, text, prefix = pairs_of(design, real, rng)
    told = design.observer.tables[real].told
    all_are_stated(filtered(told, values, rng), expected, names, values, (text, prefix, real))


def filtered(told, values, rng):
    """Estimates and steps of filters of all modes, and what the thresholds hold for their rounding, by sum."""
    xi, every = rng.uniform(-told.limit, told.limit).astype(told.real), range(len(told.M))
    u, y = (np.array([values[f"in_{s}_{j}"] for j in range(len(part))], told.real).reshape(1, -1)
            for s, part in (("u", told.u_lo), ("y", told.y_lo)))
    values |= {f"xi_{j}": a for j, a in enumerate(xi)}
    own, held = {}, {}
    for kind, row in (("estimate", told.estimates), ("forward", told.moved)):
        own |= {f"{kind}_{i}_mode_{q}": v for q, part in enumerate(row(np.tile(xi, (1, len(every), 1)), u, y)[0])
                for i, v in enumerate(part)}
        held |= {f"{kind}_{i}_mode_{q}": v for q in every for i, v in enumerate(rounding_of(told, kind, q))}
    return own, held


def all_are_stated(filters, expected, names, values, script):
    """The script has these sums and no other; what it allows those of filters is no more than their thresholds hold."""
    (own, held), (text, prefix, real) = filters, script
    merged = {n for n in own if f"{prefix}_{n}" not in names}  # the same sum in the mode before it
    assert all(own[n] == own[n[:-1] + "0"] for n in merged)
    own = {n: v for n, v in own.items() if n not in merged}
    agree(text, prefix, expected | own, values, real)
    assert {f"{prefix}_{n}" for n in (*expected, *own)} == set(names)
    for n in own:
        assert 0 < Q(float.fromhex(re.search(rf"exact_{prefix}_{n}\| <= (\S+)", text)[1])) <= held[n]
