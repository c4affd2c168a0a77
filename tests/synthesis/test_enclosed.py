"""Continuous plants with constant matrices at their samples: what is enclosed, and what is too small."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.folders import write
from helpers.points import gains_of
from synthesis.test_independent import run

import codegen
from codegen.analysis.detectability import surely_detected
from codegen.assurance.claims import claims
from codegen.designs import Design, claims_of
from codegen.errors import CertificateError
from codegen.observers import FAMILIES, Supervision
from codegen.plant.continuous import advance
from codegen.plant.load import loads
from codegen.plant.simulate import range_violations, simulate
from codegen.selection.points import certified, choice_of
from codegen.synthesis import METHODS, ellipsoid

TEXT = """
format = 1
name = "tank"
title = "Two tanks and a valve"
source = "own example"
[time]
kind = "continuous"
sample_period = 0.1
[signals]
x = [{ name = "level", range = [-3, 4] }, { name = "flow", range = [-3, 3] }]
u = [{ name = "pump", range = [-1, 2] }]
y = [{ name = "level", range = [-8, 8] }, { name = "flow", range = [-8, 8] }]
w = [{ name = "leak", bounds = [-0.2, 0.6] }]
v = [{ name = "noise", bounds = [-0.001, 0.002] }]
f = [{ name = "sensor", range = [-3, 3] }, { name = "clog", range = [-2, 2] }]
[initial]
x_lo = [-0.1, 0.1]
x_hi = [0.1, 0.3]
[common]
C  = [[1, 0], [0.2, 1]]
Dv = [[1], [-1]]
Df = [[1, 0], [0, 0]]
Bf = [[0, 0], [0, 5]]
Bw = [[1], [0.5]]
[[mode]]
name = "open"
A = [[-2, 1], [-3, -3]]
B = [[1], [1]]
[[mode]]
name = "shut"
A = [[-2, 1], [1, -4]]
B = [[-2], [2]]
[switching]
minimum_dwell = 0.3
schedule = { every = 4, order = ["open", "shut"] }
[observer]
method = "zonotope"
[[scenario]]
name = "corner"
steps = 100
mode = { every = 4, order = ["open", "shut"] }
u = ["0.5 + 1.5*sign(sin(2*t))"]
w = ["0.2 + 0.4*sign(sin(2*pi*t/0.05))"]
v = "corner"
[[scenario]]
name = "slow"
steps = 100
mode = { every = 12, order = ["open", "shut"] }
u = ["0.5 + 1.5*sign(sin(2*t))"]
w = "corner"
v = "corner"
"""
WORN = TEXT.replace('v = [{ name = "noise"', 'theta = [{ name = "wear", bounds = [-0.2, 0.3], measured = false }]\n'
                    'v = [{ name = "noise"').replace("A = [[-2, 1], [1, -4]]", 'A = [["-2 - wear", 1], [1, -4]]')
PLANT = loads(TEXT)
SETS = {"zonotope": {"order": 6}, "box": {"set": "interval"}, "ellipsoid": {"set": "ellipsoid"},
        "trace": {"set": "ellipsoid", "weights": "trace"}, "dwell": {"tables": "dwell", "rows": 6, "stages": 3},
        "schedule": {"tables": "schedule", "rows": 6}, "arbitrary": {"tables": "arbitrary", "rows": 4, "order": 4}}


def moved(plant, q, x, u, w, f):
    """The true state a period later; w piecewise constant, one row per piece."""
    for piece in w:
        x = advance(plant.modes[q], x, plant.sample_period / len(w), (np.zeros(0),) * 2, (u, u), piece, f)
    return x


def shares(plant, found, runs=24):
    """Largest share of the box of the rest that true steps take, with every other disturbance at its mean, by mode."""
    rng, out = np.random.default_rng(1), []
    for q, m in enumerate(found.modes):
        worst = 0.0
        for _ in range(runs):
            x, u, f = (np.where(rng.random(len(lo)) < 0.5, lo, hi) for lo, hi in (plant.limits(k) for k in "xuf"))
            w = np.repeat(plant.modes[q].w_lo[None], 8, axis=0)
            high = slice(0, 4) if rng.random() < 0.5 else slice(4, 8)
            w[high] = plant.modes[q].w_hi
            left = moved(plant, q, x, u, w, f) - m.A @ x - m.B @ u - m.Bf @ f - m.Bw[:, :1] @ w.mean(axis=0)
            worst = max(worst, np.max(np.abs(left) / m.w_hi[1:]))
        out.append(worst)
    return np.array(out)


def test_a_step_is_enclosed_and_hardly_more():
    """The worst disturbance within a period takes more than a third of what is kept for it, and no more than all."""
    found = PLANT.enclosed
    assert found.kind == "discrete" and found.enclosed is found and len(found.w) == 3
    share = shares(PLANT, found)
    assert np.all(share < 1) and np.all(share > 0.35)
    for wrong in (replace(PLANT, sample_period=0.099), replace(PLANT, sample_period=0.11)):
        assert np.all(shares(PLANT, wrong.enclosed, 6) > 1)


def test_parameters_and_outputs():
    """What nobody measures becomes a disturbance, and so does, as noise, what a disturbance does to the outputs."""
    plant = loads(WORN)
    assert METHODS["zonotope"].module.inapplicable(plant) is None
    found, lo, hi = plant.enclosed, *plant.theta_box(plant.modes[0])
    assert not found.theta and len(found.w) == 1 + 2 + 2
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(40):
        x, u, f = (np.where(rng.random(len(a)) < 0.5, a, b) for a, b in (plant.limits(k) for k in "xuf"))
        theta, true, w = (lo, hi)[rng.integers(2)], x, plant.modes[1].w_hi
        true = advance(plant.modes[1], x, 0.1, (theta, theta), (u, u), w, f)
        m = found.modes[1]
        left = true - m.A @ x - m.B @ u - m.Bf @ f - m.Bw[:, :1] @ w
        room = np.abs(m.Bw[:, 1:]) @ m.w_hi[1:]
        worst = max(worst, np.max(np.abs(left) / room))
    assert 0.5 < worst < 1
    assert "measured" in METHODS["zonotope"].module.inapplicable(loads(WORN.replace(", measured = false", "")))
    through = loads(TEXT.replace("Bw = [[1], [0.5]]", "Bw = [[1], [0.5]]\nDw = [[0], [0.3]]"))
    m = through.enclosed.modes[0]
    assert np.array_equal(m.Dv, [[1, 0], [-1, 0.3]]) and np.array_equal(m.v_hi, [0.002, 0.6]) and not np.any(m.Dw)
    assert METHODS["hinf-filter"].module.inapplicable(through) is None


@pytest.mark.parametrize("change, method, words", [
    (('"clog", range = [-2, 2]', '"clog"'), "zonotope", "over a period is known up to a share"),
    (("Dv = [[1], [-1]]", 'Dv = [["1 + wear"], [-1]]'), "ellipsoid", "Dv of mode \"open\" depends on a parameter"),
    (("Dv = [[1], [-1]]", 'Dv = [["1 + wear"], [-1]]'), "hinf-filter", "Dv of mode \"open\" depends on a parameter")])
def test_what_cannot_be_enclosed_says_why(change, method, words):
    wear = 'theta = [{ name = "wear", bounds = [-0.2, 0.3], measured = false }]\n[initial]'
    text = TEXT.replace(*change).replace("[initial]", wear if "wear" in change[1] else "[initial]")
    assert words in METHODS[method].module.inapplicable(loads(text))


@lru_cache
def chosen(name: str) -> dict:
    """Gains as they come, and how large the set is to be."""
    found, options = PLANT.enclosed, SETS[name]
    gains = gains_of(found, "tnl" if name in ("box", "dwell") else "luenberger")
    return gains | choice_of(options, "zonotope")(found, gains, options, 3)


@lru_cache
def tables(name: str, real: str = "float32", period: float = 0.1):
    """Tables and certificate."""
    return certified(replace(PLANT, sample_period=period).enclosed, chosen(name), {"kind": "none"}, real)


def made(name: str, reals=("float32",)) -> Design:
    """A design of the number types that are asked for."""
    t, certs = ({real: tables(name, real)[i] for real in reals} for i in (0, 1))
    proved = {real: claims_of(PLANT, t[real], certs[real]) for real in reals}
    faults = [{"channel": f.channel, "unit": f.unit, "by_delay": list(f.by_delay)}
              for f in surely_detected(PLANT, t["float32"], certs["float32"], 1)]
    return Design(PLANT, "zonotope", FAMILIES[certs["float32"]["set"]](t, Supervision()), certs, proved,
                  dict.fromkeys(reals, faults))


@lru_cache
def truths():
    """Runs of the true continuous plant: in turn as the schedule says, and slower."""
    out = [simulate(PLANT, s, seed=4) for s in ("corner", "slow")]
    assert not any(range_violations(PLANT, truth) for truth in out)
    return out


def lost(name: str, real: str, period: float = 0.1) -> int:
    """Samples with a false alarm or a state that is lost."""
    (t, cert), runs = tables(name, real, period), truths()[:1] if name == "schedule" else truths()
    x, u, y, q = (np.stack([getattr(truth, k) for truth in runs]) for k in "xuyq")
    trace = FAMILIES[cert["set"]]({real: t}, Supervision()).run_many(u, y, q, real)
    return int(np.sum(trace.alarm | np.any((x < trace.x_lo) | (x > trace.x_hi), axis=2)))


@pytest.mark.parametrize("name", SETS)
def test_no_truth_is_lost_and_a_wrong_period_loses_it(name):
    """Disturbances that move within a period are the worst there are; tables of another period lose states."""
    real = "float32" if len(name) % 2 else "float64"
    assert lost(name, real) == 0
    assert lost(name, real, 0.07) > 0


def test_a_certificate_is_that_of_its_period():
    """What is proved at 0.1 s is not at 0.101 s: the plant is enclosed anew at each check."""
    t, cert = tables("zonotope")
    assert any("between samples, 0.1 s apart" in line for line in claims_of(PLANT, t, cert))
    with pytest.raises(CertificateError):
        claims_of(replace(PLANT, sample_period=0.101), t, cert)


def test_promised_faults_are_found():
    """Steps of sensor and state a little larger than promised, either way, whatever the disturbance does."""
    design, rng = made("dwell"), np.random.default_rng(3)
    for j, fault in enumerate(design.detection["float32"]):
        size = fault["by_delay"][-1]
        assert size < 2
        for sign in (1.01, -1.01):
            q = np.repeat(rng.integers(0, 2, 7), 4)
            x, y, u = np.array([0.0, 0.2]), [], np.array([[0.5]] * len(q))
            for k, mode in enumerate(q):
                f = np.zeros(2)
                f[j] = sign * size * (k >= 24)
                m = PLANT.modes[mode]
                y.append(m.C @ x + m.Dv @ (m.v_lo, m.v_hi)[rng.integers(2)] + m.Df @ f)
                x = moved(PLANT, mode, x, u[k], np.array([(m.w_lo, m.w_hi)[i] for i in rng.integers(0, 2, 8)]), f)
            trace = design.observer.run(u, np.array(y), q, real="float32")
            assert not trace.alarm[:24].any() and trace.alarm[24:26].any()


def test_no_size_beyond_its_range_is_promised_of_a_fault_on_the_state():
    """What it does within a period is enclosed for its range; the sensor's fault does nothing there."""
    t, cert = tables("zonotope")
    for ranges, finite in ((("[-3, 3]", "[-2, 2]"), True), (("[-0.001, 0.001]", "[-0.001, 0.001]"), False)):
        text = TEXT.replace('"sensor", range = [-3, 3]', f'"sensor", range = {ranges[0]}')
        plant = loads(text.replace('"clog", range = [-2, 2]', f'"clog", range = {ranges[1]}'))
        sensor, clog = (f.best for f in surely_detected(plant, t, cert, 2))
        assert 0.001 < sensor < 2 and (0.001 < clog < 2 if finite else np.isinf(clog))


def whole(design: Design, folder):
    """The folder of a design of one number type."""
    write(design, folder)
    (folder / "design.json").write_text(design.to_json())
    (folder / "resources.json").write_text(json.dumps({"prefix": "tank", "real": "float32"}))
    return folder


def test_the_claims_are_stated():
    found = {c.id: c for c in claims(made("dwell"), "float32")}
    assert "time.sample_period" in found["no-alarm"].plant and found["sampling"].code.endswith("enclosed.enclosed")


def test_the_independent_checker_encloses_it_again(tmp_path):
    """It proves the design; at another period, of a faster plant or with a larger disturbance it does not."""
    folder = whole(made("zonotope", ("float32", "float64")), tmp_path / "tank")
    done = run(folder)
    assert done.returncode == 0 and "proved for float64" in done.stdout, done.stderr
    data = json.loads((folder / "design.json").read_text())
    text = data["plant"]["toml"]
    for old, new in (("sample_period = 0.1", "sample_period = 0.1001"), ('"pump",', '"pump", rate = 0.05,')):
        assert old in text
        data["plant"]["toml"] = text.replace(old, new)
        (folder / "design.json").write_text(json.dumps(data))
        done = run(folder)
        assert done.returncode == 1 and done.stderr.startswith("refused: "), (new, done.stderr)
    data["plant"]["toml"] = text.replace("[initial]", 'theta = [{ name = "wear", bounds = [-1, 1] }]\n[initial]')
    (folder / "design.json").write_text(json.dumps(data))
    assert "measured" in run(folder).stderr


def test_a_filter(tmp_path):
    """Of a plant that wears: no alarm without faults; the checker agrees, but not of more wear."""
    plant = loads(WORN.replace("minimum_dwell = 0.3\n", "").replace('"zonotope"', '"hinf-filter"\nset_rows = 20'))
    design = codegen.design(plant)
    sizes = design.detection["float32"]
    assert any("between samples" in line for line in design.proved["float32"]) and sizes[0]["by_delay"][-1] < 1
    truth = simulate(plant, "slow", seed=1)
    trace = design.observer.run(truth.u, truth.y, truth.q)
    assert not trace.alarm.any() and np.all(np.abs(trace.f_hat) <= trace.f_bound)
    folder = whole(design, tmp_path / "tank")
    assert run(folder).returncode == 0
    data = json.loads((folder / "design.json").read_text())
    data["plant"]["toml"] = plant.text.replace("[-0.2, 0.3]", "[-0.2, 0.32]")
    (folder / "design.json").write_text(json.dumps(data))
    assert run(folder).stderr.startswith("refused: ")


def test_a_period_that_is_short_for_the_plant():
    """A state that nobody sees decays by a hundredth in a sample: gains and weights of an ellipsoid allow for that."""
    begin, end = TEXT.index("[[mode]]"), TEXT.index("[switching]")
    text = TEXT[:begin] + '[[mode]]\nname = "open"\nA = [[-2, 0], [0, -0.5]]\nB = [[1], [1]]\n' + TEXT[end:]
    text = text.partition("[switching]")[0].replace("period = 0.1", "period = 0.02").replace("[0.2, 1]", "[0.5, 0]")
    found = loads(text + "[observer]\n").enclosed
    (gains,) = ellipsoid.candidates(found, {"structure": "luenberger", "beta": 0.0})
    assert "lambda 0.01" in gains.label
    sizes = choice_of({"set": "ellipsoid"}, "ellipsoid")(found, {"L": gains.L, "N": gains.N, "kind": gains.kind}, {}, 1)
    assert np.all(sizes["alpha"] < 0.05)
