"""The independent checker on observers that follow a mode estimator: it agrees with the proof, refuses the false."""

from __future__ import annotations

import re
from functools import cache

import pytest
from helpers.checker import checker_of, refuses_changes
from helpers.follower import CASES, PLANTS, stand_in, told
from helpers.tampering import scaled

from codegen.emit import files

LAYOUTS = {"zonotope": "literal", "box": "loop", "ellipsoid": "table", "table": "table", "trace": "literal",
           "between": "loop"}


checker = checker_of("follower")


@cache
def tables(name, real="float32"):
    return stand_in(name).observer.tables[real].to_dict()


@cache
def printed(name):
    made = files(stand_in(name), "float32", LAYOUTS[name], measure=False)
    return made["valve.c"], made["valve.h"]


def proves(checker, name, t, text=None, real="float32"):
    """All parts, as ``main`` asks for them; delays are nobody's here."""
    text = text or PLANTS[CASES[name][0]]
    period = checker.births.period_of({"plant": {"toml": text}})
    checker.births.check_boxes(*checker.read_plant(text), period, t, None)
    checker.check_told(t, told(name, real)[1], checker.read_sampled(text))
    checker.check_joint(t)
    checker.check_start(t)


@pytest.mark.parametrize("name", CASES)
def test_proves_every_set_and_reads_its_c(name, checker):
    proves(checker, name, tables(name))
    checker.check_source(*printed(name), tables(name), "valve")
    with pytest.raises(SystemExit, match="refused: "):
        checker.check_source(*printed(name), tables(name, "float64"), "valve")


FALSE = {  # case, what of the tables, factor, words
    "reach": ("box", ("reach",), 0.7, "reach of mode"), "birth": ("box", ("birth",), 0.7, "birth"),
    "noise of a step": ("zonotope", ("told", "shape", "F"), 0.9, "e"), "box of a step": (
        "box", ("told", "shape", "g"), 0.9, "g"), "gain": ("zonotope", ("told", "L"), 1.01, "e"),
    "xi_room": ("zonotope", ("xi_room",), 0.05, "xi_room"), "half widths": ("ellipsoid", ("grow",), 0.9999, "grow"),
    "squares": ("ellipsoid", ("square",), 0.99, "square"), "floor": ("box", ("floor",), 0.05, "floor"),
    "inputs": ("box", ("u_hi",), 1.5, "reach of mode|accepted beyond"), "range of x": (
        "box", ("x_lo",), 1.1, "range of x"),
    "thresholds": ("table", ("told", "shape", "h"), 0.98, "threshold"), "widths": (
        "table", ("told", "shape", "hx"), 0.98, "threshold"), "sizes of a start": (
        "table", ("told", "shape", "sizes"), 1.1, "threshold"),
    "what a period leaves": ("between", ("told", "shape", "e"), 0.5, "e"),
    "range of the observer": ("box", ("told", "x_hi"), 0.9, "box x too small"),
}


@pytest.mark.parametrize("what", FALSE)
def test_refuses_false_tables(what, checker):
    name, path, factor, words = FALSE[what]
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        proves(checker, name, scaled(tables(name), path, factor))


def test_refuses_another_plant(checker):
    for old, new in (("[-0.01, 0.01]", "[-0.02, 0.02]"), ("[0.3, 0.4, 0]", "[0.3, 0.45, 0]")):
        assert PLANTS["wide"].count(old) == 1
        with pytest.raises(SystemExit, match="refused: "):
            proves(checker, "zonotope", tables("zonotope"), PLANTS["wide"].replace(old, new))


CHANGES = (  # of the C of the box: what, what instead
    (r"\* 1\.0000005F\)", "* 1.0F)"), (r"\(0\.5F \* lo\[i\]\)", "(0.25F * lo[i])"),
    (r"(widest\[\w+\] = \{\s*)([\d.]+)F", r"\g<1>1\g<2>F"), (r"(most\[\w+\] = \{\s*)2\.0F(?=,\s+2\.0F)", r"\g<1>3.0F"),
    (r"(told_limit\[\w+\] = \{\s*)([\d.]+)F", r"\g<1>1\g<2>F"), (r"(xi_room\[\w+\] = \{\s*)[\d.e-]+F", r"\g<1>0.0F"),
    (r"(size\[VALVE_TOLD_MODES\]\[VALVE_TOLD_NX\]\[\w+\] = \{\s*\{[^{]*\{ )[\d.]+F", r"\g<1>9.0F"),
    (r"below\[i\] = 0\.0F", "below[i] = 1.5F"))


def test_changed_c_is_refused(checker):
    text, header = printed("box")
    refuses_changes(lambda source: checker.check_source(source, header, tables("box"), "valve"), text, CHANGES)


TABLE_CHANGES = (  # of the C of the table: sizes of a start, and what it is compared with
    (r"(start\[\w+\]\[\w+\] = \{\s*\{ )2\.25", r"\g<1>3.5"),
    (r"(width(?:\[\w+\])+ = \{\s*\{\s*\{\s*\{ )2\.25", r"\g<1>1.5"),
    (r"(threshold(?:\[\w+\])+ = \{\s*\{\s*\{\s*\{ )4", r"\g<1>3"))


def test_changed_table_is_refused(checker):
    text, header = printed("table")
    bare = re.sub(r"/\*.*?\*/", "", text)
    refuses_changes(lambda source: checker.check_source(source, header, tables("table"), "valve"), bare, TABLE_CHANGES)
