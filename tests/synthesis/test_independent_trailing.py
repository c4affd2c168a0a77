"""The independent checker on filters beside a mode estimator: it agrees with the proof, refuses the false."""

from __future__ import annotations

import re
from functools import cache

import pytest
from helpers.checker import checker_of, refuses_changes
from helpers.tampering import scaled
from helpers.trailing import PLANTS, made, stand_in
from synthesis.test_trailing import whole

from codegen.emit import files

checker = checker_of("trailing")


@cache
def given(name):
    """Text of the plant, tables, proofs of the thresholds, and of the level where there is one."""
    if name == "pushed":
        d = whole()
        cert = d.certificate["float32"]["told"]
        return d.plant.text, d.observer.tables["float32"].to_dict(), cert["sets"], (cert, d.options)
    t, certs = made(name, "float32")
    return PLANTS[name], t.to_dict(), certs, None


@cache
def printed(name, layout):
    d = whole() if name == "pushed" else stand_in(name)
    out = files(d, "float32", layout, measure=False)
    return out[f"{d.plant.target.prefix}.c"], out[f"{d.plant.target.prefix}.h"], d.plant.target.prefix


def proves(checker, name, t, sets, text=None):
    """All parts but the boxes and delays, which other tests look at."""
    modes, ranges, _ = checker.filters.read_plant(text or given(name)[0])
    checker.check_joint(t)
    for q, p in enumerate(modes):
        checker.check_thresholds(p, t["told"], q, sets[q])
        if given(name)[3] is not None:
            cert, options = given(name)[3]
            checker.check_energy(p, t["told"], q, cert, options, ranges)


@pytest.mark.parametrize("name, layout", [("pushed", "literal"), ("no input", "table"), ("between", "loop")])
def test_proves_thresholds_and_reads_the_c(name, layout, checker):
    _, t, sets, _ = given(name)
    proves(checker, name, t, sets)
    checker.check_source(*printed(name, layout)[:2], t, printed(name, layout)[2])


FALSE = {  # what of the tables, factor, words
    "thresholds": (("told", "h"), 0.99, "threshold"), "step": (("told", "M"), 1.02, "kept|energy"),
    "gain": (("told", "L"), 1.02, "kept|energy|threshold"), "estimate": (("told", "K"), 1.02, "threshold|energy"),
    "start": (("told", "E"), 1.1, "threshold"), "sizes": (("told", "sizes"), 1.1, "threshold"),
    "largest size": (("told", "sizes"), 0.99, "declared range"), "limit": (("told", "limit"), 0.5, "limit|threshold"),
    "grow": (("told", "grow"), 0.9999, "grow"), "floor": (("told", "floor"), 0.01, "floor"),
    "ranges": (("told", "u_hi"), 1.1, "ranges")}


@pytest.mark.parametrize("what", FALSE)
def test_refuses_false_tables(what, checker):
    path, factor, words = FALSE[what]
    name = "input" if what in ("start", "limit") else "pushed"
    _, t, sets, _ = given(name)
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        proves(checker, name, scaled(t, path, factor), sets)


def test_refuses_another_plant_or_proof(checker):
    for name, old, new in (("pushed", "[-0.01, 0.01]", "[-0.011, 0.011]"), ("pushed", "[[0.7, 0.1]", "[[0.7, 0.12]"),
                           ("between", "period = 0.05", "period = 0.051")):
        text, t, sets, _ = given(name)
        assert old in text
        with pytest.raises(SystemExit, match="refused: "):
            proves(checker, name, t, sets, text.replace(old, new))
    _, t, sets, _ = given("pushed")
    less = [s | {"bounds": [0.99 * b for b in s["bounds"]]} for s in sets]
    with pytest.raises(SystemExit, match="not kept"):
        proves(checker, "pushed", t, less)


CHANGES = (  # of the C: what, what instead
    (r"\(0\.5F \* first\)", "(0.25F * first)"), (r"(threshold(?:\[\w+\])+ = \{\s*\{\s*\{\s*\{ )", r"\g<1>1"),
    (r"(E(?:\[\w+\])+ = \{\s*\{ \{ )", r"\g<1>1"), (r"(largest(?:\[\w+\])+ = \{\s*\{ )", r"\g<1>1"),
    (r"(limit\[PUSHED_NS\] = \{\s*)", r"\g<1>1"), (r"\* 1\.0000005F\)", "* 1.0F)"),
    (r"told_since\[q\] >> 1U", "told_since[q] >> 2U"),
    (r"(?s)(_forward\w*\([^)]*\)\n{.*?)(\d+\.\d+)F", r"\g<1>1\g<2>F"))


def test_changed_c_is_refused(checker):
    t, (text, header, prefix) = given("pushed")[1], printed("pushed", "literal")
    bare = re.sub(r"/\*.*?\*/", "", text)
    refuses_changes(lambda source: checker.check_source(source, header, t, prefix), bare, CHANGES)
    with pytest.raises(SystemExit, match="macro LAST"):
        checker.check_source(bare, re.sub(r"(_LAST )(\d+)U", r"\g<1>9\g<2>U", header), t, prefix)
