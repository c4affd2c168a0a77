"""``mode-set`` after an alarm or a reset: what is certified where it is asked for, against runs from anywhere."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.checker import checker_of
from helpers.small_modes import TEXT
from scipy.linalg import expm

from codegen.assurance import mode_claims
from codegen.assurance.claims import Claim
from codegen.certify import mode_certificate
from codegen.certify.mode_claims import Claims
from codegen.certify.mode_restart import restarted
from codegen.errors import CertificateError
from codegen.observers.mode_set import ModeSet
from codegen.plant.load import loads
from codegen.selection.modes import certified


@pytest.fixture(scope="module")
def made():
    """Plant, tables and certificate of one number type, as a design has them for each."""
    p = loads(TEXT.replace('"mode-set"', '"mode-set"\nrestart = "certified"'))
    return SimpleNamespace(plant=p, **dict(zip(("t", "cert"), certified(p, p.options, "float32", None))))


def run_from_anywhere(p, rng, steps: int, mode: int, then: int | None = None, at: int = 0):
    """x anywhere in its range, everything at ends of its bounds, a switch within the period before sample ``at``.

    None where x leaves its range.
    """
    lo, hi = p.limits("x")
    x = np.where(rng.random(p.n_x) < 0.3, rng.choice([0, 1]), rng.random(p.n_x)) * (hi - lo) + lo
    u, y = [], []
    side, held = rng.random(p.n_u) < 0.5, rng.random() < 0.5
    for k in range(steps):
        if np.any(x < lo) or np.any(x > hi):
            return None
        m = p.modes[mode]
        side = side if held else rng.random(p.n_u) < 0.5
        u.append(np.where(side, *p.limits("u")))
        y.append(m.C @ x + m.D @ u[-1] + m.Dv @ np.where(rng.random(p.n_v) < 0.5, m.v_lo, m.v_hi))
        share = rng.random() if then is not None and k == at - 1 else 1.0
        for q, part in ((mode, share), (mode if then is None or k != at - 1 else then, 1 - share)):
            m, n = p.modes[q], p.n_x
            push = m.B @ u[-1] + m.Bw @ np.where(rng.random(p.n_w) < 0.5, m.w_lo, m.w_hi)
            M = np.zeros((n + 1, n + 1))
            M[:n, :n], M[:n, n] = m.A, push
            x = (expm(M * part * p.sample_period) @ np.append(x, 1))[:n]
            mode = q
    return np.array(u), np.array(y)


def decisions(t, u, y):
    """Modes decided for when everything starts in the widest boxes, as after a reset."""
    estimator = ModeSet(t)
    state = estimator.everywhere(t.wide_lo, t.wide_hi)
    answers = [estimator.step(state, a, b) for a, b in zip(u, y)]
    assert not any(a.alarm for a in answers)
    return np.array([a.mode for a in answers]), np.array([a.mode_set for a in answers])


def test_after_a_restart_the_decision_is_right_in_time(made):
    p, t, cert = made.plant, made.t, made.cert
    rng, slowest, identified = np.random.default_rng(0), 0, 0
    for _ in range(30):
        mode, at = int(rng.integers(2)), cert["calm"] + 1
        run = run_from_anywhere(p, rng, at + 12, mode, 1 - mode, at)
        if run is None:
            continue
        found, possible = decisions(t, *run)
        assert np.all(possible[:at] >> mode & 1) and np.all(possible[at:] >> (1 - mode) & 1)
        wrong = np.flatnonzero(found[:at] != mode)
        slowest = max(slowest, wrong[-1] + 1 if len(wrong) else 0)
        wrong = np.flatnonzero(found[at:] == mode)
        identified = max(identified, wrong[-1] + 2 if len(wrong) else 1)
    assert 2 <= slowest <= cert["restart"] and identified <= cert["worst"]
    words = next(s for s in mode_certificate.sentences(p, t, cert) if s.startswith("after a reset"))
    assert "after a reset, and after an alarm from the second sample without one on, mode is right after " \
           f"{cert['restart']} samples" in words and cert["calm"] > cert["restart"]


def test_false_certificates_are_refused(made):
    t, cert = made.t, made.cert
    for key in ("restart", "calm"):
        with pytest.raises(CertificateError, match=f"{key} is {cert[key] - 1} samples, only {cert[key]} proved"):
            mode_certificate.check(made.plant, t, cert | {key: cert[key] - 1})


delays = checker_of("delays")


@pytest.fixture(scope="module")
def checked(made, delays):
    """The independent checker on what design.json would say, with changes."""
    whole = json.loads(json.dumps({"plant": {"toml": made.plant.text}, "tables": {"float32": made.t.to_dict()},
                                   "certificate": {"float32": made.cert}}))

    def check(change=lambda cert, t: None):
        data = copy.deepcopy(whole)
        change(data["certificate"]["float32"], data["tables"]["float32"])
        return delays.check(data, "float32", list(zip(*(x.tolist() for x in made.plant.limits("x")))))

    assert check().startswith("delays hold, those after an alarm too")
    return check


def put(key, value):
    """Change a number of the certificate by so much."""
    return lambda cert, t: cert.__setitem__(key, cert[key] + value)


def older(cert, t):
    cert["ages"] = t["ages"] = cert["ages"] - 1


def wider(cert, t):
    for side in ("wide_lo", "wide_hi", "limit"):
        t[side] = [1.5 * a for a in t[side]]


def spoilt(course, what):
    """The multipliers of some stories are others, or are not there."""
    def change(cert, t):
        name = next(n for n in cert["witnesses"] if n.startswith(course))
        cert["witnesses"].update({name: what}) if what else cert["witnesses"].pop(name)
    return change


FALSE = {"restart": (put("restart", -1), "decision after an alarm"), "calm": (put("calm", -1), "until all holds again"),
         "calm too soon": (put("calm", -30), "until all holds|not narrow again"),
         "ages": (older, "after an alarm|gives birth"), "range": (wider, "may live|not narrow|wide"),
         "restart without": (spoilt("restart", None), "nothing refutes|nothing bounds"),
         "calm without": (spoilt("calm", None), "nothing refutes"),
         "nothing of calm": (spoilt("calm", "0 0 1"), "may live")}


@pytest.mark.parametrize("name", FALSE)
def test_the_independent_checker_refuses_other_delays(name, checked):
    change, words = FALSE[name]
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        checked(change)


def test_restart_has_a_claim_that_a_false_number_breaks(made):
    observer, cert = SimpleNamespace(family="mode"), made.cert
    design = SimpleNamespace(plant=made.plant, observer=observer)
    said = mode_certificate.sentences(made.plant, made.t, cert)

    def found(cert):
        claims = list(mode_claims.of_certificate(design, made.t, cert, Claim, (), ("exact", "independent")))
        assert len(claims) == len(said) and all(s.startswith(begins) for (begins, _), s in zip(claims, said))
        return next(make(s) for (begins, make), s in zip(claims, said) if begins.startswith("after a reset"))

    assert found(cert).id == "restart" and all(m.holds for m in found(cert).margins)
    assert "independent" in found(cert).checks
    assert "independent" not in found({k: v for k, v in cert.items() if k != "witnesses"}).checks
    assert not all(m.holds for m in found(cert | {"restart": cert["restart"] - 1}).margins)
    assert not all(m.holds for m in found(cert | {"calm": cert["calm"] - 1}).margins)


def test_few_ages_leave_it_open(made):
    """A wrong child of a wide box would come of age, and have children itself."""
    t, cert = made.t, made.cert
    assert cert["ages"] == t.ages == 9
    young = replace(t, ages=8)
    claims = Claims(young, made.plant.limits("x"), made.plant.limits("u"), 20, 60)
    with pytest.raises(CertificateError, match="Use at least 9 ages"):
        restarted(claims, np.array(cert["widths"]))
    claims = Claims(t, made.plant.limits("x"), made.plant.limits("u"), 20, 60)
    with pytest.raises(CertificateError, match="not narrow again within"):
        restarted(claims, 0.1 * np.array(cert["widths"]))
