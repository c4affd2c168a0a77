"""Filters beside a mode estimator: the truth is never lost; wrong ways of it, and tampering, are."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flint import arb
from helpers.driven import NOISY
from helpers.folders import built, write
from helpers.small_modes import exact_course
from helpers.tampering import scaled
from helpers.trailing import AGES, PLANTS, PUSHED, made, plant, tables

import codegen
from codegen.analysis import mode_promise, plots, replay
from codegen.analysis.validate import validate
from codegen.assurance.claims import claims
from codegen.certify import loose_filter
from codegen.designs import read_design, recheck
from codegen.errors import CertificateError, DesignError
from codegen.host import build
from codegen.observers import ModeObserver, Supervision, TrailingObserver, TrailingTables
from codegen.plant.load import loads
from codegen.report import trailing_words
from codegen.report.firmware_words import _matrix
from codegen.report.words import at_most

RUNS, STEPS = 5, 45


@lru_cache
def courses(name: str):
    """Switches as fast as allowed, then six times as slowly, the worst disturbance all the time."""
    return [exact_course(plant(name), AGES * (1 if seed < 2 else 6), STEPS, 35 + seed, (0, 1, 0, 1, -1)[seed])
            for seed in range(RUNS)]


def lost(name, t, real="float32", observer=TrailingObserver):
    """Samples at which state, mode or bound of the estimate is lost, or there is an alarm; the answers; what is right.

    The last is |f_hat| over f_bound where the decision is right.
    """
    runs, bad = courses(name), 0
    u, y, q = (np.stack([getattr(run, k) for run in runs]).reshape(RUNS, STEPS, -1) for k in ("u", "y", "q"))
    y[3, 7::9] = np.nan  # samples without a measurement
    out = observer({real: t}, Supervision()).run_many(u, y, q[..., 0], real)
    for i, run in enumerate(runs):
        for k, (x, true) in enumerate(zip(run.x, run.q)):
            held = all(arb(float(a)) <= b and b <= arb(float(c)) for a, b, c in
                       zip(out.x_lo[i, k], x, out.x_hi[i, k]))
            bad += (not held) or bool(out.alarm[i, k]) or not (k == 0 or int(out.mode_set[i, k]) >> int(true) & 1)
    if not hasattr(out, "f_hat"):
        return bad, out, None
    right = out.mode == q[..., 0]
    right[:, 0] = False  # nothing has acted yet
    share = np.nan_to_num((np.abs(out.f_hat) / out.f_bound).max(axis=2))
    return bad + int(np.sum(right & (share > 1))), out, np.where(right, share, 0)


@pytest.mark.parametrize("name, real", [
    ("input", "float64"), ("no input", "float32"), ("parameter", "float32")])
def test_truth_is_kept_exactly(name, real):
    """Corners of everything, switches as fast as allowed; the truth in balls of 1e-50."""
    t = tables(name, real)
    bad, out, share = lost(name, t, real)
    assert bad == 0 and out.assured.all() and share.max() > 0.4
    _, alone, _ = lost(name, t, real, ModeObserver)
    assert np.all(out.mode_set & ~alone.mode_set == 0)
    assert np.any(out.f_bound <= 1.1 * t.told.h[:, -1].max(axis=(0, 1)))  # thresholds come down between switches


class Settled(TrailingObserver):
    """The filter of a mode that may have begun within the period, and its bound, go on."""

    def _filtered(self, t, on, measured, raw, again, quiet, now, u, y):
        now.alive[..., 0] = False
        return super()._filtered(t, on, measured, raw, again, quiet, now, u, y)


class Spoilt(TrailingObserver):
    """Filters go on from anywhere, as after an alarm."""

    def _filtered(self, t, on, measured, raw, again, quiet, now, u, y):
        return super()._filtered(t, on, measured, raw, again, quiet & False, now, u, y)


class Deaf(TrailingObserver):
    """Filters go on unmoved through a change of the mode."""

    def _filtered(self, t, on, measured, raw, again, quiet, now, u, y):
        self.running = self.running | True
        now.alive[..., 1:] |= now.alive[..., :1]
        now.alive[..., 0] = False
        return super()._filtered(t, on, measured, raw, again, quiet, now, u, y)


@pytest.mark.parametrize("name", ["input", "between"])
@pytest.mark.parametrize("observer, sound", [(Spoilt, True), (Settled, False), (Deaf, False)])
def test_other_ways_lose_the_truth(name, observer, sound):
    """A filter does not hold what has just begun in its mode, at a sample or inside, but where it is from anywhere."""
    assert (lost(name, tables(name, "float32"), observer=observer)[0] == 0) == sound


def test_thresholds_of_another_period_lose_the_truth():
    """Those of a continuous plant are of what encloses it at its own samples."""
    t, later = tables("between", "float32"), replace(plant("between"), sample_period=0.06)
    (own, certs), modes = made("between", "float32"), later.enclosed.modes
    with pytest.raises(CertificateError, match="not kept"):
        for demand in loose_filter.demands(modes, own.told, certs):
            demand.require()
    wrong = replace(t.told, M=t.told.M[::-1], G=t.told.G[::-1], L=t.told.L[::-1])
    assert lost("between", replace(t, told=wrong))[0] > 0


def test_smaller_thresholds_lose_the_truth():
    """All of them, rows that come too early, constants of another mode."""
    t = tables("input", "float32")
    own = t.told
    early = np.concatenate([own.h[:, 8:], *[own.h[:, -1:]] * 8], axis=1)
    for wrong in (replace(own, h=own.h * np.float32(0.7)), replace(own, h=early), replace(own, L=own.L[::-1]),
                  replace(own, M=own.M[::-1], G=own.G[::-1])):
        assert lost("input", replace(t, told=wrong))[0] > 0


def test_a_filter_follows_the_plant_from_its_start():
    """Where an observer is the filter, E is the identity; starts of all sizes occur, each holds its box."""
    t = tables("input", "float32").told
    assert np.allclose(t.E, np.eye(2), atol=1e-6)
    rng = np.random.default_rng(3)
    middle = rng.uniform(t.x_lo, t.x_hi, (300, 2, 2))
    half = 10.0 ** rng.uniform(-4, 0.5, (300, 2, 2))
    lo, hi = (np.clip((middle + s * half).astype(t.dtype), t.x_lo, t.x_hi) for s in (-1, 1))
    xi, stage = t.started(lo, hi)
    assert set(stage.ravel()) == set(range(t.anywhere))
    centre = (lo.astype(float) + hi) / 2
    assert np.allclose(xi, centre, atol=1e-6)
    reach = np.maximum(hi - centre, centre - lo)
    assert np.all(reach <= t.sizes[stage] * (1 + 1e-6))
    tight = reach <= 0.99 * t.sizes[np.minimum(stage + 1, t.anywhere - 1)]
    assert np.all((stage == t.anywhere - 1) | ~tight.all(axis=2))


@pytest.mark.parametrize("name", ["input", "parameter"])
def test_tampering_with_thresholds_is_caught(name):
    """Each constant of the filters, and what proves them, made a little less or another."""
    (t, certs), modes = made(name, "float32"), plant(name).observed.modes
    own = t.told

    def check(t, certs=certs):
        for demand in loose_filter.demands(modes, t, certs):
            demand.require()

    check(own)
    for stage in range(len(own.h)):  # none has much to spare
        h = own.h.copy()
        h[stage, 0] *= np.float32(0.995)
        with pytest.raises(CertificateError, match=f"start of size {stage}"):
            check(replace(own, h=h))
    last = own.h.copy()
    last[:, -1] *= np.float32(0.97)
    wide, tenth, less = np.float32(1.05), np.float32(0.1), np.float32(0.01)
    for wrong, words in (({"h": last}, "estimate of fault"), ({"M": own.M * wide}, "kept|estimate"),
                         ({"K": own.K * wide}, "estimate"), ({"E": own.E * np.float32(1.2)}, "start of size"),
                         ({"sizes": own.sizes[:, ::-1] * wide}, "start of size|declared"),
                         ({"sizes": own.sizes * np.float32(0.9)}, "declared range"),
                         ({"limit": own.limit * tenth}, "beyond its limit"), ({"grow": np.float32(1)}, "grow"),
                         ({"floor": own.floor * less}, "floor")):
        with pytest.raises(CertificateError, match=words):
            check(replace(own, **wrong))
    shrunk = [cert | {"bounds": [0.99 * b for b in cert["bounds"]]} for cert in certs]
    with pytest.raises(CertificateError, match="not kept"):
        check(own, shrunk)


# ---------------------------------------------------------------------------------------------- the whole way


@lru_cache
def whole():
    return codegen.design(loads(PUSHED))


@lru_cache
def true_run():
    return codegen.simulate(whole().plant, "sensor fault")


def test_the_whole_way(tmp_path):
    """Design, file, recheck, C against reference and truth: the estimate goes on while a fault lasts."""
    design = whole()
    assert design.observer.family == "trailing" and len(design.claims("float32")) >= 8
    again = read_design(design.save(tmp_path / "design.json"))
    assert again.digest == design.digest and recheck(again) == design.proved
    quiet, faulty, *promised = validate(design, built(design, tmp_path / "c"))
    assert promised and all(o.passed for o in promised)
    assert quiet.passed and quiet.settled.all() and faulty.passed and faulty.episodes[0].delay is not None
    during = slice(80 + 5, 120)
    estimate, modes = faulty.trace.f_hat[during, 0], faulty.trace.mode[during]
    assert np.all(modes == 1) and np.all(np.abs(estimate - 0.3) < 0.05)
    assert not faulty.trace.assured[80:].any() and faulty.trace.assured[:80].all()


def test_a_continuous_plant(tmp_path):
    """Switches inside samples, the mode found; what constant matrices leave out of a period is in the level."""
    design = codegen.design(loads(PLANTS["between"].replace(*NOISY[::-1]).replace(
        'method = "mode-set"', 'method = "hinf-filter"\nset_rows = 12')))
    run, *promised = validate(design, built(design, tmp_path / "c"))
    assert run.passed and run.settled.all() and all(o.passed for o in promised)
    assert "leave out of a period" in design.proved["float32"][0]
    stated = {c.id: c for c in claims(design, "float32")}
    assert stated["energy"].text == design.proved["float32"][0] and {"bound", "containment", "delays"} <= set(stated)


def test_a_slow_fault_is_found_by_the_filter_first(tmp_path):
    """A drift of a sensor: twice as soon as by the estimator alone, or by C whose filters exclude nothing."""
    design, run = whole(), true_run()
    quiet = run.y - run.f @ design.plant.modes[0].Df.T
    drift = np.stack([np.maximum(0.002 * (np.arange(150) - 60), 0), np.zeros(150)], axis=1)
    alone = ModeObserver(design.observer.tables, Supervision())
    first = [int(np.argmax(np.append(o.run(run.u, quiet + drift).alarm, True))) for o in (design.observer, alone)]
    assert 60 < first[0] <= 60 + 0.5 * (first[1] - 60)
    folder = write(design, tmp_path, layout="loop")
    code = (folder / "pushed.c").read_text()
    deaf = code.replace("if (pushed_beyond(s, q, f_hat, bound))", "if (pushed_beyond(s, q, f_hat, bound) && (q > 9U))")
    (folder / "pushed.c").write_text(deaf)
    assert deaf != code and int(np.argmax(build(folder).run(run.u, quiet + drift).alarm)) == first[1]


def test_report_and_log_have_the_estimates():
    """Bounds as the C holds them, constants of filters and their starts, columns of a log, panels of a figure."""
    design, truth = whole(), true_run()
    t, trace = design.observer.tables["float32"].told, design.observer.run(truth.u, truth.y)
    delays, bounds = trailing_words.bounds(design, "float32")
    assert len(delays.rows) == 3 and len(bounds.rows) == 2
    cells = [c.text for c in bounds.rows[1].cells]
    assert cells[:2] == ["right", "sensor"] and at_most(float(t.h[:, -1, 1].max())) in cells[-1]
    folds = trailing_words.gains(design, "float32", _matrix)
    titles = " ".join(table.caption for fold in folds for table in fold.tables)
    assert "K: estimate from xi" in titles and "E of mode 1" in titles and "Phi" in titles
    header, *lines = replay.table(design.plant, truth, trace).splitlines()
    column = header.split(",").index("f_hat.sensor")
    assert float(lines[100].split(",")[column]) == trace.f_hat[100, 0]
    assert header.split(",")[column + 1] == "f_bound.sensor"
    assert len(plots._outputs(plots.whole(design.plant, truth, trace))) == 3


def test_validation_notices_a_bound_that_is_too_low():
    """The bound of the estimate is part of what runs are held against."""
    design, truth = whole(), true_run()
    trace = design.observer.run(truth.u, truth.y)
    assert not mode_promise.understated("discrete", truth, trace)[:80].any()
    low = replace(trace, f_bound=trace.f_bound * np.float32(0.1))
    assert mode_promise.understated("discrete", truth, low).any()
    away = replace(low, mode=1 - trace.mode)  # of a wrong mode nothing is said
    assert mode_promise.understated("discrete", truth, away).sum() < mode_promise.understated(
        "discrete", truth, low).sum()


@pytest.mark.parametrize("place, words", [(("told", "h"), "estimate"), (("told", "M"), "level|kept|matrix|positive"),
                                          (("reach",), "reach"), (("told", "u_hi"), "u_hi")])
def test_tampering_with_a_design_is_caught(place, words):
    """A constant of the filters, of the estimator, or of what joins them."""
    design = whole()
    data = scaled(design.observer.tables["float32"].to_dict(), place, 1.4 if place[-1] == "M" else 0.3)
    with pytest.raises(CertificateError, match=words):
        codegen.designs.claims_of(design.plant, TrailingTables.from_dict(data), design.certificate["float32"])


@pytest.mark.parametrize("old, new, words", [
    ("set_rows = 12", 'threshold = "calibrated"', "has to be proved"),
    ("set_rows = 12", 'modes = "sliding"', "needs a continuous plant"),
    ("minimum_dwell = 1", "", "no dwell time is declared"),
    ("Df = [[1], [0]]", "Df = [[1], [0]]\nDw = [[0.1], [0]]", "disturbances that are not in y")])
def test_refusals(old, new, words):
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(PUSHED.replace(old, new)))
