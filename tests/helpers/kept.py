"""The committed designs, and of run-time families that none of them has a small one, made when first asked for."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path

import codegen
from codegen.assurance.claims import OWN as OWN_CLAIMS
from codegen.observers import FAMILIES
from codegen.plant.load import loads

from .points import TOML
from .scripts import GENERATED

#: Plant files of families without a committed folder.
MADE = {"thresholds": TOML.replace('method = "zonotope"', """method = "zonotope"
tables = "dwell"
rows = 6
stages = 3"""),
        "schedule": TOML.replace('method = "zonotope"', """method = "zonotope"
tables = "schedule"
rows = 3
""").replace("[switching]", """[switching]
schedule = { every = 3, order = ["one", "two"] }""")}
HOME = Path(tempfile.gettempdir()) / "residua-kept"


def family_of(folder: Path) -> str:
    """Return the run-time family of a folder, without making it."""
    if folder not in GENERATED:
        return folder.name
    return json.loads((at(folder) / "resources.json").read_text(encoding="ascii"))["family"]


@cache
def at(folder: Path) -> Path:
    """Return a folder of ``KEPT``; one that is not committed is made first."""
    if folder in GENERATED:
        return folder
    home = Path(tempfile.mkdtemp(prefix="residua-kept-"))
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    plant = loads(MADE[folder.name])
    return codegen.generate(codegen.design(plant, method=plant.method), home / folder.name)


OWN = {json.loads((f / "resources.json").read_text(encoding="ascii"))["family"] for f in GENERATED}
KEPT = [*GENERATED, *(HOME / family for family in FAMILIES if family not in OWN and family in MADE)]
POINTS = [f for f in KEPT if f not in GENERATED or (json.loads((f / "design.json").read_text())["tables"]["float32"]
                                                   .get("shape"))]
#: Those of families whose assurance is stated, and whose C is therefore read back and proved.
STATED = [f for f in KEPT if FAMILIES[family_of(f)].stated]
#: Those of them that are neither framers nor point observers.
OTHERS = [f for f in STATED if family_of(f) in OWN_CLAIMS]
