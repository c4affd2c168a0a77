"""The scripts of c_tests/ as modules, and the folders that they work on."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GENERATED = sorted(p.parent for p in (ROOT / "generated").glob("*/design.json"))


def prefix_of(folder: Path) -> str:
    """Return the prefix of the C in a folder."""
    return json.loads((folder / "resources.json").read_text(encoding="ascii"))["prefix"]


def load(name: str):
    """Import c_tests/<name>.py, under a name that no other module has."""
    spec = importlib.util.spec_from_file_location(f"c_tests_{name}", ROOT / "c_tests" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module
