"""The report says what the design promises and what validation found, in one self-contained file."""

import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.reports import StandInDriver, outcomes_of, output_folder, short_record, small_design  # noqa: E402

from codegen.analysis import svg  # noqa: E402
from codegen.analysis.validate import Episode  # noqa: E402
from codegen.errors import EmitError  # noqa: E402
from codegen.plant.load import load  # noqa: E402
from codegen.report import outcome_words, words  # noqa: E402
from codegen.report.page import write_report  # noqa: E402

VOID = {"meta", "br", "img", "hr", "link", "input"}


class Page(HTMLParser):
    """A strict reading: every tag closed in order, names unique; collects text, references and names."""

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.ids, self.words = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open, self.open
        assert len(self.ids) == len(set(self.ids)), "a name is used twice"

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        attrs = dict(attrs)
        self.references += [attrs[k] for k in ("src", "href", "xlink:href", "action", "data") if k in attrs]
        self.ids += [attrs["id"]] if "id" in attrs else []

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, f"</{tag}> at {self.getpos()}"

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).replace(words.THIN, " ").replace(words.HARD, " ").split())


def report(folder, design, outcomes=None):
    outcomes = outcomes_of(design) if outcomes is None else outcomes
    path = write_report(output_folder(folder, design), design, StandInDriver(design), outcomes)
    assert path == folder / "report.html"
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def cart():
    return small_design("cart")


@pytest.fixture(scope="module")
def cart_page(cart, tmp_path_factory):
    return report(tmp_path_factory.mktemp("report") / "cart", cart)


def test_the_page_is_well_formed_and_needs_nothing_else(cart_page):
    page = Page(cart_page)
    assert not re.search(r"<(script|link|iframe|object)\b|@import|url\((?!#)", cart_page)
    anchors = {r[1:] for r in page.references if r.startswith("#")}
    assert anchors <= set(page.ids)
    files = {r for r in page.references if not r.startswith("#")}
    assert files == {"cart.c", "cart.h", "design.json", "resources.json"}
    assert "{{" not in cart_page and "None" not in page.text and "nan" not in page.text.split()
    assert "object at 0x" not in cart_page


def test_every_section_is_there_in_order(cart_page):
    headings = re.findall(r"<h2>(.*?)</h2>", cart_page)
    assert headings == ["The plant", "The design", "Faults that are surely detected", "Validation of the compiled C",
                        "Scenarios", "What it costs", "The constants in the C", "Assurance", "Provenance"]


def test_the_headline_tells_purpose_and_verdict(cart_page):
    text = Page(cart_page).text
    assert "Validation passed" in text and "Every 10 ms it reads position" in text
    assert "bounds on position and speed" in text and "1 of 1 fault found" in text
    assert "1 212 bytes" in text and "44 bytes" in text  # the target's size, not the host's


def test_the_plant_is_told_with_units_and_ranges(cart_page):
    text = Page(cart_page).text
    for part in ("[−20, 20] N", "[−0.3, 0.3] N", "[−0.01, 0.01] m", "“free” and “braked”", "50 ms (5 samples)"):
        assert part in text


def test_claims_and_thresholds_are_those_of_the_design(cart, cart_page):
    text = Page(cart_page).text
    for claim in cart.claims("float32"):
        assert " ".join(claim.split()) in text or claim[1:] in text
    threshold = cart.detection["float32"][0]["by_delay"][-1]
    printed = words.at_most(threshold)
    assert threshold <= float(printed) <= threshold * 1.001 and f"{printed} m" in text
    assert cart.digest in text and cart.plant_sha256 in text
    assert "residua generate design.json --real float32 --layout table -o cart" in text


def test_bounds_that_say_nothing_are_called_so(cart, cart_page, tmp_path):
    assert "wider than the range" not in Page(cart_page).text
    slow = tuple(replace(s, lo=-1.0, hi=1.0) for s in cart.plant.x)  # the speed is known to 4 m/s only
    text = Page(report(tmp_path / "slow", replace(cart, plant=replace(cart.plant, x=slow)))).text
    assert "wider than the range: says nothing new" in text


def test_the_constants_read_back(cart, cart_page):
    t = cart.observer.tables["float32"]
    cells = {c.replace("−", "-") for c in re.findall(r'<td class="num">([^<]*)</td>', cart_page)}
    for array in (t.M_hi, t.L_hi, t.N_hi, t.d_hi, t.c_lo):
        assert {str(v) for v in array.ravel()} <= cells


def test_every_scenario_is_shown(cart, cart_page):
    text = Page(cart_page).text
    for scenario in cart.plant.scenarios:
        assert scenario.name in text and f'aria-label="Residuals of scenario {scenario.name}"' in cart_page
        assert f'aria-label="State bounds of scenario {scenario.name}"' in cart_page
    assert text.count("equal (==)") == 2 and "at once (same sample)" in text


def test_the_same_design_gives_the_same_bytes(cart, cart_page, tmp_path):
    again = report(tmp_path / "elsewhere", small_design("cart"))
    assert again == cart_page
    assert re.search(r"\d{4}-\d\d-\d\d", cart_page) is None


def test_a_record_with_many_faults(tmp_path):
    design = short_record(2300)
    (outcome,) = outcomes_of(design)
    html = report(tmp_path / "emps", design, [outcome])
    page = Page(html)
    assert len(outcome.episodes) == 12 and "All 12 faults one by one" in page.text
    assert page.text.count("nothing: no step") == 12  # the label of the first sample is the share of its period
    assert "all found after 2 samples (10 ms);" in page.text
    assert "A record has no true state to compare with" in page.text and "not known" in page.text
    assert 'aria-label="First fault of scenario pulses"' in html
    assert "not at any size" in page.text  # the actuator fault needs a sample to be seen
    assert len(html) < 500_000 and max(map(len, re.findall(r"<svg.*?</svg>", html, re.S))) < 150_000


def test_a_failed_validation_is_not_to_be_missed(cart, tmp_path):
    good = outcomes_of(cart)
    bad = [replace(good[0], differences=["x_lo"], lost=3, false_alarms=2), good[1]]
    page = Page(report(tmp_path / "bad", cart, bad))
    for part in ("Validation failed", "differs from the reference in x_lo", "at 3 samples", "2 false alarms",
                 "Do not use this firmware", "FAILED", "1 of 2"):
        assert part in page.text
    assert "Validation passed" not in page.text


def test_a_missed_promise_is_a_failure(cart, tmp_path):
    good = outcomes_of(cart)
    late = replace(good[1], episodes=[replace(good[1].episodes[0], delay=2)])
    assert outcome_words.promise(cart, "float32", late, late.episodes[0]) == (0, "")
    page = Page(report(tmp_path / "late", cart, [good[0], late]))
    assert "PROMISE BROKEN" in page.text and "Validation failed" in page.text


@pytest.mark.parametrize("change, reason", [("small", "below the threshold"), ("ramp", "no step"),
                                            ("first sample", "the observer had not settled"),
                                            ("after a fault", "the observer had not settled"),
                                            ("missing", "a sample is missing")])
def test_nothing_is_promised_outside_the_assumptions(cart, change, reason):
    outcome = outcomes_of(cart)[1]
    f, e = np.zeros_like(outcome.truth.f), outcome.episodes[0]
    start = 0 if change == "first sample" else e.start
    f[start:e.stop, 0] = {"small": 0.07, "ramp": np.linspace(0.01, 1, e.stop - start)}.get(change, 0.1)
    settled, r_lo = outcome.settled.copy(), outcome.trace.r_lo.copy()
    settled[start - 1] &= change != "after a fault"
    r_lo[start:start + 4] = np.nan if change == "missing" else r_lo[start:start + 4]
    moved = replace(outcome, truth=replace(outcome.truth, f=f), settled=settled,
                    trace=replace(outcome.trace, r_lo=r_lo))
    limit, why = outcome_words.promise(cart, "float32", moved, Episode("encoder", start, e.stop, 0.1, None))
    assert limit is None and reason in why


def test_wrong_bounds_that_were_called_assured_are_owned_up_to(tmp_path):
    """Without a latch the framers may absorb a fault that goes on; with one, assured waits for the reset."""
    target = load("cart").target
    cart = small_design("cart", target=replace(target, latch=False))
    latched = outcomes_of(small_design("cart"))[1]
    assert not np.any(latched.trace.assured[latched.episodes[0].start:])
    cart_page = report(tmp_path / "unlatched", cart)
    o = outcomes_of(cart)[1]
    outside = np.any((o.truth.x > o.trace.x_hi) | (o.truth.x < o.trace.x_lo), axis=1)
    n = int(np.sum(outside & o.trace.assured))
    assert n > 0 and f"outside bounds called “assured” at {n} samples" in Page(cart_page).text


def test_text_of_the_plant_file_is_escaped(cart, tmp_path):
    plant = replace(cart.plant, title="<b>A & B</b>", source='"><script>alert(1)</script>')
    html = report(tmp_path / "escape", replace(cart, plant=plant))
    Page(html)
    assert "<b>A" not in html and "<script" not in html and "&lt;b&gt;A &amp; B" in html


def test_missing_resources_and_scenarios_are_tolerated(cart, tmp_path):
    for text in (None, "not json", "[]", '{"measured": 3, "state_bytes": null, "operations_per_step": []}'):
        folder = output_folder(tmp_path / f"case{hash(text)}", cart)
        (folder / "resources.json").unlink()
        if text is not None:
            (folder / "resources.json").write_text(text)
        path = write_report(folder, cart, StandInDriver(cart), [])
        assert "Not validated" in Page(path.read_text()).text


def test_nothing_tried_is_left_out(cart, tmp_path):
    rows = [dict(cart.choice[0], design=f"try {i}", chosen=i == 0) for i in range(20)]
    page = Page(report(tmp_path / "many", replace(cart, choice=rows, options={}), []))
    assert "12 other designs that were tried" in page.text and "of 20 certified designs" in page.text
    assert all(f"try {i}" in page.text for i in range(20))
    assert page.text.count("(chosen)") == 1


def test_a_folder_that_cannot_be_written(cart, tmp_path):
    folder = output_folder(tmp_path / "full", cart)
    (folder / "report.html").mkdir()
    with pytest.raises(EmitError, match=r"report\.html: .*Choose a folder"):
        write_report(folder, cart, StandInDriver(cart), [])
    assert not list(folder.glob("*.part"))


@pytest.mark.parametrize("x, printed", [(0.22391377, "0.224"), (2.888849, "2.889"), (2.8881, "2.889"), (100.0, "100"),
                                        (1e-7, "1e−7"), (1.00001e-6, "1.001e−6"), (None, "–"), (0.0, "0"),
                                        (123456.0, "123500"), (1.5e9, "1.5e9"), (float("inf"), "∞")])
def test_upper_bounds_are_rounded_up(x, printed):
    assert words.at_most(x) == printed


def test_shares_are_rounded_down():
    assert words.share(9999, 10000) == f"99.9{words.THIN}%" and words.share(1, 1) == f"100{words.THIN}%"


def test_thinning_keeps_every_extreme():
    curve = np.random.default_rng(0).normal(size=(5000, 2))
    curve[1234, 0], curve[4321, 1] = 50, -50
    index = svg.pick(curve, 100)
    assert {0, 1234, 4321, 4999} <= set(index) and len(index) <= 402 and np.all(np.diff(index) > 0)
    assert np.array_equal(svg.pick(curve[:300], 100), np.arange(300))
    curve[2000:2003] = np.nan
    assert np.isnan(curve[svg.pick(curve, 100)]).any()


def test_stretches_are_found_and_never_lost():
    assert svg.stretches(np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)) == [(0, 2), (3, 4), (6, 7)]
    assert svg.stretches(np.zeros(5, dtype=bool)) == []
    on = np.random.default_rng(0).random(10_000) < 0.3
    covered = np.zeros_like(on)
    for start, stop in svg.stretches(on, longest=100):
        covered[start:stop] = True
    assert np.all(covered[on])


def test_templates_decide_nothing():
    folder = Path(__file__).parents[2] / "templates" / "report"
    for path in folder.glob("*.jinja"):
        text = re.sub(r"{#.*?#}", "", path.read_text(), flags=re.S)
        for statement in re.findall(r"{%-?(.*?)-?%}", text):
            assert statement.split()[0] in {"for", "endfor", "extends", "import", "block", "endblock", "macro",
                                            "endmacro"}
        for printed in re.findall(r"{{(.*?)}}", text):
            assert re.fullmatch(r" ?[a-z_.]+(\([a-z_.]+\))? ?", printed), printed
