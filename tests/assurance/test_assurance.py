"""Every claim, constant, line and check of assurance.json; what was changed by hand must be found."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.kept import KEPT, OTHERS, POINTS, family_of, first_of_each
from helpers.table_numbers import (
    every_number_of_a_bank,
    every_number_of_a_set,
    every_number_of_driven,
    every_number_of_follower,
    every_number_of_framers,
    every_number_of_guided,
    every_number_of_guided_filter,
    every_number_of_guided_point,
    every_number_of_the_family,
    every_number_of_trailing,
)

import codegen
from codegen.assurance import document
from codegen.assurance.c_reader import blank
from codegen.assurance.checks import CHECKS
from codegen.assurance.claims import claims
from codegen.assurance.places import constants
from codegen.assurance.plant_lines import plant_lines
from codegen.designs import read_checked
from codegen.emit.package import firmware
from codegen.errors import CertificateError
from codegen.pipeline import check_assurance
from codegen.plant.load import gallery_folder, load

GENERATED = Path(__file__).resolve().parents[2] / "generated"
FOLDERS = [f for f in KEPT if f not in POINTS + OTHERS]  # of pairs of framers
names = pytest.mark.parametrize("folder", first_of_each(KEPT), ids=lambda f: f.name)


@cache
def design_of(folder):
    return read_checked(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Copies of the committed folders, each with its assurance file."""
    home = tmp_path_factory.mktemp("assured")

    @cache
    def copy(folder):
        shutil.copytree(folder, home / folder.name)
        document.write(home / folder.name, design_of(folder))
        return home / folder.name

    return copy


@pytest.fixture
def cart(made, tmp_path):
    """A fresh copy of the cart's folder, to be spoilt."""
    return Path(shutil.copytree(made(GENERATED / "cart_tnl-interval"), tmp_path / "cart"))


def read(folder):
    return json.loads((folder / "assurance.json").read_text())


def rewrite(folder, data):
    (folder / "assurance.json").write_text(json.dumps(data))


@names
def test_every_claim_of_the_design_is_there(folder, made):
    design, data = design_of(folder), read(made(folder))
    real = data["design"]["real"]
    texts = [c["claim"] for c in data["claims"]]
    assert texts[:len(design.proved[real])] == design.proved[real]
    ids = [c["id"] for c in data["claims"]]
    assert {f"detection-{f.name}" for f in design.plant.f} | {"ranges", "arithmetic", "execution"} <= set(ids)
    assert ("monitor" in ids) == design.observer.supervision.monitors_dwell and len(ids) == len(set(ids))
    known = {c["name"] for c in data["constants"]}
    for c in data["claims"]:
        about_the_c = c["id"] in ("arithmetic", "execution")
        assert all(c["condition"].values()) and set(c["constants"]) <= known and set(c["checks"]) <= set(CHECKS)
        assert about_the_c or (c["plant"] and c["constants"] and all(c["lines"].values()))
        assert about_the_c or c["margins"] or c["id"].startswith("detection") or c["id"] in (
            "monitor", "sampling", "decision")
        assert all(m["margin"] >= 0 and (m["expected"] == ">= 0" or m["margin"] > 0) for m in c["margins"])
        assert c["checks"]


@names
def test_both_number_types_are_covered(folder):
    design = design_of(folder)
    for real, sentences in design.proved.items():
        assert [c.text for c in claims(design, real)][:len(sentences)] == sentences


@names
def test_every_cited_line_holds_its_literal(folder, made):
    """Reads the C with a regular expression only."""
    data = read(made(folder))
    number = np.dtype(data["design"]["real"]).type
    for c in data["constants"]:
        text = (made(folder) / c["file"]).read_text().splitlines()
        for e in c["entries"]:
            where = (c["name"], c["mode"], e)
            if not e["literal"]:
                assert abs(e["value"]) in (0.0, 1.0) and bool(e["lines"]) == (e["value"] != 0), where
                continue
            assert e["lines"] and number(e["literal"].rstrip("FU")) == abs(e["value"]), where
            for line in e["lines"]:
                assert re.search(rf"(?<![\w.]){re.escape(e['literal'])}(?![\w.])", text[line - 1]), where


#: What looks for every number, of families that have numbers of two observers.
EVERY_NUMBER = {"driven": every_number_of_driven, "guided": every_number_of_guided,
                "follower": every_number_of_follower, "trailing": every_number_of_trailing,
                "guided_point": every_number_of_guided_point, "guided_filter": every_number_of_guided_filter}


@names
def test_every_number_of_the_tables_is_there(folder, made):
    design, data = design_of(folder), read(made(folder))
    t = design.observer.tables[data["design"]["real"]]
    found = {}
    for c in data["constants"]:
        for e in c["entries"]:
            found[c["name"], c["mode"], *e["index"]] = e["value"]
    if folder in POINTS:
        every_number_of_a_set(t, found, [m.name for m in design.plant.modes])
        return
    if family_of(folder) == "bank":
        every_number_of_a_bank(t, found)
        return
    if folder in OTHERS:
        of = EVERY_NUMBER.get(family_of(folder), every_number_of_the_family)
        of(t, found, [m.name for m in design.plant.modes])
        return
    modes = [m.name for m in design.plant.modes]
    gains = "MGLNd" if design.observer.family == "tnl" else "MGLd"
    every_number_of_framers(t, found, modes, gains, (*"ABCD", "a_hi", "a_lo", "c_hi", "c_lo"))
    for name in ("x_lo", "x_hi", "x0_lo", "x0_hi", "u_lo", "u_hi", "y_lo", "y_hi"):
        for (i,), value in np.ndenumerate(getattr(t, name)):
            assert found[name, "", i] == float(value)


@names
def test_lines_of_the_claims_are_those_of_their_constants(folder, made):
    data = read(made(folder))
    for claim in data["claims"]:
        lines = {n for c in data["constants"] if c["name"] in claim["constants"] for e in c["entries"]
                 for n in e["lines"]}
        (spans,) = claim["lines"].values()
        assert {n for first, last in spans for n in range(first, last + 1)} == lines


@pytest.mark.parametrize("path", sorted(gallery_folder().glob("*.toml")), ids=lambda p: p.stem)
def test_every_entry_of_the_plant_has_its_line(path):
    text = path.read_text()
    lines, data = plant_lines(text), tomllib.loads(text)
    assert {f"mode[{q}].{key}" for q, mode in enumerate(data.get("mode", ())) for key in mode} <= lines.keys()
    assert {f"signals.{key}" for key in data["signals"]} <= lines.keys()
    for entry, line in lines.items():
        assert re.match(rf"\s*{entry.rsplit('.', 1)[-1]}\s*=", text.splitlines()[line - 1]), (entry, line)


def test_a_line_that_is_not_certain_is_not_named():
    text = '[a]\nnote = """\nb = 1\n"""\nb = 2\n"c d" = 3\n'
    assert plant_lines(text) == {"a.note": 2, "a.b": 5, "a.c d": None}


@pytest.mark.parametrize("layout", ["literal", "table", "loop"])
@pytest.mark.parametrize("variant", [v for v in VARIANTS if v != "big"])
@pytest.mark.parametrize("family", ["interval", "tnl"])
def test_constants_are_found_in_every_kind_of_c(family, variant, layout):
    design = stand_in(family, **VARIANTS[variant])
    real = "float64" if layout == "table" else "float32"
    p, texts = design.plant.target.prefix, firmware(design, real, layout)
    text = texts[f"{p}.c"].splitlines()
    found = constants(design, real, layout, texts[f"{p}.c"], texts[f"{p}.h"])
    assert sum(len(c.entries) for c in found) > 8
    for c in found:
        assert all(e.literal in text[n - 1] for e in c.entries for n in e.lines)


REAL = r"(?<![\w.])\d[\d.]*(?:e[-+]?\d+)?F?(?![\w.])"
MUTANTS = [  # what, pattern, replacement: of any C that emission prints; tables are dense and random
    ("sign", r"(= [^;=]*?) \+ ", r"\1 - "), ("lost term", r" [-+] \([^()=;]* \* [^()=;]*\)", ""),
    ("other framer", r"([-+*] (?:s|out)->x_)hi", r"\1lo"), ("other input", r"->u\[0\]\)", "->u[1])"),
    ("other measurement", r"(\* (?:s|in)->y\[)0(\]\))", r"\g<1>1\2"),
    ("term too many", r"(->x_hi\[0\] = )", r"\1s->u[0] + "),
    ("lost factor", r"\(k\[\d+\] \* ([^()]*)\)", r"\1"),
    ("column", r"k\[1\]", "k[2]"), ("no such column", r"k\[1\]", "k[999]"),
    ("row of the table", r"table\[[^;]*\];", "table[0U];"),
    ("swapped cases", r"case (\w+_MODE_)MODE_0:", r"case \1MODE_9:"),
    ("matrix index", r"\[q\]\[i\]\[j\]", "[0U][i][j]"), ("vector", r"\+= \((\w+\[q\]\[i\]\[j\] \* )s->", r"+= (\1in->"),
    ("bound of a loop", r"j < \w+_NX;", "j < 1U;"), ("accumulator", r"(lo|common) \+= ", r"\1 -= "),
    ("start of a sum", r"(common = )0\.0F?", r"\g<1>1.0F"), ("not C", r"(->x_hi\[0\] = )", r"\1+ ) "),
    ("function", r"_forward(_\d)?\(", "_fort("), ("range", r"(in->u\[0\] )<=", r"\1<"),
    ("box to start from", r"(s->x_hi\[1\] = )", r"\1-"),
    ("cut elsewhere", r"x_lo(\[\w\]) = (\w+_clip)", r"x_hi\1 = \2"),
    ("cut", r"clip\(x_lo\[0\], ", "clip(x_hi[0], "),
]


@cache
def printed(family, layout):
    """C that is accepted as it is."""
    design = stand_in(family, sizes=(2, 2, 2, 2))
    p, texts = design.plant.target.prefix, firmware(design, "float32", layout)
    constants(design, "float32", layout, texts[f"{p}.c"], texts[f"{p}.h"])
    return design, texts[f"{p}.c"], texts[f"{p}.h"]


@pytest.mark.parametrize("what, pattern, new", MUTANTS, ids=[m[0] for m in MUTANTS])
def test_a_changed_c_is_refused(what, pattern, new):
    tried = 0
    for family, layout in product(("interval", "tnl"), ("literal", "table", "loop")):
        design, text, header = printed(family, layout)
        code = blank(text)  # the patterns are for code, not for comments
        changed, count = re.subn(pattern, new, code, count=1)
        if count:
            tried += 1
            with pytest.raises(CertificateError):
                constants(design, "float32", layout, changed, header)
    assert tried


@names
def test_no_literal_of_the_maps_can_be_changed(folder):
    """Some numbers of the C in turn, doubled; zeros apart, which clear and compare."""
    design = design_of(folder)
    record = json.loads((folder / "resources.json").read_text())
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    code = blank(text)
    found = [m for m in re.finditer(REAL, code) if re.search("[.e]", m[0]) and float(m[0].rstrip("F"))]
    assert len(found) > 30
    for m in found[::max(1, len(found) // 10)]:
        changed = f"{code[:m.start()]}{2 * float(m[0].rstrip('F'))!r}{'F' * m[0].endswith('F')}{code[m.end():]}"
        with pytest.raises(CertificateError):
            constants(design, record["real"], record["layout"], changed, header)


@pytest.mark.parametrize("change", [(r"bucket \+= (\d+)U", "bucket += 99U"), (r"bucket -= (\d+)U", "bucket -= 99U"),
                                    (r"bucket > (\d+)U\)\s*\{\s*\S* = ", "bucket > 99U) { s->bucket = "),
                                    (r"bucket == 0U", "bucket == 1U")])
def test_a_changed_dwell_monitor_is_refused(change):
    folder = next(f for f in FOLDERS if design_of(f).observer.supervision.monitors_dwell)
    record = json.loads((folder / "resources.json").read_text())
    text, header = ((folder / f"{record['prefix']}.{end}").read_text() for end in "ch")
    changed, count = re.subn(*change, text, count=1)
    assert count == 1
    with pytest.raises(CertificateError, match="dwell"):
        constants(design_of(folder), record["real"], record["layout"], changed, header)


def test_a_claim_without_condition_is_refused():
    """A new criterion whose sentence nobody has given a condition must not slip through."""
    design = design_of(GENERATED / "cart_tnl-interval")
    good = design.proved["float32"]
    for sentences in ([*good, "Something else is proved"], good[:-1], [*good[:-1], "Something else is proved"]):
        object.__setattr__(design, "proved", design.proved | {"float32": sentences})
        try:
            with pytest.raises(CertificateError, match="codegen/assurance/claims.py"):
                claims(design, "float32")
        finally:
            object.__setattr__(design, "proved", design.proved | {"float32": good})


def relaxed(tables, name, factor):
    """A table with one vector or matrix scaled."""
    return replace(tables, **{name: (getattr(tables, name) * factor).astype(tables.dtype)})


@pytest.mark.parametrize("where, change, claim", [
    ("tables", lambda t: relaxed(t, "d_hi", 0.5), "containment: offset d"),
    ("tables", lambda t: relaxed(t, "a_lo", 0.999), "containment: offset a"),
    ("tables", lambda t: relaxed(t, "c_hi", 0.999), "containment: offset c"),
    ("tables", lambda t: relaxed(t, "M_hi", -1.0), "nonnegative: smallest entry of M"),
    ("tables", lambda t: relaxed(t, "x0_hi", 0.9), "ranges: x0 box"),
    ("tables", lambda t: relaxed(t, "box", 0.9), "bounded: state box"),
    ("certificate", lambda c: c | {"mu": 0.5 * c["mu"]}, "linf: smallest pivot"),
    ("certificate", lambda c: c | {"rho": 1 + 0.5 * (c["rho"] - 1)}, "linf: rho P_l - P_q|jump"),
    ("certificate", lambda c: c | {"level": 0.99 * c["level"]}, "linf: square of the claimed level"),
    ("certificate", lambda c: c | {"dwell_add": c["dwell_add"] * 4}, "monitor: dwell time watched"),
    ("supervision", lambda s: replace(s, dwell_limit=s.dwell_limit + 1), "monitor: bucket's limit")])
def test_margins_refuse_what_does_not_hold(where, change, claim):
    design = design_of(next(f for f in FOLDERS if design_of(f).observer.supervision.monitors_dwell))
    tables, s, cert = design.observer.tables["float32"], design.observer.supervision, design.certificate["float32"]
    assert all(m.holds for c in claims(design, "float32") for m in c.margins)
    changed = {"tables": tables, "supervision": s, "certificate": cert} | {
        where: change({"tables": tables, "supervision": s, "certificate": cert}[where])}
    observer = type(design.observer)({"float32": changed["tables"]}, changed["supervision"])
    spoilt = replace(design, observer=observer, certificate={"float32": changed["certificate"]})
    with pytest.raises(CertificateError, match=claim):
        claims(spoilt, "float32")


def test_a_design_for_width_has_its_conditions():
    design = codegen.design(load("cart"), "tnl-interval", criterion="width")
    cert = design.certificate["float32"]
    found = {c.id: c for c in claims(design, "float32")}
    assert cert["kind"] == "width" and "p' M_q <= (1 - a) p'" in found["width"].formula
    spoilt = replace(design, certificate={"float32": cert | {"level": 0.99 * cert["level"]}})
    with pytest.raises(CertificateError, match="width: claimed level"):
        claims(spoilt, "float32")


@names
def test_the_untouched_file_is_accepted(folder, made):
    assert check_assurance(made(folder)) == read(made(folder))


def shift_a_line(data):
    next(e for c in data["constants"] for e in c["entries"] if e["lines"])["lines"][0] += 1


def another_literal(data):
    next(e for c in data["constants"] for e in c["entries"] if e["literal"])["literal"] = "9.0F"


def a_rosier_margin(data):
    data["claims"][1]["margins"][0]["margin"] *= 2


def a_claim_less(data):
    del data["claims"][2]


def a_check_less(data):
    data["checks"].pop()


def a_false_pass(data):
    data["checks"][-1] |= {"state": "passed", "ran_on": {"cart.c": "0" * 64}}


def another_plant_line(data):
    data["claims"][0]["plant"][0]["line"] += 1


@pytest.mark.parametrize("tamper", [shift_a_line, another_literal, a_rosier_margin, a_claim_less, a_check_less,
                                    a_false_pass, another_plant_line], ids=lambda f: f.__name__)
def test_a_changed_file_is_refused(tamper, cart):
    data = read(cart)
    before = json.dumps(data)
    tamper(data)
    assert json.dumps(data) != before
    rewrite(cart, data)
    with pytest.raises(CertificateError, match=r"assurance\.json"):
        check_assurance(cart)


def test_c_that_moved_by_a_line_is_refused(cart):
    source = cart / "cart.c"
    source.write_text("\n" + source.read_text())
    with pytest.raises(CertificateError, match="files.cart.c"):
        check_assurance(cart)


def test_a_missing_file_is_refused(cart):
    (cart / "assurance.json").unlink()
    with pytest.raises(CertificateError, match="cannot be read"):
        check_assurance(cart)


@names
def test_the_same_design_gives_the_same_bytes_without_a_date(folder, made, tmp_path):
    again = Path(shutil.copytree(made(folder), tmp_path / "again"))
    document.write(again, design_of(folder))
    text = (again / "assurance.json").read_text()
    assert text == (made(folder) / "assurance.json").read_text()
    assert not re.search(r"20\d\d-\d\d-\d\d|\d\d:\d\d:\d\d", text) and str(tmp_path) not in text
