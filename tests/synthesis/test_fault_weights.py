"""Sensor faults as states with weights at the estimate: bounds that hold fault or not, mutants, what has no bound."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flint import fmpq
from helpers.folders import built, write
from helpers.scripts import ROOT
from helpers.tools import need

from codegen.analysis.calibration import Population, fault_free_runs
from codegen.analysis.detectability import surely_detected
from codegen.analysis.validate import side_by_side, validate
from codegen.assurance.claims import claims
from codegen.certify import polytope_bounds, polytope_thresholds
from codegen.certify.exact import Q, leading_failure, product, rational
from codegen.designs import Design, claims_of, read_design
from codegen.errors import CertificateError, DesignError
from codegen.observers import PolytopicObserver, Supervision
from codegen.plant.load import load, loads
from codegen.plant.simulate import simulate
from codegen.report.polytopic_words import facts, tables
from codegen.selection import polytopic_calibration
from codegen.selection.fault_estimators import certified, propose
from codegen.selection.polytopic_designs import about, check
from codegen.synthesis.descriptor_fault_estimation import design, gains_of
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.fault_problem import fault_problem, in_units, inapplicable, told, unmoved
from codegen.target.gappa import prove_rounding
from codegen.target.prove import prove

DAY = 86400.0
METHOD = "descriptor-fault-estimation"
CHANCE = {"threshold": "calibrated", "false_alarm": 0.5, "confidence": 0.5, "campaign_steps": 60}
#: Estimate of the bioreactor at the start, as printed: biomass, cod, methane, growth, faults; no consistent one.
PRINTED = np.array([0, 0.5, 1, 0.4, -1, -0.2, 0.3])


@lru_cache
def proposal():
    return propose(load("tank"), METHOD, {})


def designed(options: dict) -> Design:
    """A design for the tank in single precision alone; options are of its bounds."""
    plant = replace(load("tank"), options=options)
    t, cert = certified(plant, proposal(), options, "float32")
    faults = [{"channel": f.channel, "unit": f.unit, "by_delay": [None if x == np.inf else x for x in f.by_delay]}
              for f in surely_detected(plant, t, cert, 0)]
    supervision = Supervision.of(plant.target, assures="calibration" not in cert)
    return Design(plant, METHOD, PolytopicObserver({"float32": t}, supervision), {"float32": cert},
                  {"float32": claims_of(plant, t, cert)}, {"float32": faults})


@lru_cache
def tank() -> Design:
    return designed({})


def test_the_bound_counts_that_weights_are_near():
    """Of the level sensor 0.015 m at a noise of 0.005 m; with weights that may be anything forty times as much."""
    made = tank()
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    assert not fault_problem(made.plant)[0].tied and inapplicable(made.plant) is None and "near" in cert["thresholds"]
    assert t.h[-1, 0] < 0.016 and cert["level"] <= cert["claimed"]
    claim = next(c for c in made.claims("float32") if c.startswith("r is what the faults do to y"))
    assert "disturbances and faults, z being the error of the faults" in made.claims("float32")[0]
    assert "fault or not" in claim and "the C at its estimate" in claim
    assert made.detection["float32"][0]["by_delay"][0] == pytest.approx(2 * t.h[-1, 0], rel=1e-5)
    words = str(facts(made, "float32")) + str(tables(made, "float32"))
    assert "at the estimate" in words and "with and without faults" in words and "exact: those" not in words
    far = {key: value for key, value in cert["thresholds"].items() if key != "near"}
    with pytest.raises(CertificateError, match="not kept"):
        check(made.plant, t, cert | {"thresholds": far})
    apart = designed({"mismatch": "any"})
    assert apart.observer.tables["float32"].h[-1, 0] > 30 * t.h[-1, 0]
    assert any("whatever the weights of plant and observer do" in c for c in apart.claims("float32"))


def test_the_firmware_keeps_its_promise_fault_or_not(tmp_path):
    """Scenarios of the compiled C; then faults that jump over their whole range at every sample."""
    need("gcc")
    made = tank()
    driver = built(made, tmp_path)
    outcomes = validate(made, driver)
    assert [o.scenario.name for o in outcomes] == ["no fault", "drift", "stuck high"]
    assert all(not (o.differences or o.lost or o.false_alarms) and o.trace.assured.all() for o in outcomes)
    assert outcomes[2].episodes[0].delay == 0 and outcomes[1].episodes[0].delay is not None
    true, Df = simulate(made.plant, "no fault", seed=2), made.plant.polytope.Df
    f = np.random.default_rng(0).uniform(*made.plant.limits("f"), (len(true.u), 1))
    got, quiet = (driver.run(true.u, true.y + g @ Df.T) for g in (f, 0 * f))
    off = np.abs(got.r - f @ Df.T)
    assert np.all(off <= got.r_bound) and got.assured.all() and got.settled[10:].all()
    assert off[10:, 0].max() > 0.3 * got.r_bound[-1, 0]  # and not from far away: a third of it is reached by noise
    # The estimate of x is that without faults, so the weights are.
    assert np.abs(got.x_hat[:, :2] - quiet.x_hat[:, :2]).max() < 1e-5 and np.abs(f).max() > 0.7
    short = replace(made, observer=PolytopicObserver({"float32": replace(
        made.observer.tables["float32"], h=0.3 * made.observer.tables["float32"].h)}, made.observer.supervision))
    assert validate(short, built(short, tmp_path / "short"), ["no fault"])[0].lost


def test_weights_beyond_their_range_assure_nothing_and_let_the_bound_be(tmp_path):
    """Near the end of its range the outflow's estimate passes it by noise; the bound stays what it has come down to."""
    need("gcc")
    made, low = tank(), '[[scenario]]\nname = "low"\nsteps = 450\nu = ["4.02"]\nv = "uniform"\n'
    true = simulate(loads(made.plant.text + low), "low", seed=0)
    got = built(made, tmp_path).run(true.u, true.y)
    assert np.all(true.x >= made.plant.limits("x")[0]) and 10 < np.sum(got.inside == 0) < 200
    assert np.array_equal(got.assured, got.inside) and got.settled[10:].all()
    assert np.all(np.abs(got.r) <= got.r_bound)
    assert made.observer.tables["float32"].at_estimate and not read_design(
        ROOT / "generated" / "digester_descriptor-fault-estimation").observer.tables["float32"].at_estimate


def tampered():
    """Tables and certificate, changed in one number that the bounds rest on."""
    made = tank()
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    held, one = cert["thresholds"], np.float32(1)
    low, K, F, C = (getattr(t, k).copy() for k in ("h", "K", "F", "C"))
    low[-1, 0] *= 0.98 * one
    K[0, 0, 1] *= -one
    F[1, 0, 0] += np.float32(0.05)
    C[0, 0] *= np.float32(1.01)
    yield "threshold", replace(t, h=low), cert, "residual 0 reaches"
    yield "gain", replace(t, K=K), cert, "fails|not kept"
    yield "entry of F", replace(t, F=F), cert, "fails|not kept"
    yield "entry of C", replace(t, C=C), cert, "fails|reaches|not kept"
    yield "bounds", t, cert | {"thresholds": held | {"bounds": (0.95 * np.array(held["bounds"])).tolist()}}, "not kept"
    yield "level", t, cert | {"level": 0.99 * cert["level"]}, "level"
    yield "T1", t, cert | {"energy": cert["energy"] | {"T1": (1.05 * np.array(cert["energy"]["T1"])).tolist()}}, "fails"


@pytest.mark.parametrize("what", [name for name, *_ in tampered()])
def test_what_is_not_the_proved_observer_is_refused(what):
    t, cert, words = next(rest for name, *rest in tampered() if name == what)
    with pytest.raises(CertificateError, match=words):
        check(tank().plant, t, cert)


@pytest.mark.parametrize("old, new", [("[-0.05, 0.05]", "[-0.08, 0.08]"), ("orifice = 10 ", "orifice = 9 "),
                                      ("[-0.005, 0.005]", "[-0.006, 0.006]")])
def test_the_claims_rest_on_the_plant_of_the_design(old, new):
    made = tank()
    assert old in made.plant.text
    with pytest.raises(CertificateError):
        check(loads(made.plant.text.replace(old, new), scenarios=False), made.observer.tables["float32"],
              made.certificate["float32"])


def test_rounding_of_c_is_in_the_bound_and_what_a_fault_does_is_not():
    """r is held against Df f: an entry of C that the C rounds adds what it does to x, one of Df adds nothing."""
    made = tank()
    (plant, problem), t = about(made.plant, made.observer.tables["float32"]), made.observer.tables["float32"]
    T1 = np.array(made.certificate["float32"]["energy"]["T1"])

    def room(own, C):
        every = polytope_thresholds.every_pair(own)
        return polytope_bounds.model(plant, every, replace(t, C=C), T1, None)[0][0].room[0]

    off = t.C.copy()
    off[0, 0] += np.float32(2**-10)
    assert room(problem, off) - room(problem, t.C) >= fmpq(1, 2**10) * Q(0.5)  # level is 1 m at most, 0.16 at least
    stronger = problem.C.copy()
    stronger[0, 2] *= 1 + 2**-10
    assert room(replace(problem, C=stronger), t.C) < room(problem, t.C) + fmpq(1, 10**5)


def test_claims_are_stated_with_their_margins():
    made = tank()
    found = claims(made, "float32")
    assert {"energy", "decay", "estimate", "settled", "ranges"} <= {c.id for c in found}
    assert all(m.holds for c in found for m in c.margins)
    kept = next(c for c in found if c.id == "estimate")
    assert "signals.f" in kept.plant and "weights" in kept.constants and len(kept.margins) == 2
    t = made.observer.tables["float32"]
    wrong = replace(made, observer=PolytopicObserver({"float32": replace(t, h=np.float32(0.98) * t.h)},
                                                     made.observer.supervision))
    with pytest.raises(CertificateError, match="residual 0 reaches"):
        claims(wrong, "float32")


def test_the_c_is_proved_and_its_rounding_confirmed(tmp_path):
    need("frama-c")
    need("gappa")
    folder = write(tank(), tmp_path / "out")
    result = prove(folder)
    assert result.proved and result.coverage >= 99, result.alarms
    script = folder / "rounding_tank.g"
    rounded = prove_rounding(folder)
    assert rounded.proved and rounded.rows == 13
    text = script.read_text()
    script.write_text(re.sub(r"(exact_tank_move_0\| <= )\S+", r"\g<1>0x1.0p-40", text))
    assert script.read_text() != text and not prove_rounding(folder).proved


def test_calibrated_where_that_is_asked_for():
    """From runs without a fault: nothing is assured, and what a further run shows is what was stated."""
    made = designed(CHANCE)
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    assert np.all(t.h[-1] <= cert["calibration"]["guaranteed"]) and not made.observer.supervision.assures
    assert t.h[-1, 0] < 0.9 * cert["calibration"]["guaranteed"][0]
    assert any(c.startswith("not proved but calibrated") for c in made.claims("float32"))
    assert not any("fault or not" in c for c in made.claims("float32")) and "calibrated" in str(facts(made, "float32"))
    fresh = side_by_side(fault_free_runs(made.plant, Population(steps=60), 30, 99))
    assert made.observer.run_many(*fresh[:3]).raw_bits.any(axis=1).mean() <= 0.7
    with pytest.raises(CertificateError, match="runs of the campaign exceed"):
        check(made.plant, replace(t, h=np.concatenate([t.h[:-1], np.float32(0.97) * t.h[-1:]])), cert)


def test_where_nothing_is_guaranteed_nothing_is_judged_before_a_start_is_forgotten(monkeypatch):
    def none_kept(*_):
        raise DesignError("tank: no set of the error is kept.")
    monkeypatch.setattr(polytopic_calibration, "frozen", none_kept)
    with pytest.raises(DesignError, match='no set .* observer.threshold = "calibrated"'):
        designed({})
    made = designed(CHANCE)
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    assert cert["thresholds"] == {"waits": t.last << t.shift} and cert["calibration"]["guaranteed"] is None
    assert t.last and t.h[0, 0] > 2 > 50 * t.h[-1, 0] and made.detection["float32"][0]["by_delay"] == [None]
    soon = replace(t, h=t.h[-1:], start=0, shift=0)
    early = replace(t, h=np.concatenate([0.5 * t.h[:1], t.h[1:]]).astype("float32"))
    for wrong, words in ((soon, "start may still be seen"), (early, "is judged before")):
        with pytest.raises(CertificateError, match=words):
            check(made.plant, wrong, cert)


def test_what_nothing_would_read_and_what_rests_on_known_weights_is_refused():
    plant = load("digester")
    with pytest.raises(DesignError, match="observer.mismatch is of bounds with weights at the estimate"):
        propose(plant, METHOD, {"mismatch": "any"})
    noisy = replace(plant.polytope, Dv=np.array([[0.0], [0], [0], [1]]))
    unknown = replace(plant, polytope=noisy, v=(replace(plant.f[0], name="noise"),))
    assert inapplicable(unknown).startswith("its weights read growth, which no output gives exactly, beside known ")


def bioreactor() -> str:
    """That of the gallery with the fourth sensor of example 3.7.2, which is sound; sixteen vertices."""
    text = load("bioreactor").text[:load("bioreactor").text.index("[[scenario]]")]
    for old, new in (('range = [-1, 3] },\n]', 'range = [-1, 3] },\n  { name = "growth", range = [0, 3] },\n]'),
                     ("[0, 0, 1, 0]]\nDf", "[0, 0, 1, 0], [0, 0, 0, 1]]\nDf"),
                     ("[0, 0, 1]]\n", "[0, 0, 1], [0, 0, 0]]\n")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text + '[[scenario]]\nname = "four days"\nsteps = 201\nu = ["0.45", "1.05"]\n'


def test_the_bioreactor_of_the_thesis_by_its_quotient():
    """At 4 d, from the printed start: cod and methane sensor within .024 and .034; that of biomass keeps its mode."""
    plant = loads(bioreactor())
    problem, s = fault_problem(plant)
    assert not problem.tied and len(problem.whole.pairs) == 128
    modes = {told(problem, v): mode * DAY for v, mode in unmoved(problem)}
    assert modes == pytest.approx({"biomass and biomass sensor": -0.02, "methane and methane sensor": -1})
    T = plant.sample_period
    found = design(in_units(problem, s), Bounds(60.0, 6 / DAY / s.time, T * s.time))
    assert {name for name, _ in found.slow} == set(modes)
    gains = gains_of(problem, found, s, T, "float32")
    assert len(np.unique(gains.K, axis=0)) == 2 and len(np.unique(gains.F, axis=0)) == 4
    # The quotient shrinks by more than exp(-6/d), exactly, in one quadratic function of it; a faster one is refused.
    V = np.array([v for v, _ in unmoved(problem)]).T
    kept, scale = list(problem.kept), s.columns[list(problem.kept)]
    V2 = np.linalg.svd((V / scale[:, None]).T)[2][V.shape[1]:].T
    N = [(F + K @ gains.C)[np.ix_(kept, kept)] for F, K in zip(gains.F, gains.K)]
    M = [rational(V2.T @ (n * scale / scale[:, None]) @ V2) for n in N]
    P = quadratic([np.array(m, dtype=float) for m in M], np.exp(-5.9 * T / DAY))
    for rate, holds in ((5.8, True), (60.0, False)):
        share = Q(float(np.exp(-2 * rate * T / DAY)))
        assert all(leading_failure(share * P - product(m.T, product(P, m))) is None for m in M) == holds
    true = simulate(plant, "four days", seed=0)
    f = np.where(np.arange(201) >= 50, 1.0, 0.0)[:, None] * np.array([0.1, -0.1, 0.2])
    blend = np.concatenate([gains.F, gains.G, gains.K], axis=2)
    z, out = PRINTED - gains.T2 @ (gains.C @ PRINTED), []
    for u, y in zip(true.u, true.y + f @ plant.polytope.Df.T):
        out.append(z + gains.T2 @ y)
        h, _ = plant.polytope.weights(out[-1][:4], u)
        z = np.tensordot(h, blend, 1) @ np.concatenate([out[-1], u, gains.C @ out[-1] - y])
    error = np.abs(np.array(out)[:, 4:] - f)
    assert error[200, 1] < 0.024 and error[200, 2] < 0.034 and 0.3 < error[200, 0] < error[0, 0]
    assert np.all(error[0] > 0.15) and np.all(np.array(out)[:, 3] == true.y[:, 3])
    # No bound worth the name, so no firmware: told at once.
    with pytest.raises(DesignError, match="biomass and biomass sensor move together .* weights are not the plant's"):
        propose(plant, METHOD, {"decay": 6 / DAY, "gain": 60.0})


def quadratic(M: list[np.ndarray], factor: float):
    """A matrix P, rational, in which every M shrinks by the factor: of a proposal, which is not believed."""
    import cvxpy as cp
    P = cp.Variable(M[0].shape, symmetric=True)
    conditions = [P >> np.eye(len(M[0]))]
    conditions += [factor**2 * P - m.T @ P @ m >> 1e-6 * np.eye(len(m)) for m in M]
    cp.Problem(cp.Minimize(cp.trace(P)), conditions).solve(solver=cp.CLARABEL)
    return rational((P.value + P.value.T) / 2)
