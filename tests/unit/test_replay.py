"""Replay reads what a log says, writes what the driver answers, and tells what is wrong with a log."""

import csv
import sys
import types
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.reports import StandInDriver, small_design  # noqa: E402

from codegen.analysis.logs import read_log, resample  # noqa: E402
from codegen.analysis.replay import replay  # noqa: E402
from codegen.errors import EmitError, PlantError, ToolError  # noqa: E402
from codegen.plant.record import DATA_FOLDER  # noqa: E402
from codegen.plant.simulate import simulate  # noqa: E402


@pytest.fixture(scope="module")
def cart():
    return small_design("cart")


@pytest.fixture(scope="module")
def truth(cart):
    """A run with an encoder fault of 0.1 m in samples 200 to 259."""
    return simulate(cart.plant, "encoder fault", seed=3)


def write_log(path, truth, label=True, mode=("free", "braked"), gaps=()):
    header = ["force", "position", "mode"] + ["encoder"] * label
    rows = [[repr(float(u)), repr(float(y)), mode[q], repr(float(f))][:len(header)]
            for u, y, q, f in zip(truth.u[:, 0], truth.y[:, 0], truth.q, truth.f[:, 0])]
    for k, cell in gaps:
        rows[k][1] = cell
    path.write_text("# a comment\n" + "\n".join(",".join(r) for r in [header, *rows]) + "\n")
    return path


def run(design, log, out, **kwargs):
    return replay(design, StandInDriver(design), log, out, **kwargs)


def read_bounds(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_bounds_are_those_of_the_driver(cart, truth, tmp_path):
    result = run(cart, write_log(tmp_path / "log.csv", truth, gaps=[(7, ""), (8, "nan")]), tmp_path / "out")
    assert (result.bounds, result.plot) == (tmp_path / "out" / "bounds.csv", tmp_path / "out" / "replay.svg")
    y = truth.y.copy()
    y[7:9] = np.nan
    trace = StandInDriver(cart).run(u=truth.u, y=y, q=truth.q)
    rows = read_bounds(result.bounds)
    assert list(rows[0]) == ["k", "t", "x_lo.position", "x_lo.speed", "x_hi.position", "x_hi.speed", "r_lo.position",
                             "r_hi.position", "alarm", "latched", "assured", "status"]
    assert len(rows) == len(truth.q) and rows[150]["k"] == "150" and rows[150]["t"] == "1.5"
    for column, expected in (("x_lo.speed", trace.x_lo[:, 1]), ("x_hi.position", trace.x_hi[:, 0]),
                             ("r_lo.position", trace.r_lo[:, 0]), ("r_hi.position", trace.r_hi[:, 0])):
        found = np.array([np.float32(r[column] or "nan") for r in rows])
        assert np.array_equal(found, expected, equal_nan=True)
    assert rows[7]["r_lo.position"] == rows[8]["r_hi.position"] == "" and rows[7]["x_lo.speed"] != ""
    for column, expected in (("alarm", trace.alarm), ("latched", trace.latched_bits), ("assured", trace.assured),
                             ("status", trace.status)):
        assert [int(r[column]) for r in rows] == expected.astype(int).tolist()
    assert trace.alarm.any() and not trace.assured.all()


def test_what_is_found_is_told(cart, truth, tmp_path):
    said = []
    result = run(cart, write_log(tmp_path / "log.csv", truth, gaps=[(7, "")]), tmp_path / "out", progress=said.append)
    table = dict(result.rows())
    assert table["samples"] == "400" and table["missing samples"] == "1" and table["refused samples"] == "0"
    assert table["false alarms"].startswith("0 samples") and table["faults found"] == "1 of 1"
    assert table["encoder, samples 200 to 259"] == "size 0.1: found after 0 samples (0 ms)"
    assert "first at sample 200 (2 s)" in table["alarms"]
    assert all(isinstance(cell, str) for row in result.rows() for cell in row)
    assert said[0] == "reading log.csv" and len(said) == 3


def test_without_labels_no_alarm_is_called_false(cart, truth, tmp_path):
    result = run(cart, write_log(tmp_path / "log.csv", truth, label=False), tmp_path / "out")
    table = dict(result.rows())
    assert not result.labelled and table["false alarms"].startswith("not known") and "faults found" not in table
    assert result.alarms[0][0] == 200


def test_modes_may_be_indices(cart, truth, tmp_path):
    names = run(cart, write_log(tmp_path / "names.csv", truth), tmp_path / "a")
    indices = run(cart, write_log(tmp_path / "indices.csv", truth, mode=("0", "1")), tmp_path / "b")
    assert names.bounds.read_bytes() == indices.bounds.read_bytes()


def test_the_plot_is_xml_and_always_the_same(cart, truth, tmp_path):
    log = write_log(tmp_path / "log.csv", truth)
    first, second = (run(cart, log, tmp_path / name).plot.read_bytes() for name in "ab")
    assert first == second and len(first) < 150_000
    assert ET.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"


def test_a_real_record_with_labels(tmp_path):
    design = small_design("emps")
    result = run(design, DATA_FOLDER / "emps_pulses.csv", tmp_path / "out")
    assert dict(result.rows())["faults found"] == "25 of 25" and result.outcome.false_alarms == 0
    assert max(e.delay for e in result.outcome.episodes) == 2


def test_a_log_may_begin_anywhere(cart, truth, tmp_path):
    late = replace(truth, **{name: getattr(truth, name)[60:190] for name in ("x", "u", "y", "q", "f")})
    log = write_log(tmp_path / "late.csv", late)
    assert run(cart, log, tmp_path / "box").alarms  # the initial box is not where the cart is
    result = run(cart, log, tmp_path / "range", from_range=True)
    assert not result.alarms
    trace = result.outcome.trace
    assert np.all((trace.x_lo <= late.x) & (late.x <= trace.x_hi))


@pytest.mark.parametrize("text, parts", [
    ("force,mode\n1,free\n", ['no column "position"', "found: force, mode", "expected: force, position, mode"]),
    ("force,position\n1,0\n", ['no column "mode"', "found: force, position", "free, braked"]),
    ("force,position,mode\n1,0,free\n1,high,free\n", ["line 3", '"position" holds "high"', "finite number"]),
    ("force,position,mode\n,0,free\n", ["line 2", '"force" holds ""']),
    ("force,position,mode\n1,inf,free\n", ["line 2", '"position" holds "inf"']),
    ("force,position,mode\n1,0,flying\n", ["line 2", 'mode "flying"', "free, braked"]),
    ("force,position,mode\n1,0,2\n", ["line 2", '"2"', "free, braked"]),
    ("force,position,mode,encoder\n1,0,free,broken\n", ["line 2", '"encoder" holds "broken"']),
    ("force,position,mode\n1,0\n", ["line 2", "2 cells"]),
    ("force,force,position,mode\n1,1,0,free\n", ['"force" comes twice']),
    ("force,position,mode\n", ["no rows"]),
    ("t,force,position,mode\n0,1,0,free\n10,1,0,free\n", ['"t" advances by 10', "0.01 s"]),
])
def test_what_is_wrong_with_a_log_is_told(cart, tmp_path, text, parts):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(PlantError) as error:
        run(cart, tmp_path / "log.csv", tmp_path / "out")
    message = str(error.value)
    assert message.startswith("log.csv: ") and all(part in message for part in parts)
    assert message.endswith(".") and "\n" not in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("clock", ["0\n0.01", "12.5\n12.51", "2026-01-01\n2026-01-02"])
def test_a_clock_that_fits_or_is_none_is_no_matter(cart, tmp_path, clock):
    first, second = clock.split("\n")
    (tmp_path / "log.csv").write_text(f"time,force,position,mode\n{first},1,0,free\n{second},1,0,free\n")
    assert run(cart, tmp_path / "log.csv", tmp_path / "out").bounds.is_file()


def test_samples_that_the_firmware_refuses_are_counted(cart, tmp_path):
    (tmp_path / "log.csv").write_text("force,position,mode\n100,0,free\n1,0,free\n1,99,free\n")
    table = dict(run(cart, tmp_path / "log.csv", tmp_path / "out").rows())
    assert table["refused samples"] == "2 (1 input out of range, 1 output out of range)"


def test_a_missing_log_does_not_turn_into_one_of_the_gallery(cart, tmp_path):
    with pytest.raises(PlantError, match="no such file"):
        run(cart, tmp_path / "emps_train.csv", tmp_path / "out")


def test_results_that_cannot_be_written(cart, truth, tmp_path):
    log = write_log(tmp_path / "log.csv", truth)
    (tmp_path / "file").write_text("")
    with pytest.raises(EmitError, match="Choose a folder"):
        run(cart, log, tmp_path / "file")
    (tmp_path / "out" / "replay.svg").mkdir(parents=True)
    with pytest.raises(EmitError, match="Choose a folder"):
        run(cart, log, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*.part"))


def test_mdf_without_asammdf_says_what_to_install(cart, tmp_path, monkeypatch):
    (tmp_path / "log.mf4").write_bytes(b"MDF")
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(ToolError, match=r"pip install residua\[mdf\]"):
        run(cart, tmp_path / "log.mf4", tmp_path / "out")


class FakeMDF:
    """What is used of asammdf: channels with their own clocks, one of them twice."""

    channels = {}

    def __init__(self, path):
        self.channels_db = {name: ((i, 1), (99, 1)) for i, name in enumerate(self.channels)}

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None

    def get(self, name, group, index):
        assert (group, index) == self.channels_db[name][0]
        times, samples = self.channels[name]
        return types.SimpleNamespace(timestamps=np.array(times), samples=np.array(samples))


@pytest.fixture
def mdf(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "asammdf", types.SimpleNamespace(MDF=FakeMDF))
    (tmp_path / "log.mf4").write_bytes(b"MDF")
    return tmp_path / "log.mf4"


def test_mdf_channels_come_onto_the_sample_period(cart, mdf, monkeypatch):
    monkeypatch.setattr(FakeMDF, "channels", {
        "force": ([0.0, 0.02, 0.06], [1.5, 2.5, 3.5]), "mode": ([0.0, 0.031, 0.06], [b"free\0", b"braked", b"free"]),
        "position": ([0.0, 0.011, 0.019, 0.05, 0.06], [0.1, 0.2, 0.3, 0.5, 0.6]), "spare": ([0.0], [9.0])})
    truth, labelled = read_log(cart.plant, mdf)
    assert not labelled and truth.u[:, 0].tolist() == [1.5, 1.5, 2.5, 2.5, 2.5, 2.5, 3.5]
    assert truth.q.tolist() == [0, 0, 0, 1, 1, 1, 0]
    assert np.array_equal(truth.y[:, 0], [0.1, 0.2, 0.3, np.nan, np.nan, 0.5, 0.6], equal_nan=True)


def test_a_missing_channel_lists_those_found(cart, mdf, monkeypatch):
    monkeypatch.setattr(FakeMDF, "channels", {"force": ([0.0], [1.0]), "mode": ([0.0], [0])})
    with pytest.raises(PlantError, match='no channel "position".*found: force, mode'):
        read_log(cart.plant, mdf)


def test_numbers_survive_resampling():
    values = np.random.default_rng(0).normal(size=50)
    cells = resample({"a": (np.arange(50) * 0.01 + 1e-4, values)}, 0.01, {"a"})["a"]
    assert [float(c) for c in cells] == values.tolist()
