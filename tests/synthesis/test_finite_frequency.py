"""Sensitivity to faults below a frequency: designed, certified exactly on the constants, seen in a sweep."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.tanks import CONTINUOUS

from codegen.analysis.frequency import responses
from codegen.certify import finite_frequency
from codegen.designs import Design
from codegen.errors import CertificateError, DesignError
from codegen.observers import PolytopicObserver, Supervision
from codegen.plant.load import load, loads
from codegen.report.frequency_words import words_of
from codegen.selection.detectors import certified_band, faults_of
from codegen.selection.polytopic_designs import certified, check, constants, decay_of, propose, sensitivity
from codegen.selection.polytopic_tables import tables_of
from codegen.synthesis.descriptor_gains import StandardGains, rounded

#: rad/s; the plant's own slowest modes are about as fast.
BAND = 3.0


@lru_cache
def dlpv(criterion: str):
    """Plant, proposal, emitted constants and proof of a detector for it."""
    plant = load("dlpv")
    proposal = propose(plant, "hminus-hinf", {"criterion": criterion, "band": BAND})
    gains, M, T1 = constants(proposal, "float32")
    about = {"T1": T1.tolist(), "period": proposal.period}
    proof = certified_band(proposal.problem, faults_of(plant), gains, M, about, BAND, proposal.s)
    return plant, proposal, gains, M, proof


def judged(plant, gains, M):
    t = tables_of(plant, gains, M, "float32")
    r = responses(plant, t)
    return t, r, 2 * np.pi * r.frequency <= BAND


def test_the_certified_gain_is_the_least_of_the_sweep_in_the_band():
    """Within two per cent, at every vertex; above the band it does not hold, nor for a design for lasting faults."""
    plant, _, gains, M, proof = dlpv("band")
    _, r, inside = judged(plant, gains, M)
    assert proof["beta"] > 1 and proof["period"] == 0.01  # |M r| >= |f| is what the design asks for
    assert proof["beta"] <= r.fault[:, inside].min() < 1.03 * proof["beta"] and r.fault.min() < 0.2 * proof["beta"]
    plant, _, gains, M, slow = dlpv("slow")
    _, r, inside = judged(plant, gains, M)
    assert slow["beta"] < 0.3 and slow["beta"] <= r.fault[:, inside].min() < 0.3 and r.fault[:, 0].min() > 0.9


def test_what_a_proof_rests_on_is_checked():
    plant, proposal, gains, M, proof = dlpv("band")
    given = proposal.problem, faults_of(plant)
    assert "up to 3 rad/s, by steps of 0.01 s" in finite_frequency.check(*given, gains, M, proof)[0]
    more, zero = proof["level2"] * 1.06, np.zeros_like(proof["Q"]).tolist()
    wrong = [(gains, M, proof | {"level2": more}, "fails"), (gains, M, proof | {"beta": 1.1}, "no more than the level"),
             (gains, M, proof | {"band": 2 * BAND}, "fails"), (gains, M, proof | {"Q": zero}, "positive definite"),
             (gains, M, proof | {"Y": (1.1 * np.array(proof["Y"])).tolist()}, "fails"),
             (gains, M, proof | {"P": np.eye(2).tolist()}, "symmetric"), (gains, 0.95 * M, proof, "fails"),
             (replace(gains, K=-gains.K), M, proof, "fails"), (gains, M, proof | {"period": 0.05}, "fails")]
    for own, weight, changed, words in wrong:
        with pytest.raises(CertificateError, match=words):
            finite_frequency.check(*given, own, weight, changed)
    with pytest.raises(CertificateError, match="moves the state"):
        finite_frequency.check(given[0], replace(given[1], Bf=np.ones_like(given[1].Bf)), gains, M, proof)


def test_the_same_in_continuous_time():
    """The observer of the same design, not stepped: the limit of short steps."""
    plant, proposal, _, _, stepped = dlpv("band")
    problem, s, found = proposal.problem, proposal.s, proposal.found
    T1 = np.array([s.factor1(T) for T in found.T1])
    gains = StandardGains(*(rounded(v, "float64") for v in (
        s.factor2(found.T2), T1 @ problem.A, T1 @ problem.B, np.array([s.gain(k) for k in found.K]), problem.C)))
    M = rounded(found.M / s.outputs, "float64")
    proof = certified_band(problem, faults_of(plant), gains, M, {"T1": T1.tolist()}, BAND, s)
    assert proof["period"] is None and proof["beta"] == pytest.approx(stepped["beta"], rel=0.03)
    assert "steps" not in finite_frequency.check(problem, faults_of(plant), gains, M, proof)[0]


def test_energies_of_a_slow_fault_while_the_weights_stand_still():
    """A fault of frequencies below the band, switched on and off smoothly, sample by sample at each vertex."""
    plant, _, gains, M, proof = dlpv("band")
    t, _, _ = judged(plant, gains, M)
    k = np.arange(4000)
    shape = np.exp(-((k - 2000) / 500.0) ** 2)
    f = shape[:, None] * np.array([np.sin(0.02 * k), -np.ones(4000), np.cos(0.01 * k)]).T * 2
    T2, C, F, K = (getattr(t, name).astype(float) for name in ("T2", "C", "F", "K"))
    for j in range(3):
        z, energy = np.zeros(3), 0.0
        for row in f:
            x_hat = T2 @ row
            x_hat = z + x_hat
            r = row - C @ x_hat
            z, energy = F[j] @ x_hat - K[j] @ r, energy + np.sum((M @ r) ** 2)
        assert energy >= proof["beta"] ** 2 * np.sum((f / 2) ** 2) * 0.999


def test_a_method_option_from_plant_file_to_certificate():
    """In the certificate of the firmware, checked with the rest; a band without end, or an actuator's: refused."""
    options = {"criterion": "band", "band": 1.0}
    tank = replace(loads(CONTINUOUS), options=options)
    t, cert = certified(tank, propose(tank, "hminus-hinf", options), options, "float32")
    assert any("H- up to 1 rad/s" in c for c in check(tank, t, cert))
    with pytest.raises(CertificateError, match="by steps of 0.5"):
        check(tank, t, cert | {"band": cert["band"] | {"period": 0.5}})
    with pytest.raises(DesignError, match="State observer.band"):
        propose(tank, "hminus-hinf", {"criterion": "band"})
    moved = tuple(replace(v, Bf=np.ones_like(v.Bf)) for v in tank.polytope.vertices)
    actuator = replace(tank, polytope=replace(tank.polytope, vertices=moved))
    with pytest.raises(DesignError, match="moves the state"):
        propose(actuator, "hminus-hinf", options)


@pytest.mark.parametrize("criterion", ["all", "slow"])
def test_other_criteria_are_certified_on_the_recursion_too(criterion):
    """Of all frequencies that steps know, or of those that are a hundredth of the decay: below the sweep, and near."""
    tank, options = loads(CONTINUOUS), {"criterion": criterion}
    proposal = propose(tank, "hminus-hinf", options)
    gains, M, T1 = constants(proposal, "float32")
    proof = sensitivity(tank, proposal, options, gains, M, {"T1": T1.tolist(), "period": 0.02})["band"]
    assert proof["band"] == (2 / 0.02 if criterion == "all" else pytest.approx(0.01 * decay_of(proposal.problem, 0.02)))
    seen = responses(tank, tables_of(tank, gains, M, "float32"))
    least = seen.fault[:, 2 * np.pi * seen.frequency <= proof["band"]].min() if criterion == "all" else (
        seen.fault[:, 0].min())
    assert 0.9 * least < proof["beta"] <= least * (1 + 1e-6)
    pushed = replace(tank, polytope=replace(tank.polytope, vertices=tuple(
        replace(v, Bf=np.ones_like(v.Bf)) for v in tank.polytope.vertices)))
    assert sensitivity(pushed, proposal, options, gains, M, {"T1": T1.tolist(), "period": 0.02}) == {}


def test_the_report_marks_the_band():
    plant, _, gains, M, proof = dlpv("band")
    t, _, _ = judged(plant, gains, M)
    design = Design(plant, "hminus-hinf", PolytopicObserver({"float32": t}, Supervision()),
                    {"float32": {"kind": "polytopic", "band": proof}}, {"float32": []}, {"float32": []})
    (said,) = words_of(design, "float32")
    assert "Up to 0.477 Hz, shaded" in said.text and "at least 1" in said.text and "certified" in said.plots[0].svg
    (plain,) = words_of(replace(design, certificate={"float32": {"kind": "polytopic"}}), "float32")
    assert "shaded" not in plain.text and "certified" not in plain.plots[0].svg
