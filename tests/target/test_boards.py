"""The generated C on simulated boards: bit for bit the host's, within its budgets, and who notices when not."""

import importlib.util
import json
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import POINTS, first_of_each
from helpers.scripts import GENERATED
from helpers.tools import need

from codegen.cli import main
from codegen.emit.render import template_root
from codegen.errors import ToolError
from codegen.observers import FAMILIES, PointTrace
from codegen.target.boards import BOARDS
from codegen.target.onboard import run_on

ROOT = Path(__file__).resolve().parents[2]
START = template_root() / "harness" / "board"
LAW = ROOT / "generated" / "quadrotor_tracking"
CART = ROOT / "generated" / "cart_tnl-interval"
#: Designs whose set is carried on in every sample; tables look up a row, which depends on time and modes.
STEADY = ("zammali_box_ellipsoid", "zammali_ellipsoid_ellipsoid", "zammali_trace_ellipsoid",
          "zammali_zonotope_zonotope")
spec = importlib.util.spec_from_file_location("c_tests_budgets", ROOT / "c_tests" / "budgets.py")
budgets = importlib.util.module_from_spec(spec)
spec.loader.exec_module(budgets)


@pytest.fixture
def arm():
    need("arm-none-eabi-gcc", "qemu-system-arm")


def mutant(folder, pattern, replacement):
    """A copy of the cart with one change in its C."""
    shutil.copytree(CART, folder)
    text, count = re.subn(pattern, replacement, (folder / "cart.c").read_text(), count=1)
    assert count == 1
    (folder / "cart.c").write_text(text)
    return folder


@pytest.mark.parametrize("folder", first_of_each(budgets.folders()), ids=lambda folder: folder.name)
def test_committed_designs(folder):
    """The host's bytes on each board, the state's size as declared, nothing above its budget."""
    chosen = budgets.boards(folder)
    need(*{tool for board in chosen for tool in (f"{BOARDS[board].tools}gcc", BOARDS[board].simulator[0])})
    for board in chosen:
        result = run_on(folder, board, START)
        assert result.passed, result
        assert result.state_bytes == json.loads((folder / "resources.json").read_text())["state_bytes"]
        assert result.counts["step"].calls > 30 and result.counts["refused"].calls > 1
        assert budgets.excess(folder.name, result, budgets.budgets().get((folder.name, board))) == []


def test_a_law_on_a_board(arm, tmp_path):
    """With its observer: the host's bytes, within its budget, which is that of a call of the law."""
    result = run_on(LAW, "m4f", START)
    assert result.passed and result.counts["track"].calls > 40 and result.counts["coast"].calls == 3
    assert result.counts["track"].most > result.counts["step"].most + 100
    assert budgets.excess(LAW.name, result, budgets.budgets()[LAW.name, "m4f"]) == []
    found = budgets.figures(result)
    assert found["instructions"] == result.counts["track"].most
    folder = shutil.copytree(LAW, tmp_path / "mutant")
    text = (folder / "quadrotor.c").read_text()
    assert "0.23816733F * law->s[0]" in text
    (folder / "quadrotor.c").write_text(text.replace("0.23816733F * law->s[0]", "0.23816735F * law->s[0]"))
    assert run_on(folder, "m4f", START).self_test > 2000


def test_every_point_observer_has_budgets_on_the_small_boards():
    """All families of sets; what is left out does not fit, and says so."""
    rows = set(budgets.budgets())
    points = [folder for folder in budgets.folders() if "m0" in budgets.boards(folder)]
    assert points == [folder for folder in POINTS if folder in GENERATED]
    families = {json.loads((folder / "resources.json").read_text())["family"] for folder in points}
    assert families == {name for name, family in FAMILIES.items() if family.trace_class is PointTrace}
    assert {(f.name, b) for f in points for b in (*budgets.BOARDS, *budgets.OF_SETS)} - rows == budgets.TOO_LARGE
    assert rows == {(f.name, b) for f in budgets.folders() for b in budgets.boards(f)}


@pytest.mark.parametrize("name,board", sorted(budgets.TOO_LARGE))
def test_what_is_left_out_does_not_fit(name, board):
    need("avr-gcc", "simavr")
    with pytest.raises(ToolError, match="not within region|bytes of RAM"):
        run_on(ROOT / "generated" / name, board, START)


def test_a_budget_that_is_exceeded_is_told(arm):
    result = run_on(CART, "m4f", START)
    found = budgets.figures(result)
    assert budgets.excess("cart", result, found) == []
    (told,) = budgets.excess("cart", result, found | {"flash_bytes": found["flash_bytes"] - 1})
    assert "flash_bytes" in told and "--update" in told
    assert "no budget" in budgets.excess("cart", result, None)[0]


def test_ordinary_steps_take_the_same_number_of_instructions(arm):
    """Whatever the data: table layout, hardware float, guarantee in force. And counting repeats exactly."""
    first, second = (run_on(CART, "m4f", START) for _ in range(2))
    ordinary = first.counts["ordinary"]
    assert ordinary.calls >= 10 and ordinary.least == ordinary.most
    assert first == second
    assert ordinary.most < first.counts["step"].most  # a restart after a fault costs more: it must have been seen


@pytest.mark.parametrize("folder", [f for f in budgets.folders() if f.name in STEADY], ids=lambda folder: folder.name)
def test_ordinary_steps_of_sets_take_the_same_number_of_instructions(arm, folder):
    """The set is worked on in every sample: neither signals nor the columns that are exchanged change the count.

    A sample with a fault, one after missing samples or a restart (the set is formed twice) takes a third more at most.
    """
    counts = run_on(folder, "m4f", START).counts
    assert counts["ordinary"].calls >= 10 and counts["ordinary"].least == counts["ordinary"].most
    assert counts["ordinary"].most <= counts["step"].most <= 1.35 * counts["ordinary"].most
    assert counts["predict"].most < counts["ordinary"].most


def test_an_early_exit_is_seen_in_the_instructions(arm, tmp_path):
    """The same answers, bit for bit, but a test of membership that ends once the residual is known to be inside."""
    folder = shutil.copytree(ROOT / "generated" / "zammali_zonotope_zonotope", tmp_path / "zonotope")
    source = folder / "zammali_zonotope.c"
    text, count = re.subn(r"( +most \+= zammali_zonotope_size\(along\);)",
                          r"\1 if (zammali_zonotope_size(value) <= most) { break; }", source.read_text())
    assert count == 1
    source.write_text(text)
    result = run_on(folder, "m4f", START)
    assert result.passed and result.counts["ordinary"].least < result.counts["ordinary"].most


def test_the_count_is_of_instructions(arm, tmp_path):
    """Ten more instructions in step count as ten more."""
    more = mutant(tmp_path / "cart", r"(cart_status cart_step\(.*\n\{\n)", r'\1    __asm__ volatile("'
                  + r"nop\\n" * 10 + '");\n')
    text = (more / "cart.c").read_text().replace("__asm__", "#ifdef __arm__\n__asm__").replace(
        '");\n', '");\n#endif\n', 1)
    (more / "cart.c").write_text(text)
    before, after = run_on(CART, "m4f", START), run_on(more, "m4f", START)
    for kind in ("step", "ordinary"):
        assert after.counts[kind].least == before.counts[kind].least + 10
        assert after.counts[kind].most == before.counts[kind].most + 10
    assert after.counts["predict"] == before.counts["predict"]


@pytest.mark.parametrize("number, family, variant", [(0, "interval", "guarded"), (1, "tnl", "unequal"),
                                                     (2, "tnl", "smallest"), (3, "interval", "big")])
def test_stand_ins(arm, number, family, variant, tmp_path):
    """Float and double, every layout, on the boards in turn; the harness itself compiles without a warning."""
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path / "cart",
                   ("float64", "float32")[number % 2], ("literal", "table", "loop")[number % 3])
    assert run_on(folder, ("m4f", "m7", "m3", "m0")[number], START, ("-Wall", "-Wextra", "-Werror")).passed


def test_a_changed_constant_is_noticed(arm, tmp_path):
    result = run_on(mutant(tmp_path / "cart", r"1\.0003095F", "1.0003096F"), "m4f", START)
    assert result.self_test > 0 and not result.passed


def test_contraction_is_noticed(arm):
    """Fused multiply-add, which the compiler's own default would use on this FPU, gives other last digits."""
    assert not run_on(CART, "m4f", START, ("-ffp-contract=fast",)).passed
    assert run_on(CART, "m3", START, ("-ffp-contract=fast",)).passed  # has no such instruction


def test_bytes_that_compare_equal_are_told_apart(arm, tmp_path):
    zero = r"\n#ifdef __arm__\n    out->r_lo[0] = -0.0F;\n#else\n    out->r_lo[0] = 0.0F;\n#endif"
    result = run_on(mutant(tmp_path / "cart", r"\n    out->r_lo\[0\] = 0\.0F;", zero), "m4f", START)
    assert result.self_test == 0 and not result.same_as_host and not result.passed


def test_a_fault_ends_the_run(arm, tmp_path):
    trap = mutant(tmp_path / "cart", r"(cart_status cart_step\(.*\n\{\n)", r"\1    __builtin_trap();\n")
    with pytest.raises(ToolError, match="did not come to its end"):
        run_on(trap, "m4f", START)


@pytest.mark.parametrize("board, tools", [
    ("m0", ("arm-none-eabi-gcc", "qemu-system-arm")), ("rv32", ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")),
    ("rv32d", ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")), ("avr", ("avr-gcc", "simavr"))])
def test_other_boards(board, tools):
    need(*tools)
    assert run_on(ROOT / "generated" / "zammali_fd_tnl-interval", board, START).passed


def test_double_refuses_avr(tmp_path):
    need("avr-gcc", "simavr")
    folder = write(stand_in(prefix="cart"), tmp_path / "cart", "float64")
    with pytest.raises(ToolError, match="double is not the IEEE 754 type"):
        run_on(folder, "avr", START)


def test_command(arm, tmp_path):
    """It prints, keeps the figures beside the rest, and its exit status says whether the boards agree."""
    shutil.copytree(CART, tmp_path / "good")
    before = json.loads((CART / "resources.json").read_text())
    done = CliRunner().invoke(main, ["target", str(tmp_path / "good"), "--board", "m4f"])
    assert done.exit_code == 0, done.output
    after = json.loads((tmp_path / "good" / "resources.json").read_text())
    figures = after.pop("target")["m4f"]
    assert after == before
    assert figures["passed"] and figures["counts"]["step"]["most"] > 50 and figures["unit"] == "instructions"
    wrong = mutant(tmp_path / "wrong", r"1\.0003095F", "1.0003096F")
    assert CliRunner().invoke(main, ["target", str(wrong), "--board", "m4f"]).exit_code == 7
    done = CliRunner().invoke(main, ["target", str(tmp_path), "--board", "m4f"])
    assert done.exit_code == 6 and "residua generate" in done.output


def test_tools_that_are_missing_are_named(monkeypatch, tmp_path):
    shutil.copytree(CART, tmp_path / "cart")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolError, match="apt-get install gcc-arm-none-eabi qemu-system-arm"):
        run_on(tmp_path / "cart", "m3", START)
    done = CliRunner().invoke(main, ["target", str(tmp_path / "cart")])
    assert done.exit_code == 6 and "no cross compiler" in done.output


def test_harness_has_no_library():
    """Nothing but the compiler's own headers, so that it builds without newlib."""
    for path in START.glob("*.[ch]"):
        text = re.sub(r"#if defined\(ON_HOST\)\n#include <stdio.h>", "", path.read_text())
        foreign = set(re.findall(r"#include <(.*)>", text)) - {"stdint.h"}
        assert all(name.startswith("avr/") for name in foreign), path.name
