"""A mode told one sample late: the bounds of both modes joined contain the exact state; either mode's alone do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact import campaign, false_alarms, feed, lost

from codegen.assurance.claims import claims
from codegen.certify.error_model import ErrorModel
from codegen.designs import read_design
from codegen.emit.package import files
from codegen.errors import DesignError
from codegen.observers.tnl import TnlObserver
from codegen.periods import curve
from codegen.pipeline import design as make
from codegen.plant.load import gallery_folder, loads
from codegen.plant.simulate import simulate, told
from codegen.report import period_words

GENERATED = Path(__file__).resolve().parents[2] / "generated" / "zammali_fd_tnl-interval"
LATE = '[switching]\nlate = true\n\n[[scenario]]'


def late_text() -> str:
    """The thesis's plant with its mode told late."""
    return (gallery_folder() / "zammali_fd.toml").read_text().replace("[[scenario]]", LATE, 1)


@pytest.fixture(scope="module")
def design():
    return make(loads(late_text(), "late"), "tnl-interval-lpv")


@pytest.fixture(scope="module")
def runs(design):
    """Exact runs with switches at every sample and slower; the mode that is told may be late."""
    rng = np.random.default_rng(5)
    made = campaign(design.plant, design.observer.tables["float32"], seed=4, runs=9)
    return [replace(r, q=told(design.plant, r.q, rng)) for r in made]


def alone(design, choose):
    """An observer that believes one mode only."""
    class Alone(TnlObserver):
        def _arrive(self, t, measured, y, theta, q):
            p = np.minimum(self.guard.mode, t.M_hi.shape[0] - 1)
            lo, hi = self._moved(t, measured, y, theta, choose(p, q))
            fresh = (self.phase == 0)[:, None]
            return np.where(fresh, self.lo, lo), np.where(fresh, self.hi, hi)

    return Alone({"float32": design.observer.tables["float32"]}, design.observer.supervision)


def test_compiled_float32_contains_the_exact_state(workshop, design, runs):
    trace = feed(workshop.driver(design), runs)
    assert np.all(trace.status == 0) and lost(runs, trace) == 0 and false_alarms(trace) == 0
    assert trace.differs(feed(design.observer, runs)) == []


@pytest.mark.parametrize("choose", [lambda last, now: last, lambda last, now: now], ids=["last mode", "new mode"])
def test_one_mode_alone_loses_the_state(design, runs, choose):
    assert lost(runs, feed(alone(design, choose), runs)) > 20


def test_every_mode_is_told(design):
    """The premise: each mode is told at its sample or at the next, however fast the switching."""
    rng = np.random.default_rng(0)
    q = rng.integers(0, 3, 500)
    said = told(design.plant, q, rng)
    assert np.any(said != q) and np.any((said == q)[1:] & (q[1:] != q[:-1]))
    assert np.all((said[:-1] == q[:-1]) | (said[1:] == q[:-1]))


def test_the_error_box_holds_for_either_table(design, runs):
    """The ultimate box of the certificate covers what the wrong mode's table does; without that part it would not."""
    t, cert = design.observer.tables["float64"], design.certificate["float64"]
    joined = ErrorModel(design.plant.observed.modes, t)
    plain = ErrorModel(design.plant.observed.modes, replace(t, vary=replace(t.vary, late=False)))
    assert "width" not in joined.push and "width" in plain.push
    z = np.array(cert["steady_box"]["hi"])
    small = plain.steady_box("hi")
    truth = simulate(design.plant, "no fault", seed=3)
    trace = design.observer.run(u=truth.u, y=truth.y, q=truth.q, real="float64")
    errors = np.max((trace.x_hi - truth.x)[20:], axis=0)
    assert np.all(errors <= z) and np.any(errors > small)


def test_other_methods_and_criteria_say_why_not(design):
    with pytest.raises(DesignError, match="told late"):
        make(loads(late_text(), "late"), "tnl-interval")
    with pytest.raises(DesignError, match="union of two framers"):
        make(loads(late_text(), "late"), "tnl-interval-lpv", criterion="linf")


def test_the_header_says_what_is_told(design):
    header = files(design, measure=False)["zammali_fd.h"]
    assert "still that of the step" in " ".join(header.replace("*", " ").split())
    plain = files(read_design(GENERATED), measure=False)["zammali_fd.h"]
    assert "its true mode" in plain and "still that of" not in " ".join(plain.replace("*", " ").split())


@pytest.mark.parametrize(("name", "late"), [("hoist", True), ("motor", False)])
def test_report_and_assurance_say_what_a_late_mode_costs_and_rests_on(workshop, name, late):
    design = workshop.gallery(name, "tnl-interval-lpv")
    (words,) = period_words.words_of(design, "float32", curve(design.plant, True, False, (0.5, 1.0)))
    assert ("rounding and late switches out" in words.text) == late == ("union of two modes" in words.plots[0].caption)
    of = {c.id: c for c in claims(design, "float32")}
    for key in ("containment", "ultimate-width", "detection-shunt"):
        assert ("switching.late" in of[key].plant) == late and "signals.theta" in of[key].plant
    assert ("the bounds of both modes are joined" in of["containment"].words) == late
