"""The committed fault estimation filters: the compiled C on hostile runs, on a recorded car, and as C++."""

from __future__ import annotations

import runpy
import subprocess
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.filters import hostile
from helpers.folders import CXX
from helpers.tools import need

from codegen.analysis.replay import replay
from codegen.designs import read_design
from codegen.errors import CertificateError
from codegen.host.build import build
from codegen.plant.load import gallery_folder, load
from codegen.plant.simulate import simulate
from codegen.report.filter_words import facts, tables
from codegen.selection import filter_designs

GENERATED = Path(__file__).resolve().parents[2] / "generated"
NAMES = ("farhat", "vehicle")
DATA = gallery_folder() / "data"


@lru_cache
def committed(name):
    folder = GENERATED / f"{name}_hinf-filter"
    return folder, replace(read_design(folder), plant=load(name)), build(folder)


@pytest.mark.parametrize("name", NAMES)
def test_no_hostile_run_exceeds_the_thresholds_of_the_compiled_c(name):
    _, d, driver = committed(name)
    rng, steps = np.random.default_rng(2), 150
    q = np.array([np.repeat(rng.integers(0, d.plant.n_modes, steps), rng.integers(1, 20))[:steps] for _ in range(24)])
    u, y = (np.array(a) for a in zip(*(hostile(d, row, seed) for seed, row in enumerate(q))))
    trace = driver.run_many(u, y, q)
    assert not trace.raw_bits.any() and trace.assured.all() and not trace.status.any()
    assert not trace.differs(d.observer.run_many(u, y, q))
    assert np.max(np.abs(trace.f_hat) / trace.f_bound) > 0.6
    lost = y.copy()
    lost[rng.random(y.shape[:2]) < 0.05] = np.nan
    trace = driver.run_many(u, lost, q)
    assert not trace.raw_bits.any() and trace.assured.all() and np.isnan(trace.f_hat).any()


def test_vehicle_is_what_its_script_makes():
    """Every speed is covered: see tests/synthesis/test_vehicle.py; here that the plant file has its numbers."""
    make = runpy.run_path(str(DATA / "make_vehicle.py"))
    assert make["plant_text"]() == load("vehicle").text
    assert make["record_text"]() == (DATA / "rav4_ranges.csv").read_text()


def test_level_and_threshold_of_the_vehicle():
    _, d, _ = committed("vehicle")
    for real in ("float32", "float64"):
        assert d.certificate[real]["level"] == pytest.approx(0.3707, abs=1e-4)
        assert np.all(d.observer.tables[real].h[-1] < 0.0081)  # of a fault of 0.01 rad
    assert 0.34 < d.certificate["float32"]["reached"] < 0.3708
    held = d.certificate["float32"]["set_of_both"]["reached"]
    assert np.all(d.observer.tables["float32"].h[-1] < 1.45 * np.array(held))


def test_certificate_of_the_vehicle_holds_every_matrix_to_account():
    """An unknown number a little larger in any matrix that depends on it is noticed, by level or threshold."""
    _, d, _ = committed("vehicle")
    t, cert = d.observer.tables["float32"], d.certificate["float32"]
    for name in ("A", "C", "B", "Bf"):
        modes = tuple(replace(m, theta_terms=m.theta_terms | {name: tuple(1.05 * a for a in m.theta_terms[name])})
                      for m in d.plant.modes)
        with pytest.raises(CertificateError):
            filter_designs.check(replace(d.plant, modes=modes), t, cert)


def record():
    r = np.genfromtxt(DATA / "rav4_ranges.csv", delimiter=",", names=True, dtype=None, encoding=None)
    names = [m.name for m in load("vehicle").modes]
    return r["steering"], np.stack([r["a_y"], r["yaw"]], axis=1), np.array([names.index(m) for m in r["mode"]])


def test_recorded_car_on_the_compiled_c(tmp_path):
    """No alarm in 59 s; an offset that is put in is estimated rightly, below what the declared bounds let prove."""
    _, d, driver = committed("vehicle")
    steering, y, q = record()
    trace = driver.run(u=steering[:, None], y=y, q=q)
    assert not trace.raw_bits.any() and trace.assured.all() and set(q) == {0, 1, 2}
    quiet = np.max(np.abs(trace.f_hat))
    assert 0.0008 < quiet < 0.0018 < d.observer.tables["float32"].h[-1].min() / 4
    size, command = 0.003, steering.copy()
    command[1500:2000] -= size  # the wheels turn that much beyond the command
    found = driver.run(u=np.clip(command, -0.005, 0.005)[:, None], y=y, q=q)
    assert found.f_hat[1600:2000].mean() == pytest.approx(size, rel=0.15)
    assert np.min(found.f_hat[1600:2000]) > quiet and not found.raw_bits.any()
    done = replay(d, driver, DATA / "rav4_ranges.csv", tmp_path)
    assert done.outcome.trace.assured.all()
    first = (tmp_path / "bounds.csv").read_text().splitlines()
    assert first[0] == "k,t,f_hat.offset,f_bound.offset,alarm,latched,assured,status" and len(first) == len(q) + 1
    assert (tmp_path / "replay.svg").stat().st_size > 10000


def test_offset_of_the_steering_is_found_in_simulation():
    _, d, driver = committed("vehicle")
    truth = simulate(d.plant, "offset of the steering", seed=0)
    trace = driver.run(u=truth.u, y=truth.y, q=truth.q)
    assert not trace.raw_bits[:200].any() and np.argmax(trace.alarm) < 240
    assert trace.f_hat[300:400].mean() == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("name", NAMES)
def test_header_and_words_say_how_the_threshold_was_found(name):
    folder, d, _ = committed(name)
    header = " ".join((folder / f"{name}.h").read_text().replace(" * ", " ").split())
    assert "no |f_hat| exceeds its f_bound at any sample" in header and "The estimate goes on while a fault" in header
    text = " ".join(f"{f}" for f in facts(d, "float32"))
    assert "guaranteed, not calibrated" in text and "a run was found that reaches" in text
    (rows,) = tables(d, "float32")
    assert len(rows.rows) == d.plant.n_modes


@pytest.mark.parametrize("name", NAMES)
def test_compiles_as_cpp(name, tmp_path):
    need("g++")
    folder, _, _ = committed(name)
    subprocess.run(["g++", *CXX, "-c", str(folder / f"{name}.c"), "-o", str(tmp_path / "o.o")], check=True)
