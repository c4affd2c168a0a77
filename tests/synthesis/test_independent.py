"""The independent checker agrees with the certificate, depends on nothing of ours, and refuses what is false."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.checker import CHECKER

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = sorted(p.parent for p in (ROOT / "generated").glob("*/prove_*.c"))  # pairs of framers


def run(folder):
    # -I: isolated, no site-packages of ours on the path.
    return subprocess.run([sys.executable, "-I", "-S", str(CHECKER), str(folder)], capture_output=True, text=True)


def test_is_short_and_uses_the_standard_library_only():
    text = CHECKER.read_text()
    assert len(text.splitlines()) < 250
    names = {a.name.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)}
    assert names <= set(sys.stdlib_module_names)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_proves_every_committed_design(folder):
    done = run(folder)
    assert done.returncode == 0, done.stderr
    assert "proved for float32" in done.stdout and "proved for float64" in done.stdout and "constants of" in done.stdout


def test_what_it_does_not_know_is_not_called_proved(tmp_path):
    """An observer whose equations are of another kind than it reads: a sine in place of a cube."""
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "generated" / "disc_contact_descriptor-direct", copy)
    data = json.loads((copy / "design.json").read_text())
    data["plant"]["toml"] = data["plant"]["toml"].replace("position**3", "sin(position)")
    (copy / "design.json").write_text(json.dumps(data))
    done = run(copy)
    assert done.returncode == 2 and "proved" not in done.stdout and "not checked" in done.stderr


def scaled(path, factor):
    def change(data):
        *way, last = path
        for key in way:
            data = data[key]
        data[last] *= factor
    return change


T = ("tables", "float32")
C = ("certificate", "float32")
FALSE = {
    "upper offset": ("zammali_fd_tnl-interval", scaled((*T, "d_hi", 0, 0), 1 - 1e-5), "offset d_hi[0]"),
    "blind offset": ("cart_tnl-interval", scaled((*T, "a_lo", 0, 1), 1 - 1e-3), "offset a_lo[1]"),
    "output offset": ("emps_tnl-interval", scaled((*T, "c_hi", 0, 0), 1 - 1e-3), "offset c_hi[0]"),
    "gain": ("press_tnl-interval", scaled((*T, "L_hi", 0, 0, 0), 1 + 1e-3), "offset d_"),
    "matrix": ("press_tnl-interval", scaled((*T, "M_lo", 0, 0, 2), -1), "T A - L C < 0"),
    "range": ("cart_tnl-interval", scaled((*T, "x_hi", 0), 0.5), "box x too small"),
    "state box": ("cart_tnl-interval", scaled((*T, "box", 1), 0.5), ""),
    "ultimate box": ("cart_tnl-interval", scaled((*C, "steady_box", "width", 0), 0.9), "ultimate box width"),
    "Lyapunov matrix": ("relay_tnl-interval", scaled((*C, "P_hi", 0, 0), 1.5), ""),
    "mu": ("relay_tnl-interval", scaled((*C, "mu"), 0.9), "Lyapunov inequality"),
    "level": ("relay_tnl-interval", scaled((*C, "level"), 1 - 1e-6), "L-infinity level"),
    "dwell time": ("relay_tnl-interval", scaled((*C, "dwell_add"), 0), "dwell time"),
}


@pytest.mark.parametrize("name", FALSE)
def test_refuses_false_claims(name, tmp_path):
    folder, change, words = FALSE[name]
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "generated" / folder, copy)
    data = json.loads((copy / "design.json").read_text())
    change(data)
    (copy / "design.json").write_text(json.dumps(data))
    done = run(copy)
    assert done.returncode == 1 and done.stderr.startswith("refused: ") and words in done.stderr, done.stderr


def test_refuses_another_constant_in_the_c(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "generated" / "emps_tnl-interval", copy)
    text = (copy / "emps.c").read_text()
    number = re.search(r"198\.\d+F", text)[0]
    (copy / "emps.c").write_text(text.replace(number, "198.5F"))
    done = run(copy)
    assert done.returncode == 1 and "no table does" in done.stderr
