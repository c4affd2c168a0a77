"""The tests in C reach every statement, branch and condition of the C (MC/DC)."""

import shutil

import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import first_of_each, whole
from helpers.scripts import GENERATED, load
from helpers.tools import need

need("gcc", "gcov", "clang-19", "llvm-cov-19", "llvm-profdata-19")
coverage = load("coverage")


#: One of each family, the observer that has a tracking law beside it, and the box that holds noise of its own sample.
WHOLE = [*whole(first_of_each(GENERATED)), *(f for f in GENERATED if f.name in (
    "quadrotor_tracking", "zammali_box_ellipsoid"))]


@pytest.mark.parametrize("folder", WHOLE, ids=lambda folder: folder.name)
def test_committed_designs(folder):
    found = coverage.measure(folder)
    assert found.missed == () and found.complete, str(found)


@pytest.mark.parametrize("family,variant,layout,real", [
    ("interval", "guarded", "loop", "float64"), ("tnl", "sparse", "loop", "float32"),
    ("tnl", "guarded", "literal", "float64"), ("interval", "unequal clamped", "table", "float32")])
def test_stand_ins(family, variant, layout, real, tmp_path):
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, layout)
    found = coverage.measure(folder)
    assert found.missed == () and found.complete, str(found)


def test_what_is_not_reached_is_named(tmp_path):
    """A branch that no test can take, and a condition that decides nothing, in the C."""
    folder = shutil.copytree(next(f for f in GENERATED if f.name.startswith("buck")), tmp_path / "mutant")
    source = next(p for p in folder.glob("*.c") if not p.name.startswith(("test_", "prove_")))
    text = source.read_text()
    old = "    uint32_t raw = 0U;\n"
    assert old in text
    source.write_text(text.replace(old, f"{old}\n    if ((out->raw == 77U) && (out->alarm == 77U))\n    {{\n"
                                        "        raw = 1U;\n    }\n", 1))
    found = coverage.measure(folder)
    assert not found.complete and found.statements[0] == found.statements[1] - 1
    assert any("is not run" in m for m in found.missed) and any("condition 2 of 2" in m for m in found.missed)
