"""Fault injection: what is guaranteed holds in random runs, and a claim that is too good is caught by them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from codegen import campaign
from codegen.cli import main
from codegen.designs import read_design
from codegen.errors import PlantError, ValidationError
from codegen.host.build import build
from codegen.pipeline import require
from codegen.plant.load import load

GENERATED = Path(__file__).resolve().parents[2] / "generated"


def outcomes(rows) -> list:
    return [o for row in rows for o in row.outcomes]


@pytest.mark.parametrize("name, detected", [("zammali_fd_interval", True), ("farhat_hinf-filter", True),
                                            ("vessel_hinf-filter", False)])
def test_guarantees_hold_in_random_runs(name, detected):
    made = read_design(GENERATED / name)
    driver = build(GENERATED / name)
    none, *rows = campaign.campaign(made, driver, runs=6)
    assert none.channel == "" and none.runs == 6 and none.alarmed == none.promised == 0 and not none.delays
    assert {r.channel for r in rows} == {f.name for f in made.plant.f} and len(outcomes([none])) == 6
    require(made, driver.real, outcomes([none, *rows]))
    sure = [r for r in rows if r.promised]
    assert bool(sure) == detected
    for r in sure:
        by_delay = next(d["by_delay"] for d in made.detection[driver.real] if d["channel"] == r.channel)
        assert len(r.delays) >= r.promised and any(size is not None and size <= r.size for size in by_delay)
    # Faults of either sign, which begin in the second half and stay.
    values = [float(o.scenario.fault[0].value) for o in outcomes(rows)]
    assert min(values) < 0 < max(values)
    assert all(len(o.truth.q) / 2 <= o.scenario.fault[0].start < len(o.truth.q) for o in outcomes(rows))


def test_a_claim_that_is_too_good_is_caught():
    """Found within the sample from a fifth of the size on: nothing proves it, and some run says so."""
    made = read_design(GENERATED / "farhat_hinf-filter")
    real = made.plant.target.real
    rows = [d | {"by_delay": [s and s / 5 for s in d["by_delay"]]} for d in made.detection[real]]
    boast = replace(made, detection=made.detection | {real: rows})
    got = campaign.campaign(boast, build(GENERATED / "farhat_hinf-filter"), runs=6)
    assert any(r.promised and r.delays[-1] > 0 for r in got)
    with pytest.raises(ValidationError, match="found after"):
        require(boast, real, outcomes(got))


def test_sizes_are_those_that_a_fault_may_have():
    """Of the least that is surely found; of the range where that is beyond it; of the sign that the range has."""
    made = read_design(GENERATED / "farhat_hinf-filter")
    (signal,), (row,) = made.plant.f, made.detection["float32"]
    sure = min(size for size in row["by_delay"] if size)
    assert campaign.sizes(made, "float32", signal.name)[:4] == [share * sure for share in campaign.SHARES[:4]]
    for lo, hi, want in ((-sure / 10, sure / 10, campaign.OF_RANGE), (-1e-9, 0.0, campaign.OF_RANGE), (1.0, 1.5, ())):
        other = replace(made, plant=replace(made.plant, f=(replace(signal, lo=lo, hi=hi),)))
        most, found = max(abs(lo), abs(hi)), campaign.sizes(other, "float32", signal.name)
        assert all(campaign.signs(other.plant.f[0], size) for size in found)
        assert lo == 1.0 or found == [share * most for share in want]
    assert campaign.signs(replace(signal, lo=-2.0, hi=1.0), 1.5) == [-1]


def test_runs_that_leave_the_declared_ranges_are_left_out():
    plant = load("buck")
    free, held = (campaign.inside(plant, 12, 0, modes) for modes in ("random", "scenario"))
    assert len(free) < 6 and len(held) == 12
    narrow = replace(plant, x=tuple(replace(s, lo=s.lo / 100, hi=s.hi / 100) for s in plant.x))
    with pytest.raises(PlantError, match="leaves its declared range in each of 4 random runs"):
        campaign.campaign(replace(read_design(GENERATED / "buck_tnl-interval-lpv"), plant=narrow), None, runs=4)


def test_the_command_shows_the_table_and_refuses_what_is_no_folder():
    done = CliRunner().invoke(main, ["campaign", str(GENERATED / "farhat_hinf-filter"), "-n", "2", "--seed", "3"])
    assert done.exit_code == 0 and "fault injection on the compiled C" in done.output
    assert done.output.count("100.0 %") >= 3 and np.all([w in done.output for w in ("false alarms", "guaranteed")])
    assert CliRunner().invoke(main, ["campaign", "nowhere"]).exit_code != 0
    assert CliRunner().invoke(main, ["campaign", "nowhere", "-n", "0"]).exit_code == 2
