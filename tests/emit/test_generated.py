"""generated/ is fresh: the committed designs certify, and print to the committed bytes."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import pytest

from codegen.algebra.program import LIBM
from codegen.designs import read_checked, read_design
from codegen.emit.package import files
from codegen.plant.load import gallery_folder, gallery_names, load
from codegen.plant.weight_program import weight_program
from codegen.synthesis import METHODS

GENERATED = Path(__file__).resolve().parents[2] / "generated"
FOLDERS = sorted(p.parent for p in GENERATED.glob("*/design.json"))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_prints_to_the_same_bytes(folder):
    design = read_checked(folder)
    texts = files(design, measure=False)
    kept = {p.name for p in folder.iterdir()}
    for name, text in texts.items():
        if name == "resources.json":
            # Flash and stack are the compiler's, and another machine may have another: all else must agree.
            committed = json.loads((folder / name).read_text())
            assert committed.pop("measured")["host"]["flash_bytes"] > 0
            fresh = json.loads(text)
            fresh.pop("measured")
            committed.pop("target", None)
            assert committed == fresh
        elif name in kept:
            assert (folder / name).read_bytes() == text.encode(), f"{folder.name}/{name}: run `make generated`"
    prefix = design.plant.target.prefix
    header = " ".join(texts[f"{prefix}.h"].split())
    assert not re.search(r"is in (?:\.| |$)|\bnan\b|\bNone\b", header)
    assert {"design.json", f"{prefix}.h", f"{prefix}.c", f"test_{prefix}.c", "resources.json"} <= kept


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_design_is_that_of_the_gallery_plant(folder):
    design = read_design(folder)
    assert design.plant.text == (gallery_folder() / f"{design.plant.name}.toml").read_text()
    assert folder.name == f"{design.plant.name}_{design.method}"


def test_every_gallery_plant_and_method_is_there():
    make = runpy.run_path(str(GENERATED / "make.py"))
    taken = {n for n in gallery_names() if any(m.module.inapplicable(load(n)) is None for m in METHODS.values())}
    assert {read_design(f).plant.name for f in FOLDERS} == taken - set(make["LIKE_ANOTHER"]) - set(make["WITH_LIBM"])
    for name in make["WITH_LIBM"]:
        assert weight_program(load(name).polytope, "float32").count(*LIBM)
    # Plants that no method takes are of a kind that none takes: no other plant may go without a design.
    assert all(load(n).polytope is not None for n in set(gallery_names()) - taken)
    kept = {read_design(f).method for f in FOLDERS}
    assert kept == set(METHODS) - set(make["SAME_C"])
    assert {METHODS[m].family for m in make["SAME_C"]} <= {METHODS[m].family for m in kept}
