"""A bank's design: levels of the dossier, its certificate and what it refuses, when a start is forgotten, refusals."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from helpers import banks
from helpers.descriptors import example, plant

from codegen.certify.bank import isolable, left_square
from codegen.certify.exact import Q, rational
from codegen.certify.polytope_error import standard_errors
from codegen.errors import CertificateError
from codegen.plant.descriptor_many import simulate_many
from codegen.plant.load import gallery_names, load, loads
from codegen.plant.simulate import simulate
from codegen.selection.bank_claims import check
from codegen.selection.descriptors import problem_and_scaling
from codegen.selection.detectors import faults_of
from codegen.synthesis import hminus_hinf
from codegen.synthesis.bank import inapplicable, member
from codegen.synthesis.descriptor_gains import StandardGains
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.hminus_hinf import Faults


@pytest.mark.parametrize(("without", "level"), [(0, 0.8630), (1, 0.9492), (2, 1.2412)])
def test_levels_of_the_dossier(without, level):
    """Ratios of disturbance to slow faults of the two other sensors, decay 1."""
    seen = [i for i in range(3) if i != without]
    p = replace(example(), Bd=np.array([[[1], [0], [0.5]], [[0.5], [0], [0.5]], [[0.2], [0], [0.5]]]))
    p = replace(p, C=p.C[seen], Dd=p.Dd[seen], H=p.C[seen], J=p.Dd[seen])
    found = hminus_hinf.design(p, Faults(np.zeros((3, 3, 2)), np.eye(2)), Bounds(100.0, 1.0), "slow")
    assert found.gamma == pytest.approx(level, abs=1e-4)


def bank():
    d = banks.design()
    return d.plant, d.observer.tables["float32"], deepcopy(d.certificate["float32"])


def test_the_certificate_holds_and_says_what_is_calibrated():
    p, t, cert = bank()
    claims = check(p, t, cert)
    assert claims == banks.design().proved["float32"]
    assert len(claims) == 8 and claims[-1].startswith("CALIBRATED, not proved")
    assert sum("cannot move it" in c for c in claims) == 3
    c = cert["calibration"]
    assert np.all(np.array(c["levels"]) * 1.25**2 <= t.bound * (1 + 1e-6)) and c["confidence"] >= 0.95
    assert all(0 < size < 2 for size in isolable(p, t, cert))


def louder(t, cert):
    cert["members"][1]["beta"] *= 1.01


def louder_in_the_proof(t, cert):
    cert["members"][1]["beta"] *= 1.01
    cert["members"][1]["proof"]["fault"]["beta"] *= 1.01


def quieter(t, cert):
    cert["members"][0]["proof"]["level"]["level2"] *= 0.9
    cert["members"][0]["proof"]["level"]["gamma"] *= 0.96
    cert["members"][0]["gamma"] *= 0.96


def another_period(t, cert):
    cert["members"][2]["proof"]["period"] = 0.02


def faster(t, cert):
    cert["members"][2]["proof"]["level"]["contraction"] = 0.9


def hears_less(t, cert):
    cert["members"][0]["start"]["gain2"] *= 0.5


def no_campaign(t, cert):
    cert["calibration"]["runs"] = 0


def settles_sooner(t, cert):
    return replace(t, settle=t.settle // 2)


def bridges_more(t, cert):
    return replace(t, bridge=2 * t.bridge)


def bridges_more_often(t, cert):
    return replace(t, gap=t.gap - 1)


def lower_threshold(t, cert):
    return replace(t, bound=t.bound / 1000)


def judged_at_once(t, cert):
    return replace(t, x0_lo=t.x_lo, x0_hi=t.x_hi)


def of(t, k, **changes):
    return replace(t, members=tuple(replace(m, **changes) if i == k else m for i, m in enumerate(t.members)))


def reads_its_own_sensor(t, cert):
    return of(t, 0, seen=np.array([0, 2]))


def another_gain(t, cert):
    return of(t, 1, K=t.members[1].K * np.float32(1.5))


def another_weight(t, cert):
    return of(t, 1, M=t.members[1].M * np.float32(1.1))


def another_start(t, cert):
    return of(t, 2, z0=t.members[2].z0 + np.float32(5))


@pytest.mark.parametrize("mutant", [louder, louder_in_the_proof, quieter, another_period, faster, hears_less,
                                    no_campaign, settles_sooner, bridges_more, bridges_more_often, lower_threshold,
                                    judged_at_once, reads_its_own_sensor, another_gain, another_weight,
                                    another_start], ids=lambda m: m.__name__)
def test_the_exact_check_refuses(mutant):
    p, t, cert = bank()
    changed = mutant(t, cert)
    with pytest.raises(CertificateError):
        check(p, t if changed is None else changed, cert)


def test_what_a_start_leaves_is_below_its_bound():
    """The closed forms against the sum they bound, and the recursion of a member against both."""
    for a, c, n in ((0.04, 0.99, 300), (0.04, 0.9, 40), (0.5, 0.4, 12), (1.0, 0.7, 5)):
        exact = sum(a * (1 - a) ** (n - 1 - k) * c**k for k in range(n))
        assert exact <= float(left_square(a, c, n, Q(1.0), Q(1.0))) ** 0.5 * (1 + 1e-12)
    p, t, cert = bank()
    problem, s = problem_and_scaling(p)
    rng = np.random.default_rng(0)
    for k, m in enumerate(t.members):
        own = member(p, problem, faults_of(p), s, k)[1]
        gains = StandardGains(*(getattr(m, key).astype(float) for key in ("T2", "F", "G", "K", "C")))
        model = standard_errors(own, gains, np.array(cert["members"][k]["proof"]["T1"]), p.sample_period)
        N = [np.array(model.pairs[0, j][0][:3, :3], dtype=float) for j in range(3)]
        out = m.M.astype(float) @ np.array(model.residual[:, :3], dtype=float)
        for _ in range(20):
            x = np.where(rng.random(3) < 0.5, t.x_lo, t.x_hi).astype(float)
            e, average = (x - m.T2 @ (m.C @ x)) - m.z0, np.zeros(len(m.M))
            for _ in range(t.settle):
                average, e = average + t.rate * (out @ e - average), N[rng.integers(3)] @ e
            assert average @ average <= 0.05**2 * t.bound[k]


def test_many_runs_are_the_single_ones():
    for name in gallery_names():
        p = load(name)
        if p.polytope is None or name == "disc_points":
            continue
        scenario = replace(p.scenarios[-1], steps=15, fault=())
        for seed, many in enumerate(simulate_many(p, [(scenario, seed) for seed in range(2)])):
            one = simulate(p, scenario, seed=seed)
            for field in ("x", "u", "y", "w", "v", "f", "theta"):
                assert np.allclose(getattr(one, field), getattr(many, field), rtol=1e-12, atol=1e-12), (name, field)


CASES = {
    "one fault": ('f = [{ name = "sensor 1", range = [-2, 2] }, { name = "sensor 2", range = [-2, 2] }, { name = '
                  '"sensor 3", range = [-2, 2] }]', 'f = [{ name = "sensor 1", range = [-2, 2] }]', "1 faults"),
    "hidden": ("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "Df = [[1, 1, 0], [0, 0, 0], [0, 0, 1]]", "acts on no output"),
    "all sensors": ("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "Df = [[1, 0, 0], [1, 1, 0], [1, 0, 1]]",
                    "acts on 3 of 3 outputs"),
    "on the state": ("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
                     "Bf = [[0, 0, 0], [1, 0, 0], [0, 0, 0]]", "Bf is not zero"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_does_not_apply_is_said(case):
    old, new, words = CASES[case]
    text = plant("dlpv").text
    assert text.count(old) == 1
    text = text.replace(old, new)
    if case == "one fault":
        text = text.replace("Df = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "Df = [[1], [0], [0]]")
        text = text[:text.index('[[scenario]]\nname  = "three')]
    assert words in inapplicable(loads(text))
    assert inapplicable(plant("dlpv")) is None and "modes" in inapplicable(load("cart"))
    assert "do not see an algebraic state" in inapplicable(load("bioreactor"))


def test_rational_ranges_are_those_of_the_plant():
    """The ranges that starts are drawn from enclose the declared ones."""
    p, t, _ = bank()
    lo, hi = p.limits("x")
    assert np.all(rational(t.x_lo) <= rational(lo)) and np.all(rational(t.x_hi) >= rational(hi))
