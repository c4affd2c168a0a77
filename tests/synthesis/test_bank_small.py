"""Banks of discrete plants and of measured parameters: levels, certificate, independent checker, what they refuse."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from helpers import small_banks
from helpers.checker import checker_of
from helpers.descriptors import example, plant

from codegen.analysis.frequency import responses
from codegen.emit.package import firmware
from codegen.errors import CertificateError, DesignError
from codegen.plant.load import loads
from codegen.report.design_words import words_of
from codegen.selection.bank_claims import check
from codegen.selection.polytopic_tables import read_parameters
from codegen.synthesis import hminus_hinf_discrete
from codegen.synthesis.bank import decay_of, inapplicable
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.descriptor_problem import problem_of
from codegen.synthesis.hminus_hinf import Faults

DESIGNS = {"measured": small_banks.design, "continuous": small_banks.design, "state": small_banks.frozen}


checker = checker_of("bank")


def test_short_steps_come_near_a_level_of_the_dossier():
    """Its plant by Euler steps as a discrete one, without sensor 3; long steps see less."""
    seen, level = [0, 1], 1.2412
    p = replace(example(), Bd=np.array([[[1], [0], [0.5]], [[0.5], [0], [0.5]], [[0.2], [0], [0.5]]]))
    p = replace(p, C=p.C[seen], Dd=p.Dd[seen], H=p.C[seen], J=p.Dd[seen])
    found = [hminus_hinf_discrete.design(
        replace(p, A=p.E + T * p.A, B=T * p.B, Bd=T * p.Bd, kind="discrete"), Faults(np.zeros((3, 3, 2)), np.eye(2)),
        Bounds(100.0, T)) for T in (0.01, 0.1)]
    assert found[0].gamma == pytest.approx(level, rel=0.03) and found[1].gamma > 1.02 * found[0].gamma


def test_a_fault_on_the_state_has_no_such_design():
    p = replace(example(), kind="discrete")
    with pytest.raises(DesignError, match="moves the state"):
        hminus_hinf_discrete.design(p, Faults(np.ones((3, 3, 1)), np.zeros((3, 1))), Bounds(10.0, 0.1))


@pytest.mark.parametrize("name", DESIGNS)
def test_the_certificate_holds(name):
    d = DESIGNS[name](name)
    for real, t in d.observer.tables.items():
        claims = check(d.plant, t, d.certificate[real])
        assert claims == d.proved[real] and len(claims) == 7
        assert sum("Euler steps" in c for c in claims) == 2 * (name == "continuous")
        assert sum("alike in plant and observer" in c for c in claims) == 2 * (name != "state")
        assert all(("period" in m["proof"]) == (name == "continuous") for m in d.certificate[real]["members"])
        for i, (m, proved) in enumerate(zip(t.members, d.certificate[real]["members"])):
            r = responses(d.plant, m, m.seen, np.delete(np.arange(2), i))
            assert 0 < r.unknown.max() <= proved["gamma"] and np.all(r.fault[:, 0] >= 0.999 * proved["beta"])


def of(t, k, **changes):
    return replace(t, members=tuple(replace(m, **changes) if i == k else m for i, m in enumerate(t.members)))


def with_proof(cert, **changes):
    cert = deepcopy(cert)
    cert["members"][1]["proof"] |= changes
    return cert


def of_text(old, new):
    text = small_banks.TEXT
    assert text.count(old) == 1
    return loads(text.replace(old, new))


MUTANTS = {
    "Euler steps": lambda p, t, c: (p, t, with_proof(c, period=0.1)),
    "T1 of every vertex": lambda p, t, c: (p, t, with_proof(c, T1=[c["members"][1]["proof"]["T1"]] * 2)),
    "every fault": lambda p, t, c: (p, t, with_proof(c, criterion="all")),
    "another gain": lambda p, t, c: (p, of(t, 0, K=t.members[0].K * np.float32(1.2)), c),
    "another residual": lambda p, t, c: (p, of(t, 1, M=t.members[1].M * np.float32(1.1)), c),
    "another plant": lambda p, t, c: (of_text("0.7*b", "0.75*b"), t, c),
    "a wider valve": lambda p, t, c: (of_text("[0.2, 0.7]", "[0.1, 0.7]"), t, c),
    "a valve that is not known exactly": lambda p, t, c: (loads(small_banks.text_of("error")), t, c),
    "of continuous time": lambda p, t, c: (of_text('"discrete"', '"continuous"'), t, c),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_exact_check_refuses(mutant):
    d = small_banks.frozen()
    p, t, cert = d.plant, d.observer.tables["float32"], d.certificate["float32"]
    check(p, t, cert)
    with pytest.raises(CertificateError):
        check(*MUTANTS[mutant](p, t, cert))


@pytest.mark.parametrize("name", DESIGNS)
def test_the_independent_checker_agrees(name, checker, tmp_path):
    d = DESIGNS[name](name)
    for part, text in firmware(d, "float32", "table").items():
        (tmp_path / part).write_text(text, encoding="ascii")
    checker.main(tmp_path, json.loads(d.to_json()), {"prefix": "tanks", "real": "float32"})


#: What of the plant file, and what instead: each is another plant than the one of the certificate.
OTHERS = {"plant": ("0.7*b", "0.75*b", "level"), "leak": ("[-0.01, 0.01] }]\nv", "[-0.02, 0.02] }]\nv", "level"),
          "valve": ("[0.2, 0.7]", "[0.1, 0.7]", "bounds of a parameter"),
          "time": ('"discrete"', '"continuous"', "level"),
          "error": ("[0.2, 0.7] }", "[0.2, 0.7], error = 0.02 }", "bounds of a parameter"),
          "not exact": ("[0.2, 0.7] }", "[0.2, 0.7], error = 1e-8 }", "level at vertices 0, 1")}


@pytest.mark.parametrize("name", OTHERS)
def test_the_independent_checker_refuses_another_plant(name, checker):
    old, new, words = OTHERS[name]
    assert small_banks.TEXT.count(old) == 1
    data = json.loads(small_banks.frozen().to_json())
    p, t, cert = checker.read_plant(small_banks.TEXT), data["tables"]["float32"], data["certificate"]["float32"]
    checker.check_parameters(p, t)
    p = checker.read_plant(small_banks.TEXT.replace(old, new))
    with pytest.raises(SystemExit, match=f"refused: .*(?:{words})"):
        checker.check_parameters(p, t)
        for k, stored in enumerate(cert["members"]):
            m = checker.Member(p, t, k, stored)
            m.level()
            m.fault()


def test_the_independent_checker_knows_what_is_tied(checker):
    """All pairs unless inputs and exact parameters alone are read; with an unmeasured parameter nothing is said."""
    pairs = {name: checker.read_plant(small_banks.text_of(name))["pairs"] for name in small_banks.PLANTS}
    assert pairs["measured"] == pairs["continuous"] == [(0, 0), (1, 1)]
    assert len(pairs["state"]) == len(pairs["error"]) == 4
    for name, expected in pairs.items():
        assert list(problem_of(loads(small_banks.text_of(name))).pairs) == expected
    assert checker.read_plant(small_banks.TEXT.replace("E = [[1, 0], [0, 1]]\n", ""))["E"] == [[1, 0], [0, 1]]
    with pytest.raises(SystemExit) as stopped:
        checker.read_plant(small_banks.TEXT.replace("[0.2, 0.7] }", "[0.2, 0.7], measured = false }"))
    assert stopped.value.code == 2


def test_what_is_read_of_a_parameter_takes_in_its_error():
    p = loads(small_banks.text_of("error"))
    for real in ("float32", "float64"):
        found = read_parameters(p, real)
        lo, hi = float(found["theta_lo"][0]), float(found["theta_hi"][0])
        assert found["columns"] == (0,) and lo <= 0.2 - 0.02 and hi >= 0.7 + 0.02
        assert lo > 0.18 - 1e-7 and hi < 0.72 + 1e-7


@pytest.mark.parametrize("name", ["measured", "state"])
def test_the_report_says_that_steps_are_the_plants_own_and_what_weights_read(name):
    found = words_of(small_banks.frozen(name), "float32")
    facts = {f.term: f.text for f in found.facts}
    assert facts["Observers"].endswith("in discrete time") and "Euler" not in str(found)
    assert facts["Method"].endswith(", with weights that read measured parameters") == (name == "measured")
    assert "bound every path of theta" not in str(found)  # that is of surely detected faults, of which there are none


def test_decay_is_per_sample_where_the_plant_is_discrete():
    p = loads(small_banks.text_of("measured"))
    assert decay_of(problem_of(p)) == pytest.approx(-1.5 * np.log(0.8 - 0.2 * 0.2))
    slow = loads(small_banks.text_of("continuous"))
    assert decay_of(problem_of(slow)) == pytest.approx(1.5 * (2 + 2 * 0.2))


@pytest.mark.parametrize("kind, method", [("continuous", "hminus-hinf"), ("discrete", "descriptor-discrete")])
def test_a_fault_on_the_state_is_refused_with_the_reason(kind, method):
    text = plant("dlpv").text.replace('kind = "continuous"', f'kind = "{kind}"').replace(
        "Df = [[1, 0, 0]", "Bf = [[0, 0, 0], [1, 0, 0], [0, 0, 0]]\nDf = [[1, 0, 0]")
    reason = inapplicable(loads(text))
    assert "enters the error of every observer (T1 Bf f), so that none is blind" in reason
    assert f'method "{method}"' in reason
