"""The assurance file of point observers: every kind of C is read, what was changed in it or in the tables is found."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.kept import POINTS, family_of
from helpers.points import VARIANTS, made

from codegen.assurance import point_claims, point_margins
from codegen.assurance.c_reader import blank
from codegen.assurance.claims import claims
from codegen.assurance.places import constants
from codegen.certify.set_claims import CHECKS
from codegen.designs import read_checked
from codegen.emit.package import firmware
from codegen.errors import CertificateError
from codegen.observers import FAMILIES
from codegen.observers.follower import SETS as INNER

LAYOUTS = ("literal", "table", "loop")


@cache
def printed(variant, layout, real="float32"):
    design = made(variant)
    texts = firmware(design, real, layout)
    return design, texts["pt.c"], texts["pt.h"]


@pytest.mark.parametrize("variant", VARIANTS)
def test_constants_are_found_in_every_kind_of_c(variant):
    layout, real = LAYOUTS[len(variant) % 3], ("float32", "float64")[len(variant) % 2]
    design, text, header = printed(variant, layout, real)
    lines = text.splitlines()
    found = constants(design, real, layout, text, header)
    assert sum(len(c.entries) for c in found) > 20
    for c in found:
        assert all(e.literal in lines[n - 1] for e in c.entries for n in e.lines)


#: Of the sets, beside what ``test_assurance`` changes in maps: what the C says, what instead.
SETS = {
    "gain on the new output": (
        ("key[k] > key[best]", "key[k] >= key[best]"), ("j = PT_KEPT;", "j = PT_KEPT + 1U;"),
        ("box[i] = rounding[i]", "box[i] = 0.0F"), ("matrix[i][j] * box[j]", "matrix[j][i] * box[j]"),
        ("s->origin = p;", "s->origin = PT_MODES;"), ("raw |= PT_BIT_TOGETHER", "raw |= 0U"),
        ("noise[q][o]", "noise[q][0U]"), ("rho[q][i]", "rho[0][0]"),
        ("(radius[i] <= limit[i])", "(radius[i] > limit[i])"),
        ("s->shape[i] = 0.0F;", ""), ("out->x_lo[i] = s->x_hat[i] - radius[i];", "out->x_lo[i] = s->x_hat[i];")),
    "table": (
        ("< 3U)", "< 4U)"), ("s->stage++;", "s->stage = 1U;"), ("(PT_ANEW - 1U)", "(PT_ANEW - 2U)"),
        ("s->since++;", "s->since = 0U;"), ("inside = false", "inside = true"), ("[row][i];", "[0U][i];"),
        ("direction[i - PT_NY][j]", "direction[0][j]")),
    "ellipsoid": (
        ("factor[p] *", "factor[0] *"), ("(rounding[p][i] * trace)", "0.0F"), ("- cross - cross", "- cross"),
        ("noise[p][o][", "noise[p][0]["), ("other < root", "other > root"),
        ("s->shape[i] = next[i];", ""), ("weight[i] *", "weight[0] *")),
}


@pytest.mark.parametrize("variant", SETS)
def test_a_changed_set_is_refused(variant):
    """A statement, an index, an operator: nothing of the C may differ from what is printed of the design."""
    design, text, header = printed(variant, "loop")
    constants(design, "float32", "loop", text, header)
    for old, new in SETS[variant]:
        assert old in text, old
        with pytest.raises(CertificateError, match="Print it again|Print the C again"):
            constants(design, "float32", "loop", text.replace(old, new, 1), header)
    with pytest.raises(CertificateError, match="macros"):
        constants(design, "float32", "loop", text, re.sub(
            r"(#define PT_(?:ORDER|ROWS|TANGENTS) )(\d+)U", r"\g<1>77U", header, count=1))


@pytest.mark.parametrize("variant", SETS)
def test_two_numbers_of_a_table_may_not_change_places(variant):
    """Neither does the set of numbers change, nor any of its sums: the order must be that of the tables."""
    design, text, header = printed(variant, "table")
    code = blank(text)
    places = [m for m in re.finditer(r"([\d.e-]+F), (?!\1)([\d.e-]+F)", code) if m[1] not in m[2] and m[2] not in m[1]]
    assert len(places) > 20
    for m in places[:: len(places) // 6]:
        with pytest.raises(CertificateError):
            constants(design, "float32", "table", f"{code[:m.start()]}{m[2]}, {m[1]}{code[m.end():]}", header)


def relaxed(design, real, name, factor, of_set=True):
    """One field of the tables scaled."""
    t = design.observer.tables[real]
    where = t.shape if of_set else t
    other = replace(where, **{name: (getattr(where, name) * factor).astype(t.dtype)})
    t = replace(t, shape=other) if of_set else other
    return replace(design, observer=type(design.observer)({real: t}, design.observer.supervision))


MARGINS = {
    "zonotope": (("e", 0.5, "no-alarm: e beyond"), ("rho", 0.9, "no-alarm: rho beyond"),
                 ("slack", 0.5, "no-alarm: slack"), ("floor", 0.1, "no-alarm: floor"),
                 ("spread", 0.9, "containment: spread"), ("F", 1.1, "no-alarm: e beyond"),
                 ("V", 1.1, "no-alarm: rho beyond")),
    "ellipsoid": (("H", 0.9, "no-alarm: smallest pivot"), ("Hb", 0.9, "containment: smallest pivot"),
                  ("V", 0.9, "no-alarm: smallest pivot"), ("k", 0.9, "no-alarm: rounding factor"),
                  ("b", 0.99, "containment: tangents a"), ("ay", 0.99, "no-alarm: tangents ay"),
                  ("spread", 0.9, "containment: spread"), ("slack", 0.5, "no-alarm: slack"),
                  ("floor", 0.5, "no-alarm: floor")),
    "thresholds": (("h", 0.99, "threshold"), ("hx", 0.99, "threshold"), ("hx", 1.01, "ultimate-width: width beyond")),
    "box": (("P", 0.999, "no-alarm: P beyond"), ("g", 0.999, "no-alarm: g beyond"), ("S", 0.999, "no-alarm: S beyond"),
            ("rho", 0.999, "no-alarm: rho beyond"), ("Pb", 0.999, "containment: Pb"), ("gb", 0.999, "containment: gb"),
            ("spread", 0.99, "containment: spread")),
    "ellipsoid_trace": (("H", 0.9, "no-alarm: smallest pivot"), ("Hb", 0.9, "containment: smallest pivot"),
                        ("V", 0.9, "no-alarm: smallest pivot"), ("k", 0.9, "no-alarm: rounding factor"),
                        ("scale", 0.99, "containment: scale"), ("scale_y", 0.99, "no-alarm: scale_y"),
                        ("spread", 0.9, "containment: spread"), ("slack", 0.5, "no-alarm: slack")),
    "blocks": (("scalars", 0.99, "no-alarm: scalars"), ("noise", 0.99, "no-alarm: noise"), ("e", 0.5, "no-alarm: e "),
               ("anywhere", 0.9, "anywhere")),
    "schedule": (("h", 0.99, "threshold"), ("hx", 0.99, "threshold"), ("hx", 1.01, "ultimate|repeat")),
}
BOTH = (("box", 0.6, "bounded: box beyond"), ("x0_hi", 0.5, "ranges: x0 box"))


@pytest.mark.parametrize("folder", POINTS, ids=lambda f: f.name)
def test_margins_refuse_what_does_not_hold(folder):
    design, family = read_checked(folder), family_of(folder)
    real = "float32"
    assert all(m.holds for c in claims(design, real) for m in c.margins)
    cases = [(*case, True) for case in MARGINS.get(family, ())] + [
        (*case, False) for case in BOTH if family not in ("thresholds", "schedule", "blocks") or case[0] != "box"]
    assert len(cases) > 2
    for name, factor, words, of_set in cases:
        with pytest.raises(CertificateError, match=words):
            claims(relaxed(design, real, name, factor, of_set), real)


@pytest.mark.parametrize("folder", POINTS, ids=lambda f: f.name)
def test_a_false_level_is_refused(folder):
    design = read_checked(folder)
    cert = design.certificate["float32"]
    if cert["kind"] == "none":
        assert not any(c.id in ("hinf", "linf") for c in claims(design, "float32"))
        return
    for change, words in (({"level": 0.99 * cert["level"]}, "claimed level"),
                          ({"g": 0.5 * cert["g"]}, "pivot of the matrix")):
        with pytest.raises(CertificateError, match=words):
            claims(replace(design, certificate=design.certificate | {"float32": cert | change}), "float32")


def test_every_kind_of_set_has_its_conditions():
    """A new one must not slip through: its certificate is checked, so its claims have margins and words."""
    assert set(CHECKS) == set(point_margins.HELD) == set(point_claims.WORDS) and (
        set(CHECKS) <= {*FAMILIES, *INNER})
    design = read_checked(POINTS[0])
    strange = design.certificate["float32"] | {"set": "pyramid"}
    with pytest.raises(CertificateError, match="no condition is known for the set 'pyramid'"):
        claims(replace(design, certificate=design.certificate | {"float32": strange}), "float32")


def test_no_field_of_a_set_may_be_missing():
    """A table that the C has lost is found even if everything else is as printed."""
    design, text, header = printed("ellipsoid", "loop")
    t = design.observer.tables["float32"]
    other = replace(t, shape=replace(t.shape, gr=t.shape.gr + np.float32(0.5)))
    spoilt = replace(design, observer=type(design.observer)({"float32": other}, design.observer.supervision))
    with pytest.raises(CertificateError, match="is not what residua prints|none of the design's tables"):
        constants(spoilt, "float32", "loop", text, header)
