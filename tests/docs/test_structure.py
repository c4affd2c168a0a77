"""The shape of the house: arrows go one way, files stay small, folders explain themselves."""

from __future__ import annotations

import ast
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CODEGEN = ROOT / "codegen"

# room -> rooms it may import from (besides errors and itself)
ALLOWED = {
    "algebra": set(),
    "plant": {"algebra"},
    "observers": {"algebra"},
    "synthesis": {"algebra"},
    "certify": {"algebra"},
    "analysis": {"algebra", "observers", "plant"},
    "target": set(),
    "emit": {"observers", "target", "certify"},  # the Gappa script: what offsets leave for rounding
    "host": {"observers", "emit", "target"},  # its batch glue is a template like the rest of the C
    # Chooses among what the rooms of mathematics offer; a design is what it leaves.
    "selection": {"algebra", "plant", "synthesis", "certify", "analysis", "observers", "designs", "periods"},
    # Reads back what emit printed; what a filter's certificate is about stands above the rooms.
    "assurance": {"plant", "analysis", "certify", "emit", "target", "selection"},
    "report": {"observers", "plant", "analysis", "emit", "certify"},
}


def imports(path: Path) -> set[str]:
    """Rooms of ours that a file imports, wherever in the file."""
    found = set()
    room = path.relative_to(CODEGEN).parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            parts = (node.module or "").split(".") if node.module else []
            if node.level == 0 and parts and parts[0] == "codegen":
                base = parts[1:]
            elif node.level == 1 and len(room) == 2:
                base = [room[0], *parts]
            elif node.level >= 1:
                base = parts
            else:
                continue
            found |= {base[0]} if base else {a.name for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {a.name.split(".")[1] for a in node.names if a.name.startswith("codegen.")}
    return found


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_arrows_go_one_way(room):
    files = sorted((CODEGEN / room).glob("*.py"))
    assert files
    for path in files:
        foreign = imports(path) - ALLOWED[room] - {"errors", room, "__version__"}
        assert not foreign, f"{path.relative_to(ROOT)} imports {sorted(foreign)}"


def test_synthesis_and_certify_share_nothing():
    for path in (CODEGEN / "certify").glob("*.py"):
        assert "synthesis" not in imports(path)
    for path in (CODEGEN / "synthesis").glob("*.py"):
        assert "certify" not in imports(path)


def tracked() -> list[Path]:
    if not shutil.which("git") or not (ROOT / ".git").exists():  # an unpacked archive, or a machine without git
        passed_over = {".venv", "demo", "dist", "build", ".pytest_cache", ".hypothesis", ".ruff_cache", ".git"}
        return [p for p in ROOT.rglob("*") if p.is_file() and p.relative_to(ROOT).parts[0] not in passed_over
                and "__pycache__" not in p.parts]
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                            capture_output=True, text=True, check=True).stdout.split("\n")
    return [ROOT / name for name in listed if name and (ROOT / name).is_file()]


def test_files_stay_small():
    own = [p for p in tracked() if p.suffix in (".py", ".jinja", ".c", ".h", ".css")
           and "generated" not in p.relative_to(ROOT).parts[:1]]
    assert len(own) > 40
    long = {str(p.relative_to(ROOT)): n for p in own if (n := len(p.read_text().splitlines())) > 400}
    assert not long


def test_top_level_is_fixed():
    names = {p.relative_to(ROOT).parts[0] for p in tracked()}
    assert names == {"pyproject.toml", "codegen", "templates", "generated", "c_tests", "tests", "README.md",
                     "CHANGELOG.md", "LICENSE", "Makefile", ".ci", "benchmarks", ".gitignore"}


@pytest.mark.parametrize("folder", ["codegen", "templates", "generated", "c_tests", "tests", "benchmarks"])
def test_every_folder_explains_itself(folder):
    text = (ROOT / folder / "README.md").read_text()
    assert 3 < len(text.splitlines()) <= 60
