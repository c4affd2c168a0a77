"""A change of coordinates, method "component-interval": an exact step from every point, refusals, thresholds."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from exact import Q, nearest
from helpers.varying import changed_design, changed_text

from codegen.algebra.interval import support
from codegen.analysis.detectability import surely_detected
from codegen.certify import claims
from codegen.designs import recheck
from codegen.errors import CertificateError, DesignError
from codegen.observers.framer import propagate, to_x, to_z
from codegen.plant.load import load, loads
from codegen.selection.select import choose

POINTS = 60


@pytest.fixture(scope="module")
def design():
    return changed_design()


@pytest.fixture(scope="module", params=["float32", "float64"])
def tables(request, design):
    return design.observer.tables[request.param]


def dot(matrix, vector):
    return [sum((Q(a) * b for a, b in zip(row, vector) if a), Q(0)) for row in matrix]


def lost_by_rounding(t, seed=0):
    """Points x, exact, whose z = Z x or whose way back x = X z leaves the computed bounds."""
    rng, lost = np.random.default_rng(seed), {"z": 0, "x": 0}
    x = (t.x_lo + (t.x_hi - t.x_lo) * rng.random((POINTS, len(t.box)))).astype(t.dtype)
    z_lo, z_hi = to_z(t.change, x, x)
    z = [dot(t.change.Z, [Q(a) for a in row]) for row in x]
    lost["z"] = sum(not Q(a) <= b <= Q(c) for row in zip(z_lo, z, z_hi) for a, b, c in zip(*row))
    # The tightest floats about the exact z, so that the way back has nothing but its own offsets.
    down, up = ([[np.nextafter(t.dtype.type(float(b)), t.dtype.type(s * np.inf)) if s * (Q(t.dtype.type(float(b))) - b)
                  < 0 else t.dtype.type(float(b)) for b in row] for row in z] for s in (-1, 1))
    lo, hi = to_x(t, np.array(down, t.dtype), np.array(up, t.dtype))
    lost["x"] = sum(not a <= b <= c for row in zip(lo, x, hi) for a, b, c in zip(*row))
    return lost


def test_both_maps_cover_their_rounding(tables):
    assert lost_by_rounding(tables) == {"z": 0, "x": 0}


@pytest.mark.parametrize(("offset", "loses"), [("e", "z"), ("b", "x")])
def test_without_its_offset_a_map_loses_points(tables, offset, loses):
    none = {f"{offset}_{side}": 0 * tables.change.e_hi for side in ("lo", "hi")}
    lost = lost_by_rounding(replace(tables, change=replace(tables.change, **none)))
    assert lost[loses] > 0 and lost["x" if loses == "z" else "z"] == 0


def test_x_back_to_front_is_not_the_identity(tables):
    """X is the rounded inverse: what is left of I - X Z is in b, and b alone would not do without it."""
    n = len(tables.box)
    left = [[Q(i == j) - sum((Q(a) * Q(b) for a, b in zip(row, column)), Q(0)) for j, column in enumerate(
        tables.change.Z.T)] for i, row in enumerate(tables.change.X)]
    assert any(x != 0 for row in left for x in row)
    assert all(Q(tables.change.b_hi[i]) >= sum((abs(x) * Q(b) for x, b in zip(left[i], tables.box)), Q(0))
               for i in range(n))


def step_misses(design, t, seed=3):
    """Exact successors of points, unknowns and disturbances at every corner, outside the bounds of one step.

    The points are whole numbers, of which z = Z x is a float: nothing but the step itself is rounded.
    """
    plant, missed, rng = design.plant, 0, np.random.default_rng(seed)
    for _ in range(POINTS):
        q = int(rng.integers(plant.n_modes))
        m = plant.observed.modes[q]
        x = np.round(t.x_lo + (t.x_hi - t.x_lo) * rng.choice([0.1, 0.5, 0.9], len(t.box))).astype(t.dtype)
        u = rng.choice([t.u_lo, t.u_hi])
        now, act, point = [Q(a) for a in x], [Q(a) for a in u], (t.change.Z @ x)[None]
        assert [Q(a) for a in point[0]] == dot(t.change.Z, now)
        for v, w, s in product(*zip(m.v_lo, m.v_hi), (m.w_lo[0], m.w_hi[0]), (-1, 1)):
            y = [a + b for a, b in zip(dot(m.C, now), dot(m.Dv, [Q(v)]))]
            read = np.array([[nearest(a, t.real) for a in y]])
            z = propagate(t, np.array([q]), x[None], x[None], u[None], read, 0 * read, np.empty((1, 0), t.dtype),
                          (point, point))
            lo, hi = to_x(t, *z)
            after = [a + b + c for a, b, c in zip(dot(m.A, now), dot(m.B, act), dot(m.Bw, [Q(w)]))]
            for F, G in zip(m.A_unc, m.B_unc):
                after = [a + s * (b + c) for a, b, c in zip(after, dot(F, now), dot(G, act))]
            inside = all(Q(a) <= b <= Q(c) for a, b, c in zip(lo[0], after, hi[0]))
            there = dot(t.change.Z, after)
            inside_z = all(Q(a) <= b <= Q(c) for a, b, c in zip(z[0][0], there, z[1][0]))
            kept = all(Q(a) <= b <= Q(c) for a, b, c in zip(t.x_lo, after, t.x_hi))
            missed += kept and not (inside and inside_z)
    return missed


def unrounded(design, t):
    """Offsets of disturbance and noise alone."""
    new = {"hi": [], "lo": []}
    for q, m in enumerate(design.plant.observed.modes):
        Bw, LDv = t.change.Z.astype(float) @ m.Bw, t.L_hi[q].astype(float) @ m.Dv
        new["hi"].append(support(Bw, m.w_lo, m.w_hi) + support(-LDv, m.v_lo, m.v_hi))
        new["lo"].append(-support(-Bw, m.w_lo, m.w_hi) - support(LDv, m.v_lo, m.v_hi))
    return replace(t, **{f"d_{side}": np.array(rows).astype(t.dtype) for side, rows in new.items()})


def with_radii(t, R):
    return replace(t, vary=replace(t.vary, R=R.astype(t.dtype)))


def test_one_step_contains_every_corner(design, tables):
    assert step_misses(design, tables) == 0


@pytest.mark.parametrize("mutant", [
    lambda t: with_radii(t, np.abs(t.change.X) @ t.vary.Ra),  # the sides exchanged, as in the print
    lambda t: with_radii(t, t.vary.R @ np.abs(t.change.X)),   # bounds of R dA S, but on the box of x
    lambda t: replace(t, L_hi=0.999 * t.L_hi, L_lo=0.999 * t.L_lo),
], ids=["sides", "of z on x", "gain"])
def test_mutants_lose_a_corner(design, tables, mutant):
    assert step_misses(design, mutant(tables)) > 0


def test_offsets_without_rounding_lose_a_corner(design):
    """In float32: the plant's own entries are rounded to float64, and the radii hold room for that."""
    assert step_misses(design, unrounded(design, design.observer.tables["float32"])) > 0


def test_thresholds_hold_and_say_something(design):
    """Every step of the size found raises an alarm in time, from settled bounds, whatever the rest does."""
    plant, t = design.plant, design.observer.tables["float32"]
    (fault,) = surely_detected(plant, t, design.certificate["float32"], 3)
    assert np.isfinite(fault.best) and fault.by_delay[0] >= fault.by_delay[3]

    def found(size, seed, onset=60):
        rng, x, rows = np.random.default_rng(seed), np.zeros(3), []
        q = rng.integers(0, plant.n_modes, onset + 4)
        u = rng.choice([-5.0, 7.0], (onset + 4, 1))
        for k in range(onset + 4):
            m = plant.observed.modes[q[k]]
            v, w, s = rng.choice([m.v_lo, m.v_hi]), rng.choice([m.w_lo, m.w_hi]), rng.choice([-1, 1], len(m.A_unc))
            rows.append(m.C @ x + m.Dv @ v + (m.Df[:, 0] * size if k >= onset else 0))
            x = m.A @ x + m.B @ u[k] + m.Bw @ w + sum(
                a * (F @ x + G @ u[k]) for a, F, G in zip(s, m.A_unc, m.B_unc))
        raw = design.observer.run(u, np.array(rows), q).raw_bits != 0
        assert not raw[:onset].any()
        return raw[onset:].any()

    sizes = fault.best * np.array([1.0, -1.0])
    assert all(found(size, seed) for size in sizes for seed in range(25))
    assert not all(found(size / 8, seed) for size in sizes for seed in range(25))


def test_coordinates_may_be_narrower_and_may_not():
    """The sampled plant of Chevet (2021), whose output has no noise; of the print's own plant they are wider."""
    changed, plain = (choose(load("chevet"), "component-interval", options, lambda text: None).certificate["float64"]
                      for options in ({"coordinates": "change"}, {}))
    assert np.all(4 * np.array(changed["x_width"]) < claims.ultimate_width(plain))


# -- what is refused -------------------------------------------------------------------------------
LAMOUCHI, SQUARE = load("lamouchi"), [[1, 0], [0, 1]]


@pytest.mark.parametrize(("plant", "method", "options", "words"), [
    (LAMOUCHI, "tnl-interval-lpv", {"coordinates": "change"}, 'not to be had with method "tnl-interval-lpv"'),
    (LAMOUCHI, "component-interval", {"coordinates": "change", "criterion": "linf"}, 'expected "width"'),
    (LAMOUCHI, "component-interval", {"coordinates": "other"}, 'expected "none" or "change"'),
    (LAMOUCHI, "component-interval", {"gains": {"R": SQUARE, "L": [[[0.3], [0.6]]]}}, "gains.R is unknown"),
    (LAMOUCHI, "component-interval", {"coordinates": "change", "gains": {"L": [[[0.3], [0.6]]]}}, "gains.R has shape"),
    (LAMOUCHI, "component-interval", {"coordinates": "change", "gains": {"R": [[1, 1], [1, 1]], "L": [[[0], [0]]]}},
     "no inverse worth the name"),
    (loads(changed_text().replace("[observer]", "[switching]\nlate = true\n[observer]")), "component-interval", {
        **loads(changed_text()).options}, "where the mode is told late"),
    (loads(changed_text()), "component-interval", {"coordinates": "change"}, "R for one mode, found 2 modes"),
    (LAMOUCHI, "component-interval", {"gains": {"L": [[[0.3], [0.6]]], "N": [[[0.3], [0.2]]]}},
     'the step of method "component-interval" does not read'),
    (loads(changed_text()), "component-interval", {"coordinates": "change", "gains": {
        **loads(changed_text()).options["gains"], "N": np.full((2, 3, 2), 0.1).tolist()}},
     "framers in other coordinates does not read"),
])
def test_says_what_it_cannot_do(plant, method, options, words):
    with pytest.raises(DesignError, match=words):
        choose(plant, method, options, lambda text: None)


def test_hopeless_coordinates_offer_no_gain():
    """Column 2 of A0 - L C does not depend on L: without a change nothing makes it nonnegative."""
    with pytest.raises(DesignError, match=r"at row 1, column 2 .* takes this L as it is\.$"):
        choose(LAMOUCHI, "component-interval", {"coordinates": "change", "gains": {"R": SQUARE, "L": [[[0.3], [0.6]]]}},
               lambda text: None)


def test_tables_that_their_step_does_not_read_are_refused(design):
    """N counts in the certificate of tables; the step of this family has no place for it."""
    t = design.observer.tables["float32"]
    other = type(design.observer)({"float32": replace(t, N_lo=t.N_lo + np.float32(0.1))}, design.observer.supervision)
    with pytest.raises(CertificateError, match="N is not zero"):
        recheck(replace(design, observer=other))


# -- the certificate -------------------------------------------------------------------------------
@pytest.mark.parametrize(("part", "value", "words"), [
    ("z_hi", 0.999, "range of z does not contain"), ("box", 0.5, "range of z does not contain"),
    ("e_hi", 0.5, r"offset e_hi\[0\]"), ("b_lo", 0.5, r"offset b_lo\[0\]"), ("X", 1.001, r"offset b_hi\[0\]"),
    ("Z", 1.001, "the table's|is too small|range of z")])
def test_certificate_refuses_other_coordinates(design, part, value, words):
    t, cert = design.observer.tables["float32"], design.certificate["float32"]
    claims.check(design.plant.observed.modes, t, cert)
    other = replace(t, change=replace(t.change, **{part: getattr(t.change, part) * np.float32(value)}))
    with pytest.raises(CertificateError, match=words):
        claims.check(design.plant.observed.modes, other, cert)
