"""Filters guided by sliding modes: no estimate beyond its bound while the decision is right; tampering shows."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.checker import checker_of, is_proved, refuses_changes
from helpers.guided_filter import CHOSEN, designed, made, tables
from helpers.small_modes import exact_course
from helpers.small_sliding import REFUSED, plant
from helpers.tampering import scaled

import codegen
from codegen.analysis import panels, plots, sliding_measure
from codegen.analysis.mode_promise import unbound
from codegen.analysis.replay import table
from codegen.analysis.validate import judge
from codegen.certify import loose_filter
from codegen.designs import claims_of, read_checked
from codegen.emit import firmware
from codegen.errors import CertificateError, DesignError
from codegen.observers import GuidedFilterObserver, GuidedFilterTables, Supervision
from codegen.plant.load import loads
from codegen.report.design_words import words_of
from codegen.report.firmware_words import gains
from codegen.report.verdict import purpose

RUNS, STEPS = 4, 60


@lru_cache
def courses(name: str):
    return [exact_course(plant(name), 24, STEPS, seed, side) for seed, side in ((4, 1), (5, -1), (6, 0), (7, 0))]


def beyond(name, t, observer=GuidedFilterObserver):
    """Samples with an estimate beyond its bound though the decision has been right since it was taken up; answers."""
    runs = courses(name)
    u, y, q = (np.stack([getattr(run, k) for run in runs]).reshape(RUNS, STEPS, -1) for k in ("u", "y", "q"))
    out = observer({t.real: t}, Supervision(assures=False)).run_many(u, y, q[..., 0], t.real)
    right = np.array([~unbound(run, out.row(i)) for i, run in enumerate(runs)])
    return int(np.sum((out.raw_bits >> 1 != 0) & right)), out, right


@pytest.mark.parametrize("name, real", [("one input", "float32"), ("parameters", "float64")])
def test_no_estimate_is_beyond_its_bound_while_the_decision_is_right(name, real):
    t, certs = made(name, real)
    for demand in loose_filter.demands(plant(name).enclosed.modes, t.told, certs):
        demand.require()
    bad, out, right = beyond(name, t)
    assert bad == 0 and right.mean() > 0.5 and not out.assured.any()
    share = np.abs(out.f_hat) / out.f_bound
    assert 0.2 < share[right].max() <= 1 and out.f_bound[right].min() < 0.05 * out.f_bound.max()


class Outlives(GuidedFilterObserver):
    """A filter that is not begun anew."""

    def _answered(self, t, step, kept, *rest):
        return super()._answered(t, step, np.ones_like(kept), *rest)


def test_other_ways_go_beyond():
    t = tables("one input", "float32")
    own = t.told
    assert beyond("one input", t, Outlives)[0] > 0
    for wrong in (replace(own, M=own.M[::-1], G=own.G[::-1]), replace(own, E=-12 * own.E), replace(own, h=own.h / 4)):
        assert beyond("one input", replace(t, told=wrong))[0] > 0


# ---------------------------------------------------------------------------------------------- the whole way

@pytest.fixture(scope="module", name="designed")
def whole():
    return designed()


def test_a_plant_the_whole_way(designed, tmp_path, monkeypatch):
    p = designed.plant
    assert designed.observer.family == "guided_filter" and not designed.observer.supervision.assures
    again = read_checked(designed.save(tmp_path / "design.json"))
    assert again.digest == designed.digest
    for real, t in designed.observer.tables.items():
        assert t.to_dict() == again.observer.tables[real].to_dict()
    run = codegen.simulate(p, "between samples")
    trace = designed.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == 0 and not trace.raw_bits.any() and np.mean(trace.mode == run.q) > 0.6
    low = replace(trace, f_bound=trace.f_bound / 9)
    assert judge(p, p.scenarios[0], run, low, []).lost > 5
    assert "f_bound.sensor" in table(p, run, trace).splitlines()[0]
    (row,) = designed.certificate["float32"]["paced"]
    assert row["alarms"] < 0.01 and row["lost"] < 0.01
    monkeypatch.setattr(sliding_measure, "PACES", (1.0,))
    monkeypatch.setattr(sliding_measure, "RUNS", 2)
    t = designed.observer.tables["float32"]
    wrong = GuidedFilterObserver({"float32": replace(t, told=replace(t.told, h=t.told.h / 9))},
                                 designed.observer.supervision)
    (spoilt,) = sliding_measure.paced(p, wrong, "float32")
    assert spoilt["alarms"] > 0.1


def test_a_fault_is_found_that_the_estimator_takes_for_part_of_the_plant(designed):
    """In a mode that stays a sensor that is off: the estimator's bounds go with it, the estimate settles at it."""
    m, x, y = designed.plant.enclosed.modes[0], np.array([0.0, 0.2]), []
    u = np.ones((360, 1))
    for k in range(len(u)):
        y.append(m.C @ x + m.D @ u[k] + 0.008 * (k >= 160))
        x = m.A @ x + m.B @ u[k]
    trace = designed.observer.run(u, np.array(y))
    found = trace.raw_bits == 2
    assert not trace.raw_bits[:160].any() and not (trace.raw_bits & 1).any() and found.sum() > 20
    assert np.abs(trace.f_hat[found] - 0.008).max() < 0.001


def test_report_says_what_is_not_promised(designed):
    found = words_of(designed, "float32")
    assert found.bounds[-1].caption.startswith("The largest estimates") and len(found.bounds[-1].rows) == 2
    assert any("alarm means a fault" in text for text in found.not_guaranteed)
    assert any("while the decision is right" in fact.text for fact in found.facts)
    assert "estimate of sensor" in purpose(designed) and "without a guarantee" in purpose(designed)
    assert gains(designed, "float32")[3].summary.startswith("The mode estimator: ")
    assert all(fault["by_delay"] == [None] for fault in designed.detection["float32"])


def test_the_estimate_is_drawn_and_where_it_is_beyond_its_bound(designed):
    p = designed.plant
    run = codegen.simulate(p, "between samples")
    trace = designed.observer.run(run.u, run.y)
    for f_bound, some in ((trace.f_bound, False), (trace.f_bound / 9, True)):
        drawn = plots.residual_figure(plots.whole(p, run, replace(trace, f_bound=f_bound))).axes
        (axis,) = (a for a in drawn if a.get_title(loc="left").startswith("Fault sensor: estimate") or
                   a.get_title().startswith("Fault sensor: estimate"))
        assert any(line.get_color() == panels.ALARM for line in axis.lines) == some


@pytest.mark.parametrize("place, factor, words", [
    (("told", "h", 0, 3, 1), 0.3, "threshold is"), (("told", "M", 1, 3, 3), 1.3, "not kept|level"),
    (("d_lo", 1, 0), 0.3, "d_lo"), (("told", "limit", 2), 0.1, "beyond its limit"),
    (("told", "x_hi", 0), 0.9, "ranges of x"),
    (("told", "y_hi", 0), 0.9, "y_hi is beyond"), (("told", "floor",), 0.0, "floor")])
def test_tampering_is_caught(place, factor, words, designed):
    data = scaled(designed.observer.tables["float32"].to_dict(), place, factor)
    with pytest.raises(CertificateError, match=words):
        claims_of(designed.plant, GuidedFilterTables.from_dict(data), designed.certificate["float32"])


@pytest.mark.parametrize("old, new, words", [
    *REFUSED, ('kind = "continuous"', 'kind = "discrete"', "cannot be found there: needs a continuous plant"),
    ('modes = "sliding"', 'modes = "sliding"\nthreshold = "calibrated"', 'expected "guaranteed"')])
def test_refusals(old, new, words):
    text = CHOSEN.replace(old, new)
    assert text != CHOSEN
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(text.replace("30.25", "30").replace("60.5", "60")))


# ---------------------------------------------------------------------------------------------- the independent checker

checker = checker_of("guided_filter")


@pytest.fixture(scope="module")
def printed(designed):
    made = firmware(designed, "float32", "literal")
    return made["valve.c"], made["valve.h"]


def test_the_checker_proves_it_too_and_reads_its_c(checker, designed, printed, tmp_path, capsys):
    data = is_proved(checker, designed, printed, tmp_path)
    assert "no estimate is beyond its bound without a fault" in capsys.readouterr().out
    data["tables"]["float32"]["told"]["h"][0][4][1][0] *= 0.3
    with pytest.raises(SystemExit, match="refused"):
        checker.main(tmp_path, data, {"prefix": "valve", "real": "float32"})


CHANGES = ((r"(begun\[VALVE_MODES\]\[VALVE_NS\] = \{\s*\{ )[^,]*,", r"\g<1>0.5F,"),
           (r"(?s)(threshold\[\w+\].*?\{ \{ )(?=[\d])", r"\g<1>1"),
           (r"(limit\[VALVE_NS\] = \{\s*)", r"\g<1>1"),
           (r"(uint32_t raw;\n\n    if \(!kept\))", r"const float a = 1.5F; \1"),
           (r">> (\d)U\) : \(VALVE_ROWS", r">> 1\1U) : (VALVE_ROWS"))


def test_the_checker_refuses_another_c(checker, designed, printed):
    (text, header), t = printed, designed.observer.tables["float32"].to_dict()
    refuses_changes(lambda source: checker.check_source(source, header, t, "valve"), text, CHANGES)
