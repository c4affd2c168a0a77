"""The assurance file of filters that sliding modes guide: all numbers are read, what was changed is found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from assurance.test_guided_point_claims import refuses_changes
from assurance.test_others import spoilt
from helpers.guided_filter import designed
from helpers.table_numbers import every_number_of_guided_filter

from codegen.assurance.claims import claims
from codegen.assurance.guided_filter_claims import begun
from codegen.assurance.places import constants
from codegen.emit.package import firmware
from codegen.errors import CertificateError


@cache
def printed(real, layout):
    texts = firmware(designed(), real, layout)
    return designed(), texts["valve.c"], texts["valve.h"]


@pytest.mark.parametrize("real, layout", [("float32", "literal"), ("float64", "loop")])
def test_every_number_is_read(real, layout):
    design, text, header = printed(real, layout)
    lines, read = text.splitlines(), constants(design, real, layout, text, header)
    assert all(e.literal in lines[n - 1] for c in read for e in c.entries for n in e.lines)
    found = {(c.name, c.mode, *e.index): e.value for c in read for e in c.entries}
    every_number_of_guided_filter(design.observer.tables[real], found, [m.name for m in design.plant.modes])


CHANGED = (("(!blind) && (s->age > 0U)", "(s->age > 0U)"), ("begun[q][i];", "begun[0U][i];"),
           ("in, out->mode, out->f_hat);", "in, 0U, out->f_hat);"), (" <= limit[i]))", " < limit[i]))"),
           ("threshold[stage][row][out->mode]", "threshold[0U][row][out->mode]"), ("(k[0] * xi[0])", "(k[1] * xi[0])"),
           ("raw |= (uint32_t)2U << i", "raw |= (uint32_t)1U << i"), ("(s->told_since >> ", "(s->told_since >> 1U >> "))


def test_a_changed_c_is_refused():
    refuses_changes(*printed("float32", "table"), CHANGED)


FALSE = (
    *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("d_hi", 0.98, "not far enough"), ("v_lo", 0.98, "test could fail"), ("L_hi", 1.001, "not the gain"),
        ("x_hi", 0.9, "ranges: x box"), ("x0_hi", 0.9, "ranges: x0 box"))),
    *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
        ("h", 0.99, "estimate of fault 0"), ("K", 1.02, "estimate of fault 0|energy"), ("M", 1.05, "not kept|energy"),
        ("E", 1.2, "start of size"), ("sizes", 0.99, "declared range|start of size"), ("limit", 0.01, "limit"),
        ("floor", 0.01, "floor"), ("y_hi", 0.99, "ranges of inputs"),
        ("x_lo", 0.9, "rounding of a start|ranges of the filters"))),
    ("certificate", "told", lambda c: c | {"level": 0.999 * c["level"]}, "energy: square of the claimed level"),
    ("certificate", "told", lambda c: c | {"energy": c["energy"] | {"level2": 0.99 * c["energy"]["level2"]}},
     "energy: smallest pivot of the matrix"),
    ("certificate", "told", lambda c: c | {"sets": [s | {"bounds": [0.98 * b for b in s["bounds"]]}
                                                   for s in c["sets"]]}, "not kept"),
    ("certificate", "target", lambda J: 0.4, "level beta|entries of J|J"),
    ("certificate", "dwell", lambda k: k - 1, "dwell time"))


def test_margins_refuse_what_does_not_hold():
    design = designed()
    found = {c.id: c for c in claims(design, "float32")}
    assert list(found)[:7] == ["decision", "test", "containment", "energy", "bound", "settled", "no-alarm"]
    assert not found["decision"].margins and {"told_h", "told_limit", "begun"} <= set(found["bound"].constants)
    assert len(found["bound"].margins) > 7 and all(m.holds for c in found.values() for m in c.margins)
    for where, key, change, words in FALSE:
        with pytest.raises(CertificateError, match=words):
            claims(spoilt(design, where, key, change), "float32")


def test_where_a_filter_starts_has_its_margins():
    """Of ranges that are not around zero: the state of the table is E c, the half width holds the range from c on."""
    t = designed().observer.tables["float32"]
    t = replace(t, x_lo=t.x_lo / 2, told=replace(t.told, x_lo=t.x_lo / 2))
    assert t.begun.any() and [m.holds for m in begun(t)] == [True, True]

    class Off(type(t)):
        begun = t.begun * 1.001

    assert [m.holds for m in begun(Off(**vars(t)))] == [False, True]
    wide = replace(t, x_hi=t.x_hi * 2, told=replace(t.told, x_hi=t.x_hi * 2))
    assert [m.holds for m in begun(wide)] == [True, False]
