"""The comparison: every row is a design of its own, its figures are its own, reasons where there is none."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner
from helpers.points import TOML
from helpers.reports import small_design
from helpers.tools import need

from codegen.cli import main
from codegen.compare import Compared, Variant, chosen_variants, compare, options_for, variants
from codegen.errors import DesignError
from codegen.pipeline import design
from codegen.plant.load import load, loads
from codegen.report import compare_words
from codegen.synthesis import METHODS, SETS


def test_the_walk_has_every_method_set_and_table():
    found = variants((4, 9))
    assert len({v.name for v in found}) == len(found)
    for name, method in METHODS.items():
        own = [v.options for v in found if v.method == name]
        if not method.sets:
            assert own == [{}]
            continue
        assert {o["set"] for o in own if "set" in o} == set(SETS["set"])
        assert {o["tables"] for o in own if "tables" in o} == set(SETS["tables"]) - {"none"}
        assert {o["order"] for o in own if "order" in o} == {4, 9}
    assert {v.method for v in chosen_variants(["ellipsoid"])} == {"ellipsoid"}
    with pytest.raises(DesignError, match='method "kalman" .found., expected one of interval'):
        chosen_variants(["kalman"])


def test_options_of_the_plant_file_go_to_whom_they_belong():
    """Gains to their method alone; what makes a variant to none; the rest where the method reads it."""
    plant = loads(TOML.replace("gains = {", "within = 1\norder = 6\ngains = {"))
    own = options_for(plant, Variant("", "zonotope", {"set": "ellipsoid"}))
    assert set(own) == {"within", "gains", "set"}
    assert options_for(plant, Variant("", "ellipsoid", {})) == {"within": 1}
    framed = replace(plant, method="interval", options={"criterion": "linf"})
    assert options_for(framed, Variant("", "zonotope", {})) == {}  # it has criteria of its own
    assert options_for(framed, Variant("", "tnl-interval", {})) == {"criterion": "linf"}


@pytest.fixture(scope="module")
def rows():
    """The plant with gains given: no solver. Two sets, and two that cannot be."""
    need("gcc")
    plant = loads(TOML)
    given = [v for v in variants() if v.name in ("zonotope: zonotope", 'zonotope: table "dwell"')]
    wrong = [Variant("lpv", "lpv-interval", {}), Variant("flat", "zonotope", {"order": 3})]
    kept = {}
    return plant, compare(plant, [*given, *wrong], keep=lambda v, made: kept.__setitem__(v.name, made)), kept


def test_figures_are_those_of_the_design(rows):
    plant, found, kept = rows
    first = next(c for c in found if c.name == "zonotope: zonotope")
    made = design(plant, "zonotope")
    assert first.faults == [f["by_delay"] for f in made.detection["float32"]] and first.family == "zonotope"
    assert first.multiply > 100 and first.flash > 1000 and first.ram > 50
    table = next(c for c in found if c.name == 'zonotope: table "dwell"')
    assert (table.family, table.dwell, first.dwell) == ("thresholds", 3.0, 0.0)
    assert table.multiply < first.multiply / 4 and table.ram < first.ram  # no set arithmetic
    assert table.flash > first.flash
    assert {c.name for c in found if not c.reason} == set(kept)
    reasons = {c.name: c.reason for c in found if c.reason}
    assert "constant matrices in discrete time" in reasons["lpv"] and "order is 3" in reasons["flat"]


def test_instructions_are_counted_on_the_board(rows):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    found = {c.name: c for c in rows[1]}
    some = found["zonotope: zonotope"], found['zonotope: table "dwell"']
    assert all(c.instructions > 2 * c.multiply and c.chip == "cortex-m4f" for c in some)
    assert some[1].instructions < some[0].instructions / 4


def test_the_report_tells_them_apart(rows):
    plant, found, kept = rows
    (table,) = compare_words.tables(kept["zonotope: zonotope"], found)
    assert [r.kind for r in table.rows].count("chosen") == 1
    chosen = next(r for r in table.rows if r.kind)
    assert chosen.cells[0].text == "zonotope: zonotope"
    text = " ".join(table.notes)
    assert "No design: lpv" in text and "order is 3" in text
    assert compare_words.tables(kept["zonotope: zonotope"], ()) == ()
    assert all(r.kind == "" for r in compare_words.tables(small_design("cart"), found)[0].rows)


def test_a_figure_that_does_not_exist_is_a_dash():
    c = Compared("a", "zonotope", {}, family="zonotope", label="x", faults=[[None, 0.25]], dwell=0.0, multiply=3)
    (table,) = compare_words.tables(small_design("cart"), [c])
    texts = [cell.text for cell in table.rows[0].cells]
    assert "not at any size" in texts and "0.25\u202fm" in texts and texts[-1] == "–" and "any" in texts


def test_the_command_prints_and_writes(tmp_path):
    """An applicable method with gains, then one that is not."""
    need("gcc")
    (tmp_path / "pt.toml").write_text(TOML)
    done = CliRunner().invoke(main, ["compare", str(tmp_path / "pt.toml"), "--method", "component-interval",
                                     "-o", str(tmp_path / "c.json")])
    assert done.exit_code == 0, done.output
    assert "no design: component-interval: does not apply" in done.output
    kept = json.loads((tmp_path / "c.json").read_text())
    assert kept["plant"] == "pt" and kept["rows"][0]["reason"].startswith("does not apply")
    done = CliRunner().invoke(main, ["compare", str(tmp_path / "pt.toml"), "--method", "kalman"])
    assert done.exit_code == 4 and "expected one of interval" in done.output
    done = CliRunner().invoke(main, ["compare", str(tmp_path / "pt.toml"), "--method", "component-interval", "-o",
                                     str(tmp_path / "absent" / "c.json")])
    assert done.exit_code == 6


def test_a_plant_with_parameters_compares_too():
    found = compare(load("motor"), chosen_variants(["zonotope", "ellipsoid"]))
    assert found and all(c.reason.startswith("does not apply") for c in found)
