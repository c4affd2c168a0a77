"""The commands enter what they found in assurance.json; what ran on another C is called stale; the report shows it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from helpers.designs import stand_in
from helpers.reports import StandInDriver, output_folder, small_design
from helpers.tools import need

import codegen
from codegen.assurance import document
from codegen.assurance.checks import CHECKS, digests
from codegen.cli import main
from codegen.designs import read_checked
from codegen.emit.package import generate as emit
from codegen.errors import CertificateError, EmitError
from codegen.pipeline import broken, check_assurance, record
from codegen.report.page import write_report
from codegen.target.fuzz import Fuzzed
from codegen.target.gappa import RoundingResult
from codegen.target.prove import ProofResult

GENERATED = Path(__file__).resolve().parents[2] / "generated"
PROVED = ProofResult(True, (), 1.5, "25.0 (Manganese)", {"cart_step": 12, "cart_init": 3}, 100)
NOT_PROVED = replace(PROVED, proved=False, alarms=("cart.c:3: cart_step: Unknown: is_nan",))
LATER = ("validation", "prove", "rounding", "fuzz", "target")
ROUNDED = RoundingResult(True, (), 14, 0.4, "1.4.1")
RUN = SimpleNamespace(board="m4f", passed=True, self_test=0, same_as_host=True, compiler="gcc 1", simulator="QEMU 7")


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The cart's committed folder with its assurance file."""
    folder = tmp_path_factory.mktemp("updates") / "cart"
    shutil.copytree(GENERATED / "cart_tnl-interval", folder)
    document.write(folder, read_checked(folder))
    return folder


@pytest.fixture
def cart(first, tmp_path):
    return Path(shutil.copytree(first, tmp_path / "cart"))


def states(folder):
    return {e["id"]: e["state"] for e in json.loads((folder / "assurance.json").read_text())["checks"]}


def check(folder, name):
    (found,) = [e for e in json.loads((folder / "assurance.json").read_text())["checks"] if e["id"] == name]
    return found


def edit(folder, old, new):
    source = folder / "cart.c"
    text = source.read_text()
    assert old in text
    source.write_text(text.replace(old, new, 1))


def test_what_was_not_run_is_listed_with_its_command(cart):
    assert list(states(cart)) == list(CHECKS)
    assert {k for k, v in states(cart).items() if v == "not run"} == set(LATER)
    for name in LATER:
        command = check(cart, name)["command"].split()
        assert command[0] == "residua" and command[1] in main.commands and not check(cart, name)["ran_on"]
    assert all(e in main.commands for e in ("assurance", "certify", "generate"))


def test_a_proof_is_entered_with_the_digest_of_its_c(cart):
    assert record(cart, "prove", PROVED) == ""
    found = check(cart, "prove")
    assert found["state"] == "passed" and found["tool"] == "Frama-C 25.0 (Manganese)"
    assert found["figures"] == {"properties proved": 15, "alarms": [], "coverage in percent": 100}
    assert found["ran_on"] == digests(cart, ["cart.c", "cart.h", "prove_cart.c"])
    assert states(check_and_return(cart))["prove"] == "passed"


def check_and_return(folder):
    check_assurance(folder)
    return folder


def test_a_failure_is_entered_too(cart):
    record(cart, "prove", NOT_PROVED)
    record(cart, "fuzz", Fuzzed(cart, 10, 5, b"\x00", "runtime error: x"))
    assert states(cart)["prove"] == states(cart)["fuzz"] == "failed"
    assert check(cart, "prove")["figures"]["alarms"] == list(NOT_PROVED.alarms)
    record(cart, "prove", PROVED)
    assert states(cart)["prove"] == "passed" and states(cart)["fuzz"] == "failed"


def test_boards_add_up_and_one_failure_is_one(cart):
    record(cart, "target", [RUN])
    record(cart, "target", [SimpleNamespace(**(vars(RUN) | {"board": "rv32", "passed": False, "self_test": 4}))])
    found = check(cart, "target")
    assert found["state"] == "failed" and set(found["figures"]) == {"m4f", "rv32"}
    edit(cart, "#include <float.h>", "#include <float.h>\n")
    record(cart, "target", [RUN])  # the other board's result is of another C
    assert set(check(cart, "target")["figures"]) == {"m4f"} and states(cart)["target"] == "passed"


def test_results_of_another_c_are_stale_and_the_claims_are_stated_anew(cart):
    record(cart, "prove", PROVED)
    before = json.loads((cart / "assurance.json").read_text())
    edit(cart, "#include <float.h>", "\n#include <float.h>")  # one line further down, the same numbers
    with pytest.raises(CertificateError, match="cart.c"):
        check_assurance(cart)
    assert record(cart, "fuzz", Fuzzed(cart, 10, 5, b"", "")) == ""
    found = states(cart)
    assert (found["prove"], found["compile"], found["fuzz"], found["exact"]) == ("stale", "stale", "passed", "passed")
    assert check(cart, "prove")["ran_on"] != digests(cart, ["cart.c", "cart.h", "prove_cart.c"])
    after = check_assurance(cart)
    (old,), (new,) = (data["claims"][1]["lines"].values() for data in (before, after))
    assert [[a + 1, b + 1] for a, b in old] == new
    record(cart, "prove", PROVED)
    assert states(cart)["prove"] == "passed"


def test_c_with_another_constant_is_called_so_and_the_result_is_kept(cart):
    text = (cart / "cart.c").read_text()
    number = re.search(r"\d\.\d{6,}F", text)[0]
    edit(cart, number, "0.5F")
    problem = record(cart, "fuzz", Fuzzed(cart, 10, 5, b"", ""))
    assert "not about this C" in problem and "0.5" in problem
    data = json.loads((cart / "assurance.json").read_text())
    assert data["state"].startswith("stale: ") and data["claims"]
    assert states(cart)["fuzz"] == "passed" and states(cart)["read-back"] == "stale"
    assert states(cart)["independent"] == "failed"
    with pytest.raises(CertificateError):
        check_assurance(cart)
    edit(cart, "0.5F", number)
    assert record(cart, "prove", PROVED) == ""
    assert states(cart)["fuzz"] == "stale" and states(cart)["read-back"] == "passed"
    check_assurance(cart)


@pytest.mark.parametrize("spoil", ["missing", "no JSON", "no checks"])
def test_a_missing_or_broken_file_is_made_again(cart, spoil):
    path = cart / "assurance.json"
    path.unlink() if spoil == "missing" else path.write_text("{" if spoil == "no JSON" else '{"checks": 3}')
    assert record(cart, "prove", PROVED) == ""
    assert states(cart)["prove"] == "passed" and states(cart)["compile"] == "not run"
    check_assurance(cart)


def test_a_folder_without_design_keeps_its_result(cart):
    for name in ("design.json", "assurance.json"):
        (cart / name).unlink()
    assert "not about this C" in record(cart, "prove", PROVED)
    assert states(cart) == dict.fromkeys(CHECKS, "not run") | {"prove": "passed"}


@pytest.mark.parametrize("fault", ["resources", "disk"])
def test_what_cannot_be_entered_is_said_and_changes_nothing(cart, fault, monkeypatch):
    before = (cart / "assurance.json").read_bytes()
    if fault == "resources":
        (cart / "resources.json").unlink()
    else:
        def full(*args):
            raise OSError("No space left on device")
        monkeypatch.setattr(os, "replace", full)
    assert "not updated" in record(cart, "prove", PROVED)
    assert (cart / "assurance.json").read_bytes() == before
    assert not [p.name for p in cart.iterdir() if p.name.startswith(".")]


def test_commands_at_the_same_time_do_not_lose_results(cart):
    results = [("prove", PROVED), ("rounding", ROUNDED), ("fuzz", Fuzzed(cart, 1, 1, b"", "")), ("target", [RUN])]
    threads = [threading.Thread(target=record, args=(cart, *r)) for r in results]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert all(states(cart)[name] == "passed" for name, _ in results)


def test_a_part_of_the_scenarios_does_not_stand_for_all(cart):
    design = small_design("cart")
    outcomes = codegen_outcomes(design)
    assert broken(design, "float32", outcomes) == ""
    record(cart, "validation", (outcomes[:1], "", design.plant.scenarios))
    assert states(cart)["validation"] == "not run"
    record(cart, "validation", (outcomes, "", design.plant.scenarios))
    figures = check(cart, "validation")["figures"]
    assert states(cart)["validation"] == "passed" and figures["scenarios"] == ["no fault", "encoder fault"]
    assert (figures["faults"], figures["faults found"], figures["false alarms"]) == (1, 1, 0)
    bad = [replace(outcomes[0], lost=2)]
    said = broken(design, "float32", bad)
    record(cart, "validation", (bad, said, design.plant.scenarios))
    assert states(cart)["validation"] == "failed"
    assert "2 samples" in check(cart, "validation")["figures"]["promise broken"]


def codegen_outcomes(design):
    from helpers.reports import outcomes_of

    return outcomes_of(design)


def residua(*args):
    return CliRunner().invoke(main, [str(a) for a in args])


@pytest.mark.parametrize("result, status", [(PROVED, 0), (NOT_PROVED, 7)])
def test_prove_and_target_enter_their_results(cart, monkeypatch, result, status):
    from codegen.target import gappa, onboard, prove

    monkeypatch.setattr(prove, "prove", lambda folder: result)
    monkeypatch.setattr(gappa, "nothing_to_prove", lambda folder: "")
    monkeypatch.setattr(gappa, "prove_rounding", lambda folder: ROUNDED)
    monkeypatch.setattr(onboard, "run_all", lambda *args: [])
    assert residua("prove", cart).exit_code == status
    assert states(cart)["prove"] == ("failed" if status else "passed")
    assert states(cart)["rounding"] == ("not run" if status else "passed")
    (cart / "resources.json").unlink()  # it cannot be entered: the command's own result stays
    done = residua("prove", cart)
    assert done.exit_code == status and "assurance.json: not updated" in done.output
    assert residua("target", cart).exit_code == 0


def test_validate_enters_its_result(cart):
    done = residua("validate", cart)
    assert done.exit_code == 0 and states(cart)["validation"] == "passed"
    assert residua("validate", cart, "--scenario", "no fault").exit_code == 0
    assert check(cart, "validation")["figures"]["samples"] == 800


def test_fuzz_enters_its_result(cart):
    need("clang")
    done = residua("fuzz", cart, "--runs", "200")
    assert done.exit_code == 0, done.output
    found = check(cart, "fuzz")
    assert found["state"] == "passed" and found["figures"]["sequences of calls"] >= 200
    assert "clang" in found["tool"] and found["ran_on"] == digests(cart, ["cart.c", "cart.h"])


def test_the_assurance_command(cart):
    done = residua("assurance", cart)
    assert done.exit_code == 0 and "containment" in done.output and "residua prove ." in done.output
    edit(cart, "#include <float.h>", "#include <float.h>\n")
    done = residua("assurance", cart)
    assert done.exit_code == 5 and "assurance.json" in done.output
    assert len(done.output.strip().splitlines()) == 1


def test_generate_writes_it_and_replaces_an_older_one(tmp_path):
    design = small_design("cart")
    folder = codegen.generate(design, tmp_path / "out", real="float64", layout="loop")
    data = check_assurance(folder)
    assert data["design"]["real"] == "float64" and states(folder)["compile"] == "passed"
    record(folder, "prove", PROVED)
    codegen.generate(design, folder, real="float32", layout="literal")
    assert check_assurance(folder)["design"]["layout"] == "literal" and states(folder)["prove"] == "not run"
    emit(stand_in(prefix="cart"), folder)  # without a certificate there are no claims, and none of old may stay
    assert not (folder / "assurance.json").exists()
    (tmp_path / "mine").mkdir()
    with pytest.raises(EmitError):
        codegen.generate(design, tmp_path / "mine")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "out"]


def test_the_independent_checker_that_is_named_runs(cart):
    command = check(cart, "independent")["command"].split()
    done = subprocess.run([os.sys.executable, *command[1:]], cwd=cart, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(GENERATED.parent)})
    assert done.returncode == 0 and done.stdout.splitlines() == check(cart, "independent")["figures"]["says"]


def test_the_report_shows_it_as_a_table(tmp_path):
    design = small_design("cart")
    folder = output_folder(tmp_path / "cart", design)
    path = write_report(folder, design, StandInDriver(design), [])
    assert "There is no assurance.json" in path.read_text()
    folder = codegen.generate(design, tmp_path / "whole")
    record(folder, "prove", NOT_PROVED)
    html = write_report(folder, design, StandInDriver(design), []).read_text(encoding="utf-8")
    section = re.search(r'<section id="assurance">.*?</section>', html, re.S)[0].replace("\u2060", "")
    assert '<a href="#assurance">' in html and 'href="assurance.json"' in html
    data = json.loads((folder / "assurance.json").read_text())
    rows = re.findall(r"<tr class=\"\">(.*?)</tr>", section, re.S)
    assert len(rows) == len(data["claims"]) + len(data["checks"])
    for claim, row in zip(data["claims"], rows):
        text = row.replace("&gt;", ">").replace("&lt;", "<").replace("&#39;", "'")
        (spans,) = claim["lines"].values()
        assert claim["claim"] in text and claim["condition"]["formula"] in text
        assert all(f"{a}–{b}" in text if a != b else str(a) in text for a, b in spans)
        assert all(c in text for c in (*claim["constants"], *claim["checks"]))
    assert '<td class="bad">failed</td>' in section and section.count('<td class="warn">not run</td>') == 4
