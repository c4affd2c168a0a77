"""Calibrated thresholds: what order statistics promise, checked where the distribution is known."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import ceil, log
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from codegen.analysis.calibration import Population, campaign, fault_free_runs, losses, pattern
from codegen.analysis.order_statistics import Calibration, calibrate, confidence, largest_values, runs_needed
from codegen.errors import PlantError
from codegen.plant.load import load


@pytest.mark.parametrize("p, wanted", [(0.05, 0.95), (0.01, 0.99)])
def test_the_largest_of_runs_follows_the_closed_form(p, wanted):
    runs = runs_needed(p, wanted)
    assert runs == ceil(log(1 - wanted) / log(1 - p))
    exact = 1 - (1 - Fraction(p)) ** runs
    assert 0 <= exact - Fraction(confidence(runs, p)) < Fraction(1, 10**15)
    assert confidence(runs, p) >= wanted > confidence(runs - 1, p)


def test_lower_ranks_and_more_statistics_follow_the_binomial():
    for runs, p, blocks in ((700, 0.01, 4), (93, 0.05, 2), (2000, 0.003, 7)):
        assert confidence(runs, p, blocks) == pytest.approx(1 - binom.cdf(blocks - 1, runs, p), abs=1e-12)
    assert runs_needed(0.05, 0.95) == 59 and runs_needed(0.05, 0.95, 2) == 93  # Wilks' tables
    assert confidence(3, 0.5, 4) == 0.0


def exceeding(rng, runs: int, rank: int):
    """Campaigns with three statistics of which a run has one: what share of them is exceeded by more than 10 %."""
    count = 6000
    which, size = rng.integers(3, size=(count, runs)), rng.random((count, runs))
    values = np.where(which[..., None] == np.arange(3), size[..., None], 0.0)
    h = np.array([largest_values(v, rank) for v in values])
    return np.mean(np.mean(1 - h, axis=1) > 0.1)  # P(exceeded) is known: a third of 1 - h_j each


@pytest.mark.parametrize("runs, rank", [(40, 1), (90, 2)])
def test_chance_of_a_wrong_threshold_is_what_is_said(runs, rank):
    """Tight where a run shows in one statistic alone: who counts the rank once, not per statistic, says too much."""
    wrong = exceeding(np.random.default_rng(0), runs, rank)
    noise = 4 * 0.5 / np.sqrt(6000)
    assert wrong <= 1 - confidence(runs, 0.1, 3 * rank) + noise
    assert wrong > 1 - confidence(runs, 0.1, rank) + noise


def test_ties_and_what_is_refused():
    values = np.repeat([[1.0], [2.0], [2.0], [3.0]], 1, axis=1)
    assert largest_values(values, 2)[0] == 2 and largest_values(values, 4)[0] == 1
    found = calibrate(values, 0.5)
    assert isinstance(found, Calibration) and found.thresholds[0] == 3 and found.confidence <= 1 - 0.5**4
    for bad in (lambda: largest_values(values, 5), lambda: largest_values(np.array([np.nan]), 1),
                lambda: confidence(10, 0.0), lambda: confidence(10, 1.5), lambda: runs_needed(0.1, 1.0)):
        with pytest.raises(ValueError, match="found"):
            bad()


def test_runs_keep_to_the_plant_file():
    plant = load("farhat")
    runs = fault_free_runs(plant, Population(steps=60, theta="corner"), 6, seed=3)
    assert len(runs) == 6 and all(len(r.q) == 60 and not r.f.any() for r in runs)
    assert len({r.y.tobytes() for r in runs}) == 6 and {q for r in runs for q in r.q} == {0, 1}
    assert all(np.all(np.abs(r.theta) == 1) for r in runs)
    again = fault_free_runs(plant, Population(steps=60, theta="corner"), 6, seed=3)
    assert all(np.array_equal(a.y, b.y) for a, b in zip(runs, again))
    assert not np.array_equal(runs[0].y, fault_free_runs(plant, Population(steps=60), 1, seed=4)[0].y)


def test_conditions_say_how_often_a_continuous_plant_is_disturbed():
    """As often as its runs are: on each of their pieces, noise at the samples alone."""
    wishes = {name: [s for s in Population().words(load(name)) if "drawn anew" in s]
              for name in ("kiln", "dlpv", "farhat")}
    assert [s.rpartition("anew ")[2] for s in wishes["kiln"]] == ["8 times a sample", "at every sample"]
    assert [s.rpartition("anew ")[2] for s in wishes["dlpv"]] == ["2 times a sample", "at every sample"]
    assert {s.rpartition("anew ")[2] for s in wishes["farhat"]} == {"at every sample"}


def test_mode_sequences_keep_to_the_switching():
    slow, turn = load("zammali_dwell"), load("zammali_schedule")
    least = slow.switching.average_dwell / slow.sample_period
    rng = np.random.default_rng(1)
    for _ in range(20):
        starts, modes = zip(*pattern(slow, 300, rng))
        assert np.all(np.diff(starts) >= least - 1e-9) and all(a != b for a, b in zip(modes, modes[1:]))
    steps = np.array([turn.switching.schedule[k % len(turn.switching.schedule)] for k in range(30)])
    starts, modes = zip(*pattern(turn, 30, rng))
    assert np.array_equal(np.array(modes)[np.searchsorted(starts, np.arange(30), side="right") - 1], steps)


def test_losses_are_paid_for_and_use_what_they_may():
    """A count of its own; bursts of every length, alone and in one another's wake; no longer run, no larger share."""
    population = Population(4000, gap=20, bridge=3)
    lost, seen = losses(population, 20, seed=3), set()
    for row in lost:
        credit, burst = 0, 0
        for gone in row:
            assert not gone or credit >= 20
            seen |= {burst} - {0} if not gone else set()
            credit, burst = (credit - 20, burst + 1) if gone else (min(credit + 1, 60), 0)
    assert seen == {1, 2, 3} and 0.03 < lost.mean() < 1 / 21
    assert np.array_equal(lost, losses(population, 20, seed=3)) and not np.array_equal(lost, losses(population, 20, 4))
    assert not losses(Population(300), 5).any()
    assert population.words(load("farhat"))[-1].startswith("1 to 3 measurements in succession missing")


def test_campaign_over_a_reference():
    """An observer whose answer is y itself: the threshold is the k-th largest |y| of just those runs."""
    plant, population = load("farhat"), Population(steps=30)
    echo = SimpleNamespace(run_many=lambda u, y, q, real, theta: SimpleNamespace(y=y))
    design = SimpleNamespace(plant=plant, observer=echo)

    def by_mode(trace, q):
        size = np.abs(trace.y[..., 0])
        return np.stack([np.max(np.where(q == i, size, 0.0), axis=1) for i in (0, 1)], axis=1)

    found = campaign(design, by_mode, 0.2, 0.9, population, rank=2, seed=5)
    assert found.runs == runs_needed(0.2, 0.9, 4) and found.confidence >= 0.9 and found.rank == 2
    runs = fault_free_runs(plant, population, found.runs, seed=5)
    largest = [sorted(np.max(np.where(r.q == i, np.abs(r.y[:, 0]), 0.0)) for r in runs)[-2] for i in (0, 1)]
    assert found.thresholds == pytest.approx(largest, rel=1e-12)
    assert found.conditions[0] == "30 samples from the initial box" and "no measurement missing" in found.conditions
    bare = replace(load("cart"), scenarios=())
    with pytest.raises(PlantError, match="says what the inputs do"):
        fault_free_runs(bare, population, 1)
