"""Replay of a plant with parameters: the log must hold the measured ones, and the firmware reads these."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.reports import StandInDriver  # noqa: E402
from helpers.varying import HEATER, heater_design  # noqa: E402

from codegen.analysis.logs import read_log  # noqa: E402
from codegen.analysis.replay import replay  # noqa: E402
from codegen.errors import PlantError  # noqa: E402
from codegen.plant.load import loads  # noqa: E402
from codegen.plant.simulate import simulate  # noqa: E402

HEAD = "power,inlet,thermometer,flow,mode\n"


@pytest.fixture(scope="module")
def heater():
    return heater_design()


def write_log(path, truth, columns=("flow",)):
    names = ["power", "inlet", "thermometer", *columns, "mode"]
    theta = {"flow": truth.theta[:, 0], "loss": truth.theta[:, 1]}
    values = [truth.u[:, 0], truth.u[:, 1], truth.y[:, 0], *(theta[c] for c in columns), truth.q]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*(v.tolist() for v in values)))
    return path


@pytest.mark.parametrize("columns", [("flow",), ("loss", "flow")], ids=["measured alone", "all"])
def test_the_firmware_reads_the_measured_columns(heater, tmp_path, columns):
    truth = simulate(heater.plant, "drift", seed=1)
    result = replay(heater, StandInDriver(heater), write_log(tmp_path / "log.csv", truth, columns), tmp_path / "out")
    expected = StandInDriver(heater).run(u=truth.u, y=truth.y, q=truth.q, theta=truth.theta)
    got = result.outcome.trace
    assert got.differs(expected) == [] and expected.alarm.any() and result.alarms[0][0] == 300
    # The control: other parameters give other bounds.
    other = truth.theta.copy()
    other[:, 0] = np.clip(other[:, 0] - 0.1, 0.5, 1.5)
    assert got.differs(StandInDriver(heater).run(u=truth.u, y=truth.y, q=truth.q, theta=other)) != []
    plot = result.plot.read_text(encoding="utf-8")
    assert "Parameter flow" in plot and ("Parameter loss" in plot) == ("loss" in columns)


def test_a_parameter_out_of_its_bounds_is_counted(heater, tmp_path):
    """The second row is beyond the bounds of its mode, the third within those of the other one."""
    (tmp_path / "log.csv").write_text(HEAD + "0,0,0,0.6,shut\n0,0,0,1.2,shut\n0,0,0,1.2,open\n0,0,0,1.53,open\n")
    table = dict(replay(heater, StandInDriver(heater), tmp_path / "log.csv", tmp_path / "out").rows())
    assert table["refused samples"] == "2 (2 parameter out of its bounds)"


@pytest.mark.parametrize("text, parts", [
    ("power,inlet,thermometer,mode\n0,0,0,open\n",
     ['no column "flow"', "found: power, inlet, thermometer, mode", "expected: power, inlet, thermometer, flow, mode"]),
    ("power,inlet,thermometer,loss,mode\n0,0,0,0.2,open\n", ['no column "flow"']),
    (HEAD + "0,0,0,,open\n", ["line 2", '"flow" holds ""', "finite number"]),
    (HEAD + "0,0,0,0.6,open\n0,0,0,wide,open\n", ["line 3", '"flow" holds "wide"']),
    ("power,inlet,thermometer,flow,loss,mode\n0,0,0,0.6,much,open\n", ["line 2", '"loss" holds "much"']),
])
def test_what_is_wrong_with_the_parameters_of_a_log_is_told(heater, tmp_path, text, parts):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(PlantError) as error:
        replay(heater, StandInDriver(heater), tmp_path / "log.csv", tmp_path / "out")
    assert str(error.value).startswith("log.csv: ") and all(part in str(error.value) for part in parts)
    assert not (tmp_path / "out").exists()


def test_a_column_of_two_names_is_refused(tmp_path):
    plant = loads(HEATER.replace('name = "thermometer"', 'name = "flow"'))
    (tmp_path / "log.csv").write_text("power,inlet,flow,mode\n0,0,0.6,open\n")
    with pytest.raises(PlantError, match=r'"flow" names two signals \(of mode, u, y, f, theta\)'):
        read_log(plant, tmp_path / "log.csv")


def test_what_nobody_measures_may_have_gaps(heater, tmp_path):
    (tmp_path / "log.csv").write_text("power,inlet,thermometer,flow,loss,mode\n0,0,0,0.6,,open\n0,0,0,0.6,0.2,open\n")
    truth, _ = read_log(heater.plant, tmp_path / "log.csv")
    assert np.array_equal(truth.theta, [[0.6, np.nan], [0.6, 0.2]], equal_nan=True)
