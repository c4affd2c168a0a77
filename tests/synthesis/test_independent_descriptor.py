"""The independent checker on observers that solve the algebraic equations, and on those of states and faults."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.checker import checker_of
from helpers.folders import write
from helpers.scripts import ROOT
from helpers.solved import stand_in
from helpers.solved import tables as stand_in_tables
from helpers.tampering import scaled
from synthesis.test_descriptor_direct import held, samples
from synthesis.test_independent_polytopic import C, T

from codegen.certify.descriptor_error import descriptor_errors
from codegen.observers.descriptor import of_pivots
from codegen.plant.bend import bend
from codegen.plant.load import load, loads

FOLDERS = {name: ROOT / "generated" / folder for name, folder in (
    ("contact", "disc_contact_descriptor-direct"), ("digester", "digester_descriptor-fault-estimation"))}


checker = checker_of("descriptor", "faults", "polytopic", "sector", "formula", "bend", "blend", "weights",
               "drift", "pairs")


@cache
def data_of(name):
    return json.loads((FOLDERS[name] / "design.json").read_text())


@pytest.fixture(scope="module")
def run(checker):
    """Everything but the C, of one number type; what rests on the plant alone is calculated once."""
    plants = {}

    def solved(text, t, cert):
        own, parts = checker["descriptor"], plants.get(text)
        if parts is None:
            p = checker["sector"].read_plant(text)
            plant = checker["pairs"].Plant(p)
            parts = plants[text] = p, plant, own.Solved(plant), checker["drift"].Drift(plant)
        p, plant, known, drift = parts
        checker["weights"].check_weights(t, len(p["x"]) + len(p["u"]))
        checker["polytopic"].check_ranges(t, p)
        errors = own.DescriptorErrors(plant, t, known, drift)
        checker["polytopic"].check_form(cert["energy"], "descriptor", plant)
        checker["polytopic"].check_energy(errors, cert, "state")
        checker["polytopic"].check_thresholds(errors, p, cert["thresholds"])

    def estimated(text, t, cert):
        own, parts = checker["faults"], plants.get(text)
        if parts is None:
            p = checker["sector"].read_plant(text)
            far = [p["period"] ** 2 / 2 * b for b in checker["bend"].bend(p)]
            parts = plants[text] = p, own.with_faults(p), far
        p, whole, far = parts
        shares = checker["weights"].check_weights(t, len(whole["x"]) + len(p["u"]))
        checker["polytopic"].check_ranges(t, p)
        own.check_bounds(own.FaultErrors(whole, t, shares, cert["T1"], far), whole, cert["thresholds"])

    def all_of(data, real="float32"):
        check = solved if data["family"] == "descriptor" else estimated
        check(data["plant"]["toml"], data["tables"][real], data["certificate"][real])

    return all_of


TH = (*C, "thresholds")
#: Tables and certificate: what is changed, by how much, and what is refused.
FALSE = {
    "contact": (
        ((*T, "P", 1, 1, 0), 1.01, ""), ((*T, "Q", 0, 1, 0), 0.5, ""),
        ((*T, "pivot", 1), 0.5, "energy gain"), ((*T, "pivot", 0), -1.0, "factors of the solved"),
        ((*T, "F", 1, 1, 0), 1.1, ""), ((*T, "K", 0, 0, 0), -1.0, ""), ((*T, "C", 0, 0), 1.02, ""),
        ((*T, "algebraic", 0), 1, "states that are solved for"), ((*T, "z_hi", 0), 4.0, "threshold row|not kept"),
        ((*T, "h", 0, 0), 0.98, "threshold row 0"), ((*T, "h", -1, 1), 0.999, "threshold row"),
        ((*T, "start"), 3, "rows of the table"), ((*T, "u_hi", 0), 1.5, "range of u"),
        ((*T, "weights", "constants", 4), 1.01, "between 0 and 1"),
        ((*TH, "bounds", 0, 1), 0.9, "not kept"), ((*TH, "carry", 1, 1, 1, 0), 3.0, "not kept"),
        ((*C, "energy", "Re", 2, 0), 20.0, "energy gain"), ((*C, "energy", "Rc", 0, 0), -1.0, "contraction at"),
        ((*C, "energy", "P1", 0, 0), 0.9, ""), ((*C, "energy", "level2"), 0.5, "energy gain"),
        ((*C, "energy", "contraction"), 0.99, "contraction at"), ((*C, "energy", "period"), 2.0, "period"),
        ((*C, "level"), 0.99, "claimed level")),
    "digester": (
        ((*T, "h", -1, 1), 0.98, "bound 1 of row 11"),
        ((*T, "F", 0, 0, 0), 1.001, "not kept"),
        ((*T, "known", 1, 0), 1.05, "not kept"), ((*T, "start"), 11, "initial box"),
        ((*T, "weights", "constants", 2), 0.99, "not kept"), ((*T, "weights", "constants", 5), 0.9, "not kept"),
        ((*C, "T1", 0, 3), 1.1, "initial box|not kept"), ((*TH, "P", 0, 0), 1.05, "not kept"),
        ((*TH, "D", 0, 10), 0.1, "not kept"), ((*TH, "kept", 0, 10), 51, "not kept"),
        ((*TH, "kept", 0, 10), 60, "columns"), ((*TH, "share"), 0.9, "not kept"),
        ((*TH, "level"), 0.95, "last level|too early")),
}


@pytest.mark.parametrize("name, case", [(name, k) for name, cases in FALSE.items() for k in range(len(cases))])
def test_refuses_false_claims(name, case, run):
    path, factor, words = FALSE[name][case]
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        run(scaled(data_of(name), path, factor))


@pytest.mark.parametrize("name, old, new, words", [
    ("contact", "J = 3.2 ", "J = 3.3 ", "energy gain|not kept"),
    ("contact", "damping = 30.0", "damping = 29.0", "energy gain|not kept"),
    ("contact", "bounds = [-0.02, 0.02]", "bounds = [-0.03, 0.02]", "energy gain|not kept"),
    ("contact", "bounds = [-0.0005, 0.0005]", "bounds = [-0.0005, 0.0007]", "energy gain|not kept"),
    ("contact", "range = [-20, 20]", "range = [-60, 20]", "threshold|not kept"),
    ("contact", "sample_period = 0.01 ", "sample_period = 0.011 ", "period"),
    ("contact", "x_hi = [0.1, 0.3, 0, 0]", "x_hi = [0.2, 0.3, 0, 0]", "initial box"),
    ("digester", "kd    = 0.02", "kd    = 0.04", "not kept"),
    ("digester", "sample_period = 864 ", "sample_period = 900 ", "not kept"),
    ("digester", "range = [1, 2] }", "range = [0, 4] }", "range of u"),
    ("digester", "range = [0.15, 0.55]", "range = [-0.6, 0.55]", "not kept|bound|too early"),
    ("digester", '"dilution", unit = "1/d", range = [0.3, 0.6]',
     '"dilution", unit = "1/d", rate = 1e-4, range = [0.3, 0.6]', "not kept"),
    ("digester", 'known = ["0", "dilution*inlet/day"', 'known = ["0", "dilution*inlet/day*2"', "A x . B u is not f"),
    ("digester", "x_hi = [0.5, 0.4", "x_hi = [0.5, 0.7", "initial box leaves")])
def test_refuses_another_plant(name, old, new, words, run):
    data = data_of(name)
    assert data["plant"]["toml"].count(old) == 1
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        run(data | {"plant": data["plant"] | {"toml": data["plant"]["toml"].replace(old, new)}})


@pytest.mark.parametrize("name", FOLDERS)
def test_rounding_counts(name, run):
    """Bounds that hold the plant in double precision do not hold what float32 rounds on the way."""
    data = json.loads(json.dumps(data_of(name)))
    data["tables"]["float64"]["real"] = "float32"
    with pytest.raises(SystemExit, match="refused: "):
        run(data, "float64")


#: What of the C, and what instead.
CHANGES = {
    "contact": (("x_hat[2] = (2.5F * s->z[1])", "x_hat[2] = (2.5F * s->z[0])"), ("(h[0] * v[0])", "(h[1] * v[0])"),
                ("(1.6666666F * in->u[0])", "(1.6666668F * in->u[0])"), ("weights(s->z, h)", "weights(s->y, h)"),
                ("x_hat[0] = s->z[0]", "x_hat[0] = s->z[1]"), ("since = 176U", "since = 160U"),
                ("v[1] = (35.946667F", "v[1] = -(35.946667F"), ("h[1] = t6", "h[1] = t7")),
    "digester": (("(864.0F * h[4])", "(864.0F * h[5])"), ("- (0.029520394F * h[5])", "+ (0.029520394F * h[5])"),
                 ("h[4] = t1", "h[4] = t0"), ("(t2 / t3)", "(t3 / t2)"), ("4.62468F - x_hat[3]", "x_hat[3] - 4.62468F"),
                 ("s->z[3] + y[3]", "s->z[3] - y[3]"), ("s->z[3] = 0.0F;\n    v[0]", "s->z[3] = r[3];\n    v[0]")),
    "two pivots": (("h[1] * 0.3F", "h[1] * 0.2F"), ("0.15F) ? pivot", "0.1F) ? pivot"), (": 0.15F", ": 0.3F"),
                   ("g[0] = h[0];", "g[0] = h[1];"), ("(0.25F * s->z[0]) +", "(0.25F * s->z[1]) +"),
                   ("pivot = g[0] + g[1]", "pivot = g[0] - g[1]"), ("+ (g[1] * v[1])", "+ (h[1] * v[1])"),
                   ("g[1] = g[1] / pivot", "g[1] = g[0] / pivot"), ("weights(s->z, h)", "weights(s->z, g)")),
}


@pytest.mark.parametrize("name", CHANGES)
def test_refuses_another_c(name, checker, tmp_path):
    if name in FOLDERS:
        folder, t, prefix = FOLDERS[name], data_of(name)["tables"]["float32"], {"digester": "dig"}.get(
            name, "disc_contact")
    else:  # constants that mean nothing, of vertices whose equations have other factors
        folder, t, prefix = write(stand_in(True), tmp_path), stand_in_tables(True, "float32").to_dict(), "obs"
    text, header = ((folder / f"{prefix}.{end}").read_text() for end in "ch")
    checker["blend"].check_source(text, header, t, prefix)
    for old, new in CHANGES[name]:
        assert old in text, old
        with pytest.raises(SystemExit, match="refused: "):
            checker["blend"].check_source(text.replace(old, new, 1), header, t, prefix)
            pytest.fail(old)


@pytest.mark.parametrize("name", ["disc_contact", "dlpv"])
def test_the_error_is_that_of_the_project(name, checker):
    """Step and solved equations, pair by pair; the second plant's vertices have other factors."""
    problem, t = held(name)
    own, plant = checker["descriptor"], checker["pairs"].Plant(checker["sector"].read_plant(load(name).text))
    errors = own.DescriptorErrors(plant, json.loads(json.dumps(t.to_dict())), own.Solved(plant))
    model, n, m = descriptor_errors(problem, t, load(name).sample_period), len(problem.E), problem.B.shape[2]
    units = np.concatenate([np.ones(2 * n), problem.u_unit, problem.d_unit])
    assert t.uneven == (name == "dlpv") and list(t.algebraic) == errors.solved.without
    for i, j in model.pairs:
        step = np.array([e + sum(parts, []) for e, *parts in zip(errors.N[j], *errors.terms(i, j))], float)
        project = np.concatenate(model.pairs[i, j], axis=1)[:n].astype(float)
        assert (step * units)[t.moving] == pytest.approx(project[t.moving], rel=1e-12, abs=1e-15)
        assert np.array(errors.ties(i, j), float) * units == pytest.approx(model.ties[i, j].astype(float), abs=1e-12)
    assert np.array(errors.Ee, float).tolist() == model.Ee.astype(float).tolist() and m == len(plant.box["u"])


@pytest.mark.parametrize("name", ["disc_contact", "dlpv"])
def test_bounds_of_a_step_hold_for_all_weights(name, checker):
    """Plant and observer at weights of their own, simulated; those of another gain, or without a mismatch, are none."""
    _, t = held(name)
    plant = checker["pairs"].Plant(checker["sector"].read_plant(load(name).text))
    known, still = checker["descriptor"].Solved(plant), SimpleNamespace(of=lambda rows: [0 * row[0] for row in rows])

    def worst(given, agrees=False):
        errors = checker["descriptor"].DescriptorErrors(plant, json.loads(json.dumps(given.to_dict())), known, still)
        if agrees:
            errors.mismatch = lambda k: [0] * len(known.without)
        N, W, O, room = zip(*errors.pushes())  # noqa: E741
        N, O, room = (np.array(M, float) for M in (N, O, room))  # noqa: E741
        far, over, firsts = np.array([[sum(map(abs, row)) for row in M] for M in W], float), [], errors.firsts
        for (x, _, _, z), (_, h), (_, r, after), later in samples(name, t):
            g, e = of_pivots(t, h[None])[0], (x - z)[t.moving]
            both = np.outer(h, [g[np.all(t.solved == t.solved[k], axis=(1, 2))].sum() for k in firsts]).ravel()
            over.append(np.max(np.abs((later - after)[t.moving] - np.tensordot(both, N, 1) @ e) - both @ far))
            over.append(np.max(np.abs(r - np.tensordot(both, O, 1) @ e) - both @ room))
        return max(over)

    assert worst(t) < 0 < worst(replace(t, K=-3 * t.K))
    assert worst(t, agrees=True) > 0 or not t.uneven  # one pivot: two vertices that hardly differ


def test_how_fast_a_right_side_changes_is_what_the_project_finds(checker):
    text, own = load("digester").text, checker["bend"]
    moving = text.replace('unit = "1/d", range = [0.3, 0.6]', 'unit = "1/d", rate = 1e-5, range = [0.3, 0.6]')
    found = {}
    for name, some in (("still", text), ("moving", moving)):
        found[name] = [float(b) for b in own.bend(checker["sector"].read_plant(some))]
        assert found[name] == pytest.approx(bend(loads(some)).tolist(), rel=1e-5)
    assert found["still"][1] < 0.8 * found["moving"][1] and found["still"][3] == 0
    with pytest.raises(SystemExit) as stopped:  # a disturbance of an algebraic row: the state may jump
        own.bend(checker["sector"].read_plant(load("disc_contact").text))
    assert stopped.value.code == 2


def test_formulas_are_calculated_exactly_and_bounded_from_outside(checker):
    formula, rng = checker["formula"].formula, np.random.default_rng(0)
    f = formula("(x**3 - 2*x*y)/(3 - x*y) + y/2", ["x", "y"], {})
    same = formula("x**3/(3 - x*y) - 2*x*y/(3 - x*y) + y/2", ["x", "y"], {})
    assert not f - same and (f * formula("3 - x*y", ["x", "y"], {})).plain and not f.plain
    lo, hi = f.range([(-1, 1), (0, 1)])
    x, y = rng.uniform(-1, 1, 4000), rng.uniform(0, 1, 4000)
    values = (x**3 - 2 * x * y) / (3 - x * y) + y / 2
    assert lo <= values.min() < lo + 0.05 and hi - 0.05 < values.max() <= hi
    slope = f.slope(0)
    for a, b in zip(x[:20], y[:20]):
        point = [(checker["formula"].F(v),) * 2 for v in (a, b)]
        near = [(checker["formula"].F(v),) * 2 for v in (a + 1e-6, b)]
        assert float(slope.bounds(point)[0]) == pytest.approx(
            float(f.bounds(near)[0] - f.bounds(point)[0]) / 1e-6, abs=1e-4)
    assert re.search("inf", str(formula("1/x", ["x"], {}).bounds([(-1, 1)])))
    with pytest.raises(SystemExit):
        formula("1/x", ["x"], {}).largest([(checker["formula"].F(-1), checker["formula"].F(1))])
