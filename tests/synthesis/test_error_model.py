"""The exact error model behind the levels, against brute force over all corners."""

from itertools import product as every

import numpy as np
import pytest
from exact import Q
from flint import fmpq
from small_plants import LOPSIDED

from codegen.certify.claims import check, prove
from codegen.certify.containment import Containment
from codegen.certify.error_model import ErrorModel
from codegen.certify.freeze import freeze, limits
from codegen.errors import CertificateError
from codegen.observers import FramerTables
from codegen.plant.load import loads

# Noise that stays far from zero; A so large that gains of either sign leave A - L C nonnegative.
FAR = """
format = 1
name = "far"
title = "Noise that never vanishes"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
[signals]
x = [{ name = "a", range = [-40, 60] }, { name = "b", range = [-40, 60] }]
y = [{ name = "y1", range = [-90, 90] }, { name = "y2", range = [-90, 90] }]
w = [{ name = "w", bounds = [0.1, 0.7] }]
v = [{ name = "v1", bounds = [10, 11] }, { name = "v2", bounds = [-5, -4] }]
[initial]
x_lo = [-1, -2]
x_hi = [2, 1]
[common]
C = [[1, 0], [0, 1]]
Dv = [[1, 0], [0, -0.3]]
[[mode]]
name = "one"
A = [[0.9, 0.3], [0.2, 0.8]]
Bw = [[1], [0.4]]
[[mode]]
name = "two"
A = [[0.8, 0.1], [0.3, 0.7]]
Bw = [[-0.6], [1]]
"""


def error_cases(workshop):
    for name in (("zammali_fd", "interval"), ("press", "tnl-interval")):
        design = workshop.gallery(*name)
        yield design.plant, design.observer.tables["float32"]
    plant = loads(FAR, "far")
    for sign in (1, -1):
        L = sign * np.array([[[0.3, 0.05], [0.1, 0.25]]] * 2)
        for low in (L, -L):  # with -L the noise pulls both framers inward
            gains = {"L_hi": L, "L_lo": low, "N_hi": 0.2 * L, "N_lo": 0.2 * low}
            yield plant, freeze(FramerTables, plant.modes, limits(plant), gains, "float32")


def test_push_and_theta_cover_every_corner(workshop):
    """b in [0, push] and |d| <= theta at every corner of w, v, v+ in every pair of modes.

    Before, theta took the largest signed slack only: too small for a noise that never comes near zero.
    """
    for plant, t in error_cases(workshop):
        model = ErrorModel(plant.modes, t)
        theta2 = float(model.theta2)
        for q, m in enumerate(plant.modes):
            for after in plant.modes:
                w = np.array(list(every(*zip(m.w_lo, m.w_hi))))
                v, v_next = (np.array(list(every(*zip(a.v_lo, a.v_hi)))) for a in (m, after))
                for side, sign in (("hi", 1), ("lo", -1)):
                    L, N, d = (np.asarray(getattr(t, k + side)[q], dtype=float) for k in ("L_", "N_", "d_"))
                    T = np.eye(plant.n_x) - N @ m.C
                    slack = sign * (d - (w @ m.Bw.T) @ T.T)
                    a, c = v @ m.Dv.T, v_next @ after.Dv.T
                    b = (slack[:, None, None] + sign * (a @ L.T)[None, :, None] + sign * (c @ N.T)[None, None, :])
                    push = np.array([float(x) for x in model.push[side][q]])
                    assert np.all(b >= 0) and np.all(b <= push)
                    d2 = (np.sum(slack**2, 1)[:, None, None] + np.sum(a**2, 1)[None, :, None]
                          + (np.sum(c**2, 1)[None, None, :] if np.any(N) else 0))
                    assert np.max(d2) <= theta2


def test_a_state_that_nothing_damps_has_no_ultimate_box():
    """x+ = x, no disturbance, not seen by the output: push is 0, and the box 0 would claim that it is known.

    M z + push <= z alone accepts z = 0 there; the box must also bring errors in, M z < z.
    """
    text = """
format = 1
name = "stuck"
title = "A constant that nobody sees"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
[signals]
x = [{ name = "a", range = [-1, 1] }, { name = "b", range = [-1, 1] }]
y = [{ name = "y", range = [-2, 2] }]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[[mode]]
name = "only"
A = [[0.5, 0], [0, 1]]
C = [[1, 0]]
"""
    plant = loads(text, "stuck")
    zero = np.zeros((1, 2, 1))
    gains = dict.fromkeys(("L_hi", "L_lo", "N_hi", "N_lo"), zero)
    t = freeze(FramerTables, plant.modes, limits(plant), gains, "float32")
    cert = prove(plant.modes, t, {"kind": "none"})
    assert cert["steady_box"] is None
    with pytest.raises(CertificateError, match="the error box is left"):
        check(plant.modes, t, {**cert, "steady_box": {"hi": [1.0, 0.0], "lo": [1.0, 0.0]}})
    # Even if nothing at all were added, not a rounding error either.
    model = ErrorModel(plant.modes, t)
    model.push = {s: [np.array([fmpq(0), fmpq(0)], dtype=object)] for s in ("hi", "lo")}
    for unseen in (0, 5):
        assert model.box_violation(np.array([fmpq(1), fmpq(unseen)], dtype=object), "hi")[:2] == (0, 1)


def test_physical_input_may_exceed_the_rounded_limit():
    """0.7 rounds down in float32: what multiplies the true u must be bounded by 0.7, not by the table's limit."""
    plant = loads(LOPSIDED.replace("DIRECT", "").replace("range = [-5, 7]", "range = [-0.7, 0.7]"), "limit")
    L = np.full((2, 2, 2), 0.1)
    t = freeze(FramerTables, plant.modes, limits(plant), {"L_hi": L, "L_lo": L, "N_hi": L, "N_lo": L}, "float32")
    exact = Containment(plant.modes, t)
    assert Q(t.u_hi[0]) < Q(0.7) <= exact.u_true[0]
    assert exact.u_true[0] - exact.u_max[0] < fmpq(1, 10**7)


def test_margins_cover_what_the_caller_rounds():
    """With dyadic constants and nothing unknown only the rounding of u and y by the caller is left, all of it."""
    text = """
format = 1
name = "dyadic"
title = "Every constant is exact"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
[signals]
x = [{ name = "a", range = [-8, 8] }, { name = "b", range = [-8, 8] }]
u = [{ name = "u", range = [-4, 4] }]
y = [{ name = "y", range = [-16, 16] }]
[initial]
x_lo = [0, 0]
x_hi = [0, 0]
[[mode]]
name = "only"
A = [[0.5, 0.25], [0.25, 0.5]]
B = [[1], [-0.5]]
C = [[1, 0.5]]
D = [[0.5]]
"""
    plant = loads(text, "dyadic")
    L, N, half_ulp = np.array([[[0.25], [0.125]]]), np.array([[[0.125], [-0.25]]]), fmpq(1, 2**24)
    t = freeze(FramerTables, plant.modes, limits(plant), {"L_hi": L, "L_lo": L, "N_hi": N, "N_lo": N}, "float32")
    exact = Containment(plant.modes, t)
    assert not any(np.any(rest.most()) for rest in exact.leftover(0, "hi")[1:])
    for side in ("hi", "lo"):
        for i, demand in enumerate(exact.update(0, side)):
            by_y = (abs(Q(L[0, i, 0])) + abs(Q(N[0, i, 0]))) * 16 * half_ulp
            by_u = abs(Q(t.G_hi[0, i, 0])) * 4 * half_ulp
            assert 0 <= demand.need - by_y - by_u < fmpq(1, 2**100)
        for i, demand in enumerate(exact.blind(0, side)):
            assert 0 <= demand.need - abs(Q(t.B[0, i, 0])) * 4 * half_ulp < fmpq(1, 2**100)
        assert 0 <= exact.output(0, side)[0].need - (16 + fmpq(1, 2) * 4) * half_ulp < fmpq(1, 2**100)
