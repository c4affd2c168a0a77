"""``mode-set`` from plant file to design: constants that hold the plant, delays, refusals; wrong ones are caught."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from flint import arb

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.small_modes import PLANTS, TEXT, exact_course, plant, quiet, tables  # noqa: E402

import codegen  # noqa: E402
from codegen.analysis import mode_promise  # noqa: E402
from codegen.analysis.validate import judge  # noqa: E402
from codegen.certify import mode_certificate, mode_widths  # noqa: E402
from codegen.certify.mode_claims import contracted  # noqa: E402
from codegen.certify.mode_steps import check_enclosure  # noqa: E402
from codegen.certify.mode_widths import narrowed  # noqa: E402
from codegen.designs import read_checked  # noqa: E402
from codegen.errors import CertificateError, DesignError, PlantError  # noqa: E402
from codegen.observers import ModeTables  # noqa: E402
from codegen.observers.mode_set import ModeSet  # noqa: E402
from codegen.plant.load import loads  # noqa: E402
from codegen.synthesis.mode_tables import tables_of  # noqa: E402

AGES = 3


@lru_cache
def designed():
    return codegen.design(plant())


def lost(p, t, seeds=2, steps=100):
    """Samples of exact courses at which the true mode is not possible or the true state is out of its bounds."""
    bad = 0
    for seed in range(seeds):
        run = exact_course(p, t.ages, steps, seed)
        for answer, q, x in zip(ModeSet(t).run(run.u, run.y), run.q, run.x):
            held = all(arb(float(a)) <= v <= arb(float(b)) for a, v, b in zip(answer.x_lo, x, answer.x_hi))
            bad += (not answer.mode_set >> int(q) & 1) or not held or bool(answer.alarm)
    return bad


# ---------------------------------------------------------------------------------------------- soundness

@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", PLANTS)
def test_truth_is_kept_exactly(name, real):
    """Corners of everything, switches as fast as allowed and a hair beside samples; the truth in balls of 1e-50."""
    assert lost(plant(name), tables(name, AGES, real)) == 0
    check_enclosure(plant(name), tables(name, AGES, real))


def test_rounding_is_in_the_boxes():
    """Without disturbance and noise rounding is all that there is; tables that leave it out lose the truth."""
    p = quiet(plant())
    sound, exact = (tables_of(ModeTables, p, AGES, real) for real in ("float32", "float64"))
    assert lost(p, sound) == 0
    names = ("reach", "birth", "v_lo", "v_hi", "J_radius", "J_u_radius", "J_reach", "x_room")
    bare = replace(sound, **{name: getattr(exact, name).astype("float32") for name in names})
    assert lost(p, bare) > 0
    with pytest.raises(CertificateError, match="expected: the true mode could be dropped|does not hold"):
        check_enclosure(p, bare)


SHRUNK = {"reach": 0.5, "birth": 0.9, "J_radius": 0.7, "J_u_radius": 0.5, "J_reach": 0.5, "v_lo": 0.999, "v_hi": 0.999,
          "x_room": 0.1, "start_hi": 0.999, "wide_lo": 0.999, "limit": 0.2, "Phi": 1.001, "Gamma": 0.999, "J": 1.01,
          "J_shift": 0.9, "S_inverse": 1.001, "D": 1.01, "S": 1.01}


def test_far_ranges_are_rounded_for():
    """Ranges a thousand times the true ones, where what sums lose is as large as the noise; the check sees it all."""
    far = loads(TEXT.replace("range = [-2.5, 2]", "range = [-2500, 2000]").replace("D  = [[0.1]]\n", ""))
    t = tables_of(ModeTables, far, 3, "float32")
    check_enclosure(far, t)
    with pytest.raises(CertificateError, match="birth"):
        check_enclosure(far, replace(t, birth=t.birth * np.float32(0.8)))
    with pytest.raises(CertificateError, match="does not hold"):
        check_enclosure(far, replace(t, v_lo=t.v_lo * np.float32(0.999)))


@pytest.mark.parametrize("name", SHRUNK)
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_wrong_constants_are_caught(name, real):
    t = tables("one input", AGES, real)
    wrong = (getattr(t, name) * SHRUNK[name] + (0.01 if name == "J_shift" else 0)).astype(getattr(t, name).dtype)
    with pytest.raises(CertificateError):
        check_enclosure(plant(), replace(t, **{name: wrong}))


def test_narrow_boxes_grow_again():
    """The widths after a long stay count too: those of a narrow box are not the last word."""
    t = tables("one input", AGES, "float64")
    zero = np.zeros(2)
    ever = contracted(t, zero, 0, 2)
    few = zero
    for _ in range(400):
        few = narrowed(t, few, 0)
        assert np.all(few <= ever)
    assert np.all(ever < 1.01 * few) and ever[1] > 1.2 * narrowed(t, zero, 0)[1]
    with pytest.raises(CertificateError, match="grows while the mode stays"):
        contracted(replace(t, Phi=2 + 0 * t.Phi), zero, 0, 2)


# ---------------------------------------------------------------------------------------------- certificate

def test_certificate_of_a_design():
    made = designed()
    cert = made.certificate["float32"]
    assert set(made.observer.tables) == {"float32", "float64"} and cert["worst"] <= 3 and cert["start"] <= 2
    assert made.observer.tables["float32"].ages == made.observer.tables["float64"].ages == cert["ages"] < cert["dwell"]
    words = " ".join(made.claims("float32"))
    assert f"within {cert['worst']} samples" in words and '"open" to "shut"' in words and "float32" in words


@pytest.mark.parametrize("key, change, words", [
    ("old", lambda c: [[0, 1], [2, 0]], "old of the switch"), ("identified", lambda c: [[0, 1], [1, 0]], "identified"),
    ("worst", lambda c: 1, "worst is 1"), ("start", lambda c: 0, "start is 0"), ("quiet", lambda c: 1, "quiet is 1"),
    ("widths", lambda c: (0.5 * np.array(c["widths"])).tolist(), "may grow beyond"),
    ("ages", lambda c: 9, "for 9 ages"), ("dwell", lambda c: 21, "dwell time of 21")])
def test_false_certificates_are_refused(key, change, words):
    made = designed()
    t, cert = made.observer.tables["float32"], made.certificate["float32"]
    with pytest.raises(CertificateError, match=words):
        mode_certificate.check(made.plant, t, {**cert, key: change(cert)})


def test_design_reads_back_and_tampering_is_seen(tmp_path):
    made = designed()
    path = made.save(tmp_path / "design.json")
    again = read_checked(path)
    for real, t in made.observer.tables.items():
        fresh = again.observer.tables[real]
        assert all(np.array_equal(getattr(t, name), getattr(fresh, name)) for name in t.__dataclass_fields__)
        assert all(getattr(t, name).dtype == getattr(fresh, name).dtype for name in ("S", "Phi", "v_lo"))
    data = json.loads(path.read_text())
    data["tables"]["float32"]["reach"][0][0] *= 0.5
    path.write_text(json.dumps(data))
    with pytest.raises(CertificateError, match="a stored number was changed"):
        read_checked(path)


@pytest.mark.parametrize("old, new, words", [
    ("known = false", "known = true", "mode is known at run time, expected switching.known = false"),
    ("minimum_dwell = 1", "", "expected switching.minimum_dwell"),
    ("minimum_dwell = 1", "minimum_dwell = 0.06", "less than two samples"),
    ('{ name = "level", range = [-3, 3] }', '{ name = "level" }', 'range of "level" in signals.y'),
    ('method = "mode-set"', 'method = "mode-set"\nages = 40', "ages is 40, expected a whole number from 1 to 31"),
    ('method = "mode-set"', 'method = "mode-set"\nages = 3.5', "ages is 3.5, expected a whole number from 1 to 31"),
    ("A = [[-2, 1], [0, -3]]", "A = [[-2, 1], [0, -3e6]]", r'mode "open" has \|A\| T = 1.5e\+05, expected at most 40'),
    ('method = "mode-set"', 'method = "mode-set"\norder = 3', "observer.order is no option of this method"),
    ('method = "mode-set"', 'method = "mode-set"\nhorizn = 9', 'Did you mean "horizon"'),
    ('method = "mode-set"', 'method = "mode-sett"', 'Did you mean "mode-set"'),
    ("range = [0.5, 2]", "range = [-2, 2]", "modes (open|shut) and (open|shut) cannot be told apart"),
    ("[30.25,", "[58.25,", "samples 58.25 to 60 are 1.75 .expected 20 at least, switching.minimum_dwell"),
    ('method = "mode-set"', 'method = "tnl-interval-lpv"', "D is not zero"),
    ('method = "mode-set"', 'method = "tnl-interval"', "the plant is continuous")])
def test_refusals(old, new, words):
    text = TEXT.replace(old, new).replace("30.25", "30").replace("60.5", "60")
    with pytest.raises((DesignError, CertificateError, PlantError), match=words):
        codegen.design(loads(text))


@pytest.mark.parametrize("old, new, words", [
    ("minimum_dwell = 1", "minimum_dwell = 0.1", "valve: certificate: .* the dwell time is 2"),
    ('method = "mode-set"', 'method = "mode-set"\nages = 1', "Use at least"),
    ("B = [[-2], [2]]", "B = [[1], [1.0001]]", "told apart|may live")])
def test_what_cannot_be_certified(old, new, words):
    with pytest.raises(CertificateError, match=words):
        codegen.design(loads(TEXT.replace(old, new).replace("A = [[-2, 1], [1, -4]]", "A = [[-2, 1], [0, -3]]")
                             if "B" in old else TEXT.replace(old, new)))


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", PLANTS)
def test_no_noise_leaves_room_for_rounding(name, real):
    """An end of the noise that is zero has no rounding of its own to hide in."""
    still = quiet(plant(name))
    t = tables_of(ModeTables, still, AGES, real)
    check_enclosure(still, t)
    p, noise = len(t.v_lo), np.maximum(-t.v_lo, t.v_hi).astype(float)
    far = np.maximum(abs(t.wide_lo), abs(t.wide_hi)).astype(float)[:p]
    share = (len(t.S) + len(t.u_lo) + 8) * np.finfo(real).eps  # what the independent checker asks for
    assert np.all(share * (far + 5 * noise) <= noise)


@pytest.mark.parametrize("dwell, period, samples", [
    (0.3, 0.1, 3), (0.15, 0.005, 30), (0.7, 0.1, 7), (0.2999999999, 0.1, 2), (np.float64(0.6), np.float64(0.2), 3)])
def test_a_dwell_time_is_as_long_as_it_is_written(dwell, period, samples):
    """A switch a hair before the oldest age would lose the truth."""
    p = plant()
    p = replace(p, sample_period=period, switching=replace(p.switching, average_dwell=dwell))
    assert mode_certificate.dwell_samples(p) == samples


def test_widths_after_a_long_dwell_time():
    """They stand still long before; walking on would take minutes."""
    t, calls = tables("one input", AGES, "float32"), []

    def counted(*args):
        calls.append(args)
        return narrowed(*args)

    widths = (t.wide_hi - t.wide_lo).astype(float)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mode_widths, "narrowed", counted)
        assert np.array_equal(contracted(t, widths, 0, 100000), contracted(t, widths, 0, 2000)) and len(calls) < 3000


# ---------------------------------------------------------------------------------------------- scenarios, promises

def test_switches_between_samples():
    p = plant()
    run = codegen.simulate(p, "between samples")
    assert run.q[30] == 0 and run.q[31] == 1 and run.q[60] == 1 and run.q[61] == 0
    whole = loads(TEXT.replace("30.25", "31").replace("60.5", "61"))
    other = codegen.simulate(whole, "between samples")
    assert np.array_equal(run.q, other.q) and np.array_equal(run.x[:31], other.x[:31])
    assert np.all(run.x[31] != other.x[31])  # three quarters of that period were in the new mode
    with pytest.raises(PlantError, match="sample 30.25 is not whole"):
        loads(TEXT.replace("known = false", "known = true"))


def test_promises_are_held_against_runs():
    made, p = designed(), plant()
    run = codegen.simulate(p, "between samples")
    trace, cert = made.observer.run(run.u, run.y), made.certificate["float32"]
    outcome = judge(p, p.scenarios[0], run, trace, [])
    assert outcome.lost == outcome.false_alarms == 0 and outcome.settled.all()
    assert mode_promise.late("continuous", cert, run, trace, outcome.settled) == 0
    slow = replace(trace, mode=np.concatenate([trace.mode[:1], trace.mode[1:31], np.zeros(10), trace.mode[41:]]))
    assert mode_promise.late("continuous", cert, run, slow, outcome.settled) == 40 - (30 + cert["identified"][0][1]) + 1
    wrong = replace(trace, mode_set=np.where(np.arange(100) % 20 == 7, 1 << (1 - run.q), trace.mode_set))
    assert judge(p, p.scenarios[0], run, wrong, []).lost == 5


ALIKE = """
format = 1
name = "one"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "level", range = [-1, 1] }]
y = [{ name = "level", range = [-9, 9] }]
w = [{ name = "feed", bounds = [1, 1] }]
v = [{ name = "noise", bounds = [3, 3.001] }]
f = [{ name = "sensor", range = [-1, 1] }]
[initial]
x_lo = [0.5]
x_hi = [0.6]
[common]
C = [[1]]
Dv = [[1]]
Df = [[1]]
[[mode]]
name = "slow"
A = [[0.5]]
Bw = [[-0.5]]
[[mode]]
name = "quick"
A = [[0.1]]
Bw = [[-0.9]]
[switching]
known = false
minimum_dwell = 2
[observer]
method = "mode-set"
"""


@pytest.mark.parametrize("noise", ["[3, 3.001]", "[-3.001, -3]"])
def test_noise_of_one_sign_proves_nothing_by_itself(noise):
    """Both modes rest where x = -1, whatever the offset in y: nobody can tell them apart there."""
    p = loads(ALIKE.replace("[3, 3.001]", noise))
    with pytest.raises(CertificateError, match="slow and quick cannot be told apart"):
        mode_certificate.prove(p, tables_of(ModeTables, p, AGES, "float64"), 8)
