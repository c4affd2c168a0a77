"""Residual sets in the report: what is drawn is what the firmware's test accepts, and the exact set lies inside."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.points import VARIANTS, point_design, random_plant
from helpers.reports import StandInDriver, outcomes_of, output_folder, small_design

from codegen.algebra import zonotope
from codegen.analysis import plots as drawn
from codegen.analysis import set_compare, set_history
from codegen.analysis.panels import joint_only
from codegen.analysis.svg import text
from codegen.compare import Compared
from codegen.plant.model import Fault, Scenario
from codegen.report import plots, set_words
from codegen.report.page import write_report

SHOWN = ("two outputs", "ellipsoid, one output", "four outputs", "table")


def scenes(plant):
    """Without a fault, and with one on the sensor."""
    mode = tuple((5 * i, i % plant.n_modes) for i in range(10))
    if cycle := plant.switching.schedule:
        mode = tuple((k, cycle[k % len(cycle)]) for k in range(50))
    quiet = Scenario("no fault", 50, mode, ("0.2",) * plant.n_u, "corner", "corner", (), "", "uniform")
    fault = replace(quiet, name="sensor", fault=(Fault(1, 30, 40, "0.5"),))
    return replace(plant, scenarios=(quiet, fault))


def with_report(variant):
    """A certified design with what the report needs of a chosen one."""
    made, options = VARIANTS[variant]
    design = point_design(scenes(random_plant(**made)), **options)
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None, 10.0]} for f in design.plant.f]  # own words
    choice = [{"method": "zonotope", "design": "given", "level": None, "relative_width": None,
               "surely_detected": [None, None], "chosen": True}]
    return replace(design, detection={r: faults for r in design.detection}, choice=choice)


@pytest.fixture(scope="module", params=SHOWN)
def shown(request):
    design = with_report(request.param)
    return request.param, design, outcomes_of(design)


def test_outlines_are_where_the_firmware_changes_its_mind(shown):
    """A hair inside is accepted, a hair outside is not, in every direction; and the noise alone never leaves."""
    _, design, (quiet, _) = shown
    history = set_history.watch(design.observer, "float32", quiet.truth)
    assert np.array_equal(history.bound, quiet.trace.r_bound)
    index, t = np.arange(0, 50, 7), history.t
    rays = np.random.default_rng(0).normal(size=(6, design.plant.n_y))
    length = history.reach(index, rays)
    for side, outside in ((0.999, False), (1.001, True)):
        for k, along in zip(index, length):
            at = np.full(len(rays), k)
            r = (side * along[:, None] * rays).astype(np.float32)
            _, raw = design.observer.judged(t, history.q[at], history.origin[at], history.sets[at], r)
            assert (raw.any(axis=1) == outside).all()
    assert np.all(history.gauges(np.arange(50), quiet.trace.r) <= 1.0 + 1e-5)


def test_the_exact_set_is_inside_and_follows_the_truth(shown):
    variant, design, (quiet, fault) = shown
    for o in (quiet, fault):
        history = set_history.watch(design.observer, "float32", o.truth)
        exact = set_history.exact_sets(design.plant, history)
        assert exact[0] is not None and sum(G is None for G in exact) == 0
        for k, G in enumerate(exact):
            rays = np.random.default_rng(k).normal(size=(4, len(G)))
            if len(G) <= 3:
                inside = [zonotope.gauge(G, x) for x in rays]
                assert np.all(history.reach(np.array([k]), rays)[0] * inside >= 1.0 - 1e-5), (variant, k)
            assert np.all(zonotope.hull(G) <= history.bound[k] * (1 + 1e-6))
    halved = [0.5 * zonotope.hull(G) for G in exact]  # a set half as large loses the residual under corner noise
    assert any(np.any(np.abs(r) > h) for r, h in zip(quiet.trace.r, halved))


def test_a_missing_measurement_ends_what_is_known_exactly():
    design = with_report("two outputs")
    truth = outcomes_of(design)[0].truth
    y = truth.y.copy()
    y[20] = np.nan
    history = set_history.watch(design.observer, "float32", replace(truth, y=y))
    exact = set_history.exact_sets(design.plant, history)
    assert all(G is not None for G in exact[:20]) and all(G is None for G in exact[20:])


def test_the_page_shows_sets_in_words_and_pictures(shown, tmp_path, monkeypatch):
    variant, design, outcomes = shown
    monkeypatch.setattr(plots, "states", lambda *_: ())  # they have tests of their own, and take their time
    monkeypatch.setattr(plots, "residuals", lambda *_: ())
    page = write_report(output_folder(tmp_path, design), design, StandInDriver(design), outcomes).read_text()
    n_y = design.plant.n_y
    assert "The residual set</h2>" in page and page.count('href="#sets"') == 1
    assert page.count('aria-label="Residual set of') == {1: 0, 2: 2, 4: 6}[n_y]
    assert page.count('aria-label="Threshold of output') == min(n_y, 3)
    assert ('aria-label="Area of' in page) == (n_y == 2)
    assert ('aria-label="Accuracy and cost' in page) == (design.observer.family == "zonotope")
    assert "nan" not in re.sub("<[^>]*>", " ", page).split() and "None" not in page
    for name in set_compare.SETS:
        assert f"<td>{name}</td>" in page or f'<td class="">{name}</td>' in page
    assert ("outside: alarm" in page) == (n_y > 1)


def test_the_samples_that_are_shown():
    """Before the fault, at the first alarm, while it lasts; without a fault the sample that is closest to the edge."""
    design = with_report("two outputs")
    quiet, fault = set_words.watched(design, "float32", outcomes_of(design))
    chosen = dict(set_words.moments(fault))
    assert chosen["before the fault"] == 29
    assert chosen["first alarm"] == 30 + fault.outcome.episodes[0].delay
    assert 30 < chosen["while it lasts"] < 40
    at = dict(set_words.moments(quiet))["closest to the edge"]
    far = quiet.history.gauges(np.arange(10, 50), quiet.outcome.trace.r[10:])
    assert far[at - 10] == far.max()


def test_the_table_of_sets_orders_them(shown):
    """More columns are no worse, an interval is worst of what is carried, and nothing beats the exact set."""
    variant, design, outcomes = shown
    (w, _) = set_words.watched(design, "float32", outcomes)
    found = set_compare.closeness(design.plant, w.history, w.exact, np.arange(50))
    mean = {c.name: c.mean for c in found}
    assert all(x >= 0.999 for x in mean.values()) and found[0].name == "" and len(found) == len(set_compare.SETS) + 1
    assert mean["zonotope of order 20"] <= mean["zonotope of order 10"] + 0.02 <= mean["interval"] + 0.03
    assert set_compare.closeness(design.plant, w.history, [w.exact[0], *[None] * 49], np.arange(50)) == []


def test_an_alarm_that_no_output_raises_alone_has_a_row_of_its_own():
    design = with_report("two outputs")
    o = outcomes_of(design)[0]
    for bits, wanted in ((4, True), (5, False), (0, False)):
        raw = o.trace.raw_bits.copy()
        raw[5] = bits
        run = drawn.whole(design.plant, o.truth, replace(o.trace, raw_bits=raw))
        assert joint_only(run).sum() == wanted
        assert ("only jointly" in text(drawn.residual_figure(run))) == wanted
    framed = small_design("cart")  # there the last bit means crossed framers
    o = outcomes_of(framed)[0]
    run = drawn.whole(framed.plant, o.truth, replace(o.trace, raw_bits=np.full_like(o.trace.raw_bits, 2)))
    assert not joint_only(run).any()


def test_other_methods_are_shown_where_they_were_compared(tmp_path):
    design = with_report("two outputs")
    rows = [Compared("zonotope: zonotope", "zonotope", {}, family="zonotope", label="given", chip="host", multiply=379,
                     faults=[[None, 0.25], [0.5, 0.5]], dwell=0.0),
            Compared("interval", "interval", {}, reason="no L will do")]
    folder, driver = output_folder(tmp_path, design), StandInDriver(design)
    with_them = write_report(folder, design, driver, [], (), rows).read_text()
    assert "Other methods on this plant" in with_them and "No design: interval: no L will do" in with_them
    assert '<tr class="chosen">' in with_them.split("Other methods on this plant")[-1]
    assert "Other methods on this plant" not in write_report(folder, design, driver, []).read_text()
