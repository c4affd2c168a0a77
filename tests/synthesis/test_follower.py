"""A point observer that follows a mode estimator: the truth is never lost; wrong ways of it, and tampering, are."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from flint import arb
from helpers.follower import AGES, CASES, gains, plant, tables, told
from helpers.small_modes import exact_course
from helpers.tampering import scaled

import codegen
from codegen.analysis import mode_promise
from codegen.analysis.validate import judge
from codegen.assurance import point_margins
from codegen.certify import follower_certificate
from codegen.designs import claims_of, read_design
from codegen.emit import set_ranges
from codegen.errors import CertificateError, DesignError
from codegen.observers import FollowerObserver, FollowerTables, ModeObserver, Supervision, follower
from codegen.plant.load import load, loads
from codegen.selection.points import certified

RUNS, STEPS = 5, 50


@lru_cache
def courses(plant_name: str, name: str):
    """Switches as fast as allowed, then three times as slowly, the worst disturbance all the time."""
    return [exact_course(plant(name), AGES * (1 if seed < 3 else 3), STEPS, 35 + seed, (0, 0, 0, 1, -1)[seed])
            for seed in range(RUNS)]


def lost(name, t, real, observer=FollowerObserver):
    """Samples at which a state or the mode is lost, or there is an alarm; and the answers."""
    runs, bad = courses(CASES[name][0], name), 0
    u, y, q = (np.stack([getattr(run, k) for run in runs]).reshape(RUNS, STEPS, -1) for k in ("u", "y", "q"))
    out = observer({real: t}, Supervision()).run_many(u, y, q[..., 0], real)
    for i, run in enumerate(runs):
        for k, (x, q) in enumerate(zip(run.x, run.q)):
            held = all(arb(float(a)) <= b and b <= arb(float(c)) for a, b, c in
                       zip(out.x_lo[i, k], x, out.x_hi[i, k]))
            bad += (not held) or bool(out.alarm[i, k]) or not (k == 0 or int(out.mode_set[i, k]) >> int(q) & 1)
    return bad, out


@pytest.mark.parametrize("name, real", [(name, "float32") for name in CASES] + [("zonotope", "float64")])
def test_truth_is_kept_exactly(name, real):
    """Corners of everything, switches as fast as allowed; the truth in balls of 1e-50."""
    t = tables(name, real)
    bad, out = lost(name, t, real)
    assert bad == 0 and out.assured.all()
    _, alone = lost(name, t, real, ModeObserver)  # never wider than the estimator alone, no more modes
    own, others = out.x_hi - out.x_lo, alone.x_hi - alone.x_lo
    assert np.all(own <= others * (1 + 1e-5)) and own.mean() < others.mean()
    assert np.all(out.mode_set & ~alone.mode_set == 0)


def covers_all(t, now, alive, followed, own_lo, own_hi):
    """As ``hulls``, what began within the period cut to the observer's bounds as well."""
    lo, hi = ORIGINAL(t, now, alive, followed, own_lo, own_hi)
    its = (followed[:, None] == np.arange(alive.shape[1]))[..., None]
    return np.where(its, np.maximum(lo, own_lo[:, None]), lo), np.where(its, np.minimum(hi, own_hi[:, None]), hi)


def young_too(t, now, rows, p, kept, lo, hi):
    """As ``narrow``, the newest hypothesis cut as well."""
    alive = np.concatenate([now.alive[..., :1], now.alive], axis=-1)
    wide = follower.ModeState(*(np.concatenate([b[:, :, :1], b], axis=2) for b in (now.lo, now.hi)), alive, now.mode)
    NARROW(t, wide, rows, p, kept, lo, hi)
    now.lo, now.hi, now.alive = wide.lo[:, :, 1:], wide.hi[:, :, 1:], wide.alive[..., 1:]


ORIGINAL, NARROW = follower.hulls, follower.narrow


class NeverAnew(FollowerObserver):
    """Keeps its estimate where the mode that it follows may have begun within the period."""

    def started(self, t, lo, hi):
        """The estimate as it is, from the first start on."""
        fresh = super().started(t, lo, hi)
        return follower.chosen(self.followed < t.sizes[0], (self.x_hat, self.set, self.origin), fresh)


@pytest.mark.parametrize("name, where, instead", [
    ("box", "hulls", covers_all), ("box", "narrow", young_too), ("box", "observer", NeverAnew),
    ("between", "observer", NeverAnew)])
def test_other_ways_lose_the_truth(name, where, instead, monkeypatch):
    """What has just begun is not covered by the observer: cut to its bounds, or not a reason to start again."""
    observer = instead if where == "observer" else FollowerObserver
    if where != "observer":
        monkeypatch.setattr(follower, where, instead)
    assert lost(name, tables(name, "float32"), "float32", observer)[0] > 0


def test_wrong_mode_or_no_noise_loses_the_truth():
    t = tables("zonotope", "float32")
    own = t.told
    for wrong in (replace(own, M=own.M[::-1], A=own.A[::-1]), replace(own, L=own.L[::-1]),
                  replace(own, shape=replace(own.shape, F=0 * own.shape.F, e=0 * own.shape.e))):
        assert lost("zonotope", replace(t, told=wrong), "float32")[0] > 0
    shrunk = replace(t, grow=t.grow * np.float32(0.4))
    assert lost("zonotope", shrunk, "float32")[0] > 0


def test_tables_of_another_period_lose_the_truth():
    t, slow = tables("between", "float32"), replace(plant("between"), sample_period=0.04).enclosed
    wrong, _ = certified(slow, gains("between"), {"kind": "none"}, "float32")
    assert lost("between", replace(t, told=wrong), "float32")[0] > 0


class AlwaysSmall(FollowerObserver):
    """Starts every table with the smallest size."""

    def started(self, t, lo, hi):
        """As before, another size."""
        x, shape, origin = super().started(t, lo, hi)
        return x, np.stack([np.full(len(x), t.told.shape.anew - 1), shape[:, 1]], axis=1), origin


def test_smaller_thresholds_lose_the_truth():
    """Those of residuals, the widths, rows that come too early, and sizes that do not hold the start."""
    t = tables("table", "float32")
    z, early = t.told.shape, lambda rows: np.concatenate([rows[:, :, 3:], *[rows[:, :, -1:]] * 3], axis=2)
    assert lost("table", t, "float32")[0] == 0
    for wrong in (replace(z, h=z.h * np.float32(0.5)), replace(z, hx=z.hx * np.float32(0.5)),
                  replace(z, h=early(z.h), hx=early(z.hx)), replace(z, sizes=z.sizes * np.float32(8))):
        assert lost("table", replace(t, told=replace(t.told, shape=wrong)), "float32")[0] > 0
    assert lost("table", t, "float32", AlwaysSmall)[0] > 0


def test_margins_of_a_table():
    """What assurance would state of it; a width that is less than the last rows does not hold, nor do they by less."""
    (t, cert), modes = told("table", "float32"), plant("table").modes
    held = point_margins.HELD["starts"](modes, t, cert)
    assert all(m.holds for margins in held.values() for m in margins)
    assert held["alarm"] and held["bounded"] and held["ultimate"]
    less = cert | {"steady_box": {k: [0.9 * x for x in v] for k, v in cert["steady_box"].items()}}
    assert not any(m.holds for m in point_margins.HELD["starts"](modes, t, less)["ultimate"])
    small = replace(t, shape=replace(t.shape, h=t.shape.h * np.float32(0.99)))
    with pytest.raises(CertificateError, match="start 0 in mode 0"):
        point_margins.HELD["starts"](modes, small, cert)
    assert set_ranges.RANGES["starts"](t, {}).words == {"stage": 4, "since": 8}


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_a_start_takes_a_size_that_holds_it(real):
    """The smallest of the listed ones, and none of them where a half width is larger."""
    t = tables("table", real)
    z, run = t.told.shape, FollowerObserver({real: t}, Supervision())
    run.start(t, 1)
    rng = np.random.default_rng(2)
    half = (10.0 ** rng.uniform(-4, 1, (300, len(t.x_lo)))).astype(real)
    half[:len(z.sizes)] = z.sizes
    size, since = run.inner.begun(t.told, half).T
    assert set(size) == set(range(len(z.sizes) + 1)) and not since.any()
    for d, k in zip(half, size):
        assert k == z.anew or np.all(d <= z.sizes[k])
        assert k == z.anew - 1 or not np.all(d <= z.sizes[k + 1 if k < z.anew else 0])
    assert list(size[:len(z.sizes)]) == list(range(len(z.sizes)))


@pytest.mark.parametrize("name, real", [("ellipsoid", "float32"), ("box", "float64")])
def test_a_start_holds_its_box(name, real):
    """Exactly: boxes of every size, single points and numbers below the normal ones among them."""
    t, rng = tables(name, real), np.random.default_rng(5)
    run = FollowerObserver({real: t}, Supervision())
    run.start(t, 400)
    n = len(t.x_lo)
    middle = rng.uniform(t.x_lo, t.x_hi, (400, n))
    half = 10.0 ** rng.uniform(-50 if real == "float32" else -320, 0.5, (400, n)) * (rng.random((400, n)) < 0.9)
    middle = np.where(rng.random((400, n)) < 0.5, 0, middle)
    lo, hi = (middle + s * half for s in (-1, 1))
    lo, hi = (np.clip(b.astype(real), t.x_lo, t.x_hi) for b in (lo, hi))
    x, shape, _ = run.started(t, lo, hi)
    reach = np.stack([shape[:, i, i] for i in range(n)], axis=1) if t.by_squares else shape
    many = n if t.by_squares else 1
    for k in range(400):
        for i in range(n):
            need = max(abs(arb(float(b)) - arb(float(x[k, i]))) for b in (lo[k, i], hi[k, i]))
            held = arb(float(reach[k, i]))
            assert (many * need * need if t.by_squares else need) <= held
    width = (hi - lo).astype(float)
    wide = (width > 0.9 * (t.x_hi - t.x_lo)).any(axis=1)  # may start from the declared range
    most = many * (width / 2 * 1.001) ** (2 if t.by_squares else 1) + 1e-5 * np.abs(x) + 1e-12
    assert (~wide).any() and np.all(reach[~wide] <= most[~wide])  # and little more than that


def test_parts_go_together():
    """The check refuses less room and constants of another observer, before it looks at the delays."""
    t, p = tables("box", "float32"), plant("box")
    cert = {"told": told("box", "float32")[1]}
    own, tenth = t.told, np.float32(0.1)
    weaker = replace(own, shape=replace(own.shape, g=own.shape.g * np.float32(0.9)))
    table, sized = tables("table", "float32"), {"told": told("table", "float32")[1]}
    z = table.told.shape
    for wrong, words in ((replace(z, sizes=z.sizes * np.float32(1.1)), "start 0 in mode 0: .*stage 0"),
                         (replace(z, h=z.h[1:], hx=z.hx[1:]), "parts of the table"),
                         (replace(z, hx=z.hx * np.float32(0.98)), "row 0"),
                         (replace(z, h=np.minimum(z.h, z.h[:1])), "start 4 in mode")):
        with pytest.raises(CertificateError, match=words):
            follower_certificate.check(plant("table"), replace(table, told=replace(table.told, shape=wrong)), sized)
    for wrong, words in ((replace(t, xi_room=t.xi_room * tenth), "xi_room"), (replace(t, u_hi=t.u_hi * 2), "u_hi"),
                         (replace(t, x_hi=t.x_hi * 9), "ranges of x"), (replace(t, grow=np.float32(1)), "grow"),
                         (replace(t, square=np.float32(2)), "square"), (replace(t, floor=t.floor * tenth), "floor"),
                         (replace(t, set="zonotope"), 'of a set "box"'),
                         (replace(t, told=weaker), "g")):
        with pytest.raises(CertificateError, match=words):
            follower_certificate.check(p, wrong, cert)


# ---------------------------------------------------------------------------------------------- the whole way


@lru_cache
def committed():
    return read_design(Path(__file__).parents[2] / "generated" / "fan_zonotope")


def test_the_gallery_plant_the_whole_way(tmp_path):
    """Scenarios keep what is promised; bounds are a third as wide as the estimator's, faults of half the size found."""
    made = committed()
    p, cert = made.plant, made.certificate["float32"]
    assert made.observer.family == "follower" and cert["told"]["set"] == "zonotope"
    assert read_design(made.save(tmp_path / "design.json")).digest == made.digest
    assert claims_of(p, made.observer.tables["float32"], cert) == made.claims("float32")
    run = codegen.simulate(p, "turned round")
    trace = made.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == outcome.false_alarms == 0 and outcome.settled.all() and trace.assured.all()
    assert mode_promise.late("discrete", cert, run, trace, outcome.settled) == 0
    estimator = ModeObserver({r: t for r, t in made.observer.tables.items()}, Supervision())
    alone = estimator.run(run.u, run.y)
    width, wide = ((o.x_hi - o.x_lo)[20:].mean(axis=0) for o in (trace, alone))
    assert np.all(width < [0.7, 0.4] * wide)
    shifted = run.y + np.where(np.arange(300) >= 160, 0.05, 0)[:, None]
    first = [int(np.argmax(o.run(run.u, shifted).alarm)) for o in (made.observer, estimator)]
    assert 160 <= first[0] <= 162 < first[1]


@pytest.mark.parametrize("place, words", [
    (("told", "shape", "F", 0, -1, 0, 0), r"e\[0\]"), (("grow",), "grow"), (("reach", 1, 0), "reach"),
    (("told", "M", 1, 0, 0), "M|error|e")])
def test_tampering_is_caught(place, words):
    """A constant of the observer, of the estimator, or of what joins them, made less."""
    made = committed()
    data = scaled(made.observer.tables["float32"].to_dict(), place, 0.3)
    with pytest.raises(CertificateError, match=words):
        claims_of(made.plant, FollowerTables.from_dict(data), made.certificate["float32"])


@pytest.mark.parametrize("old, new, words", [
    ("known = false", "known = true", "ages|modes"),
    ("order     = 8", 'tables    = "arbitrary"', 'sees one mode alone, so "dwell" is never worse than "arbitrary"'),
    ("order     = 8", 'tables    = "schedule"', '"none" or "dwell": .* never worse than "schedule"'),
    ("minimum_dwell = 1 ", "# ", "cannot be found there: no dwell time is declared"),
    ('-0.005, 0.005] }]\nv = [{ name = "noise", bounds = [-0.02, 0.02]',
     '0, 0] }]\nv = [{ name = "noise", bounds = [0, 0]', "nothing disturbs the plant")])
def test_refusals(old, new, words):
    text = load("fan").text.replace(old, new).replace("[observer]", '[observer]\nmodes = "set"')
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(text))
