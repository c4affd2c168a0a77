"""Framers over the set of possible modes: the truth is never lost, whatever the switching; wrong ways of it are."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flint import arb
from helpers.driven import AGES, PLANTS, plant, tables, told, turned_design
from helpers.small_modes import exact_course
from helpers.tampering import altered

import codegen
from codegen.analysis import mode_promise
from codegen.analysis.validate import judge
from codegen.certify import driven_certificate
from codegen.designs import claims_of, read_checked
from codegen.errors import CertificateError, DesignError
from codegen.observers import DrivenObserver, DrivenTables, ModeObserver, Supervision, driven
from codegen.plant.bounded import bounded
from codegen.plant.load import loads
from codegen.report.design_words import words_of

RUNS, STEPS = 6, 70
#: Mean width against that of the estimator alone.
NARROWER = {"constant": 1, "parameters": 0.92, "hidden": 0.99, "discrete": 1, "turned": 0.9}


@lru_cache
def courses(name):
    """Half of them switch as fast as allowed; the others three times as slowly, the worst disturbance all the time."""
    return [exact_course(plant(name), AGES * (1 if seed < RUNS // 2 else 3), STEPS, seed, (0, 0, 0, 0, 1, -1)[seed])
            for seed in range(RUNS)]


def answers(name, t, real, observer=DrivenObserver):
    runs = courses(name)
    return observer({real: t}, Supervision()).run_many(
        *(np.stack([getattr(run, k) for run in runs]) for k in ("u", "y", "q")), real,
        theta=np.stack([run.theta for run in runs]))


def lost(name, t, real, observer=DrivenObserver):
    """Samples at which a state or the mode is lost, or there is an alarm; and the answers."""
    out, bad = answers(name, t, real, observer), 0
    for i, run in enumerate(courses(name)):
        for k, (x, q) in enumerate(zip(run.x, run.q)):
            held = all(arb(float(a)) <= b and b <= arb(float(c)) for a, b, c in
                       zip(out.x_lo[i, k], x, out.x_hi[i, k]))
            here = k == 0 and plant(name).kind == "discrete" or bool(int(out.mode_set[i, k]) >> int(q) & 1)
            bad += (not held) or (not here) or bool(out.alarm[i, k])
    return bad, out


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", PLANTS)
def test_truth_is_kept_exactly(name, real):
    """Corners of everything, switches as fast as allowed; the truth in balls of 1e-50."""
    t = tables(name, real)
    bad, out = lost(name, t, real)
    assert bad == 0 and out.assured.all()
    # The bounds are those of the estimator alone, or narrower; framers tell modes apart that it does not.
    alone = answers(name, t, real, ModeObserver)
    own, others = out.x_hi - out.x_lo, alone.x_hi - alone.x_lo
    assert np.all(own <= others * (1 + 1e-5)) and own.mean() <= NARROWER[name] * others.mean()
    assert np.all(out.mode_set & ~alone.mode_set == 0)


def not_widened(t, run, now, kept, lo, hi):
    """As ``framed``, but the newest hypothesis adds nothing where framers live."""
    new_lo, new_hi = ORIGINAL(t, run, now, kept, lo, hi)
    here = (kept & now.alive[..., 1:].any(axis=-1))[..., None]
    return np.where(here, np.maximum(new_lo, lo), new_lo), np.where(here, np.minimum(new_hi, hi), new_hi)


def wrong_box(t, run, now, kept, lo, hi):
    """As ``framed``, with the newest box of the next mode."""
    other = replace(now, lo=now.lo.copy(), hi=now.hi.copy(), alive=now.alive)
    other.lo[:, :, 0], other.hi[:, :, 0] = now.lo[:, ::-1, 0], now.hi[:, ::-1, 0]
    return ORIGINAL(t, run, other, kept, lo, hi)


def young_too(t, now, kept, lo, hi):
    """As ``narrowed``, the newest hypothesis cut as well."""
    older, now.alive = now.alive, np.concatenate([now.alive[..., :1], now.alive], axis=-1)
    now.lo, now.hi = (np.concatenate([b[:, :, :1], b], axis=2) for b in (now.lo, now.hi))
    out = NARROWED(t, now, kept, lo, hi)
    out.lo, out.hi, out.alive = out.lo[:, :, 1:], out.hi[:, :, 1:], out.alive[..., 1:] & older
    return out


ORIGINAL, NARROWED, TURNED = driven.framed, driven.narrowed, driven.turned


@pytest.mark.parametrize("name", ["hidden", "discrete"])
@pytest.mark.parametrize("where, instead", [("framed", not_widened), ("framed", wrong_box), ("narrowed", young_too)])
def test_other_ways_lose_the_truth(name, where, instead, monkeypatch):
    """Framers that are not widened by a switch, or by another mode's, or that cut what has just begun."""
    monkeypatch.setattr(driven, where, instead)
    assert lost(name, tables(name, "float32"), "float32")[0] > 0


def test_other_coordinates_begin_anew_and_are_carried(monkeypatch):
    """z that was made of x before a switch could have been loses the truth; z made of x at every sample is useless."""
    t, lived = tables("turned", "float32"), {}

    def noted(t, run, now, kept, lo, hi):
        lived["kept"] = kept & now.alive[..., 1:].any(axis=-1)
        return ORIGINAL(t, run, now, kept, lo, hi)

    monkeypatch.setattr(driven, "framed", noted)
    monkeypatch.setattr(driven, "turned", lambda told, moved, x, z: TURNED(told, lived["kept"], x, z))
    assert lost("turned", t, "float32")[0] > 0
    monkeypatch.setattr(driven, "turned", lambda told, moved, x, z: TURNED(told, moved, x, [a[:, ::-1] for a in z]))
    assert lost("turned", t, "float32")[0] > 0
    monkeypatch.setattr(driven, "turned", lambda told, moved, x, z: TURNED(told, 0 * moved > 0, x, z))
    bad, out = lost("turned", t, "float32")
    alone = answers("turned", t, "float32", ModeObserver)
    assert bad == 0 and np.mean(out.x_hi - out.x_lo) > 0.97 * np.mean(alone.x_hi - alone.x_lo)


@pytest.mark.parametrize("part", ["d_hi", "Z", "X"])
def test_other_coordinates_of_another_step_lose_the_truth(part):
    t = tables("turned", "float32")
    own, c = t.told, t.told.change
    wrong = {"d_hi": {"d_hi": 0 * own.d_hi, "d_lo": 0 * own.d_lo},
             "Z": {"change": replace(c, Z=0.9 * c.Z)}, "X": {"change": replace(c, X=c.X[::-1])}}[part]
    assert lost("turned", replace(t, told=replace(own, **wrong)), "float32")[0] > 0


@pytest.mark.parametrize("part, factor, words", [
    ("e_lo", 0.5, "offset e_lo"), ("b_hi", 0.5, "offset b_hi"), ("X", 1.001, "offset b"), ("z_hi", 0.999, "range of z"),
    ("box", 0.5, "range of z"), ("Z", 1.001, "offset|range of z"), ("N", 0.1, "next sample")])
def test_other_coordinates_are_certified(part, factor, words):
    """Both maps, the range of z, and that nothing of the next sample is read; all before the delays."""
    t, p, cert = tables("turned", "float32"), plant("turned"), {"told": told("turned", "float32")[1]}
    own, c = t.told, t.told.change
    driven_certificate.check_framers(p.observed.modes, own, cert["told"])
    wrong = replace(own, N_hi=own.N_hi + np.float32(factor)) if part == "N" else replace(
        own, change=replace(c, **{part: getattr(c, part) * np.float32(factor)}))
    with pytest.raises(CertificateError, match=words):
        driven_certificate.check(bounded(p), p.observed.modes, replace(t, told=wrong), cert)


def test_wrong_mode_or_no_margin_loses_the_truth():
    t = tables("parameters", "float32")
    own = t.told
    for wrong in (replace(own, M_hi=own.M_hi[::-1], M_lo=own.M_lo[::-1]),
                  replace(own, G_hi=own.G_hi[::-1], G_lo=own.G_lo[::-1]), replace(own, d_hi=-own.d_hi)):
        assert lost("parameters", replace(t, told=wrong), "float32")[0] > 0


def test_rounding_of_coordinates_is_in_the_boxes():
    """The room of S x is what certifies; the check refuses less, and framers that do not go together."""
    t, p = tables("parameters", "float32"), plant("parameters")
    cert = {"told": told("parameters", "float32")[1]}
    driven_certificate.check_joint(t)
    own = t.told
    for wrong, words in ((replace(t, xi_room=t.xi_room * np.float32(0.3)), "xi_room"),
                         (replace(t, S_rounded=t.S_rounded * np.float32(1.001)), "xi_room"),
                         (replace(t, u_hi=t.u_hi * 2), "u_hi"), (replace(t, x_hi=t.x_hi * 9), "ranges of x"),
                         (replace(t, told=replace(own, vary=replace(own.vary, late=True))), "told late"),
                         (replace(t, told=replace(own, d_hi=own.d_hi * np.float32(0.9))), "d_hi|offset")):
        with pytest.raises(CertificateError, match=words):  # all before the delays
            driven_certificate.check(bounded(p), p.observed.modes, wrong, cert)


@pytest.mark.parametrize("name", PLANTS)
def test_a_fault_is_found_without_being_told_the_mode(name):
    real, run = "float32", courses(name)[0]
    t = tables(name, real)
    y = run.y + np.where(np.arange(STEPS) >= 30, 0.9, 0.0)[:, None]
    out = DrivenObserver({real: t}, Supervision()).run(run.u, np.clip(y, -3, 3), run.q, run.theta, real)
    assert not out.alarm[:30].any() and out.alarm[30:33].any() and not out.assured[40:].any()


def test_parameters_are_bounded():
    """Every matrix in the box of parameters is the middle one and a disturbance within the bounds added."""
    p, rng = plant("parameters"), np.random.default_rng(1)
    q = bounded(p)
    assert not q.theta and bounded(q) is q and q.n_w == p.n_w + p.n_x
    tight = 0.0
    for m, b in zip(p.modes, q.modes):
        for _ in range(200):
            theta, x, u = (np.array([rng.choice(ends) for ends in zip(*p.limits(v))]) for v in ("theta", "x", "u"))
            A, B = (getattr(m, n) + sum(s * S for s, S in zip(theta, m.theta_terms.get(n, [0 * getattr(m, n)] * 2)))
                    for n in "AB")
            d = (A - b.A) @ x + (B - b.B) @ u
            assert np.all(np.abs(d) <= b.w_hi[p.n_w:] * (1 + 1e-12))
            tight = max(tight, np.abs(d[1]) / b.w_hi[-1])
    assert tight > 0.99


# ---------------------------------------------------------------------------------------------- the whole way

CERTIFIED = PLANTS["discrete"].replace("[-0.02, 0.03]", "[-0.001, 0.002]").replace(
    'method = "mode-set"', 'method = "tnl-interval"\nmodes = "set"\ngains = { L = [[[0.3], [-0.1]], [[0.3], [0]]], '
    "N = [[[0.5], [0]], [[0.5], [0]]] }").replace("B = [[0.1], [0.1]]", "B = [[-0.2], [0.2]]")


@lru_cache
def certified():
    return codegen.design(loads(CERTIFIED))


def test_a_discrete_plant_the_whole_way(tmp_path):
    """From plant file to certified design and back; scenarios keep what is promised, sooner than what is certified."""
    made = certified()
    p, cert = made.plant, made.certificate["float32"]
    assert made.observer.family == "driven" and "at any sample" in made.claims("float32")[0]
    again = read_checked(made.save(tmp_path / "design.json"))
    assert again.digest == made.digest
    for real, t in made.observer.tables.items():
        assert t.to_dict() == again.observer.tables[real].to_dict()
    run = codegen.simulate(p, "between samples")
    trace = made.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == outcome.false_alarms == 0 and outcome.settled.all() and trace.assured.all()
    assert mode_promise.late("discrete", cert, run, trace, outcome.settled) == 0
    wrong = replace(trace, mode_set=np.where(np.arange(100) == 50, 1, trace.mode_set).astype(np.uint32))
    assert judge(p, p.scenarios[0], run, wrong, []).lost == 1


@pytest.mark.parametrize("place, words", [
    (("told", "d_hi", 0, 0), "d_hi"), (("xi_room", 0), "xi_room"), (("reach", 1, 0), "reach"),
    (("birth", 0, 1, 0), "birth"), (("J", 0, 1, 0, 0), "not zero")])
def test_tampering_is_caught(place, words):
    """A constant of the framers, of the estimator, or of what joins them, made less (or, zero, made more)."""
    data = altered(certified().observer.tables["float32"].to_dict(), place, lambda value: 0.3 * value or 0.5)
    t = DrivenTables.from_dict(data)
    with pytest.raises(CertificateError, match=words):
        claims_of(certified().plant, t, certified().certificate["float32"])


def test_other_coordinates_the_whole_way(tmp_path):
    """Gains and R of the user; bounds narrower than those of the estimator alone, and the report says how."""
    made = turned_design()
    p, t = made.plant, made.observer.tables["float32"]
    assert made.observer.family == "driven" and "those of z = Z x" in made.claims("float32")[1]
    again = read_checked(made.save(tmp_path / "design.json"))
    assert again.digest == made.digest and again.observer.tables["float32"].to_dict() == t.to_dict()
    run = codegen.simulate(p, "between samples")
    trace = made.observer.run(run.u, run.y)
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == outcome.false_alarms == 0 and trace.assured.all()
    alone = ModeObserver({"float32": t}, Supervision()).run(run.u, run.y)
    assert np.mean(trace.x_hi - trace.x_lo) < 0.9 * np.mean(alone.x_hi - alone.x_lo)
    assert "bounds of z = Z x, of which those of x are made" in str(words_of(made, "float32"))
    for key, words in (("e_hi", "offset e_hi"), ("b_lo", "offset b_lo"), ("z_hi", "range of z")):
        data = t.to_dict()
        data["told"]["change"][key] = [0.9 * x for x in data["told"]["change"][key]]
        with pytest.raises(CertificateError, match=words):
            claims_of(p, DrivenTables.from_dict(data), made.certificate["float32"])


@pytest.mark.parametrize("old, new, words", [
    ("known = false", "known = true", "observer.modes says how the mode is found"),
    ('modes = "set"', 'modes = "sliding"', "cannot be found there: needs a continuous plant"),
    ("minimum_dwell = 1", "", "cannot be found there: no dwell time is declared"),
    ('method = "tnl-interval"', 'method = "hinf-filter"', 'observer.gains is no option of this method')])
def test_refusals(old, new, words):
    with pytest.raises(DesignError, match=words):
        codegen.design(loads(CERTIFIED.replace(old, new)))
