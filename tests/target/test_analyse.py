"""clang-tidy and cppcheck with MISRA find nothing in the C but what templates/MISRA.md lists, with its reason."""

import re
import shutil

import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import whole
from helpers.scripts import GENERATED, load
from helpers.tools import need

need("clang-tidy-19", "cppcheck")
analyse = load("analyse")


@pytest.mark.parametrize("folder", whole(GENERATED), ids=lambda folder: folder.name)
def test_committed_designs(folder):
    assert analyse.unlisted(folder) == []


@pytest.mark.parametrize("family,variant,layout,real", [
    ("interval", "guarded", "loop", "float64"), ("interval", "unequal clamped", "literal", "float32"),
    ("tnl", "sparse", "loop", "float32"), ("tnl", "guarded", "literal", "float64"),
    ("tnl", "unequal", "table", "float32")])
def test_stand_ins(family, variant, layout, real, tmp_path):
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, layout)
    assert analyse.unlisted(folder) == []


def test_every_listed_deviation_occurs():
    """A row that nothing needs any more would hide the next finding of its kind."""
    missing = set(analyse.deviations())
    for folder in GENERATED:
        found = analyse.cppcheck(folder) if missing else []
        missing -= {d for d in missing for f in found if d.covers(f, analyse.prefix_of(folder))}
    assert not missing


@pytest.mark.parametrize("old,new,finding", [
    (r"    uint32_t raw = 0U;\n", "    uint32_t raw = 0U;\n    int spare;\n", "unusedVariable"),
    (r"    return raw;\n", "    if (raw == 9U)\n    {\n        return 0U;\n    }\n    return raw;\n",
     "misra-c2012-15.5"),
    (r"static bool (\w+)_judge", r"bool \1_judge", "misra-c2012-8.7"),
    (r"(static bool \w+_y_accepted)", r"#define Cart_loose(a) a + 1\n\1", "bugprone-macro-parentheses")])
def test_a_new_finding_is_noticed(old, new, finding, tmp_path):
    """Mutants of the C: also of a rule that is deviated from, at another place."""
    folder = shutil.copytree(GENERATED[0], tmp_path / "mutant")
    source = folder / f"{analyse.prefix_of(folder)}.c"
    text, count = re.subn(old, new, source.read_text(), count=1)
    assert count == 1
    source.write_text(text)
    assert any(finding in f for f in analyse.unlisted(folder))


@pytest.mark.parametrize("row", ["| `misra-c2012-8.7` | `.c` | `void` | because |", "| `misra-c2012-8.7` | `.c` |"])
def test_a_deviation_needs_a_reason(row):
    with pytest.raises(ValueError, match="reason"):
        analyse.deviations(row)
