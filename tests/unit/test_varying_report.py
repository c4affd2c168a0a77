"""The report of a plant with parameters in continuous time: everything that the user must know of them is there."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.reports import StandInDriver, outcomes_of, output_folder  # noqa: E402
from helpers.varying import HELD, changed_design, heater_design  # noqa: E402

from codegen.analysis import panels, plots  # noqa: E402
from codegen.analysis.validate import Episode  # noqa: E402
from codegen.periods import FACTORS, PeriodPoint  # noqa: E402
from codegen.pipeline import period_curve  # noqa: E402
from codegen.plant.load import loads  # noqa: E402
from codegen.plant.simulate import simulate  # noqa: E402
from codegen.report import (  # noqa: E402
    design_words,
    firmware_words,
    outcome_words,
    parameter_words,
    period_words,
    plant_words,
    words,
)
from codegen.report.page import view, write_report  # noqa: E402


@pytest.fixture(scope="module")
def heater():
    return heater_design()


@pytest.fixture(scope="module")
def outcomes(heater):
    return outcomes_of(heater)


@pytest.fixture(scope="module")
def curve(heater):
    return period_curve(heater)


def plain(text):
    return " ".join(text.replace(words.THIN, " ").replace(words.HARD, " ").split())


@pytest.fixture(scope="module")
def page(heater, outcomes, curve, tmp_path_factory):
    folder = output_folder(tmp_path_factory.mktemp("varying") / "heater", heater)
    return write_report(folder, heater, StandInDriver(heater), outcomes, curve).read_text(encoding="utf-8")


def text_of(page):
    return plain(re.sub(r"<[^>]*>", " ", re.sub(r"<svg.*?</svg>", " ", page, flags=re.S)))


def cells(table):
    return [[plain(c.text) for c in row.cells] for row in table.rows]


def test_parameters_are_listed_with_all_that_is_known(heater):
    (table,) = parameter_words.parameter_tables(heater.plant)
    assert [c.text for c in table.head] == ["theta", "bounds", "where", "measured", "fastest change"]
    assert cells(table) == [
        ["flow", "[0.5, 1.5] kg/s", "open", "yes, to within 0.02 kg/s", "0.5 kg/s/s"],
        ["flow", "[0.5, 0.8] kg/s", "shut", "yes, to within 0.02 kg/s", "0.5 kg/s/s"],
        ["loss", "[0.1, 0.3] 1/s", "every mode", "no", "any: it may jump"]]


def test_sampling_and_assumptions_are_stated(heater, page):
    text = text_of(page)
    for part in ("20 ms (continuous time)", "“exponential”: the whole series", "inlet is held; power moves by",
                 "at most 2 W/s; the mode changes at samples only", "within their bounds and rates",
                 "the measurement at its start",
                 "x′ = A x + B u", "A and B are affine in the parameters theta",
                 "The parameter loss is in [0.1, 0.3] 1/s, may jump, and is not measured.",
                 "[0.5, 0.8] kg/s in mode “shut”, changes by at most 0.5 kg/s/s, and is measured to within 0.02 kg/s.",
                 "That a change of loss is noticed", "off by more than its error or moves faster than its rate",
                 "The state bounds between samples. They hold at the samples.",
                 "with constants affine in the measured parameters and radii for what is only bounded",
                 "the parameters anywhere within their bounds", "it reads thermometer and flow"):
        assert part in text, part


def test_words_follow_the_plant():
    """The same words on a plant without these things do not say them."""
    both = loads(HELD)
    facts = parameter_words.sampling_facts(both)
    assert both.reads_both_ends and "mean of the measurements at both its ends" in facts[2].text
    assert parameter_words.between(both).startswith("power and inlet are held; ")
    one = loads(HELD.replace(', measured = false', "").replace(", error = 0.02", ""))
    assert not any("noticed" in item for item in parameter_words.not_guaranteed(one))
    assert any("measured without error" in item for item in parameter_words.assumed(one))
    euler = replace(both, options={"sampling": "euler"})
    assert "“euler”: the Euler step" in parameter_words.sampling_facts(euler)[0].text
    plain_plant = replace(both, kind="discrete", theta=(), modes=tuple(replace(m, theta_terms={}) for m in both.modes))
    for say in (parameter_words.sampling_facts, parameter_words.assumed, parameter_words.not_guaranteed,
                parameter_words.parameter_tables):
        assert say(plain_plant) == ()


def test_slopes_and_radii_read_back(heater, page):
    t = heater.observer.tables["float32"]
    found = {c.replace("−", "-") for c in re.findall(r'<td class="num">([^<]*)</td>', page)}
    assert t.vary.parameters == 1 and np.any(t.vary.M) and np.any(t.vary.R)
    for array in (t.vary.M, t.vary.G, t.vary.R, t.vary.S, t.vary.Ra, t.vary.Sa, t.M_hi):
        assert {str(v) for v in array.ravel() if v} <= found
    text = text_of(page)
    assert "Slope of M in flow" in text and "M = T A − L C at theta = 0" in text and "loss" not in re.findall(
        r"Slope of \w in (\w+)", text)
    assert "R max(−x_lo, x_hi) + S |u|" in text


def test_a_fault_on_the_state_has_its_promise_and_its_condition(heater, page):
    text = text_of(page)
    assert "these thresholds bound every path of theta" in text and "far end of the declared range" in text
    assert design_words.hides(heater, "float32", "leak") and not design_words.hides(heater, "float32", "drift")
    size = heater.detection["float32"][1]["by_delay"]
    assert size[0] is None and 20 < size[-1] <= size[1] < 30
    assert "smallest surely detected leak fault" in text
    # A channel that has none at any size.
    blind = replace(heater, detection={r: [dict(f, by_delay=[None] * 4) for f in faults]
                                       for r, faults in heater.detection.items()})
    figures = [f.term for f in view(Path("."), blind, StandInDriver(blind), []).verdict.figures]
    assert "drift: no fault surely detected" in figures and "leak: no fault surely detected" in figures


def test_nothing_is_promised_with_a_bound_on_the_far_end(heater):
    """A fault on the state can hide in the cut; one of a sensor cannot."""
    plant, t = heater.plant, heater.observer.tables["float32"]
    f = np.zeros((40, 2))
    f[20:, 1] = 30.0
    run = simulate(plant, replace(plant.scenarios[0], steps=40, fault=()), seed=0)
    trace = heater.observer.run(u=run.u, y=run.y, q=run.q, theta=run.theta)
    done = SimpleNamespace(truth=replace(run, f=f), trace=trace, settled=np.ones(40, dtype=bool))
    trace.assured[:] = True
    trace.x_lo[20], trace.x_hi[20] = 0.0, 0.0
    episode = Episode("leak", 20, 40, 30.0, None)
    assert outcome_words.promise(heater, "float32", done, episode) == (1, "")
    trace.x_lo[21, 1] = t.x_hi[1]
    assert outcome_words.promise(heater, "float32", done, episode) == (None, "a bound on the far end of the range")
    sensor = Episode("drift", 20, 40, 30.0, None)
    done.truth = replace(run, f=f[:, ::-1])
    assert outcome_words.promise(heater, "float32", done, sensor) == (0, "")


def test_the_parameters_are_drawn(heater, outcomes, page):
    for title in ("Parameter flow, measured to within 0.02; dashed: its bounds",
                  "Parameter loss, not measured; dashed: its bounds"):
        assert page.count(title) == 1
    run = plots.whole(heater.plant, outcomes[0].truth, outcomes[0].trace)
    assert panels.known_parameters(run) == [0, 1]
    theta = run.truth.theta.copy()
    theta[:, 1] = np.nan
    assert panels.known_parameters(replace(run, truth=replace(run.truth, theta=theta))) == [0]
    # The bounds that are drawn are those of the mode: the value never leaves them by more than its error.
    figure = plots.residual_figure(run)
    axis = next(a for a in figure.axes if a.get_title(loc="left").startswith("Parameter flow"))
    (steps_lo, steps_hi) = (s.get_data() for s in axis.patches)
    edges = steps_hi.edges
    at = np.clip(np.searchsorted(edges, run.time, side="right") - 1, 0, len(steps_hi.values) - 1)
    assert set(steps_hi.values) == {1.5, 0.8} and set(steps_lo.values) == {0.5}
    assert np.all(run.truth.theta[:, 0] <= steps_hi.values[at] + 0.02 + 1e-12)
    assert np.any(run.truth.theta[:, 0] > 0.82)  # the other mode's bound would not do


def test_the_curve_is_over_all_periods_and_holds_the_chosen_one(heater, curve):
    assert [p.period for p in curve] == [0.02 * f for f in FACTORS]
    chosen = next(p for p in curve if p.period == 0.02)
    assert np.all(np.diff([p.width.sum() for p in curve if p.width is not None]) > -1e-9)
    # The certified design is as narrow, but for rounding.
    own = design_words.settled_width(heater, "float32")
    assert np.all(own >= chosen.width * (1 - 1e-6)) and np.all(own <= chosen.width * 1.05)
    discrete = replace(heater, plant=replace(heater.plant, kind="discrete"))
    assert period_curve(discrete) == []


def test_the_price_of_the_period_is_told_in_words_and_numbers(heater, curve, page):
    text = text_of(page)
    scale = 40.0
    ratio = curve[6].width.sum() / curve[0].width.sum()
    assert f"{words.at_most(ratio, 3)} times as wide as at 312.5 µs" in text and 1.005 < ratio < 1.2
    assert f"are {plain(period_words.percent(curve[6].width.sum() / scale))} wide" in text
    assert 'aria-label="Guaranteed width against sampling period"' in page
    (found,) = period_words.words_of(heater, "float32", curve)
    rows = found.tables[0].rows
    assert len(rows) == len(curve) and [r.kind for r in rows].index("chosen") == 6
    assert sum(r.kind == "chosen" for r in rows) == 1 and rows[6].cells[-1].text == "chosen"
    for row, point in zip(cells(found.tables[0]), curve):
        printed = float(row[1].split()[0])
        assert point.width[0] <= printed <= point.width[0] * 1.001


def test_periods_without_a_design_are_called_so(heater, curve):
    gone = [replace_width(p, None) if p.period > 0.1 else p for p in curve]
    (found,) = period_words.words_of(heater, "float32", gone)
    assert "At 80 ms there still is a design, at 160 ms none was found" in plain(found.text)
    assert sum("no design" in row[-1] for row in cells(found.tables[0])) == 4 and "no design" in found.plots[0].svg
    (all_there,) = period_words.words_of(heater, "float32", curve)
    assert "none was found" not in all_there.text and "no design" not in all_there.plots[0].svg
    not_here = [replace_width(p, None) if p.period == 0.02 else p for p in curve]
    (found,) = period_words.words_of(heater, "float32", not_here)
    assert "no design was found at the chosen 20 ms" in plain(found.text)
    assert cells(found.tables[0])[6][-1] == "chosen, no design"
    assert period_words.words_of(heater, "float32", []) == ()
    assert period_words.words_of(heater, "float32", [PeriodPoint(0.02, None)]) == ()


def replace_width(point, width):
    return PeriodPoint(point.period, width)


def test_without_a_curve_nothing_is_said_of_periods(heater, tmp_path):
    folder = output_folder(tmp_path / "none", heater)
    text = text_of(write_report(folder, heater, StandInDriver(heater), []).read_text(encoding="utf-8"))
    assert "What the sampling period costs" not in text


def test_entries_of_either_sign_are_told():
    unmeasured = HELD.replace("rate = 0.5, error = 0.02", "measured = false")
    for text, signed in ((unmeasured, False), (unmeasured.replace(" 0.5], [", " -0.5], ["), True)):
        design = heater_design(text, "component-interval")
        method = {f.term: f.text for f in design_words.words_of(design, "float32").facts}["Method"]
        assert "radii for what is only bounded" in method and "affine" not in method
        assert ("on the bound that its sign asks for" in method) is design.observer.tables["float32"].signed is signed


def test_a_mode_that_is_told_late_is_told(heater):
    late = replace(heater, plant=replace(heater.plant, switching=replace(heater.plant.switching, late=True)))
    for design, is_late in ((heater, False), (late, True)):
        first = design_words.words_of(design, "float32").assumed[0]
        assert ("that of the sample or of the one before" in first) is is_late is not ("is the true one" in first)
        assert ("perhaps that of the sample before" in plant_words.switching(design.plant)) is is_late


def test_the_curve_keeps_to_the_gains_of_the_design(heater):
    """With T, N, L the narrowest bounds see no fault; the curve is about gains like those of the firmware."""
    blind = heater_design(HELD, "tnl-interval-lpv")
    t = blind.observer.tables["float32"]
    assert blind.detection["float32"][0]["by_delay"][-1] is None and np.allclose(t.N_hi[:, 0, 0], 1)
    N = {real: np.where(np.arange(2)[:, None] == 0, 0.3, tables.N_hi).astype(real)
         for real, tables in blind.observer.tables.items()}
    tables = {real: replace(tables, N_hi=N[real], N_lo=N[real]) for real, tables in blind.observer.tables.items()}
    seeing = replace(blind, observer=type(blind.observer)(tables, blind.observer.supervision))
    narrow, wide = (np.array([p.width[0] for p in period_curve(d)]) for d in (blind, seeing))
    assert np.allclose(narrow, 0.2, atol=1e-6) and np.all(wide > 0.2001)
    captions = [period_words.words_of(d, "float32", period_curve(d))[0].plots[0].caption for d in (seeing, heater)]
    assert ["gains N no larger" in c for c in captions] == [True, False]


def test_other_coordinates_and_the_detector_are_told():
    design = changed_design()
    method = {f.term: f.text for f in design_words.words_of(design, "float32").facts}["Method"]
    assert "bounds of z = Z x, of which those of x are made" in method
    captions = [t.caption for fold in firmware_words.gains(design, "float32") for t in fold.tables]
    assert sum("z = Z x" in c for c in captions) == 2 == sum("M = Z A X" in c for c in captions)
    told = plain(" ".join(parameter_words.not_guaranteed(design.plant)))
    assert "Where g stands for faults, a second observer sees what this one bears" in told
    assert "second observer" not in plain(" ".join(parameter_words.not_guaranteed(loads(HELD))))
    others = [t.caption for fold in firmware_words.gains(heater_design(), "float32") for t in fold.tables]
    assert not any("z = Z x" in c for c in others)
