"""Tracking: the corrected inequalities, sampled vertices, bounds of the closed loop, its certificate and its runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import fmpq
from helpers.tracking import closed_loop, designed, observer

from codegen.algebra.interval import sizes
from codegen.certify.exact import pivots, rational
from codegen.certify.peaks import Sums
from codegen.certify.sampled_vertices import sampled_vertices
from codegen.errors import CertificateError, DesignError
from codegen.observers.feedback import CUT_INTEGRAL, Tracker
from codegen.plant.descriptor import Implicit, truth
from codegen.plant.load import load, loads
from codegen.selection import tracking_claims, tracking_task
from codegen.synthesis import METHODS, tracking
from codegen.synthesis.descriptor_problem import Scaling, problem_of, scaled
from codegen.synthesis.tracking import Speed

PLANT = load("quadrotor")
REFERENCE = np.full(3, 0.15)


def scaled_problem():
    unit = sizes(*PLANT.limits("x"))  # C is the identity
    return scaled(problem_of(PLANT), Scaling(unit, unit, 1 / unit, 1.0)), unit


def peak(A, B, C, D) -> float:
    """Largest gain over frequency."""
    return max(np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D, 2)
               for w in [0.0, *np.geomspace(1e-2, 1e3, 120)])


def test_the_observer_keeps_its_level_and_its_place():
    """Of the frozen error system, from its own equations."""
    p, unit = scaled_problem()
    weight = np.diag(unit / sizes(*PLANT.limits("v")))
    found = tracking.observer(p, weight, Speed(3.0, 20.0))
    assert np.allclose(found.T1 + found.T2 @ p.C, np.eye(6), atol=1e-9)
    R, gains = np.eye(6) - p.C @ found.T2, []
    for A, Bd, K in zip(p.A, p.Bd, found.K):
        N = found.T1 @ A + K @ p.C
        modes = np.linalg.eigvals(N)
        assert modes.real.max() <= -3 + 1e-4 and np.abs(modes).max() <= 20 + 1e-3
        gains.append(peak(N, found.T1 @ (Bd - A @ found.T2 @ p.Dd) + K @ R @ p.Dd, weight @ p.C,
                          weight @ R @ p.Dd))
    assert 0.9 * found.gamma < max(gains) <= found.gamma * (1 + 1e-4)
    # Sign of K as in the print, C'Phi' subtracted: not even stable.
    assert np.linalg.eigvals(found.T1 @ p.A[0] - found.K[0] @ p.C).real.max() > 0


def test_the_feedback_keeps_its_level_and_its_place():
    p, unit = scaled_problem()
    Cc, effort, speed = np.eye(6)[:3] * unit / 0.15, np.full(3, 0.3), Speed(1.0, 5.0)
    found, levels = tracking.feedback(p, Cc, effort, speed), []
    for A, B, Bd, Kx, Ki in zip(p.A, p.B, p.Bd, found.Kx, found.Ki):
        loop = np.block([[A - B @ Kx, -B @ Ki], [-Cc, np.zeros((3, 3))]])
        modes = np.linalg.eigvals(loop)
        assert modes.real.max() <= -1 + 1e-4 and np.abs(modes).max() <= 5 + 1e-3
        out = np.vstack([np.hstack([Cc, np.zeros((3, 3))]), np.hstack([effort[:, None] * Kx, effort[:, None] * Ki])])
        levels.append(peak(loop, np.vstack([Bd, np.zeros((3, Bd.shape[1]))]), out, 0))
    assert 0.3 * found.gamma < max(levels) <= found.gamma * (1 + 1e-4)


def test_what_cannot_be_held_has_no_feedback():
    p, unit = scaled_problem()
    with pytest.raises(DesignError, match="Track at most as many outputs"):
        tracking.feedback(p, np.eye(6)[[0, 3]] * unit, np.full(3, 0.3), Speed(1.0, 5.0))  # an angle and its rate


def test_the_sampled_vertices_hold_the_true_plant():
    """One period of the nonlinear plant from its ranges, disturbances moving on the way; and the bound is needed."""
    v, p, rng = sampled_vertices(PLANT), PLANT.polytope, np.random.default_rng(0)
    true, solver, T, worst, plain = truth(PLANT), Implicit(p.E), PLANT.sample_period, 0.0, 0.0
    ends = [np.array(PLANT.limits(name)) for name in "xuw"]
    for _ in range(60):
        # The ranges hold over the whole period: x starts so far inside.
        x, u = (np.where(rng.random(len(lo)) < 0.5, lo, hi) for lo, hi in ends[:2])
        x = x - np.sign(x) * T * v.speed
        h, _ = p.weights(x, u)
        w = np.where(rng.random((4, 3)) < 0.5, ends[2][0], ends[2][1])
        after = x
        for k in range(4):
            def at(_, u=u, now=w[k]):
                return lambda z: true(z, u, np.zeros(0), now, np.zeros(3))
            after = solver.advance(after, T / 4, at)
        said = np.einsum("i,ijk,k->j", h, v.A, x) + np.einsum("i,ijk,k->j", h, v.B, u) + v.Bw[0] @ w.mean(axis=0)
        worst = max(worst, np.max(np.abs(after - said) / (v.error + 1e-13)))
        first = x + T * (np.einsum("i,ijk,k->j", h, np.array([q.A for q in p.vertices]), x) + p.vertices[0].B @ u)
        plain = max(plain, np.max(np.abs(after - first - v.Bw[0] @ w.mean(axis=0))[:2] / v.error[:2]))
    assert 0.05 < worst <= 1 and plain > 10  # Euler steps miss it by far


def test_why_a_plant_cannot_be_tracked():
    reason = METHODS["tracking"].module.inapplicable
    assert reason(PLANT) is None
    assert "constants" in reason(load("disc_points")) or "normalised" in reason(load("disc_points"))
    assert "E is not the identity" in reason(load("disc"))
    assert reason(load("cart")).startswith("it has modes")
    bent = loads(PLANT.text.replace("yaw_rate*", "").replace("*yaw_rate", "*sin(yaw_rate)").replace(
        'term = "yaw_rate"', 'term = "sin(yaw_rate)"'))
    assert 'premise "turn" is not affine' in reason(bent)
    with pytest.raises(CertificateError, match="not affine in the states"):
        sampled_vertices(bent)
    with pytest.raises(CertificateError, match="no continuous sector model"):
        sampled_vertices(load("disc"))


@pytest.mark.parametrize("options, words", [
    ({}, "names 0 outputs"), ({"track": {"height": 1}}, "no output"), ({"track": {"roll": -1}}, "above 0"),
    ({"track": {s.name: 0.1 for s in PLANT.y[:4]}}, "names 4 outputs"),
    ({"track": {"roll": 0.1}, "decay": 9.0}, "less than observer.fastest")])
def test_options_are_checked(options, words):
    with pytest.raises(DesignError, match=words):
        tracking_task.task_of(PLANT, options)


def test_peaks_bound_every_run_and_are_sharp():
    rng = np.random.default_rng(2)
    M = rng.normal(size=(4, 4))
    M *= 0.8 / np.abs(np.linalg.eigvals(M)).max()
    e, x0, out = rng.random(4), rng.random(4), rng.normal(size=(2, 4))
    found = Sums.of(rational(M), rational(out))
    b = found.reached(e, np.zeros((4, 4)), np.zeros(4))
    powers = [np.linalg.matrix_power(M, k) for k in range(400)]
    exact = np.concatenate([sum(np.abs(P) for P in powers) @ e, sum(np.abs(out @ P) for P in powers) @ e])
    assert np.all(b >= exact) and np.all(b <= exact * (1 + 1e-2))
    D = 0.02 * rng.random((4, 4))
    b = found.reached(e, D, x0)
    for _ in range(20):
        x = x0 * rng.choice([-1, 1], 4)
        for _ in range(100):
            assert np.all(np.abs(np.concatenate([x, out @ x])) <= b)
            x = (M + D * rng.choice([-1, 1], (4, 4))) @ x + e * rng.choice([-1, 1], 4)
    with pytest.raises(CertificateError, match="without end"):
        found.reached(e, np.ones((4, 4)), x0)
    with pytest.raises(CertificateError, match="still remembers"):
        Sums.of(rational(np.eye(2)), rational(np.zeros((0, 2))))


def test_definite_is_exact_where_balls_are_not():
    S = rational(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert pivots(S)[-1] <= 0
    S[1, 1] = S[1, 1] + fmpq(1, 10**200)  # far below the balls' width
    assert pivots(S)[-1] > 0 >= pivots(-S)[-1]


def tampered(change):
    """Check the float32 design with something changed in its plant, tables or certificate."""
    design = designed()
    plant, t, cert = change(design.plant, design.observer.tables["float32"], design.certificate["float32"])
    return tracking_claims.check(plant, t, cert)


def of_law(**fields):
    return lambda p, t, c: (p, replace(t, law=replace(t.law, **fields)), c)


def of_proof(part, **fields):
    return lambda p, t, c: (p, t, c | {"loop": c["loop"] | {part: c["loop"][part] | fields}})


def of_plant(old, new):
    def change(p, t, c):
        assert old in p.text
        return replace(loads(p.text.replace(old, new)), options=p.options), t, c
    return change


LAW = designed().observer.tables["float32"].law
LOOP = designed().certificate["float32"]["loop"]
WRONG = {
    "sign of a gain": (of_law(Kx=LAW.Kx * np.where(np.arange(6) == 3, -1, 1).astype("float32")), "decay|level"),
    "no integral": (of_law(Ki=0 * LAW.Ki), "decay|still remembers"),
    "integral of another sign": (of_law(Ki=-LAW.Ki), "decay"),
    "gains of another input": (of_law(Kx=LAW.Kx[:, [1, 0, 2]]), "decay"),
    "another output": (of_law(rows=(0, 1, 5)), "other outputs"),
    "another period": (of_law(period=0.02), "another period"),
    "a larger reference": (of_law(reference=2 * LAW.reference), "other outputs or references"),
    "a limit too low": (of_law(limit=LAW.limit / 2), "limit of its integral"),
    "a better decay": (of_proof("decay", factor=0.95), "the decay"),
    "growth": (of_proof("decay", factor=1.5), "between 0 and 1"),
    "a better level": (of_proof("level", level2=LOOP["level"]["level2"] * 0.9), "the level"),
    "a level of its square": (of_proof("level", gamma=LOOP["level"]["gamma"] * 0.9), "claimed"),
    "a smaller reach": (lambda p, t, c: (p, t, c | {"reached": c["reached"] | {"u": [0.07, 0.07, 0.04]}}),
                        "u reaches more"),
    "a better sampling": (lambda p, t, c: (p, t, c | {"missed": [0.5 * e for e in c["missed"]]}), "sampling misses"),
    "no storage": (of_proof("decay", P=(-np.array(LOOP["decay"]["P"])).tolist()), "positive definite"),
    "more disturbance": (of_plant("[-0.004, 0.004]", "[-0.04, 0.04]"), "the level"),
    "a longer period": (lambda p, t, c: (replace(p, sample_period=0.02), t, c), "another period"),
    "a narrower range": (of_plant('rad", range = [-0.5, 0.5]', 'rad", range = [-0.3, 0.3]'), '"roll" may reach'),
    "less torque": (of_plant("[-0.072, 0.072]", "[-0.04, 0.04]"), "saturate"),
    "another inertia": (of_plant("Izz = 1.3e-2", "Izz = 2.6e-2"), "decay|level|may reach"),
    "an observer for another vertex": (lambda p, t, c: (p, replace(t, F=t.F[::-1]), c), "decay|level|set|residual"),
    "a lower threshold": (lambda p, t, c: (p, replace(t, h=(0.9 * t.h).astype("float32")), c), "residual"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_tampered_design_is_refused(name):
    change, words = WRONG[name]
    with pytest.raises(CertificateError, match=words):
        tampered(change)


def test_the_certificate_says_what_is_proved():
    claims = tampered(lambda *same: same)
    assert claims == designed().proved["float32"]
    assert [c.split(":")[0] for c in claims[:4]] == ["decay", "H-infinity", "no saturation", "sampling"]


def square(steps, period=120):
    return np.where((np.arange(steps) // period) % 2 == 0, 1.0, -1.0)[:, None] * REFERENCE


@pytest.mark.parametrize("draw", ["uniform", "corner"])
def test_a_run_keeps_what_is_promised(draw):
    """References that jump from end to end, disturbances at their ends: no cut, no alarm, always assured."""
    run = closed_loop(PLANT, Tracker(observer()), square(300), 5, draw)
    lo, hi = PLANT.limits("x")
    assert np.all((run.x >= lo) & (run.x <= hi)) and not run.limited.any() and not run.raw.any() and run.assured.all()
    assert np.all(np.abs(run.r) <= run.r_bound) and np.abs(run.r / run.r_bound).max() > 0.1
    told = [float(s.split()[1]) for s in designed().proved["float32"][2].split("inputs within ")[1].split(": nothing")[
        0].split(", ")]
    assert np.all(np.abs(run.u).max(axis=0) <= told)


def without(law, **fields):
    return {"float32": replace(designed().observer.tables["float32"], law=replace(law, **fields))}


def test_the_reference_is_reached_under_a_lasting_disturbance():
    """By the integral alone: without it the same torque leaves an offset."""
    steady = replace(PLANT, w=tuple(replace(s, lo=s.hi, hi=s.hi) for s in PLANT.w))
    steady = replace(steady, v=tuple(replace(s, lo=0.0, hi=0.0) for s in PLANT.v))
    ref = np.tile(REFERENCE, (600, 1))
    run = closed_loop(steady, Tracker(observer()), ref, 0, "corner")
    assert np.abs(run.x[-1, :3] - REFERENCE).max() < 2e-3
    stuck = closed_loop(steady, Tracker(observer(without(LAW, limit=0 * LAW.limit))), ref[:160], 0, "corner")
    assert np.abs(stuck.x[-1, :3] - REFERENCE).min() > 0.05 and (stuck.limited & CUT_INTEGRAL).all()
    wrong = closed_loop(steady, Tracker(observer(without(LAW, Ki=-LAW.Ki))), ref[:140], 0, "corner")
    assert wrong.x[-1, :3].max() < -0.15


def test_a_sensor_fault_is_found_and_the_loop_stays_stable():
    """The weights are wrong from then on; the proof of decay holds for any."""
    fault = np.zeros((420, PLANT.n_f))
    fault[200:, 2] = 0.6  # the yaw gyro, which schedules
    run = closed_loop(PLANT, Tracker(observer()), square(420), 3, "uniform", fault)
    assert np.flatnonzero(run.raw)[0] == 200 and run.raw[200] == 1 << 5 and run.assured[:200].all()
    assert np.abs(run.x).max() < 2 and np.abs(run.x[-100:, :2]).max() < 0.3


def test_missing_samples_are_coasted_and_other_draws_refused():
    missing = np.arange(160) % 50 > 46
    run = closed_loop(PLANT, Tracker(observer()), square(160), 6, "uniform", None, missing)
    assert np.all(np.isnan(run.y[missing])) and not run.raw.any() and np.abs(run.x[:, :3]).max() < 0.3
    with pytest.raises(ValueError, match="beyond its range"):
        Tracker(observer()).step(np.full((1, 3), 0.2), np.zeros((1, 6)))
    with pytest.raises(ValueError, match="draw is"):
        closed_loop(PLANT, Tracker(observer()), square(1), 0, "sometimes")
