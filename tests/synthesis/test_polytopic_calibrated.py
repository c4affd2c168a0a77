"""Thresholds of polytopic observers from simulated runs: lower, or where no set of the error is kept."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.tanks import CONTINUOUS, DISCRETE
from helpers.tools import need

from codegen.analysis.calibration import Population, fault_free_runs
from codegen.analysis.detectability import surely_detected
from codegen.analysis.validate import side_by_side, validate
from codegen.certify import polytope_waiting
from codegen.designs import Design, claims_of
from codegen.emit.package import generate
from codegen.errors import CertificateError, DesignError
from codegen.host import build
from codegen.observers import PolytopicObserver, Supervision
from codegen.plant.load import loads
from codegen.report.polytopic_words import facts, tables
from codegen.report.verdict import purpose
from codegen.selection.polytopic_calibration import check, uncalibrated
from codegen.selection.polytopic_designs import certified, propose
from codegen.synthesis.descriptor_problem import problem_of

CHANCE = {"threshold": "calibrated", "false_alarm": 0.2, "confidence": 0.8}
#: An input that moves between the samples: what it does there has no bound, and no set is kept.
MOVING = CONTINUOUS.replace("range = [-1, 1] }]", "range = [-1, 1], rate = 5 }]", 1).replace("sign(sin(0.3*k))",
                                                                                            "sin(0.05*k)")


def designed(text: str, options: dict) -> Design:
    """A design in single precision alone."""
    plant = replace(loads(text), options=options)
    t, cert = certified(plant, propose(plant, "descriptor-discrete", options), options, "float32")
    faults = [{"channel": f.channel, "unit": f.unit, "by_delay": [None if x == np.inf else x for x in f.by_delay]}
              for f in surely_detected(plant, t, cert, 0)]
    supervision = Supervision.of(plant.target, assures="calibration" not in cert)
    return Design(plant, "descriptor-discrete", PolytopicObserver({"float32": t}, supervision), {"float32": cert},
                  {"float32": claims_of(plant, t, cert)}, {"float32": faults})


@lru_cache
def lower():
    return designed(DISCRETE, CHANCE)


@lru_cache
def instead():
    return designed(MOVING, CHANCE | {"false_alarm": 0.5, "confidence": 0.5})


def test_where_none_is_guaranteed_the_refusal_names_the_way_out():
    with pytest.raises(DesignError, match='moves between samples.*observer.threshold = "calibrated"'):
        designed(MOVING, {})
    d = instead()
    t, cert = d.observer.tables["float32"], d.certificate["float32"]
    assert cert["thresholds"] == {"waits": t.last << t.shift} and cert["calibration"]["guaranteed"] is None
    assert any("not proved but calibrated" in c for c in d.claims("float32"))
    assert not any("no false alarm" in c for c in d.claims("float32"))
    assert all(x is None for f in d.detection["float32"] for x in f["by_delay"])  # nothing is promised to be found
    assert "calibrated by simulation" in purpose(d) and "calibrated" in str(facts(d, "float32"))
    assert "#calibrated" not in str(tables(d, "float32")) and "calibrated" in str(tables(d, "float32"))


def test_guaranteed_rows_stay_and_the_last_one_comes_down():
    d = lower()
    t, cert = d.observer.tables["float32"], d.certificate["float32"]
    c = cert["calibration"]
    assert np.all(t.h[-1] <= c["guaranteed"]) and np.any(t.h[-1] < 0.9 * np.array(c["guaranteed"]))
    assert not d.observer.supervision.assures and claims_of(d.plant, t, cert) == d.claims("float32")
    seen = [f["by_delay"][0] for f in d.detection["float32"]]
    assert 0 < seen[0] < np.inf  # sure all the same: calibrated and guaranteed one together
    fresh = side_by_side(fault_free_runs(d.plant, Population(steps=c["steps"]), 200, 99))
    raised = d.observer.run_many(*fresh[:3]).raw_bits.any(axis=1).mean()
    assert raised <= 0.3  # at most a fifth of the runs, with the confidence that is stated


@pytest.mark.parametrize("which", [lower, instead])
def test_the_firmware_never_assures_and_its_alarms_count_as_chance(which, tmp_path):
    need("gcc")
    d = which()
    folder = generate(d, tmp_path / "out")
    outcomes = validate(d, build(folder))
    assert outcomes and all(o.false_alarms == 0 and not o.differences for o in outcomes)
    assert not any(o.trace.assured.any() for o in outcomes)
    header = next(p for p in Path(folder).iterdir() if p.suffix == ".h" and p.stem == d.plant.name).read_text()
    assert "calibrated" in header and "guaranteed" not in header.split("r_bound")[1].split("raw")[0]


def test_a_calibration_that_is_not_the_runs_is_refused():
    d = lower()
    t, c = d.observer.tables["float32"], d.certificate["float32"]["calibration"]
    for tables_, said, words in ((replace(t, h=t.h * np.float32(0.99)), c, "runs of the campaign exceed"),
                                 (t, c | {"confidence": 0.99}, "give a confidence"),
                                 (t, c | {"conditions": ["as you like"]}, "conditions")):
        with pytest.raises(CertificateError, match=words):
            check(d.plant, tables_, said)


def test_waiting_is_checked():
    """A start that may still be seen when it is judged, thresholds before: refused."""
    d = instead()
    t, proof = d.observer.tables["float32"], d.certificate["float32"]["energy"]
    given = d.plant, problem_of(d.plant)
    polytope_waiting.check(*given, t, proof)
    soon = replace(t, h=t.h[-2:], start=0, shift=0)
    judged, at_once = t.h.copy(), replace(t, start=t.last, z0=t.z_hi)
    judged[0] = t.h[-1]
    for tables_, words in ((soon, "start may still be seen"), (replace(t, h=judged), "is judged before"),
                           (at_once, "start may still be seen"), (replace(t, start=1), "starts at")):
        with pytest.raises(CertificateError, match=words):
            polytope_waiting.check(*given, tables_, proof)
    with pytest.raises(CertificateError, match="does not contract"):
        polytope_waiting.samples_needed([1], 1, 1.0, np.ones(1))
    assert np.all(uncalibrated(t, d.certificate["float32"]["calibration"]).h[-1] >= t.h[0])
