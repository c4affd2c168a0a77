"""Gains of polytopic observers by frequency: against time series, against what is proved, and in the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.banks import DATA

from codegen.analysis.frequency import responses
from codegen.designs import read_design
from codegen.plant.load import load
from codegen.plant.model import Signal
from codegen.report import plant_words
from codegen.report.frequency_words import words_of

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def bank():
    return read_design(DATA)


@pytest.fixture(scope="module")
def disc():
    return read_design(ROOT / "generated" / "disc_descriptor-uncertain")


def each(design, change=lambda m: m):
    plant, t = design.plant, design.observer.tables["float64"]
    for i, m in enumerate(t.members):
        yield design.certificate["float64"]["members"][i], responses(
            plant, change(m), m.seen, np.delete(np.arange(plant.n_f), i))


def test_what_is_proved_for_all_weights_holds_at_each_vertex(bank):
    """The level holds at all frequencies, the sensitivity where a fault lasts; a spoilt gain breaks one of them."""
    for proved, r in each(bank):
        assert 0.01 < r.unknown.max() <= proved["gamma"]  # most of the level is for weights that differ
        assert np.all(r.fault[:, 0] >= proved["beta"] * 0.999)  # that of a fault that stands still
    broken = [r.unknown.max() > proved["gamma"] or np.any(r.fault[:, 0] < proved["beta"] * 0.99)
              for proved, r in each(bank, lambda m: replace(m, K=-m.K))]
    assert any(broken)


def test_fast_faults_are_seen_less_than_the_published_level_says(bank):
    """Of a design for lasting faults: more of them than rows of I - C T2, so that some fast ones are hardly seen."""
    assert all(r.fault[:, -1].min() < 0.5 * r.fault[:, 0].min() for _, r in each(bank))


def test_gains_are_those_of_a_time_series(disc):
    """A sinusoid on one sensor at one vertex, after a long time, sample by sample."""
    plant, t = disc.plant, disc.observer.tables["float64"]
    r, p, T, k = responses(plant, t, faults=np.array([1])), disc.plant.polytope, disc.plant.sample_period, 90
    size = np.max(np.abs(plant.limits("f")), axis=0)
    angle, n = 2 * np.pi * r.frequency[k] * T, np.arange(4000)
    for j in range(len(p.vertices)):
        wave, z, out = size[1] * np.exp(1j * angle * n), np.zeros(plant.n_x, dtype=complex), 0
        for f in wave:  # the plant rests: a fault of a sensor does not move it
            y = p.Df[:, 1] * f
            x_hat = z + t.T2 @ y
            out, z = t.M @ (y - t.C @ x_hat), t.F[j] @ x_hat - t.K[j] @ (y - t.C @ x_hat)
        assert np.linalg.norm(out) == pytest.approx(r.fault[j, k], rel=1e-6)


def test_the_report_says_it_for_polytopic_observers_with_faults(bank, disc):
    (one,), (several,) = words_of(disc, "float32"), words_of(bank, "float32")
    assert "<svg" in one.plots[0].svg and one.text.count("lasting faults") == 1
    assert several.text.count("lasting faults") == 3 and "zero" not in several.text
    assert words_of(read_design(ROOT / "generated" / "cart_tnl-interval"), "float32") == ()
    t = disc.observer.tables["float32"]
    estimator = type(disc.observer)({"float32": replace(t, faults=1)}, disc.observer.supervision)
    estimating = replace(disc, observer=estimator)
    assert words_of(estimating, "float32") == ()  # whose residual is what the faults do


def test_the_plant_of_a_polytopic_observer_is_described_by_its_vertices(bank, disc):
    """Nothing is said of modes; terms of the weights, known terms, disturbances and parameters have their bounds."""
    for plant in (bank.plant, disc.plant, load("digester"), load("quadrotor")):
        facts, tables = plant_words.facts(plant), plant_words.tables(plant)
        text = " ".join(f"{f.term} {f.text}" for f in facts)
        rows = {t.caption: [[c.text for c in r.cells] for r in t.rows] for t in tables}
        assert "mode" not in text and "witch" not in text and f"{len(plant.polytope.vertices)}, from" in text
        unknown = [row[1] for row in rows.get("What may act at any time, within these bounds", [])]
        assert unknown == [s.name for s in (*plant.w, *plant.v)]
        terms = [row[0] for row in rows.get("Terms that the weights are made of", [])]
        assert terms == [z.name for z in plant.polytope.premises]
    assert rows["Terms that the weights are made of"] == [["turn", "yaw_rate", "[\u22121,\u00a01]"]]
    assert "Algebraic equations 2: E has rank 2 of 4" in " ".join(
        f"{f.term} {f.text}" for f in plant_words.facts(disc.plant))
    known = plant_words.tables(load("digester"))[-1]
    assert [[c.text for c in row.cells][0] for row in known.rows] == ["2", "4"]
    measured = replace(disc.plant, theta=(Signal("load", "", 0.5, 1.5, measured=True),))
    assert [c.text for c in plant_words.tables(measured)[1].rows[0].cells][:3] == [
        "load", "[0.5,\u00a01.5]", "every vertex"]
