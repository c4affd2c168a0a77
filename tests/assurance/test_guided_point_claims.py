"""The assurance file of guided point observers: all numbers are read, what was changed is found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
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
    ("box", "float32", "table"), ("zonotope", "float64", "loop"), ("ellipsoid", "float32", "table"),
    ("trace", "float32", "literal"), ("table", "float32", "table")])
def test_every_number_is_read(name, real, layout):
    design, text, header = printed(name, real, layout)
    lines, read = text.splitlines(), constants(design, real, layout, text, header)
    assert all(e.literal in lines[n - 1] for c in read for e in c.entries for n in e.lines)
    found = {(c.name, c.mode, *e.index): e.value for c in read for e in c.entries}
    every_number_of_guided_point(design.observer.tables[real], found, [m.name for m in design.plant.modes])


CHANGED = {
    "box": (
        ("valve_lend(s, out->mode, &held);", "valve_lend(s, 0U, &held);"), ("if (kept && (own.x_hi", "if ((own.x_hi"),
        ("&own) << 1U", "&own) << 2U"), ("held->shape[i] = s->told", "held->shape[i] = -s->told"),
        ("_SHARE 0.8F", "_SHARE 0.7F")),
    "table": (("half[i] <= start[k][i]", "half[i] >= start[k][i]"),),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_changed_c_is_refused(name):
    design, text, header = printed(name, "float32", "table")
    for old, new in CHANGED[name]:
        assert old in text, old
        with pytest.raises(CertificateError, match="rint it again"):
            constants(design, "float32", "table", text.replace(old, new, 1), header)


FALSE = (
    *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("d_hi", 0.98, "not far enough"), ("v_lo", 0.98, "test could fail"), ("L_hi", 1.001, "not the gain"),
        ("x_hi", 0.9, "ranges of x"), ("x0_hi", 0.9, "ranges: x0 box"))),
    *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("L", 1.01, "observer: "), ("limit", 0.4, "observer: limit beyond"), ("x_lo", 0.9, "ranges of x"),
        ("box", 0.6, "observer: box beyond"), ("y_hi", 0.5, "y_hi"))),
    *(("set", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("g", 0.9, "observer: g beyond"), ("rho", 0.9, "observer: rho beyond"), ("P", 0.9, "observer: P beyond"),
        ("spread", 0.9, "observer: spread"))),
    ("certificate", "target", lambda J: 0.4, "level beta|entries of J|J"),
    ("certificate", "dwell", lambda k: k - 1, "dwell time"))


def test_margins_refuse_what_does_not_hold():
    design = designed()
    found = {c.id: c for c in claims(design, "float32")}
    assert list(found)[:5] == ["decision", "test", "containment", "observer", "no-alarm"]
    assert not found["decision"].margins and {"told_M", "told_g", "told_x_set"} <= set(found["observer"].constants)
    assert len(found["observer"].margins) > 8 and all(m.holds for c in found.values() for m in c.margins)
    for where, key, change, words in FALSE:
        with pytest.raises(CertificateError, match=words):
            claims(spoilt(design, where, key, change), "float32")


def test_margins_of_a_table():
    """Those of every set: ``test_others``, of observers that follow."""
    design = designed('tables = "dwell"\nrows = 4')
    found = {c.id: c for c in claims(design, "float32")}
    assert "1 sizes" in found["table"].text and {"widest", "told_sizes"} <= set(found["table"].constants)
    assert [m.holds for m in found["table"].margins] == [True, True]
    t = design.observer.tables["float32"]
    assert not guided_point_claims.widest(replace(t, told=replace(t.told, x_lo=t.told.x_lo / 2))).holds
    with pytest.raises(CertificateError, match="start 0 in mode 0"):
        claims(spoilt(design, "set", "h", lambda h: h * np.float32(0.9)), "float32")
