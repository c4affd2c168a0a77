"""The whole way of a point observer: plant file, design, C, validation, report, by public calls and commands."""

import json

import pytest
from click.testing import CliRunner
from helpers.points import TOML

import codegen
from codegen.cli import main
from codegen.errors import DesignError
from codegen.plant.load import loads
from codegen.selection.select import choose

TABLE = TOML.replace('method = "zonotope"', 'method = "zonotope"\ntables = "dwell"\nrows = 6\nstages = 3')
TURN = TOML.replace('method = "zonotope"', 'method = "zonotope"\ntables = "schedule"').replace(
    "[switching]", '[switching]\nschedule = { every = 3, order = ["one", "two", "three"] }').replace(
    'mode = { every = 4, order = ["two", "one"] }', 'mode = { every = 3, order = ["one", "two", "three"] }')
BOX = TOML.replace('method = "zonotope"', 'method = "zonotope"\nset = "interval"')
TRACE = TOML.replace('method = "zonotope"', 'method = "ellipsoid"\nweights = "trace"')


@pytest.mark.parametrize("text,family", [(TOML, "zonotope"), (BOX, "box"), (TURN, "schedule"),
                                         (TRACE, "ellipsoid_trace")])
def test_plant_file_to_validated_firmware(text, family, tmp_path):
    path = tmp_path / "pt.toml"
    path.write_text(text)
    result = codegen.run(codegen.load(path), tmp_path / "out")
    assert result.design.observer.family == family and all(o.passed for o in result.outcomes)
    sensor = next(o for o in result.outcomes if o.scenario.name == "sensor")
    assert [e.delay for e in sensor.episodes] == [0]
    promised = result.design.detection["float32"][0]["by_delay"][0]
    assert promised < 2
    kept = {p.name for p in (tmp_path / "out").iterdir()}
    assert {"pt.c", "pt.h", "test_pt.c", "design.json", "resources.json", "report.html", "prove_pt.c", "rounding_pt.g",
            "assurance.json"} <= kept
    for command in (["certify", "out/design.json"], ["validate", "out"],
                    ["generate", "out/design.json", "-o", "again"]):
        done = CliRunner().invoke(main, [a if "out" not in a and a != "again" else str(tmp_path / a) for a in command])
        assert done.exit_code == 0, done.output
    done = CliRunner().invoke(main, ["assurance", str(tmp_path / "out")])
    begins = "each residual is" if family == "box" else "the residual lies"
    assert done.exit_code == 0 and begins in done.output, done.output
    states = {c["id"]: c["state"] for c in json.loads((tmp_path / "out" / "assurance.json").read_text())["checks"]}
    known = {"exact", "read-back", "validation", "independent"}
    assert known == {k for k, v in states.items() if v == "passed"} - {"compile", "detection"}
    for name in ("pt.c", "pt.h", "test_pt.c"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    record = json.loads((tmp_path / "out" / "resources.json").read_text())
    assert record["family"] == family and record["measured"]["host"]["flash_bytes"] > 0


@pytest.mark.parametrize("old,new,message", [
    ("gains = {", 'order = 3\ngains = {', "order is 3 .found., expected at least 4"),
    ("gains = {", 'tables = "few"\ngains = {', "tables is 'few', expected"),
    ("gains = {", 'wieght = 3\ngains = {', "observer.wieght is no option"),
    ("gains = { L =", "gains = { K =", "gains.K is unknown"),
    ("B = [[0], [1], [0]]", "B = [[0], [1], [0]]\nD = [[1], [0]]", "gains.N: D is not zero"),
    ("[0, 0]], [[0.1", "[0]], [[0.1", "gains.L has shape"),
    ("A = [[0.5, 0.1, 0]", "A = [[1.5, 0.1, 0]", "grows without bound"),
    ('method = "zonotope"', 'method = "zonotope"\nset = "box"', "set is 'box', expected"),
])
def test_what_is_wrong_is_named(old, new, message):
    assert old in TOML
    text = TOML.replace(old, new, 1)
    if "gains.N" in message:
        text = text.replace("gains = { L", "gains = { N = [[[0.1, 0], [0, 0], [0, 0]], [[0, 0], [0, 0], [0, 0]], "
                            "[[0, 0], [0, 0], [0, 0]]], L")
    plant = loads(text)
    with pytest.raises(DesignError, match=message):
        choose(plant, "zonotope", plant.options, lambda text: None)


def test_a_table_needs_stable_modes():
    plant = loads(TABLE.replace("A = [[0.5, 0.1, 0]", "A = [[1.5, 0.1, 0]", 1))
    with pytest.raises(DesignError, match="pt: mode 0: spectral radius of the error matrix 1.396"):
        choose(plant, "zonotope", plant.options, lambda text: None)
