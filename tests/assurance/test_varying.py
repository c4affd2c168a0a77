"""Constants, lines, claims and margins of C with parameters and radii; what was changed by hand must be found."""

from __future__ import annotations

import importlib
import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.varying import HEATER, HELD, changed_design, heater_design

import codegen
from codegen.assurance import document
from codegen.assurance.c_reader import blank
from codegen.assurance.claims import claims
from codegen.assurance.places import constants
from codegen.emit.package import firmware, generate
from codegen.errors import CertificateError
from codegen.pipeline import check_assurance
from codegen.plant.load import load

LATE = HELD.replace("[initial]", "[switching]\nlate = true\n[initial]")
NOISE = HEATER.replace('bounds = [-0.1, 0.1] }]\nf', 'bounds = [0.05, 0.3] }]\nf')  # that never vanishes
DESIGNS = {  # both families, one and two parameters, the mean of both ends, opposite bounds, a mode told late
    "interval": lambda: heater_design(),
    "mean": lambda: heater_design(HELD, "tnl-interval-lpv"),
    "start": lambda: heater_design(HEATER, "tnl-interval-lpv"),
    "two": lambda: codegen.design(load("zammali_lpv_dt"), "lpv-interval"),
    "signed": lambda: codegen.design(load("lamouchi"), "component-interval"),
    "changed": changed_design,
    "late": lambda: heater_design(LATE, "tnl-interval-lpv"),
    "negative": lambda: heater_design(NOISE, "tnl-interval-lpv", criterion="linf"),
}
LAYOUTS = ("literal", "table")  # loops are straight here, as in the second
kinds = pytest.mark.parametrize("name", DESIGNS)


@cache
def design_of(name):
    return DESIGNS[name]()


@cache
def printed(name, layout):
    """C without comments, in the order of lines, and its header."""
    design = design_of(name)
    real = "float64" if name == "two" else "float32"
    p, texts = design.plant.target.prefix, firmware(design, real, layout)
    return design, real, blank(texts[f"{p}.c"]), texts[f"{p}.h"]


def found_in(name, layout, code=None):
    design, real, text, header = printed(name, layout)
    return constants(design, real, layout, text if code is None else code, header)


@pytest.mark.parametrize("layout", [*LAYOUTS, "loop"])
@kinds
def test_every_number_is_found_where_it_stands(name, layout):
    design, real, text, _ = printed(name, layout)
    t, lines = design.observer.tables[real], text.splitlines()
    found = {}
    for c in found_in(name, layout):
        for e in c.entries:
            found.setdefault((c.name, c.mode, *e.index), []).append(e)
            assert all(e.literal in lines[n - 1] for n in e.lines)
            assert bool(e.lines) or e.value == 0
    modes = [m.name for m in design.plant.modes]
    for table, label in [(k, f"{k}_theta") for k in "MGL"] + [(k, k) for k in ("R", "S", "E", "Ra", "Sa")] + [
            ("theta_lo", "theta_lo"), ("theta_hi", "theta_hi")]:
        for (q, *index), value in np.ndenumerate(getattr(t.vary, table)):
            entries = found[label, modes[q], *index]
            assert all(e.value == float(value) and (e.lines or not value) for e in entries), (table, q, index)
            assert len(entries) == (2 if name == "late" and not label.startswith("theta") else 1)
    assert [key for key in found if key[0] == "theta_weight"] == (
        [("theta_weight", m, 0) for m in modes] if t.vary.midpoint else [])


NUMBER = r"(?<![\w.])\d+\.\d+(?:e[-+]?\d+)?F?(?![\w.])"


@kinds
def test_no_literal_can_be_changed(name):
    """Some numbers of the C in turn, doubled; zeros apart, which clear and compare."""
    for layout in LAYOUTS:
        code = printed(name, layout)[2]
        numbers = [m for m in re.finditer(NUMBER, code) if float(m[0].rstrip("F"))]
        assert len(numbers) > 30
        for m in numbers[::max(1, len(numbers) // 8)]:
            changed = f"{code[:m.start()]}{2 * float(m[0].rstrip('F'))!r}{'F' * m[0].endswith('F')}{code[m.end():]}"
            with pytest.raises(CertificateError):
                found_in(name, layout, changed)


COEFFICIENT = r"(_real [MGL]_\d_\d = [^;]*?)"
MUTANTS = {  # pattern, replacement: of any C with parameters or radii
    "sign of a slope": (COEFFICIENT + r" \+ (\([^()]* \* th_)", r"\1 - \2"),
    "lost slope": (COEFFICIENT + r" [-+] \([^()]* \* th_\d\)", r"\1"),
    "other parameter": (COEFFICIENT + r"th_0", r"\1th_1"),
    "other parameter read": (r"(th_0 = [^;]*theta\[)0", r"\g<1>1"),
    "weight of the mean": (r"0\.5F \* \(", "0.25F * ("),
    "mean of one end": (r"s->theta\[0\] \+ in->theta\[0\]", "s->theta[0] + s->theta[0]"),
    "other end": (r"(th_0 = )s->theta", r"\1in->theta"),
    "mean of more": (r"(th_0 = [^;]*theta\[0\])\)", r"\1 + in->u[0])"),
    "smaller magnitude": (r"(m_0 = \([^;]*?) > ", r"\1 < "),
    "magnitude of one bound": (r"(m_0 = [^;]* \? )-([^;]*?) : [^;]*;", r"\1-\2 : -\2;"),
    "magnitude of another state": (r"(m_)0( = \([^;]*;)", r"\g<1>1\2"),
    "input with its sign": (r"(a_0 = [^;]* \? )-", r"\1"),
    "magnitude of another input": (r"(a_0 = [^;]*->u\[)0(\];)", r"\g<1>1\2"),
    "positive bound alone": (r"(m_0 = )\([^;]*: ([^;]*;)", r"\1\2"),
    "negative bound alone": (r"(m_0 = )\([^;]*\? ([^;]*?) : [^;]*;", r"\1\2;"),
    "input as positive": (r"(a_0 = )\([^;]*: ([^;]*;)", r"\1\2"),
    "gain with the other sign": (r"(\* \()(L_\d_\d\)\))", r"\1-\2"),
    "negative gain with its sign": (r"(\* \()-(L_\d_\d\)\))", r"\1\2"),
    "gain with its sign": (r"\? -(L_\d_\d) : (L_\d_\d)", r"? \1 : \2"),
    "gain as positive": (r"\(\(L_\d_\d < 0\.0F?\) \? -L_\d_\d : (L_\d_\d)\)", r"\1"),
    "another gain": (r"(apart_0 = [^;]*\bL_)0(_0)", r"\g<1>1\2"),
    "lost radius": (r"(apart_\d = [^;]*) \+ \([^()]*\* m_1\)", r"\1"),
    "radius of another state": (r"(apart_\d = [^;]*\* m_)1", r"\g<1>0"),
    "radius that tightens": (r"(hi_\d = [^;]*) \+ apart", r"\1 - apart"),
    "radius left out": (r"(lo_\d = [^;]*) - apart_\d", r"\1"),
    "radius of another row": (r"([-+] apart_)0", r"\g<1>1"),
    "common part of another row": (r"(lo_0 = common_)0", r"\g<1>1"),
    "common part twice": (r"(hi_0 = )common_0", r"\1common_0 + common_0"),
    "coefficient of another state": (r"(\(M_\d_\d \* \w+->x_\w\w\[)0", r"\g<1>1"),
    "coefficient of the other bound": (r"(\(M_\d_\d \* \w+->x_)lo", r"\1hi"),
    "another coefficient": (r"\(M_0_0 \* ", "(M_1_0 * "),
    "coefficient scaled": (r"\(M_0_0 \* ", "(0.5F * "),
    "local that nobody reads": (r"(const \w+_real lo_0)", r"const \g<1>9 = 1.0F; \1"),
    "defined twice": (r"(const \w+_real )(lo_0)( =)", r"\1\2 = 1.0F; \1\2\3"),
    "bound of theta": (r"(in->theta\[0\]) >= ", r"\1 > "),
    "other bound of theta": (r"(in->theta\[0\] >= )(?:-?[\d.e+-]+F?|least\[in->mode\]\[0\])\)", r"\g<1>-77.0F)"),
    "bound of another parameter": (r"(in->theta\[)0(\] <=)", r"\g<1>1\2"),
    "bounds of the first mode": (r"most\[in->mode\]", "most[0U]"),
    "more compared": (r"(in->theta\[0\] >= [^)]*\))", r"\1 && (in->y[0] >= 0.0F)"),
    "opposite bound": (r"([-+] \((?:k\[\d+\]|\d[^()*]*) \* (?:out|s)->x_)lo(\[\d\]\))", r"\1hi\2"),
}


@pytest.mark.parametrize("what", MUTANTS)
def test_a_changed_c_is_refused(what):
    pattern, new = MUTANTS[what]
    tried = 0
    for name in DESIGNS:
        for layout in LAYOUTS:
            code = printed(name, layout)[2]
            changed, count = re.subn(pattern, new, code, count=1)
            if count and changed != code:
                tried += 1
                with pytest.raises(CertificateError):
                    found_in(name, layout, changed)
        if tried >= 2:  # in both layouts of one design is enough
            break
    assert tried


def test_the_maps_of_a_late_mode_are_read_too():
    code = printed("late", "table")[2]
    for function in ("forward_late", "blind_late"):
        at = code.index("{", code.index(f"heater_{function}("))
        m = next(m for m in re.compile(NUMBER).finditer(code, at) if float(m[0].rstrip("F")))
        with pytest.raises(CertificateError, match=function):
            found_in("late", "table", f"{code[:m.start()]}7.5F{code[m.end():]}")


@kinds
def test_lines_move_with_the_c(name):
    before, after = found_in(name, "table"), found_in(name, "table", "\n" + printed(name, "table")[2])
    assert after != before
    for a, b in zip(before, after, strict=True):
        assert all([n + 1 for n in x.lines] == list(y.lines) for x, y in zip(a.entries, b.entries, strict=True))


@kinds
def test_claims_name_parameters_sampling_and_signs(name):
    design = design_of(name)
    for real in ("float32", "float64"):
        found = {c.id: c for c in claims(design, real)}
        assert [c.text for c in found.values()][:len(design.proved[real])] == design.proved[real]
        assert ("signs" in found) == (name == "signed") and ("nonnegative" in found) == (name != "signed")
        assert ("sampling" in found) == (design.plant.kind == "continuous")
        assert ("parameters" in found) == bool(design.plant.theta and name not in ("signed", "changed"))
        first = found["signs" if name == "signed" else "nonnegative"]
        assert {"signals.theta", "M_theta"} <= {*first.plant, *first.constants}
        assert ("theta" in first.text) == (name not in ("signed", "changed"))
        assert ("time.sample_period" in found["containment"].plant) == (design.plant.kind == "continuous")
        for c in found.values():
            module, _, function = c.code.rpartition(".")
            assert callable(getattr(importlib.import_module(module), function)), c.code


def vary(name, index, factor):
    """Scale one number of the Variation."""
    def change(t):
        values = getattr(t.vary, name).copy()
        values[index] *= factor
        return replace(t, vary=replace(t.vary, **{name: values}))
    return change


def change(name, factor):
    def act(t):
        return replace(t, change=replace(t.change, **{name: getattr(t.change, name) * np.float32(factor)}))
    return act


def table(name, index, factor):
    def change(t):
        values = getattr(t, name).copy()
        values[index] *= factor
        return replace(t, **{name: values})
    return change


@pytest.mark.parametrize("design, change, claim", [
    ("interval", vary("R", (0, 0, 0), 0.5), "containment: offset d"),
    ("interval", vary("Ra", (0, 0, 0), 0.5), "containment: offset a"),
    ("interval", vary("L", (0, 0, 0, 0), 1.01), "containment: offset d"),
    ("two", vary("M", (0, 0, 0, 0), -100), "nonnegative: smallest entry of M"),
    ("interval", vary("theta_hi", (0, 0), 0.99), "parameters: accepted theta"),
    ("signed", vary("R", (0, 0, 0), 0.5), "containment: offset d"),
    ("signed", table("d_hi", (0, 0), 0.9), "containment: offset d"),
    ("changed", change("e_hi", 0.5), "containment: offset e"),
    ("changed", change("b_lo", 0.5), "containment: offset b"),
    ("changed", change("X", 1.001), "containment: offset b"),
    ("changed", change("z_hi", 0.999), "bounded: range of z"),
    ("late", table("a_lo", (0, 0), 0.9), "containment: offset a"),
])
def test_margins_refuse_what_does_not_hold(design, change, claim):
    made = design_of(design)
    spoilt = replace(made, observer=type(made.observer)({"float32": change(made.observer.tables["float32"])},
                                                        made.observer.supervision))
    assert all(m.holds for c in claims(made, "float32") for m in c.margins)
    with pytest.raises(CertificateError, match=claim):
        claims(spoilt, "float32")


@pytest.mark.parametrize("path, factor, claim", [(("mu",), 0.5, "linf: smallest pivot"),
                                                 (("level",), 0.9, "linf: square of the claimed level"),
                                                 (("steady_box", "width", 0), 0.9, "ultimate-width: z - .M z . push")])
def test_margins_at_the_corners_refuse_what_does_not_hold(path, factor, claim):
    made = heater_design(HEATER, "lpv-interval", criterion="linf")
    cert = json.loads(json.dumps(made.certificate["float32"]))
    *way, last = path
    below = cert
    for key in way:
        below = below[key]
    below[last] *= factor
    assert any("corner 1 of theta" in m.where for c in claims(made, "float32") for m in c.margins)
    with pytest.raises(CertificateError, match=claim):
        claims(replace(made, certificate={"float32": cert}), "float32")


def test_the_file_says_where_parameters_come_from(tmp_path):
    folder = generate(design_of("interval"), tmp_path / "heater")
    document.write(folder, design_of("interval"))
    data = check_assurance(folder)
    text = design_of("interval").plant.text.splitlines()
    by_id = {c["id"]: c for c in data["claims"]}
    entries = {e["entry"]: e["line"] for e in by_id["sampling"]["plant"]}
    assert {"time.kind", "time.sample_period", "signals.theta", "mode[1].bounds"} <= entries.keys()
    assert all(re.match(rf"\s*{e.rpartition('.')[2]}\s*=", text[n - 1]) for e, n in entries.items())
    assert {e["entry"] for e in by_id["parameters"]["plant"]} == {"signals.theta", "mode[1].bounds"}
    assert by_id["parameters"]["constants"] == ["theta_lo", "theta_hi"] and by_id["parameters"]["margins"]
    assert next(c for c in data["checks"] if c["id"] == "independent")["state"] == "passed"
    for spoil in (lambda d: d["claims"][0]["plant"][0].update(line=1),
                  lambda d: next(c for c in d["constants"] if c["name"] == "R")["entries"][0].update(value=0.5)):
        spoilt = json.loads(json.dumps(data))
        spoil(spoilt)
        (folder / "assurance.json").write_text(json.dumps(spoilt))
        with pytest.raises(CertificateError, match=r"assurance\.json"):
            check_assurance(folder)
