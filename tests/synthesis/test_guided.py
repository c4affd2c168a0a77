"""Framers guided by sliding modes: the state is held while the decision is right; wrong ways and tampering show."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest
from flint import arb
from helpers.checker import checker_of, is_proved
from helpers.guided import plant, stand_in, tables, told
from helpers.scripts import ROOT
from helpers.small_modes import TEXT, exact_course
from helpers.small_sliding import REFUSED
from helpers.tampering import scaled

import codegen
from codegen.analysis import sliding_measure
from codegen.analysis.mode_promise import unbound
from codegen.analysis.validate import judge
from codegen.certify import guided_certificate
from codegen.designs import claims_of, read_checked, read_design
from codegen.emit import firmware
from codegen.emit.cprint import literal
from codegen.errors import CertificateError, DesignError
from codegen.observers import GuidedObserver, GuidedTables, SlidingObserver, SlidingTables, Supervision
from codegen.observers import guided as module
from codegen.plant.load import loads
from codegen.report.design_words import words_of
from codegen.synthesis import mode_sliding

GALLERY = ROOT / "generated" / "valve_sliding_lpv-interval"
TURNED = module.turned
NAMES, RUNS, STEPS = ("one input", "no input, two outputs"), 4, 80


@lru_cache
def courses(name: str):
    """With parameters modes that last: only narrow bounds tell what these do from what framers start with."""
    how = ((24, 3, 0), (24, 4, 1), (24, 5, -1), (60, 6, 0)) if name != "parameters" else (
        (70, 4, 0), (70, 5, 0), (70, 7, 0), (70, 8, 0))
    return [exact_course(plant(name), ages, STEPS, seed, side) for ages, seed, side in how]


def lost(name, t, observer=GuidedObserver):
    """Samples at which a state is not held though the decision has been right since it was taken up; the answers."""
    runs, bad = courses(name), 0
    u, y, q, theta = (np.stack([getattr(run, k) for run in runs]).reshape(RUNS, STEPS, -1)
                      for k in ("u", "y", "q", "theta"))
    out = observer({t.real: t}, Supervision(assures=False)).run_many(u, y, q[..., 0], t.real, theta=theta)
    for i, run in enumerate(runs):
        free = ~unbound(run, out.row(i))
        for k in np.flatnonzero(free):
            bad += not all(arb(float(a)) <= b and b <= arb(float(c)) for a, b, c in
                           zip(out.x_lo[i, k], run.x[k], out.x_hi[i, k]))
            bad += bool(out.raw_bits[i, k])
    return bad, out


@pytest.mark.parametrize("name, real", [(NAMES[0], "float32"), (NAMES[1], "float64"), ("parameters", "float32"),
                                        ("turned", "float32")])
def test_state_is_held_exactly_while_the_decision_is_right(name, real):
    t = tables(name, real)
    bad, out = lost(name, t)
    assert bad == 0 and not out.assured.any()
    own = SlidingObserver({real: t}, Supervision(assures=False))
    false, wide = lost(name, t, type("Alone", (SlidingObserver,), {}))
    assert false == 0 and own.bits(t) == 1 and np.mean(out.x_hi - out.x_lo) < 0.9 * np.mean(wide.x_hi - wide.x_lo)


class Outlives(GuidedObserver):
    """Framers that are not begun anew."""

    def _answered(self, t, step, kept, *rest):
        return super()._answered(t, step, np.ones_like(kept), *rest)


def test_other_ways_lose_the_state():
    t = tables(NAMES[0], "float32")
    own = t.told
    assert lost(NAMES[0], t, Outlives)[0] > 0
    assert lost(NAMES[0], replace(t, told=replace(own, M_hi=own.M_hi[::-1], M_lo=own.M_lo[::-1])))[0] > 0
    assert lost(NAMES[0], replace(t, told=replace(own, d_hi=0 * own.d_hi, d_lo=0 * own.d_lo)))[0] > 0
    t = tables("parameters", "float32")
    vary = t.told.vary
    for narrow in ({"R": 0 * vary.R}, {"S": 0 * vary.S}):
        assert lost("parameters", replace(t, told=replace(t.told, vary=replace(vary, **narrow))))[0] > 0


@pytest.mark.parametrize("part", ["z of the start", "Z", "X", "d_hi"])
def test_other_coordinates_lose_the_state(part, monkeypatch):
    """z that is carried on from before a start; maps and offsets that are not those of the tables."""
    t = tables("turned", "float32")
    own, c = t.told, t.told.change
    if part == "z of the start":
        monkeypatch.setattr(module, "turned", lambda t, moved, x, z: TURNED(t, np.ones_like(moved), x, z))
    wrong = {"d_hi": {"d_hi": 0 * own.d_hi, "d_lo": 0 * own.d_lo}, "Z": {"change": replace(c, Z=0.9 * c.Z)},
             "X": {"change": replace(c, X=c.X[::-1])}}.get(part, {})
    assert lost("turned", replace(t, told=replace(own, **wrong)))[0] > 0


def test_parts_go_together():
    """Refused before anything is proved: framers that accept less, another range, parameters by mode."""
    t, cert = tables(NAMES[0], "float32"), {"told": told(NAMES[0], "float32")[1]}
    for wrong, words in ((replace(t, u_hi=t.u_hi * 2), "u_hi"), (replace(t, x_hi=t.x_hi / 2), "ranges of x"),
                         (replace(t, told=replace(t.told, d_hi=t.told.d_hi / 2)), "d_hi")):
        with pytest.raises(CertificateError, match=words):
            guided_certificate.check(plant(NAMES[0]), plant(NAMES[0]).observed.modes, wrong, cert)
    t = tables("parameters", "float32")
    vary = t.told.vary
    apart = replace(vary, theta_hi=vary.theta_hi * np.array([[1], [0.5]], np.float32))
    with pytest.raises(CertificateError, match="differ between modes"):
        guided_certificate.check_joint(replace(t, told=replace(t.told, vary=apart)))


# ---------------------------------------------------------------------------------------------- the whole way

CHOSEN = TEXT.replace('method = "mode-set"', 'method = "lpv-interval"\nmodes = "sliding"\ngains = { '
                                             "L = [[[0.7], [0]], [[0.7], [0]]] }")


@lru_cache
def designed():
    return codegen.design(loads(CHOSEN))


def test_a_plant_the_whole_way(tmp_path, monkeypatch):
    for name, value in (("PERIODS", (1.0,)), ("NOISES", (1.0,)), ("RUNS", 10)):
        monkeypatch.setattr(sliding_measure, name, value)
    made = designed()
    p, cert = made.plant, made.certificate["float32"]
    assert made.observer.family == "guided" and not made.observer.supervision.assures
    again = read_checked(made.save(tmp_path / "design.json"))
    assert again.digest == made.digest
    for real, t in made.observer.tables.items():
        assert t.to_dict() == again.observer.tables[real].to_dict()
    run = codegen.simulate(p, "between samples")
    trace = made.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == 0 and not trace.assured.any() and np.mean(trace.mode == run.q) > 0.6
    rows = cert["paced"]
    assert [r["dwell"] for r in rows] == [1, 2, 4] and rows[2]["wrong"] < rows[0]["wrong"] < 0.5
    assert all(r["alarms"] < 0.01 and r["lost"] < 0.01 and r["switches"] > 10 for r in rows)
    monkeypatch.setattr(sliding_measure, "PACES", (1.0,))
    t = made.observer.tables["float32"]
    wrong = replace(t, told=replace(t.told, d_hi=t.told.d_hi - np.float32(0.1)))
    (spoilt,) = sliding_measure.paced(p, GuidedObserver({"float32": wrong}, made.observer.supervision), "float32")
    assert spoilt["alarms"] > 0.1 and spoilt["lost"] > 0.1
    found = words_of(made, "float32")
    assert [len(table.rows) for table in found.bounds][1] == 3
    assert any("alarm means a fault" in text for text in found.not_guaranteed)
    assert "a decision that is not right" in " ".join(made.claims("float32"))


@pytest.mark.parametrize("place, words", [
    (("told", "d_hi", 0, 0), "d_hi"), (("told", "M_hi", 1, 0, 0), "d_|a_"), (("d_lo", 1, 0), "d_lo"),
    (("v_hi", 0), "v_hi"), (("told", "x_hi", 0), "x")])
def test_tampering_is_caught(place, words):
    data = scaled(designed().observer.tables["float32"].to_dict(), place, 0.3)
    with pytest.raises(CertificateError, match=words):
        claims_of(designed().plant, GuidedTables.from_dict(data), designed().certificate["float32"])


def test_an_estimator_alone_bears_parameters():
    """As bounded unknowns: wider ones are not in its offsets."""
    kept = read_design(GALLERY)
    t, cert = kept.observer.tables["float32"], kept.certificate["float32"]
    own = SlidingTables(**{f.name: getattr(t, f.name) for f in fields(SlidingTables)})
    assert mode_sliding.inapplicable(kept.plant) is None and len(claims_of(kept.plant, own, cert)) == 6
    with pytest.raises(CertificateError, match="not far enough"):
        claims_of(loads(kept.plant.text.replace("[-0.1, 0.1], rate", "[-0.15, 0.15], rate")), own, cert)


@pytest.mark.parametrize("old, new, words", REFUSED)
def test_refusals(old, new, words):
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(CHOSEN.replace(old, new).replace("30.25", "30").replace("60.5", "60")))


# ---------------------------------------------------------------------------------------------- the independent checker


checker = checker_of("guided")


@lru_cache
def printed():
    made = firmware(designed(), "float32", "literal")
    return made["valve.c"], made["valve.h"]


def test_the_checker_proves_it_too_and_reads_its_c(checker, tmp_path, capsys):
    is_proved(checker, designed(), printed(), tmp_path)
    assert "the framers hold x while the decision is right" in capsys.readouterr().out


@pytest.mark.parametrize("key, factor, words", [
    ("d_hi", 0.9, "d_hi"), ("M_lo", 1.1, ""), ("x_hi", 0.9, "range of x"), ("y_hi", 0.5, "accepted beyond")])
def test_the_checker_refuses_what_is_false(key, factor, words, checker):
    data = designed().observer.tables["float32"].to_dict()
    data["told"][key] = (np.array(data["told"][key]) * factor).tolist()
    with pytest.raises(SystemExit, match=f"refused.*{words}"):
        checker.check_joint(data)
        checker.driven.check_told(data, designed().certificate["float32"], checker.read_plant(CHOSEN))


def test_the_checker_reads_other_coordinates(checker):
    t, cert = tables("turned", "float32").to_dict(), {"told": told("turned", "float32")[1]}
    known = checker.read_plant(TEXT)
    checker.check_joint(t)
    checker.driven.check_told(t, cert, known)
    made = firmware(stand_in("turned"), "float32", "table")
    checker.check_source(made["valve.c"], made["valve.h"], t, "valve")
    with pytest.raises(SystemExit, match="a map is missing"):
        checker.check_source(made["valve.c"].replace("told_to_z(", "told_z("), made["valve.h"], t, "valve")
    for key in ("e_hi", "b_lo", "z_hi"):
        right = t["told"]["change"][key]
        t["told"]["change"][key] = [0.9 * x for x in right]
        with pytest.raises(SystemExit, match="refused: .*(offset|range of z)"):
            checker.driven.check_told(t, cert, known)
        t["told"]["change"][key] = right


@pytest.mark.parametrize("old, new, words", [
    ("bounds = [-0.1, 0.1], rate", "bounds = [-0.15, 0.15], rate", "offset of x_"),
    ("error = 0.005", "error = 1", "theta box"), ('"-4 - resistance"', '"-4 - 2*resistance"', "offset of x_")])
def test_the_checker_refuses_other_parameters(old, new, words, checker):
    """Of a plant whose parameters do more than tables hold: the estimator's offsets, the framers' bounds."""
    data = json.loads((GALLERY / "design.json").read_text())
    data["tables"] = {"float32": (t := data["tables"]["float32"])}
    assert old in data["plant"]["toml"]
    data["plant"]["toml"] = data["plant"]["toml"].replace(old, new)
    with pytest.raises(SystemExit, match=f"refused.*{words}"):
        checker.sliding.check_design(data)
        checker.driven.check_told(t, data["certificate"]["float32"], checker.read_plant(data["plant"]["toml"]))


@pytest.mark.parametrize("part", ["framers", "estimator"])
def test_the_checker_refuses_another_c(part, checker):
    """A constant of either that is another number in the C."""
    t, (text, header) = designed().observer.tables["float32"], printed()
    checker.check_source(text, header, t.to_dict(), "valve")
    old = literal(abs(float(t.told.d_hi[0, 0] if part == "framers" else t.d_hi[0, 0])), "float32")
    assert old in text
    with pytest.raises(SystemExit, match="refused"):
        checker.check_source(text.replace(old, "0.7654321F"), header, t.to_dict(), "valve")
