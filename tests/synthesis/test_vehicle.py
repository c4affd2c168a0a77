"""Steering-fault filter of a vehicle whose speed is known by its range: cover, levels, and a recorded car."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from flint import arb
from helpers.filters import bicycle, vehicle, vehicle_data
from helpers.tools import need
from scipy.linalg import expm

from codegen.algebra.cover import Cover, sampled_cover
from codegen.analysis.worst_sequence import worst_run
from codegen.certify.switched_gain import check_gain
from codegen.errors import CertificateError
from codegen.plant.record import DATA_FOLDER
from codegen.selection.filters import design_filter
from codegen.synthesis import fault_filter, hinf_filter

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks import vehicle as benchmark  # noqa: E402

DATA = vehicle_data()
SPEEDS = list(zip(DATA["filter"]["speeds"], DATA["filter"]["speeds"][1:]))


@lru_cache
def robust():
    problem = vehicle("both")
    return problem, design_filter(problem)


def exact(s):
    motion, outputs = bicycle(DATA["vehicle"])
    M = np.zeros((4, 4))
    M[:2] = sum(s**k * term for k, term in enumerate(motion))
    return np.vstack([expm(DATA["filter"]["sample_period"] * M)[:2], sum(s**k * t for k, t in enumerate(outputs))])


def outside(cover: Cover, low: float, high: float) -> int:
    """How many of 301 speeds are not covered: no number d in [-1, 1] explains all entries."""
    count = 0
    for v in np.linspace(low, high, 301):
        off = exact(1 / v) - cover.base
        room = cover.radius + 1e-12 * np.abs(cover.base)
        line = np.where(cover.slope == 0, 1, cover.slope)
        a, b = (off - room) / line, (off + room) / line
        fixed = np.all(np.abs(off[cover.slope == 0]) <= room[cover.slope == 0])
        moving = cover.slope != 0
        lo, hi = np.minimum(a, b)[moving].max(initial=-1), np.maximum(a, b)[moving].min(initial=1)
        count += not (fixed and lo <= hi)
    return count


@pytest.mark.parametrize("low, high", SPEEDS)
def test_every_speed_is_covered(low, high):
    motion, outputs = bicycle(DATA["vehicle"])
    cover = sampled_cover(motion, outputs, DATA["filter"]["sample_period"], arb(1) / high, arb(1) / low)
    assert outside(cover, low, high) == 0
    # A cover that says nothing would pass too: the rest is small beside the line.
    assert np.linalg.norm(cover.radius) < 0.02 * np.linalg.norm(cover.slope)
    assert outside(Cover(cover.base, cover.slope, 0 * cover.radius), low, high) > 250
    assert outside(Cover(cover.base, -cover.slope[::-1], cover.radius), low, high) > 250


@pytest.mark.parametrize("low, high, missed", [(8, 12, 13.6), (12, 19, 17.6), (19, 32, 22.8)])
def test_first_order_expansion_leaves_real_speeds_outside(low, high, missed):
    """1/v^2 by its tangent in v at the middle of the range, as in the slides: misses per cent at the edge."""
    middle = (low + high) / 2
    tangent = 1 / middle**2 - 2 / middle**3 * (high - middle)
    assert 100 * (1 - tangent * high**2) == pytest.approx(missed, abs=0.06)


@pytest.mark.parametrize("measured", ["steering_unknown", "both"])
def test_levels_of_the_three_measurement_sets(measured):
    problem, printed = vehicle(measured), DATA["levels"][measured]
    assert hinf_filter.design(problem.nominal).gamma == pytest.approx(printed["nominal"], abs=6e-5)
    found = robust()[1].gamma if measured == "both" else hinf_filter.design(problem).gamma
    # Another cover (of the whole range, not of sampled speeds) than the dossier's.
    assert found == pytest.approx(printed["robust"], rel=2e-3)


def test_one_output_from_plant_file_to_board(tmp_path):
    """All steps of ``benchmarks.vehicle`` on two ranges: certified, C equal to the reference, validated, on a board."""
    need("arm-none-eabi-gcc", "qemu-system-arm")
    row = benchmark.whole("a_y", 2, tmp_path / "vehicle", set_rows=8, threshold='"calibrated"', false_alarm=0.1,
                          confidence=0.9, campaign_steps=100)
    assert hinf_filter.design(vehicle("a_y").nominal).gamma == pytest.approx(DATA["levels"]["a_y"]["nominal"], abs=6e-5)
    # Between the levels of three ranges (dossier, other cover) and of an unknown steering.
    assert DATA["levels"]["a_y"]["robust"] < row.level < DATA["levels"]["steering_unknown"]["robust"]
    assert 0.9 * row.level < row.reached < row.level
    assert row.calibrated < 0.1 * row.guaranteed and row.delay is not None and row.flash > 500 and row.instructions > 50
    table = benchmark.write([replace(row, ranges=3)])
    assert "| a_y, steering known | 3 | 0.9359 |" in table


def rows():
    """Level, and what a run reaches, of each row of the committed table."""
    cells = [line.split(" | ") for line in benchmark.TABLE.read_text(encoding="utf-8").splitlines()
             if line.startswith("| a_y")]
    return {(c[0].removeprefix("| "), int(c[1])): (float(c[2]), float(c[3])) for c in cells}


@pytest.mark.parametrize("case", benchmark.CASES, ids=str)
def test_the_committed_level_is_proved_again(case):
    """From the constants of the C and their proof, exactly, for the plant as the script makes it; every row."""
    measured, ranges = case
    row = json.loads(benchmark.KEPT.read_text(encoding="ascii"))[f"{measured} {ranges}"]
    level, reached = rows()[benchmark.WORDS[measured], ranges]
    assert level == round(benchmark.proved(measured, ranges, row), 4) and reached < level
    assert len(rows()) == len(benchmark.CASES)


def test_other_constants_do_not_prove_it():
    row = json.loads(benchmark.KEPT.read_text(encoding="ascii"))["both 3"]
    wrong = row["constants"] | {"K": (1.02 * np.array(row["constants"]["K"])).tolist()}
    with pytest.raises(CertificateError, match="fails from mode"):
        benchmark.proved("both", 3, row | {"constants": wrong})
    with pytest.raises(CertificateError, match="fails from mode"):
        benchmark.proved("both", 3, row | {"energy": row["energy"] | {"level2": 0.998 * row["energy"]["level2"]}})


@pytest.mark.parametrize("measured, inputs, disturbances, outputs", [
    ("steering_unknown", 0, 4, 1), ("a_y", 1, 3, 1), ("both", 1, 3, 2)])
def test_plant_files_of_the_three_measurement_sets(measured, inputs, disturbances, outputs):
    p = benchmark.plant(measured, 4, set_rows=8)
    assert (p.n_u, p.n_w, p.n_y, p.n_modes) == (inputs, disturbances, outputs, 4)
    assert fault_filter.inapplicable(p) is None
    assert p.modes[0].name == "8 to 11.3137 mps" and p.modes[-1].name == "22.6274 to 32 mps"
    m, other = p.modes[1], benchmark.plant("both", 4, set_rows=8).modes[1]
    assert np.array_equal(m.A, other.A) and np.array_equal(m.C[0], other.C[0])
    steering = (m.Bw[:, -1], m.Dw[0, -1]) if measured == "steering_unknown" else (m.B[:, 0], m.D[0, 0])
    assert np.array_equal(steering[0], m.Bf[:, 0]) and steering[1] == m.Df[0, 0]


def test_finer_ranges_lower_the_level():
    speeds = 8 * 4 ** (np.arange(5) / 4)
    assert hinf_filter.design(vehicle("both", speeds)).gamma == pytest.approx(DATA["levels"]["ranges_4"], abs=6e-4)


def test_level_is_certified_and_a_run_comes_near():
    problem, filt = robust()
    run = worst_run(problem.modes, filt.gains, problem.switching, filt.gamma, steps=60, beam=4)
    assert 0.88 * filt.gamma <= run.gain <= filt.gamma  # dossier: 0.321
    proof = dict(filt.proof)
    for change in ("skew", "T"):
        row = [dict(b) for b in proof["multipliers"][0]]
        value = np.array(row[0][change])
        value[0, 1] += 1e-9
        row[0][change] = value.tolist()
        with pytest.raises(CertificateError, match="skew|symmetric"):
            check_gain(problem.modes, problem.names, problem.switching, filt.gains,
                       proof | {"multipliers": [row, *proof["multipliers"][1:]]})
    full = [dict(b) for b in proof["multipliers"][0]]
    full[1] = full[0]
    with pytest.raises(CertificateError, match="full block"):
        check_gain(problem.modes, problem.names, problem.switching, filt.gains,
                   proof | {"multipliers": [full, *proof["multipliers"][1:]]})


@lru_cache
def recorded():
    record = np.genfromtxt(DATA_FOLDER / "rav4.csv", delimiter=",", names=True)
    train = slice(0, 2000)  # the first 40 s: offsets of the two sensors
    yaw = record["yaw_rate"] + np.deg2rad(0.44)
    lateral = record["a_y"] - np.mean((record["a_y"] - record["speed"] * yaw)[train])
    return record["speed"], record["steering"], yaw, lateral


@lru_cache
def car():
    return design_filter(vehicle("both", data=DATA["rav4"]))


def estimate(offset):
    """Estimate in rad over the record; ``offset`` is what the wheels turn beyond the command."""
    speed, steering, yaw, lateral = recorded()
    f, filt = DATA["rav4"]["filter"], car()
    s, out = np.zeros(len(filt.gains[0][0])), np.empty(len(speed))
    for k in range(len(speed)):
        A, B, C, D = filt.gains[int(np.searchsorted(f["speeds"][1:-1], speed[k]))]
        y = np.array([lateral[k], yaw[k] / f["x_size"][1], (steering[k] - offset[k]) / f["steering"]])
        out[k] = (C @ s + D @ y)[0] * f["fault"]
        s = A @ s + B @ y
    return out


def test_recorded_car_without_and_with_a_steering_fault():
    quiet = estimate(np.zeros(2950))
    largest = np.max(np.abs(quiet))
    assert 0.0008 < largest < 0.0018  # rad at the road wheel, 0.08 degrees
    for size in (0.005, -0.01):
        offset = np.zeros(2950)
        offset[1500:2000] = size
        found = estimate(offset)
        assert found[1600:2000].mean() == pytest.approx(size, rel=0.15)
        assert np.all(np.abs(found[1600:2000]) > 2 * largest)  # a threshold from the whole quiet record sees it all
        assert np.array_equal(found[:1500], quiet[:1500])
        late = int(np.argmax(np.abs(found[1500:]) > 1.2 * largest))
        assert late <= 40  # 0.8 s, with the 1 Hz target
