"""The assurance file of guided point observers: all numbers are read, what was changed is found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from assurance.test_others import spoilt
from helpers.guided_point import designed, stand_in
from helpers.table_numbers import every_number_of_guided_point

from codegen.assurance import guided_point_claims
from codegen.assurance.claims import claims
from codegen.assurance.places import constants
from codegen.emit.package import firmware
from codegen.errors import CertificateError


@cache
def printed(name, real, layout):
    design = stand_in(name, real)
    texts = firmware(design, real, layout)
    return design, texts["valve.c"], texts["valve.h"]


@pytest.mark.parametrize("name, real, layout", [
    ("zonotope", "float64", "loop"), ("ellipsoid", "float32", "table"), ("trace", "float32", "literal"),
    ("table", "float32", "table")])
def test_every_number_is_read(name, real, layout):
    design, text, header = printed(name, real, layout)
    lines, read = text.splitlines(), constants(design, real, layout, text, header)
    assert all(e.literal in lines[n - 1] for c in read for e in c.entries for n in e.lines)
    found = {(c.name, c.mode, *e.index): e.value for c in read for e in c.entries}
    every_number_of_guided_point(design.observer.tables[real], found, [m.name for m in design.plant.modes])


CHANGED = (("valve_lend(s, out->mode, &held);", "valve_lend(s, 0U, &held);"),
           ("if (kept && (own.x_hi", "if ((own.x_hi"),
           ("held->shape[i] = s->told", "held->shape[i] = -s->told"))


def refuses_changes(design, text, header, changes):
    """The C, in a table, is read; with one of these changes it is not what is printed."""
    assert constants(design, "float32", "table", text, header)
    for old, new in changes:
        assert old in text, old
        with pytest.raises(CertificateError, match="rint it again"):
            constants(design, "float32", "table", text.replace(old, new, 1), header)


def test_a_changed_c_is_refused():
    refuses_changes(*printed("box", "float32", "table"), CHANGED)


FALSE = (
    *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("d_hi", 0.98, "not far enough"), ("v_lo", 0.98, "test could fail"), ("L_hi", 1.001, "not the gain"),
        ("x_hi", 0.9, "ranges of x"), ("x0_hi", 0.9, "ranges: x0 box"))),
    *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("L", 1.01, "start 0 in mode"), ("y_hi", 0.5, "y_hi"), ("x_lo", 0.9, "ranges of x"))),
    *(("set", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("h", 0.9, "start 0 in mode 0"), ("hx", 0.9, "start 0 in mode 0"))),
    ("certificate", "target", lambda J: 0.4, "level beta|entries of J|J"),
    ("certificate", "dwell", lambda k: k - 1, "dwell time"))


def test_margins_refuse_what_does_not_hold():
    """Of a table, which has all claims; margins of other sets: those of observers that follow (``test_others``)."""
    design = designed('tables = "dwell"\nrows = 4')
    found = {c.id: c for c in claims(design, "float32")}
    assert list(found)[:6] == ["decision", "test", "containment", "observer", "table", "no-alarm"]
    assert not found["decision"].margins and {"told_M", "told_h", "told_box"} <= set(found["observer"].constants)
    assert "1 sizes" in found["table"].text and {"widest", "told_sizes"} <= set(found["table"].constants)
    assert len(found["observer"].margins) > 3 and all(m.holds for c in found.values() for m in c.margins)
    t = design.observer.tables["float32"]
    assert not guided_point_claims.widest(replace(t, x_hi=t.x_hi * 2)).holds
    for where, key, change, words in FALSE:
        with pytest.raises(CertificateError, match=words):
            claims(spoilt(design, where, key, change), "float32")
