"""The committed designs, by what their families have."""

from __future__ import annotations

import json
from pathlib import Path

from codegen.assurance.claims import OWN as OWN_CLAIMS
from codegen.target.gappa import WITHOUT

from .scripts import GENERATED

KEPT = GENERATED


def family_of(folder: Path) -> str:
    """Return the run-time family of a folder."""
    return json.loads((folder / "resources.json").read_text(encoding="ascii"))["family"]


def first_of_each(folders: list[Path]) -> list[Path]:
    """Return one folder of each run-time family, with and without parameters: for what takes long."""
    found = {}
    for folder in folders:
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        found.setdefault((record["family"], record["n_theta"] > 0, "z_lo" in str(record["state"])), folder)
    return list(found.values())


def whole(folders: list[Path]) -> list[Path]:
    """Leave out mode estimators by themselves, whose C is all in that of what they guide or what runs beside them."""
    return [f for f in folders if family_of(f) not in ("sliding", "mode")]


POINTS = [f for f in KEPT if json.loads((f / "design.json").read_text())["tables"]["float32"].get("shape")]
#: Those whose C has margins for rounding.
ROUNDED = [f for f in KEPT if family_of(f) not in WITHOUT]
#: Those that are neither framers nor point observers.
OTHERS = [f for f in KEPT if family_of(f) in OWN_CLAIMS]
