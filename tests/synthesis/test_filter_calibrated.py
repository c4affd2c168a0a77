"""Fault estimation filter with calibrated thresholds: what is said of them, and that nothing more is."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers.filters import hostile
from helpers.folders import GCC

import codegen
from codegen.analysis.calibration import Population, fault_free_runs
from codegen.analysis.validate import side_by_side, validate
from codegen.designs import recheck
from codegen.errors import CertificateError, DesignError
from codegen.plant.load import load, loads
from codegen.report.filter_words import facts, tables
from codegen.report.verdict import verdict
from codegen.selection import filter_calibration, filter_designs

FARHAT = load("farhat").text
ASKED = {"threshold": '"calibrated"', "false_alarm": 0.1, "confidence": 0.9, "campaign_steps": 60, "set_rows": 6}


def text(**options) -> str:
    lines = "\n".join(f"{k} = {v}" for k, v in (ASKED | options).items())
    return FARHAT.replace('method = "hinf-filter"\n', f'method = "hinf-filter"\n{lines}\n')


@pytest.fixture(scope="module")
def made():
    return codegen.design(loads(text()))


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    return codegen.generate(made, tmp_path_factory.mktemp("calibrated") / "farhat")


def test_assurance_calls_no_calibrated_threshold_proved(folder):
    stated = json.loads((folder / "assurance.json").read_text())
    (claim,) = [c for c in stated["claims"] if c["id"] == "calibrated"]
    assert "independent" not in claim["checks"] and not any(c["id"] == "no-alarm" for c in stated["claims"])
    (checker,) = [c for c in stated["checks"] if c["id"] == "independent"]
    assert checker["state"] == "passed" and "calibrated and not proved" in checker["figures"]["says"][0]


def test_last_row_alone_is_lower_and_what_is_said_is_exact(made):
    for real, t in made.observer.tables.items():
        c, whole = made.certificate[real]["calibration"], filter_calibration.guaranteed(t, made.certificate[real])
        assert np.all(t.h[-1] < whole.h[-1]) and np.array_equal(t.h[:-1], whole.h[:-1])
        assert c["runs"] == 38 and 1 - 0.9**c["runs"] - 0.1 * c["runs"] * 0.9**(c["runs"] - 1) >= c["confidence"] >= 0.9
        assert "not proved but calibrated" in made.proved[real][1] and "no false alarm" not in str(made.proved[real])
    assert recheck(made) == made.proved


def alarms(made, population: Population, runs: int) -> float:
    """Share of further runs with an alarm."""
    u, y, q, theta = side_by_side(fault_free_runs(made.plant, population, runs, seed=99))
    trace = made.observer.run_many(u, y, q, theta=theta)
    assert not trace.assured.any()
    return float(np.mean(trace.raw_bits.any(axis=1)))


def test_further_runs_alarm_as_rarely_as_said_and_runs_of_another_kind_do_not(made):
    assert 0 < alarms(made, Population(steps=60), 250) <= 0.1
    assert alarms(made, Population(steps=60, w="corner", theta="corner"), 40) > 0.5


def test_faults_are_surely_detected_from_less(made):
    """A step may meet an estimate as large as the guaranteed bound, but has only the calibrated one to exceed."""
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    whole = filter_calibration.guaranteed(t, cert)
    sure = codegen.analysis.detectability.surely_detected
    less, more = (sure(made.plant, table, c)[0].best for table, c in ((t, cert), (whole, {"kind": "filter"})))
    wrong = sure(made.plant, t, {"kind": "filter"})[0].best
    assert wrong < 0.99 * less < 0.99 * more and made.detection["float32"][0]["by_delay"][0] < 1
    q, size = np.random.default_rng(1).integers(0, 2, 70), made.detection["float32"][0]["by_delay"][0]
    _, y = hostile(made, q, 4)
    y[60] -= np.sign(y[60]) * 1.02 * size * made.plant.modes[q[60]].Df[0]
    assert made.observer.run(np.zeros((70, 0)), y, q).raw_bits[60] == 1


def spoilt(made, name: str):
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    c = cert["calibration"]

    def with_c(**changed):
        return t, cert | {"calibration": c | changed}

    return {
        "threshold": (replace(t, h=np.concatenate([t.h[:-1], 0.98 * t.h[-1:]])), cert),
        "confidence": with_c(confidence=0.95),
        "probability": with_c(probability=0.09),
        "seed": with_c(seed=1),
        "conditions": with_c(conditions=["always"]),
        "guaranteed": with_c(guaranteed=(0.97 * np.array(c["guaranteed"])).tolist()),
        "start": (replace(t, h=np.concatenate([0.9 * t.h[:1], t.h[1:]])), cert),
    }[name]


@pytest.mark.parametrize("name, words", [
    ("threshold", "runs of the campaign exceed"), ("confidence", "give a confidence"),
    ("probability", "give a confidence"), ("seed", "runs of the campaign exceed"), ("conditions", "conditions"),
    ("guaranteed", "in the end"), ("start", "0 samples after anywhere")])
def test_certificate_refuses(made, name, words):
    with pytest.raises(CertificateError, match=words):
        filter_designs.check(made.plant, *spoilt(made, name))


def test_c_and_papers_say_that_nothing_is_assured(made, folder):
    header = " ".join((folder / "farhat.h").read_text().replace(" * ", " ").split())
    assert "THE THRESHOLDS ARE CALIBRATED" in header and "assured is always 0" in header
    assert "assured is never set" in header and "cannot happen without a fault" not in header
    assert "stay guaranteed" not in header and "with 90.47 % confidence (exact binomial, rank 1)" in header
    said = str(facts(made, "float32"))
    assert "calibrated, not guaranteed: from 38 simulated runs" in said
    (rows,) = tables(made, "float32")
    assert len(rows.head) == 5 and "calibrated" in rows.head[2].text
    driver = codegen.build(folder)
    outcomes = validate(made, driver)
    assert all(o.passed and not o.trace.assured.any() for o in outcomes)
    assert sum(o.chance for o in outcomes) > 0  # the scenarios have disturbances at their ends
    found = verdict(made, "float32", {}, outcomes)
    assert found.kind == "ok" and "as calibrated thresholds allow" in found.result
    subprocess.run(["gcc", *GCC, "-c", str(folder / "farhat.c"), "-o", str(folder / "o.o")], check=True)


@pytest.mark.parametrize("given, words", [
    ({"false_alarm": 0}, "observer.false_alarm is 0"), ({"confidence": 1}, "observer.confidence is 1"),
    ({"threshold": '"hoped"'}, '"guaranteed" or "calibrated"')])
def test_options_say_what_is_wrong(given, words):
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(text(**given)))


def test_runs_that_are_too_short_are_refused(made):
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    with pytest.raises(DesignError, match="no run of 12 samples settles in mode"):
        filter_calibration.calibrated(made.plant, replace(filter_calibration.guaranteed(t, cert), start=0), cert,
                                      made.options | {"campaign_steps": 12})
