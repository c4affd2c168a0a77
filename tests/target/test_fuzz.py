"""libFuzzer with sanitizers finds nothing in the C, and finds what is planted in it."""

import json
import re
import shutil

import pytest
from click.testing import CliRunner
from helpers import small_banks
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import KEPT, POINTS, family_of
from helpers.scripts import GENERATED, prefix_of
from helpers.tools import need

from codegen.cli import main
from codegen.emit.fuzzing import fuzz_harness
from codegen.errors import ToolError, ValidationError
from codegen.target.fuzz import fuzz, read_record, require

need("clang-19")
TWO = [folder for folder in GENERATED if folder.name in ("relay_tnl-interval", "zammali_fd_interval")]


def run(folder, runs=50000):
    return fuzz(folder, fuzz_harness(read_record(folder)), runs=runs)


@pytest.mark.parametrize("folder", TWO, ids=lambda folder: folder.name)
def test_committed_designs(folder):
    found = run(folder)
    require(found)
    assert found.runs == 50000 and found.edges > 80


@pytest.mark.parametrize("family", ["ellipsoid", "thresholds", "filter", "driven", "descriptor",
                                    "guided", "guided_point", "guided_filter", "bank", "follower",
                                    "trailing"])
def test_other_observers(family):
    """The set online and as a table, all other families (polytopic: below; mode estimators: those beside others)."""
    found = run(next(f for f in KEPT if family_of(f) == family), 2000)
    require(found)
    assert found.runs == 2000 and found.edges > 80


@pytest.mark.parametrize("old,new", [("", ""), (r"!\w+_theta_accepted\(in\)", "in->theta[0] > 0.6F")])
def test_a_bank_that_reads_a_parameter(old, new, tmp_path):
    folder = write(small_banks.frozen(), tmp_path)
    text = (folder / "tanks.c").read_text()
    (folder / "tanks.c").write_text(re.sub(old, new, text, count=1) if old else text)
    found = run(folder, 2000)
    assert bool(found.message) == bool(old) and (old or found.edges > 100)


@pytest.mark.parametrize("old,new", [
    ("", ""),
    (r"(    if \(!\w+_ref_accepted\(ref\)\)\n    \{)", r"\1 law->limited = 7U;"),  # a refusal that writes
    (r"in->u\[i\] = most\[i\];", "in->u[i] = 2.0F * most[i];")])  # an input that is not cut
def test_a_law_and_its_mutants(old, new, tmp_path):
    folder = shutil.copytree(next(f for f in KEPT if f.name == "quadrotor_tracking"), tmp_path / "mutant")
    source = folder / f"{prefix_of(folder)}.c"
    text, count = re.subn(old, new, source.read_text(), count=1)
    assert count == 1
    source.write_text(text)
    found = run(folder, 2000)
    assert bool(found.message) == bool(old) and (old or found.edges > 120)


@pytest.mark.parametrize("old,new", [
    (r"\(s->since < \w+_ROWS\) \? s->since : \(\w+_ROWS - 1U\)", "s->since"),  # a spoilt state reads beyond a table
    (r"out->x_hi\[i\] = ", "out->x_hi[i] = (radius[0] - radius[0]) / 0.0F + ")])  # bounds that are no numbers
def test_mutants_of_a_point_observer(old, new, tmp_path):
    folder = shutil.copytree(next(f for f in POINTS if family_of(f) == "thresholds"), tmp_path / "mutant")
    source = folder / f"{prefix_of(folder)}.c"
    text, count = re.subn(old, new, source.read_text(), count=1)
    assert count == 1
    source.write_text(text)
    found = run(folder, 20000)
    assert found.crash and found.message


@pytest.mark.parametrize("family,variant,layout,real", [("tnl", "unequal", "loop", "float64"),
                                                        ("interval", "smallest", "literal", "float32")])
def test_stand_ins(family, variant, layout, real, tmp_path):
    found = run(write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, layout), 3000)
    require(found)
    assert found.runs == 3000


@pytest.mark.parametrize("old,new", [
    ("[(s->mode < RELAY_MODES) ? s->mode : 0U]", "[s->mode]"),  # a spoilt state reads beyond a table
    ("status = RELAY_BAD_OUTPUT;", "status = RELAY_BAD_OUTPUT; out->raw = 9U;"),  # refusal that writes
    ("in->u[0] <= 2.0F", "in->u[0] <= 2.5F"),  # range
    ("+ (k[4] * s->x_lo[0])", "- (k[4] * s->x_lo[0])")])  # framers cross
def test_mutants(old, new, tmp_path):
    folder = shutil.copytree(TWO[0], tmp_path / "mutant")
    source = folder / f"{prefix_of(folder)}.c"
    text = source.read_text()
    assert old in text
    source.write_text(text.replace(old, new))
    found = run(folder)
    assert found.crash and found.message
    with pytest.raises(ValidationError, match="Sequence: [0-9a-f]+"):
        require(found)


def test_command(tmp_path):
    folder = shutil.copytree(TWO[1], tmp_path / "made")  # its assurance file is written
    done = CliRunner().invoke(main, ["fuzz", str(folder), "--runs", "2000"])
    assert done.exit_code == 0 and "2000 sequences" in done.output, done.output
    done = CliRunner().invoke(main, ["fuzz", str(tmp_path)])
    assert done.exit_code == ToolError.exit_code and "resources.json" in done.output


def test_folders_that_are_not_ours(tmp_path):
    (tmp_path / "resources.json").write_text(json.dumps([1]))
    with pytest.raises(ToolError, match="Make the folder with residua generate"):
        read_record(tmp_path)
    folder = shutil.copytree(TWO[1], tmp_path / "broken")
    (folder / f"{prefix_of(folder)}.c").write_text("int broken(")
    with pytest.raises(ToolError, match="cannot compile"):
        run(folder)
