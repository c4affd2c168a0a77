"""Polytopic methods from plant file to certified tables: thresholds on emitted constants, runs, tampering, refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.descriptors import made
from helpers.tanks import CONTINUOUS, DISCRETE

from codegen.certify import polytope_drift, polytope_rounding, polytope_thresholds
from codegen.certify.exact import Q
from codegen.certify.polytope_ranges import Ranges
from codegen.designs import Design, recheck
from codegen.errors import CertificateError, DesignError
from codegen.observers import PolytopicObserver, Supervision
from codegen.observers.polytopic_step import step
from codegen.plant.load import load, loads
from codegen.plant.simulate import simulate
from codegen.selection.polytopic_designs import by_steps, certified, check, propose
from codegen.selection.select import choose
from codegen.synthesis import METHODS
from codegen.synthesis.descriptor_problem import problem_of


def parts(design, real="float32"):
    """What ``polytope_thresholds.check`` takes."""
    plant, cert = design.plant, design.certificate[real]
    return (plant, problem_of(plant), design.observer.tables[real], cert["thresholds"],
            np.array(cert["energy"]["T1"]), cert["energy"].get("period"))


def test_a_discrete_plant_the_whole_way():
    """Default method, both types; no false alarm at the corners; a sensor step above the promise is found at once."""
    design = choose(loads(DISCRETE), None, {}, print)
    assert design.method == "descriptor-discrete" and set(design.observer.tables) == {"float32", "float64"}
    assert recheck(design) == design.proved and "Euler" not in " ".join(design.claims("float32"))
    plant, t = design.plant, design.observer.tables["float32"]
    size = design.detection["float32"][0]["by_delay"][0]
    truths = [simulate(plant, plant.scenarios[0], seed=k) for k in range(4)]
    trace = design.observer.run_many(*(np.array([getattr(r, n) for r in truths]) for n in "uyq"))
    assert not trace.raw_bits.any() and trace.assured.all()
    largest = np.nanmax(np.abs(trace.r), axis=(0, 1))
    assert np.all(largest <= t.h[-1]) and np.all(largest > t.h[-1] / 12)
    fault = simulate(plant, plant.scenarios[1], seed=1)
    assert 0 < size < 0.9 and np.argmax(design.observer.run(fault.u, fault.y).raw_bits != 0) == 100


@lru_cache
def disc() -> Design:
    """As it is designed now: bounds that are not tight let mutants pass."""
    plant = load("disc")
    t, cert = certified(plant, propose(plant, "descriptor-uncertain", {}), {}, "float32")
    return Design(plant, "descriptor-uncertain", PolytopicObserver({"float32": t}, Supervision()), {"float32": cert},
                  {"float32": check(plant, t, cert)}, {"float32": []})


def test_thresholds_are_checked():
    """Each number that a threshold rests on, changed: refused."""
    polytope_thresholds.check(*parts(made("disc")))  # as committed, with bounds that are less tight
    plant, problem, t, cert, T1, period = parts(disc())
    polytope_thresholds.check(plant, problem, t, cert, T1, period)
    low, first, carried = t.h.copy(), t.h.copy(), [list(map(list, c)) for c in cert["carry"]]
    low[-1, 0] *= np.float32(0.99)
    first[0, -1] *= np.float32(0.5)
    bounds = (np.array(cert["bounds"]) * 0.98).tolist()
    carried[0][0] = [[0], [2.0]]
    wide = replace(t, z_hi=t.z_hi * 30)
    for tables, proof, words in ((replace(t, h=low), cert, "in the end"), (replace(t, h=first), cert, "after a start"),
                                 (t, cert | {"bounds": bounds}, "not kept|initial box"),
                                 (t, cert | {"carry": carried}, "not kept"), (wide, cert, "after|not kept"),
                                 (replace(t, K=-t.K), cert, "not kept")):
        with pytest.raises(CertificateError, match=words):
            polytope_thresholds.check(plant, problem, tables, proof, T1, period)
    with pytest.raises(CertificateError, match="not kept"):  # three times the period: the plant moves further
        polytope_thresholds.check(plant, problem, t, cert, T1, 3 * period)


def test_a_certificate_of_another_plant_is_refused():
    design = disc()
    t, cert = design.observer.tables["float32"], design.certificate["float32"]
    assert check(design.plant, t, cert) == design.claims("float32")
    noisy = replace(design.plant, x=tuple(replace(s, lo=1.5 * s.lo, hi=1.5 * s.hi) for s in design.plant.x))
    with pytest.raises(CertificateError, match="not kept"):
        check(noisy, t, cert)
    with pytest.raises(CertificateError, match="period"):
        check(replace(design.plant, sample_period=0.02), t, cert)
    with pytest.raises(CertificateError, match="level"):
        check(design.plant, t, cert | {"level": cert["level"] / 2})


@pytest.mark.parametrize("name", ["disc", "dlpv"])
def test_between_samples_the_plant_moves_by_less_than_what_is_taken(name):
    """The mean distance of simulated runs, the algebraic states too; the trivial bound is the width of the ranges."""
    plant = load(name)
    problem = problem_of(plant)
    found = polytope_drift.drift(plant, problem, Ranges.of(plant, problem), plant.sample_period)
    bound = found.moved.astype(float)
    fine = replace(plant, sample_period=plant.sample_period / 8)
    runs = [simulate(fine, replace(s, steps=160, w="corner", fault=()), seed=4).x.reshape(20, 8, -1)
            for s in plant.scenarios[:1]]
    moved = np.max([np.abs(x - x[:, :1]).mean(axis=1).max(axis=0) for x in runs], axis=0)
    width = np.subtract(*plant.limits("x")[::-1])
    assert np.all(moved <= bound) and np.all(bound <= width) and np.any(bound < width / 2)


def test_rounding_is_covered():
    """The computed recursion against the same in double precision, from the same numbers: within what is taken."""
    t, rng = made("disc").observer.tables["float32"], np.random.default_rng(2)
    slip = polytope_rounding.rounding(t)
    z = rng.uniform(t.z_lo, t.z_hi, (400, len(t.z_lo))).astype("float32")
    u, y = (rng.uniform(lo, hi, (400, len(lo))).astype("float32") for lo, hi in ((t.u_lo, t.u_hi), (t.y_lo, t.y_hi)))
    none, seen = np.zeros((400, 0), "float32"), np.ones(400, bool)
    x_hat, r, _, _ = step(t, z, u, y, none, seen)
    T2, C = t.T2.astype(float), t.C.astype(float)
    exact = z + y.astype(float) @ T2.T
    assert np.all(np.abs(x_hat - exact) <= [float(v) for v in slip.x_hat])
    assert np.all(np.abs(r - (y - x_hat.astype(float) @ C.T)) <= [float(v) for v in slip.r])
    assert np.any(np.abs(x_hat - exact) > 0.01 * np.array([float(v) for v in slip.x_hat]))
    assert all(v > 0 for v in slip.z) and max(slip.z) < Q(1e-3)


def test_methods_of_a_continuous_plant():
    """Each designs; the detector's residual is weighted."""
    plant = loads(CONTINUOUS)
    for method, options in (("descriptor-uncertain", {"factors": "least"}), ("descriptor-error", {}),
                            ("descriptor-discrete", {}), ("hminus-hinf", {"criterion": "slow"})):
        given = replace(plant, options=options)
        assert METHODS[method].module.inapplicable(given) is None
        t, cert = certified(given, propose(given, method, options), options, "float32")
        claims = check(given, t, cert)
        assert t.weighted == (method == "hminus-hinf") and (cert["limit"] is None) == (method == "descriptor-discrete")
        assert any("no |r| exceeds" in c for c in claims) and any("H-infinity" in c for c in claims)


def test_what_does_not_apply_is_said():
    dlpv, module = load("dlpv"), METHODS["descriptor-uncertain"].module
    assert "discrete" in module.inapplicable(loads(DISCRETE)) and METHODS["hminus-hinf"].module.inapplicable(
        replace(dlpv, f=())).startswith("no fault")
    wide = replace(dlpv, x=(replace(dlpv.x[0], hi=np.inf), *dlpv.x[1:]))
    assert "no range" in module.inapplicable(wide) and "modes" in module.inapplicable(load("cart"))
    assert "rank" in module.inapplicable(load("bioreactor"))
    tank = loads(CONTINUOUS)
    with pytest.raises(DesignError, match="no observer was found.*sample faster"):
        propose(replace(tank, sample_period=2.0), "hminus-hinf", {"criterion": "slow"})
    moving = replace(tank, u=(replace(tank.u[0], rate=1.0),))
    with pytest.raises(DesignError, match="moves between samples"):
        certified(moving, propose(moving, "descriptor-discrete", {}), {}, "float32")
    problem = problem_of(dlpv)
    assert np.allclose(by_steps(problem, 0.1).A[0], problem.E + 0.1 * problem.A[0])


def test_the_first_method_that_certifies_something_is_taken():
    """At .3 s thresholds for Euler steps of an observer in continuous time are of no use; those of a recursion are."""
    plant, said = loads(CONTINUOUS.replace("sample_period = 0.02", "sample_period = 0.3")), []
    design = choose(plant, None, {"set_rows": 8}, said.append)
    assert design.method == "descriptor-discrete" and recheck(design)
    assert np.all(design.observer.tables["float32"].h[-1] < 3)
    assert "descriptor-uncertain: certified, but no residual within the ranges of y passes its thresholds" in said
    alone = choose(plant, "descriptor-uncertain", {"set_rows": 8}, said.append)
    assert np.all(alone.observer.tables["float32"].h[-1] > 400) and recheck(alone)
    with pytest.raises(DesignError, match="descriptor-uncertain: no observer was found"):
        choose(loads(CONTINUOUS.replace("sample_period = 0.02", "sample_period = 5")), None, {}, said.append)
