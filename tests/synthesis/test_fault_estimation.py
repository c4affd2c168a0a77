"""Sensor faults as states: figures of the thesis' bioreactor, bounds that hold, refusals, tampering that is seen."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import sympy
from flint import fmpq
from helpers.folders import built
from helpers.scripts import ROOT
from helpers.tools import need

import codegen
from codegen.algebra.program import Builder
from codegen.certify import fault_bounds, fault_sets
from codegen.certify.polytope_gain import check as exact_check
from codegen.certify.program_error import program_errors
from codegen.designs import claims_of, read_design
from codegen.errors import CertificateError, DesignError, PlantError
from codegen.observers.polytopic_step import evaluate
from codegen.plant.bend import bend
from codegen.plant.load import load, loads
from codegen.plant.simulate import simulate
from codegen.selection.descriptors import certified
from codegen.selection.fault_estimators import bend_of_steps, check, propose, with_faults
from codegen.synthesis.descriptor_fault_estimation import design, gains_of
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.fault_problem import fault_problem, in_units, inapplicable, told, unmoved, unseen_by

DAY = 86400.0
FOLDER = ROOT / "generated" / "digester_descriptor-fault-estimation"
#: Estimate at the start: biomass, cod, methane, growth, faults; as printed, and no consistent one.
PRINTED = np.array([0, 0.5, 1, 0.4, -1, -0.2, 0.3])


@lru_cache
def kept():
    """The committed design."""
    return read_design(FOLDER)


@lru_cache
def truth():
    return simulate(kept().plant, "three faults", seed=1)


@lru_cache
def judged():
    """What every check of the kept design is about, but for tables and certificate."""
    plant = kept().plant
    return with_faults(plant), fault_problem(plant)[0].whole, bend_of_steps(plant)


def faster() -> str:
    """The digester at half the period; eleven days of the same scenario, the faults at the same time."""
    text = load("digester").text.replace("sample_period = 864 ", "sample_period = 432 ")
    for old, new in (("1000, to = 1500", "2000, to = 2200"), ("800, to = 1600", "1600, to = 2200"),
                     ("1200, to = 1600", "1900, to = 2200"), ("duration = 1382400", "duration = 950400")):
        assert old in text
        text = text.replace(old, new)
    return text


def estimates(plant, u, y, x0):
    """The observer as it is written down, not as the firmware has it: in the innovation, unrounded."""
    made, p = propose(plant, "", {}), plant.polytope
    g = gains_of(made.problem, made.found, made.s, made.period, "float64")
    terms = sympy.lambdify(p.symbols, [k.term for k in p.known], "math")
    all_gains = np.concatenate([g.F, g.G, g.K], axis=2)
    z, out = x0 - g.T2 @ (g.C @ x0), []
    for now, seen in zip(u, y):
        x_hat = z + g.T2 @ seen
        h, inside = p.weights(x_hat[:plant.n_x], now)
        assert inside
        z = np.tensordot(h, all_gains, 1) @ np.concatenate([x_hat, now, terms(*x_hat[:plant.n_x], *now),
                                                            g.C @ x_hat - seen])
        out.append(x_hat)
    return np.array(out)


def test_the_figures_of_the_thesis_from_a_start_that_is_not_consistent():
    """RMS after ten days .00007, .00004, .00058 with three faults at once; the printed start, our inputs and faults."""
    plant = loads(faster())
    true = simulate(plant, "three faults", seed=1)
    assert np.all(true.f[2000:2199] != 0)
    error = estimates(plant, true.u, true.y, PRINTED) - np.hstack([true.x, true.f])
    assert np.all(np.abs(error[800, 4:]) < [1e-3, 1e-3, 0.02]) and np.abs(error[0, 4:]).max() > 0.3
    assert np.all(np.sqrt(np.mean(error[2000:, 4:] ** 2, axis=0)) < [7e-5, 4e-5, 5.8e-4])
    # A state that an output is exactly is read there; the printed start of growth contradicts the equations.
    assert np.all(error[:, 3] == 0)


def test_the_firmware_estimates_three_faults_at_once_within_its_bounds(tmp_path):
    """Of the compiled C; tests/sil hold it against the reference."""
    need("gcc")
    true = truth()
    got = built(kept(), tmp_path).run(true.u, true.y)
    late, f_hat = slice(1000, None), got.x_hat[:, 4:]
    assert np.all(true.f[1200:1500] != 0)
    assert np.all(np.sqrt(np.mean((f_hat - true.f)[late] ** 2, axis=0)) < [1e-4, 8e-5, 2e-4])
    off = np.abs(got.r - true.f @ kept().plant.polytope.Df.T)
    assert np.all(off <= got.r_bound) and got.assured.all() and got.inside.all()
    # Bits are those of the faults, and sure from twice the bound on, while the other sensors fail as well.
    for j in range(3):
        raw = got.raw_bits >> j & 1
        assert not raw[true.f[:, j] == 0].any()
        assert raw[np.abs(true.f[:, j]) > 2 * got.r_bound[:, j]].all() and raw.sum() > 300
    sure = [fault["by_delay"][0] for fault in kept().detection["float32"]]
    assert sure == pytest.approx(2 * got.r_bound[-1, :3], rel=1e-6)


def test_the_bounds_are_near_what_the_recursion_reaches():
    """Worst sequences of vertices and disturbances of the exact error model; simulated without the certificate."""
    t, cert = kept().observer.tables["float32"], kept().certificate["float32"]
    whole, problem, bent = judged()
    model, _ = fault_bounds.model(whole, problem, t, np.array(cert["T1"]), 864.0, bent)
    J, W = ([np.array(M, dtype=float) for M in (getattr(m, k) for m in model)] for k in "JW")
    worst, rng = np.zeros(4), np.random.default_rng(0)
    for j in range(3):  # the response of residual j backwards, at each sample the vertex that lasts longest
        for choice in (lambda row: int(np.argmax([np.linalg.norm(row @ A) for A in J])), lambda _: rng.integers(4)):
            row, reach = np.array(model[0].O[j], dtype=float), float(model[0].room[j])
            for _ in range(800):
                q = choice(row)
                reach += np.abs(row @ W[q]).sum()
                row = row @ J[q]
            worst[j] = max(worst[j], reach)
    assert np.all(worst[:3] <= t.h[-1, :3]) and np.all(t.h[-1, :3] < 3 * worst[:3])
    reached = np.array(cert["thresholds"]["reached"])
    assert np.all(reached[:3] <= t.h[-1, :3])


def tampered():
    """What must be refused: tables, certificate, or what the plant does, changed."""
    t, cert = kept().observer.tables["float32"], kept().certificate["float32"]
    held = cert["thresholds"]
    low, K, known, F = (getattr(t, k).copy() for k in ("h", "K", "known", "F"))
    low[-1, 1] *= 0.9
    K[2, 1, 1] *= -1
    known[1] *= 1.001
    F[0, 0, 0] += np.float32(1e-3)
    first = t.h.copy()
    first[3] *= 0.5
    P, D = np.array(held["P"]), np.array(held["D"])
    P *= 1.05
    yield "threshold", replace(t, h=low), cert
    yield "row", replace(t, h=first), cert
    yield "gain", replace(t, K=K), cert
    yield "known term", replace(t, known=known), cert
    yield "entry of F", replace(t, F=F), cert
    yield "start", replace(t, start=t.last), cert
    yield "P", t, cert | {"thresholds": held | {"P": P.tolist()}}
    yield "D", t, cert | {"thresholds": held | {"D": (D * 0.9).tolist()}}
    yield "share", t, cert | {"thresholds": held | {"share": held["share"] * 0.999}}
    yield "level", t, cert | {"thresholds": held | {"level": held["level"] * 0.9}}
    yield "T1", t, cert | {"T1": (np.array(cert["T1"]) * 1.01).tolist()}


@pytest.mark.parametrize("what", [name for name, *_ in tampered()])
def test_what_is_not_the_proved_observer_is_refused(what):
    t, cert = next(rest for name, *rest in tampered() if name == what)
    plant, problem, bent = judged()
    with pytest.raises(CertificateError):
        fault_sets.check(plant, problem, t, cert["thresholds"], np.array(cert["T1"]), 864.0, bent)


def test_an_entry_of_c_that_the_c_rounds_counts():
    """Its rounding error times the largest state, in the bound of r less what the faults do to y."""
    whole, problem, bent = judged()
    t, cert = kept().observer.tables["float32"], kept().certificate["float32"]
    off = t.C.copy()
    off[1, 1] += np.float32(2**-12)
    room = [fault_bounds.model(whole, problem, replace(t, C=C), np.array(cert["T1"]), 864.0, bent)[0][0].room[1]
            for C in (t.C, off)]
    assert room[1] - room[0] >= fmpq(1, 2**12) * fmpq(15, 100)  # cod is 0.15 g/l at least


def test_what_happens_between_samples_counts():
    cert = kept().certificate["float32"]
    plant, problem, bent = judged()
    given = plant, problem, kept().observer.tables["float32"], cert["thresholds"], np.array(cert["T1"])
    fault_sets.check(*given, 864.0, bent)
    with pytest.raises(CertificateError):
        fault_sets.check(*given, 864.0, 1.2 * bent)


def test_the_claims_rest_on_the_plant_of_the_design():
    made = kept()
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    assert any("fault or not" in claim for claim in claims_of(made.plant, t, cert))
    for old, new in (("range = [1, 2] }", "range = [0, 4] }"), ("kd    = 0.02", "kd    = 0.04"),
                     ("sample_period = 864 ", "sample_period = 900 ")):
        assert old in made.plant.text
        with pytest.raises(CertificateError):
            check(loads(made.plant.text.replace(old, new), scenarios=False), t, cert)


def test_what_the_plant_does_between_samples_is_within_its_bound():
    """What an Euler step leaves out of simulated runs; the bound is of the ranges, not of this run."""
    plant, true = kept().plant, truth()
    f = sympy.lambdify(plant.polytope.symbols, plant.polytope.equations, "numpy")
    values = np.array([np.broadcast_to(v, len(true.x)) for v in f(*true.x.T, *true.u.T)]).T
    bound = bend(plant)
    step = np.abs(np.diff(true.x, axis=0) - plant.sample_period * values[:-1])[:, :3]
    allowed = plant.sample_period**2 / 2 * bound[:3]
    assert np.all(step <= allowed) and np.all(step.max(axis=0) > 0.02 * allowed) and bound[3] == 0
    narrow = loads(plant.text.replace("range = [1, 2] }", "range = [1.3, 1.7] }"))
    assert np.all(bend(narrow)[:3] <= bound[:3]) and bend(narrow)[1] < bound[1]


def test_errors_of_weights_and_known_terms_are_bounds():
    made = kept()
    t, p = made.observer.tables["float32"], made.plant.polytope
    off = fault_bounds.slips(t, p.premises)
    errors = np.array([float(e) for e in (*off.h, *off.g)])
    rng, whole = np.random.default_rng(3), with_faults(made.plant)
    lo, hi = (np.concatenate(v) for v in zip(whole.limits("x"), whole.limits("u")))
    points = rng.uniform(lo, hi, (300, len(lo)))
    got = np.array(evaluate(t.weights, list(points.astype("float32").T), "float32")[:-1], dtype=float).T
    terms = sympy.lambdify(p.symbols, [k.term for k in p.known], "math")
    true = np.array([[*p.weights(x[:4], x[7:])[0], *terms(*x[:4], *x[7:])] for x in points])
    worst = np.abs(got - true).max(axis=0)
    assert np.all(worst <= errors) and np.all(errors < 300 * worst)


def test_programs_without_a_bound_are_refused():
    t = kept().observer.tables["float32"]
    with pytest.raises(CertificateError, match="reads an estimate"):
        program_errors(t.weights, [None] * t.weights.inputs, "float32")
    x = sympy.Symbol("x")
    for expression, message in ((sympy.exp(x), "exp of the libm has no bound"), (1 / x, "a divisor of a weight")):
        b = Builder([x])
        program = b.done([b.value(expression), b.apply("ge", b.value(x), b.constant(0.0))])
        with pytest.raises(CertificateError, match=message):
            program_errors(program, [(fmpq(0), fmpq(1), fmpq(0))], "float32")


def test_what_no_observer_moves_is_said_and_left_alone():
    """Methane against its sensor decays by 1/d whatever the gains; a faster rate is asked of the rest only."""
    plant = load("digester")
    problem, _ = fault_problem(plant)
    (v, mode), = unmoved(problem)
    assert told(problem, v) == "methane and methane sensor" and mode * DAY == pytest.approx(-1)
    for decay, slow in ((0.8, 0), (2.0, 1)):
        made = propose(plant, "", {"decay": decay / DAY, "gain": 100.0})
        assert len(made.found.slow) == slow
        g = gains_of(made.problem, made.found, made.s, made.period, "float64")
        for A, K in zip(g.F, g.K):
            modes = np.sort(np.abs(np.linalg.eigvals(A + K @ g.C)))
            assert modes[-1] == pytest.approx(0.99, abs=1e-6) if slow else modes[-1] <= np.exp(-0.8 * 0.01) + 1e-6
            assert not slow or modes[-2] <= np.exp(-2 * 0.01) + 1e-6
    assert made.found.slow[0][0] == "methane and methane sensor"


def changed(*pairs) -> str:
    text = load("digester").text
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


REFUSED = [
    ([("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]]", "Df = [[1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]]")],
     "the fault methane sensor acts on no output"),
    ([('{ name = "methane sensor", unit = "l/d", range = [-0.5, 0.5] }', '{ name = "methane sensor", unit = "l/d" }')],
     "has no range, expected one"),
    ([("((1 - Y1)*YCH4*growth*biomass - methane)/day", "(1 - Y1)*YCH4*growth*biomass/day"),
      ('0, "-1/day", 0]', "0, 0, 0]")], "nothing tells methane and methane sensor apart"),
]


@pytest.mark.parametrize("pairs, message", REFUSED)
def test_plants_without_an_observer_are_told_why(pairs, message):
    reason = inapplicable(loads(changed(*pairs)))
    assert message in reason and reason.endswith(".")
    with pytest.raises(DesignError, match="does not apply"):
        codegen.design(loads(changed(*pairs)), method="descriptor-fault-estimation")


def test_an_algebraic_state_needs_a_sound_sensor_and_known_terms_something_exact():
    reason = inapplicable(load("bioreactor"))
    assert "rank [E; C] of states and faults is 6, expected 7" in reason and "growth" in reason
    noisy = changed(("\n[initial]", 'v = [{ name = "noise", bounds = [-0.1, 0.1] }]\n[initial]'),
                    ("[0, 0, 0]]\n\n[non", "[0, 0, 0]]\nDv = [[0], [0], [0], [1]]\n\n[non"))
    with pytest.raises(PlantError, match="reads growth, which the observer does not know exactly"):
        loads(noisy)
    assert inapplicable(load("disc_points")) is not None


@pytest.mark.parametrize("pairs, message", [
    ([('"ks1*growth/(km1*IpH - growth)"]', '"ks1*growth/(km1*IpH - growth) - cod"]')],
     r"nonlinear.known.#4: reads cod, which the observer does not know exactly"),
    ([('known = ["0", ', 'known = [')], r"nonlinear.known: has 3 entries, expected 4"),
    ([('"ks1*growth/(km1*IpH - growth)"]', '"ks1*growth/(growth - 2)"]')], r"nonlinear.known.#4: has no bounds"),
    ([('"ks1*growth/(km1*IpH - growth)"]', '"2*ks1*growth/(km1*IpH - growth)"]')], r"row 4 of A x \+ B u differs"),
])
def test_known_terms_of_a_plant_file(pairs, message):
    with pytest.raises(PlantError, match=message):
        loads(changed(*pairs))


def test_with_weights_of_the_estimate_the_level_of_the_recursion_is_certified():
    """The first form: weights read what is not measured exactly, the plant's own storage is in the inequalities."""
    text = load("dlpv").text
    text = text[:text.index("[[scenario]]")] + '[[scenario]]\nname = "s"\nsteps = 300\nu = ["4*sin(t)"]\n'
    for old, new in ((', { name = "sensor 2", range = [-2, 2] }, { name = "sensor 3", range = [-2, 2] }]', "]"),
                     ("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "Df = [[1], [0], [0]]")):
        assert old in text
        text = text.replace(old, new)
    plant = loads(text)
    problem, s = fault_problem(plant)
    assert not problem.tied and unseen_by(problem, s, "continuous") is None
    assert inapplicable(plant) is None
    found = design(in_units(problem, s), Bounds(10.0, 0.5 / s.time, 0.01 * s.time))
    gains = gains_of(problem, found, s, 0.01, "float32")
    start = {"form": "standard", "time": "discrete", "contraction": 1.0, "period": 0.01,
             "T1": s.factor1(found.T1).tolist()}
    gamma, proof, _ = certified(problem.whole, gains, start, s)
    assert gamma == pytest.approx(found.gamma, rel=0.05) and proof["contraction"] < 1
    with pytest.raises(CertificateError):
        exact_check(problem.whole, replace(gains, K=-gains.K), proof)
    true = simulate(plant, "s", seed=1)
    f = np.where(np.arange(300) >= 100, 0.5, 0.0)[:, None]
    z, error = np.zeros(4), []
    for u, y in zip(true.u, true.y + f @ plant.polytope.Df.T):
        x_hat = z + gains.T2 @ y
        h, _ = plant.polytope.weights(x_hat[:3], u)
        z = np.tensordot(h, np.concatenate([gains.F, gains.G, gains.K], axis=2), 1) @ np.concatenate(
            [x_hat, u, gains.C @ x_hat - y])
        error.append(x_hat[3])
    error = np.array(error) - f[:, 0]
    assert abs(error[150:].mean()) < 0.05 and error[150:].std() < 0.1  # noise of 0.15 on that sensor, and no bias
