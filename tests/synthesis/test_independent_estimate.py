"""The independent checker on observers of states and faults with weights at the estimate."""

from __future__ import annotations

import copy
import json
from functools import cache

import pytest
from helpers.checker import checker_of
from helpers.folders import write
from helpers.tampering import scaled
from synthesis.test_fault_weights import tank
from synthesis.test_independent_polytopic import C, T

from codegen.assurance.claims import claims

checker = checker_of("faults")


@cache
def data():
    return json.loads(tank().to_json())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write(tank(), tmp_path_factory.mktemp("estimate") / "tank")


def record(folder):
    return json.loads((folder / "resources.json").read_text())


def test_proves_what_the_claims_say_it_does(checker, folder, capsys):
    checker.main(folder, data(), record(folder))
    said = capsys.readouterr().out
    assert "around the faults, with rounding, energy gain, contraction" in said and "constants of tank.c" in said
    named = {c.id for c in claims(tank(), "float32") if "independent" in c.checks}
    assert {"energy", "decay", "estimate", "settled", "ranges"} <= named


@pytest.mark.parametrize("path, factor, words", [
    ((*T, "h", -1, 0), 0.98, "threshold row"), ((*T, "h", 0, 0), 0.5, "threshold row"),
    ((*T, "K", 0, 0, 1), 1.01, "threshold row"), ((*T, "F", 1, 0, 0), 1.05, "contraction at"),
    ((*T, "C", 0, 0), 1.01, "energy gain|not kept|threshold row"), ((*T, "faults"), 0, "number of faults"),
    ((*T, "T2", 2, 0), 0.99, "energy gain|not kept|threshold row"),
    ((*C, "level"), 0.99, "claimed level"), ((*C, "energy", "level2"), 0.98, "claimed level|energy gain"),
    ((*C, "energy", "contraction"), 0.9, "contraction at"), ((*C, "energy", "P2", 0, 0), 0.5, "energy gain|P1, P2"),
    ((*C, "energy", "R", 5, 1), 0.5, "energy gain"), ((*C, "thresholds", "bounds", 0, 0), 0.95, "not kept"),
])
def test_refuses_what_is_not_proved(path, factor, words, checker, folder):
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        checker.main(folder, scaled(data(), path, factor), record(folder))


@pytest.mark.parametrize("old, new, words", [
    ("[-0.05, 0.05]", "[-0.08, 0.08]", "not kept|energy gain|threshold"),
    ("[-0.005, 0.005]", "[-0.006, 0.006]", "not kept|energy gain|threshold"),
    ("area    = 0.5 ", "area    = 0.4 ", "energy gain|not kept"),
    ("range = [4, 10] }]\nu", "range = [4, 11] }]\nu", "range|not kept|energy"),
    ("Df = [[1], [0]]", "Df = [[0.9], [0]]", "energy gain|not kept|threshold"),
])
def test_refuses_another_plant(old, new, words, checker, folder):
    out = copy.deepcopy(data())
    assert old in out["plant"]["toml"]
    out["plant"]["toml"] = out["plant"]["toml"].replace(old, new, 1)
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        checker.main(folder, out, record(folder))


def test_refuses_another_c_and_does_not_know_calibrated_bounds(checker, folder, tmp_path):
    out = copy.deepcopy(data())
    out["certificate"]["float32"]["calibration"] = {}
    with pytest.raises(SystemExit) as stopped:
        checker.main(folder, out, record(folder))
    assert stopped.value.code == 2
    for name in ("tank.c", "tank.h"):
        (tmp_path / name).write_text((folder / name).read_text().replace("x_hat[2] = s->z[2]", "x_hat[2] = s->z[0]"))
    with pytest.raises(SystemExit, match="refused: .*x_hat"):
        checker.main(tmp_path, data(), record(folder))
