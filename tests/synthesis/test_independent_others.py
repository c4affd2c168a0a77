"""The independent checker on filters, mode estimators and such: it agrees with certificates, refuses what is false."""

from __future__ import annotations

import ast
import copy
import json
import re
import sys
from functools import cache

import pytest
from helpers.checker import CHECKER, checker_of, refuses_changes
from helpers.kept import OTHERS, family_of
from helpers.scripts import prefix_of
from helpers.small_modes import PLANTS, stand_in
from helpers.tampering import scaled

FILES = sorted(CHECKER.parent.glob("independent*.py"))
NAMES = {p.stem for p in FILES}


checker = checker_of("filter", "energy", "births", "sliding", "bank", "period")


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_uses_the_standard_library_only(path):
    tree = list(ast.walk(ast.parse(path.read_text())))
    names = {a.name.split(".")[0] for n in tree if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module.split(".")[0] for n in tree if isinstance(n, ast.ImportFrom)}
    assert names <= set(sys.stdlib_module_names) | NAMES


@cache
def folder_of(family):
    folder = next(f for f in OTHERS if family_of(f) == family)
    return folder, json.loads((folder / "design.json").read_text())


T, C = ("tables", "float32"), ("certificate", "float32")
FILTER = {
    "M": ((*T, "M", 0, 0, 0), 1.02, ""), "L": ((*T, "L", 0, 0, 0), 1.01, ""), "K": ((*T, "K", 0, 0, 0), 1.02, ""),
    "Dy": ((*T, "Dy", 1, 0, 0), 1.02, ""), "first threshold": ((*T, "h", 0, 0, 0), 0.99, "threshold row 0"),
    "threshold after a loss": ((*T, "h", 18, 1, 0), 0.99, "threshold row 18"),
    "last threshold": ((*T, "h", 28, 0, 0), 0.999, "threshold"), "limit": ((*T, "limit", 0), 1e-3, ""),
    "range": ((*T, "x_hi", 0), 0.9, "box x too small"), "initial box": ((*T, "x0_lo", 1), 0.9, "box x0 too small"),
    "start": ((*T, "start"), 0, ""), "rows": ((*T, "lost"), 0, ""), "samples per row": ((*T, "shift"), 0, ""),
    "bounds": ((*C, "set_of_both", "bounds", 0, 0), 0.98, "not kept"), "unit rows": (
        (*C, "set_of_both", "rows", 0, 0), 1.5, "unit rows"),
    "combination": ((*C, "set_of_both", "carry", 0, 0, 1, 0), 1.1, "not kept"),
    "level": ((*C, "level"), 0.999, "level"), "proved level": ((*C, "energy", "level2"), 0.99, "energy gain"),
    "P": ((*C, "energy", "P", 0, 0, 0), 1.01, "energy gain"), "P not symmetric": (
        (*C, "energy", "P", 0, 0, 1), 1.01, "Lyapunov"), "dwell time": ((*C, "dwell_add"), 3, "dwell"),
}


@pytest.mark.parametrize("name", FILTER)
def test_refuses_false_claims_of_a_filter(name, checker):
    folder, data = folder_of("filter")
    path, factor, words = FILTER[name]
    record = json.loads((folder / "resources.json").read_text())
    with pytest.raises(SystemExit, match=f"refused: .*{words}"):
        checker["filter"].main(folder, scaled(data, path, factor), record)


@pytest.mark.parametrize("old, new, words", [
    ('w = [{ name = "d", bounds = [-1, 1] }]', 'w = [{ name = "d", bounds = [-1.1, 1] }]', "energy gain"),
    ("0.60 + 0.2*0.22*delta", "0.60 + 0.2*0.3*delta", "energy gain"),
    ("Dw = [[0.25]]", "Dw = [[0.27]]", "energy gain"),
    ("Bf = [[0.45], [0.25]]", "Bf = [[0.47], [0.25]]", "energy gain"),
    ("x_hi = [0.1, 0.1]", "x_hi = [0.12, 0.1]", "box x0")])
def test_refuses_a_filter_of_another_plant(old, new, words, checker):
    folder, data = folder_of("filter")
    assert data["plant"]["toml"].count(old) == 1
    other = data | {"plant": data["plant"] | {"toml": data["plant"]["toml"].replace(old, new)}}
    with pytest.raises(SystemExit, match=words):
        checker["filter"].main(folder, other, json.loads((folder / "resources.json").read_text()))


def test_bounds_alone_are_refused_where_the_plant_is_another(checker):
    """The thresholds for themselves, without the energy gain before them."""
    module, (_, data) = checker["filter"], folder_of("filter")
    t, cert, graph = data["tables"]["float64"], data["certificate"]["float64"]["set_of_both"], ([None], [(0, 0, 0),
                                                                                                        (0, 1, 0)])
    toml = data["plant"]["toml"]
    for text, kept in ((toml, True), (toml.replace("[-1, 1] }]\nf", "[-1.02, 1] }]\nf"), False),
                       (toml.replace("0.2*0.22*delta", "0.2*0.23*delta"), False)):
        modes, ranges, box0 = module.read_plant(text)
        if kept:
            module.check_thresholds(module.Set(modes, t, cert, graph), t, cert, ranges, box0)
        else:
            assert text != toml
            with pytest.raises(SystemExit, match="not kept"):
                module.Set(modes, t, cert, graph)


@cache
def sampled(name):
    """Tables of small plants, whose delays nobody certified, and of the committed one."""
    if name == "committed":
        return folder_of("mode")[1]
    design = stand_in(name, 3)
    return {"plant": {"toml": PLANTS[name]}, "tables": {r: t.to_dict() for r, t in design.observer.tables.items()}}


def boxes(module, data, real, plants):
    """Everything about the boxes of one number type; the exponentials of a plant are calculated once."""
    modes, ranges, box0 = module.read_plant(data["plant"]["toml"])
    t, S = data["tables"][real], json.dumps(data["tables"][real]["S"])
    if S not in plants:
        period = module.tomllib.loads(data["plant"]["toml"])["time"]["sample_period"]
        plants[S] = module.Plant(modes, module.exact(t["S"]), module.F(float(period)))
    tables = module.Tables(modes, t, plants[S])
    tables.starts(ranges, box0)
    tables.answers(ranges)
    for j in range(len(modes)):
        lost, sums = tables.step(j)
        for i in (i for i in range(len(modes)) if i != j):
            tables.birth(i, j, lost, sums)


@pytest.fixture(scope="module")
def plants():
    return {}


@pytest.mark.parametrize("name", PLANTS)
def test_proves_boxes_of_every_kind_of_plant(name, checker, plants):
    for real in ("float32", "float64"):
        boxes(checker["births"], sampled(name), real, plants)


MODES = {"reach": 0.5, "birth": 0.5, "J_radius": 0.7, "J_u_radius": 0.5, "J_reach": 0.5, "v_lo": 0.99, "v_hi": 0.99,
         "x_room": 0.01, "start_hi": 0.999, "wide_lo": 0.999, "limit": 0.2, "Phi": 1.001, "Gamma": 0.999, "J": 1.01,
         "J_u": 1.01, "S_inverse": 1.001, "D": 1.01}


@pytest.mark.parametrize("name", MODES)
def test_refuses_false_boxes(name, checker, plants):
    data = copy.deepcopy(sampled("one input"))
    table = data["tables"]["float32"]

    def change(value):
        return [change(v) for v in value] if isinstance(value, list) else value * MODES[name]

    table[name] = change(table[name])
    with pytest.raises(SystemExit, match="refused: "):
        boxes(checker["births"], data, "float32", plants)


def test_rounding_counts(checker, plants):
    """Boxes that hold the plant in double precision do not hold what float32 rounds on the way."""
    data = copy.deepcopy(sampled("one input"))
    t = data["tables"]["float64"]
    boxes(checker["births"], data, "float64", plants)
    t["real"] = "float32"
    with pytest.raises(SystemExit, match="refused: "):
        boxes(checker["births"], data, "float64", plants)


SLIDING = {
    "d_hi": ((*T, "d_hi", 0, 0), 0.97, "offset of x_hi"), "d_lo": ((*T, "d_lo", 2, 0), 0.9, "offset of x_lo"),
    "M": ((*T, "M_lo", 1, 0, 0), -1.0, "M_lo < 0"), "L": ((*T, "L_hi", 0, 0, 0), 1.0001, "not the gain"),
    "G": ((*T, "G", 1, 2, 0), 1.01, "offset"), "v": ((*T, "v_hi", 0), 0.99, "v_hi"),
    "H": ((*T, "H", 0, 0), 1.01, "v_hi"),
    "range": ((*T, "x_hi", 0), 0.9, "box x too small"), "initial box": ((*T, "x0_lo", 1), 0.9, "box x0 too small"),
    "limit": ((*T, "limit", 0), 0.1, "limit"), "dwell": ((*T, "dwell"), 31, "dwell"),
    "blank": ((*T, "blank"), 5, "blank"),
    "P": ((*C, "P", 0, 1), 0.9, "P or J"), "J": ((*C, "target"), 0.9, "P or J"), "gamma": (
        (*C, "gamma", 1), 0.99, "level gamma"), "beta": ((*C, "beta", 2), 0.99, "level beta"),
    "limit of the gains": ((*C, "limit"), 0.01, "Metzler"), "gain": ((*C, "L_lo", 0, 0, 0), 0.9, "level|not the gain"),
    "error": ((*C, "errors", 0, 0, 0), 0.99, "does not settle"),
}


@pytest.fixture(scope="module")
def period(checker):
    """The exponentials of the committed plant, calculated once."""
    made = {}

    def of(module, modes, unit, T):
        if str(modes) not in made:
            made[str(modes)] = checker["period"].Plant(modes, unit, T)
        return made[str(modes)]

    return of


@pytest.mark.parametrize("name", SLIDING)
def test_refuses_false_claims_of_sliding_modes(name, checker, period, monkeypatch):
    folder, data = folder_of("sliding")
    path, factor, words = SLIDING[name]
    record = json.loads((folder / "resources.json").read_text())
    monkeypatch.setattr(checker["sliding"], "Plant", lambda *of: period(checker["sliding"], *of))
    with pytest.raises(SystemExit, match=f"refused: .*{words}"):
        checker["sliding"].main(folder, scaled(data, path, factor), record)


@pytest.mark.parametrize("old, new, words", [
    ('name = "w1", bounds = [-0.02, 0.02]', 'name = "w1", bounds = [-0.03, 0.02]', "does not settle"),
    ("minimum_dwell = 0.15", "minimum_dwell = 0.14", "dwell time")])
def test_refuses_sliding_modes_of_another_plant(old, new, words, checker, period, monkeypatch):
    folder, data = folder_of("sliding")
    assert data["plant"]["toml"].count(old) == 1
    other = data | {"plant": data["plant"] | {"toml": data["plant"]["toml"].replace(old, new)}}
    monkeypatch.setattr(checker["sliding"], "Plant", lambda *of: period(checker["sliding"], *of))
    with pytest.raises(SystemExit, match=words):
        checker["sliding"].main(folder, other, json.loads((folder / "resources.json").read_text()))


MEMBER, PROOF = (*T, "members", 0), (*C, "members", 0)
BANK = {
    "T2": ((*MEMBER, "T2", 1, 1), 1e15, "limits|level|T1 E"), "F": ((*MEMBER, "F", 0, 0, 0), 1.02, "level"),
    "G": ((*MEMBER, "G", 1, 0, 0), 2.0, "level"), "K": ((*MEMBER, "K", 0, 3, 1), 1.1, "level|contraction"),
    "C": ((*MEMBER, "C", 0, 2), 1.01, "level"), "M": ((*MEMBER, "M", 0, 0), 1.1, "level"),
    "a deaf weight": ((*MEMBER, "M", 1, 0), 0.8, "sensitivity"),
    "outputs": ((*MEMBER, "seen", 0), 0, "outputs of member 0"), "z0": ((*MEMBER, "z0", 1), 1e3, "settling time"),
    "gamma": ((*PROOF, "gamma"), 0.999, "level or period"), "proved level": (
        (*PROOF, "proof", "level", "level2"), 0.9, "the level at"), "beta": ((*PROOF, "beta"), 1.001, "sensitivity"),
    "proved sensitivity": ((*PROOF, "proof", "fault", "level2"), 1.1, "the sensitivity at"),
    "contraction": ((*PROOF, "proof", "level", "contraction"), 0.99, "the contraction at"),
    "P1": ((*PROOF, "proof", "level", "P1", 0, 0), 0.5, "P1, P2|level"), "P2": (
        (*PROOF, "proof", "level", "P2", 0, 1), 1.1, "P1, P2"), "R": (
        (*PROOF, "proof", "level", "R", 0, 0), -100.0, "the level at"), "T1": (
        (*PROOF, "proof", "T1", 0, 0, 3), 1.5, "the level at"), "period": ((*PROOF, "proof", "period"), 1.01, "period"),
    "start": ((*PROOF, "start", "gain2"), 0.9, "size of the residual"), "another's": (
        (*PROOF, "start", "member"), 1, "start of another"), "settling": ((*T, "settle"), 300, "settling time"),
    "begin": ((*T, "begin"), 5, "start of member"), "lost": ((*T, "bridge"), 6, "lost samples"),
    "pay": ((*T, "gap"), 19, "lost samples"), "limit": ((*T, "limit", 1), 0.5, "limits of member 0"),
    "averages": ((*T, "most", 3), 0.4, "averages of member 1"), "bound": (
        (*T, "bound", 0), 0.5, "settling|below the largest"), "wide bound": ((*T, "bound", 0), 3.0, "not isolated"),
    "runs": ((*C, "calibration", "runs"), 92, "confidence"), "probability": (
        (*C, "calibration", "probability"), 0.99, "confidence"), "confidence": (
        (*C, "calibration", "confidence"), 1.001, "confidence"), "levels": (
        (*C, "calibration", "levels", 1), 2.0, "below the largest"), "box": ((*T, "x_hi", 0), 0.9, "box x"),
}


@pytest.mark.parametrize("name", BANK)
def test_refuses_false_claims_of_a_bank(name, checker):
    folder, data = folder_of("bank")
    path, factor, words = BANK[name]
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        checker["bank"].main(folder, scaled(data, path, factor), json.loads((folder / "resources.json").read_text()))


@pytest.mark.parametrize("old, new, words", [
    ("[-0.02, 0.02] }, { name = \"noise 2\"", "[-0.03, 0.02] }, { name = \"noise 2\"", "level"),
    ("damping = 30.0", "damping = 31.0", "level"), ("speed + contact/m", "speed + 1.2*contact/m", "level"),
    ("Df = [[1, 0], [0, 1], [0, 0]]", "Df = [[1, 0], [0, 1], [0, 0.1]]", "sensitivity"),
    ('"y1 sensor", range = [-0.5, 0.5]', '"y1 sensor", range = [-0.4, 0.5]', ""),
    ("range = [-1.75, 1.75]", "range = [-1.75, 1.8]", "box x too small"),
    ("sample_period = 0.01", "sample_period = 0.011", "level or period")])
def test_refuses_a_bank_of_another_plant(old, new, words, checker):
    folder, data = folder_of("bank")
    assert data["plant"]["toml"].count(old) == 1
    other = data | {"plant": data["plant"] | {"toml": data["plant"]["toml"].replace(old, new)}}
    record = json.loads((folder / "resources.json").read_text())
    if not words:  # the unit of a fault is its largest size: nothing has changed
        checker["bank"].main(folder, other, record)
        return
    with pytest.raises(SystemExit, match=f"refused: .*{words}"):
        checker["bank"].main(folder, other, record)


def test_a_bank_of_given_vertices_is_proved_and_a_foreign_plant_is_not_judged(checker):
    data = json.loads((FILES[0].parents[2] / "tests" / "data" / "dlpv_bank.json").read_text())
    bank = checker["bank"]
    plant, t, cert = bank.read_plant(data["plant"]["toml"]), data["tables"]["float64"], data["certificate"]["float64"]
    m = bank.Member(plant, t, 2, cert["members"][2])
    m.level()
    m.fault()
    m.starts()
    bank.check_words(plant, t, cert, data["proved"]["float64"])
    with pytest.raises(SystemExit) as stopped:
        bank.read_plant(data["plant"]["toml"].replace("[[vertex]]", "[[vertex]]\noffset = [1, 0, 0]", 1))
    assert stopped.value.code == 2


#: What of the C, and what instead.
CHANGES = {
    "bank": ((r"s->z\[2\] \+ s->y\[1\]", "s->z[2] + s->y[0]"), (r"left\[i\] = 100U", "left[i] = 10U"),
             (r"wait = 431U", "wait = 43U"), (r"12\.75\d*F", "12.5F"),
             (r"0x2U, 0x1U", "0x1U, 0x2U"), (r"(bound\[\w+\] = \{\s*)[\d.]+F", r"\g<1>0.123F"),
             (r"0\.73849833F", "0.73849837F"), (r"s->z\[0\] = 0\.1F", "s->z[0] = 0.3F"), (r"<= 20\.0F", "<= 21.0F"),
             (r"out->r\[i\] = 0\.0F", "out->r[i] = 1.5F")),
    "sliding": ((r"(limit\[\w+\] = \{\s*)[\d.]+F", r"\g<1>0.123F"), (r"_PULL [\d.]+F", "_PULL 1.5F"),
                (r"move_hi\(const", "move_no(const"), (r"<= 15\.0F", "<= 16.0F"), (r"-1\.0F : 1\.0F", "-2.0F : 1.0F"),
                (r"(M\[[^{]*\{\s*\{[^{]*\{ )([\d.e-]+F), ([\d.e-]+F)", r"\1\3, \2")),
    "filter": ((r"(limit\[\w+\] = \{\s*)[\d.]+F", r"\g<1>0.123F"), (r"\{ (-?[\d.]+F), (-?[\d.]+F)", r"{ \1, 0.5F"),
               (r"\{ (\{ [\d.]+F \}), (\{ [\d.]+F \}) \}", r"{ \2, \1 }"), (r"since = 36U", "since = 56U"),
               (r"since >> 1U", "since >> 2U"), (r"since = 0U", "since = 1U"), (r">= -10\.0F", ">= -11.0F")),
    "mode": ((r"(limit\[\w+\] = \{\s*)[\d.]+F", r"\g<1>0.123F"), (r"(room\[\w+\] = \{\s*)[\d.e-]+F", r"\g<1>0.0F"),
             (r"(birth\[[^{]*\{\s*\{ )([\d.e-]+F), ([\d.e-]+F)", r"\1\3, \2"), (r"<= 15\.0F", "<= 16.0F"),
             (r"below\[i\] = 0\.0F", "below[i] = 1.5F")),
}


@pytest.mark.parametrize("family, part", [
    ("filter", "filter"), ("mode", "births"), ("sliding", "sliding"), ("bank", "bank")])
def test_refuses_another_c(family, part, checker):
    folder, data = folder_of(family)
    prefix, check = prefix_of(folder), checker[part].check_source
    text, header = ((folder / f"{prefix}.{end}").read_text() for end in "ch")
    refuses_changes(lambda source: check(source, header, data["tables"]["float32"], prefix), text, CHANGES[family])
    other, count = re.subn(r"(#define \w+_(?:LOST|OLDEST|DWELL|NF) )\d+U", r"\g<1>3U", header)
    assert count
    with pytest.raises(SystemExit, match="refused: (?:macro|ages)"):
        check(text, other, data["tables"]["float32"], prefix)
