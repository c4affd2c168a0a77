"""The independent checker on polytopic observers: it agrees with the certificate, and refuses what is false."""

from __future__ import annotations

import copy
import json
import re
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from helpers.checker import checker_of, refuses_changes
from helpers.kept import OTHERS, family_of
from helpers.scripts import prefix_of
from helpers.tampering import scaled
from synthesis.test_polytopic_near import TANK

from codegen.plant.load import loads
from codegen.selection.polytopic_tables import frozen, tables_of
from codegen.synthesis.descriptor_gains import StandardGains
from codegen.synthesis.descriptor_problem import problem_of

FOLDERS = {f.name.partition("_")[0]: f for f in OTHERS if family_of(f) == "polytopic"}
CHECKED = [name for name in FOLDERS if name != "digester"]


checker = checker_of("polytopic", "pairs", "sector", "blend", "drift", "near", "formula", "weights")


@cache
def data_of(name):
    return json.loads((FOLDERS[name] / "design.json").read_text())


@pytest.fixture(scope="module")
def run(checker):
    """Everything but the C, of one number type; what rests on the plant alone is calculated once."""
    plants = {}

    def all_of(data, real="float32"):
        text, t, cert = data["plant"]["toml"], data["tables"][real], data["certificate"][real]
        if text not in plants:
            p = checker["sector"].read_plant(text)
            plant = checker["pairs"].Plant(p)
            plants[text] = p, plant, checker["drift"].Drift(plant) if plant.T is not None else None
        p, plant, drift = plants[text]
        shares = checker["weights"].check_weights(t, len(p["x"]) + len(p["u"]))
        errors = checker["pairs"].Errors(plant, t, cert.get("energy", cert)["T1"], drift)
        if "energy" in cert:
            checker["polytopic"].check_energy(errors, cert, "state")
        checker["polytopic"].check_thresholds(errors, p, cert["thresholds"], shares)

    return all_of


@pytest.mark.parametrize("name", CHECKED)
def test_proves_a_committed_design(name, checker, capsys):
    folder = FOLDERS[name]
    checker["polytopic"].main(folder, data_of(name), json.loads((folder / "resources.json").read_text()))
    said = capsys.readouterr().out
    assert said.count("thresholds with rounding") == 2 and said.count("energy gain") == 2 * (name == "disc")
    assert said.count("the law beside it is not checked") == 2 * (name == "quadrotor")


def test_says_that_observers_of_faults_are_checked_elsewhere(checker):
    folder = FOLDERS["digester"]
    with pytest.raises(SystemExit) as stopped:
        checker["polytopic"].main(folder, data_of("digester"), json.loads((folder / "resources.json").read_text()))
    assert stopped.value.code == 2


def test_plants_are_those_of_the_project(checker):
    """Vertices, E and C of all plants that it reads: equations, factors of the file, tables of vertices."""
    from codegen.assurance.polytopic_claims import read_apart
    from codegen.plant.load import gallery_folder, load
    read = 0
    for path in sorted(gallery_folder().glob("*.toml")):
        if "[nonlinear]" not in path.read_text() and "[[vertex]]" not in path.read_text():
            continue
        polytope = load(path).polytope
        try:
            p = checker["sector"].read_plant(path.read_text())
        except SystemExit as stopped:
            assert stopped.code == 2 and path.stem in ("bioreactor", "disc_points"), path.stem
            assert not read_apart(load(path)), path.stem
            continue
        read += 1
        assert len(p["vertices"]) == len(polytope.vertices)
        for own, vertex in zip(p["vertices"], polytope.vertices):
            for key in ("A", "B", "Bw"):
                for row, given in zip(own[key], getattr(vertex, key)):
                    assert [float(a) for a in row] == pytest.approx(given.tolist(), rel=1e-14), (path.stem, key)
        for key in ("E", "C"):
            assert [[float(a) for a in row] for row in p[key]] == getattr(polytope, key).tolist()
    assert read >= 4


def test_says_which_plants_it_knows_between_samples(checker):
    """What claims take it to know is what it knows; how far such a plant moves is what the project finds."""
    from codegen.assurance.polytopic_claims import read_apart
    from codegen.certify.exact import rational
    from codegen.certify.polytope_drift import drift
    from codegen.certify.polytope_ranges import Ranges
    from codegen.plant.load import load
    for name in ("disc", "disc_contact", "quadrotor", "dlpv"):
        plant = load(name)
        own = checker["pairs"].Plant(checker["sector"].read_plant(plant.text))
        if not read_apart(plant):
            with pytest.raises(SystemExit) as stopped:
                checker["drift"].Drift(own)
            assert stopped.value.code == 2 and name == "dlpv"
            continue
        found, problem = checker["drift"].Drift(own), problem_of(plant)
        known = drift(plant, problem, Ranges.of(plant, problem), plant.sample_period)
        for rows in (own.A[0], own.A[-1], checker["pairs"].unit(len(own.E))):
            floats = [[float(a) for a in row] for row in rows]
            assert [float(x) for x in found.of(rows)] == pytest.approx(
                [float(x) for x in known.of(rational(floats))], rel=1e-6)


T, C = ("tables", "float32"), ("certificate", "float32")
FALSE = {
    "T2": ((*T, "T2", 1, 0), 1.01, ""), "C": ((*T, "C", 0, 0), 1.001, ""), "F": ((*T, "F", 1, 1, 1), 1.01, ""),
    "G": ((*T, "G", 0, 1, 0), 1.2, ""), "K": ((*T, "K", 0, 2, 0), 1.02, ""), "M": ((*T, "M", 0, 0), 1.1, ""),
    "first threshold": ((*T, "h", 0, 0), 0.99, "threshold row 0"), "middle": ((*T, "h", 5, 1), 0.99, "threshold row 5"),
    "last threshold": ((*T, "h", -1, 2), 0.999, "threshold row"), "start": ((*T, "start"), 3, "rows of the table"),
    "samples per row": ((*T, "shift"), 0, "row"), "limits of z": ((*T, "z_hi", 0), 1.5, "threshold row 0|not kept"),
    "z0": ((*T, "z0", 1), 1.2, "initial box|within its limits"), "T1": ((*C, "energy", "T1", 0, 2), 1.1, ""),
    "bounds": ((*C, "thresholds", "bounds", 0, 2), 0.98, "not kept"),
    "unit rows": ((*C, "thresholds", "rows", 0, 0), 1.5, "unit rows"),
    "combination": ((*C, "thresholds", "carry", 3, 1, 1, 1), 1.1, "not kept"),
    "claimed level": ((*C, "level"), 0.999, "claimed level"), "proved level": ((*C, "energy", "level2"), 0.1, ""),
    "P1": ((*C, "energy", "P1", 0, 0), 0.9, ""), "R": ((*C, "energy", "R", 5, 0), 1.5, "energy gain"),
    "contraction": ((*C, "energy", "contraction"), 0.99, "contraction at vertex"),
    "a weight": ((*T, "weights", "constants", 4), 1.01, "between 0 and 1"),
    "a premise": ((*T, "weights", "constants", 3), 1.01, "between 0 and 1"),
}


@pytest.mark.parametrize("name", FALSE)
def test_refuses_false_claims(name, run):
    path, factor, words = FALSE[name]
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        run(scaled(data_of("disc"), path, factor))


#: Of weights that are no further apart than the error allows: their certificate, and what the C makes of a premise.
NEAR = {
    "combination": ((*C, "thresholds", "near", "sees", 0, 1, 0), 3.0, "not kept"),
    "row": ((*C, "thresholds", "near", "sees", 0, 0, 0), 4, "not kept"),
    "slope": ((*T, "weights", "constants", 4), 0.99, "not kept"),
    "lower bound": ((*T, "weights", "constants", 2), 0.97, "not kept"),
    "bounds": ((*C, "thresholds", "bounds", 0, 3), 0.98, "not kept"),
    "last threshold": ((*T, "h", -1, 3), 0.999, "threshold row"),
}


@pytest.mark.parametrize("name", NEAR)
def test_refuses_false_claims_of_near_weights(name, run):
    path, factor, words = NEAR[name]
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        run(scaled(data_of("quadrotor"), path, factor))


def test_near_weights_are_those_of_powers_that_the_c_cuts_to_their_bounds(checker):
    """A share that is another function of the state, or of a product, is not known."""
    near, t = checker["near"], data_of("quadrotor")["tables"]["float32"]
    box = [(Fraction(-2), Fraction(2))] * 9
    (share,) = checker["weights"].check_weights(t, 9)
    premise = (tuple(int(k == 5) for k in range(9)), Fraction(-1), Fraction(1))
    found = near.read(t["weights"], share, box, "float32")
    assert (found.cut, found.scale, found.shift) == ((-1, 1), Fraction(1, 2), Fraction(1, 2))
    assert 0 < near.apart(found, premise) < 1e-6
    assert near.apart(found, (premise[0], Fraction(-1), Fraction(11, 10))) > 0.04
    with pytest.raises(SystemExit) as stopped:
        near.apart(found, (premise[0][::-1], *premise[1:]))
    assert stopped.value.code == 2


#: The tank beside another one that its pump stirs: premises are the square of a state, named with a sign, and an input.
TWO_TANKS = {
    'x = [{ name = "level", range = [0, 2] }]':
        'x = [{ name = "level", range = [0, 2] }, { name = "other", range = [-1, 1] }]',
    "x_lo = [0.5]": "x_lo = [0.5, 0]", "x_hi = [0.5]": "x_hi = [0.5, 0]", "C = [[1]]": "C = [[1, 0]]",
    "E = [[1]]": "E = [[1, 0], [0, 1]]", '["0.5*level + 0.1*level**2 + 0.1*pump"]':
        '["0.4*level + 0.05*level**3 + 0.02*other + 0.1*pump", "0.3*other + 0.1*pump*other"]\n'
        'premise = [{ name = "square", term = "-2*level**2" }]'}


def test_weights_of_two_premises_one_of_them_an_input(run, checker):
    """A discrete plant that no folder has: proved as it is, refused where any number is another."""
    text = TANK
    for old, new in TWO_TANKS.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    plant = loads(text)
    problem = problem_of(plant)
    A, B = (getattr(problem, k).astype("float32").astype(float) for k in "AB")
    K = np.tile([[-0.25], [0.0]], (len(A), 1, 1))
    t = tables_of(plant, StandardGains(np.zeros((2, 1)), A, B, K, problem.C), np.eye(1), "float32")
    t, cert = frozen(plant, problem, t, np.eye(2), None)
    assert [str(q.term) for q in plant.polytope.premises] == ["-2*level**2", "pump"] and len(cert["near"]["sees"]) == 2
    data = json.loads(json.dumps({"plant": {"toml": text}, "tables": {"float32": t.to_dict()}, "certificate": {
        "float32": {"T1": np.eye(2).tolist(), "thresholds": cert}}}))
    run(data)
    for path, factor, words in (((*C, "thresholds", "near", "sees", 0, 1, 0), 2.0, "not kept"),
                                ((*C, "thresholds", "bounds", 0, 0), 0.98, "not kept"),
                                ((*T, "h", -1, 0), 0.999, "threshold row")):
        with pytest.raises(SystemExit, match=f"refused: .*{words}"):
            run(scaled(data, path, factor))
    with pytest.raises(SystemExit, match="refused: .*not kept"):
        run(data | {"plant": {"toml": text.replace("level**3", "level**3*1.1")}})


@pytest.mark.parametrize("name, old, new, words", [
    ("disc", "damping = 30.0", "damping = 29.0", "energy gain|not kept"),
    ("disc", "stiffness = 100.0", "stiffness = 90.0", "energy gain|not kept"),
    ("disc", 'unit = "m", range = [-0.28, 0.28]', 'unit = "m", range = [-0.5, 0.5]', "energy gain|not kept"),
    ("quadrotor", 'name = "roll noise", unit = "rad", bounds = [-0.002, 0.002]',
     'name = "roll noise", unit = "rad", bounds = [-0.003, 0.002]', "not kept"),
    ("quadrotor", 'name = "yaw gust", unit = "N m", bounds = [-0.001, 0.001]',
     'name = "yaw gust", unit = "N m", bounds = [-0.0013, 0.001]', "not kept"),
    ("quadrotor", "sample_period = 0.01 ", "sample_period = 0.011 ", "not kept"),
    ("quadrotor", "Izz = 1.3e-2", "Izz = 1.5e-2", "not kept|A x . B u"),
    ("quadrotor", "x_hi = [0.02, ", "x_hi = [0.6, ", "initial box")])
def test_refuses_another_plant(name, old, new, words, run):
    data = data_of(name)
    assert data["plant"]["toml"].count(old) == 1
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        run(data | {"plant": data["plant"] | {"toml": data["plant"]["toml"].replace(old, new)}})


def test_rounding_counts(run):
    """Thresholds that hold the plant in double precision do not hold what float32 rounds on the way."""
    data = copy.deepcopy(data_of("quadrotor"))
    run(data, "float64")
    data["tables"]["float64"]["real"] = "float32"
    with pytest.raises(SystemExit, match="refused: "):
        run(data, "float64")


#: What of the C, and what instead.
CHANGES = {
    "disc": ((r"(x_hat\[1\] = s->z\[1\] [+-] )\(0\.12", r"\g<1>(0.13"), (r"y\[1\] - x_hat\[2\]", "y[1] + x_hat[2]"),
             (r"\+ \(h\[1\] \* v\[1\]\)", "+ (h[0] * v[1])"), (r"-\(0\.0010989932F", "(0.0010989932F"),
             (r"(\{ )([\d.]+F), ([\d.]+F)", r"\1\3, \2"), (r"since = 1536U", "since = 1408U"), (r">> 7U", ">> 6U"),
             (r">= -2\.0F", ">= -2.5F"), (r"t5 \* 12\.755102F", "t5 * 12.8F"),
             (r"t3 \? t0 : 0\.0F", "t3 ? 0.0F : t0"), (r"h\[1\] = t6", "h[1] = t7"), (r"1\.0F - t6", "1.0F - t5"),
             (r"out->r\[0\] = r\[0\]",
                                                                                "out->r[0] = r[1]"),
             (r"(?<=least\[DISC_NX\] = \{\n)( +)-[\d.]+F", r"\1-0.5F"), (r"s->z\[3\] = 0\.0F", "s->z[3] = 1.0F")),
    "quadrotor": ((r"0\.32269752F \* law->s\[2\]", "0.32269752F * law->s[1]"),
                  (r"ref\[1\] <= 0\.15F", "ref[1] <= 0.2F"), (r"law->s\[0\] \+ \(0\.01F", "law->s[0] + (0.02F")),
}


@pytest.mark.parametrize("name", CHANGES)
def test_refuses_another_c(name, checker):
    folder, data, check = FOLDERS[name], data_of(name), checker["blend"].check_source
    prefix = prefix_of(folder)
    text, header = ((folder / f"{prefix}.{end}").read_text() for end in "ch")
    refuses_changes(lambda source: check(source, header, data["tables"]["float32"], prefix), text, CHANGES[name])
    with pytest.raises(SystemExit, match="refused: macro"):
        check(text, re.sub(r"(#define \w+_LAST )\d+U", r"\g<1>3U", header), data["tables"]["float32"], prefix)
