"""Point observers guided by sliding modes: the state is held while the decision is right; tampering shows."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flint import arb
from helpers.checker import checker_of, is_proved, refuses_changes
from helpers.guided_point import CHOSEN, designed, plant, stand_in, tables, told
from helpers.small_modes import exact_course
from helpers.small_sliding import REFUSED
from helpers.tampering import scaled

import codegen
from codegen.analysis import sliding_measure
from codegen.analysis.mode_promise import unbound
from codegen.analysis.validate import judge
from codegen.certify import guided_point_certificate
from codegen.designs import claims_of, read_checked
from codegen.emit import firmware
from codegen.errors import CertificateError, DesignError
from codegen.observers import GuidedPointObserver, GuidedPointTables, Supervision
from codegen.plant.load import loads
from codegen.report.design_words import words_of
from codegen.report.firmware_words import gains
from codegen.report.verdict import purpose

RUNS, STEPS = 2, 60


@lru_cache
def courses(name: str):
    how = ((24, 4, 1), (24, 5, -1))
    return [exact_course(plant(name), ages, STEPS, seed, side) for ages, seed, side in how]


def lost(name, t, observer=GuidedPointObserver):
    """Samples at which a state is not held though the decision has been right since it was taken up; the answers."""
    runs, bad = courses(name), 0
    u, y, q = (np.stack([getattr(run, k) for run in runs]).reshape(RUNS, STEPS, -1) for k in ("u", "y", "q"))
    out = observer({t.real: t}, Supervision(assures=False)).run_many(u, y, q[..., 0], t.real)
    for i, run in enumerate(runs):
        for k in np.flatnonzero(~unbound(run, out.row(i))):
            bad += not all(arb(float(a)) <= b and b <= arb(float(c)) for a, b, c in
                           zip(out.x_lo[i, k], run.x[k], out.x_hi[i, k]))
            bad += bool(out.raw_bits[i, k])
    return bad, out


@pytest.mark.parametrize("name, real", [("box", "float32"), ("table", "float64"), ("parameters", "float32")])
def test_state_is_held_exactly_while_the_decision_is_right(name, real):
    bad, out = lost(name, tables(name, real))
    assert bad == 0 and not out.assured.any() and (out.raw_bits == 0).mean() > 0.5
    width = out.x_hi - out.x_lo
    assert np.all(width[out.age > tables(name, real).blank].max(axis=0) > 0) and width.min() < 0.3 * width.max()


class Outlives(GuidedPointObserver):
    """An observer that is not begun anew."""

    def _answered(self, t, step, kept, *rest):
        return super()._answered(t, step, np.ones_like(kept), *rest)


def test_other_ways_lose_the_state():
    t = tables("box", "float32")
    own = t.told
    assert lost("box", t, Outlives)[0] > 0
    for wrong in (replace(own, M=own.M[::-1]), replace(own, d=own.d + np.float32(0.1)),
                  replace(own, shape=replace(own.shape, g=0 * own.shape.g))):
        assert lost("box", replace(t, told=wrong))[0] > 0
    t = tables("parameters", "float32")  # what parameters do is in the set
    narrow = replace(t.told, shape=replace(t.told.shape, g=t.told.shape.g / 20))
    assert lost("parameters", replace(t, told=narrow))[0] > 0


def test_parts_go_together():
    """Refused before anything is proved: an observer that accepts less, another range, another set."""
    t, p = tables("box", "float32"), plant("box")
    cert = {"told": told("box", "float32")[1]}
    limits = {"x": p.limits("x"), "x0": (p.x0_lo, p.x0_hi)}
    for wrong, words in ((replace(t, u_hi=t.u_hi * 2), "u_hi"), (replace(t, x_hi=t.x_hi / 2), "ranges of x"),
                         (replace(t, set="ellipsoid"), "of a set"),
                         (replace(t, told=replace(t.told, shape=replace(t.told.shape, g=t.told.shape.g / 2))), "g|e")):
        with pytest.raises(CertificateError, match=words):
            guided_point_certificate.check(p, p.enclosed.modes, wrong, cert, limits)


# ---------------------------------------------------------------------------------------------- the whole way

@pytest.fixture(scope="module", name="designed")
def whole():
    return designed()


@pytest.fixture(scope="module")
def printed(designed):
    made = firmware(designed, "float32", "literal")
    return made["valve.c"], made["valve.h"]


def test_a_plant_the_whole_way(designed, tmp_path, monkeypatch):
    p, cert = designed.plant, designed.certificate["float32"]
    assert designed.observer.family == "guided_point" and not designed.observer.supervision.assures
    again = read_checked(designed.save(tmp_path / "design.json"))
    assert again.digest == designed.digest
    for real, t in designed.observer.tables.items():
        assert t.to_dict() == again.observer.tables[real].to_dict()
    run = codegen.simulate(p, "between samples")
    trace = designed.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == 0 and not trace.assured.any() and np.mean(trace.mode == run.q) > 0.6
    right = (trace.mode == run.q) & (trace.age > 10)
    assert np.abs(trace.x_hat - run.x)[right].max() < 0.1
    rows = cert["paced"]
    assert [r["dwell"] for r in rows] == [1, 2] and all(r["alarms"] < 0.01 and r["lost"] < 0.01 for r in rows)
    monkeypatch.setattr(sliding_measure, "PACES", (1.0,))
    monkeypatch.setattr(sliding_measure, "RUNS", 2)
    t = designed.observer.tables["float32"]
    wrong = replace(t, told=replace(t.told, d=t.told.d + np.float32(0.1)))
    (spoilt,) = sliding_measure.paced(p, GuidedPointObserver({"float32": wrong}, designed.observer.supervision),
                                      "float32")
    assert spoilt["alarms"] > 0.1 and spoilt["lost"] > 0.1


def test_report_says_what_is_not_promised(designed):
    found = words_of(designed, "float32")
    assert [len(table.rows) for table in found.bounds][1] == 2
    assert any("alarm means a fault" in text for text in found.not_guaranteed)
    assert not any("threshold" in text for text in found.not_guaranteed)
    assert [cell.text for cell in found.choice.head] == ["method", "design", "relative width", "level"]
    assert "raises an alarm where the measurements contradict it" in purpose(designed)
    assert gains(designed, "float32")[2].summary.startswith("The mode estimator: ")
    assert all(fault["by_delay"] == [None] for fault in designed.detection["float32"])


@pytest.mark.parametrize("place, words", [
    (("told", "shape", "g", 0, 0), "g|e"), (("told", "M", 1, 0, 0), "g|e"), (("d_lo", 1, 0), "d_lo"),
    (("v_hi", 0), "v_hi"), (("told", "x_hi", 0), "x")])
def test_tampering_is_caught(place, words, designed):
    data = scaled(designed.observer.tables["float32"].to_dict(), place, 0.3)
    with pytest.raises(CertificateError, match=words):
        claims_of(designed.plant, GuidedPointTables.from_dict(data), designed.certificate["float32"])


@pytest.mark.parametrize("old, new, words", [
    *REFUSED, ('kind = "continuous"', 'kind = "discrete"', "cannot be found there: needs a continuous plant"),
    ('set = "interval"', 'tables = "arbitrary"', 'expected "none" or "dwell"')])
def test_refusals(old, new, words):
    text = CHOSEN.replace(old, new)
    assert text != CHOSEN
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(text.replace("30.25", "30").replace("60.5", "60")))


# ---------------------------------------------------------------------------------------------- the independent checker

checker = checker_of("guided_point")


def test_the_checker_proves_it_too_and_reads_its_c(checker, designed, printed, tmp_path, capsys):
    is_proved(checker, designed, printed, tmp_path)
    assert "while the decision is right, error and residual stay in their boxes" in capsys.readouterr().out


@pytest.mark.parametrize("way, factor, words", [
    (("told", "shape", "g"), 0.9, "g"), (("told", "M"), 1.1, ""), (("told", "x_hi"), 0.9, "range of x"),
    (("told", "y_hi"), 0.5, "accepted beyond")])
def test_the_checker_refuses_what_is_false(way, factor, words, checker, designed):
    data = scaled(designed.observer.tables["float32"].to_dict(), way, factor)
    with pytest.raises(SystemExit, match=f"refused.*{words}"):
        checker.check_joint(data)
        checker.follower.check_told(data, designed.certificate["float32"]["told"], checker.read_sampled(CHOSEN))


CHANGES = ((r"(size\[VALVE_TOLD_MODES\]\[VALVE_TOLD_NX\]\[\w+\] = \{\s*\{[^{]*\{ )[\d.]+F", r"\g<1>9.0F"),
           (r"raw = 0U;\n\n    valve_lend", "raw = 0U; const float a = 1.5F;\n\n    valve_lend"),
           (r"valve_told_settle\(valve_told_state", "valve_told_settl(valve_told_state"))


def test_the_checker_refuses_another_c(checker, designed, printed):
    (text, header), t = printed, designed.observer.tables["float32"].to_dict()
    refuses_changes(lambda source: checker.check_source(source, header, t, "valve"), text, CHANGES)


def test_the_checker_reads_a_table(checker):
    t = tables("table", "float64").to_dict()
    made = firmware(stand_in("table", "float64"), "float64", "table")
    checker.check_source(made["valve.c"], made["valve.h"], t, "valve")
    pattern = r"(widest\[\w+\] = \{\s*)([\d.]+)"
    assert len(re.findall(pattern, made["valve.c"])) == 1
    with pytest.raises(SystemExit, match="the half widths from which a start"):
        checker.check_source(re.sub(pattern, r"\g<1>1\g<2>", made["valve.c"]), made["valve.h"], t, "valve")
