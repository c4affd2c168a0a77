"""``mode-sliding``: the thesis's numbers by the printed condition, the corrected one certified, tampering caught."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.analysis import sliding_measure
from codegen.analysis.sliding_measure import courses, delays, measured, scaled
from codegen.certify import sliding_claims
from codegen.designs import read_design, recheck
from codegen.errors import CertificateError, DesignError
from codegen.observers import SlidingObserver, SlidingTables, Supervision
from codegen.observers.ellipsoid_trace import root
from codegen.plant.load import load
from codegen.synthesis.mode_sliding import settings, theorem12
from codegen.synthesis.sliding_tables import tables_of

FOLDER = Path(__file__).resolve().parents[2] / "generated" / "zammali_modes_mode-sliding"
PLANT = load("zammali_modes")
A, C = [m.A for m in PLANT.modes], PLANT.modes[0].C
#: Zammali (2020), section 4.5; modes 1 and 3 do not bind, their gains are not unique.
THESIS = {"gamma": 0.73, "beta": 2.77, "P": [[4.64, 1, 4.4], [1, 1, 4.87]],
          "L_hi": [-98.6, 0.50, 40.23], "L_lo": [-93.50, 0, 5.96]}


@pytest.fixture(scope="module")
def design():
    return read_design(FOLDER)


def test_the_printed_condition_gives_the_printed_numbers():
    """The sign of J2 as printed, and P >= I, which no line states."""
    found = theorem12(A, C, 500.0, corrected=False, second=False)
    assert round(found["gamma"].max(), 2) == THESIS["gamma"] and round(found["beta"].max(), 2) == THESIS["beta"]
    assert np.allclose(found["P"], THESIS["P"], atol=0.011)
    assert np.allclose(found["L_hi"][1, :, 0], THESIS["L_hi"], atol=0.1)
    # The lower gain of mode 2 is less sharp: its diagonal limit is met, the thesis stays a little off.
    assert np.allclose(found["L_lo"][1, :, 0], [-98.6, 0, 6.38], atol=0.02)


def test_the_corrected_condition():
    found = theorem12(A, C, 500.0)
    assert (round(found["gamma"].max(), 3), round(found["beta"].max(), 2)) == (0.658, 1.85)
    both = {"kind": "sliding", "target": 0.5, "limit": 500.0, **{k: found[k].tolist() for k in ("L_hi", "L_lo", "P")}}
    levels = {"gamma": (found["gamma"] * 1.0001).tolist(), "beta": (found["beta"] * 1.0001).tolist()}
    sliding_claims.check_theorem(PLANT, both | levels)
    # beta cannot be below the largest eigenvalue of J' J, whatever the gains: it says nothing of sensitivity.
    assert found["beta"].min() > 1.5
    printed = theorem12(A, C, 500.0, corrected=False, second=False)
    wrong = both | levels | {k: printed[k].tolist() for k in ("L_hi", "L_lo", "P")}
    with pytest.raises(CertificateError, match="gamma|beta"):
        sliding_claims.check_theorem(PLANT, wrong)


def test_modes_share_no_gains_where_none_are_stable():
    with pytest.raises(DesignError, match=r"Raise observer\.gain_limit"):
        theorem12([np.array([[1.0, 0], [0, 1.0]])], np.array([[1.0, 0]]), 10.0)


def test_what_is_stored_is_proved_again(design):
    proved = recheck(design)
    assert proved == design.proved and len(proved["float32"]) == 6
    assert "nothing is proved of the decision" in proved["float32"][0]


SPOILT = {
    "P": (lambda c: c | {"P": [[p * 0.9 for p in c["P"][0]], c["P"][1]]}, "no entry below 1"),
    "gamma": (lambda c: c | {"gamma": [g * 0.9 for g in c["gamma"]]}, "the level gamma"),
    "beta": (lambda c: c | {"beta": [1.5] * 3}, "the level beta"),
    "gain": (lambda c: c | {"L_hi": (np.array(c["L_hi"]) * [[[1.0], [1.0], [1 + 1e-6]]]).tolist()}, "L_hi"),
    "metzler": (lambda c: c | {"L_lo": (np.array(c["L_lo"]) + [[[0], [0.6], [0]]]).tolist()}, "not Metzler"),
    "errors": (lambda c: c | {"errors": (np.array(c["errors"]) * 0.99).tolist()}, "does not settle"),
    "dwell": (lambda c: c | {"dwell": 20}, "dwell time")}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_certificate_is_refused(design, name):
    change, words = SPOILT[name]
    with pytest.raises(CertificateError, match=words):
        sliding_claims.check(design.plant, design.observer.tables["float32"], change(design.certificate["float32"]))


TAMPERED = {
    "d_hi": lambda t: replace(t, d_hi=t.d_hi * np.float32(0.98)),
    "d_lo": lambda t: replace(t, d_lo=t.d_lo * np.float32(0.98)),
    "M_hi": lambda t: replace(t, M_hi=np.where(t.M_hi == 0, np.float32(-1e-6), t.M_hi)),
    "L_lo": lambda t: replace(t, L_lo=t.L_lo * np.float32(1.00001)),
    "G": lambda t: replace(t, G=t.G * np.float32(1.001)),
    "v_hi": lambda t: replace(t, v_hi=np.nextafter(np.float32(0.02), np.float32(0)) * np.ones_like(t.v_hi)),
    "H": lambda t: replace(t, H=t.H * np.float32(1.0001)),
    "limit": lambda t: replace(t, limit=t.limit / 8),
    "dwell": lambda t: replace(t, dwell=t.dwell + 1)}


@pytest.mark.parametrize("name", TAMPERED)
def test_tampered_tables_are_refused(design, name):
    with pytest.raises(CertificateError):
        sliding_claims.check(design.plant, TAMPERED[name](design.observer.tables["float32"]),
                             design.certificate["float32"])


def told_modes(plant, t, runs=6, steps=150, seed=3):
    """Reference and truth over random courses with disturbances at their bounds."""
    run = courses(plant, runs, steps, seed)
    return run, SlidingObserver({t.real: t}, Supervision()).run_many(run.u, run.y, run.q, t.real)


def lost(run, trace) -> int:
    """Samples at which x is beyond bounds that are promised: those of a mode that was right since it was taken up."""
    outside = ((run.x < trace.x_lo) | (run.x > trace.x_hi)).any(axis=-1)
    count = 0
    for i, k in np.argwhere(outside):
        span = slice(max(k - int(trace.age[i, k]), 0), k + 1)
        count += np.all(run.q[i, span] == trace.mode[i, k])
    return int(count)


def test_bounds_hold_while_the_decision_is_right_and_no_alarm_is_false(design):
    t = design.observer.tables["float32"]
    run, trace = told_modes(design.plant, t)
    assert lost(run, trace) == 0 and not trace.raw_bits.any() and not trace.assured.any()
    assert np.mean(trace.mode == run.q) > 0.8 and len(np.unique(run.q)) == 3
    other = replace(t, M_hi=np.roll(t.M_hi, 1, axis=0), M_lo=np.roll(t.M_lo, 1, axis=0))
    assert lost(*told_modes(design.plant, other)) > 10  # a test that nothing can fail proves nothing


def held_by_its_pair(plant, t, steps) -> bool:
    """Whether the pair of the active mode holds x, from the initial box on, in the mode for good."""
    for_good = replace(plant, switching=replace(plant.switching, average_dwell=1e3))
    run, observer = courses(for_good, 30, steps + 1, 7), SlidingObserver({t.real: t}, Supervision())
    trace = observer.run_many(run.u[:, :-1], run.y[:, :-1], run.q[:, :-1], t.real)
    rows, q = np.arange(30), run.q[:, -1]
    inside = (observer.x[0][rows, q] <= run.x[:, -1]) & (run.x[:, -1] <= observer.x[1][rows, q])
    return bool(inside.all() and np.all((trace.mode_set >> run.q[:, :-1]) & 1))


@pytest.mark.parametrize("steps", [4, 60])
def test_the_pair_of_the_active_mode_holds_x(design, steps):
    t = design.observer.tables["float32"]
    assert held_by_its_pair(design.plant, t, steps)
    middle = (t.d_hi + t.d_lo) / 2
    assert not held_by_its_pair(design.plant, replace(t, d_hi=middle, d_lo=middle), steps)
    assert not held_by_its_pair(design.plant, replace(t, L_hi=-t.L_hi, L_lo=-t.L_lo), steps)


def test_what_no_mode_explains_is_an_alarm(design):
    """A sensor that jumps between the ends of its range: modes refuted over and over within the dwell time."""
    t = design.observer.tables["float32"]
    y = np.where(np.arange(60) % 2 == 0, -45.0, 15.0)[:, None]
    trace = design.observer.run(np.full((60, 1), 5.0), y, real="float32")
    assert trace.raw_bits.any() and trace.latched_bits[-1] and not trace.assured.any()
    assert np.flatnonzero(trace.raw_bits)[0] <= t.dwell


def test_the_right_pair_does_not_restart(design):
    """The livelock: at a detection every pair restarted in the thesis, the right one too. Here its test never fails."""
    t = design.observer.tables["float32"]
    run, trace = told_modes(design.plant, t)
    settled = np.zeros(run.q.shape, bool)
    for k in range(10, run.q.shape[1]):
        settled[:, k] = np.all(run.q[:, k - 9:k + 1] == run.q[:, k:k + 1], axis=1)
    holds = (trace.mode_set >> run.q) & 1 == 1
    assert np.mean(holds[settled]) == 1.0
    detections = (trace.age == 0).sum(axis=1)
    assert np.all(detections <= 2 * np.array([len(s) for s in run.switches]) + 2)


class AllBeginAnew(SlidingObserver):
    """As printed: at a detection every pair restarts, the right one too."""

    def sample(self, t, on, measured, u, y, q, theta, out):
        super().sample(t, on, measured, u, y, q, theta, out)
        again = on & measured & (self.age == 0)
        self.x = [np.where(again[:, None, None], end, own) for end, own in zip((t.x_lo, t.x_hi), self.x)]
        self.fresh = self.fresh | again[:, None]


def test_restarts_of_all_pairs_are_a_livelock(design):
    """With a short blanking time: detections over and over, of which none is a switch."""
    found = {k: np.array(design.certificate["float64"][k]) for k in ("L_hi", "L_lo")}
    chosen = settings(PLANT, {"blank": 0.01, "slope": 1e4, "window": 0.01, "share": 1.0})
    t = tables_of(SlidingTables, PLANT, found, chosen, "float64")
    run = courses(PLANT, 4, 180, 3)
    counts, right = {}, {}
    for cls in (SlidingObserver, AllBeginAnew):
        trace = cls({"float64": t}, Supervision()).run_many(run.u, run.y, run.q, "float64")
        counts[cls] = (trace.age == 0).sum(axis=1) - [len(s) for s in run.switches]
        right[cls] = np.mean(trace.mode == run.q)
    assert counts[SlidingObserver].max() <= 1 and right[SlidingObserver] > 0.9
    assert counts[AllBeginAnew].min() >= 4 and right[AllBeginAnew] < 0.75


@pytest.mark.parametrize("slope", [50.0, 1e4, 3e6])
def test_closed_form_is_the_numeric_root_of_backward_euler(design, slope):
    """e = b - tau k1 |e|^(1/2) sign e - tau^2 k2 sign e, solved by bisection; the tables made anew."""
    found = {k: np.array(design.certificate["float64"][k]) for k in ("L_hi", "L_lo")}
    t = tables_of(SlidingTables, PLANT, found, settings(PLANT, {"slope": slope}), "float64")
    tau, observer = float(t.period), SlidingObserver({"float64": t}, Supervision())
    observer.start(t, 1)
    observer.fresh[:] = False
    for b in (0.3 * t.ground, -t.ground, 1.5 * t.ground, -20 * t.ground, 0.5 * t.z_limit[0], -0.9 * t.z_limit[0]):
        observer.x = [0 * x for x in observer.x]
        observer.z, observer.rate = [0 * z + b for z in observer.z], [0 * v for v in observer.rate]
        z, rate = observer._twisted(t, np.zeros((1, 1)))
        lo, hi = 0.0, abs(b)
        for _ in range(200):
            e = (lo + hi) / 2
            lo, hi = (e, hi) if e + 2 * tau * np.sqrt(slope * e) + tau**2 * slope < abs(b) else (lo, e)
        turned = tau * slope * np.sign(b) * min(1, abs(b) / (tau**2 * slope))
        assert rate[0][0, 0, 0] == pytest.approx(-turned, rel=1e-9)
        left = z[0][0, 0, 0] + tau * rate[0][0, 0, 0]  # z moves by tau rate after the correction
        assert left == pytest.approx(np.sign(b) * hi, rel=1e-4, abs=1e-4 * abs(b))


def test_implicit_euler_does_not_chatter(design):
    """With k1 = 2 sqrt k2 the step rests within |b| <= h; an explicit one cycles where |rate| < k1^2 tau / 4."""
    t = design.observer.tables["float64"]
    tau, k2 = float(t.period), float(t.turn / t.period)
    k1 = float(t.pull / t.period)
    assert np.isclose(k1, 2 * np.sqrt(k2)) and np.isclose(float(t.ground), tau**2 * k2)
    slope, z, v, explicit = 30.0, 1.0, 0.0, [1.0, 0.0]
    for _ in range(400):
        b = z + tau * slope + tau * v
        inside = abs(b) <= t.ground
        c = b * t.inverse if inside else np.sign(b)
        g = 0.0 if inside else root(t, np.array([abs(b)]))[0] - t.foot
        v = v - t.turn * c
        z = z + tau * slope - t.pull * g * c + tau * v
        e, w = explicit
        explicit = [e + tau * (slope - k1 * np.sqrt(abs(e)) * np.sign(e) + w), w - tau * k2 * np.sign(e)]
    assert abs(v + slope) < 1e-6 and abs(z) < 1e-6
    assert k1**2 * tau / 4 > slope and abs(explicit[1] + slope) > 10  # stalls, as predicted


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_roots_are_roots(design, real):
    t = design.observer.tables[real]
    values = np.geomspace(float(t.ground), float(1 / (4 * t.a[-1] ** 2)), 2000).astype(real)
    assert np.max(np.abs(root(t, values) / np.sqrt(values) - 1)) < {"float32": 1e-5, "float64": 1e-5}[real]


def test_measured_figures_are_those_of_the_runs(monkeypatch):
    monkeypatch.setattr(sliding_measure, "RUNS", 3)
    assert delays(np.array([0, 0, 0, 1, 1, 0]), np.array([0, 0, 1, 1, 1, 0]), [(1.5, 1), (4.2, 0)], 1.0) == [1.5]
    assert delays(np.zeros(6, int), np.array([0, 1, 1, 0, 0, 0]), [(0.5, 1), (2.5, 0)], 1.0) == [np.inf]
    plant = scaled(PLANT, 2.0, 0.0)
    assert plant.sample_period == 0.01 and not any(np.any(m.v_hi) for m in plant.modes)
    run = courses(PLANT, 2, 40, 5)
    assert np.all(np.abs(run.y[..., 0] - run.x @ C[0]) <= 0.02) and len(run.switches[0]) <= 2

    class Perfect:
        """Answers with the truth, late by two samples, as a family would."""

        def __init__(self, tables, supervision):
            pass

        def run_many(self, u, y, q, real):
            late = np.concatenate([q[:, :1], q[:, :1], q[:, :-2]], axis=1)
            return type("Trace", (), {"mode": late})

    def tables_for(plant):
        if plant.sample_period > 0.005:
            raise DesignError("too slow")
        return type("Tables", (), {"real": "float64", "y_lo": -1e9, "y_hi": 1e9})

    cells = measured(PLANT, Perfect, None, tables_for)
    assert {c["period"] for c in cells} == {0.0025, 0.005} and all(c["missed"] == 0 for c in cells)
    assert all(2 * c["period"] <= c["median"] <= c["longest"] <= 3 * c["period"] for c in cells)


def test_options_and_what_the_plant_suggests():
    chosen = settings(PLANT, {})
    assert (chosen["blank"], chosen["dwell"], chosen["limit"], chosen["window"]) == (4, 30, 100.0, 0.01)
    own = settings(PLANT, {"slope": 10000, "blank": 0.02, "window": 0.03, "gain_limit": 500, "share": 0.5})
    assert (own["slope"], own["window"], own["limit"], own["share"]) == (10000.0, 0.03, 500.0, 0.5)
    with pytest.raises(DesignError, match="Shorten it"):
        settings(PLANT, {"blank": 0.145})


def test_the_other_number_type_and_period_are_held_too(design):
    """The gains at a period of 1 ms in double precision: certified anew, the pairs hold."""
    fine = replace(design.plant, sample_period=0.001)
    found = {k: np.array(design.certificate["float64"][k]) for k in ("L_hi", "L_lo", "P", "gamma", "beta")}
    t = tables_of(SlidingTables, fine, found, settings(fine, {}), "float64")
    cert = sliding_claims.prove(fine, t, found, 100.0, 0.5)
    assert sliding_claims.check(fine, t, cert) and t.dwell == 150
