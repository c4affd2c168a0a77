"""The independent checker on framers that a mode estimator drives: it agrees with the proof, and refuses what is false.

Three parts, each with a tampering of its own: boxes of the estimator, framers, what joins them; and the C.
"""

from __future__ import annotations

import copy
import json
import re
from functools import cache

import pytest
from helpers.checker import checker_of, refuses_changes
from helpers.driven import PLANTS, stand_in, told, turned_design
from helpers.kept import KEPT, family_of
from helpers.scripts import prefix_of
from helpers.tampering import scaled

from codegen.certify.driven_certificate import check_joint
from codegen.emit import files, firmware

REALS = ("float32", "float64")


checker = checker_of("driven")


@cache
def tables(name, real):
    return stand_in(name).observer.tables[real].to_dict()


#: What a plant's period is enclosed in, by plant and number type: no table changes it.
ENCLOSED = {}


def proves(checker, name, real, t, text=None):
    """All three parts, as ``main`` asks for them; delays are nobody's here."""
    plant = checker.read_plant(text or PLANTS[name])
    given, boxes, _, h, _ = plant
    u, tiny = checker.UNIT[real]
    umax = [max(abs(checker.F(a)), abs(checker.F(b))) for a, b in zip(t["u_lo"], t["u_hi"])]
    modes = checker.middle_plant(given, boxes["x"], [b + u * b + tiny for b in umax])
    known = None if text or umax != [2] else ENCLOSED.get((name, real))
    known = checker.births.check_boxes(modes, boxes["x"], boxes["x0"], h, t, known)
    if text is None:
        ENCLOSED[name, real] = known
    checker.check_told(t, {"told": told(name, real)[1]}, plant)
    checker.check_joint(t)


@pytest.mark.parametrize("name", ["constant", "parameters", "discrete", "turned"])
def test_proves_every_kind_of_plant(name, checker):
    """Without parameters, with measured and unknown ones, with switches at samples alone, in other coordinates."""
    for real in REALS:
        proves(checker, name, real, tables(name, real))


FALSE = {  # plant, what of the tables, factor, words
    "reach": ("parameters", ("reach",), 0.7, "reach of mode"), "birth": ("parameters", ("birth",), 0.7, "birth"),
    "reach of a step": ("discrete", ("reach",), 0.7, "reach of mode"), "birth at a sample": (
        "discrete", ("birth",), 0.7, "birth"), "J": ("parameters", ("J",), 1.02, "jump"),
    "start": ("parameters", ("start_hi",), 0.99, "start_hi"), "limit": ("discrete", ("limit",), 0.2, "limit"),
    "offset": ("parameters", ("told", "d_hi"), 0.9, "offset d_hi"), "gain": (
        "parameters", ("told", "L_hi"), 1.01, "equal gains"), "slope": (
        "parameters", ("told", "vary", "M"), 1.5, "offset d"), "radius": (
        "parameters", ("told", "vary", "R"), 0.5, "offset d"), "blind radius": (
        "parameters", ("told", "vary", "Ra"), 0.5, "offset a"), "offset of a step": (
        "discrete", ("told", "d_lo"), 0.9, "offset d_lo"), "bounds of a parameter": (
        "parameters", ("told", "vary", "theta_hi"), 0.9, "theta box"), "box of framers": (
        "parameters", ("told", "box"), 0.9, "box x too small"), "range of framers": (
        "discrete", ("told", "x_hi"), 0.9, "box x too small"),
    "xi_room": ("parameters", ("xi_room",), 0.05, "xi_room"), "S": ("parameters", ("S_rounded",), 1.0001, "xi_room"),
    "Z": ("turned", ("told", "change", "Z"), 1.001, "offset d|range of z"), "X": (
        "turned", ("told", "change", "X"), 1.001, "offset b_"), "way to z": (
        "turned", ("told", "change", "e_lo"), 0.5, "offset e_lo"), "way to x": (
        "turned", ("told", "change", "b_hi"), 0.5, "offset b_hi"), "range of z": (
        "turned", ("told", "change", "z_lo"), 0.999, "range of z"), "step of z": (
        "turned", ("told", "d_hi"), 0.9, "offset d_hi"),
    "inputs": ("parameters", ("u_hi",), 1.5, "jump|reach of mode"), "measurements": (
        "parameters", ("y_lo",), 1.001, "v_|accepted beyond"), "range of x": ("discrete", ("x_lo",), 1.1, "range of x"),
}


@pytest.mark.parametrize("name", FALSE)
def test_refuses_false_tables(name, checker):
    plant, place, factor, words = FALSE[name]
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        proves(checker, plant, "float32", scaled(tables(plant, "float32"), place, factor))


def test_refuses_what_parts_do_not_share(checker):
    """Each part for itself holds; together they do not."""
    t = copy.deepcopy(tables("parameters", "float32"))
    checker.check_joint(t)
    t["told"]["vary"]["theta_hi"][1] = [x * 2 for x in t["told"]["vary"]["theta_hi"][1]]
    with pytest.raises(SystemExit, match="differ between modes"):
        checker.check_joint(t)
    for key in ("u_lo", "y_hi"):
        t = copy.deepcopy(tables("discrete", "float32"))
        t[key] = [x + (1 if key == "y_hi" else -1) for x in t[key]]
        with pytest.raises(SystemExit, match=f"{key[0]} is accepted beyond"):
            checker.check_joint(t)


@pytest.mark.parametrize("plant, old, new, words", [
    ("parameters", "bounds = [-0.1, 0.1]", "bounds = [-0.11, 0.1]", "reach of mode"),
    ("parameters", "bounds = [0, 0.02]", "bounds = [0, 0.03]", "reach of mode"),
    ("parameters", "-3 - wear", "-3 - 1.2*wear", "reach of mode"),
    ("constant", "[-0.002, 0.004]", "[-0.002, 0.005]", "reach of mode"),
    ("discrete", "[0.1, 0.5]]", "[0.1, 0.51]]", "reach of mode"),
    ("discrete", 'kind = "discrete"', 'kind = "continuous"', "reach of mode"),
    ("parameters", "known = false", "known = false\nlate = true", "told late")])
def test_refuses_another_plant(plant, old, new, words, checker):
    assert PLANTS[plant].count(old) == 1
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        proves(checker, plant, "float32", tables(plant, "float32"), PLANTS[plant].replace(old, new))


def test_room_of_both_checkers_agrees(checker):
    """The room for S x that the proof asks for is what the checker asks for, but for the finer count of roundings."""
    data = tables("parameters", "float32")
    checker.check_joint(data)
    check_joint(stand_in("parameters").observer.tables["float32"])
    with pytest.raises(SystemExit, match="xi_room"):
        checker.check_joint(scaled(data, ("xi_room",), 0.05))


CHANGES = (  # of the C: what, what instead
    (r"(\.\d+)F, -1\.", r"\g<1>F, -2."), (r"0\.5F \* \(s->theta", "0.25F * (s->theta"),
    (r"(\w+_cut_x\(valve_real[^}]*?)-2\.5F", r"\1-2.75F"),
    (r"(forth\[\w+\]\[\w+\] = \{\s*\{ )1\.0F", r"\g<1>0.5F"), (r"(xi_room\[\w+\] = \{\s*)[\d.e-]+F", r"\g<1>0.0F"),
    (r"(frame_limit\[\w+\] = \{\s*)2\.5F", r"\g<1>2.6F"),
    (r"(birth\[[^{]*\{\s*\{ )([\d.e-]+F), ([\d.e-]+F)", r"\1\3, \2"),
    (r"<= 0\.105000004F", "<= 0.11F"), (r"<= 4\.0F", "<= 5.0F"), (r"below\[i\] = 0\.0F", "below[i] = 1.5F"))


def test_the_c_is_read(checker):
    """The committed C in its own layout, and others; numbers that are no longer those of the tables are refused."""
    folder = next(f for f in KEPT if family_of(f) == "driven")
    t, prefix = json.loads((folder / "design.json").read_text())["tables"]["float32"], prefix_of(folder)
    text, header = ((folder / f"{prefix}.{end}").read_text() for end in "ch")
    refuses_changes(lambda source: checker.check_source(source, header, t, prefix), text, CHANGES)
    with pytest.raises(SystemExit, match="ages"):
        checker.check_source(text, re.sub(r"(_OLDEST )\d+U", r"\g<1>9U", header), t, prefix)
    with pytest.raises(SystemExit, match="maps of the framers"):
        checker.check_source(text.replace(f"{prefix}_blind(", f"{prefix}_other("), header, t, prefix)


@pytest.mark.parametrize("name, real, layout", [
    ("constant", "float64", "literal"), ("discrete", "float32", "loop"), ("parameters", "float64", "literal"),
    ("parameters", "float32", "loop"), ("turned", "float32", "literal"), ("turned", "float64", "loop")])
def test_every_kind_of_c_is_read(name, real, layout, checker):
    made = files(stand_in(name), real, layout, measure=False)
    checker.check_source(made["valve.c"], made["valve.h"], tables(name, real), "valve")
    with pytest.raises(SystemExit, match="refused: "):
        checker.check_source(made["valve.c"], made["valve.h"], tables(name, "float32" if real == "float64" else
                                                                      "float64"), "valve")


def test_other_coordinates_the_whole_way(checker, tmp_path, capsys):
    """Boxes, framers of z, delays and C of one folder; widths without the rounding of a cut are refused."""
    made = turned_design()
    for name, text in firmware(made, "float32", "table").items():
        (tmp_path / name).write_text(text)
    data, record = json.loads(made.to_json()), {"prefix": "valve", "real": "float32"}
    assert checker.main(tmp_path, data, record) == 0
    assert capsys.readouterr().out.count("delays hold") == 2
    cert = data["certificate"]["float32"]
    cert["widths"] = [0.003 * (1 + 1e-9), *cert["widths"][1:]]
    with pytest.raises(SystemExit, match="row 0"):
        checker.main(tmp_path, data, record)


@pytest.mark.parametrize("pattern, new", [
    (r"(_to_x\(valve_held[^}]*?\()(\d)", r"\g<1>1\2"), (r"(_to_z\(valve_held[^}]*?[-+] \()0\.", r"\g<1>1."),
    (r"(_cut_z\(valve_real[^}]*?-)(\d)", r"\g<1>1\2"),
    (r"static void valve_to_z\(valve_held", "static void valve_z(valve_held")])
def test_other_coordinates_of_the_c_are_read(pattern, new, checker):
    made = files(stand_in("turned"), "float32", "literal", measure=False)
    other, count = re.subn(pattern, new, made["valve.c"], count=1)
    assert count == 1 and other != made["valve.c"]
    with pytest.raises(SystemExit, match="refused: "):
        checker.check_source(other, made["valve.h"], tables("turned", "float32"), "valve")
